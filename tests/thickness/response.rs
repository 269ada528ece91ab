//! The response keeps bodies as far apart as they are thick.

use std::time::Duration;

use bevy_app::prelude::*;
use bevy_circumsphere::{prelude::*, response::*};
use bevy_time::Time;
use bevy_transform::components::Transform;
use circumsphere_support::scenes::{Diagonals, Mesh, cloth, grid};
use glam::Vec3;

const TICK: f64 = 1.0 / 60.0;

fn scene() -> App {
    let mut app = App::new();
    app.add_plugins((DeformableCollisionPlugins::new(Update), XpbdResponsePlugin::new(Update)));
    app.init_resource::<Time>();
    app.finish();
    app.cleanup();
    app
}

fn run(app: &mut App, ticks: usize) {
    for _ in 0..ticks {
        app.world_mut().resource_mut::<Time>().advance_by(Duration::from_secs_f64(TICK));
        app.update();
    }
}

fn surface(mesh: &Mesh) -> (DeformableSurface, SurfacePositions) {
    let points: Vec<Vec3> = mesh.positions.iter().copied().map(Vec3::from_array).collect();
    DeformableSurface::from_mesh(&points, &mesh.triangles).expect("the mesh is valid")
}

/// The thickness of a wedge of 2 by 2: from 0.02 to 0.1 along x.
fn wedge_thickness(x: f32) -> f32 {
    0.06 + 0.04 * x
}

fn wedge() -> (Mesh, VertexThickness) {
    let mesh = grid(20, 20, 2.0, 2.0, Diagonals::Uniform);
    let thickness = VertexThickness::new(mesh.positions.iter().map(|[x, ..]| wedge_thickness(*x)));
    (mesh, thickness)
}

#[test]
fn cloth_rests_on_a_wedge_as_high_as_that_is_thick() {
    for swept in [false, true] {
        let mut app = scene();
        let (mesh, thickness) = wedge();
        app.world_mut().spawn((surface(&mesh), thickness));
        let mesh = cloth(21, 0.08);
        let (cloth, positions) = surface(&mesh);
        let mut body = XpbdBody::new(&cloth, &positions, XpbdMaterial::CLOTH).expect("the material is valid");
        // Fast enough to go through the wedge in a tick.
        body.velocities.fill(Vec3::Y * if swept { -12.0 } else { 0.0 });
        let place = Transform::from_xyz(0.0, 0.25, 0.0);
        let bundle = (cloth, positions, body, place, SurfaceThickness::World(0.01), SurfaceFriction::default());
        let entity = app.world_mut().spawn(bundle).id();
        if swept {
            app.world_mut().entity_mut(entity).insert(SweptCollision);
        }
        run(&mut app, 240);
        let positions = &app.world().get::<SurfacePositions>(entity).expect("it is a surface").0;
        let (mut count, mut worst) = (0, 0.0_f32);
        for position in positions {
            let at = *position + Vec3::Y * 0.25;
            if at.x.abs() > 0.9 || at.z.abs() > 0.9 {
                continue;
            }
            let expected = wedge_thickness(at.x) + 0.01;
            worst = worst.max((at.y - expected).abs() / expected);
            count += 1;
        }
        assert!(count > 300, "{count} on the wedge");
        // A cloth at rest is within a tenth of the contact distance of where it should be.
        assert!(worst < 0.1, "swept {swept}: off by {worst} of the contact distance");
    }
}

#[test]
fn a_wedge_rests_on_the_ground_by_its_thickness() {
    let mut app = scene();
    let ground = SharedShape::halfspace(parry3d::math::Vector::Y);
    app.world_mut().spawn((RigidShape(ground), Transform::IDENTITY));
    let (mesh, thickness) = wedge();
    let (sheet, positions) = surface(&mesh);
    let body = XpbdBody::new(&sheet, &positions, XpbdMaterial::CLOTH).expect("the material is valid");
    let entity = app.world_mut().spawn((sheet, positions, body, thickness, Transform::from_xyz(0.0, 0.15, 0.0))).id();
    run(&mut app, 240);
    let positions = &app.world().get::<SurfacePositions>(entity).expect("it is a surface").0;
    for (position, [x, ..]) in positions.iter().zip(&mesh.positions) {
        let (height, expected) = (position.y + 0.15, wedge_thickness(*x));
        assert!((height - expected).abs() < 0.1 * expected, "at {x}: {height}, not {expected}");
    }
}

#[test]
fn a_shot_stops_at_the_thin_end() {
    // A small cloth is shot at a thin place of a sheet that is thick elsewhere, 0.2 per tick, more than the sheet is thick.
    let mut app = scene();
    let mesh = grid(20, 20, 2.0, 2.0, Diagonals::Uniform);
    let thickness = mesh.positions.iter().map(|[x, ..]| if *x < 0.0 { 0.005 } else { 0.2 });
    let thickness = VertexThickness::new(thickness);
    app.world_mut().spawn((surface(&mesh), thickness));
    let mesh = cloth(5, 0.05);
    let (ball, positions) = surface(&mesh);
    let mut body = XpbdBody::new(&ball, &positions, XpbdMaterial::CLOTH).expect("the material is valid");
    body.velocities.fill(Vec3::Y * -12.0);
    let bundle = (ball, positions, body, Transform::from_xyz(-0.6, 0.3, 0.0), SurfaceThickness::World(0.005));
    let entity = app.world_mut().spawn((bundle, SweptCollision)).id();
    let mut lowest = f32::INFINITY;
    for _ in 0..60 {
        run(&mut app, 1);
        let positions = &app.world().get::<SurfacePositions>(entity).expect("it is a surface").0;
        lowest = positions.iter().map(|position| position.y + 0.3).fold(lowest, f32::min);
    }
    // It comes as close as the sheet is thin there, and not through it.
    assert!(lowest > 0.0 && lowest < 0.05, "{lowest}");
}
