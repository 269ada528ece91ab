//! Pairs of surfaces, and of surfaces with shapes: which frame a pair is tested in, its distances, and its candidates.

use bevy_ecs::prelude::*;
#[cfg(feature = "reflect")]
use bevy_reflect::prelude::*;
use glam::Vec3;

use crate::{
    kernel::{mesh::bounds::Aabb, pose::Pose},
    settings::EVENT_HYSTERESIS,
    surface::{ActiveShape, ActiveSurface, ActiveSurfaces, ContactMethod, FilterSide, SurfaceShape},
};

mod moved;

/// Lengths that are rounded to f32 on the way to a box are enlarged by this factor.
pub(super) const GROWTH_SLACK: f32 = 1.0 + 4.0 * f32::EPSILON;

/// The second side of a pair, by its index in [`ActiveSurfaces`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OtherSide {
    /// A surface. In a self-collision, the same one.
    Surface(usize),
    /// A rigid shape.
    Shape(usize),
}

/// Which side's frame a pair is tested in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Frame {
    /// The first surface.
    First,
    /// The second surface or the shape.
    Second,
}

/// A surface and something that it may touch, with the triangles that may be within range.
#[derive(Clone, Debug)]
pub struct SurfacePair {
    /// The index of the first side in [`ActiveSurfaces::surfaces`].
    pub first: usize,
    /// The second side. Of two surfaces, the later one.
    pub second: OtherSide,
    /// How the pair is tested.
    pub method: ContactMethod,
    /// Triangles touch within this distance, in world units.
    pub contact_distance: f32,
    /// Contacts are reported up to this distance, in world units.
    pub reported_distance: f32,
    /// The largest distance at which a pair of triangles matters, in world units.
    pub range: f32,
    /// How far any patches of both sides together may be from their triangles, in world units. 0 if both are flat.
    pub bulge: f32,
    /// Whose own frame the pair is tested in: that of the shape, or of the surface with more triangles.
    pub frame: Frame,
    /// World pose of that frame.
    pub frame_pose: Pose,
    /// Transforms the other side's own frame to that frame.
    pub relative_pose: Pose,
    /// Triangles of the other surface that may be near, with their boxes in that frame, if the algorithm lists them.
    pub moved_triangles: Vec<(u32, Aabb)>,
    /// Vertices of the other surface in that frame. NaN if none of their triangles was transformed. Empty if none was,
    /// or if the positions are in that frame already.
    pub moved_positions: Vec<Vec3>,
    /// Upper bound of the rounding error of those, in the unit of the frame.
    pub moved_rounding: f32,
    /// The candidate pairs: triangles of the first and second surface whose boxes overlap. In a self-collision, the
    /// lower triangle comes first, and neighbors are left out. With a shape, the second number is 0. If the method
    /// culls, pairs that a slab separates by more than the range may be missing (the tree leaves them out, see
    /// [`PairFate::Planes`](crate::kernel::pair_fate::PairFate::Planes)), and so may pairs that are known to be farther
    /// apart, see [`PairFate::Remembered`](crate::kernel::pair_fate::PairFate::Remembered).
    pub triangles: Vec<[u32; 2]>,
    /// Whether any pair of triangles is not among these because of
    /// [`RestContactsIgnored`](crate::RestContactsIgnored), [`TriangleLayers`](crate::TriangleLayers), or
    /// [`ContactFilter`](crate::ContactFilter).
    pub any_left_out: bool,
}

impl SurfacePair {
    /// Whether a surface is paired with itself.
    #[must_use]
    pub fn is_self(&self) -> bool {
        self.second == OtherSide::Surface(self.first)
    }

    /// The vertices of the first and second surface in the pair's frame, given those in their own frames.
    pub(crate) fn positions<'a>(&'a self, first: &'a [Vec3], second: &'a [Vec3]) -> [&'a [Vec3]; 2] {
        match self.frame {
            _ if self.moved_positions.is_empty() => [first, second],
            Frame::First => [first, &self.moved_positions],
            Frame::Second => [&self.moved_positions, second],
        }
    }

    /// Whether one of the surfaces is smooth.
    pub(crate) fn is_smooth(&self, active: &ActiveSurfaces) -> bool {
        let is_smooth = |place: usize| active.surfaces[place].shape == SurfaceShape::Smooth;
        is_smooth(self.first) || matches!(self.second, OtherSide::Surface(second) if is_smooth(second))
    }

    /// What both sides know about the pairs of triangles that are left out.
    pub(crate) fn filter_sides(&self, active: &ActiveSurfaces) -> [FilterSide; 2] {
        let second = match self.second {
            OtherSide::Surface(second) => FilterSide::of_surface(&active.surfaces[second]),
            OtherSide::Shape(place) => FilterSide::of_shape(&active.shapes[place]),
        };
        [FilterSide::of_surface(&active.surfaces[self.first]), second]
    }

    /// The poses of the first and second surface in the pair's frame.
    pub(crate) fn poses(&self) -> [&Pose; 2] {
        match self.frame {
            Frame::First => [&Pose::IDENTITY, &self.relative_pose],
            Frame::Second => [&self.relative_pose, &Pose::IDENTITY],
        }
    }
}

/// The results of the broad phase: pairs of surfaces in their order, then surfaces with shapes.
#[derive(Resource, Clone, Debug, Default)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(opaque, Resource, Clone, Debug, Default))]
pub struct CandidateTrianglePairs {
    pub(crate) pairs: Vec<SurfacePair>,
}

impl CandidateTrianglePairs {
    /// The pairs.
    #[must_use]
    pub fn pairs(&self) -> &[SurfacePair] {
        &self.pairs
    }

    /// The number of candidate pairs of triangles.
    #[must_use]
    pub fn triangle_pair_count(&self) -> usize {
        self.pairs.iter().map(|pair| pair.triangles.len()).sum()
    }
}

/// Writes for each active surface whether it is part of a pair that is tested by `method`.
pub(crate) fn surfaces_with_method<'a>(
    active: &ActiveSurfaces,
    pairs: impl Iterator<Item = &'a SurfacePair>,
    method: ContactMethod,
    used: &mut Vec<bool>,
) {
    used.clear();
    used.resize(active.surfaces.len(), false);
    for pair in pairs.filter(|pair| pair.method == method) {
        used[pair.first] = true;
        if let OtherSide::Surface(second) = pair.second {
            used[second] = true;
        }
    }
}

/// Pairs of triangles, transformed triangles, and transformed positions.
pub(super) type PairLists = (Vec<[u32; 2]>, Vec<(u32, Aabb)>, Vec<Vec3>);

/// The margin of a pair. Halves are added, because the boxes of both sides are grown by them.
fn mean_margin(a: f32, b: f32) -> f32 {
    0.5 * a + 0.5 * b
}

fn range(contact_distance: f32, margin: f32) -> f32 {
    (contact_distance * (1.0 + EVENT_HYSTERESIS)).max(contact_distance + margin)
}

pub(super) fn surface_pair(
    surfaces: &[ActiveSurface],
    first: usize,
    second: usize,
    (triangles, moved_triangles, moved_positions): PairLists,
) -> SurfacePair {
    let (a, b) = (&surfaces[first], &surfaces[second]);
    let contact_distance = a.thickness + b.thickness;
    let margin = if first == second { a.own_margin } else { mean_margin(a.margin, b.margin) };
    // The smaller surface is transformed, so a body of a few triangles over a landscape costs what the body costs.
    let (frame, frame_pose, relative_pose) = if b.topology.triangles().len() > a.topology.triangles().len() {
        (Frame::Second, b.pose, a.pose.relative_to(&b.pose))
    } else {
        (Frame::First, a.pose, b.pose.relative_to(&a.pose))
    };
    SurfacePair {
        first,
        second: OtherSide::Surface(second),
        method: a.method.max(b.method),
        contact_distance,
        reported_distance: contact_distance + margin,
        range: range(contact_distance, margin),
        bulge: 0.0,
        frame,
        frame_pose,
        relative_pose,
        moved_triangles,
        moved_positions,
        moved_rounding: 0.0,
        triangles,
        any_left_out: false,
    }
}

pub(super) fn shape_pair(
    surface: &ActiveSurface,
    first: usize,
    shape: &ActiveShape,
    place: usize,
    (triangles, moved_triangles, moved_positions): PairLists,
) -> SurfacePair {
    let margin = mean_margin(surface.margin, shape.margin);
    SurfacePair {
        first,
        second: OtherSide::Shape(place),
        method: ContactMethod::Exact,
        contact_distance: surface.thickness,
        reported_distance: surface.thickness + margin,
        range: range(surface.thickness, margin),
        bulge: 0.0,
        frame: Frame::Second,
        frame_pose: shape.pose,
        relative_pose: surface.pose.relative_to(&shape.pose),
        moved_triangles,
        moved_positions,
        moved_rounding: 0.0,
        triangles,
        any_left_out: false,
    }
}

/// The box of a shape in a surface's own frame, grown by what the surface's boxes lack. `None` for a half-space.
pub(super) fn shape_bounds(pair: &SurfacePair, shape: &ActiveShape, surface: &ActiveSurface) -> Option<Aabb> {
    let bounds = moved_box(&shape.geometry.bounds()?, &pair.relative_pose.inverse());
    // The boxes of the triangles include the thickness and half the surface's margin. A shape has no thickness, and no
    // box that includes half of its own margin.
    let missing = (pair.range - world_growth(surface.thickness, surface.margin)).max(0.0);
    Some(bounds.grown((f64::from(missing) / surface.pose.scale()) as f32))
}

/// Whether a triangle's box reaches a half-space.
pub(super) fn reaches_half_space(pair: &SurfacePair, normal: glam::DVec3, bounds: &Aabb) -> bool {
    let moved = moved_box(bounds, &pair.relative_pose);
    let lowest = glam::DVec3::select(normal.cmpgt(glam::DVec3::ZERO), moved.min.as_dvec3(), moved.max.as_dvec3());
    normal.dot(lowest) <= f64::from(pair.range) / pair.frame_pose.scale()
}

/// How far the boxes of a surface extend beyond it, in world units. The boxes of two surfaces overlap wherever the
/// surfaces are within the range of their pair.
pub(super) fn world_growth(thickness: f32, margin: f32) -> f32 {
    (thickness * (1.0 + EVENT_HYSTERESIS) + 0.5 * margin) * GROWTH_SLACK
}

/// Like [`world_growth`], in a frame whose unit is `scale` world units.
pub(super) fn frame_growth(thickness: f32, margin: f32, scale: f64) -> f32 {
    (f64::from(world_growth(thickness, margin)) / scale) as f32 * GROWTH_SLACK
}

/// The box of a transformed box.
pub(crate) fn moved_box(bounds: &Aabb, pose: &Pose) -> Aabb {
    if *pose == Pose::IDENTITY {
        return *bounds;
    }
    let corner = |bits: u32| {
        let pick = |axis: usize| if bits & (1 << axis) == 0 { bounds.min[axis] } else { bounds.max[axis] };
        pose.transform_point(Vec3::new(pick(0), pick(1), pick(2)).as_dvec3()).as_vec3()
    };
    Aabb::from_points((0..8).map(corner)).grown(0.0)
}
