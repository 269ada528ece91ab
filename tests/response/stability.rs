//! What must not blow up, whatever a game does.

use bevy_circumsphere::{prelude::*, response::*};
use circumsphere_support::scenes::{Diagonals, Mesh, cuboid, grid, icosphere, needle, pile_body, torus};
use glam::Vec3;

use crate::harness::{Scene, TICK};

/// The greatest speed of a vertex, in meters per second; not a number if one is not.
fn fastest(scene: &Scene, entity: bevy_ecs::entity::Entity) -> f32 {
    let speeds = scene.body(entity).velocities.iter().map(|velocity| velocity.length());
    speeds.fold(0.0, |fastest, speed| if speed > fastest || speed.is_nan() { speed } else { fastest })
}

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
            // Rounding to single precision is a micrometer a tick at this distance, a thousandth of this bound.
            let speed = fastest(&scene, body);
            assert!((speed - 1.0).abs() < 0.1, "{name} {material:?}: {speed}");
        }
    }
}
