//! What is swept: surfaces, and the triangles that stand for rigid shapes tested by formula.

use std::sync::Arc;

use bevy_ecs::prelude::*;
use glam::{DVec3, Vec3};

use super::path::Path;
use crate::{
    kernel::{
        exact::rigid_shape::{boundary_topology, boundary_triangle},
        mesh::{bounds::Aabb, topology::SurfaceTopology},
        pose::Pose,
    },
    surface::{ActiveShape, ActiveSurface, FilterSide, SurfaceLayers},
};

/// A mesh in motion, or at rest.
#[expect(clippy::struct_excessive_bools, reason = "each is read by itself")]
pub(super) struct Mover<'a> {
    pub entity: Entity,
    /// The part of a shape that is tested by formula.
    pub part: Option<u32>,
    pub topology: &'a Arc<SurfaceTopology>,
    pub path: Path<'a>,
    /// A world box around its motion and everything within its radius.
    pub world: Aabb,
    /// Half the distance at which two such surfaces touch, in world units. The least, if it varies.
    pub thickness: f64,
    /// How far it is solid beyond its triangles, in world units.
    pub radius: f64,
    pub layers: SurfaceLayers,
    /// What it knows about pairs of triangles that are left out.
    pub filter: FilterSide,
    pub self_collision: bool,
    /// Whether it is a rigid shape. These do not meet each other.
    pub rigid: bool,
    /// Whether results of earlier ticks are invalid for it.
    pub fresh: bool,
    /// The version of its positions. Equal versions mean equal positions. 0 for a shape that is tested by formula.
    pub version: u64,
    /// Whether it is swept against everything that it meets.
    pub asks: bool,
}

impl<'a> Mover<'a> {
    pub fn of_surface(surface: &'a ActiveSurface, path: Path<'a>, version: u64, asks: bool) -> Self {
        let ActiveSurface { entity, topology, layers, self_collision, rigid, fresh, .. } = surface;
        Self {
            entity: *entity,
            part: None,
            topology,
            path,
            world: if path.is_still() { surface.world_bounds } else { path.world_bounds() },
            thickness: f64::from(surface.least_thickness()),
            radius: 0.0,
            layers: *layers,
            filter: FilterSide::of_surface(surface),
            self_collision: *self_collision,
            rigid: *rigid,
            fresh: *fresh,
            version,
            asks,
        }
    }

    /// The parts of a shape that moves from one pose to another. `plane` stands for a half-space.
    pub fn of_shape(
        shape: &'a ActiveShape,
        [start_pose, end_pose]: [Pose; 2],
        plane: Option<&'a Plane>,
        asks: bool,
    ) -> impl Iterator<Item = Self> {
        let scale = start_pose.scale().max(end_pose.scale());
        let plane = plane.map(|plane| (boundary_topology(), &plane.corners[..], plane.deviation));
        let parts = shape.parts.iter().map(|part| (&part.topology, &part.positions[..], part.radius));
        (0..).zip(plane.into_iter().chain(parts)).map(move |(number, (topology, positions, radius))| {
            let path = Path { start: positions, start_pose, end: positions, end_pose };
            let radius = radius * scale;
            Self {
                entity: shape.entity,
                part: Some(number),
                topology,
                path,
                world: path.world_bounds().grown((radius as f32).next_up()),
                thickness: 0.0,
                radius,
                layers: shape.layers,
                filter: FilterSide::of_shape(shape),
                self_collision: false,
                rigid: true,
                fresh: shape.fresh,
                version: 0,
                asks,
            }
        })
    }

    pub fn moves(&self) -> bool {
        !self.path.is_still()
    }

    /// Whether two movers are swept against each other.
    pub fn meets(&self, other: &Self) -> bool {
        !(self.rigid && other.rigid)
            && (self.moves() || other.moves())
            && (self.asks || other.asks)
            && self.layers.interacts_with(other.layers)
    }
}

/// A triangle in the boundary of a half-space, in its own frame.
pub(super) struct Plane {
    corners: [Vec3; 3],
    /// The largest distance of a corner from the boundary, due to rounding.
    deviation: f64,
}

impl Plane {
    /// A triangle in the boundary that covers a world box, seen along the normal, while the half-space moves. `None` if
    /// that is out of range.
    pub fn under(bounds: &Aabb, normal: DVec3, poses: &[Pose; 2]) -> Option<Self> {
        let middle = (bounds.min.as_dvec3() + bounds.max.as_dvec3()) * 0.5;
        let own = poses.each_ref().map(|pose| pose.inverse().transform_point(middle));
        let way = own[0].distance(own[1]);
        let half = (bounds.max.as_dvec3() - bounds.min.as_dvec3()).length() * 0.5;
        let radius = way + half / poses[0].scale().min(poses[1].scale()) + f64::from(f32::MIN_POSITIVE);
        let corners = boundary_triangle(normal, own[0], radius).map(DVec3::as_vec3);
        let heights = corners.map(|corner| normal.dot(corner.as_dvec3()).abs());
        let is_finite = corners.iter().all(|corner| corner.is_finite());
        is_finite.then(|| Self { corners, deviation: heights.into_iter().fold(0.0, f64::max) })
    }
}
