//! What must hold from tick to tick: rest, sliding, stale spheres, and noise at thresholds.

use std::collections::{BTreeSet, VecDeque};

use bevy_circumsphere::{Circumspheres, detection::DetectionDiagnostics, prelude::*};
use circumsphere_support::scenes::{Diagonals, cuboid, grid, icosphere, twisted_rod};
use glam::Vec3;

use crate::harness::{
    Body, BroadPhase, Case, EventCounts, Found, Random, Run, Stated, Tally, at, combinations, loose_triangles, points,
    tick_all, turned,
};

const THIN: f32 = 0.05;

/// The share of two sets that is not common to both, from 0 to 1.
fn churn<T: Ord>(one: &BTreeSet<T>, other: &BTreeSet<T>) -> f64 {
    let union = one.union(other).count();
    if union == 0 { 0.0 } else { 1.0 - one.intersection(other).count() as f64 / union as f64 }
}

/// Points with each coordinate moved by up to `units` units in the last place.
fn trembling(points: &[Vec3], units: u32, random: &mut Random) -> Vec<Vec3> {
    let mut tremble = |coordinate: f32| {
        let step = random.below(2 * units as usize + 1) as u32;
        if coordinate == 0.0 { coordinate } else { f32::from_bits(coordinate.to_bits() + step - units) }
    };
    points.iter().map(|point| Vec3::new(tremble(point.x), tremble(point.y), tremble(point.z))).collect()
}

const RESTING_TICKS: usize = 10_000;

/// The noise repeats bit by bit after this number of ticks.
const NOISE_PERIOD: usize = 125;

/// Churn of the touching pairs from tick to tick, by method. Each pair lies on the threshold, and noise decides like a
/// coin toss. (Two fair tosses are both heads in a quarter and both tails in a quarter of cases: a churn of 2/3.)
const RESTING_CHURNS: [f64; 5] = [0.377, 0.469, 0.541, 0.541, 0.541];

/// Churn of the reported contacts when the margin keeps them from the threshold. Rounding decides between features that
/// are equally near.
const RESTING_CHURN_WITH_MARGIN: f64 = 0.0;

struct Rest {
    events: EventCounts,
    churn: f64,
    contact_churn: f64,
}

/// A box held above a sheet at exactly the contact distance, give or take a few units in the last place.
fn rest(method: ContactMethod, broad_phase: BroadPhase, margin: f32) -> Rest {
    let sheet = Body::new(&grid(2, 2, 1.0, 1.0, Diagonals::Uniform), THIN);
    let block = Body::new(&cuboid([0.2; 3], 1).translate([0.03, 0.3, 0.01]), THIN);
    let lowest = block.positions.iter().map(|point| point.y).fold(f32::INFINITY, f32::min);
    let contact_distance = THIN + THIN;
    // Placed exactly on the threshold.
    let held: Vec<Vec3> = block.positions.iter().map(|point| *point + Vec3::Y * (contact_distance - lowest)).collect();
    let settled: Vec<Vec3> =
        held.iter().map(|point| if point.y < 0.2 { point.with_y(contact_distance) } else { *point }).collect();
    let mut case = Case::new([sheet, block]).with_neighbors_at(at(0.9, 0.0, 0.9));
    case.settings.margin = margin;
    let mut random = Random::new(9);
    let noise: Vec<Vec<Vec3>> = (0..NOISE_PERIOD).map(|_| trembling(&settled, 4, &mut random)).collect();

    let mut run = Run::new(&case, method, broad_phase);
    run.app.world_mut().entity_mut(run.entities[0]).insert(ContactEventsEnabled);
    let mut period: VecDeque<Found> = VecDeque::new();
    let (mut churned, mut contacts_churned) = (0.0, 0.0);
    for tick in 0..RESTING_TICKS {
        let positions = &noise[tick % NOISE_PERIOD];
        run.deform(1, positions.clone());
        let found = run.tick();
        if method.is_exact() && found.contacts() > 0 {
            // The deepest contact has the distance of the lowest vertex, because the sheet lies in the plane y = 0.
            let lowest = positions.iter().map(|point| point.y).fold(f32::INFINITY, f32::min);
            assert!((found.deepest() - lowest).abs() <= f32::EPSILON * lowest, "{} over {lowest}", found.deepest());
        }
        if let Some(last) = period.back() {
            churned += churn(&found.touching_set(), &last.touching_set());
            contacts_churned += churn(&found.contact_keys(), &last.contact_keys());
        }
        if period.len() == NOISE_PERIOD {
            let before = period.pop_front().expect("the period is full");
            found.assert_same_bits(&before, "contacts drift: a repeated state gives different ones");
        }
        period.push_back(found);
    }
    let steps = (RESTING_TICKS - 1) as f64;
    Rest { events: run.events(), churn: churned / steps, contact_churn: contacts_churned / steps }
}

#[test]
fn resting_for_ten_thousand_ticks_neither_drifts_nor_ends() {
    for (method, broad_phase) in combinations() {
        let Rest { events, churn, contact_churn } = rest(method, broad_phase, 0.0);
        println!("{method:?}, {broad_phase:?}: {events:?}, churn {churn}, of contacts {contact_churn}");
        assert_eq!(events, EventCounts { started: 1, ended: 0 }, "{method:?}, {broad_phase:?}");
        let most =
            RESTING_CHURNS[ContactMethod::ALL.iter().position(|&other| other == method).expect("it is one of them")];
        assert!(churn <= most, "{method:?}: churn {churn}");
    }
}

#[test]
fn a_margin_keeps_resting_contacts_from_the_threshold() {
    let Rest { events, contact_churn, .. } = rest(ContactMethod::Exact, BroadPhase::Tree, 0.01);
    assert_eq!(events, EventCounts { started: 1, ended: 0 });
    assert!(contact_churn <= RESTING_CHURN_WITH_MARGIN, "churn {contact_churn}");
}

/// Triangles near the ball's lowest point. Those beside it are at an angle and missed. Large caps beside it are false.
const SLIDING: Stated = Stated {
    touching: 17_745,
    false_by_balls: 19_973,
    missed_by_caps: 0,
    bodies_missed_by_caps: 0,
    false_by_caps: 5246,
};

/// How much the deepest distance changes while the ball stays at one height, by method. Spheres appear and disappear
/// below it. Inner edges must not affect the exact methods at all, apart from the rounding of positions near the ball's
/// height.
const SLIDING_SWINGS: [f32; 4] = [0.034, 4.0 * f32::EPSILON, 4.0 * f32::EPSILON, 4.0 * f32::EPSILON];

#[test]
fn a_ball_that_slides_over_inner_edges_neither_loses_contact_nor_height() {
    const STEP: f32 = 0.004;
    let sheet = Body::new(&grid(8, 8, 2.0, 2.0, Diagonals::Alternating), THIN);
    let case = Case::new([sheet, Body::new(&icosphere(2, 0.5), THIN)]).with_neighbors_at(at(1.3, 0.0, 0.9));
    let mut runs = case.runs();
    let mut tally = Tally::default();
    let mut ranges = [(f32::INFINITY, f32::NEG_INFINITY); 4];
    for tick in 0..150 {
        // Across cells, diagonals, and vertices, with the lowest vertex at half the contact distance.
        let way = STEP * (tick as f32 - 75.0);
        for run in &mut runs {
            run.place(1, at(way, 0.55, 0.61 * way + 0.003));
        }
        let (judged, found) = tick_all(&mut runs, &format!("tick {tick}"));
        tally += judged;
        for ((found, range), method) in found.iter().zip(&mut ranges).zip(ContactMethod::ALL) {
            assert!(found.touching() > 0 && found.contacts() > 0, "{method:?} lost contact in tick {tick}");
            *range = (range.0.min(found.deepest()), range.1.max(found.deepest()));
        }
    }
    println!("ranges {ranges:?}");
    for (((low, high), most), method) in ranges.into_iter().zip(SLIDING_SWINGS).zip(ContactMethod::ALL) {
        assert!(high - low <= most, "{method:?}: the deepest distance is from {low} to {high}");
        assert!(!method.is_exact() || (low - 0.05).abs() < 4.0 * f32::EPSILON, "{method:?}: {low}");
    }
    tally.assert_as(SLIDING);
}

/// Spheres of a rod that was twisted by up to 15 radians in one tick. Below that, almost none of them are refreshed.
const STALE: Stated =
    Stated { touching: 1773, false_by_balls: 9316, missed_by_caps: 126, bodies_missed_by_caps: 0, false_by_caps: 3654 };

/// The same with every sphere made anew. The difference is the cost of staleness.
const REFRESHED: Stated =
    Stated { touching: 1773, false_by_balls: 9316, missed_by_caps: 188, bodies_missed_by_caps: 0, false_by_caps: 3547 };

#[test]
fn stale_spheres_contain_their_triangles_after_a_sudden_twist() {
    let rod = |twist: f32| twisted_rod(2.0, 0.4, 24, 3, twist);
    let case = Case::new([
        Body::new(&rod(0.0), 0.02).meeting_itself(),
        Body::new(&icosphere(2, 0.3), 0.02).at(at(0.47, 0.0, 0.1)),
    ]);
    assert!((case.settings.refit_threshold - 0.7).abs() < 1.0e-6);
    let mut fresh_case = case.clone();
    fresh_case.settings.refit_threshold = 0.0;
    let (mut tally, mut fresh) = (Tally::default(), Tally::default());
    let mut stale = 0;
    for twist in [0.5, 2.0, 6.0, 15.0] {
        let mut runs = case.runs();
        tick_all(&mut runs, "straight");
        for run in &mut runs {
            run.deform(0, points(&rod(twist)));
        }
        tally += tick_all(&mut runs, &format!("twisted by {twist}")).0;
        let mut fresh_runs = fresh_case.runs();
        tick_all(&mut fresh_runs, "straight");
        for run in &mut fresh_runs {
            run.deform(0, points(&rod(twist)));
        }
        fresh += tick_all(&mut fresh_runs, &format!("twisted by {twist}, refreshed")).0;
        for run in runs.iter().filter(|run| run.method == ContactMethod::Circumsphere) {
            let refreshed = run.app.world().resource::<DetectionDiagnostics>().recipes_refreshed;
            println!("twist {twist}: {refreshed} of {} refreshed", run.bodies[0].triangles.len());
            stale += run.bodies[0].triangles.len() - refreshed;
            assert_spheres_contain_triangles(run, 0, twist);
        }
    }
    assert!(stale > 1000, "only {stale} spheres are stale");
    tally.assert_as(STALE);
    fresh.assert_as(REFRESHED);
}

/// To the last bit, because radii are enlarged by more than rounding.
fn assert_spheres_contain_triangles(run: &Run, body: usize, twist: f32) {
    let spheres = &run.app.world().get::<Circumspheres>(run.entities[body]).expect("a surface has spheres");
    let body = &run.bodies[body];
    for (triangle, corners) in body.triangles.iter().enumerate() {
        let (center, radius) = (spheres.centers[triangle].as_dvec3(), f64::from(spheres.radii[triangle]));
        for &corner in corners {
            let distance = body.positions[corner as usize].as_dvec3().distance(center);
            assert!(distance <= radius, "twist {twist}: triangle {triangle} is outside by {:e}", distance - radius);
        }
    }
}

/// How often in a thousand ticks of noise `Circumsphere` changes its result for a pair at the boundary of a cone.
const CONE_FLIPS: usize = 351;

/// The start and end events during that time: one for each change, because hysteresis applies to distances, not
/// directions.
const CONE_EVENTS: usize = 351;

/// A triangle standing on its corner above a horizontal one, tilted by `angle` from parallel.
fn leaning(angle: f32) -> [Body; 2] {
    let triangle = |turn: glam::Quat| {
        let corners = [Vec3::new(0.5, 0.0, -0.3), Vec3::new(-0.5, 0.0, -0.3), Vec3::new(0.02, 0.0, 0.57)];
        corners.map(|corner| turn * corner)
    };
    let lying = triangle(turned(Vec3::Z, std::f64::consts::PI));
    let mut steep = triangle(turned(Vec3::X, f64::from(angle)));
    let lowest = steep.iter().map(|corner| corner.y).fold(f32::INFINITY, f32::min);
    for corner in &mut steep {
        corner.y += 0.05 - lowest;
    }
    [lying, steep].map(|corners| Body::new(&loose_triangles(&[corners]), THIN))
}

#[test]
fn noise_at_the_boundary_of_a_cone_makes_circumsphere_flicker_and_no_other_method() {
    let far = at(3.0, 0.0, 0.0);
    // The cone test of the source paper. Widened cones contain every direction in which the rim of a single triangle is
    // met.
    let settings =
        CircumsphereSettings { sphere_offset: 1.0, widen_cones: false, plane_cull: false, ..Default::default() };
    let touches = |angle: f32| {
        let case = Case::new(leaning(angle)).with_settings(settings).with_neighbors_at(far);
        Run::new(&case, ContactMethod::Circumsphere, BroadPhase::Tree).tick().touching() > 0
    };
    let (mut inside, mut outside) = (0.0_f32, 1.5_f32);
    assert!(touches(inside) && !touches(outside), "the cone rejects a triangle that leans too far");
    while f32::from_bits(inside.to_bits() + 1) < outside {
        let middle = 0.5 * (inside + outside);
        if touches(middle) { inside = middle } else { outside = middle }
    }
    println!("boundary at {inside}");

    let case = Case::new(leaning(inside)).with_settings(settings).with_neighbors_at(far);
    let steady = case.bodies[1].positions.clone();
    let mut runs = case.runs();
    for run in &mut runs {
        run.app.world_mut().entity_mut(run.entities[0]).insert(ContactEventsEnabled);
    }
    let mut random = Random::new(10);
    let mut flips = vec![0; ContactMethod::ALL.len()];
    let mut last = vec![None; ContactMethod::ALL.len()];
    let mut tally = Tally::default();
    for tick in 0..1000 {
        let positions = trembling(&steady, 4, &mut random);
        for run in &mut runs {
            run.deform(1, positions.clone());
        }
        let (judged, found) = tick_all(&mut runs, &format!("tick {tick}"));
        tally += judged;
        for (place, found) in found.iter().enumerate() {
            let touching = found.touching() > 0;
            flips[place] += usize::from(last[place].is_some_and(|before| before != touching));
            last[place] = Some(touching);
        }
    }
    assert_eq!(tally.refined.touching, 1000, "the pair touches all the time");
    println!("flips {flips:?}, missed by caps {}", tally.caps.missed);
    for run in &runs {
        let EventCounts { started, ended } = run.events();
        println!("{:?}: {started} started, {ended} ended", run.method);
        if run.method == ContactMethod::Circumsphere {
            assert!(started + ended <= CONE_EVENTS, "{started} starts, {ended} ends");
        } else {
            assert_eq!((started, ended), (1, 0), "{:?}", run.method);
        }
    }
    assert!(flips[1] > 0, "the case is at the boundary");
    assert!(flips[0] == 0 && flips[1] <= CONE_FLIPS && flips[2..].iter().all(|&flips| flips == 0), "{flips:?}");
}
