//! Runs meshes through a headless app and compares the results with the reference.

use bevy_app::prelude::*;
use bevy_circumsphere::{
    ContactStore,
    detection::{
        BruteForceBroadPhasePlugin, HierarchicalSpatialHashBroadPhasePlugin, NormalConeCullingPlugin,
        SpatialHashBroadPhasePlugin, TreeBroadPhasePlugin,
    },
    geometry::{CompactContact, TouchingPair},
    prelude::*,
};
use bevy_ecs::prelude::*;
pub use circumsphere_support::bars::BAND;
use circumsphere_support::bars::SEPARATION_TOLERANCE;
use circumsphere_truth::ParryBroadPhasePlugin;
use circumsphere_truth::{
    Comparison, ReferencePair, compare, exact_weld, point_triangle, segment_segment, touching_pairs_tree,
};
use glam::{DVec3, Vec3};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BroadPhase {
    Tree,
    TreeWithoutCones,
    SpatialHash,
    HierarchicalHash,
    BruteForce,
    Parry,
}

impl BroadPhase {
    pub const ALL: [Self; 6] =
        [Self::Tree, Self::TreeWithoutCones, Self::SpatialHash, Self::HierarchicalHash, Self::BruteForce, Self::Parry];
}

/// A self-colliding mesh in its own app.
pub struct Detector {
    app: App,
    entity: Entity,
}

impl Detector {
    pub fn new(
        rest: &[Vec3],
        triangles: &[[u32; 3]],
        method: ContactMethod,
        broad_phase: BroadPhase,
        distance: f64,
    ) -> Self {
        let mut app = App::new();
        let plugins = DeformableCollisionPlugins::new(Update).build();
        match broad_phase {
            BroadPhase::Tree => app.add_plugins(plugins),
            BroadPhase::TreeWithoutCones => app.add_plugins(plugins.disable::<NormalConeCullingPlugin>()),
            _ => app.add_plugins(plugins.disable::<TreeBroadPhasePlugin>()),
        };
        match broad_phase {
            BroadPhase::Tree | BroadPhase::TreeWithoutCones => &mut app,
            BroadPhase::SpatialHash => app.add_plugins(SpatialHashBroadPhasePlugin::default()),
            BroadPhase::HierarchicalHash => app.add_plugins(HierarchicalSpatialHashBroadPhasePlugin::default()),
            BroadPhase::BruteForce => app.add_plugins(BruteForceBroadPhasePlugin),
            BroadPhase::Parry => app.add_plugins(ParryBroadPhasePlugin),
        };
        let surface = DeformableSurface::from_mesh(rest, triangles).expect("the mesh is valid");
        let thickness = SurfaceThickness::World((0.5 * distance) as f32);
        let entity = app.world_mut().spawn((surface, SelfCollision, thickness, method)).id();
        Self { app, entity }
    }

    pub fn detect(&mut self, positions: &[Vec3]) -> (Vec<TouchingPair>, Vec<CompactContact>) {
        self.app.world_mut().get_mut::<SurfacePositions>(self.entity).expect("the mesh exists").0 = positions.to_vec();
        self.app.update();
        let store = self.app.world().resource::<ContactStore>();
        (store.touching().copied().collect(), store.contacts().copied().collect())
    }
}

/// The touching pairs of a mesh according to the reference, welded at `rest`, up to the end of the band.
pub fn truth(rest: &[Vec3], positions: &[Vec3], triangles: &[[u32; 3]], distance: f64) -> Vec<ReferencePair> {
    let wide = |positions: &[Vec3]| positions.iter().map(|position| position.as_dvec3()).collect::<Vec<_>>();
    touching_pairs_tree(&wide(positions), triangles, &exact_weld(&wide(rest)), distance * (1.0 + 2.0 * BAND))
}

/// Compares pair sets and distances. Panics with `what` if they differ.
pub fn assert_agrees(
    what: &str,
    found: &[TouchingPair],
    truth: &[ReferencePair],
    distance: f64,
    size: f64,
) -> Comparison {
    let found: Vec<(u32, u32, f64)> =
        found.iter().map(|pair| (pair.triangle_a, pair.triangle_b, pair.distance)).collect();
    let comparison = compare(&found, truth, distance, BAND);
    assert!(
        comparison.missed.is_empty() && comparison.false_pairs.is_empty(),
        "{what}: {} missed, {} false of {}; first missed {:?}, first false {:?}",
        comparison.missed.len(),
        comparison.false_pairs.len(),
        truth.len(),
        comparison.missed.first(),
        comparison.false_pairs.first()
    );
    let tolerance = SEPARATION_TOLERANCE * distance.max(size);
    assert!(
        comparison.worst_distance_error <= tolerance,
        "{what}: a distance is wrong by {} (tolerance {tolerance}) at {:?}",
        comparison.worst_distance_error,
        comparison.worst_pair
    );
    comparison
}

/// The number of crossing pairs with no vertex–face or edge–edge distance within the contact distance. Only an edge
/// that pierces a face shows that they touch.
pub fn crossings_without_near_features(
    positions: &[Vec3],
    triangles: &[[u32; 3]],
    truth: &[ReferencePair],
    distance: f64,
) -> usize {
    let corners = |triangle: u32| triangles[triangle as usize].map(|vertex| positions[vertex as usize].as_dvec3());
    truth
        .iter()
        .filter(|pair| pair.distance == 0.0)
        .filter(|pair| feature_distance(&corners(pair.triangle_a), &corners(pair.triangle_b)) > distance)
        .count()
}

fn feature_distance(a: &[DVec3; 3], b: &[DVec3; 3]) -> f64 {
    let mut nearest = f64::INFINITY;
    for k in 0..3 {
        nearest = nearest.min(point_triangle(a[k], b).distance).min(point_triangle(b[k], a).distance);
        for l in 0..3 {
            nearest = nearest.min(segment_segment(a[k], a[(k + 1) % 3], b[l], b[(l + 1) % 3]).distance);
        }
    }
    nearest
}
