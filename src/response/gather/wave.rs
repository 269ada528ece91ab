//! Constraints of many contacts at a time: which contacts may act, and what becomes of them, on all threads.

use super::{Between, Gatherer, Side, Watch};
use crate::{
    kernel::{
        contact::CompactContact,
        simd::parallel::{Parallel, Team},
    },
    response::{contact::ContactConstraint, particles::Particles, record::normal_of, scene::Scene},
};

/// Contacts per task.
const PART: usize = 512;

/// The most tasks. What they make, up to 0.7 MB, mostly stays in the cache until it is taken over.
const PARTS: usize = 8;

/// Consecutive contacts of a pair.
#[derive(Default)]
pub(super) struct Wave {
    parts: [Part; PARTS],
}

#[derive(Default)]
struct Part {
    fates: Vec<Fate>,
    made: Vec<ContactConstraint>,
}

/// What becomes of a contact.
#[derive(Clone, Copy)]
pub(super) enum Fate {
    /// It cannot act in the tick.
    Unwatched,
    /// It may act, and its constraint may add particles, so the caller makes it.
    Later,
    /// It may act, and needs no constraint.
    Dropped,
    /// It may act, and its constraint has been made.
    Made,
}

impl Wave {
    /// The most contacts.
    pub(super) const SIZE: usize = PART * PARTS;

    /// Chooses for each contact, and makes constraints between bodies, whose particles exist already.
    pub(super) fn fill(
        &mut self,
        gatherer: &Gatherer,
        team: &dyn Team,
        (particles, scene): (&Particles, &Scene<'_, '_>),
        between: &Between<'_>,
        contacts: &[CompactContact],
        watch: Watch,
    ) {
        self.parts.iter_mut().for_each(|part| part.fates.clear());
        let [a, b] = between.sides;
        let are_bodies = between.sides.iter().all(|side| matches!(side, Side::Body { .. }));
        team.run_tasks(contacts.chunks(PART).zip(&mut self.parts), PARTS, |(contacts, Part { fates, made })| {
            made.clear();
            fates.extend(contacts.iter().map(|contact| {
                if !gatherer.may_act(scene, between, contact, watch) {
                    return Fate::Unwatched;
                }
                if !are_bodies {
                    return Fate::Later;
                }
                let Some(normal) = normal_of(between.pair, contact) else { return Fate::Dropped };
                let [triangle_a, triangle_b] = gatherer.triangles_below(particles, scene, between, contact);
                let corners = [a.particles(triangle_a), b.particles(triangle_b)];
                let before = made.len();
                made.extend(gatherer.surface_constraint(particles, scene, between, (contact, normal), corners));
                if made.len() > before { Fate::Made } else { Fate::Dropped }
            }));
        });
    }

    /// What becomes of each contact, in their order, with its constraint if that has been made.
    pub(super) fn fates(&mut self) -> impl Iterator<Item = (Fate, Option<&mut ContactConstraint>)> {
        self.parts.iter_mut().flat_map(|Part { fates, made }| {
            let mut made = made.iter_mut();
            fates.iter().map(move |&fate| (fate, if matches!(fate, Fate::Made) { made.next() } else { None }))
        })
    }
}
