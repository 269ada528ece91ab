//! The scene of the walk-through as readers run it: the program's table against the f64 reference, and why the method
//! misses.

use std::{
    collections::BTreeSet,
    process::{Command, Output},
};

use bevy_app::prelude::*;
use bevy_circumsphere::{Circumspheres, TriangleCones, prelude::*};
use circumsphere_support::{
    programs::example_program,
    scenes::{MovingScene, beam_on_mattress},
};
use circumsphere_truth::{ReferencePair, touching_pairs_between_brute_force};
use glam::{DVec3, Vec3};

const TICKS: usize = 60;

/// The tick that the walk-through discusses. The beam's edge is in the mattress.
const NAMED_TICK: usize = 45;

/// The program's output for one tick.
struct Row {
    sunk: f64,
    touching: usize,
    found: usize,
    missed: usize,
    false_pairs: usize,
    dropped: String,
}

fn program(arguments: &[&str]) -> Output {
    Command::new(example_program("missed_edge")).args(arguments).output().expect("the program starts")
}

fn play(arguments: &[&str]) -> Vec<Row> {
    let output = program(arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    let table = String::from_utf8(output.stdout).expect("the table is text");
    let rows = table.lines().filter_map(|line| {
        let mut words = line.split_whitespace();
        let _tick: usize = words.next()?.parse().ok()?;
        let sunk = words.next()?.parse().ok()?;
        let [touching, found, missed, false_pairs] = [(); 4].map(|()| words.next().map(str::parse));
        let number = |cell: Option<Result<usize, _>>| cell.expect("the row is complete").expect("the cell is a number");
        Some(Row {
            sunk,
            touching: number(touching),
            found: number(found),
            missed: number(missed),
            false_pairs: number(false_pairs),
            dropped: words.collect::<Vec<_>>().join(" "),
        })
    });
    let rows: Vec<Row> = rows.collect();
    assert_eq!(rows.len(), TICKS, "{table}");
    for row in &rows {
        assert_eq!(row.found + row.missed, row.touching);
    }
    rows
}

fn positions(scene: &MovingScene, body: usize, tick: usize) -> Vec<DVec3> {
    scene.bodies[body].ticks[tick].iter().map(|&position| Vec3::from_array(position).as_dvec3()).collect()
}

/// The contact distance of the program: twice the thickness of its bodies.
fn contact_distance() -> f64 {
    2.0 * f64::from(0.01_f32)
}

/// Relative to the contact distance: within this band, rounding may decide either way.
const BAND: f64 = 1.0e-4;

/// The pairs of a triangle of the mattress and one of the beam within the contact distance times `factor`.
fn truth(scene: &MovingScene, tick: usize, factor: f64) -> Vec<ReferencePair> {
    let [mattress, beam] = [0, 1].map(|body| (positions(scene, body, tick), &scene.bodies[body].triangles));
    touching_pairs_between_brute_force(&mattress.0, mattress.1, &beam.0, beam.1, contact_distance() * factor)
}

#[test]
fn circumsphere_with_its_default_settings_misses_the_whole_edge_at_the_cone() {
    let scene = beam_on_mattress(1, TICKS);
    let rows = play(&[]);
    let (mut touched, mut decided) = (0, 0);
    for (tick, row) in rows.iter().enumerate() {
        let [least, most] = [1.0 - BAND, 1.0 + BAND].map(|factor| truth(&scene, tick, factor).len());
        assert!((least..=most).contains(&row.touching), "tick {tick}: {} for {least} to {most}", row.touching);
        decided += usize::from(least == most);
        assert_eq!(row.found, 0, "tick {tick}");
        let all_by_the_cone = if row.missed > 0 { format!("cone {}", row.missed) } else { String::new() };
        assert_eq!(row.dropped, all_by_the_cone, "tick {tick}");
        touched += usize::from(row.touching > 0);
    }
    assert!((20..TICKS).contains(&touched), "they touch in {touched} ticks");
    assert!(decided > TICKS - 5, "in {} ticks, a pair is at the contact distance", TICKS - decided);

    // The edge's height is linear in time, from 0.08 above the crest to 0.04 below. The program prints 4 digits, and
    // the crest lies between vertices, less than 1e-4 above them.
    let expected = -0.08 + 0.12 * NAMED_TICK as f64 / (TICKS - 1) as f64;
    assert!((rows[NAMED_TICK].sunk - expected).abs() < 2.0e-4, "{} instead of {expected}", rows[NAMED_TICK].sunk);
    assert!(rows[NAMED_TICK].sunk > 0.01 && rows[NAMED_TICK].touching > 100);
    // Only the edge touches: triangles that contain it, or one of its parts.
    let beam = positions(&scene, 1, NAMED_TICK);
    let lowest = beam.iter().map(|position| position.y).fold(f64::INFINITY, f64::min);
    let at_edge = |triangle: u32| {
        let corners = scene.bodies[1].triangles[triangle as usize];
        corners.iter().filter(|&&corner| beam[corner as usize].y < lowest + 1.0e-6).count()
    };
    let pairs = truth(&scene, NAMED_TICK, 1.0);
    assert!(pairs.iter().any(|pair| pair.distance == 0.0), "nothing crosses");
    assert!(pairs.iter().all(|pair| at_edge(pair.triangle_b) >= 1), "only the edge may touch");
    let along_edge: BTreeSet<u32> =
        pairs.iter().map(|pair| pair.triangle_b).filter(|&triangle| at_edge(triangle) == 2).collect();
    assert_eq!(along_edge.len(), 2, "the edge has a face on either side");
}

/// The reason: seen from the mattress, the center of the beam's sphere is too far to the side for its cones.
#[test]
fn the_line_to_the_center_of_a_long_triangle_leaves_the_cones_of_short_ones() {
    let scene = beam_on_mattress(1, TICKS);
    let mut app = App::new();
    app.add_plugins(DeformableCollisionPlugins::new(Update));
    let entities = [0, 1].map(|body| {
        let at = |tick: usize| -> Vec<Vec3> {
            scene.bodies[body].ticks[tick].iter().copied().map(Vec3::from_array).collect()
        };
        let (surface, _) = DeformableSurface::from_mesh(&at(0), &scene.bodies[body].triangles).expect("it is valid");
        let placed = SurfacePositions(at(NAMED_TICK));
        let touching = (ContactMethod::Circumsphere, SurfaceThickness::World(0.01));
        app.world_mut().spawn((surface, placed, touching)).id()
    });
    app.update();
    let [mattress, beam] = entities.map(|entity| {
        let entity = app.world().entity(entity);
        (
            &**entity.get::<Circumspheres>().expect("it has spheres"),
            &**entity.get::<TriangleCones>().expect("it has cones"),
        )
    });
    let (mut least_excess, mut angles, mut cones) = (f64::INFINITY, Vec::new(), Vec::new());
    for pair in truth(&scene, NAMED_TICK, 1.0) {
        let (a, b) = (pair.triangle_a as usize, pair.triangle_b as usize);
        // A long face's sphere is centered in its middle, four units from both ends.
        if beam.0.radii[b] > 1.0 {
            // Half the diagonal of 8 by 0.2. Rounding of the center: 4 units in the last place of 8.
            let (radius, center) = (f64::from(beam.0.radii[b]), beam.0.centers[b]);
            assert!((radius - 16.01_f64.sqrt()).abs() < 4.0e-6 && center.x.abs() < 4.0e-6, "{radius}, {center}");
        }
        // A sheet has a cap on each side. The one on the side of the beam's center counts.
        let up = mattress.1.axes[a].as_dvec3();
        let height = f64::from(mattress.0.heights[a]);
        let in_plane = mattress.0.centers[a].as_dvec3() + up * height;
        let center = beam.0.centers[b].as_dvec3();
        let axis = if (center - in_plane).dot(up) >= 0.0 { up } else { -up };
        let line = (center - (in_plane - axis * height)).normalize();
        let angle = line.dot(axis).clamp(-1.0, 1.0).acos().to_degrees();
        let cone = f64::from(mattress.1.cosines[a]).acos().to_degrees();
        least_excess = least_excess.min(angle - cone);
        angles.push(angle);
        cones.push(cone);
        // The beam's own cones contain every direction, because its edges are sharp.
        assert_eq!(beam.1.cosines[b], -1.0);
    }
    let span = |values: &[f64]| {
        (values.iter().copied().fold(f64::INFINITY, f64::min), values.iter().copied().fold(0.0, f64::max))
    };
    println!("lines at {:?}°, cones of {:?}°, least excess {least_excess}°", span(&angles), span(&cones));
    assert!(angles.len() > 100 && least_excess > 0.0, "{} pairs, least excess {least_excess}", angles.len());
}

#[test]
fn exact_methods_a_shorter_beam_and_flat_spheres_find_the_edge_and_narrow_cones_do_not() {
    for (arguments, shares, is_exact) in [
        (&["--method", "exact"][..], 1.0..=1.0, true),
        (&["--method", "closest"], 1.0..=1.0, true),
        (&["--method", "polygon"], 1.0..=1.0, true),
        (&["--method", "bounding-sphere"], 1.0..=1.0, false),
        (&["--sphere-offset", "0.25"], 1.0..=1.0, false),
        (&["--beam-cells", "16"], 1.0..=1.0, false),
        (&["--beam-cells", "4"], 0.3..=0.6, false),
        (&["--widen-cones", "false", "--plane-cull", "false", "--sphere-offset", "1"], 0.0..=0.0, true),
    ] {
        let rows = play(arguments);
        let total = |count: fn(&Row) -> usize| rows.iter().map(count).sum::<usize>();
        let (touching, found) = (total(|row| row.touching), total(|row| row.found));
        assert!(touching > 2_000, "{arguments:?}: {touching}");
        let share = found as f64 / touching as f64;
        assert!(shares.contains(&share), "{arguments:?}: {found} of {touching}");
        assert_eq!(total(|row| row.false_pairs) == 0, is_exact, "{arguments:?}");
    }
}

#[test]
fn what_makes_no_sense_is_refused() {
    for arguments in [
        &["--method", "circumspheres"][..],
        &["--beam-cells", "0"],
        &["--ticks", "0"],
        &["--widen-cones", "perhaps"],
        &["--sphere-offset"],
    ] {
        let output = program(arguments);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {message}");
        assert!(message.contains(arguments[0]) && !message.contains("panicked"), "{arguments:?}: {message}");
    }
}
