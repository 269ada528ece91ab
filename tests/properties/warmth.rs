//! A long-running world finds the same as a new one, despite refitted and decayed trees, reused buffers, and lazily
//! refreshed spheres.

use crate::strategies::{motion, placement, two_meshes};
use bevy_circumsphere::{Circumspheres, detection::DetectionDiagnostics, geometry::CompactContact, prelude::*};
use proptest::prelude::*;

use crate::{
    agreement::edges,
    harness::{Body, Count, EXACT_METHODS, Found, Setup, SmallWorld, for_all, mean_edge, points},
};

/// The part of a contact that does not depend on earlier ticks. The side of a sheet on which something was decides the
/// sign of the distance and of the normal.
fn without_sides(contact: &CompactContact) -> (u64, [u32; 2], [u32; 4], u32, [u32; 3]) {
    let weights = [contact.barycentric_a, contact.barycentric_b].as_flattened().to_vec();
    (
        contact.key.0,
        [contact.triangle_a, contact.triangle_b],
        std::array::from_fn(|k| weights[k].to_bits()),
        contact.distance.abs().to_bits(),
        contact.normal.abs().to_array().map(f32::to_bits),
    )
}

#[track_caller]
fn assert_same(tick: usize, warm: &[Found], cold: &[Found]) {
    assert_eq!(warm.len(), cold.len(), "tick {tick}: different surfaces touch");
    for (warm, cold) in warm.iter().zip(cold) {
        assert_eq!(warm.sides, cold.sides, "tick {tick}");
        assert_eq!(warm.touching, cold.touching, "tick {tick}");
        let (warm_contacts, cold_contacts) = (warm.contacts.iter(), cold.contacts.iter());
        assert!(
            warm_contacts.map(without_sides).eq(cold_contacts.map(without_sides)),
            "tick {tick}: {:?} has different contacts",
            warm.sides
        );
    }
}

#[test]
fn a_world_that_has_run_for_long_finds_what_a_new_one_finds() {
    let (ticks, touching) = (Count::default(), Count::default());
    let motions = prop::collection::vec((motion(), motion()), 3..12);
    let case = (two_meshes(), motions, placement(), edges());
    for_all(file!(), 150, case, |(meshes, motions, placement, edges)| {
        let distance = (edges * mean_edge(&meshes[0])) as f32 * placement.scale;
        let bodies: Vec<Body> = meshes.iter().map(|mesh| Body::new(&placement.apply(mesh.clone()))).collect();
        for method in EXACT_METHODS {
            let setup = Setup { method, ..Setup::REFINED };
            let mut warm = SmallWorld::new(&bodies, distance, setup);
            warm.tick();
            let mut current = meshes.clone();
            for (tick, motions) in motions.iter().enumerate() {
                current = [motions.0.apply(current[0].clone()), motions.1.apply(current[1].clone())];
                let mut cold = SmallWorld::new(&bodies, distance, setup);
                for (body, mesh) in current.iter().enumerate() {
                    let positions = points(&placement.apply(mesh.clone()));
                    warm.write(body, &positions);
                    cold.write(body, &positions);
                }
                let found = warm.tick();
                assert_same(tick, &found, &cold.tick());
                ticks.add(1);
                touching.add(found.iter().map(|found| found.touching.len()).sum());
            }
        }
    });
    ticks.assert_at_least(1500, "ticks");
    touching.assert_at_least(200_000, "touching pairs");
}

#[test]
fn stale_spheres_of_a_world_that_has_run_for_long_contain_their_triangles() {
    let (checked, lazy) = (Count::default(), Count::default());
    let motions = prop::collection::vec((motion(), motion()), 3..12);
    let case = (two_meshes(), motions, placement(), edges());
    for_all(file!(), 400, case, |(meshes, motions, placement, edges)| {
        let distance = (edges * mean_edge(&meshes[0])) as f32 * placement.scale;
        let bodies: Vec<Body> = meshes.iter().map(|mesh| Body::new(&placement.apply(mesh.clone()))).collect();
        let setup = Setup { method: ContactMethod::Circumsphere, ..Setup::REFINED };
        let mut world = SmallWorld::new(&bodies, distance, setup);
        world.tick();
        let mut current = meshes;
        for motions in motions {
            let [first, second] = current;
            current = [motions.0.apply(first), motions.1.apply(second)];
            for (body, mesh) in current.iter().enumerate() {
                world.write(body, &points(&placement.apply(mesh.clone())));
            }
            world.tick();
            let refreshed = world.app.world().resource::<DetectionDiagnostics>().recipes_refreshed;
            let mut count = 0;
            for (body, mesh) in current.iter().enumerate() {
                let positions = points(&placement.apply(mesh.clone()));
                let spheres = &world.app.world().get::<Circumspheres>(world.entities[body]).expect("it has some");
                count += spheres.radii.len();
                for (triangle, corners) in mesh.triangles.iter().enumerate().take(spheres.radii.len()) {
                    let center = spheres.centers[triangle].as_dvec3();
                    let radius = f64::from(spheres.radii[triangle]);
                    for &vertex in corners {
                        let distance = positions[vertex as usize].as_dvec3().distance(center);
                        assert!(distance <= radius, "a corner of {triangle} is {distance} away, not {radius}");
                    }
                }
            }
            checked.add(count);
            lazy.add(count.saturating_sub(refreshed));
        }
    });
    checked.assert_at_least(100_000, "spheres");
    lazy.assert_at_least(50_000, "spheres that were not made anew");
}
