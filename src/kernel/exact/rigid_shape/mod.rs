//! Exact proximity of a triangle and a rigid shape, both in the shape's own frame.
//!
//! A ball is a point with a radius, and a capsule a segment with one, so both reduce to the exact pair test with a
//! degenerate triangle. A cuboid or convex hull is tested by its faces, and the depth of vertices inside comes from the
//! planes. A cylinder or cone is a convex solid whose distance has a closed form, a half-space is one plane, and a
//! compound is its parts. parry is not called while the game runs: its shapes are read once.

mod compound;
mod contact;
mod error;
mod foot;
mod frustum;
mod frustum_contacts;
mod half_space;
mod pairs;
mod polytope;
mod prepare;
mod rounded;
mod sweep;
mod union;

use glam::{DAffine3, DVec3, Vec3};

pub(crate) use self::half_space::{boundary_topology, boundary_triangle};
pub use self::{
    compound::Compound, error::ShapeError, frustum::Frustum, pairs::shape_pairs, polytope::ConvexPolytope,
    sweep::SweepPart,
};
pub(in crate::kernel) use self::{
    foot::ShapeFoot,
    pairs::{Nearness, test_each},
};
use super::triangle_pair::PairProximity;
use crate::kernel::mesh::{bounds::Aabb, feature::Feature, smooth_normal::NormalCone};

/// How far the shape may extend beyond the plane through a contact point, perpendicular to its normal, relative to the
/// shape's size. A contact beyond that does not lead out but through the shape, on its far side. Far above the tilt
/// that f32 corners give the narrow faces of a convex hull, and far below the error of a far side.
const SUPPORT_SLACK: f64 = 1.0e-3;

/// A shape prepared for exact tests.
#[derive(Clone)]
pub enum ShapeGeometry {
    /// All points within `radius` of the segment from `start` to `end`: a capsule, or a ball if both are equal.
    Rounded {
        /// One end of the segment.
        start: DVec3,
        /// The other end.
        end: DVec3,
        /// Distance from the segment to the surface.
        radius: f64,
    },
    /// All points behind the plane through the origin.
    HalfSpace {
        /// Unit normal, pointing out of the solid.
        normal: DVec3,
    },
    /// A convex polyhedron, rounded or not.
    Polytope(Box<ConvexPolytope>),
    /// A cylinder or a cone, rounded or not.
    Convex(Frustum),
    /// The union of several shapes.
    Compound(Box<Compound>),
}

impl core::fmt::Debug for ShapeGeometry {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        formatter.write_str(match self {
            Self::Rounded { .. } => "Rounded",
            Self::HalfSpace { .. } => "HalfSpace",
            Self::Polytope(_) => "Polytope",
            Self::Convex(_) => "Convex",
            Self::Compound(_) => "Compound",
        })
    }
}

/// A triangle's feature that is close to a shape, or inside it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShapeProximity {
    /// The feature of the triangle.
    pub feature: Feature,
    /// The feature of the shape, by a number that is stable for the shape. 0 if the shape has only one.
    pub shape_feature: u32,
    /// Whether the triangle and the surface of the shape cross here, without a vertex inside that gives the depth.
    pub crossing: bool,
    /// Weights of the triangle's corners. They sum to 1.
    pub barycentric: [f64; 3],
    /// The closest point of the shape's surface.
    pub shape_point: DVec3,
    /// Unit vector out of the shape. Always defined: at exact touch it is the normal of the surface there, or of the
    /// triangle, and on an axis or in a center some direction that leads out.
    pub normal: DVec3,
    /// Distance from the shape's surface, negative inside.
    pub distance: f64,
}

impl ShapeGeometry {
    /// The box around the shape, in its own frame. `None` for a half-space, which has none.
    #[must_use]
    pub fn bounds(&self) -> Option<Aabb> {
        match self {
            Self::Rounded { start, end, radius } => {
                Some(Aabb::from_points([start.as_vec3(), end.as_vec3()]).grown(*radius as f32))
            }
            Self::HalfSpace { .. } => None,
            Self::Polytope(polytope) => Some(polytope.bounds()),
            Self::Convex(frustum) => {
                let half = frustum.half_extents().as_vec3();
                Some(Aabb { min: -half, max: half }.grown(0.0))
            }
            Self::Compound(compound) => Some(compound.bounds()),
        }
    }

    /// The directions in which a contact at `shape_feature` may point out of the shape, given its actual direction. For
    /// a box, the normals of its faces there.
    #[must_use]
    pub fn normal_cone(&self, shape_feature: u32, outward: DVec3) -> NormalCone {
        match self {
            Self::Rounded { radius, .. } => NormalCone::single(outward, radius.recip()),
            Self::HalfSpace { normal } => NormalCone::single(*normal, 0.0),
            Self::Polytope(polytope) => polytope.normal_cone(shape_feature, outward),
            Self::Convex(frustum) => frustum.normal_cone(shape_feature, outward),
            Self::Compound(compound) => compound.normal_cone(shape_feature, outward),
        }
    }

    /// Appends the proximities of a triangle within `range` (0 or more) of the shape, or inside it, and returns the
    /// smallest signed distance among them, or infinity if there is none. `scratch` is overwritten.
    ///
    /// Corners that are too far away for f64 give no proximities.
    pub fn examine(
        &self,
        triangle: &[DVec3; 3],
        range: f64,
        scratch: &mut PairProximity,
        found: &mut Vec<ShapeProximity>,
    ) -> f64 {
        let before = found.len();
        match self {
            Self::Rounded { start, end, radius } => {
                rounded::examine(triangle, [*start, *end], *radius, range, scratch, found);
            }
            Self::HalfSpace { normal } => half_space::examine(triangle, *normal, range, found),
            Self::Polytope(polytope) => polytope.examine(triangle, range, scratch, found),
            Self::Convex(frustum) => frustum.examine(triangle, range, found),
            Self::Compound(compound) => compound.examine(triangle, range, scratch, found),
        }
        let mut kept = before;
        for place in before..found.len() {
            if found[place].is_finite() {
                found[kept] = found[place];
                kept += 1;
            }
        }
        found.truncate(kept);
        found[before..].iter().map(|proximity| proximity.distance).fold(f64::INFINITY, f64::min)
    }

    /// Signed distance of a point from the shape's surface, negative inside. For a compound, the distance from the
    /// nearest part, or the depth in the deepest.
    #[must_use]
    pub fn signed_distance(&self, point: DVec3) -> f64 {
        self.foot(point).distance
    }

    /// Calls `visit` with every convex part, and with the transform into its frame.
    pub(in crate::kernel) fn for_each_part(&self, visit: &mut impl FnMut(&Self, &DAffine3)) {
        match self {
            Self::Compound(compound) => {
                for part in compound.parts() {
                    visit(&part.geometry, &part.inward_transform());
                }
            }
            _ => visit(self, &DAffine3::IDENTITY),
        }
    }

    /// Whether a feature is a face or a round side, rather than an edge, a rim, or a corner.
    fn is_smooth_at(&self, shape_feature: u32) -> bool {
        match self {
            Self::Polytope(polytope) => polytope.is_face(shape_feature),
            Self::Convex(_) => frustum::Part::is_number_smooth(shape_feature),
            Self::Rounded { .. } | Self::HalfSpace { .. } | Self::Compound(_) => true,
        }
    }

    /// One more than the largest feature number.
    fn feature_count(&self) -> usize {
        match self {
            Self::Rounded { .. } => rounded::FEATURES,
            Self::HalfSpace { .. } => 1,
            Self::Polytope(polytope) => polytope.feature_count(),
            Self::Convex(_) => frustum_contacts::FRUSTUM_FEATURES as usize,
            Self::Compound(compound) => compound.feature_count(),
        }
    }
}

impl ShapeProximity {
    fn is_finite(&self) -> bool {
        self.distance.is_finite()
            && self.shape_point.is_finite()
            && self.normal.is_finite()
            && self.barycentric.iter().all(|weight| weight.is_finite())
    }
}

/// Corners in f32, for boxes.
fn rounded(corners: &[DVec3; 3]) -> [Vec3; 3] {
    [corners[0].as_vec3(), corners[1].as_vec3(), corners[2].as_vec3()]
}
