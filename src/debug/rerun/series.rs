//! Curves: time and pairs of every stage, steadiness of contacts, and depths.

use std::{
    collections::{HashMap, HashSet},
    time::Duration,
};

use bevy_ecs::{entity::EntityHashMap, prelude::*};
use glam::{DVec3, Vec3};
use rerun::{Scalars, SeriesLines};

use super::{
    colors,
    names::Names,
    recorder::{TickWriter, path},
    settings::RerunSettings,
};
use crate::{
    contacts::{Contact, SurfaceContacts},
    debug::tick::{Detected, Touch, Touches},
    detection::{DetectionDiagnostics, StageDiagnostics},
    kernel::contact::ContactKey,
    surface::{ActiveSurfaces, ContactSide, DeformableSurface, SurfacePositions},
};

/// The root entity of all curves, and its children, each a plot.
pub(super) const SERIES: &str = "series";
pub(super) const MILLISECONDS: &str = "milliseconds";
pub(super) const COUNTS: &str = "counts";
pub(super) const STEADINESS: &str = "steadiness";
pub(super) const MOTION: &str = "motion";
pub(super) const DEPTHS: &str = "depths";

/// If more surfaces touch in a tick, only the largest jitter is drawn.
const JITTER_CURVES: usize = 8;

/// Identifies a contact among all pairs.
type ContactName = (ContactSide, ContactSide, ContactKey);

/// What the curves remember of previous ticks.
#[derive(Default)]
pub(super) struct Series {
    /// Curves that already have a color and a name, by plot, in the order of their first appearance.
    named: HashMap<&'static str, Vec<String>>,
    /// Number of curves that have taken a color from the cycle.
    others: usize,
    contacts: HashMap<ContactName, Vec3>,
    /// World positions of vertices, in this tick and the two before it.
    vertices: EntityHashMap<Track>,
}

/// World positions of the vertices of a surface, newest tick first.
#[derive(Default)]
struct Track([Vec<DVec3>; 3]);

/// Steadiness of contacts from the last tick to this one.
pub(super) struct Steadiness {
    /// Share of contacts that only one of the two ticks has, from 0 to 1.
    churn: f64,
    /// Largest rotation of the normal of a contact that both ticks have, in degrees.
    normal_jump: f64,
    /// The name of each touching surface, with the mean second difference of the positions of its touching vertices, in
    /// mean edges.
    jitter: Vec<(String, f64)>,
    /// Largest displacement of a vertex, in contact distances of two surfaces with its surface's thickness. Above 1, it
    /// may tunnel.
    motion: f64,
}

impl Series {
    /// Observes a tick, whether it is recorded or not.
    pub(super) fn observe(
        &mut self,
        detected: &Detected,
        surfaces: &Query<&DeformableSurface>,
        names: &Names,
        touches: &Touches,
    ) -> Steadiness {
        let mut contacts = HashMap::new();
        for (pair, of_pair) in detected.contacts.by_pair() {
            contacts.extend(of_pair.map(|contact| ((pair.a, pair.b, contact.key()), contact.normal())));
        }
        let before = std::mem::replace(&mut self.contacts, contacts);
        let both: Vec<(Vec3, Vec3)> =
            before.iter().filter_map(|(name, &normal)| Some((normal, *self.contacts.get(name)?))).collect();
        let either = before.len() + self.contacts.len() - both.len();
        let turn = |&(one, other): &(Vec3, Vec3)| one.as_dvec3().angle_between(other.as_dvec3()).to_degrees();

        let (mut jitter, mut motion) = (Vec::new(), 0.0_f64);
        let mut tracks = std::mem::take(&mut self.vertices);
        for (place, surface) in detected.active.surfaces.iter().enumerate() {
            let Some((positions, _)) = detected.surface(surface) else { continue };
            // Positions before a jump say nothing about the motion after it.
            let before = tracks.remove(&surface.entity).filter(|_| !surface.fresh);
            let Track([newest, last, _]) = before.unwrap_or_default();
            let vertices = positions.iter().map(|&position| surface.pose.transform_point(position.as_dvec3()));
            let track = Track([vertices.collect(), newest, last]);
            let mean_edge = surfaces
                .get(surface.entity)
                .map_or(0.0, |made_from| f64::from(made_from.mean_edge()) * surface.pose.scale());
            let touching = surface.topology.triangles().iter().zip(&touches.triangles[place]);
            let contact_distance = 2.0 * f64::from(surface.thickness);
            if contact_distance > 0.0 {
                motion = motion.max(track.longest_way() / contact_distance);
            }
            let mut touches = vec![false; positions.len()];
            for (corners, _) in touching.filter(|&(_, &touch)| touch != Touch::None) {
                for &vertex in corners {
                    touches[vertex as usize] = true;
                }
            }
            if mean_edge > 0.0
                && let Some(mean) = track.mean_second_difference(&touches)
            {
                jitter.push((names.of(surface.entity), mean / mean_edge));
            }
            self.vertices.insert(surface.entity, track);
        }
        let there: HashSet<String> =
            detected.active.surfaces.iter().map(|surface| jitter_of(&names.of(surface.entity))).collect();
        if let Some(named) = self.named.get_mut(STEADINESS) {
            // End the curves of surfaces that are gone. Otherwise their number could grow without bound.
            named.retain(|curve| !curve.starts_with(&jitter_of("")) || there.contains(curve));
        }
        Steadiness {
            churn: if either == 0 { 0.0 } else { 1.0 - both.len() as f64 / either as f64 },
            normal_jump: both.iter().map(turn).fold(0.0, f64::max),
            jitter,
            motion,
        }
    }

    /// Forgets the previous ticks, because the next observed tick does not follow them.
    pub(super) fn forget(&mut self) {
        self.contacts.clear();
        self.vertices.clear();
    }

    /// Draws the results of detection. `recording` is the time that recording the last tick took.
    pub(super) fn draw(
        &mut self,
        writer: &mut TickWriter,
        diagnostics: &DetectionDiagnostics,
        settings: &RerunSettings,
        steadiness: &Steadiness,
        recording: Duration,
    ) {
        if settings.times {
            let mut stages: Vec<(String, f64)> = diagnostics
                .stages
                .iter()
                .map(|stage| (stage.name.to_owned(), stage.duration.as_secs_f64() * 1.0e3))
                .collect();
            stages.push(("recording".to_owned(), recording.as_secs_f64() * 1.0e3));
            self.draw_plot(writer, MILLISECONDS, stages);
        }
        let pairs = diagnostics.stages.iter().filter(|stage| stage.pairs_in + stage.pairs_out > 0);
        let pairs = pairs.filter(|stage| stage.name != "pair surfaces");
        let left = |stage: &StageDiagnostics| match stage.name {
            "contacts" => "contacts".to_owned(),
            name => format!("after {name}"),
        };
        let mut counts: Vec<(String, f64)> = pairs.map(|stage| (left(stage), stage.pairs_out as f64)).collect();
        counts.extend([
            ("examined".to_owned(), diagnostics.pairs_examined as f64),
            ("recipes refreshed".to_owned(), diagnostics.recipes_refreshed as f64),
        ]);
        self.draw_plot(writer, COUNTS, counts);
        let mut steady = vec![
            ("contact churn".to_owned(), steadiness.churn),
            ("normal jump in turns".to_owned(), steadiness.normal_jump / 360.0),
        ];
        let jitter = &steadiness.jitter;
        steady.push(("largest jitter".to_owned(), jitter.iter().map(|&(_, jitter)| jitter).fold(0.0, f64::max)));
        if jitter.len() <= JITTER_CURVES {
            steady.extend(jitter.iter().map(|(name, jitter)| (jitter_of(name), *jitter)));
        }
        self.draw_plot(writer, STEADINESS, steady);
        self.draw_plot(writer, MOTION, vec![("largest motion".to_owned(), steadiness.motion)]);
    }

    /// Draws depths before and after the response. Positions have moved since detection, poses have not.
    pub(super) fn draw_answer(
        &mut self,
        writer: &mut TickWriter,
        contacts: &SurfaceContacts,
        active: &ActiveSurfaces,
        positions: &Query<&SurfacePositions>,
    ) {
        let poses: EntityHashMap<_> = active.surfaces.iter().map(|surface| (surface.entity, &surface.pose)).collect();
        let opened = |contact: &Contact| -> f64 {
            let share = |entry: crate::contacts::StencilEntry| {
                let vertex = entry.vertex.0 as usize;
                let then = self.vertices.get(&entry.entity)?.0[0].get(vertex)?;
                let now = positions.get(entry.entity).ok()?.0.get(vertex)?;
                let moved = poses.get(&entry.entity)?.transform_point(now.as_dvec3()) - *then;
                Some(f64::from(entry.weight) * entry.normal.as_dvec3().dot(moved))
            };
            contact.stencil().into_iter().filter_map(share).sum()
        };
        let found = Depths::of(contacts.iter().map(|contact| (contact, 0.0)));
        let left = Depths::of(contacts.iter().map(|contact| (contact, opened(&contact))));
        let curves = [
            ("overlap found", found.overlap),
            ("overlap left", left.overlap),
            ("penetration found", found.penetration),
            ("penetration left", left.penetration),
        ];
        self.draw_plot(writer, DEPTHS, curves.map(|(curve, depth)| (curve.to_owned(), depth)).to_vec());
    }

    /// Draws the curves of a plot. A curve without a value in this tick drops to 0.
    fn draw_plot(&mut self, writer: &mut TickWriter, plot: &'static str, curves: Vec<(String, f64)>) {
        let named = self.named.entry(plot).or_default();
        let of = |curve: &str| path([SERIES, plot, curve]);
        for (curve, _) in &curves {
            if !named.contains(curve) {
                let color = colors::curve(curve).unwrap_or_else(|| {
                    self.others += 1;
                    colors::OTHER_CURVES[self.others % colors::OTHER_CURVES.len()]
                });
                let style = SeriesLines::new().with_names([curve.as_str()]).with_colors([color]);
                writer.timeless_row(of(curve), &style);
                named.push(curve.clone());
            }
        }
        let values: HashMap<&str, f64> = curves.iter().map(|(curve, value)| (curve.as_str(), *value)).collect();
        for curve in named.iter() {
            writer.row(of(curve), &[&Scalars::single(values.get(curve.as_str()).copied().unwrap_or(0.0))]);
        }
    }
}

/// Name of the jitter curve of a surface.
fn jitter_of(surface: &str) -> String {
    format!("jitter of {surface}")
}

impl Track {
    /// Largest displacement of a vertex since the last tick; 0 if there is no last tick.
    fn longest_way(&self) -> f64 {
        let [now, last, _] = &self.0;
        let ways = now.iter().zip(last).map(|(now, last)| now.distance(*last));
        if now.len() == last.len() { ways.fold(0.0, f64::max) } else { 0.0 }
    }

    /// Mean over the marked vertices. `None` if none is marked, or if the track is too short.
    fn mean_second_difference(&self, marked: &[bool]) -> Option<f64> {
        let [now, last, before] = &self.0;
        let count = marked.iter().filter(|&&marked| marked).count();
        if count == 0 || [last.len(), before.len()] != [now.len(); 2] {
            return None;
        }
        let difference = |vertex: usize| (now[vertex] - 2.0 * last[vertex] + before[vertex]).length();
        Some((0..marked.len()).filter(|&vertex| marked[vertex]).map(difference).sum::<f64>() / count as f64)
    }
}

/// Depths of the deepest contacts, in world units.
struct Depths {
    /// Overlap: how much closer than the contact distance.
    overlap: f64,
    /// Penetration: how far the sides have passed each other.
    penetration: f64,
}

impl Depths {
    /// Depths of contacts. Each comes with the distance by which it has opened since detection.
    fn of<'a>(contacts: impl Iterator<Item = (Contact<'a>, f64)>) -> Self {
        contacts.fold(Self { overlap: 0.0, penetration: 0.0 }, |deepest, (contact, opened)| Self {
            overlap: deepest.overlap.max(-(f64::from(contact.separation()) + opened)),
            penetration: deepest.penetration.max(-(f64::from(contact.distance()) + opened)),
        })
    }
}
