//! The recording shows tetrahedra, and the way out of each vertex in them.

use bevy_circumsphere::{
    debug::{LevelOfDetail, RerunSettings},
    prelude::*,
    response::{XpbdBody, XpbdMaterial},
};
use bevy_ecs::prelude::*;
use bevy_transform::components::Transform;
use circumsphere_support::tetrahedra::{tetrahedral_ball, tetrahedral_box};
use glam::Vec3;

use crate::world::{Recorded, everything, nothing};

const HALF: f32 = 0.5;
const AWAY: f32 = 0.3;

/// A box, and a ball that is deep in it. The box is at rest, except for one vertex if `inverts`.
fn ball_in_box(settings: RerunSettings, inverts: bool) -> (Recorded, [Entity; 2]) {
    let mut recorded = Recorded::with(settings, DeformableCollisionPlugins::new(bevy_app::Update), |app| {
        app.add_plugins(TetrahedralContainmentPlugin);
    });
    let block = tetrahedral_box([2; 3], [f64::from(HALF); 3]);
    let ball = tetrahedral_ball(2, 0.3);
    let bodies = [("block", block, 0.0), ("ball", ball, HALF - AWAY)].map(|(name, mesh, x)| {
        let rest: Vec<Vec3> = mesh.positions.iter().copied().map(Vec3::from_array).collect();
        let (inside, surface, mut positions) = TetrahedralBody::from_mesh(&rest, &mesh.tetrahedra).unwrap();
        let body = XpbdBody::tetrahedral(&inside, &surface, &positions, XpbdMaterial::SOLID).unwrap();
        if inverts && name == "block" {
            let middle = rest.iter().position(|at| *at == Vec3::ZERO).unwrap();
            positions.0[middle] = Vec3::X * 0.8;
        }
        let pose = Transform::from_xyz(x, 0.0, 0.0);
        recorded.app.world_mut().spawn((inside, surface, positions, body, pose, Name::new(name))).id()
    });
    recorded.tick();
    (recorded, bodies)
}

#[test]
fn an_arrow_leads_from_each_contained_vertex_to_the_surface() {
    let (recorded, [block, ball]) = ball_in_box(RerunSettings { penetrations: true, ..nothing() }, false);
    let containments = recorded.app.world().resource::<Containments>();
    let found: Vec<u32> = containments.between(ball, block).map(|found| found.vertex.0).collect();
    assert!(found.len() > 5 && containments.between(block, ball).next().is_some());
    let shown = recorded.viewer.of(&["penetrations", "contained", "ball in block"]).expect("the ball is in the block");
    assert_eq!(shown.wholes("vertex"), found);
    let [origins, ways] = ["Arrows3D:origins", "Arrows3D:vectors"].map(|name| shown.vectors::<3>(name));
    let depths = shown.floats("depth");
    for ((origin, way), depth) in origins.into_iter().map(Vec3::from).zip(ways.into_iter().map(Vec3::from)).zip(depths)
    {
        // Inside, and from there to the nearest side.
        let room = HALF - origin.abs().max_element();
        assert!(
            room > -1.0e-6 && (way.length() - room).abs() < 1.0e-5 && (depth - room).abs() < 1.0e-5,
            "{origin} {way}"
        );
        assert!(((origin + way).abs().max_element() - HALF).abs() < 1.0e-5, "{origin} {way}");
    }
    assert!(recorded.viewer.of(&["penetrations", "contained", "block in ball"]).is_some());
}

#[test]
fn tetrahedra_are_drawn_where_something_is_in_them_or_all() {
    let near = RerunSettings { tetrahedra: LevelOfDetail::NearContacts, ..nothing() };
    let (recorded, [block, ball]) = ball_in_box(near, false);
    let containments = recorded.app.world().resource::<Containments>();
    let mut expected: Vec<u32> = containments.between(ball, block).map(|found| found.tetrahedron.0).collect();
    expected.sort_unstable();
    expected.dedup();
    let shown = recorded.viewer.of(&["tetrahedra", "block"]).expect("something is in it");
    assert_eq!(shown.wholes("tetrahedron"), expected);
    let (recorded, _) = ball_in_box(everything(), true);
    let shown = recorded.viewer.of(&["tetrahedra", "block"]).expect("all are shown");
    let (strips, volumes) = (shown.strips(), shown.floats("volume"));
    assert_eq!([strips.len(), volumes.len()], [48; 2]);
    // The volume of the block is that of its tetrahedra, also where some are inverted.
    let whole: f32 = volumes.iter().sum();
    assert!((whole - 48.0).abs() < 1.0e-3 && volumes.iter().any(|&volume| volume < 0.0), "{volumes:?}");
    for strip in &strips {
        // Every pair of corners is next to each other somewhere.
        let mut corners: Vec<[u32; 3]> = strip.iter().map(|at| at.map(f32::to_bits)).collect();
        let sides: std::collections::BTreeSet<_> =
            corners.windows(2).map(|ends| [ends[0].min(ends[1]), ends[0].max(ends[1])]).collect();
        corners.sort_unstable();
        corners.dedup();
        assert_eq!((corners.len(), sides.len()), (4, 6));
    }
}
