//! The components of swept collision: what asks for it, where the last motion ended, and where the next one leads.

use bevy_ecs::{lifecycle::HookContext, prelude::*, world::DeferredWorld};
#[cfg(feature = "reflect")]
use bevy_reflect::prelude::*;
use glam::Vec3;

use crate::kernel::pose::Pose;

/// Sweeps the surface's motion since the last tick against every surface that it meets by its layers, and with
/// [`SelfCollision`](super::SelfCollision) against itself. This finds what passes through another surface between two
/// ticks, and the time at which they first meet. Read the results with [`SurfaceImpacts`](crate::SurfaceImpacts). Use it
/// for bullets, thin sheets, and anything else that may move farther than its contact distance in a tick. Contacts are the
/// same with or without it.
///
/// - Vertices move in straight lines in the world, from where they were in the last detection to where they are now.
///   With a [`SweptTarget`], they move from where they are now to the target.
/// - A surface without this component stands still where it is now, even if it has moved since the last tick, unless it
///   has a [`SweptTarget`]. If two surfaces move, give it to both. [Rigid shapes](super::RigidShape) of all kinds are
///   swept from their pose in the last detection to the current one, with or without it. A shape with this component
///   also meets surfaces without it.
/// - Only fast pairs of triangles are tested: at least one of the two has a vertex that moves farther than half the
///   thickness of its surface, relative to the common motion of the larger surface. Triangles that pass through each
///   other more slowly are in contact before and after, within half the contact distance. A surface without fast
///   triangles only costs a pass over its vertices.
/// - An impact is when two triangles are at distance 0. Thickness does not count. The time is never later than the true
///   one. It is earlier by at most the rounding error of f64, a motion of about 1e-13 of the size of the surfaces. What
///   touches or crosses at the start is an impact at time 0.
/// - In its first tick, after a jump ([`Teleported`](super::Teleported)), and after a pause, a surface has no motion
///   except to a target.
/// - Solids have their exact shape, except for cylinders and cones, which become inscribed ones with 256 flat sides.
///   What starts inside a solid meets it on its way out.
///
/// Detection only finds impacts. With [`XpbdResponsePlugin`](crate::response::XpbdResponsePlugin), the component also keeps
/// an [`XpbdBody`](crate::response::XpbdBody) from passing through things, see [what is
/// guaranteed](crate::response#what-is-guaranteed), and impacts are only looked for if a system reads them.
#[derive(Component, Clone, Copy, Debug, Default, PartialEq, Eq)]
#[require(PreviousPositions, SweptTarget)]
#[component(on_remove = Self::on_remove)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Component, Clone, Debug, Default, PartialEq))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SweptCollision;

impl SweptCollision {
    fn on_remove(mut world: DeferredWorld, context: HookContext) {
        world.commands().entity(context.entity).try_remove::<PreviousPositions>();
    }
}

/// Where a surface with [`SweptCollision`] was in the last detection. Its next motion starts there.
#[derive(Component, Clone, Debug, Default)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(opaque, Component, Clone, Debug, Default))]
pub struct PreviousPositions {
    /// Its positions, in its own frame.
    pub positions: Vec<Vec3>,
    /// Its pose in the world.
    pub pose: Pose,
    /// The version of the positions. Equal versions mean equal positions, bit by bit.
    pub(crate) version: u64,
    /// The number of that detection.
    pub(crate) detection: u64,
}

impl PreviousPositions {
    pub(crate) fn remember(&mut self, positions: &[Vec3], pose: Pose, version: u64, detection: u64) {
        if self.version != version || self.detection + 1 != detection {
            self.positions.clear();
            self.positions.extend_from_slice(positions);
        }
        (self.pose, self.version, self.detection) = (pose, version, detection);
    }
}

/// Where a solver expects the vertices of a surface at the end of this tick, in the surface's own frame and in the
/// order of [`SurfacePositions`](super::SurfacePositions). The motion from the current positions to these is swept, instead
/// of the motion since the last tick. Write it in [`DeformableSystems::Predict`](crate::DeformableSystems::Predict).
///
/// Every surface has one, and so has every rigid shape made of triangles. Default: empty, which means no target. A
/// surface with a target is swept even without [`SweptCollision`], as long as anything has that component.
///
/// The target is ignored if it is empty, has another length than the positions, or has a coordinate that is not finite.
/// It stays until it is written again, so empty it after a jump.
/// [`XpbdResponsePlugin`](crate::response::XpbdResponsePlugin) writes it for every body, and for what the game moves
/// near one.
#[derive(Component, Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Component, Clone, Debug, Default, PartialEq))]
pub struct SweptTarget(pub Vec<Vec3>);
