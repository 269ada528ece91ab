//! A thousand rays a tick at a deforming mesh of a hundred thousand triangles: ours, and Bevy's own mesh ray cast, the one
//! behind its picking.
//!
//! `cargo run --release --manifest-path benches/peers/Cargo.toml --features rays --bin rays`
//!
//! Both get the same rays at the same mesh asset, whose positions the game writes in every tick, on one thread. Ours is the
//! whole update of the app, in which the mesh is read, its bounds are computed, and contacts are looked for, with the rays.
//! Of Bevy's, only the rays are measured. Every hit is compared.

use std::time::{Duration, Instant};

use bevy_app::{TaskPoolOptions, TaskPoolPlugin, TaskPoolThreadAssignmentPolicy, prelude::*};
use bevy_asset::{AssetPlugin, Assets, RenderAssetUsages};
use bevy_camera::{
    primitives::Aabb,
    visibility::{InheritedVisibility, ViewVisibility},
};
use bevy_circumsphere::prelude::*;
use bevy_ecs::system::RunSystemOnce;
use bevy_math::{Dir3, Vec3, Vec3A};
use bevy_mesh::{Indices, Mesh, Mesh3d, MeshPlugin, PrimitiveTopology, VertexAttributeValues};
use bevy_picking::mesh_picking::ray_cast::{MeshRayCast, MeshRayCastSettings, RayCastVisibility};
use bevy_shape::Ray3d;
use bevy_transform::components::GlobalTransform;
use circumsphere_support::{random::Random, scenes::torus};

const RAYS: usize = 1_000;
const TICKS: usize = 11;

/// Ticks before the first that is measured: the tree is built, and memory is taken.
const WARM: usize = 2;

/// How far the distances of a hit may be apart: Bevy's ray cast computes in f32.
const TOLERANCE: f32 = 1.0e-4;

fn main() {
    let torus = torus(0.8, 0.3, 320, 160);
    let rest: Vec<Vec3> = torus.positions.iter().copied().map(Vec3::from_array).collect();
    let mesh = Mesh::new(PrimitiveTopology::TriangleList, RenderAssetUsages::default())
        .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, torus.positions.clone())
        .with_inserted_indices(Indices::U32(torus.triangles.as_flattened().to_vec()));

    let mut app = App::new();
    let one_thread = TaskPoolThreadAssignmentPolicy {
        min_threads: 1,
        max_threads: 1,
        percent: 0.0,
        on_thread_spawn: None,
        on_thread_destroy: None,
    };
    let task_pool_options = TaskPoolOptions { compute: one_thread, max_total_threads: 1, ..TaskPoolOptions::default() };
    app.add_plugins((TaskPoolPlugin { task_pool_options }, AssetPlugin::default(), MeshPlugin));
    app.add_plugins(DeformableCollisionPlugins::new(PostUpdate));
    let handle = app.world_mut().resource_mut::<Assets<Mesh>>().add(mesh);
    // What Bevy's visibility systems would insert.
    let bounds = Aabb { center: Vec3A::ZERO, half_extents: Vec3A::splat(1.2) };
    let seen = (GlobalTransform::IDENTITY, InheritedVisibility::VISIBLE, ViewVisibility::HIDDEN, bounds);
    app.world_mut().spawn((Mesh3d(handle.clone()), SurfaceFromMesh::default(), QueryOnly, seen));

    let mut random = Random::new(61);
    let mut vector = move || Vec3::from_array([0; 3].map(|_| random.signed_unit()));
    let (mut our_times, mut bevy_times, mut hits, mut different) = (Vec::new(), Vec::new(), 0, 0);
    for tick in 0..WARM + TICKS {
        let rays: Vec<Ray3d> = (0..RAYS)
            .map(|_| {
                let origin = vector().normalize() * 3.0;
                Ray3d { origin, direction: Dir3::new(vector() - origin).expect("it is not zero") }
            })
            .collect();
        let mut meshes = app.world_mut().resource_mut::<Assets<Mesh>>();
        let mut mesh = meshes.get_mut(&handle).expect("it is there");
        let Some(VertexAttributeValues::Float32x3(positions)) = mesh.attribute_mut(Mesh::ATTRIBUTE_POSITION) else {
            unreachable!("the mesh was made with positions");
        };
        let time = tick as f32 * 0.05;
        for (position, at) in positions.iter_mut().zip(&rest) {
            let moved = Vec3::new((at.y * 5.0 + time).sin(), (at.z * 5.0 + time).sin(), (at.x * 5.0 + time).sin());
            *position = (at + 0.06 * moved).to_array();
        }
        drop(mesh);

        let copy = rays.clone();
        let start = Instant::now();
        app.update();
        let cast = move |query: SurfaceQuery| -> Vec<Option<f32>> {
            let filter = SurfaceQueryFilter::default();
            let cast = |ray: &Ray3d| query.cast_ray(ray.origin, *ray.direction, f32::INFINITY, &filter);
            copy.iter().map(|ray| cast(ray).map(|hit| hit.distance)).collect()
        };
        let ours = app.world_mut().run_system_once(cast).expect("the parameters are there");
        let our_time = start.elapsed();

        let cast = move |mut query: MeshRayCast| -> (Vec<Option<f32>>, Duration) {
            let settings = MeshRayCastSettings::default().with_visibility(RayCastVisibility::Visible);
            let start = Instant::now();
            let mut cast = |ray: &Ray3d| query.cast_ray(*ray, &settings).first().map(|(_, hit)| hit.distance);
            (rays.iter().map(&mut cast).collect(), start.elapsed())
        };
        let (theirs, bevy_time) = app.world_mut().run_system_once(cast).expect("the parameters are there");

        hits += ours.iter().flatten().count();
        let agree = |pair: &(&Option<f32>, &Option<f32>)| match pair {
            (Some(ours), Some(theirs)) => (ours - theirs).abs() < TOLERANCE,
            (ours, theirs) => ours.is_none() && theirs.is_none(),
        };
        different += ours.iter().zip(&theirs).filter(|pair| !agree(pair)).count();
        if tick >= WARM {
            our_times.push(our_time);
            bevy_times.push(bevy_time);
        }
    }
    our_times.sort_unstable();
    bevy_times.sort_unstable();
    let [ours, bevy] = [&our_times, &bevy_times].map(|times| times[times.len() / 2]);
    println!("{} triangles, {RAYS} rays a tick, medians of {TICKS} ticks", torus.triangles.len());
    println!("ours, update and rays: {ours:.2?}");
    println!("Bevy's MeshRayCast, rays only: {bevy:.2?}");
    println!("ratio: 1/{:.0}", bevy.as_secs_f64() / ours.as_secs_f64());
    let all = RAYS * (WARM + TICKS);
    println!("{hits} of {all} rays hit; {different} differ by more than {TOLERANCE} or hit only with one of both");
}
