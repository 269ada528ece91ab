//! Bodies that become invalid, teleport, barely exist, or do not exist at all.

use bevy_app::prelude::*;
use bevy_circumsphere::{ContactStore, prelude::*};
use circumsphere_support::scenes::{Diagonals, grid, icosphere};
use glam::Vec3;

use crate::harness::{
    BROAD_PHASES, Body, Case, Found, Run, Stated, Tally, at, combinations, judge, loose_triangles, new_app, points,
    turned,
};

const THIN: f32 = 0.02;

/// Two bodies in contact, and a third one in contact with both.
fn three_bodies() -> Case {
    Case::new([
        Body::new(&grid(6, 6, 2.0, 2.0, Diagonals::Uniform), THIN),
        Body::new(&icosphere(2, 0.4), THIN).at(at(0.1, 0.41, 0.2)),
        Body::new(&icosphere(2, 0.3), THIN).at(at(-0.55, 0.31, 0.2)).meeting_itself(),
    ])
}

const VICTIM: usize = 2;

/// The pairs found between the two intact bodies.
fn between_others(found: &Found) -> Found {
    let mut found = found.clone();
    found.pairs.retain(|&(first, second), _| first != VICTIM && second != VICTIM);
    found
}

#[test]
fn nan_and_infinity_set_one_body_aside_until_it_is_whole_again() {
    let case = three_bodies();
    for (method, broad_phase) in combinations() {
        let what = format!("{method:?}, {broad_phase:?}");
        let mut run = Run::new(&case, method, broad_phase);
        let whole = run.tick();
        assert!(whole.pairs.keys().filter(|pair| pair.1 == VICTIM).count() >= 2, "{what}: it touches both others");
        let healthy = points(&icosphere(2, 0.3));
        for broken in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            for vertices in [0..1, 161..162, 0..162] {
                let mut positions = healthy.clone();
                positions[vertices].iter_mut().for_each(|position| position.y = broken);
                run.deform(VICTIM, positions);
                for _ in 0..2 {
                    let found = run.tick();
                    let status = run.app.world().get::<SurfaceStatus>(run.entities[VICTIM]);
                    assert!(matches!(status, Some(SurfaceStatus::Quarantined(_))), "{what}: {status:?}");
                    found.assert_same_bits(&between_others(&whole), &what);
                }
                run.deform(VICTIM, healthy.clone());
                run.tick().assert_same_bits(&whole, &what);
            }
        }
    }
}

/// Finite, but with lengths whose squares are not. The body takes part and does not affect the others.
#[test]
fn a_body_that_explodes_within_the_range_of_f32_harms_no_other() {
    let case = three_bodies();
    for (method, broad_phase) in combinations() {
        let what = format!("{method:?}, {broad_phase:?}");
        let mut run = Run::new(&case, method, broad_phase);
        let whole = run.tick();
        for far in [1.0e6, 1.0e9, 1.0e15, 1.0e20, 1.0e30, f32::MAX] {
            for vertices in [7..8, 0..162] {
                let mut positions = points(&icosphere(2, 0.3));
                positions[vertices].iter_mut().for_each(|position| *position = position.normalize() * far);
                run.deform(VICTIM, positions);
                let found = run.tick();
                between_others(&found).assert_same_bits(&between_others(&whole), &format!("{what}, {far:e}"));
                // Beyond this, not even f64 resolves the contact distance next to the triangle's size.
                if method.is_exact() && far <= 1.0e9 {
                    let verdict = judge(&found, &run.truth());
                    assert_eq!((verdict.missed, verdict.false_pairs), (0, 0), "{what}, {far:e}");
                }
            }
            run.deform(VICTIM, points(&icosphere(2, 0.3)));
            run.tick().assert_same_bits(&whole, &what);
        }
    }
}

#[test]
fn a_teleported_body_is_as_one_that_was_always_there() {
    let sheet = Body::new(&grid(6, 6, 2.0, 2.0, Diagonals::Uniform), THIN);
    let patch = Body::new(&grid(3, 3, 0.5, 0.5, Diagonals::Uniform), THIN);
    let tilt = turned(Vec3::new(1.0, 0.0, 0.3), 0.03);
    let [above, below] = [0.02, -0.02].map(|height| at(0.1, height, 0.2).with_rotation(tilt));
    let far = at(1.0e6, -3.0e5, 7.0e5).with_rotation(tilt);
    for (method, broad_phase) in combinations() {
        let what = format!("{method:?}, {broad_phase:?}");
        let always = |place| {
            let mut run = Run::new(&Case::new([sheet.clone(), patch.clone().at(place)]), method, broad_phase);
            run.tick()
        };
        let mut run = Run::new(&Case::new([sheet.clone(), patch.clone().at(above)]), method, broad_phase);
        let start = run.tick();
        assert!(start.contacts() > 0, "{what}");
        for place in [below, far, below, above, far, above] {
            run.place(1, place);
            run.app.world_mut().entity_mut(run.entities[1]).insert(Teleported);
            run.tick().assert_same_bits(&always(place), &what);
        }
        // The past does matter: without the component, the ball has passed through the sheet.
        run.place(1, below);
        let passed = run.tick();
        if method.is_exact() {
            assert!(always(below).deepest() >= 0.0, "{what}");
            assert!(passed.deepest() < 0.0, "{what}: it has passed through");
        }
    }
    // With a new shape as well, the spheres of the old one must not be used.
    let rod = |twist| circumsphere_support::scenes::twisted_rod(2.0, 0.4, 12, 2, twist);
    for broad_phase in BROAD_PHASES {
        let case = |twist| Case::new([sheet.clone(), Body::new(&rod(twist), THIN).at(at(0.1, 0.2, 0.0))]);
        let fresh = Run::new(&case(1.0), ContactMethod::Circumsphere, broad_phase).tick();
        let mut run = Run::new(&case(0.0), ContactMethod::Circumsphere, broad_phase);
        run.tick();
        run.deform(1, points(&rod(1.0)));
        run.app.world_mut().entity_mut(run.entities[1]).insert(Teleported);
        run.tick().assert_same_bits(&fresh, "deformed on the way");
        assert!(fresh.contacts() > 0);
    }
}

#[test]
fn an_empty_world_has_no_contacts() {
    for (method, broad_phase) in combinations() {
        let mut app = new_app(broad_phase, CircumsphereSettings::default());
        let is_empty = |app: &App| {
            let store = app.world().resource::<ContactStore>();
            store.pairs().is_empty()
        };
        app.update();
        assert!(is_empty(&app));
        // One body that waits for positions, one that is disabled, then nothing again.
        let mesh = icosphere(1, 0.5);
        let surface = || DeformableSurface::from_mesh(&points(&mesh), &mesh.triangles).expect("the mesh is valid");
        let waiting = app.world_mut().spawn((surface().0, method, SelfCollision)).id();
        let disabled = app.world_mut().spawn((surface(), method, SurfaceDisabled)).id();
        app.update();
        assert!(is_empty(&app));
        app.world_mut().despawn(waiting);
        app.world_mut().despawn(disabled);
        app.update();
        assert!(is_empty(&app));
        assert_eq!(app.world().resource::<ContactStore>().tick(), 3);

        // Only the neighbors are left, which the harness compares.
        let found = Run::new(&Case::new([]), method, broad_phase).tick();
        assert!(found.pairs.is_empty());
    }
}

/// Pairs that cross in the plane of the triangle are missed.
const ONE_TRIANGLE: Stated =
    Stated { touching: 175, false_by_balls: 0, missed_by_caps: 24, bodies_missed_by_caps: 0, false_by_caps: 0 };

#[test]
fn a_single_triangle_touches_others_and_never_itself() {
    let corners = [Vec3::new(-0.5, 0.0, -0.4), Vec3::new(0.1, 0.0, 0.6), Vec3::new(0.6, 0.0, -0.3)];
    let mesh = loose_triangles(&[corners]);
    let alone = Body::new(&mesh, THIN).meeting_itself();
    assert_eq!(Case::new([alone.clone()]).judge("alone").refined.touching, 0);
    let mut tally = Tally::default();
    for height in [0.03, 0.0, -0.03, 0.05] {
        for other in [mesh.clone(), icosphere(0, 0.2), icosphere(2, 0.2)] {
            let lift = if other.triangles.len() == 1 { 0.0 } else { 0.2 };
            let place = at(0.05, lift + height, 0.02).with_rotation(turned(Vec3::Y, 0.4));
            tally += Case::new([alone.clone(), Body::new(&other, THIN).at(place)]).judge("two");
        }
    }
    tally.assert_as(ONE_TRIANGLE);
}
