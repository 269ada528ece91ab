//! The embedded scene: the asset is what the code computes, and it shows what it is intended to show.

use std::collections::BTreeSet;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use circumsphere_support::recording::{Recording, read_recording};
use circumsphere_support::scenes::{
    BALL_CENTER, BALL_RADIUS, BALL_TRIANGLES, BALL_VERTICES, CLOTH_EDGE, CLOTH_SIDE_VERTICES, CLOTH_TRIANGLES,
    CLOTH_VERTICES, FRAMES, TORUS_TRIANGLES, TORUS_VERTICES, cloth_fall_start,
};

static ASSET: LazyLock<Recording> = LazyLock::new(|| {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let path: PathBuf = folder.join("../../assets/cloth_fall.bin");
    read_recording(&[path]).unwrap()
});

type Point = [f64; 3];

fn point(position: [f32; 3]) -> Point {
    position.map(f64::from)
}

fn subtract(a: Point, b: Point) -> Point {
    std::array::from_fn(|axis| a[axis] - b[axis])
}

fn dot(a: Point, b: Point) -> f64 {
    (0..3).map(|axis| a[axis] * b[axis]).sum()
}

fn distance(a: [f32; 3], b: [f32; 3]) -> f64 {
    let between = subtract(point(a), point(b));
    dot(between, between).sqrt()
}

fn cloth(frame: usize) -> &'static [[f32; 3]] {
    &ASSET.frames[frame][CLOTH_VERTICES]
}

fn mean_height(positions: &[[f32; 3]]) -> f32 {
    positions.iter().map(|position| position[1]).sum::<f32>() / positions.len() as f32
}

fn edges(triangles: &[[u32; 3]]) -> Vec<[usize; 2]> {
    let sides = triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
    let edges: BTreeSet<[usize; 2]> = sides.map(|[a, b]| [a.min(b) as usize, a.max(b) as usize]).collect();
    edges.into_iter().collect()
}

/// Without optimizations the whole scene takes half a minute, so only its first third is computed.
#[test]
fn asset_is_what_the_code_makes() {
    let frames = if cfg!(debug_assertions) { 40 } else { FRAMES };
    let made = cloth_fall_start(frames);
    assert_eq!(made.triangles, ASSET.triangles);
    // Compared frame by frame, because a failure of the whole comparison would print thousands of vertices.
    for (frame, positions) in made.frames.iter().enumerate() {
        assert!(*positions == ASSET.frames[frame], "frame {frame} differs");
    }
}

#[test]
fn topology_is_cloth_ball_and_ring() {
    assert_eq!(ASSET.frames.len(), FRAMES);
    let vertices = [CLOTH_VERTICES, BALL_VERTICES, TORUS_VERTICES];
    let triangles = [CLOTH_TRIANGLES, BALL_TRIANGLES, TORUS_TRIANGLES];
    assert_eq!(vertices.clone().map(|range| range.len()), [676, 162, 288]);
    assert_eq!(triangles.clone().map(|range| range.len()), [1250, 320, 576]);
    assert_eq!(ASSET.frames[0].len(), TORUS_VERTICES.end);
    assert_eq!(ASSET.triangles.len(), TORUS_TRIANGLES.end);
    for (vertices, triangles) in vertices.into_iter().zip(triangles) {
        let used: BTreeSet<usize> =
            ASSET.triangles[triangles].iter().flatten().map(|&corner| corner as usize).collect();
        assert!(used.into_iter().eq(vertices));
    }
}

#[test]
fn every_coordinate_is_finite_and_near_the_scene() {
    for position in ASSET.frames.iter().flatten() {
        assert!(position.iter().all(|value| value.is_finite() && value.abs() < 3.0));
        assert!(position[1] > 0.0, "below the floor");
    }
}

#[test]
fn ball_rests_and_ring_deforms() {
    for frame in &ASSET.frames {
        assert_eq!(frame[BALL_VERTICES], ASSET.frames[0][BALL_VERTICES]);
    }
    // A rigid body would keep its edge lengths.
    let edges = edges(&ASSET.triangles[TORUS_TRIANGLES]);
    let change = |frame: usize| {
        let changes = edges.iter().map(|&[a, b]| {
            let [now, first] = [frame, 0].map(|frame: usize| distance(ASSET.frames[frame][a], ASSET.frames[frame][b]));
            (now / first - 1.0).abs()
        });
        changes.fold(0.0, f64::max)
    };
    assert!((10..FRAMES).any(|frame| change(frame) > 0.2));
}

#[test]
fn cloth_falls() {
    assert!(mean_height(cloth(FRAMES - 1)) < mean_height(cloth(0)) - 0.5);
}

#[test]
fn cloth_moves_less_than_an_edge_per_frame() {
    // 5 m/s are 83 mm in a sixtieth of a second. An exploding scene is faster.
    for frame in 1..FRAMES {
        for (now, before) in cloth(frame).iter().zip(cloth(frame - 1)) {
            assert!(distance(*now, *before) < 1.2 * f64::from(CLOTH_EDGE), "frame {frame}");
        }
    }
}

#[test]
fn cloth_stretches_little() {
    let edges = edges(&ASSET.triangles[CLOTH_TRIANGLES]);
    for frame in 0..FRAMES {
        for &[a, b] in &edges {
            let stretch = distance(cloth(frame)[a], cloth(frame)[b]) / distance(cloth(0)[a], cloth(0)[b]);
            assert!(stretch < 1.15, "frame {frame} edge {a} {b}: {stretch}");
        }
    }
}

#[test]
fn cloth_comes_near_itself() {
    let near = |frame: usize| {
        let positions = cloth(frame);
        let mut pairs = 0;
        for a in 0..positions.len() {
            for b in 0..a {
                let (rows, columns) = (
                    (a / CLOTH_SIDE_VERTICES).abs_diff(b / CLOTH_SIDE_VERTICES),
                    (a % CLOTH_SIDE_VERTICES).abs_diff(b % CLOTH_SIDE_VERTICES),
                );
                let is_far_at_rest = rows.max(columns) > 5;
                if is_far_at_rest && distance(positions[a], positions[b]) < 0.6 * f64::from(CLOTH_EDGE) {
                    pairs += 1;
                }
            }
        }
        pairs
    };
    assert_eq!(near(0), 0);
    let frames = [60, 80, 100, FRAMES - 1];
    assert!(frames.into_iter().all(|frame| near(frame) >= 2), "{:?}", frames.map(near));
}

#[test]
fn cloth_touches_ball_and_ring() {
    let edge = f64::from(CLOTH_EDGE);
    let above_ball = |frame: usize| {
        let distances = cloth(frame).iter().map(|position| distance(*position, BALL_CENTER) - f64::from(BALL_RADIUS));
        distances.fold(f64::INFINITY, f64::min)
    };
    assert!((0..FRAMES).all(|frame| above_ball(frame) > 0.0));
    assert!(above_ball(0) > edge);
    // The mesh of the ball is inside the sphere, and the cloth is less than a tenth of an edge outside the mesh.
    assert!((0..FRAMES).filter(|&frame| above_ball(frame) < 0.1 * edge).count() > 80);

    // Vertices of the torus are about an edge apart, so cloth on the torus is within that distance of some of them.
    let above_ring = |frame: usize| {
        let ring = &ASSET.frames[frame][TORUS_VERTICES];
        let near = |position: &[f32; 3]| ring.iter().any(|other| distance(*position, *other) < edge);
        cloth(frame).iter().filter(|position| near(position)).count()
    };
    assert_eq!(above_ring(0), 0);
    assert!(above_ring(60) > 20 && above_ring(FRAMES - 1) > 20);
}

/// Whether the segment crosses the triangle, by the signs of volumes.
fn crosses([from, to]: [Point; 2], [a, b, c]: [Point; 3]) -> bool {
    let volume = |p: Point, q: Point, r: Point, s: Point| {
        let (q, r, s) = (subtract(q, p), subtract(r, p), subtract(s, p));
        q[0] * (r[1] * s[2] - r[2] * s[1]) + q[1] * (r[2] * s[0] - r[0] * s[2]) + q[2] * (r[0] * s[1] - r[1] * s[0])
    };
    let sides = [volume(from, a, b, c) > 0.0, volume(to, a, b, c) > 0.0];
    let around = [(a, b), (b, c), (c, a)].map(|(start, end)| volume(from, to, start, end) > 0.0);
    sides[0] != sides[1] && around[0] == around[1] && around[1] == around[2]
}

/// Number of crossings between an edge and a triangle without common vertices.
fn crossings(positions: &[[f32; 3]], edges: &[[usize; 2]], triangles: Range<usize>) -> usize {
    let mut count = 0;
    for triangle in &ASSET.triangles[triangles] {
        let corners = triangle.map(|corner| corner as usize);
        let points = corners.map(|corner| point(positions[corner]));
        let bound = |pick: fn(f64, f64) -> f64| -> Point {
            std::array::from_fn(|axis| pick(pick(points[0][axis], points[1][axis]), points[2][axis]))
        };
        let (low, high) = (bound(f64::min), bound(f64::max));
        for edge in edges {
            let ends = edge.map(|end| point(positions[end]));
            let is_apart = (0..3).any(|axis| {
                ends[0][axis].max(ends[1][axis]) < low[axis] || ends[0][axis].min(ends[1][axis]) > high[axis]
            });
            if !is_apart && !edge.iter().any(|end| corners.contains(end)) && crosses(ends, points) {
                count += 1;
            }
        }
    }
    count
}

#[test]
fn nothing_crosses_anything() {
    let cloth = edges(&ASSET.triangles[CLOTH_TRIANGLES]);
    let obstacles = edges(&ASSET.triangles[BALL_TRIANGLES.start..TORUS_TRIANGLES.end]);
    // All frames if the code is optimized. Otherwise the check would take longer than all other tests together.
    let step = if cfg!(debug_assertions) { 8 } else { 1 };
    for frame in (0..FRAMES).step_by(step) {
        let positions = &ASSET.frames[frame];
        assert_eq!(crossings(positions, &cloth, 0..TORUS_TRIANGLES.end), 0, "frame {frame}");
        assert_eq!(crossings(positions, &obstacles, CLOTH_TRIANGLES), 0, "frame {frame}");
    }

    // Check that crossings are detected: the last cloth, moved to the center of the ball.
    let mut moved = ASSET.frames[FRAMES - 1].clone();
    for position in &mut moved[CLOTH_VERTICES] {
        position[1] -= BALL_RADIUS;
    }
    assert!(crossings(&moved, &cloth, BALL_TRIANGLES) > 10);
    // And the cloth with its first row swapped with its middle row.
    let mut swapped = ASSET.frames[FRAMES - 1].clone();
    for column in 0..CLOTH_SIDE_VERTICES {
        swapped.swap(column, CLOTH_SIDE_VERTICES * CLOTH_SIDE_VERTICES / 2 + column);
    }
    let found = crossings(&swapped, &cloth, CLOTH_TRIANGLES);
    assert!(found > 10, "{found}");
}
