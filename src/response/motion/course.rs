//! The trajectory of one object in a tick, and where it comes near bodies.

use std::sync::Arc;

use glam::{DMat3, DQuat, DVec3, Vec3};

use crate::kernel::{mesh::topology::SurfaceTopology, pose::Pose};

/// State of a surface or shape: its vertices in its own frame, and the pose of that frame. A shape tested by formula has
/// no vertices.
#[derive(Clone, Debug, Default)]
pub(in crate::response) struct Stand {
    pub(in crate::response) positions: Vec<Vec3>,
    pub(in crate::response) pose: Pose,
}

impl Stand {
    pub(super) fn set(&mut self, positions: &[Vec3], pose: &Pose) {
        self.positions.clear();
        self.positions.extend_from_slice(positions);
        self.pose = *pose;
    }

    /// World position of a vertex.
    pub(in crate::response) fn point(&self, vertex: usize) -> DVec3 {
        self.pose.transform_point(self.positions[vertex].as_dvec3())
    }

    /// Interpolates between two states.
    pub(super) fn become_between(&mut self, from: &Self, to: &Self, share: f64, deforms: bool) {
        self.positions.clear();
        if share >= 1.0 {
            self.set(&to.positions, &to.pose);
            return;
        }
        self.pose = between(&from.pose, &to.pose, share);
        if deforms {
            let both = from.positions.iter().zip(&to.positions);
            self.positions.extend(both.map(|(from, to)| from.lerp(*to, share as f32)));
        } else {
            self.positions.extend_from_slice(&to.positions);
        }
    }
}

/// Interpolates between two poses: it rotates about one axis, and translates and scales linearly.
fn between(from: &Pose, to: &Pose, share: f64) -> Pose {
    if from.has_bits_of(to) {
        return *to;
    }
    let parts = |pose: &Pose| {
        let affine = pose.to_affine();
        let sign = if pose.is_mirrored() { -1.0 } else { 1.0 };
        let turn = DQuat::from_mat3(&(affine.matrix3 * (sign / pose.scale()))).normalize();
        (turn, sign * pose.scale(), affine.translation)
    };
    let ((turn, scale, place), (last_turn, last_scale, last_place)) = (parts(from), parts(to));
    if scale * last_scale < 0.0 {
        return *to;
    }
    let scale = scale + (last_scale - scale) * share;
    let linear = DMat3::from_quat(turn.slerp(last_turn, share)) * scale;
    let affine = glam::DAffine3 { matrix3: linear, translation: place.lerp(last_place, share) };
    Pose::from_double_affine(&affine).unwrap_or(*to)
}

/// The trajectory of one surface or shape in this tick.
#[derive(Clone, Debug)]
pub(in crate::response) struct Course {
    pub(super) from: Stand,
    pub(super) to: Stand,
    pub(super) deforms: bool,
    /// Whether it belongs to a body. Only the body's pinned vertices then follow it.
    pub(super) is_of_pins: bool,
    /// The triangles, if it is a surface.
    pub(super) topology: Option<Arc<SurfaceTopology>>,
    /// State at the beginning of the current part.
    pub(in crate::response) now: Stand,
    /// State at the end of the current part, if no contact pushes it.
    pub(in crate::response) ahead: Stand,
    /// Its pose at the end of the current part, as far as solved, if it belongs to a rigid body that contacts push.
    pub(in crate::response) pushed: Option<Pose>,
}

impl Course {
    pub(super) fn new(from: Stand, to: Stand, is_of_pins: bool) -> Self {
        let deforms = from.positions != to.positions;
        Self {
            from,
            to,
            deforms,
            is_of_pins,
            topology: None,
            now: Stand::default(),
            ahead: Stand::default(),
            pushed: None,
        }
    }

    /// Its pose at the end of the current part, as far as solved.
    pub(in crate::response) fn end(&self) -> &Pose {
        self.pushed.as_ref().unwrap_or(&self.ahead.pose)
    }

    /// The state at which detection sees it, or, after detection, at which the game sees it.
    pub(super) fn shown(&self, is_on_its_way: bool) -> &Stand {
        if is_on_its_way { &self.now } else { &self.to }
    }
}

#[derive(Clone, Copy)]
pub(super) struct Region {
    pub(super) low: DVec3,
    pub(super) high: DVec3,
}

impl Region {
    pub(super) fn around(points: impl Iterator<Item = DVec3>) -> Self {
        let empty = Self { low: DVec3::INFINITY, high: DVec3::NEG_INFINITY };
        points.fold(empty, |Self { low, high }, point| Self { low: low.min(point), high: high.max(point) })
    }

    pub(super) fn grown(self, by: f64) -> Self {
        Self { low: self.low - by, high: self.high + by }
    }

    pub(super) fn overlaps(&self, other: &Self) -> bool {
        self.low.cmple(other.high).all() && other.low.cmple(self.high).all()
    }

    pub(super) fn corners(&self) -> [DVec3; 8] {
        std::array::from_fn(|bits| {
            let pick = |axis: usize| if bits & (1 << axis) == 0 { self.low[axis] } else { self.high[axis] };
            DVec3::new(pick(0), pick(1), pick(2))
        })
    }
}

/// A trajectory in the world: where its points begin and end.
pub(super) struct Track {
    pub(super) region: Region,
    ends: Vec<[DVec3; 2]>,
    /// The triangles between them. Without any, all points belong together.
    topology: Option<Arc<SurfaceTopology>>,
}

impl Track {
    pub(super) fn new(ends: Vec<[DVec3; 2]>, topology: Option<Arc<SurfaceTopology>>) -> Self {
        Self { region: Region::around(ends.iter().flatten().copied()), ends, topology }
    }

    /// Largest displacement relative to something in a region that moves by `common`, of the triangles that come near
    /// it.
    pub(super) fn way(&self, near: &Region, common: DVec3) -> f64 {
        let squared = |&[start, end]: &[DVec3; 2]| (end - start - common).length_squared();
        let Some(topology) = &self.topology else {
            return self.ends.iter().map(squared).fold(0.0, f64::max).sqrt();
        };
        let corners = topology.triangles().iter().map(|corners| corners.map(|corner| self.ends[corner as usize]));
        let is_near = |corners: &[[DVec3; 2]; 3]| Region::around(corners.as_flattened().iter().copied()).overlaps(near);
        corners.filter(is_near).flat_map(|corners| corners.map(|ends| squared(&ends))).fold(0.0, f64::max).sqrt()
    }
}
