//! Checks the properties that bodies of moving scenes claim, in every tick.

use std::collections::HashMap;

use circumsphere_support::scenes::{
    Fineness, MOVING_SCENES, MovingScene, beam_on_mattress, growing_sheets, moving_scene,
};

const CLOTH_FALL: &[u8] = include_bytes!("../../../assets/cloth_fall.bin");

fn scene(name: &str, fineness: Fineness, ticks: usize) -> MovingScene {
    moving_scene(name, fineness, ticks, CLOTH_FALL).expect("the asset is a recording").expect("the scene exists")
}

/// How often each directed edge occurs.
fn directed_edges(triangles: &[[u32; 3]]) -> HashMap<[u32; 2], usize> {
    let mut edges = HashMap::new();
    for [a, b, c] in triangles {
        for edge in [[*a, *b], [*b, *c], [*c, *a]] {
            *edges.entry(edge).or_default() += 1;
        }
    }
    edges
}

/// Six times the volume that the triangles enclose, positive if they face outward.
fn volume(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> f64 {
    triangles
        .iter()
        .map(|corners| {
            let [a, b, c] = corners.map(|corner| positions[corner as usize].map(f64::from));
            a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0])
        })
        .sum()
}

#[test]
fn closed_bodies_are_closed_and_face_outward_at_every_tick() {
    let mut closed = 0;
    for name in MOVING_SCENES {
        for fineness in [Fineness::Coarse, Fineness::Middle, Fineness::Fine] {
            let scene = scene(name, fineness, 5);
            assert_eq!(scene.name, name);
            for (number, body) in scene.bodies.iter().enumerate() {
                assert_eq!(body.ticks.len(), 5, "{name} body {number}");
                let finite = body.ticks.iter().flatten().flatten().all(|coordinate| coordinate.is_finite());
                assert!(finite, "{name} body {number} has positions that are not finite");
                let edges = directed_edges(&body.triangles);
                let is_closed = edges.iter().all(|(&[a, b], &count)| count == 1 && edges.get(&[b, a]) == Some(&1));
                assert_eq!(is_closed, body.is_closed, "{name} body {number}, {fineness:?}");
                for positions in body.ticks.iter().filter(|_| is_closed) {
                    assert!(volume(positions, &body.triangles) > 0.0, "{name} body {number} is inside out");
                    closed += 1;
                }
            }
        }
    }
    assert!(closed > 200, "only {closed} closed bodies were checked");
}

#[test]
fn finer_scenes_have_more_triangles_up_to_twenty_thousand() {
    for name in MOVING_SCENES {
        let count = |fineness| scene(name, fineness, 1).bodies.iter().map(|body| body.triangles.len()).sum::<usize>();
        let counts = [Fineness::Coarse, Fineness::Middle, Fineness::Fine].map(count);
        // The embedded recording has only one resolution.
        assert!(counts.is_sorted_by(|a, b| a < b) || name == "cloth_over_ball", "{name}: {counts:?}");
        assert!((1_000..=20_000).contains(&counts[2]), "{name}: {counts:?}");
    }
}

#[test]
fn scenes_say_whether_they_deform() {
    for name in MOVING_SCENES {
        let scene = scene(name, Fineness::Coarse, 3);
        let mut change = 0.0_f64;
        for body in &scene.bodies {
            for [a, b, _] in &body.triangles {
                let length = |tick: usize| {
                    let (from, to) = (body.ticks[tick][*a as usize], body.ticks[tick][*b as usize]);
                    (0..3).map(|axis| f64::from(to[axis] - from[axis]).powi(2)).sum::<f64>().sqrt()
                };
                if length(0) > 0.0 {
                    change = change.max((length(2) / length(0) - 1.0).abs());
                }
            }
        }
        // Rigid motion changes edges by no more than the rounding of positions with coordinates of up to 200.
        assert_eq!(change > 1.0e-3, scene.deforms, "{name}: edges change by {change}");
    }
}

#[test]
fn the_motion_is_the_same_however_finely_it_is_cut() {
    for name in MOVING_SCENES.into_iter().filter(|name| *name != "cloth_over_ball") {
        let (coarse, fine) = (scene(name, Fineness::Coarse, 3), scene(name, Fineness::Coarse, 5));
        for (a, b) in coarse.bodies.iter().zip(&fine.bodies) {
            assert!(a.ticks[1] == b.ticks[2] && a.ticks[2] == b.ticks[4], "{name}");
        }
    }
}

#[test]
fn growing_sheets_have_about_the_triangles_asked_for() {
    for triangles in [1_000, 3_000, 10_000, 100_000] {
        let scene = growing_sheets(triangles, 1);
        let count: usize = scene.bodies.iter().map(|body| body.triangles.len()).sum();
        assert!(count.abs_diff(triangles) * 20 < triangles, "{count} instead of {triangles}");
    }
}

#[test]
fn there_is_no_scene_of_another_name() {
    assert!(moving_scene("no_such_scene", Fineness::Coarse, 1, CLOTH_FALL).expect("nothing is read").is_none());
    assert!(moving_scene("cloth_over_ball", Fineness::Coarse, 1, b"no recording").is_err());
}

#[test]
fn a_beam_sinks_edge_first_into_the_crest_of_a_mattress_of_even_triangles() {
    for cells in [1, 16] {
        let scene = beam_on_mattress(cells, 7);
        let [mattress, beam] = &scene.bodies[..] else { panic!("{} bodies", scene.bodies.len()) };
        assert_eq!([mattress.triangles.len(), beam.triangles.len()], [448, 8 * cells + 4]);
        // The sheet does not move, and its edges have length 0.1. On an arch with radius 10, the steepest edges rise by
        // 14 % of their run, which makes them 1 % longer.
        assert!(mattress.ticks.iter().all(|positions| *positions == mattress.ticks[0]));
        let at = |corner: u32| mattress.ticks[0][corner as usize].map(f64::from);
        let length = |a: u32, b: u32| (0..3).map(|axis| (at(a)[axis] - at(b)[axis]).powi(2)).sum::<f64>().sqrt();
        for [a, b] in directed_edges(&mattress.triangles).into_keys() {
            assert!((0.1 - 1.0e-6..0.1011).contains(&length(a, b)), "an edge is {} long", length(a, b));
        }
        // The lowest edge of the beam is level and above the crest at x = 2.5.
        for (tick, positions) in beam.ticks.iter().enumerate() {
            assert!(volume(positions, &beam.triangles) > 0.0, "the beam is inside out");
            let edges = directed_edges(&beam.triangles);
            assert!(edges.iter().all(|(&[a, b], &count)| count == 1 && edges.get(&[b, a]) == Some(&1)));
            let height = 0.08 - 0.12 * tick as f32 / 6.0;
            let low: Vec<_> = positions.iter().filter(|position| (position[1] - height).abs() < 1.0e-6).collect();
            assert_eq!(low.len(), cells + 1, "tick {tick}");
            assert!(positions.iter().all(|position| position[1] > height - 1.0e-6));
            let reach = |end: f32| low.iter().any(|position| position[0] == end);
            assert!(reach(-4.0) && reach(4.0));
        }
    }
}
