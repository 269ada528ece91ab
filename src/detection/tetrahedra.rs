//! Which vertices lie in tetrahedral bodies, how deep, and the shortest way out. Optional, beside the stages: reads
//! positions as `Prepare` has found them.

use std::collections::HashMap;

use bevy_app::prelude::*;
use bevy_ecs::{prelude::*, schedule::InternedScheduleLabel};
#[cfg(feature = "reflect")]
use bevy_reflect::prelude::*;
use glam::{DVec3, Vec3};

use super::pairs::moved_box;
use crate::{
    diagnostics::{DetectionDiagnostics, StageWatch},
    kernel::{
        mesh::{
            bounds::{Aabb, point_bounds},
            ids::{TetrahedronId, VertexId},
        },
        pose::Pose,
        tetrahedra::{
            containment::{Containment, ContainmentSearch},
            penetration::SurfaceSearch,
        },
    },
    schedule::{DeformableSystems, add_to_host_schedule},
    surface::{ActiveSurface, ActiveSurfaces, GatherSurfaces, SurfacePositions, TetrahedralBody},
};

/// Finds the vertices of [tetrahedral bodies](TetrahedralBody) that lie in other such bodies, and with
/// [`SelfCollision`](crate::SelfCollision) in the body itself. Read the result from [`Containments`].
///
/// It needs [`DeformableCollisionPlugins`](crate::DeformableCollisionPlugins). It runs at the end of
/// [`DeformableSystems::Prepare`], on the positions that the game has written. Contacts are the same with and without
/// it.
pub struct TetrahedralContainmentPlugin;

impl Plugin for TetrahedralContainmentPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<Containments>();
        add_to_host_schedule::<Self>(app, false, add_systems);
    }

    fn finish(&self, app: &mut App) {
        add_to_host_schedule::<Self>(app, true, add_systems);
    }
}

fn add_systems(app: &mut App, schedule: InternedScheduleLabel) {
    app.add_systems(schedule, find_containments.in_set(DeformableSystems::Prepare).after(GatherSurfaces));
}

/// A vertex of one body that lies in a tetrahedron of another, or in one of its own body.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct VertexContainment {
    /// The body of the vertex.
    pub body: Entity,
    /// The vertex.
    pub vertex: VertexId,
    /// The body of the tetrahedron.
    pub container: Entity,
    /// The tetrahedron that contains the vertex: the lowest, where several do. A point on a face is inside.
    pub tetrahedron: TetrahedronId,
    /// The barycentric weights of the vertex in the tetrahedron: 0 or more, with a sum of 1.
    pub barycentric: [f64; 4],
    /// Distance from the vertex to the nearest point of the container's surface, in world units, 0 or more.
    pub depth: f64,
    /// World unit vector to that point. For a vertex on the surface, its outward normal.
    ///
    /// In a self-containment, triangles around the vertex do not count, nor does surface that faces the vertex from
    /// outside. Zero if nothing else is there.
    pub direction: DVec3,
}

/// The containments of this tick, sorted by the body of the vertex, then by the container, both in the order of
/// [`ActiveSurfaces`], then by vertex.
#[derive(Resource, Clone, Debug, Default)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(opaque, Resource, Clone, Debug, Default))]
pub struct Containments {
    found: Vec<VertexContainment>,
}

impl Containments {
    /// All containments.
    pub fn iter(&self) -> impl Iterator<Item = &VertexContainment> {
        self.found.iter()
    }

    /// The vertices of `body` that lie in `container`. Both may be the same.
    pub fn between(&self, body: Entity, container: Entity) -> impl Iterator<Item = &VertexContainment> {
        self.found.iter().filter(move |found| found.body == body && found.container == container)
    }

    /// The number of containments.
    #[must_use]
    pub fn len(&self) -> usize {
        self.found.len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.found.is_empty()
    }
}

/// A body in this tick.
struct ActiveBody<'a> {
    surface: &'a ActiveSurface,
    body: &'a TetrahedralBody,
    positions: &'a [Vec3],
    /// Its box in the world.
    bounds: Aabb,
}

/// What is kept from tick to tick: buffers, and the trees of the surfaces in which something was found.
#[derive(Default)]
struct Workspace {
    search: ContainmentSearch,
    inside: Vec<Containment>,
    surfaces: HashMap<Entity, (SurfaceSearch, bool)>,
}

fn find_containments(
    mut containments: ResMut<Containments>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
    mut workspace: Local<Workspace>,
    active: Res<ActiveSurfaces>,
    bodies: Query<(&TetrahedralBody, &SurfacePositions)>,
) {
    let watch = StageWatch::start("containments");
    containments.found.clear();
    let bodies: Vec<ActiveBody> = active
        .surfaces
        .iter()
        .filter_map(|surface| {
            let (body, SurfacePositions(positions)) = bodies.get(surface.entity).ok()?;
            // The surface may have been replaced by another mesh.
            (body.topology().vertex_count() == positions.len()).then(|| {
                let bounds = moved_box(&point_bounds(positions, 0.0), &surface.pose);
                ActiveBody { surface, body, positions, bounds }
            })
        })
        .collect();
    if bodies.is_empty() {
        workspace.surfaces.clear();
        return;
    }
    let Workspace { search, inside, surfaces } = &mut *workspace;
    surfaces.retain(|entity, _| bodies.iter().any(|body| body.surface.entity == *entity));
    for (_, is_current) in surfaces.values_mut() {
        *is_current = false;
    }
    let mut pairs = 0;
    for (place, body) in bodies.iter().enumerate() {
        for (other_place, container) in bodies.iter().enumerate() {
            let is_own = place == other_place;
            let meets = if is_own { body.surface.self_collision } else { body.surface.meets(container.surface) };
            if !meets || !body.bounds.overlaps(&container.bounds) {
                continue;
            }
            pairs += 1;
            find_inside(search, body, container, is_own, inside);
            if inside.is_empty() {
                continue;
            }
            let (surface, is_current) = surfaces.entry(container.surface.entity).or_default();
            if !std::mem::replace(is_current, true) {
                surface.update(&container.surface.topology, container.positions);
            }
            containments
                .found
                .extend(inside.iter().map(|inside| penetration(surface, body, container, is_own, inside)));
        }
    }
    diagnostics.finish(watch, pairs, containments.found.len());
}

/// The vertices of one body as points in the frame of another.
fn points<'a>(body: &'a ActiveBody, container: &ActiveBody) -> impl Iterator<Item = DVec3> + 'a {
    let pose = body.surface.pose.relative_to(&container.surface.pose);
    let is_moved = pose != Pose::IDENTITY;
    body.positions.iter().map(move |position| {
        let point = position.as_dvec3();
        if is_moved { pose.transform_point(point) } else { point }
    })
}

fn find_inside(
    search: &mut ContainmentSearch,
    body: &ActiveBody,
    container: &ActiveBody,
    is_own: bool,
    inside: &mut Vec<Containment>,
) {
    let own = is_own.then(|| container.surface.topology.weld());
    search.find(container.body.topology(), container.positions, points(body, container), own, inside);
}

fn penetration(
    search: &SurfaceSearch,
    body: &ActiveBody,
    container: &ActiveBody,
    is_own: bool,
    &Containment { vertex, tetrahedron, barycentric }: &Containment,
) -> VertexContainment {
    let topology = &container.surface.topology;
    let found = if is_own {
        search.own_penetration(topology, container.positions, vertex.0)
    } else {
        let pose = body.surface.pose.relative_to(&container.surface.pose);
        let point = body.positions[vertex.index()].as_dvec3();
        let point = if pose == Pose::IDENTITY { point } else { pose.transform_point(point) };
        search.penetration(topology, container.positions, point)
    };
    let pose = &container.surface.pose;
    let (depth, direction) = found.map_or((0.0, DVec3::ZERO), |found| (found.depth, found.direction));
    VertexContainment {
        body: body.surface.entity,
        vertex,
        container: container.surface.entity,
        tetrahedron,
        barycentric,
        depth: depth * pose.scale(),
        direction: pose.transform_direction(direction),
    }
}
