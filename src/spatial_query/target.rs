//! What lines and moving shapes may hit.

use glam::{DVec3, Vec3};

use super::{SurfaceQuery, SurfaceQueryFilter};
use crate::{detection::SurfaceState, kernel::query::solid::SolidLine, surface::ActiveShape};

/// What is hit, by its index. In the order in which hits at equal distances count.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Target {
    Triangle { surface: u32, triangle: u32 },
    Solid(usize),
}

impl SurfaceQuery<'_> {
    /// The state of an active surface, if a filter looks at it.
    pub(super) fn state(&self, surface: u32, filter: &SurfaceQueryFilter<'_>) -> Option<&SurfaceState> {
        let (entity, state) = self.states.active(surface);
        filter.looks_at(entity, state.query_layers()).then_some(state)
    }

    /// The solids that a filter looks at, with their indices.
    pub(super) fn solids<'a>(
        &'a self,
        filter: &'a SurfaceQueryFilter<'_>,
    ) -> impl Iterator<Item = (usize, &'a ActiveShape)> {
        let looks_at = |(_, shape): &(usize, &ActiveShape)| filter.looks_at(shape.entity, shape.query_layers);
        self.active.shapes.iter().enumerate().filter(looks_at)
    }
}

/// Whether numbers describe a motion.
pub(super) fn is_motion(start: Vec3, direction: Vec3, max_distance: f32) -> bool {
    start.is_finite() && direction.is_finite() && direction != Vec3::ZERO && max_distance >= 0.0
}

/// A line in the frame of a solid, along which a ball with a radius in world units moves.
pub(super) fn line_in(shape: &ActiveShape, origin: DVec3, direction: DVec3, radius: f64) -> SolidLine {
    let into = shape.pose.inverse();
    SolidLine {
        origin: into.transform_point(origin),
        direction: into.to_affine().matrix3 * direction,
        radius: radius / shape.pose.scale(),
    }
}
