//! Draws contacts: points, normals, the separation of the deepest, and penetrations.

use bevy_ecs::prelude::*;
use rerun::{AnyValues, Arrows3D, AsComponents, LineStrips3D, Points3D, Radius};

use super::{
    colors,
    names::{ALL_PAIRS, MANY_PAIRS, Names},
    recorder::{Layer, Share, TickWriter, path, row_bytes},
    settings::RerunSettings,
    values,
};
use crate::{
    contacts::{Contact, StoredPair},
    debug::{
        contacts::NormalLengths,
        tick::{Detected, has_passed},
    },
    surface::DeformableSurface,
};

/// Sizes that are visible over a mesh from afar, in points on the screen.
const POINT: Radius = Radius(rerun::datatypes::Float32(-4.0));
const LINE: Radius = Radius(rerun::datatypes::Float32(-1.5));

/// Draws all contacts.
pub(super) fn draw(
    writer: &mut TickWriter,
    detected: &Detected,
    settings: &RerunSettings,
    names: &Names,
    surfaces: &Query<&DeformableSurface>,
) {
    let lengths = NormalLengths::new(detected, surfaces);
    let of_pair = |pair: &StoredPair| (names.of_pair([pair.a.entity(), pair.b.entity()]), lengths.of(pair));
    let named: Vec<(String, f32)> = detected.contacts.by_pair().map(|(pair, _)| of_pair(pair)).collect();
    let pairs = detected.contacts.by_pair().zip(&named).map(|((_, contacts), (name, normal_length))| {
        contacts.map(|contact| Drawn { contact, pair: name, normal_length: *normal_length }).collect()
    });
    let pairs: Vec<Vec<Drawn>> = pairs.filter(|contacts: &Vec<Drawn>| !contacts.is_empty()).collect();
    let penetrations = pairs.iter().map(|contacts| passed(contacts)).filter(|contacts| !contacts.is_empty()).collect();
    if settings.contacts {
        let deepest =
            pairs.iter().flatten().copied().min_by(|a, b| a.contact.separation().total_cmp(&b.contact.separation()));
        let groups = grouped(pairs);
        let count = groups.iter().map(|(_, contacts)| contacts.len()).sum();
        // A point with its color and numbers, and an arrow.
        let rows = row_bytes(8) + row_bytes(4);
        let mut share = writer.share(Layer::Contacts, count, (12 + 4 + 4 * 4) + (12 + 12), groups.len(), rows);
        for (name, contacts) in &groups {
            draw_contacts(writer, &mut share, name, contacts);
        }
        if let Some(deepest) = deepest {
            draw_depth(writer, deepest);
        }
    }
    if settings.penetrations {
        let groups = grouped(penetrations);
        let count = groups.iter().map(|(_, contacts)| contacts.len()).sum();
        let mut share = writer.share(Layer::Penetrations, count, 2 * 12 + 4 + 4 * 4, groups.len(), 2 * row_bytes(8));
        for (name, contacts) in &groups {
            draw_penetrations(writer, &mut share, name, contacts);
        }
    }
}

/// A contact as it is drawn.
#[derive(Clone, Copy)]
struct Drawn<'a> {
    contact: Contact<'a>,
    /// The name of its pair.
    pair: &'a str,
    normal_length: f32,
}

/// Groups contacts by pair, or into a single group if there are too many pairs for a list.
fn grouped(pairs: Vec<Vec<Drawn<'_>>>) -> Vec<(&str, Vec<Drawn<'_>>)> {
    if pairs.len() > MANY_PAIRS {
        vec![(ALL_PAIRS, pairs.into_iter().flatten().collect())]
    } else {
        pairs.into_iter().map(|contacts| (contacts[0].pair, contacts)).collect()
    }
}

fn passed<'a>(contacts: &[Drawn<'a>]) -> Vec<Drawn<'a>> {
    contacts.iter().copied().filter(|drawn| has_passed(&drawn.contact)).collect()
}

/// The pair, triangles, distance, and separation of each contact.
fn numbers(contacts: &[Drawn]) -> AnyValues {
    let side = |drawn: &Drawn| {
        let (a, b) = drawn.contact.triangles();
        [a, b].map(|triangle| triangle.map(|triangle| triangle.0))
    };
    let triangles: Vec<[Option<u32>; 2]> = contacts.iter().map(side).collect();
    let distances: Vec<f32> = contacts.iter().map(|drawn| drawn.contact.distance()).collect();
    let separations: Vec<f32> = contacts.iter().map(|drawn| drawn.contact.separation()).collect();
    let values = values::number(values::contact_triangles(&triangles), "distance", &distances);
    let values = values::number(values, "separation", &separations);
    // Otherwise the entity is named after the pair.
    let is_mixed = contacts.iter().any(|drawn| drawn.pair != contacts[0].pair);
    if is_mixed { values::texts(values, "pair", contacts.iter().map(|drawn| drawn.pair)) } else { values }
}

fn draw_contacts(writer: &mut TickWriter, share: &mut Share, name: &str, contacts: &[Drawn]) {
    let kept: Vec<Drawn> = share.places(contacts.len()).into_iter().map(|place| contacts[place]).collect();
    if kept.is_empty() {
        return;
    }
    let of = |kind: &str| path([Layer::Contacts.name(), kind, name]);
    // Draw the point on the first side. The second side is at the other end of the normal.
    let points: Vec<[f32; 3]> = kept.iter().map(|drawn| drawn.contact.points().0.to_array()).collect();
    let point_colors = kept.iter().map(|drawn| colors::contact(&drawn.contact));
    let marks = Points3D::new(points.iter().copied()).with_colors(point_colors).with_radii([POINT]);
    writer.passing_row(of("points"), &[&marks, &numbers(&kept)]);
    let normals = kept.iter().map(|drawn| (drawn.contact.normal() * drawn.normal_length).to_array());
    let arrows = Arrows3D::from_vectors(normals).with_origins(points).with_colors([colors::NORMALS]).with_radii([LINE]);
    writer.passing_row(of("normals"), &[&arrows]);
}

/// Labels the deepest contact. Further labels would hide each other: deep contacts are often close together.
fn draw_depth(writer: &mut TickWriter, drawn: Drawn) {
    if writer.share(Layer::Contacts, 1, 12 + 4 + 16 + 4 * 4, 1, row_bytes(10)).places(1).is_empty() {
        return;
    }
    let depth = Points3D::new([drawn.contact.points().1.to_array()])
        .with_labels([format!("{:.2e}", drawn.contact.separation())])
        .with_show_labels(true)
        .with_colors([colors::contact(&drawn.contact)])
        .with_radii([POINT]);
    writer.passing_row(path([Layer::Contacts.name(), "deepest"]), &[&depth, &numbers(&[drawn])]);
}

fn draw_penetrations(writer: &mut TickWriter, share: &mut Share, name: &str, contacts: &[Drawn]) {
    let kept = share.places(contacts.len()).into_iter().map(|place| contacts[place]);
    let (crossings, passed): (Vec<Drawn>, Vec<Drawn>) = kept.partition(|drawn| drawn.contact.is_crossing());
    let of = |kind: &str| path([Layer::Penetrations.name(), kind, name]);
    if !crossings.is_empty() {
        let marks = Points3D::new(crossings.iter().map(|drawn| drawn.contact.points().0.to_array()))
            .with_colors([colors::CROSSINGS])
            .with_radii([POINT]);
        writer.passing_row(of("crossings"), &[&marks, &numbers(&crossings)]);
    }
    if !passed.is_empty() {
        let ends = |drawn: &Drawn| [drawn.contact.points().0, drawn.contact.points().1].map(|point| point.to_array());
        let lines = LineStrips3D::new(passed.iter().map(ends)).with_colors([colors::PENETRATING]).with_radii([LINE]);
        let rows: [&dyn AsComponents; 2] = [&lines, &numbers(&passed)];
        writer.passing_row(of("depths"), &rows);
    }
}
