//! Where the vertices of a surface start and end a step, in the frame in which a pair is swept.
//!
//! Vertices move in straight lines in the world. The frame is the main surface's own frame at the end of the step, and
//! moves along with the common motion of its vertices. So straight lines stay straight, bodies that fly together are
//! slow in it, and precision does not suffer far from the origin.

use glam::{DAffine3, DMat3, DVec3, Vec3};

use crate::kernel::{
    ccd::{SweepTree, SweptMesh, drift, outward_box},
    mesh::{bounds::Aabb, topology::SurfaceTopology},
    pose::Pose,
};

/// Upper bound of the rounding error of a coordinate that is transformed into the frame, relative to the largest length
/// involved. In halves of ε: an entry of an inverse rotation is off by 10, its product with another rotation by 13√3, a
/// point rotated by that by 26 · 3, its translation, rotated by the inverse, by 13 · 3, and sums by 3. Together 120.
const ROUNDING: f64 = 64.0 * f64::EPSILON;

/// Where a surface starts and ends a step: positions in its own frame, and the world pose of that frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Path<'a> {
    pub start: &'a [Vec3],
    pub start_pose: Pose,
    pub end: &'a [Vec3],
    pub end_pose: Pose,
}

impl<'a> Path<'a> {
    /// The path of a surface at rest.
    pub fn still(positions: &'a [Vec3], pose: Pose) -> Self {
        Self { start: positions, start_pose: pose, end: positions, end_pose: pose }
    }

    pub fn is_still(&self) -> bool {
        std::ptr::eq(self.start, self.end) && self.start_pose.has_bits_of(&self.end_pose)
    }

    /// A world box around the path.
    pub fn world_bounds(&self) -> Aabb {
        let world = Pose::IDENTITY;
        self.bounds_in(&Frame { pose: world, drift: DVec3::ZERO }).0
    }

    /// A box around the path in a frame, and how far rounding may displace a vertex on its way there.
    pub fn bounds_in(&self, frame: &Frame) -> (Aabb, f64) {
        let [start, end] = frame.ends(self);
        let box_of = |positions: &[Vec3], affine: &DAffine3, shift: DVec3| {
            let own = Aabb::from_points(positions.iter().copied());
            let (low, high) = (own.min.as_dvec3(), own.max.as_dvec3());
            let (middle, half) = ((low + high) * 0.5, (high - low) * 0.5);
            let linear = affine.matrix3;
            let half = linear.x_axis.abs() * half.x + linear.y_axis.abs() * half.y + linear.z_axis.abs() * half.z;
            let center = affine.transform_point3(middle) + shift;
            let size = middle.abs().max_element() + half.max_element();
            let scale = linear.x_axis.length();
            let largest = affine.translation.abs().max_element() + scale * size + shift.abs().max_element();
            (outward_box([center - half, center + half]).grown(0.0), ROUNDING * largest)
        };
        let (start_box, start_rounding) = box_of(self.start, &start, frame.drift);
        let (end_box, end_rounding) = box_of(self.end, &end, DVec3::ZERO);
        (start_box.union(&end_box), start_rounding.max(end_rounding))
    }
}

/// A moving frame: its pose at the end of a step, and its own motion during the step, in its own coordinates.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Frame {
    pub pose: Pose,
    pub drift: DVec3,
}

impl Frame {
    /// Transforms from the own frame of a surface to this one: at the start of a step, without the drift, and at its
    /// end.
    fn ends(&self, path: &Path<'_>) -> [DAffine3; 2] {
        [&path.start_pose, &path.end_pose].map(|pose| relative(pose, &self.pose))
    }
}

/// A pose as seen from another one. Translations are subtracted before they are rotated, because those of neighbors far
/// from the origin have most of their digits in common.
fn relative(pose: &Pose, frame: &Pose) -> DAffine3 {
    let (pose, frame) = (pose.to_affine(), frame.to_affine());
    let is_frame = frame.matrix3 == DMat3::IDENTITY;
    let inverse = if is_frame { DMat3::IDENTITY } else { frame.matrix3.inverse() };
    let matrix3 = if pose.matrix3 == frame.matrix3 { DMat3::IDENTITY } else { inverse * pose.matrix3 };
    DAffine3 { matrix3, translation: inverse * (pose.translation - frame.translation) }
}

/// The vertices of a surface at both ends of a step, in the frame of a pair, and the boxes of its triangles.
#[derive(Debug, Default)]
pub(super) struct SweptPositions {
    /// Empty if the surface is at rest.
    start: Vec<DVec3>,
    end: Vec<DVec3>,
    pub tree: SweepTree,
    /// Whether the tree has been updated to these positions.
    boxed: bool,
    /// The farthest motion of a vertex.
    farthest: f64,
}

impl SweptPositions {
    /// Transforms the vertices of a path into a frame.
    pub fn fill(&mut self, path: &Path<'_>, frame: &Frame) {
        let [start, end] = frame.ends(path);
        let bring = |positions: &[Vec3], affine: &DAffine3, moved: &mut Vec<DVec3>| {
            moved.clear();
            if *affine == DAffine3::IDENTITY {
                moved.extend(positions.iter().map(|position| position.as_dvec3()));
            } else {
                moved.extend(positions.iter().map(|position| affine.transform_point3(position.as_dvec3())));
            }
        };
        bring(path.end, &end, &mut self.end);
        self.start.clear();
        if !path.is_still() || frame.drift != DVec3::ZERO {
            bring(path.start, &start, &mut self.start);
        }
        self.boxed = false;
        self.take_away(frame.drift);
    }

    /// The common motion of the vertices.
    pub fn drift(&self) -> DVec3 {
        if self.start.is_empty() { DVec3::ZERO } else { drift(&self.start, &self.end) }
    }

    /// Subtracts a motion from that of the vertices.
    pub fn take_away(&mut self, drift: DVec3) {
        if drift != DVec3::ZERO {
            self.start.iter_mut().for_each(|start| *start += drift);
        }
        let squared = self.start.iter().zip(&self.end).map(|(start, end)| (*end - *start).length_squared());
        self.farthest = squared.fold(0.0, f64::max).sqrt();
        self.boxed = false;
    }

    pub fn is_fast(&self, reach: f64) -> bool {
        self.farthest > reach
    }

    pub fn mesh<'a>(&'a self, topology: &'a SurfaceTopology, reach: f64) -> SweptMesh<'a> {
        let start = if self.start.is_empty() { &self.end } else { &self.start };
        SweptMesh { topology, start, end: &self.end, drift: DVec3::ZERO, reach }
    }

    /// Updates the boxes, if necessary.
    pub fn update_boxes(&mut self, topology: &SurfaceTopology, reach: f64) {
        if !std::mem::replace(&mut self.boxed, true) {
            let mut tree = std::mem::take(&mut self.tree);
            tree.update(&self.mesh(topology, reach));
            self.tree = tree;
        }
    }
}
