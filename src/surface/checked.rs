//! What `Prepare` remembers of an entity: under which number it was registered, and whether its positions passed.

use bevy_ecs::{change_detection::Tick, lifecycle::HookContext, prelude::*, world::DeferredWorld};
use bytemuck::cast_slice;
use glam::Vec3;

use super::{components::SurfacePositions, quarantine::QuarantineReason};
use crate::kernel::mesh::ids::VertexId;

/// The number under which an entity was first registered as a surface or shape. 0 if it was spawned before the plugin
/// was added.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq)]
#[component(on_add = Self::on_add)]
pub(crate) struct Registration(pub(crate) u64);

/// The registration number that was assigned last.
#[derive(Resource, Default)]
pub(crate) struct NextRegistration(u64);

impl Registration {
    fn on_add(mut world: DeferredWorld, context: HookContext) {
        let Some(mut next) = world.get_resource_mut::<NextRegistration>() else { return };
        next.0 += 1;
        let number = next.0;
        if let Some(mut registration) = world.get_mut::<Self>(context.entity) {
            registration.0 = number;
        }
    }
}

/// The result of the last check of a surface's positions. No stage looks for NaN and infinity in them again.
#[derive(Component, Clone, Copy, Debug, Default)]
pub(crate) struct CheckedPositions {
    /// If all positions were finite: their change tick, and an upper bound of the magnitude of all coordinates.
    passed: Option<(Tick, f32)>,
}

impl CheckedPositions {
    /// Checks positions that have changed since they last passed. Returns an upper bound of the magnitude of all
    /// coordinates.
    pub(crate) fn check(&mut self, positions: &Ref<SurfacePositions>) -> Result<f32, QuarantineReason> {
        let changed = positions.last_changed();
        if let Some((seen, at_most)) = self.passed
            && seen == changed
        {
            return Ok(at_most);
        }
        self.passed = None;
        let at_most = if first_large(&positions.0).is_none() { LARGE } else { f32::MAX };
        if at_most == f32::MAX
            && let Some(vertex) = first_non_finite(&positions.0)
        {
            return Err(QuarantineReason::NonFinitePosition(vertex));
        }
        self.passed = Some((changed, at_most));
        Ok(at_most)
    }
}

/// 2^60. In an ordinary pose, smaller coordinates are far from the limits of f32.
const LARGE: f32 = f32::from_bits((127 + 60) << 23);

/// The first position that is not finite.
pub(crate) fn first_non_finite(positions: &[Vec3]) -> Option<VertexId> {
    first_beyond(positions, f32::INFINITY)
}

/// The first position that has a coordinate of magnitude [`LARGE`] or more, or is not finite.
fn first_large(positions: &[Vec3]) -> Option<VertexId> {
    first_beyond(positions, LARGE)
}

/// The first position with a coordinate that is NaN or has at least the magnitude `power`, a power of two.
fn first_beyond(positions: &[Vec3], power: f32) -> Option<VertexId> {
    /// Numbers per block, so many that the loop over a block outweighs the check after it.
    const BLOCK: usize = 192;
    const EXPONENT: u32 = 0x7f80_0000;
    // Infinity and NaN have the largest exponent.
    let is_special = |bits: u32| bits & EXPONENT >= power.to_bits();
    let numbers: &[u32] = cast_slice(positions);
    let has_special = |block: &[u32]| block.iter().fold(false, |found, &bits| found | is_special(bits));
    let block = numbers.chunks(BLOCK).position(has_special)?;
    let within = numbers[block * BLOCK..].iter().position(|&bits| is_special(bits))?;
    Some(VertexId(((block * BLOCK + within) / 3) as u32))
}
