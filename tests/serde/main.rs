//! The promises of the feature `serde`: values come back as they were, files may leave out what is a default, and data
//! that no constructor would accept is an error.

mod bodies;
mod shapes;

use std::fmt::Debug;

use bevy_app::prelude::*;
use bevy_circumsphere::{
    ContactStore, StencilEntry,
    geometry::{
        Aabb, CompactContact, ContactKey, CurvatureEstimator, EdgeId, Feature, FeatureKind, FeaturePair, ImpactCause,
        SphereContact, SurfaceTopology, TouchingPair, TriangleId, VertexId,
    },
    prelude::*,
    response::{SurfaceForces, SurfaceFriction, SurfaceWind, XpbdMaterial, XpbdSettings},
};
use circumsphere_support::random::Random;
use glam::Vec3;
use serde::{Serialize, de::DeserializeOwned};
use serde_json::{Value, json};

/// Writes and reads a value. It must come back, and a default one must be written differently, or nothing is tested.
fn comes_back<T: Serialize + DeserializeOwned + PartialEq + Debug>(value: &T, other: &T) {
    let text = serde_json::to_string(value).expect("it can be written");
    let read: T = serde_json::from_str(&text).expect("it can be read");
    assert_eq!(read, *value, "{text}");
    assert_ne!(text, serde_json::to_string(other).expect("it can be written"));
}

#[test]
fn settings_come_back() {
    let settings = CircumsphereSettings {
        margin: 0.25,
        sphere_offset: 1.5,
        curvature_threshold: 0.75,
        plane_cull: false,
        widen_cones: false,
        refit_threshold: 0.1,
        estimator: CurvatureEstimator::DualAngleDeficit,
        crease_angle: 0.3,
        sphere_contacts: SphereContactDetail::Distances,
        threads: 3,
        memory: false,
    };
    comes_back(&settings, &CircumsphereSettings::default());
    let settings = XpbdSettings {
        gravity: Vec3::new(0.1, -1.62, 0.3),
        substeps: 7,
        iterations: 2,
        push_out_speed: 12.0,
        sleep_speed: 0.5,
    };
    comes_back(&settings, &XpbdSettings::default());
    comes_back(&XpbdMaterial::SOFT, &XpbdMaterial::CLOTH);
    comes_back(&SurfaceFriction { static_coefficient: 0.9, dynamic_coefficient: 0.1 }, &SurfaceFriction::default());
    let wind = SurfaceWind { velocity: Vec3::new(1.0, 2.0, 3.0), density: 1.0, drag: 2.0, lift: 3.0 };
    comes_back(&wind, &SurfaceWind::default());
}

#[test]
fn components_come_back() {
    comes_back(&SurfaceThickness::World(0.1), &SurfaceThickness::default());
    comes_back(&SurfaceThickness::MeanEdges(0.1), &SurfaceThickness::default());
    comes_back(&VertexThickness::new([0.1, 0.0, 0.25]), &VertexThickness::new([]));
    comes_back(&SurfaceLayers { memberships: 6, filters: 9 }, &SurfaceLayers::default());
    for method in ContactMethod::ALL {
        let other = if method == ContactMethod::Exact { ContactMethod::Polygon } else { ContactMethod::Exact };
        comes_back(&method, &other);
    }
    comes_back(&Sidedness::TwoSided, &Sidedness::OneSided);
    comes_back(&SurfaceShape::Smooth, &SurfaceShape::Flat);
    comes_back(&SurfaceFrame::World, &SurfaceFrame::Local);
    comes_back(&SurfaceOrder(7), &SurfaceOrder(0));
    comes_back(&SurfacePositions(vec![Vec3::new(0.1, 0.2, 0.3)]), &SurfacePositions::default());
    comes_back(&SurfaceForces(vec![Vec3::new(0.1, 0.2, 0.3)]), &SurfaceForces::default());
}

#[test]
fn an_infinite_compliance_comes_back() {
    let text = serde_json::to_string(&XpbdMaterial::CLOTH).expect("it can be written");
    let read: XpbdMaterial = serde_json::from_str(&text).expect("it can be read");
    assert_eq!(read.volume_compliance, f32::INFINITY);
    assert_eq!(read, XpbdMaterial::CLOTH);
}

#[test]
fn what_a_file_leaves_out_is_the_default_and_what_nobody_knows_is_an_error() {
    let read: CircumsphereSettings = serde_json::from_value(json!({ "margin": 0.5 })).expect("it can be read");
    assert_eq!(read, CircumsphereSettings { margin: 0.5, ..CircumsphereSettings::default() });
    let read: XpbdMaterial = serde_json::from_value(json!({ "drag": 0.5 })).expect("it can be read");
    assert_eq!(read, XpbdMaterial { drag: 0.5, ..XpbdMaterial::default() });
    let error = serde_json::from_value::<XpbdSettings>(json!({ "substep": 5 })).expect_err("there is no such setting");
    assert!(error.to_string().contains("substep"), "{error}");
}

/// A tetrahedron and a strip beside it, with one seam of equal positions and one that rounding has opened.
fn mesh() -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let mut positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z];
    let mut triangles = vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
    let right = Vec3::X * 3.0;
    positions.extend([right, right + Vec3::X, right + Vec3::Y]);
    positions.extend([right + Vec3::X, right + Vec3::ONE, right + Vec3::Y + 1.0e-6 * Vec3::X]);
    triangles.extend([[4, 5, 6], [7, 8, 9]]);
    (positions, triangles)
}

fn assert_same(read: &SurfaceTopology, made: &SurfaceTopology) {
    assert_eq!(read.vertex_count(), made.vertex_count());
    assert_eq!(read.triangles(), made.triangles());
    assert_eq!(read.weld(), made.weld());
    assert_eq!(read.edges(), made.edges());
    assert_eq!(read.triangle_edges(), made.triangle_edges());
    assert_eq!(read.report(), made.report());
    assert_eq!(read.is_closed(), made.is_closed());
}

#[test]
fn surfaces_come_back() {
    let (positions, triangles) = mesh();
    let (surface, _) = DeformableSurface::builder(&positions, &triangles).weld_within(1.0e-4).build().expect("a mesh");
    assert_eq!(surface.topology().report().welded_vertices, 2);
    let text = serde_json::to_string(&surface).expect("it can be written");
    let read: DeformableSurface = serde_json::from_str(&text).expect("it can be read");
    assert_same(read.topology(), surface.topology());
    assert_eq!(read.mean_edge(), surface.mean_edge());
}

#[test]
fn data_that_is_no_topology_is_an_error() {
    for (weld, triangles, reason) in [
        (json!([0, 1, 2]), json!([]), "no triangles"),
        (json!([0, 1, 2]), json!([[0, 1, 3]]), "names vertex 3"),
        (json!([0, 1, 2]), json!([[0, 1, 4_294_967_295_u32]]), "names vertex 4294967295"),
        (json!([]), json!([[0, 0, 0]]), "names vertex 0"),
        (json!([0, 2, 2]), json!([[0, 1, 2]]), "vertex 1 is welded to vertex 2"),
        (json!([0, 0, 1]), json!([[0, 1, 2]]), "vertex 2 is welded to vertex 1"),
        (json!([0, 4_294_967_295_u32, 2]), json!([[0, 1, 2]]), "vertex 1 is welded"),
    ] {
        let data = json!({ "weld": weld, "triangles": triangles });
        let error = serde_json::from_value::<SurfaceTopology>(data.clone()).expect_err("it is no topology");
        assert!(error.to_string().contains(reason), "{data}: {error}");
        let data = json!({ "topology": data, "mean_edge": 1.0 });
        let error = serde_json::from_value::<DeformableSurface>(data).expect_err("it is no surface");
        assert!(error.to_string().contains(reason), "{error}");
    }
    let topology = json!({ "weld": [0, 1, 2], "triangles": [[0, 1, 2]] });
    let surface = |mean_edge: Value| json!({ "topology": topology, "mean_edge": mean_edge });
    assert!(serde_json::from_value::<DeformableSurface>(surface(json!(1.0))).is_ok());
    for mean_edge in [json!(-1.0), json!(1.0e300), Value::Null] {
        assert!(serde_json::from_value::<DeformableSurface>(surface(mean_edge)).is_err());
    }
}

#[test]
fn no_change_of_a_number_panics() {
    let (positions, triangles) = mesh();
    let made = SurfaceTopology::welded_within(&positions, &triangles, 1.0e-4).expect("a mesh");
    let written = serde_json::to_value(&made).expect("it can be written");
    let mut random = Random::new(28);
    let [mut accepted, mut refused] = [0, 0];
    for _ in 0..2000 {
        let mut data = written.clone();
        for _ in 0..=random.below(2) {
            let number = json!(random.below(12));
            if random.below(2) == 0 {
                let weld = data["weld"].as_array_mut().expect("a list");
                let place = random.below(weld.len() as u64) as usize;
                weld[place] = number;
            } else {
                let triangles = data["triangles"].as_array_mut().expect("a list");
                let place = random.below(triangles.len() as u64) as usize;
                triangles[place][random.below(3) as usize] = number;
            }
        }
        match serde_json::from_value::<SurfaceTopology>(data) {
            Ok(read) => {
                accepted += 1;
                assert!(read.triangles().as_flattened().iter().all(|&vertex| (vertex as usize) < read.vertex_count()));
                assert!(read.weld().iter().all(|&to| read.weld()[to as usize] == to));
            }
            Err(_) => refused += 1,
        }
    }
    assert!(accepted > 100 && refused > 100, "{accepted} accepted, {refused} refused");
}

#[test]
fn contacts_come_back() {
    let mut app = App::new();
    app.add_plugins(DeformableCollisionPlugins::new(Update));
    let corners = [Vec3::ZERO, Vec3::X, Vec3::Z];
    let sheets = [0.0, 0.05].map(|height| {
        let corners = corners.map(|corner| corner + Vec3::new(0.1, 1.0, 0.2) * height);
        let bundle = DeformableSurface::from_mesh(&corners, &[[0, 2, 1]]).expect("a triangle");
        app.world_mut().spawn((bundle, SurfaceThickness::World(0.05), ContactEventsEnabled)).id()
    });
    app.update();
    let store = app.world().resource::<ContactStore>();
    let found: Vec<CompactContact> = store.contacts().copied().collect();
    assert!(found.len() > 1, "the sheets touch");
    comes_back(&found, &Vec::new());
    let touching: Vec<TouchingPair> = store.touching().copied().collect();
    assert!(!touching.is_empty());
    comes_back(&touching, &Vec::new());
    let [entity, other] = sheets;
    comes_back(&SurfaceContactStart { entity, other }, &SurfaceContactStart { entity: other, other: entity });
    comes_back(&SurfaceContactEnd { entity, other }, &SurfaceContactEnd { entity: other, other: entity });
    comes_back(&ContactSide::Surface(entity), &ContactSide::Shape(entity));
    let entry = StencilEntry { entity, vertex: VertexId(2), weight: 0.3, normal: Vec3::Y };
    comes_back(&entry, &StencilEntry { entity: other, ..entry });
    let hit = app
        .world_mut()
        .run_system_cached(|query: SurfaceQuery| {
            query.cast_ray(Vec3::new(0.2, 1.0, 0.2), Vec3::NEG_Y, 9.0, &SurfaceQueryFilter::default())
        })
        .expect("the system runs")
        .expect("the ray meets a sheet");
    comes_back(&hit, &RayHit { distance: 9.0, ..hit });
}

#[test]
fn numbers_and_features_come_back() {
    comes_back(&TriangleId(3), &TriangleId(0));
    comes_back(&EdgeId(3), &EdgeId(0));
    comes_back(&ContactKey(u64::MAX), &ContactKey(0));
    let features = FeaturePair { a: Feature::Vertex(2), b: Feature::Edge(1) };
    comes_back(&features, &features.swapped());
    comes_back(&FeatureKind::EdgeFace, &FeatureKind::EdgeEdge);
    comes_back(&ImpactCause::Reached, &ImpactCause::Within);
    comes_back(&Aabb { min: Vec3::ZERO, max: Vec3::ONE }, &Aabb { min: Vec3::ZERO, max: Vec3::X });
    assert_eq!(serde_json::to_value(TriangleId(3)).expect("it can be written"), json!(3));
    let contact = SphereContact { triangle_a: 1, triangle_b: 2, distance: 0.5 };
    comes_back(&contact, &SphereContact { triangle_a: 0, ..contact });
}
