//! Bodies fall on the ground and on each other, and come to rest.

use std::f64::consts::FRAC_PI_2;

use bevy_circumsphere::{CircumsphereSettings, prelude::*, response::*};
use bevy_transform::components::Transform;
use circumsphere_support::{
    random::Random,
    tetrahedra::{
        HALF_WIDTH_OF_PIT, TetrahedralMesh, WALLS_OF_PIT, tetrahedral_ball, tetrahedral_box, tetrahedral_pile,
    },
};
use glam::{DQuat, DVec3, Vec3};

use crate::{
    files::bodies,
    world::{Solid, World, moved},
};

/// Ticks in a row in which all bodies must be at rest.
const REST: usize = 60;

/// Bodies above the ground, between walls.
fn above_ground(meshes: &[TetrahedralMesh], walls: &[[f32; 3]], material: XpbdMaterial) -> (World, Vec<Solid>) {
    let mut world = World::new();
    world.settings().gravity = Vec3::NEG_Y * 9.81;
    world.app.world_mut().spawn(RigidShape(SharedShape::halfspace(Vec3::Y)));
    for normal in walls.iter().copied().map(Vec3::from_array) {
        let at = Transform::from_translation(normal * -(HALF_WIDTH_OF_PIT as f32));
        world.app.world_mut().spawn((RigidShape(SharedShape::halfspace(normal)), at));
    }
    let solids = meshes.iter().map(|mesh| world.add(mesh, material, SelfCollision)).collect();
    (world, solids)
}

/// Drops bodies between walls, and returns the world when they have come to rest, with the number of ticks, or else the
/// speed of the fastest vertex of each. They have so many ticks for it.
fn dropped(
    meshes: &[TetrahedralMesh],
    walls: &[[f32; 3]],
    ticks: usize,
    material: XpbdMaterial,
) -> Result<(World, Vec<Solid>, usize), Vec<f32>> {
    let (mut world, solids) = above_ground(meshes, walls, material);
    let mut resting = 0;
    for tick in 0..ticks {
        world.tick();
        for (number, solid) in solids.iter().enumerate() {
            let volumes = world.volumes(solid);
            let least = volumes.into_iter().fold(f64::INFINITY, f64::min);
            assert!(least > 0.0, "body {number} has a tetrahedron of volume {least} in tick {tick}");
        }
        let is_at_rest = |solid: &Solid| {
            let velocities = &world.body(solid).velocities;
            let mean = velocities.iter().map(|velocity| velocity.length()).sum::<f32>() / velocities.len() as f32;
            // Single corners that are pressed flat may tremble.
            mean < 0.02 && world.fastest(solid) < 0.1
        };
        resting = if solids.iter().all(is_at_rest) { resting + 1 } else { 0 };
        if resting == REST {
            assert_on_the_ground(&world, &solids);
            return Ok((world, solids, tick + 1 - REST));
        }
    }
    Err(solids.iter().map(|solid| world.fastest(solid)).collect())
}

fn assert_on_the_ground(world: &World, solids: &[Solid]) {
    for (number, solid) in solids.iter().enumerate() {
        let lowest = world.positions(solid).into_iter().map(|at| at.y).fold(f64::INFINITY, f64::min);
        assert!(lowest > 0.0, "body {number} is in the ground: {lowest}");
    }
}

#[test]
fn boxes_come_to_rest_on_each_other_without_an_inverted_tetrahedron() {
    // Without the balls, which roll for long.
    let boxes: Vec<TetrahedralMesh> = tetrahedral_pile().into_iter().step_by(2).take(4).collect();
    let dropped = dropped(&boxes, &[], 600, XpbdMaterial::SOLID);
    assert!(dropped.is_ok(), "{:?} m/s", dropped.err());
}

/// The ten bodies of the pile in another order, each level turned about the pit's axis by some quarters, each body turned
/// about its center, and shifted. Seed 0 leaves them as they are.
fn arranged(seed: u64) -> Vec<TetrahedralMesh> {
    let mut meshes = tetrahedral_pile();
    if seed == 0 {
        return meshes;
    }
    let mut random = Random::new(seed);
    for level in meshes.chunks_mut(2) {
        let quarter = DQuat::from_rotation_y(FRAC_PI_2 * random.below(4) as f64);
        for TetrahedralMesh { positions, .. } in level {
            let center = positions.iter().map(|at| Vec3::from_array(*at).as_dvec3()).sum::<DVec3>();
            let center = center / positions.len() as f64;
            let turn = DQuat::from_array(std::array::from_fn(|_| f64::from(random.signed_unit()))).normalize();
            // There is no more room beside them.
            let shift = DVec3::new(0.005, 0.03, 0.005)
                * DVec3::from_array(std::array::from_fn(|_| f64::from(random.signed_unit())));
            for at in positions {
                let from_center = Vec3::from_array(*at).as_dvec3() - center;
                *at = (quarter * center + turn * from_center + shift).as_vec3().to_array();
            }
        }
    }
    for end in (2..=meshes.len()).rev() {
        meshes.swap(end - 1, random.below(end as u64) as usize);
    }
    meshes
}

/// Returns the moduli with which they do not come to rest.
fn ten_come_to_rest(seed: u64) -> Vec<f32> {
    let mut trembling = Vec::new();
    for young_modulus in [3.0e4, 1.0e5, 1.0e6] {
        let material = XpbdMaterial { young_modulus, ..XpbdMaterial::SOLID };
        let (world, solids, ticks) = match dropped(&arranged(seed), &WALLS_OF_PIT, 1800, material) {
            Ok(dropped) => dropped,
            Err(fastest) => {
                println!("arrangement {seed}, {young_modulus:e}: not at rest, {fastest:?} m/s");
                trembling.push(young_modulus);
                continue;
            }
        };
        let count: usize = solids.iter().map(|solid| solid.tetrahedra.len()).sum();
        assert!(count >= 10_000);
        let heights: Vec<[f64; 2]> = solids
            .iter()
            .map(|solid| {
                let heights = world.positions(solid).into_iter().map(|at| at.y);
                heights.fold([f64::INFINITY, 0.0], |[low, high], y| [low.min(y), high.max(y)])
            })
            .collect();
        let highest = heights.iter().map(|[_, high]| *high).fold(0.0, f64::max);
        let [at_rest, now] = solids
            .iter()
            .map(|solid| world.whole_volumes(solid))
            .fold([0.0; 2], |sum, volumes| [sum[0] + volumes[0], sum[1] + volumes[1]]);
        let carried = heights.iter().filter(|[low, _]| *low > 0.05).count();
        println!(
            "arrangement {seed}, {young_modulus:e}: at rest after {ticks} ticks, {highest:.3} m high, with {:.4} of the volume; {carried} of \
             the bodies are not on the ground",
            now / at_rest
        );
        // Half a meter presses with up to 5,000 pascals, which compresses by `p (1 − 2ν) / E`: by 1.7 % at the lowest
        // modulus. A pile has gaps, so the load is on less than all of the area.
        assert!(now > 0.95 * at_rest, "{now} of {at_rest} cubic meters");
        // So much volume does not fit into the pit any lower.
        let floor = 4.0 * HALF_WIDTH_OF_PIT * HALF_WIDTH_OF_PIT;
        assert!(highest > now / floor, "{highest}");
        assert!(carried > 1, "all are on the ground: {heights:?}");
    }
    trembling
}

#[test]
#[ignore = "takes a minute"]
fn ten_bodies_of_a_thousand_tetrahedra_come_to_rest_in_every_arrangement() {
    let trembling: Vec<Vec<f32>> = (0..8).map(ten_come_to_rest).collect();
    assert!(trembling.iter().all(Vec::is_empty), "{trembling:?}");
}

/// Soft bodies are pressed into each other where they land. They trembled forever while a vertex inside of a body switched
/// off the contacts that carried it elsewhere. Stiff bodies press the corners of their tetrahedra flat against the walls,
/// and did the same while contacts let go of vertices that stood still.
#[test]
fn piles_of_soft_usual_and_stiff_bodies_come_to_rest() {
    let usual = XpbdMaterial::SOLID.young_modulus;
    for (young_modulus, seeds) in [(3.0e4, [0, 3, 7]), (usual, [0, 1, 2]), (1.0e6, [1, 2, 7])] {
        let material = XpbdMaterial { young_modulus, ..XpbdMaterial::SOLID };
        for seed in seeds {
            let dropped = dropped(&arranged(seed), &WALLS_OF_PIT, 600, material);
            assert!(dropped.is_ok(), "{seed}, {young_modulus:e}: {:?} m/s", dropped.err());
        }
    }
}

#[test]
fn a_pile_is_the_same_for_any_number_of_threads() {
    let positions = |threads: usize| {
        let (mut world, solids) = above_ground(&tetrahedral_pile(), &WALLS_OF_PIT, XpbdMaterial::SOLID);
        world.app.world_mut().resource_mut::<CircumsphereSettings>().threads = threads;
        // By then the lowest have hit the ground.
        world.run(30);
        solids.iter().flat_map(|solid| world.positions(solid)).collect::<Vec<DVec3>>()
    };
    assert!(positions(1) == positions(2), "positions differ");
}

#[test]
fn real_bodies_fall_on_the_ground_and_end_without_an_inverted_tetrahedron() {
    let mut inverted = Vec::new();
    for (name, mesh) in bodies() {
        let (low, high) = mesh
            .positions
            .iter()
            .fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), at| (low.min(at[1]), high.max(at[1])));
        let mut world = World::new();
        world.settings().gravity = Vec3::NEG_Y * 9.81;
        world.app.world_mut().spawn(RigidShape(SharedShape::halfspace(Vec3::Y)));
        let solid = world.add(&moved(&mesh, [0.0, 0.3 - low, 0.0]), XpbdMaterial::SOLID, SelfCollision);
        let left_out: Vec<usize> = world.body(&solid).left_out().iter().map(|id| id.index()).collect();
        assert!(left_out.len() <= 2, "{name}: {left_out:?}");
        let mut least = f64::INFINITY;
        for _ in 0..150 {
            world.tick();
            let volumes = world.volumes(&solid).into_iter().enumerate();
            let held = volumes.filter(|(place, _)| !left_out.contains(place)).map(|(_, volume)| volume);
            least = held.fold(least, f64::min);
        }
        println!("{name}: the least volume is {least:.3}, the fastest vertex has {:.4} m/s", world.fastest(&solid));
        if least <= 0.0 {
            inverted.push((name, least));
        }
        let volumes = world.volumes(&solid).into_iter().enumerate();
        let last = volumes.filter(|(place, _)| !left_out.contains(place)).map(|(_, volume)| volume);
        let last = last.fold(f64::INFINITY, f64::min);
        assert!(last > 0.0, "{name} ends with a tetrahedron of volume {last}");
        let top = world.positions(&solid).into_iter().map(|at| at.y).fold(0.0, f64::max);
        // The longest, of 10 m, still swings.
        assert!(top < f64::from(high - low) + 0.1, "{name} is {top} high");
    }
    assert!(inverted.is_empty(), "{inverted:?}");
}

#[test]
fn a_swept_ball_that_is_thrown_at_the_ground_and_at_a_cube_passes_through_neither_and_is_not_inverted() {
    for speed in [5.0, 10.0, 20.0] {
        let mut world = World::new();
        world.app.world_mut().spawn(RigidShape(SharedShape::halfspace(Vec3::Y)));
        let cube = world.add(&tetrahedral_box([6; 3], [0.15; 3]), XpbdMaterial::SOLID, SweptCollision);
        world.place(&cube, cube.rest.iter().map(|at| *at + DVec3::Y * 0.16));
        let ball = world.add(&tetrahedral_ball(6, 0.12), XpbdMaterial::SOLID, (SweptCollision, SelfCollision));
        world.place(&ball, ball.rest.iter().map(|at| *at + DVec3::new(0.03, 0.6, 0.02)));
        world.body_mut(&ball).velocities.fill(Vec3::NEG_Y * speed);
        let mut least = f64::INFINITY;
        for tick in 0..60 {
            world.tick();
            for body in [&cube, &ball] {
                least = world.volumes(body).into_iter().fold(least, f64::min);
                let lowest = world.positions(body).into_iter().map(|at| at.y).fold(f64::INFINITY, f64::min);
                assert!(lowest > 0.0, "{speed}: {lowest} in tick {tick}");
            }
        }
        println!("{speed} m/s: the least volume is {least:.3}");
        // The guard stops faster ones on their way, and the inside follows in the next ticks.
        assert!(least > 0.0 || speed > 5.0, "{speed}: {least}");
        assert_eq!([&cube, &ball].map(|body| world.inverted(body)), [0; 2], "{speed}");
        let highest = world.positions(&ball).into_iter().map(|at| at.y).fold(0.0, f64::max);
        assert!(highest > 0.15, "it has been crushed: {highest}");
    }
}
