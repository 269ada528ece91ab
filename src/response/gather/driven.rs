//! The vertices of objects that the solver does not move, as particles.

use glam::DVec3;

use crate::{kernel::xpbd::coloring::NONE, response::particles::Particles};

/// Which vertices of a static or kinematic object are particles in this tick.
#[derive(Default)]
pub(super) struct Driven {
    /// The particle of each vertex; [`NONE`] for those that are not particles.
    pub(super) slots: Vec<u32>,
    pub(super) used: Vec<u32>,
    /// The last tick in which a contact touched the object.
    pub(super) tick: u64,
}

impl Driven {
    /// Returns the particle of a vertex, and creates it from its start and end position if it does not exist yet.
    pub(super) fn particle(
        &mut self,
        particles: &mut Particles,
        vertex: usize,
        body: Option<u32>,
        ends: impl FnOnce() -> Option<[DVec3; 2]>,
    ) -> Option<u32> {
        let slot = self.slots.get_mut(vertex)?;
        if *slot == NONE {
            let ends = ends()?;
            *slot = particles.len() as u32;
            self.used.push(vertex as u32);
            particles.push_on_body(body, ends);
        }
        Some(*slot)
    }
}
