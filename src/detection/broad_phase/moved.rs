//! Brings those triangles of a surface into the frame of a pair that may be near the other surface.
//!
//! Where two surfaces have poses of their own, the boxes of one of them are needed in the other's frame. Only what can reach
//! the other's box is moved: two bodies that touch at a corner cost what the corner costs, and a body in many pairs is not
//! moved as a whole for each.

use glam::{DMat3, DVec3, Vec3};

use super::{Frame, OtherSide, SurfacePair};
use crate::{
    detection::bounds::frame_growth,
    kernel::{bounds::Aabb, ids::VertexId, pose::Pose, topology::SurfaceTopology},
    surface::{ActiveSurface, ActiveSurfaces, SurfacePositions},
};

/// Whether a box, brought into another frame, reaches a box there.
pub(super) struct Reach {
    linear: DMat3,
    absolute: DMat3,
    translation: DVec3,
    center: DVec3,
    half: DVec3,
}

/// Boxes are rounded to f32 on the way here by a few units in the last place: far more than those are allowed for.
const ROUNDING: f64 = 32.0 * f32::EPSILON as f64;

impl Reach {
    /// `pose` brings boxes into the frame of `target`.
    pub(super) fn new(pose: &Pose, target: &Aabb) -> Self {
        let affine = pose.to_affine();
        let (low, high) = (target.min.as_dvec3(), target.max.as_dvec3());
        let linear = affine.matrix3;
        let absolute = DMat3::from_cols(linear.x_axis.abs(), linear.y_axis.abs(), linear.z_axis.abs());
        Self { linear, absolute, translation: affine.translation, center: (low + high) * 0.5, half: (high - low) * 0.5 }
    }

    /// Never says that something is apart that is not: what is no number reaches.
    #[inline]
    pub(super) fn is_reached_by(&self, bounds: &Aabb) -> bool {
        let (low, high) = (bounds.min.as_dvec3(), bounds.max.as_dvec3());
        let center = self.linear * ((low + high) * 0.5) + self.translation;
        let half = self.absolute * ((high - low) * 0.5);
        let slack = ROUNDING * (center.abs() + half).max_element();
        let apart = (center - self.center).abs() - self.half - half;
        !apart.cmpgt(DVec3::splat(slack)).any()
    }
}

/// Moves triangles of a pair's other surface into the frame of the pair, one after the other.
///
/// What an algorithm of the broad phase asks for boxes where a pair [needs it](SurfacePair::is_moved): of which triangles is
/// up to the algorithm, but it has to have asked for every triangle that it pairs.
pub struct TriangleMover<'a> {
    topology: &'a SurfaceTopology,
    own: &'a [Vec3],
    pose: &'a Pose,
    growth: f32,
    moved: &'a mut Vec<Vec3>,
    rounding: &'a mut f32,
}

impl SurfacePair {
    /// Whether one of two surfaces has to be moved into the frame of the pair.
    #[must_use]
    pub fn is_moved(&self) -> bool {
        matches!(self.second, OtherSide::Surface(_)) && self.relative_pose != Pose::IDENTITY
    }

    /// The surface that has to be moved, if [any](Self::is_moved) has.
    pub fn moved_surface<'a>(&self, active: &'a ActiveSurfaces) -> Option<&'a ActiveSurface> {
        let OtherSide::Surface(second) = self.second else { return None };
        self.is_moved().then(|| match self.frame {
            Frame::First => &active.surfaces[second],
            Frame::Second => &active.surfaces[self.first],
        })
    }

    /// Begins to move the triangles of `surface`, which is [`moved_surface`](Self::moved_surface), from its own `positions`;
    /// `margin` is that of the settings.
    pub fn mover<'a>(
        &'a mut self,
        surface: &'a ActiveSurface,
        positions: &'a SurfacePositions,
        margin: f32,
    ) -> TriangleMover<'a> {
        self.moved_positions.clear();
        self.moved_rounding = 0.0;
        TriangleMover {
            topology: &surface.topology,
            own: &positions.0,
            growth: frame_growth(surface.thickness, margin, self.frame_pose.scale()),
            pose: &self.relative_pose,
            moved: &mut self.moved_positions,
            rounding: &mut self.moved_rounding,
        }
    }
}

impl TriangleMover<'_> {
    /// The box of a triangle in the frame of the pair, grown by the surface's thickness and half the margin.
    ///
    /// # Panics
    /// If there is no such triangle.
    pub fn bounds(&mut self, triangle: u32) -> Aabb {
        if self.moved.is_empty() {
            self.moved.resize(self.own.len(), Vec3::NAN);
        }
        let [a, b, c] = self.topology.triangles()[triangle as usize].map(|vertex| self.vertex(vertex));
        Aabb { min: a.min(b).min(c), max: a.max(b).max(c) }.grown(self.growth)
    }

    fn vertex(&mut self, vertex: u32) -> Vec3 {
        let moved = self.moved[vertex as usize];
        if !moved.is_nan() {
            return moved;
        }
        if self.topology.report().welded_vertices > 0 {
            // Whether vertices that were together still are is asked in this frame too.
            let welded = self.topology.weld()[vertex as usize];
            for &triangle in self.topology.triangles_of_vertex(VertexId(welded)) {
                for &other in &self.topology.triangles()[triangle as usize] {
                    if self.topology.weld()[other as usize] == welded {
                        self.move_vertex(other);
                    }
                }
            }
            // Of which no triangle may be left but collapsed ones.
            self.move_vertex(welded);
        }
        self.move_vertex(vertex)
    }

    fn move_vertex(&mut self, vertex: u32) -> Vec3 {
        let moved = self.pose.transform_point(self.own[vertex as usize].as_dvec3()).as_vec3();
        self.moved[vertex as usize] = moved;
        // Half a unit in the last place along each of three axes.
        *self.rounding = self.rounding.max(f32::EPSILON * moved.abs().max_element());
        moved
    }
}
