//! Bodies that overlap deeply come apart, and no tetrahedron is turned inside out on the way.

use bevy_circumsphere::{
    kernel::tetrahedra::{containment::ContainmentSearch, topology::TetrahedralTopology},
    response::*,
};
use circumsphere_support::tetrahedra::{TetrahedralMesh, tetrahedral_ball, tetrahedral_box};
use glam::{DVec3, Vec3};

use crate::world::{Solid, World, moved};

/// The number of vertices of one body in another.
fn inside(world: &World, body: &Solid, container: &Solid) -> usize {
    let rest: Vec<Vec3> = container.rest.iter().map(|at| at.as_vec3()).collect();
    let topology = TetrahedralTopology::new(&rest, &container.tetrahedra).unwrap();
    let now: Vec<Vec3> = world.positions(container).iter().map(|at| at.as_vec3()).collect();
    let mut found = Vec::new();
    let points = world.positions(body).into_iter();
    ContainmentSearch::default().find(&topology, &now, points, None, &mut found);
    found.len()
}

/// What became of two bodies.
#[derive(Debug, Default)]
struct Parting {
    began_inside: usize,
    inside: usize,
    /// The tick after which nothing was inside.
    parted: usize,
    inverted: usize,
    least_volume: f64,
    fastest: f32,
}

fn part(meshes: [&TetrahedralMesh; 2], material: XpbdMaterial, ticks: usize) -> Parting {
    let mut world = World::new();
    let bodies = meshes.map(|mesh| world.add(mesh, material, ()));
    let both = |world: &World| inside(world, &bodies[0], &bodies[1]) + inside(world, &bodies[1], &bodies[0]);
    let mut parting = Parting { began_inside: both(&world), least_volume: f64::INFINITY, ..Parting::default() };
    for tick in 0..ticks {
        world.tick();
        for body in &bodies {
            parting.inverted = parting.inverted.max(world.inverted(body));
            let least = world.volumes(body).into_iter().fold(f64::INFINITY, f64::min);
            parting.least_volume = parting.least_volume.min(least);
            parting.fastest = parting.fastest.max(world.fastest(body));
        }
        parting.inside = both(&world);
        if parting.inside > 0 {
            parting.parted = tick + 1;
        }
    }
    parting
}

#[test]
fn balls_that_overlap_by_10_to_60_percent_part_without_an_inverted_tetrahedron() {
    let mut failures = Vec::new();
    for young_modulus in [2.0e4, 1.0e5, 1.0e6] {
        for percent in [10, 20, 30, 40, 50, 60] {
            let ball = tetrahedral_ball(6, 0.2);
            let away = 0.4 * (1.0 - f64::from(percent) / 100.0);
            let direction = DVec3::new(0.6, 0.48, 0.64) * away;
            let other = moved(&ball, direction.as_vec3().to_array());
            let material = XpbdMaterial { young_modulus, ..XpbdMaterial::SOLID };
            let parting = part([&ball, &other], material, 120);
            println!("{young_modulus:e} {percent} %: {parting:?}");
            assert!(parting.began_inside > 0);
            if parting.inside > 0 || parting.inverted > 0 {
                failures.push(format!("{young_modulus:e} {percent} %: {parting:?}"));
            }
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

#[test]
fn other_bodies_that_overlap_part_too() {
    let cube = tetrahedral_box([6; 3], [0.2; 3]);
    let bar = tetrahedral_box([16, 3, 3], [0.5, 0.09, 0.09]);
    let ball = tetrahedral_ball(6, 0.15);
    let mut failures = Vec::new();
    for (name, one, other, by) in [
        ("a ball in a cube", &cube, &ball, [0.11, 0.03, 0.02]),
        ("a ball in the middle of a cube", &cube, &ball, [0.0, 0.0, 0.0]),
        ("a bar through a cube", &cube, &bar, [0.02, 0.08, 0.03]),
        ("two bars crossed", &bar, &moved(&tetrahedral_box([3, 3, 16], [0.09, 0.09, 0.5]), [0.0; 3]), [0.1, 0.05, 0.1]),
    ] {
        let parting = part([one, &moved(other, by)], XpbdMaterial::SOLID, 120);
        println!("{name}: {parting:?}");
        assert!(parting.began_inside > 0);
        if parting.inside > 0 || parting.inverted > 0 {
            failures.push(format!("{name}: {parting:?}"));
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}
