//! Which patches touch, by the whole pipeline, against patches that are subdivided until bounds meet.

use std::path::Path;

use bevy_app::{App, Update};
use bevy_circumsphere::{
    ContactStore,
    kernel::mesh::{curved_edges::CurvedEdges, smooth_normal::CreaseAngle, topology::SurfaceTopology},
    prelude::*,
};
use circumsphere_support::{
    recording::{read_recording, recordings_folder},
    scenes::{crumpled_sheet, triangle_soup},
};
use circumsphere_truth::{BodyShape, ReferencePatch, SmoothBody, patch_distance, triangle_distance};
use glam::{DVec3, Vec3};

use crate::bodies::{BodyMesh, CREASE, mesh_of, rotation};

/// A mesh with its smooth edges, in the world.
struct Patches {
    positions: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    all: Vec<ReferencePatch>,
    welded: Vec<[u32; 3]>,
    edge: f64,
    largest: f64,
}

impl Patches {
    fn new(rest: &[Vec3], positions: Vec<Vec3>, triangles: &[[u32; 3]], smooth: bool) -> Self {
        let topology = SurfaceTopology::new(rest, triangles).expect("the mesh is valid");
        let mut edges = CurvedEdges::default();
        edges.update(&topology, &positions, CreaseAngle::new(CREASE));
        let all = (0..triangles.len())
            .map(|triangle| {
                let corners = triangles[triangle].map(|vertex| positions[vertex as usize].as_dvec3());
                let offsets = topology.triangle_edges()[triangle]
                    .map(|edge| if smooth { edges.offsets()[edge as usize].as_dvec3() } else { DVec3::ZERO });
                ReferencePatch::bent(corners, offsets)
            })
            .collect();
        Self {
            edge: topology.mean_edge_length(&positions),
            welded: topology.welded_triangles().to_vec(),
            largest: f64::from(edges.largest()),
            positions,
            triangles: triangles.to_vec(),
            all,
        }
    }
}

/// What the comparison found.
#[derive(Clone, Copy, Debug, Default)]
struct Counts {
    touching: usize,
    missed: usize,
    /// Of the missed ones, those that are closer than the contact distance by a hundredth of an edge.
    far_missed: usize,
    surplus: usize,
    worst: f64,
    /// Pairs that touch as patches, but not as triangles, and the other way round.
    only_patches: usize,
    only_flat: usize,
}

impl Counts {
    /// A few pairs whose patches are nearly parallel may be missed by up to a hundredth of an edge: the search ends
    /// early there. None is found that is not there.
    fn check(&self, what: &str) {
        println!("{what}: {self:?}");
        assert_eq!(self.surplus, 0, "{what}: {self:?}");
        assert_eq!(self.far_missed, 0, "{what}: {self:?}");
        assert!(self.missed * 1_000 <= self.touching, "{what}: {self:?}");
        assert!(self.worst < 0.1, "{what}: {self:?}");
    }
}

fn app(method: ContactMethod, surfaces: &[(&Patches, &[Vec3], SurfaceShape)], distance: f64) -> App {
    let mut app = App::new();
    app.add_plugins(DeformableCollisionPlugins::new(Update));
    let is_self = surfaces.len() == 1;
    for (patches, rest, shape) in surfaces {
        let (surface, _) = DeformableSurface::from_mesh(rest, &patches.triangles).expect("the mesh is valid");
        let thickness = SurfaceThickness::World((distance / 2.0) as f32);
        let mut entity =
            app.world_mut().spawn((surface, SurfacePositions(patches.positions.clone()), thickness, method, *shape));
        if is_self {
            entity.insert(SelfCollision);
        }
    }
    app.update();
    app
}

/// Compares the touching pairs of two surfaces, or of one with itself.
fn compare(app: &App, a: &Patches, b: Option<&Patches>, distance: f64) -> Counts {
    let distance = f64::from((distance / 2.0) as f32) * 2.0;
    let store = app.world().resource::<ContactStore>();
    let mut found: Vec<([u32; 2], f64)> =
        store.touching().map(|pair| ([pair.triangle_a, pair.triangle_b], pair.distance)).collect();
    found.sort_by_key(|(triangles, _)| *triangles);
    let other = b.unwrap_or(a);
    let reach = distance + a.largest + other.largest;
    let tolerance = 1.0e-3 * a.edge.min(other.edge);
    let mut counts = Counts::default();
    for own in 0..a.all.len() {
        let first = if b.is_none() { own + 1 } else { 0 };
        for next in first..other.all.len() {
            let (p, q) = (&a.all[own], &other.all[next]);
            let near = (0..3).all(|axis| {
                let span = |patch: &ReferencePatch| {
                    let values = patch.corners.map(|corner| corner[axis]);
                    (values[0].min(values[1]).min(values[2]), values[0].max(values[1]).max(values[2]))
                };
                let ((low, high), (other_low, other_high)) = (span(p), span(q));
                low <= other_high + reach && other_low <= high + reach
            });
            if !near || b.is_none() && a.welded[own].iter().any(|vertex| a.welded[next].contains(vertex)) {
                continue;
            }
            let flat = triangle_distance(&p.corners, &q.corners);
            if flat > reach {
                continue;
            }
            let truth = patch_distance(p, q, distance + 2.0 * tolerance, 0.1 * tolerance);
            let place = found.binary_search_by_key(&[own as u32, next as u32], |(triangles, _)| *triangles);
            counts.only_patches += usize::from(truth <= distance && flat > distance);
            counts.only_flat += usize::from(truth > distance && flat <= distance);
            if let Ok(place) = place {
                counts.touching += 1;
                counts.worst = counts.worst.max((found[place].1 - truth).abs() / a.edge);
                counts.surplus += usize::from(truth > distance + tolerance);
            } else {
                counts.missed += usize::from(truth < distance - tolerance);
                counts.far_missed += usize::from(truth < distance - 10.0 * tolerance);
            }
        }
    }
    counts
}

#[test]
fn patches_of_bodies_touch_like_the_reference() {
    let ellipsoid = BodyShape::Ellipsoid(DVec3::new(1.0, 0.7, 0.5));
    let torus = BodyShape::Torus(0.8, 0.3);
    let mut different = 0;
    for (shapes, distance) in [([ellipsoid, ellipsoid], 1.9), ([torus, ellipsoid], 1.3), ([torus, torus], 1.6)] {
        for seed in [0.3, 1.7] {
            let meshes = shapes.map(|shape| mesh_of(shape, 2));
            let bodies = [DVec3::ZERO, DVec3::X * distance * 0.75].map(|center| SmoothBody {
                shape: shapes[0],
                rotation: rotation(seed + center.x),
                center,
            });
            let surfaces: Vec<(Patches, Vec<Vec3>)> = meshes
                .iter()
                .zip(bodies)
                .map(|(mesh, body)| {
                    let positions = BodyMesh::new(body, mesh).positions;
                    (Patches::new(&positions, positions.clone(), &mesh.triangles, true), positions)
                })
                .collect();
            let [(a, rest_a), (b, rest_b)] = &surfaces[..] else { panic!("there are two") };
            for edges in [0.1, 0.5] {
                let distance = edges * a.edge;
                for method in [ContactMethod::Exact, ContactMethod::Closest, ContactMethod::Polygon] {
                    let smooth = SurfaceShape::Smooth;
                    let app = app(method, &[(a, rest_a, smooth), (b, rest_b, smooth)], distance);
                    let counts = compare(&app, a, Some(b), distance);
                    counts.check(&format!("{shapes:?} {seed} {edges} {method:?}"));
                    different += counts.only_patches + counts.only_flat;
                }
            }
        }
    }
    // Flat triangles would not have passed.
    assert!(different > 100, "{different}");
}

/// The patches of a frame of a recording, at most the last one, and the positions of its first frame.
fn recorded(folder: &Path, name: &str, frame: usize) -> (Patches, Vec<Vec3>) {
    let recording = read_recording(&[folder.join(format!("{name}.bin"))]).expect("the recording is valid");
    let frame = frame.min(recording.frames.len() - 1);
    let of = |frame: usize| -> Vec<Vec3> { recording.frames[frame].iter().copied().map(Vec3::from_array).collect() };
    let rest = of(0);
    (Patches::new(&rest, of(frame), &recording.triangles, true), rest)
}

/// Osculating spheres are not the patches, but nearly.
#[test]
fn spheres_touch_nearly_where_patches_do() {
    let Some(folder) = recordings_folder() else { return };
    for (name, frame) in [("rumba_36_60", 30), ("bunny_3485", 20), ("mat100x100", 4), ("thick_cloth", 3)] {
        let (patches, rest) = recorded(&folder, name, frame);
        let distance = 0.1 * patches.edge;
        let app = app(ContactMethod::Circumsphere, &[(&patches, &rest, SurfaceShape::Smooth)], distance);
        let Counts { touching, missed, surplus, worst, .. } = compare(&app, &patches, None, distance);
        println!("{name}: {touching} touch, {missed} missed, {surplus} do not touch, worst {worst}");
        assert!(missed + surplus <= touching / 50, "{name}: {missed} missed and {surplus} surplus of {touching}");
    }
}

#[test]
fn patches_of_recordings_touch_like_the_reference() {
    let Some(folder) = recordings_folder() else { return };
    for (name, frame) in
        [("rumba_36_60", 30), ("bunny_3485", 20), ("mat100x100", 4), ("thick_cloth", 3), ("gear_chain", 0)]
    {
        let (patches, rest) = recorded(&folder, name, frame);
        for edges in [0.1, 0.5] {
            let distance = edges * patches.edge;
            let app = app(ContactMethod::Exact, &[(&patches, &rest, SurfaceShape::Smooth)], distance);
            let counts = compare(&app, &patches, None, distance);
            counts.check(&format!("{name} {edges}"));
        }
    }
}

#[test]
fn patches_of_random_meshes_touch_like_the_reference() {
    let meshes = [crumpled_sheet(1_000, 0.3), triangle_soup(300, 7)];
    for mesh in meshes {
        let positions: Vec<Vec3> = mesh.positions.iter().copied().map(Vec3::from_array).collect();
        let patches = Patches::new(&positions, positions.clone(), &mesh.triangles, true);
        for edges in [0.1, 0.5] {
            let distance = edges * patches.edge;
            let app = app(ContactMethod::Exact, &[(&patches, &positions, SurfaceShape::Smooth)], distance);
            let counts = compare(&app, &patches, None, distance);
            counts.check(&format!("{} triangles {edges}", mesh.triangles.len()));
        }
    }
}
