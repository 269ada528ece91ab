//! Single bodies.

use std::f64::consts::PI;

use circumsphere_support::scenes::{
    Mesh, capsule, closed_target, cloth, cloth_corners, cloth_layers, lobed_ball, needle, organ, rounded_cuboid,
};

use super::geometry::{
    assert_closed, bounds, corners, cross, dot, edge_lengths, edges, length, point, point_segment, subtract, volume,
    winding,
};

/// Coordinates below 1 m are rounded by at most 6e-8 of their value when they are stored.
const ROUNDING: f64 = 1e-7;

/// Asserts that the error of a mesh at two resolutions falls with the square of the edge length.
fn assert_second_order(errors: [f64; 2], what: &str) {
    let ratio = errors[0] / errors[1];
    assert!((3.6..4.4).contains(&ratio), "{what}: errors {errors:?}, ratio {ratio}");
}

#[test]
fn capsule_is_the_capsule_of_its_closed_form() {
    let (radius, half) = (0.03, 0.05);
    let exact = PI * radius * radius * (2.0 * half + 4.0 / 3.0 * radius);
    let missing = [1, 2].map(|fineness| {
        let mesh = capsule(radius as f32, half as f32, 24 * fineness, 12 * fineness, 6 * fineness);
        assert_closed(&mesh, "capsule");
        for &position in &mesh.positions {
            let distance = point_segment(point(position), [[0.0, -half, 0.0], [0.0, half, 0.0]]);
            assert!((distance - radius).abs() < ROUNDING, "a vertex at {distance}");
        }
        let ends = [mesh.positions[0], mesh.positions[mesh.positions.len() - 1]].map(|pole| f64::from(pole[1]));
        assert!((ends[0] - 0.08).abs() < ROUNDING && (ends[1] + 0.08).abs() < ROUNDING);
        exact - volume(&mesh)
    });
    // A polygon of 24 sides lacks 1.1 % of its circle.
    assert!(missing[0] > 0.0 && missing[0] < 0.02 * exact, "{missing:?} of {exact}");
    assert_second_order(missing, "capsule");
}

#[test]
fn capsules_of_any_number_of_segments_are_closed() {
    for around in 3..20 {
        for along in 1..4 {
            for rings in 1..7 {
                assert_closed(&capsule(0.1, 0.1, around, along, rings), &format!("capsule {around} {along} {rings}"));
            }
        }
    }
}

/// Between circles with different numbers of vertices, an edge can become the diagonal of a square cell, √2 times its
/// side.
#[test]
fn capsule_has_nearly_uniform_edges() {
    for mesh in [capsule(0.03, 0.029, 12, 4, 3), capsule(0.01, 0.06, 24, 52, 6)] {
        let lengths = edge_lengths(&mesh);
        let mean = lengths.iter().sum::<f64>() / lengths.len() as f64;
        let shortest = lengths.iter().copied().fold(f64::INFINITY, f64::min);
        let longest = lengths.iter().copied().fold(0.0, f64::max);
        assert!(shortest > 0.7 * mean && longest < 1.5 * mean, "{shortest} to {longest} around {mean}");
    }
}

/// Bands between two regular octagons that are rotated by half a step relative to each other are antiprisms. Their
/// middle section is a regular polygon of 16 sides, and Simpson's rule is exact.
#[test]
fn needle_has_the_volume_of_its_antiprisms_and_its_pyramid() {
    let (long, radius) = (0.2, 0.004);
    let mesh = needle(long as f32, radius as f32);
    assert_closed(&mesh, "needle");
    assert_eq!(mesh.triangles.len(), 96);
    let polygon = |sides: f64, radius: f64| 0.5 * sides * radius * radius * (2.0 * PI / sides).sin();
    let end = polygon(8.0, radius);
    let middle = polygon(16.0, radius * (PI / 16.0).cos());
    let exact = 0.8 * long * (2.0 * end + 4.0 * middle) / 6.0 + 0.2 * long * end / 3.0;
    // Radii of 4 mm are rounded by 3e-8 of their value, which counts twice.
    assert!((volume(&mesh) / exact - 1.0).abs() < 1e-6, "{} for {exact}", volume(&mesh));
    assert_eq!(mesh.positions[mesh.positions.len() - 1], [0.0; 3]);
    let [lowest, highest] = bounds(&mesh);
    assert!(lowest[1] == 0.0 && (highest[1] - long).abs() < ROUNDING);
}

/// Asserts that all triangles face away from the origin and wind around it once, so that a ray from the origin hits one
/// triangle.
fn assert_star_shaped(mesh: &Mesh, name: &str) {
    assert_closed(mesh, name);
    assert!(corners(mesh).all(|[a, b, c]| dot(a, cross(b, c)) > 0.0), "a triangle of {name} faces its center");
    assert!((winding(mesh, [0.0; 3]) - 1.0).abs() < 1e-9, "{name} winds around its center more than once");
}

/// The largest angle between adjacent triangles, and the largest where they are concave, in radians.
fn sharpest(mesh: &Mesh) -> [f64; 2] {
    let all: Vec<_> = corners(mesh).collect();
    let normal = |triangle: usize| {
        let [a, b, c] = all[triangle];
        cross(subtract(b, a), subtract(c, a))
    };
    let middle =
        |triangle: usize| -> [f64; 3] { std::array::from_fn(|axis| all[triangle].map(|a| a[axis]).iter().sum()) };
    let (mut angle, mut hollow) = (0.0_f64, 0.0_f64);
    for [first, second] in edges(mesh).into_values() {
        let (first, second) = (first[0], second[0]);
        let (a, b) = (normal(first), normal(second));
        let between = length(cross(a, b)).atan2(dot(a, b));
        angle = angle.max(between);
        if dot(a, subtract(middle(second), middle(first))) > 0.0 {
            hollow = hollow.max(between);
        }
    }
    [angle, hollow]
}

#[test]
fn organ_is_one_smooth_body_that_does_not_cross_itself() {
    let levels = [2, 3, 4, 5].map(organ);
    for (mesh, triangles) in levels.iter().zip([320, 1280, 5120, 20480]) {
        assert_eq!(mesh.triangles.len(), triangles);
        assert_star_shaped(mesh, "organ");
    }
    let [lowest, highest] = bounds(&levels[2]);
    assert!((0.18..0.22).contains(&(highest[0] - lowest[0])), "{lowest:?} to {highest:?}");
    // On a smooth surface, halved edges halve the angles between triangles, once they resolve its finest feature.
    let angles = [1, 2, 3].map(|level| sharpest(&levels[level]));
    assert!(angles[1][0] < 0.75 * angles[0][0] && angles[2][0] < 0.6 * angles[1][0], "{angles:?}");
    // The cleft: a ball or an ellipsoid has no concave edges.
    assert!(angles[1][1] > 0.05, "{angles:?}");
    let volumes = levels.each_ref().map(volume);
    assert_second_order([volumes[2] - volumes[1], volumes[3] - volumes[2]], "organ");
    assert_eq!(closed_target(), levels[1]);
}

#[test]
fn organ_has_a_cleft_in_front_and_none_on_top() {
    let mesh = organ(5);
    let slab =
        |x: f64| mesh.positions.iter().map(|&position| point(position)).filter(move |at| (at[0] - x).abs() < 0.005);
    let front = |x: f64| slab(x).map(|at| at[2]).fold(f64::NEG_INFINITY, f64::max);
    let top = |x: f64| slab(x).map(|at| at[1]).fold(f64::NEG_INFINITY, f64::max);
    let reaches: Vec<[f64; 2]> = (-6..=6).map(|step| 0.01 * f64::from(step)).map(|x| [front(x), top(x)]).collect();
    let dips =
        |side: usize| reaches.windows(3).filter(|reach| reach[1][side] < reach[0][side].min(reach[2][side])).count();
    assert_eq!([dips(0), dips(1)], [1, 0], "{reaches:?}");
}

#[test]
fn lobed_ball_and_rounded_cuboid_keep_their_measures() {
    let ball = lobed_ball(3, 0.1);
    assert_star_shaped(&ball, "lobed ball");
    for &position in &ball.positions {
        let distance = length(point(position));
        assert!((0.075 - ROUNDING..=0.125 + ROUNDING).contains(&distance), "{distance}");
    }
    let (half, rounding) = ([0.05_f64, 0.03, 0.04], 0.012_f64);
    for subdivisions in 1..8 {
        let mesh = rounded_cuboid(half.map(|extent| extent as f32), rounding as f32, subdivisions);
        assert_star_shaped(&mesh, "rounded cuboid");
        assert_eq!(mesh.triangles.len(), 12 * subdivisions * subdivisions);
        for &position in &mesh.positions {
            let beyond: [f64; 3] =
                std::array::from_fn(|axis| (f64::from(position[axis]).abs() - (half[axis] - rounding)).max(0.0));
            assert!((length(beyond) - rounding).abs() < ROUNDING, "{position:?} is not on the rounded box");
        }
    }
}

#[test]
fn cloths_have_their_edges_and_their_gaps() {
    let (side, edge, gap) = (9, 0.02, 0.006);
    let layers = cloth_layers(4, side, edge as f32, gap as f32);
    assert_eq!(layers.len(), 4);
    assert_eq!(layers[0], cloth(side, edge as f32));
    for (layer, mesh) in layers.iter().enumerate() {
        assert_eq!(mesh.triangles.len(), 2 * 8 * 8);
        assert!(mesh.positions.iter().all(|position| (f64::from(position[1]) - gap * layer as f64).abs() < ROUNDING));
        assert!(corners(mesh).all(|[a, b, c]| cross(subtract(b, a), subtract(c, a))[1] > 0.0));
        for length in edge_lengths(mesh) {
            let straight = (length - edge).abs() < ROUNDING;
            assert!(straight || (length - edge * 2.0_f64.sqrt()).abs() < ROUNDING, "an edge of {length}");
        }
    }
    let reach = 0.5 * edge * 8.0;
    for (corner, [x, z]) in cloth_corners(side).into_iter().zip([[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]]) {
        let at = point(layers[0].positions[corner]);
        assert!(length(subtract(at, [x * reach, 0.0, z * reach])) < ROUNDING);
    }
}
