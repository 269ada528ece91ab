//! Bodies without contacts, against closed forms.

use bevy_circumsphere::{prelude::*, response::*};
use bevy_ecs::{entity_disabling::Disabled, prelude::*};
use bevy_transform::components::Transform;
use circumsphere_support::scenes::{Diagonals, grid, icosphere};
use glam::{DVec3, Vec3};

use crate::harness::{LOSSLESS, Scene, TICK, mean};

#[test]
fn what_falls_falls_as_steps_of_its_size_do() {
    let mut scene = Scene::new();
    let body = scene.add(&icosphere(2, 0.1), LOSSLESS, ());
    scene.run(30);
    // Velocities are updated first, then positions. After n steps of length h, the fall is g h² n (n + 1) / 2.
    let (step, steps) = (TICK / 10.0, 300.0);
    let fallen = 9.81 * step * step * steps * (steps + 1.0) / 2.0;
    // Positions are stored in single precision once per tick.
    assert!((mean(scene.positions(body)).y + fallen).abs() < 30.0 * 1e-6, "{fallen}");
    assert!((f64::from(scene.body(body).velocities[0].y) + 9.81 * 0.5).abs() < 1e-4);
}

#[test]
fn drag_takes_its_share_of_the_velocity() {
    let mut scene = Scene::new();
    scene.settings().gravity = Vec3::ZERO;
    let material = XpbdMaterial { drag: 1.5, ..LOSSLESS };
    let body = scene.add_changed(&icosphere(1, 0.1), material, |body| body.moving(Vec3::X), ());
    scene.run(60);
    // Each of 600 steps loses a share of drag · h.
    let kept = (1.0_f64 - 1.5 / 600.0).powi(600);
    assert!((f64::from(scene.body(body).velocities[3].x) - kept).abs() < 1e-4);
}

#[test]
fn nothing_inside_a_body_changes_its_momentum() {
    let mut scene = Scene::new();
    scene.settings().gravity = Vec3::ZERO;
    let material = XpbdMaterial { drag: 0.0, ..XpbdMaterial::SOFT };
    let body = scene.add(&icosphere(2, 0.1), material, ());
    {
        let mut body = scene.body_mut(body);
        body.velocities.iter_mut().enumerate().for_each(|(vertex, velocity)| {
            *velocity = if vertex % 3 == 0 { Vec3::new(0.7, -0.2, 0.4) } else { Vec3::ZERO };
        });
    }
    let momentum = |scene: &Scene| {
        let body = scene.body(body);
        let masses = body.inverse_masses.iter().map(|&inverse| 1.0 / f64::from(inverse));
        body.velocities.iter().zip(masses).map(|(velocity, mass)| velocity.as_dvec3() * mass).sum::<DVec3>()
    };
    let (before, energy) = (momentum(&scene), scene.body(body).kinetic_energy());
    scene.run(60);
    // Velocities are rounded to single precision once per tick: 60 · 6e-8.
    assert!((momentum(&scene) - before).length() < 1e-5 * before.length());
    let after = scene.body(body).kinetic_energy();
    assert!(after < 0.7 * energy, "inner motion is not damped: {energy} {after}");
}

#[test]
fn a_pinned_cloth_hangs_by_its_weight_over_its_stiffness() {
    // One column of cells, pinned at its upper row. Every row carries the weight of everything below it.
    let mut scene = Scene::new();
    scene.settings().iterations = 20;
    let mesh = grid(1, 10, 0.1, 1.0, Diagonals::Uniform).rotate([1.0, 0.0, 0.0], std::f32::consts::FRAC_PI_2);
    let highest = mesh.positions.iter().map(|position| position[1]).fold(f32::MIN, f32::max);
    let pins: Vec<VertexId> = (0..mesh.positions.len())
        .filter(|&vertex| mesh.positions[vertex][1] > highest - 1e-4)
        .map(|vertex| VertexId(vertex as u32))
        .collect();
    assert_eq!(pins.len(), 2);
    let material =
        XpbdMaterial { stretch_compliance: 2e-3, bend_compliance: f32::INFINITY, drag: 3.0, ..XpbdMaterial::CLOTH };
    let body = scene.add_changed(&mesh, material, |body| body.pinned(pins.clone()), ());
    let lowest = |scene: &Scene| scene.positions(body).iter().map(|position| position.y).fold(f32::MAX, f32::min);
    let before = lowest(&scene);
    scene.run(600);
    let sag = f64::from(before - lowest(&scene));
    // A row of cells weighs 0.2 · 0.1 · 0.1 kg. Two columns share the weight below the middle of a row, but not quite
    // equally, because one has more triangles around its vertices. The diagonals carry a part of it. So the sag of the
    // columns alone is roughly an upper bound, and half of it a lower bound.
    let weight = 0.2 * 0.1 * 0.1 * 9.81;
    let alone: f64 = (1..=10).map(|row| 2e-3 * weight * (f64::from(row) - 0.5) / 2.0).sum();
    assert!(sag < 1.05 * alone && sag > 0.5 * alone, "{sag} of {alone}");
    for pin in pins {
        assert_eq!(scene.positions(body)[pin.index()], Vec3::from(mesh.positions[pin.index()]));
    }
}

#[test]
fn a_pinned_vertex_goes_where_the_game_writes_it() {
    let mut scene = Scene::new();
    let mesh = grid(4, 4, 0.4, 0.4, Diagonals::Uniform);
    let body = scene.add_changed(&mesh, XpbdMaterial::CLOTH, |body| body.pinned([VertexId(0), VertexId(4)]), ());
    for _ in 0..60 {
        let mut positions = scene.app.world_mut().get_mut::<SurfacePositions>(body).unwrap();
        positions.0[0].x += 0.01;
        positions.0[4].x += 0.01;
        scene.tick(TICK);
    }
    assert!((scene.positions(body)[0].x - (mesh.positions[0][0] + 0.6)).abs() < 1e-5);
    let speed = scene.body(body).velocities.iter().map(|velocity| f64::from(velocity.x)).sum::<f64>() / 25.0;
    assert!((speed - 0.6).abs() < 0.3, "the cloth does not follow its pinned vertex: {speed}");
}

#[test]
fn a_soft_ball_keeps_its_volume_where_a_shell_does_not() {
    let volumes = [0.0, f32::INFINITY].map(|volume_compliance| {
        let mut scene = Scene::new();
        scene.app.world_mut().spawn(RigidShape(SharedShape::halfspace(Vec3::Y)));
        let mesh = icosphere(2, 0.1).translate([0.0, 0.12, 0.0]);
        let material =
            XpbdMaterial { volume_compliance, bend_compliance: 1e5, area_density: 5.0, ..XpbdMaterial::SOFT };
        let body = scene.add(&mesh, material, ());
        let volume = |positions: &[Vec3]| -> f64 {
            let at = |vertex: u32| positions[vertex as usize].as_dvec3();
            mesh.triangles.iter().map(|&[a, b, c]| at(a).dot(at(b).cross(at(c))) / 6.0).sum()
        };
        let before = volume(scene.positions(body));
        scene.run(120);
        volume(scene.positions(body)) / before
    });
    assert!((volumes[0] - 1.0).abs() < 0.02, "{volumes:?}");
    assert!(volumes[1] < 0.9, "the shell keeps too much of its volume: {volumes:?}");
}

/// What is taken out of a pool begins where the game puts it, whichever component kept it there.
#[test]
fn a_body_that_was_disabled_is_where_its_transform_puts_it() {
    fn pooled(put: fn(&mut EntityWorldMut), take: fn(&mut EntityWorldMut)) {
        let mut scene = Scene::new();
        let mesh = grid(4, 4, 1.0, 1.0, Diagonals::Uniform);
        let cloth = scene.add(&mesh, LOSSLESS, Transform::default());
        scene.run(5);
        let before = mean(scene.positions(cloth));
        put(&mut scene.app.world_mut().entity_mut(cloth));
        scene.app.world_mut().get_mut::<Transform>(cloth).unwrap().translation.x = 10.0;
        scene.run(3);
        assert_eq!(scene.app.world().get::<SurfaceStatus>(cloth), Some(&SurfaceStatus::Disabled));
        assert_eq!(mean(scene.positions(cloth)), before, "time stands still for it");
        take(&mut scene.app.world_mut().entity_mut(cloth));
        scene.run(1);
        let after = mean(scene.positions(cloth));
        // Relative to its transform, it has only fallen on. Positions are stored in single precision.
        assert!((after.x - before.x).abs() < 1e-5 && after.y < before.y, "{before} {after}");
    }
    pooled(|cloth| _ = cloth.insert(SurfaceDisabled), |cloth| _ = cloth.remove::<SurfaceDisabled>());
    pooled(|cloth| _ = cloth.insert(Disabled), |cloth| _ = cloth.remove::<Disabled>());
}

/// Bevy's first frame takes no time. What is new then has been there before the second.
#[test]
fn shapes_have_not_moved_when_the_clock_starts() {
    let mut scene = Scene::new();
    let pole = RigidShape(SharedShape::capsule_y(1.0, 0.05));
    scene.app.world_mut().spawn((pole, Transform::from_xyz(-1.3, 1.7, -0.5)));
    let cloth = grid(10, 10, 1.0, 1.0, Diagonals::Alternating).translate([-0.5, 1.7, -0.5]);
    scene.add(&cloth, XpbdMaterial::CLOTH, SweptCollision);
    scene.tick(0.0);
    for _ in 0..3 {
        scene.tick(1.0 / 60.0);
        assert_eq!(scene.diagnostics().parts, 1);
    }
}
