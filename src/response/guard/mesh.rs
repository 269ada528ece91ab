//! The meshes of a tick that may collide: surfaces, and triangles inside rigid shapes.

use std::sync::Arc;

use bevy_ecs::{change_detection::Tick, prelude::*};
use glam::{DMat3, DVec3, Vec3};

use super::ways::turn_between;
use crate::{
    kernel::{
        ccd::{SweepTree, SweptMesh, drift},
        exact::rigid_shape::{ShapeGeometry, boundary_triangle},
        mesh::{feature::Feature, topology::SurfaceTopology},
        pose::Pose,
        simd::parallel::{Sequential, Team},
    },
    response::{
        gather::Gatherer,
        meeting::{MeetingCorners, MeetingSide},
        particles::Particles,
        scene::Scene,
    },
    surface::{FilterSide, SurfaceLayers, ThicknessList},
};

/// With fewer triangles than this in a mesh, or in all that move, more than one thread does not pay off.
pub(super) const LEAST_SHARE: usize = 4096;

/// Relative bound on the rounding of positions to f32 between ticks.
pub(super) const ROUNDING: f64 = 1.0e-6;

/// Separation to keep, as a share of the contact distance. If features begin closer, half of their distance is kept
/// instead.
const KEPT_APART: f64 = 0.02;

/// Distance that the solver should keep of what has come from far away in this tick, as a share of the contact distance. What
/// begins the next tick any closer may pass through in its first substep, after which the constraint is on the far side.
const CLEARANCE: f64 = 0.2;

/// Features closer than this share of the contact distance may come no closer.
const LEAST_APART: f64 = 0.005;

/// Share of the distance that such close features keep.
const LEAST_KEPT: f64 = 0.9;

/// Two separate triangles cannot collide while each of their vertices moves by less than this share of their distance.
const SHARE_OF_DISTANCE: f64 = 0.49;

/// Triangles that the solver does not move: their start and end positions, and the state that these were computed from.
#[derive(Default)]
pub(super) struct Obstacle {
    /// The last change of the positions, and the pose, while the object is static.
    pub(super) at_rest: Option<(Tick, Pose)>,
    pub(super) start: Vec<DVec3>,
    pub(super) end: Vec<DVec3>,
    /// How it rotates and scales, if it is a moving rigid shape.
    pub(super) turn: Option<DMat3>,
}

impl Obstacle {
    /// Updates a static object whose positions last changed at `changed`. Returns whether anything is different.
    pub(super) fn rest(&mut self, positions: &[Vec3], changed: Tick, pose: &Pose) -> bool {
        let is_same = |&(seen, stood): &(Tick, Pose)| seen == changed && stood.has_bits_of(pose);
        if self.at_rest.as_ref().is_some_and(is_same) && self.start.len() == positions.len() {
            return false;
        }
        self.move_on([positions; 2], [pose; 2]);
        self.at_rest = Some((changed, *pose));
        true
    }

    /// Updates the end of a rigid object from the poses at both ends.
    pub(super) fn end_at(&mut self, poses: [&Pose; 2]) {
        let [start, end] = poses;
        let own = start.inverse();
        self.end.clear();
        self.end.extend(self.start.iter().map(|&point| end.transform_point(own.transform_point(point))));
        self.turn = self.turn.and_then(|_| turn_between(poses));
    }

    /// Updates a moving object.
    pub(super) fn move_on(&mut self, positions: [&[Vec3]; 2], poses: [&Pose; 2]) {
        self.at_rest = None;
        self.turn = None;
        for ((points, positions), pose) in [&mut self.start, &mut self.end].into_iter().zip(positions).zip(poses) {
            points.clear();
            points.extend(positions.iter().map(|position| pose.transform_point(position.as_dvec3())));
        }
    }
}

/// One mesh of a tick: a surface, or triangles inside a rigid shape.
#[expect(clippy::struct_excessive_bools, reason = "each flag is queried on its own")]
pub(super) struct Mesh {
    pub(super) name: MeshName,
    pub(super) topology: Arc<SurfaceTopology>,
    pub(super) layers: SurfaceLayers,
    /// What it knows about pairs of triangles that are left out.
    pub(super) filter: FilterSide,
    /// How far it extends beyond its triangles. Two meshes touch within the sum. The largest, if it varies.
    pub(super) thickness: f64,
    /// The thickness at each vertex if it varies, and the scale of the pose.
    pub(super) vertex_thickness: Option<(Arc<ThicknessList>, f64)>,
    /// The solid part of the thickness, which nothing may enter.
    pub(super) radius: f64,
    pub(super) meets_itself: bool,
    /// Whether detection lists everything that touches it, with distances.
    pub(super) is_exact: bool,
    /// The shape that it is part of, and the transform from world space to the shape's own frame at its start.
    pub(super) shape: Option<(Arc<ShapeGeometry>, Pose)>,
    /// Its first particle, if it is a body.
    pub(super) first: Option<usize>,
    pub(super) obstacle: Obstacle,
    /// Whether it is a body with [`SweptCollision`](crate::SweptCollision).
    pub(super) is_guarded: bool,
    /// How far each triangle may move without colliding with anything that moves no farther than its own reach.
    pub(super) reaches: Vec<f64>,
    pub(super) tree: SweepTree,
    /// Whether the tree may be out of date with the trajectories.
    pub(super) stale: bool,
}

/// The entity of a surface or shape, and the part of the shape that the mesh stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct MeshName {
    pub(super) entity: Entity,
    pub(super) part: u32,
}

/// The part number of a surface, which has only one part.
pub(super) const SURFACE: u32 = u32::MAX;

impl Mesh {
    pub(super) fn swept<'a>(&'a self, particles: &'a Particles) -> SweptMesh<'a> {
        let (start, end) = match self.first {
            Some(first) => {
                let own = first..first + self.topology.vertex_count();
                (&particles.start[own.clone()], &particles.position[own])
            }
            None => (&self.obstacle.start[..], &self.obstacle.end[..]),
        };
        SweptMesh { topology: &self.topology, start, end, drift: DVec3::ZERO, reach: 0.0 }
    }

    /// Whether more than one thread pays off for it.
    pub(super) fn is_large(&self) -> bool {
        self.topology.triangles().len() >= LEAST_SHARE
    }

    /// Updates the tree to the trajectories.
    pub(super) fn follow_ways(&mut self, team: &dyn Team, particles: &Particles) {
        let team = if self.is_large() { team } else { &Sequential };
        let mut tree = std::mem::take(&mut self.tree);
        let swept = self.swept(particles);
        let swept = SweptMesh { drift: drift(swept.start, swept.end), ..swept };
        tree.update_with_reaches_on(&team, &swept, &self.reaches);
        tree.update_tree_on(&team);
        self.tree = tree;
        self.stale = false;
    }

    /// Sets the reach of every triangle to that of a triangle at `distance` from everything, or at twice its thickness if
    /// that is less.
    pub(super) fn reach_all(&mut self, distance: f64) {
        let mut reaches = std::mem::take(&mut self.reaches);
        reaches.clear();
        reaches.resize(self.topology.triangles().len(), SHARE_OF_DISTANCE * distance);
        if self.vertex_thickness.is_some() {
            for (triangle, reach) in (0..).zip(&mut reaches) {
                let thinnest = self.thickness_at(triangle).into_iter().fold(f64::INFINITY, f64::min);
                *reach = reach.min(SHARE_OF_DISTANCE * 2.0 * thinnest);
            }
        }
        self.reaches = reaches;
    }

    /// Limits the reach of a triangle that is at `distance` from another one.
    pub(super) fn reach_less(&mut self, triangle: u32, distance: f64) {
        let reach = &mut self.reaches[triangle as usize];
        *reach = reach.min(SHARE_OF_DISTANCE * distance);
    }

    /// Whether a feature of a triangle is being pushed out of another mesh, with all triangles around it, or begins inside a
    /// shape. Nothing may hold it there.
    pub(super) fn is_leaving(
        &self,
        triangle: u32,
        feature: Feature,
        other: &Self,
        (particles, gatherer): (&Particles, &Gatherer),
    ) -> bool {
        let Some(corners) = self.corners(triangle) else { return false };
        let (first, count) = match feature {
            Feature::Vertex(corner) => (corner, 1),
            Feature::Edge(edge) => (edge, 2),
            Feature::Face => (0, 3),
        };
        let [entity, from] = [self.name.entity, other.name.entity];
        let leaves = |&triangle: &u32| {
            let mut corners = self.corners(triangle).into_iter().flatten();
            corners.any(|corner| gatherer.is_leaving(from, corner))
                || count > 1 && gatherer.is_crossing(entity, from, triangle)
        };
        let begins_inside = |(geometry, own): &(Arc<ShapeGeometry>, Pose)| {
            let mut vertices = (first..first + count).map(|corner| corners[corner as usize % 3]);
            vertices.any(|vertex| {
                let start = own.transform_point(particles.start[vertex as usize]);
                geometry.signed_distance(start) < 0.0
            })
        };
        self.topology.triangles_around(&triangle, feature).iter().all(leaves)
            || other.shape.as_ref().filter(|_| other.radius <= 0.0).is_some_and(begins_inside)
    }

    /// The particles of a triangle, if it belongs to a body.
    pub(super) fn corners(&self, triangle: u32) -> Option<[u32; 3]> {
        let first = self.first? as u32;
        Some(self.topology.welded_triangles()[triangle as usize].map(|vertex| first + vertex))
    }

    /// One side of an impact, for the solver.
    pub(super) fn side(&self, particles: &Particles, triangle: u32) -> MeetingSide {
        let corners = if let Some(corners) = self.corners(triangle) {
            MeetingCorners::Body(corners)
        } else {
            let triangle = self.topology.welded_triangles()[triangle as usize];
            let of = |points: &[DVec3]| triangle.map(|vertex| points[vertex as usize]);
            let swept = self.swept(particles);
            let is_surface = self.name.part == SURFACE;
            let vertices = is_surface.then(|| (triangle, self.topology.vertex_count()));
            MeetingCorners::Driven { starts: of(swept.start), ends: of(swept.end), vertices }
        };
        MeetingSide { entity: self.name.entity, thickness: self.thickness_at(triangle), corners }
    }

    /// How far it extends beyond the corners of a triangle.
    fn thickness_at(&self, triangle: u32) -> [f64; 3] {
        self.vertex_thickness.as_ref().map_or([self.thickness; 3], |(list, scale)| {
            list.varying(*scale).at(self.topology.triangles()[triangle as usize])
        })
    }
}

/// Two meshes that may collide along their trajectories.
#[derive(Clone, Copy)]
pub(super) struct MeshPair {
    pub(super) places: [usize; 2],
    /// What the guard keeps.
    pub(super) separation: f64,
    /// What the solver should keep, at least as much: what comes closer has not been watched, and the tick is solved again.
    pub(super) clearance: f64,
    /// The solid part of the separation.
    pub(super) radius: f64,
}

/// What is kept of a mesh between ticks.
#[derive(Default)]
pub(super) struct Kept {
    pub(super) obstacle: Obstacle,
    pub(super) reaches: Vec<f64>,
    pub(super) tree: SweepTree,
    pub(super) tick: u64,
}

impl MeshPair {
    pub(super) fn new(scene: &Scene<'_, '_>, places: [usize; 2], mesh: &Mesh, other: &Mesh) -> Self {
        let reach = |mesh: &Mesh| mesh.thickness - mesh.radius;
        let contact_distance = reach(mesh) + reach(other);
        let radius = mesh.radius + other.radius;
        let (a, b) = (mesh.name.entity, other.name.entity);
        let known = scene.nearest_of(a, b);
        let nearest = known.unwrap_or(contact_distance);
        let kept = KEPT_APART * contact_distance;
        // Under pressure over many ticks, halving would shrink the separation to nothing. It still has to stay below
        // the smallest distance.
        let floor = (LEAST_KEPT * nearest - ROUNDING * radius).clamp(0.0, LEAST_APART * contact_distance);
        let separation = radius + kept.min((0.5 * nearest).max(floor));
        let clearance = if known.is_none() { radius + CLEARANCE * contact_distance } else { separation };
        Self { places, separation, clearance, radius }
    }
}

/// Start and end of a triangle in the boundary of a half-space, large enough to lie under or over everything that
/// bodies may reach.
pub(super) fn plane_under(particles: &Particles, normal: DVec3, poses: [&Pose; 2]) -> Option<[Vec<DVec3>; 2]> {
    let bodies = (0..particles.len()).filter(|&particle| particles.inverse_mass[particle] > 0.0);
    let points = bodies.flat_map(|particle| [particles.start[particle], particles.position[particle]]);
    let empty = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (low, high) = points.fold(empty, |(low, high), point| (low.min(point), high.max(point)));
    let size = (high - low).length();
    if !size.is_finite() {
        return None;
    }
    let center = poses[0].inverse().transform_point((low + high) * 0.5);
    let radius = (2.0 * size + f64::MIN_POSITIVE.sqrt()) / poses[0].scale();
    let corners = boundary_triangle(normal, center, radius);
    Some(poses.map(|pose| corners.iter().map(|&corner| pose.transform_point(corner)).collect()))
}
