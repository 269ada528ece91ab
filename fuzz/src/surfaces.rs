//! The whole plugin with any mesh, motion, pose, and settings. Unusable data is rejected or quarantined, contacts of
//! the rest are finite, and other bodies keep their contacts.

use std::cell::Cell;

use bevy_app::prelude::*;
use bevy_circumsphere::{
    ContactStore,
    kernel::{
        mesh::{
            ids::{EdgeId, VertexId},
            topology::SurfaceTopology,
        },
        spheres::curvature::CurvatureEstimator,
    },
    prelude::*,
};
use bevy_ecs::entity::Entity;
use bevy_transform::components::Transform;
use glam::{Quat, Vec3};

use crate::input::Input;

/// The most triangles and vertices of the surface.
const MOST_TRIANGLES: usize = 12;
const MOST_VERTICES: usize = 20;

/// The most ticks of one world.
const MOST_TICKS: usize = 3;

/// The layer of the clean bodies. The fuzzed surface is on another.
const CLEAN: u32 = 1 << 1;

/// A mesh of any numbers, and a few ticks of a world with it.
pub fn surfaces(bytes: &[u8]) {
    let mut input = Input::new(bytes);
    let flags = input.byte();
    let flag = |bit: u8| flags & (1 << bit) != 0;
    let vertex_count = input.below(MOST_VERTICES + 1);
    let triangles: Vec<[u32; 3]> = (0..input.below(MOST_TRIANGLES + 1))
        .map(|_| std::array::from_fn(|_| index(&mut input, vertex_count)))
        .collect();
    let written = input.coordinates();
    let positions = input.points(vertex_count, written);

    let surface = DeformableSurface::from_mesh(&positions, &triangles);
    let is_valid = !triangles.is_empty()
        && triangles.iter().flatten().all(|&vertex| (vertex as usize) < vertex_count)
        && positions.iter().all(|position| position.is_finite());
    assert_eq!(surface.is_ok(), is_valid, "{surface:?}: {positions:?} {triangles:?}");
    let Ok(surface) = surface.inspect_err(|error| assert!(error.to_string().len() < 500, "{error}")) else { return };
    check_topology(surface.0.topology());

    let World { mut app, clean } = WORLD.take().unwrap_or_else(World::new);
    app.insert_resource(settings(&mut input, flag(0)));
    let entity = app.world_mut().spawn((surface, method(&mut input), transform(&mut input, flag(1)))).id();
    if flag(2) {
        let thickness = input.float();
        let thickness =
            if flag(3) { SurfaceThickness::World(thickness) } else { SurfaceThickness::MeanEdges(thickness) };
        app.world_mut().entity_mut(entity).insert(thickness);
    }
    if flag(4) {
        app.world_mut().entity_mut(entity).insert(SelfCollision);
    }
    if flag(5) {
        // On the layer of the clean bodies.
        app.world_mut().entity_mut(entity).insert(SurfaceLayers { memberships: CLEAN, filters: u32::MAX });
    }
    if flag(6) {
        app.world_mut().entity_mut(entity).insert(Sidedness::OneSided);
    }
    for tick in 0..MOST_TICKS {
        app.update();
        check_contacts(&app);
        let between = contacts_between(&app, clean);
        assert_eq!(between, 1, "tick {tick}: the contact of the clean bodies has changed");
        if input.is_empty() {
            break;
        }
        let written = input.coordinates();
        // Sometimes one more or fewer than required.
        let count = vertex_count + usize::from(flag(7) && tick == 1);
        let positions = input.points(count, written);
        app.world_mut().entity_mut(entity).insert(SurfacePositions(positions));
    }
    app.world_mut().despawn(entity);
    WORLD.set(Some(World { app, clean }));
}

/// A world with two clean bodies.
struct World {
    app: App,
    clean: [Entity; 2],
}

thread_local! {
    /// The world of the last input. It is reused, because making one would take most of the time. An input that fails
    /// discards it.
    static WORLD: Cell<Option<World>> = const { Cell::new(None) };
}

impl World {
    fn new() -> Self {
        let mut app = App::new();
        app.add_plugins(DeformableCollisionPlugins::new(Update));
        let clean = spawn_clean_bodies(&mut app);
        Self { app, clean }
    }
}

/// Mostly in range.
fn index(input: &mut Input<'_>, vertex_count: usize) -> u32 {
    let byte = input.byte();
    match byte {
        255 => u32::MAX,
        254 => vertex_count as u32,
        _ => u32::from(byte) % (vertex_count.max(1) as u32),
    }
}

fn settings(input: &mut Input<'_>, any: bool) -> CircumsphereSettings {
    if !any {
        return CircumsphereSettings::default();
    }
    let flags = input.byte();
    CircumsphereSettings {
        margin: input.float(),
        sphere_offset: input.float(),
        curvature_threshold: input.float(),
        refit_threshold: input.float(),
        plane_cull: flags & 1 != 0,
        estimator: if flags & 2 != 0 { CurvatureEstimator::DualAngleDeficit } else { CurvatureEstimator::SignedEdge },
        ..Default::default()
    }
}

fn method(input: &mut Input<'_>) -> ContactMethod {
    [ContactMethod::BoundingSphere, ContactMethod::Circumsphere, ContactMethod::Exact, ContactMethod::Polygon]
        [input.below(4)]
}

fn transform(input: &mut Input<'_>, any: bool) -> Transform {
    if !any {
        return Transform::IDENTITY;
    }
    let written = input.coordinates();
    let rotation = Quat::from_array(std::array::from_fn(|_| input.float()));
    let translation = input.point(written);
    let scale = if input.byte().is_multiple_of(2) { Vec3::splat(input.float()) } else { input.point(written) };
    Transform { rotation, translation, scale }
}

/// Two triangles 0.05 apart that touch within 0.1.
fn spawn_clean_bodies(app: &mut App) -> [Entity; 2] {
    [0.0, 0.05].map(|height| {
        let corners = [Vec3::new(0.0, height, 0.0), Vec3::new(1.0, height, 0.0), Vec3::new(0.0, height, 1.0)];
        let surface = DeformableSurface::from_mesh(&corners, &[[0, 1, 2]]).expect("a triangle is a mesh");
        let layers = SurfaceLayers { memberships: CLEAN, filters: CLEAN };
        app.world_mut().spawn((surface, layers, SurfaceThickness::World(0.05), ContactMethod::Exact)).id()
    })
}

/// The number of touching pairs of triangles of two surfaces.
fn contacts_between(app: &App, [a, b]: [Entity; 2]) -> usize {
    let store = app.world().resource::<ContactStore>();
    let sides = [ContactSide::Surface(a), ContactSide::Surface(b)];
    let pairs = store.pairs().iter().filter(|pair| sides == [pair.a, pair.b] || sides == [pair.b, pair.a]);
    pairs.map(|pair| pair.touching.len()).sum()
}

fn check_contacts(app: &App) {
    let store = app.world().resource::<ContactStore>();
    for pair in store.pairs() {
        assert!(pair.nearest >= 0.0, "the nearest pair is {} away", pair.nearest);
    }
    for touching in store.touching() {
        assert!(touching.distance >= 0.0, "{touching:?}");
    }
    for contact in store.contacts() {
        let weights = [contact.barycentric_a, contact.barycentric_b];
        assert!(weights.iter().flatten().all(|weight| !weight.is_nan()), "{contact:?}");
        assert!(!contact.normal.is_nan() && !contact.point_b.is_nan() && !contact.distance.is_nan(), "{contact:?}");
    }
}

/// Checks adjacency against its definition by searching all triangles for shared edges and vertices.
fn check_topology(topology: &SurfaceTopology) {
    let (triangles, welded) = (topology.triangles(), topology.welded_triangles());
    assert!(topology.weld().iter().enumerate().all(|(vertex, &to)| to as usize <= vertex), "{:?}", topology.weld());
    for (corners, welded) in triangles.iter().zip(welded) {
        assert_eq!(corners.map(|vertex| topology.weld()[vertex as usize]), *welded);
    }
    for vertex in 0..topology.vertex_count() {
        let to = topology.weld()[vertex];
        let around: Vec<u32> = (0..).zip(welded).filter(|(_, corners)| corners.contains(&to)).map(|(k, _)| k).collect();
        assert_eq!(topology.triangles_of_vertex(VertexId(vertex as u32)), around, "around vertex {vertex}");
    }
    for (edge, ends) in topology.edges().iter().enumerate() {
        let has = |corners: &[u32; 3]| {
            (0..3).any(|k| {
                let (from, to) = (corners[k], corners[(k + 1) % 3]);
                [from.min(to), from.max(to)] == *ends
            })
        };
        let around: Vec<u32> = (0..).zip(welded).filter(|(_, corners)| has(corners)).map(|(k, _)| k).collect();
        assert_eq!(topology.triangles_of_edge(EdgeId(edge as u32)), around, "around edge {edge}");
        assert!(!around.is_empty(), "edge {edge} has no triangle");
    }
    for (triangle, edges) in topology.triangle_edges().iter().enumerate() {
        for k in 0..3 {
            let (from, to) = (welded[triangle][k], welded[triangle][(k + 1) % 3]);
            assert_eq!(topology.edges()[edges[k] as usize], [from.min(to), from.max(to)]);
        }
    }
    let (components, count) = topology.components();
    assert!(components.iter().all(|&component| (component as usize) < count));
}
