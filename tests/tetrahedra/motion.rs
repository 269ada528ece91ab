//! 20,000 tetrahedra in motion that collide with themselves: every containment is what brute force finds.

use bevy_app::prelude::*;
use bevy_circumsphere::prelude::*;
use bevy_ecs::prelude::*;
use circumsphere_support::tetrahedra::CurlingBar;
use glam::Vec3;
use robust::{Coord3D, orient3d};

/// Vertices with the lowest tetrahedron that each is in, by the signs of exact predicates.
fn brute_force(points: &[[f32; 3]], positions: &[[f32; 3]], tetrahedra: &[[u32; 4]], is_own: bool) -> Vec<(u32, u32)> {
    let coordinate = |[x, y, z]: [f32; 3]| Coord3D { x: f64::from(x), y: f64::from(y), z: f64::from(z) };
    let mut found = Vec::new();
    for (vertex, &point) in (0..).zip(points) {
        let contains = |corners: &[u32; 4]| {
            let at = corners.map(|corner| positions[corner as usize]);
            let is_outside = |axis: usize| {
                at.iter().all(|corner| corner[axis] < point[axis]) || at.iter().all(|corner| corner[axis] > point[axis])
            };
            if is_own && corners.contains(&vertex) || (0..3).any(is_outside) {
                return false;
            }
            let signs = [0, 1, 2, 3].map(|corner| {
                let mut part = at;
                part[corner] = point;
                let [a, b, c, d] = part.map(coordinate);
                orient3d(a, b, c, d)
            });
            signs.iter().any(|&sign| sign != 0.0)
                && (signs.iter().all(|&sign| sign >= 0.0) || signs.iter().all(|&sign| sign <= 0.0))
        };
        if let Some(tetrahedron) = tetrahedra.iter().position(contains) {
            found.push((vertex, tetrahedron as u32));
        }
    }
    found
}

#[test]
fn containments_of_bodies_in_motion_are_those_of_brute_force() {
    let motion = CurlingBar::default();
    let meshes = [&motion.bar, &motion.ball];
    assert!(meshes.iter().map(|mesh| mesh.tetrahedra.len()).sum::<usize>() > 20_000);
    let mut app = App::new();
    app.add_plugins((DeformableCollisionPlugins::new(Update), TetrahedralContainmentPlugin));
    app.insert_resource(CircumsphereSettings { threads: 1, ..CircumsphereSettings::default() });
    app.finish();
    app.cleanup();
    let points = |positions: &[[f32; 3]]| positions.iter().copied().map(Vec3::from_array).collect::<Vec<_>>();
    let bodies: [Entity; 2] = meshes.map(|mesh| {
        let body = TetrahedralBody::from_mesh(&points(&mesh.positions), &mesh.tetrahedra).unwrap();
        app.world_mut().spawn((body, SelfCollision)).id()
    });
    let (mut in_own, mut in_other) = (0, 0);
    for tick in [0, 20, 40, 55, 57, 59] {
        let places = motion.positions_at(tick);
        for (body, positions) in bodies.into_iter().zip(&places) {
            app.world_mut().get_mut::<SurfacePositions>(body).unwrap().0 = points(positions);
        }
        app.update();
        let containments = app.world().resource::<Containments>();
        for [own, container] in [[0, 0], [0, 1], [1, 0], [1, 1]] {
            let found = containments.between(bodies[own], bodies[container]);
            let found: Vec<(u32, u32)> = found.map(|found| (found.vertex.0, found.tetrahedron.0)).collect();
            let expected =
                brute_force(&places[own], &places[container], &meshes[container].tetrahedra, own == container);
            assert_eq!(found, expected, "tick {tick}, body {own} in {container}");
            *(if own == container { &mut in_own } else { &mut in_other }) += found.len();
        }
    }
    assert!(in_own > 100 && in_other > 100, "{in_own} {in_other}");
}
