//! The response must not blow up, whatever a game does.

use bevy_app::prelude::*;
use bevy_circumsphere::{prelude::*, response::*};
use bevy_ecs::prelude::*;
use bevy_transform::components::Transform;
use circumsphere_support::scenes::{Diagonals, Mesh, cuboid, grid, icosphere, needle, pile_body, torus};
use glam::Vec3;

use crate::harness::{LOSSLESS, Scene, TICK, apart, surface_of};

#[test]
fn bodies_of_any_shape_fly_on_without_shaking() {
    let meshes: Vec<(&str, Mesh)> = vec![
        ("needle", needle(0.2, 0.004)),
        ("ball", icosphere(2, 0.1)),
        ("box", cuboid([0.1, 0.1, 0.1], 4)),
        ("ring", torus(0.1, 0.03, 16, 8)),
        ("sheet", grid(8, 8, 0.2, 0.2, Diagonals::Alternating)),
        ("pile", pile_body(3)),
    ];
    for (name, mesh) in meshes {
        let stiff = XpbdMaterial { stretch_compliance: 0.0, bend_compliance: 0.0, ..XpbdMaterial::SOFT };
        let stiff_skin = XpbdMaterial { volume_compliance: f32::INFINITY, ..stiff };
        for material in [XpbdMaterial::SOFT, XpbdMaterial::CLOTH, stiff, stiff_skin] {
            let mut scene = Scene::new();
            scene.settings().gravity = Vec3::ZERO;
            let material = XpbdMaterial { drag: 0.0, ..material };
            let body = scene.add_changed(&mesh, material, |body| body.moving(Vec3::X), ());
            scene.run(60);
            // At this distance, rounding to single precision is a micrometer per tick, a thousandth of this bound.
            let speed = scene.fastest(body);
            assert!((speed - 1.0).abs() < 0.1, "{name} {material:?}: {speed}");
        }
    }
}

/// Runs a cloth that is pinned at two corners and hangs onto a ball, applies `change` in tick 10, and checks that
/// everything stays within reach.
fn survives(change: impl Fn(&mut Scene, bevy_ecs::entity::Entity) -> f64, prepare: impl Fn(XpbdBody) -> XpbdBody) {
    let mut scene = Scene::new();
    scene.add_obstacle(&icosphere(3, 0.2).translate([0.0, -0.25, 0.0]), ());
    let sheet = grid(10, 10, 0.5, 0.5, Diagonals::Alternating);
    let pinned = |body: XpbdBody| prepare(body.pinned([VertexId(0), VertexId(10)]));
    let body = scene.add_changed(&sheet, XpbdMaterial::CLOTH, pinned, (SelfCollision, SweptCollision));
    for tick in 0..120 {
        let seconds = if tick == 10 { change(&mut scene, body) } else { TICK };
        scene.tick(seconds);
        for position in scene.positions(body) {
            // The diagonal of the cloth is 0.71 m long. No vertex is farther from a pin than that and some stretch.
            assert!(position.is_finite() && position.length() < 1.5, "tick {tick}: {position}");
        }
    }
    let speed = scene.fastest(body);
    assert!(speed < 5.0, "{speed}");
}

#[test]
fn a_mass_ratio_of_a_thousand_holds() {
    let heavy = |mut body: XpbdBody| {
        body.inverse_masses[115] /= 1000.0;
        body
    };
    survives(|_, _| TICK, heavy);
    let light = |mut body: XpbdBody| {
        (0..60).for_each(|vertex| body.inverse_masses[2 * vertex + 1] *= 1000.0);
        body
    };
    survives(|_, _| TICK, light);
}

#[test]
fn a_tick_without_time_changes_nothing() {
    let mut scene = Scene::new();
    let body = scene.add(&icosphere(2, 0.1), XpbdMaterial::SOFT, ());
    scene.run(5);
    let (positions, velocities) = (scene.positions(body).to_vec(), scene.body(body).velocities.clone());
    scene.app.world_mut().resource_mut::<bevy_time::Time>().advance_by(std::time::Duration::ZERO);
    scene.app.update();
    assert_eq!(scene.positions(body), positions);
    assert_eq!(scene.body(body).velocities, velocities);
    survives(|_, _| 0.0, |body| body);
}

#[test]
fn a_tick_ten_times_as_long_is_survived() {
    survives(|_, _| 10.0 * TICK, |body| body);
}

#[test]
fn a_vertex_without_mass_is_refused_and_its_body_stands_until_it_has_one() {
    let mut scene = Scene::new();
    let sheet = grid(2, 2, 0.2, 0.2, Diagonals::Uniform);
    let body = scene.add(&sheet, XpbdMaterial::CLOTH, ());
    let other = scene.add(&sheet.translate([1.0, 0.0, 0.0]), XpbdMaterial::CLOTH, ());
    let sound = scene.body(body).inverse_masses[4];
    // Infinity is one over a mass of 0.
    for wrong in [f32::INFINITY, f32::NAN, -1.0] {
        scene.body_mut(body).inverse_masses[4] = wrong;
        let (before, others) = (scene.positions(body).to_vec(), scene.positions(other)[0].y);
        scene.run(3);
        assert_eq!(scene.positions(body), before);
        assert!(scene.positions(other)[0].y < others, "the other body does not fall");
        let refused = &scene.diagnostics().refused;
        assert!(matches!(refused[..], [(entity, XpbdBodyError::InverseMass(VertexId(4), _))] if entity == body));
    }
    scene.body_mut(body).inverse_masses[4] = sound;
    scene.run(3);
    assert!(scene.positions(body)[0].y < 0.0);
}

#[test]
fn a_body_goes_on_with_another_mesh_of_its_surface() {
    let meshes = [(2, Diagonals::Uniform), (2, Diagonals::Alternating), (7, Diagonals::Uniform)];
    let [own, others @ ..] = meshes.map(|(cells, diagonals)| grid(cells, cells, 0.2, 0.2, diagonals));
    for other in others {
        let mut scene = Scene::new();
        let body = scene.add_changed(&own, LOSSLESS, |body| body.moving(Vec3::X).pinned([VertexId(0)]), SelfCollision);
        scene.run(1);
        let velocity = scene.body(body).velocities[8];
        // The new mesh is where the old one is, moved by its last corner.
        let way = scene.positions(body)[8] - Vec3::from(own.positions[8]);
        scene.app.world_mut().entity_mut(body).insert(surface_of(&other.clone().translate(way.to_array())));
        let last = other.positions.len() - 1;
        let before = scene.positions(body)[last];
        scene.run(1);
        assert!(scene.diagnostics().refused.is_empty());
        let moved = (scene.positions(body)[last] - before) * TICK.recip() as f32;
        assert!(moved.distance(velocity) < 0.5, "{moved}, and {velocity} before");
        let pins = scene.body(body).inverse_masses.iter().filter(|inverse_mass| **inverse_mass == 0.0).count();
        assert!((1..=(last + 1) / 9).contains(&pins), "{pins} pins");
        // It swings like a pendulum.
        let mut lowest = before.y;
        for _ in 0..60 {
            scene.run(1);
            assert!(scene.positions(body).iter().all(|at| at.is_finite()));
            lowest = lowest.min(scene.positions(body)[last].y);
        }
        assert!(lowest < before.y - 0.05, "{lowest} instead of {}", before.y);
    }
}

#[test]
fn a_body_stands_while_somebody_has_written_too_few_or_too_many_positions() {
    for count in [0, 3, 40] {
        let mut scene = Scene::new();
        let body = scene.add(&grid(2, 2, 0.2, 0.2, Diagonals::Uniform), XpbdMaterial::CLOTH, ());
        // After detection has read the surface.
        let resize = move |mut surfaces: Query<&mut SurfacePositions>| {
            for mut positions in &mut surfaces {
                positions.0.resize(count, Vec3::ZERO);
            }
        };
        scene.app.add_systems(Update, resize.after(DeformableSystems::Detect).before(DeformableSystems::Respond));
        scene.run(1);
        let expected = XpbdBodyError::Count { what: "positions", expected: 9, found: count };
        assert_eq!(scene.diagnostics().refused, [(body, expected)]);
        scene.run(1);
        assert_eq!(scene.positions(body).len(), count);
    }
}

#[test]
fn a_vertex_of_triangles_without_area_has_a_mass() {
    let mut mesh = grid(2, 2, 0.2, 0.2, Diagonals::Uniform);
    // A spike without area, and a vertex without triangles.
    let spike = mesh.positions.len() as u32;
    mesh.positions.push(mesh.positions[4]);
    mesh.positions.push([0.5, 0.5, 0.5]);
    mesh.positions[spike as usize][1] += 0.1;
    mesh.triangles.push([4, spike, 4]);
    let mut scene = Scene::new();
    let body = scene.add(&mesh, XpbdMaterial::CLOTH, SelfCollision);
    assert!(scene.body(body).inverse_masses.iter().all(|&inverse| inverse.is_finite() && inverse > 0.0));
    scene.run(30);
    assert!(scene.positions(body).iter().all(|position| position.is_finite()));
}

#[test]
fn a_body_that_would_leave_the_range_of_numbers_stands_and_says_so() {
    for gravity in [3.0e38, 1.0e25, f32::MAX] {
        let mut scene = Scene::new();
        let body = scene.add(&grid(2, 2, 0.2, 0.2, Diagonals::Uniform), XpbdMaterial::CLOTH, SelfCollision);
        // A pinned vertex makes no difference.
        let held = scene.add_changed(
            &icosphere(1, 0.1).translate([3.0, 0.0, 0.0]),
            XpbdMaterial::SOFT,
            |body| body.pinned([VertexId(0)]),
            (),
        );
        scene.run(2);
        let before = [body, held].map(|body| scene.positions(body).to_vec());
        scene.settings().gravity = Vec3::new(0.0, -gravity, 0.0);
        for _ in 0..5 {
            scene.run(1);
            let refused = &scene.diagnostics().refused;
            assert_eq!(refused.len(), 2, "{gravity}: {refused:?}");
            for (body, before) in [body, held].into_iter().zip(&before) {
                assert!(
                    refused
                        .iter()
                        .any(|(entity, error)| *entity == body && matches!(error, XpbdBodyError::OutOfRange(_))),
                    "{gravity}: {refused:?}"
                );
                assert_eq!(scene.positions(body), before, "{gravity}");
                assert!(scene.body(body).velocities.iter().all(|&velocity| velocity == Vec3::ZERO), "{gravity}");
            }
        }
        scene.settings().gravity = XpbdSettings::default().gravity;
        scene.run(3);
        assert!(scene.diagnostics().refused.is_empty(), "{:?}", scene.diagnostics().refused);
        assert!(scene.positions(body)[0].y < before[0][0].y, "it falls again");
    }
}

#[test]
fn a_body_whose_seams_differ_by_rounding_keeps_its_volume_once_it_is_welded() {
    let volume = |corners: &[Vec3]| {
        let triples =
            corners.chunks(3).map(|corner| corner[0].as_dvec3().dot(corner[1].as_dvec3().cross(corner[2].as_dvec3())));
        triples.sum::<f64>() / 6.0
    };
    let (corners, triangles) = apart(&cuboid([0.1; 3], 3), 1.0e-6);
    let mut scene = Scene::new();
    let (surface, positions) = DeformableSurface::builder(&corners, &triangles).weld_within(1.0e-5).build().unwrap();
    assert!(surface.topology().is_closed());
    let material = XpbdMaterial { stretch_compliance: 1.0e-2, ..XpbdMaterial::SOFT };
    let body = XpbdBody::new(&surface, &positions, material).unwrap();
    let body =
        scene.app.world_mut().spawn((surface.clone(), positions, body, Transform::from_xyz(0.0, 0.12, 0.0))).id();
    scene.app.world_mut().spawn(RigidShape(SharedShape::halfspace(Vec3::Y)));
    let before = volume(&corners);
    scene.run(1);
    // The first tick closes the seams, and moves vertices by no more than the seams were open.
    for (vertex, &weld) in surface.topology().weld().iter().enumerate() {
        assert_eq!(scene.positions(body)[vertex], scene.positions(body)[weld as usize]);
    }
    assert!(scene.positions(body).iter().zip(&corners).all(|(now, then)| (*now - *then).length() < 0.01));
    scene.run(120);
    let after = volume(scene.positions(body));
    // Ten substeps leave a fraction of a percent of the volume's error.
    assert!((after / before - 1.0).abs() < 0.02, "{before} has become {after}");
    assert!(scene.diagnostics().refused.is_empty());
}
