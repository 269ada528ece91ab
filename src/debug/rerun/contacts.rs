//! Draws contacts: points, normals, the depths of the deepest, and what has penetrated.

use bevy_ecs::{entity::EntityHashMap, prelude::*};
use rerun::{AnyValues, Arrows3D, AsComponents, Color, LineStrips3D, Points3D, Radius};

use super::{
    colors,
    recorder::{Layer, Share, TickWriter, path, row_bytes},
    settings::RerunSettings,
    tick::{Detected, Names},
    values,
};
use crate::{
    contacts::{Contact, StoredPair},
    surface::DeformableSurface,
};

/// How many contacts of a tick are labelled with their separation: more would hide each other.
const LABELS: usize = 3;

/// Points that are seen over a mesh from afar, in points on the screen.
const POINT: Radius = Radius(rerun::datatypes::Float32(-4.0));
const LINE: Radius = Radius(rerun::datatypes::Float32(-1.5));

/// Draws them all. Normals are half as long as the edges of the finer side.
pub(super) fn draw(
    writer: &mut TickWriter,
    detected: &Detected,
    settings: &RerunSettings,
    names: &Names,
    surfaces: &Query<&DeformableSurface>,
) {
    let edges: EntityHashMap<f32> = detected
        .active
        .surfaces
        .iter()
        .filter_map(|active| {
            Some((active.entity, surfaces.get(active.entity).ok()?.mean_edge() * active.pose.scale() as f32))
        })
        .collect();
    let of_pair = |pair: &StoredPair| {
        let sides = [pair.a.entity(), pair.b.entity()];
        // Of a surface that is gone by now nothing is known.
        let finer = sides.iter().filter_map(|side| edges.get(side)).copied().reduce(f32::min);
        (names.of_pair(sides), 0.5 * finer.unwrap_or(0.0))
    };
    let pairs: Vec<(String, f32, Vec<Contact>)> = detected
        .contacts
        .by_pair()
        .map(|(pair, contacts)| {
            let (name, normal_length) = of_pair(pair);
            (name, normal_length, contacts.collect())
        })
        .filter(|(.., contacts): &(_, _, Vec<Contact>)| !contacts.is_empty())
        .collect();
    if settings.contacts {
        let count = pairs.iter().map(|(.., contacts)| contacts.len()).sum();
        // A point with its color and numbers, and an arrow.
        let rows = row_bytes(7) + row_bytes(4);
        let mut share = writer.share(Layer::Contacts, count, (12 + 4 + 4 * 4) + (12 + 12), pairs.len(), rows);
        for (name, normal_length, contacts) in &pairs {
            draw_contacts(writer, &mut share, name, contacts, *normal_length);
        }
        draw_depths(writer, pairs.iter().filter_map(|(.., contacts)| deepest(contacts)).collect());
    }
    if settings.penetrations {
        let penetrations: Vec<(&String, Vec<Contact>)> = pairs
            .iter()
            .map(|(name, _, contacts)| (name, contacts.iter().copied().filter(has_passed).collect()))
            .filter(|(_, contacts): &(_, Vec<Contact>)| !contacts.is_empty())
            .collect();
        let count = penetrations.iter().map(|(_, contacts)| contacts.len()).sum();
        let mut share =
            writer.share(Layer::Penetrations, count, 2 * 12 + 4 + 4 * 4, penetrations.len(), 2 * row_bytes(7));
        for (name, contacts) in &penetrations {
            draw_penetrations(writer, &mut share, name, contacts);
        }
    }
}

/// Whether the two sides have passed each other here, or cross.
fn has_passed(contact: &Contact) -> bool {
    contact.distance() < 0.0 || contact.is_crossing()
}

fn color(contact: &Contact) -> Color {
    if has_passed(contact) {
        colors::PENETRATING
    } else if contact.separation() <= 0.0 {
        colors::TOUCHING
    } else {
        colors::NEAR
    }
}

/// Where a contact is, which triangles it is of, and how far apart they are.
fn numbers(contacts: &[Contact]) -> AnyValues {
    let side = |contact: &Contact| {
        let (a, b) = contact.triangles();
        [a, b].map(|triangle| triangle.map(|triangle| triangle.0))
    };
    let triangles: Vec<[Option<u32>; 2]> = contacts.iter().map(side).collect();
    let distances: Vec<f32> = contacts.iter().map(Contact::distance).collect();
    let separations: Vec<f32> = contacts.iter().map(Contact::separation).collect();
    let values = values::number(values::contact_triangles(&triangles), "distance", &distances);
    values::number(values, "separation", &separations)
}

fn draw_contacts(writer: &mut TickWriter, share: &mut Share, name: &str, contacts: &[Contact], normal_length: f32) {
    let kept: Vec<Contact> = share.places(contacts.len()).into_iter().map(|place| contacts[place]).collect();
    if kept.is_empty() {
        return;
    }
    let of = |kind: &str| path([Layer::Contacts.name(), kind, name]);
    // On the second side: the first is at the other end of the normal.
    let points: Vec<[f32; 3]> = kept.iter().map(|contact| contact.points().1.to_array()).collect();
    let marks = Points3D::new(points.iter().copied()).with_colors(kept.iter().map(color)).with_radii([POINT]);
    writer.passing_row(of("points"), &[&marks, &numbers(&kept)]);
    let arrows = Arrows3D::from_vectors(kept.iter().map(|contact| (contact.normal() * normal_length).to_array()))
        .with_origins(points)
        .with_colors([colors::YELLOW])
        .with_radii([LINE]);
    writer.passing_row(of("normals"), &[&arrows]);
}

fn deepest<'a>(contacts: &[Contact<'a>]) -> Option<Contact<'a>> {
    contacts.iter().copied().min_by(|a, b| a.separation().total_cmp(&b.separation()))
}

/// Labels the deepest of the deepest contact of each pair: contacts of one pair often lie where their labels would overlap.
fn draw_depths(writer: &mut TickWriter, mut contacts: Vec<Contact>) {
    contacts.sort_by(|a, b| a.separation().total_cmp(&b.separation()));
    contacts.truncate(LABELS);
    let mut share = writer.share(Layer::Contacts, contacts.len(), 12 + 4 + 16 + 4 * 4, 1, row_bytes(9));
    contacts.truncate(share.places(contacts.len()).len());
    if contacts.is_empty() {
        return;
    }
    let depths = Points3D::new(contacts.iter().map(|contact| contact.points().1.to_array()))
        .with_labels(contacts.iter().map(|contact| format!("{:.2e}", contact.separation())))
        .with_show_labels(true)
        .with_colors(contacts.iter().map(color))
        .with_radii([POINT]);
    writer.passing_row(path([Layer::Contacts.name(), "depths"]), &[&depths, &numbers(&contacts)]);
}

fn draw_penetrations(writer: &mut TickWriter, share: &mut Share, name: &str, contacts: &[Contact]) {
    let kept = share.places(contacts.len()).into_iter().map(|place| contacts[place]);
    let (crossings, passed): (Vec<Contact>, Vec<Contact>) = kept.partition(Contact::is_crossing);
    let of = |kind: &str| path([Layer::Penetrations.name(), kind, name]);
    if !crossings.is_empty() {
        let marks = Points3D::new(crossings.iter().map(|contact| contact.points().0.to_array()))
            .with_colors([colors::PURPLE])
            .with_radii([POINT]);
        writer.passing_row(of("crossings"), &[&marks, &numbers(&crossings)]);
    }
    if !passed.is_empty() {
        let ends = |contact: &Contact| [contact.points().0, contact.points().1].map(|point| point.to_array());
        let lines = LineStrips3D::new(passed.iter().map(ends)).with_colors([colors::PENETRATING]).with_radii([LINE]);
        let rows: [&dyn AsComponents; 2] = [&lines, &numbers(&passed)];
        writer.passing_row(of("depths"), &rows);
    }
}
