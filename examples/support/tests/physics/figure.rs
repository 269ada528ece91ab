//! The walking figure and its skirt.

use circumsphere_support::scenes::{
    FIGURE_EASE, FIGURE_HEIGHT, FIGURE_LIMBS, FIGURE_STEP, Mesh, SKIRT_HEM, SKIRT_WAIST, pelvis_offset, skirt,
    skirt_waist_vertices, walking_figure,
};

use super::geometry::{
    Point, assert_closed, bounds, centroid, corners, cross, dot, edge_lengths, edges, length, point, point_triangle,
    subtract, winding,
};

fn limb<'a>(figure: &'a [Mesh], name: &str) -> &'a Mesh {
    &figure[FIGURE_LIMBS.iter().position(|&limb| limb == name).unwrap()]
}

/// The lower end of a limb's surface, which is the last vertex of its capsule.
fn lower_end(figure: &[Mesh], name: &str) -> Point {
    point(*limb(figure, name).positions.last().unwrap())
}

#[test]
fn figure_stands_at_first_and_is_as_high_as_a_person() {
    let standing = walking_figure(0.0);
    assert_eq!(standing.len(), FIGURE_LIMBS.len());
    assert_eq!(walking_figure(-3.0), standing);
    let all = standing.iter().map(bounds);
    let [low, high] =
        all.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], limb| [low.min(limb[0][1]), high.max(limb[1][1])]);
    assert!((high - low - FIGURE_HEIGHT).abs() < 1e-6, "{low} to {high}");
    for (name, mesh) in FIGURE_LIMBS.iter().zip(&standing) {
        let Some(other) = name.strip_prefix("left_") else { continue };
        let [x, y, z] = centroid(mesh);
        let mirrored = centroid(limb(&standing, &format!("right_{other}")));
        assert!(x > 0.05 && length(subtract(mirrored, [-x, y, z])) < 1e-6, "{name} is not mirrored");
    }
}

#[test]
fn limbs_are_closed_and_rigid_at_every_time() {
    let standing = walking_figure(0.0);
    let triangles: usize = standing.iter().map(|mesh| mesh.triangles.len()).sum();
    assert!((2_000..4_000).contains(&triangles), "{triangles} triangles");
    for time in [0.0, 0.3, 0.9, 1.7, 2.6, 31.4] {
        for ((name, mesh), rest) in FIGURE_LIMBS.iter().zip(&walking_figure(time)).zip(&standing) {
            assert_closed(mesh, name);
            assert_eq!(mesh.triangles, rest.triangles, "{name} at {time} s");
            for (now, then) in edge_lengths(mesh).into_iter().zip(edge_lengths(rest)) {
                // Coordinates below 1 m are rounded by 6e-8 m.
                assert!((now - then).abs() < 5e-7, "an edge of the {name} changed from {then} to {now}");
            }
        }
    }
}

#[test]
fn limbs_hold_together_and_legs_do_not_cross() {
    let nearest = |first: &Mesh, second: &Mesh| {
        let at = first.positions.iter().flat_map(|&a| second.positions.iter().map(move |&b| [point(a), point(b)]));
        at.map(|[a, b]| length(subtract(a, b))).fold(f64::INFINITY, f64::min)
    };
    for step in 0..30 {
        let time = 0.13 * f64::from(step);
        let figure = walking_figure(time);
        let at = |name: &str| limb(&figure, name);
        for side in ["left", "right"] {
            let of = |name: &str| format!("{side}_{name}");
            for [upper, lower] in [["thigh", "shin"], ["upper_arm", "forearm"]] {
                // The first vertex of a capsule is the pole above its upper joint. It is inside the limb that ends at
                // that joint.
                let joint = point(at(&of(lower)).positions[0]);
                let inside = winding(at(&of(upper)), joint);
                assert!(inside > 0.5, "{side} {upper} and {lower} have come apart at {time} s");
            }
            assert!(winding(at("pelvis"), point(at(&of("thigh")).positions[0])) > 0.5, "a {side} thigh has come off");
            assert!(nearest(at(&of("upper_arm")), at("trunk")) > 0.02, "the {side} arm is in the trunk");
        }
        for left in ["left_thigh", "left_shin"] {
            for right in ["right_thigh", "right_shin"] {
                assert!(nearest(at(left), at(right)) > 0.03, "{left} collides with {right} at {time} s");
            }
        }
    }
}

#[test]
fn figure_takes_a_step_a_second_and_both_sides_walk_alike() {
    for step in 0..20 {
        let time = FIGURE_EASE + 0.17 * f64::from(step);
        let (now, later, stride) =
            (walking_figure(time), walking_figure(time + FIGURE_STEP), walking_figure(time + 2.0 * FIGURE_STEP));
        for (number, name) in FIGURE_LIMBS.iter().enumerate() {
            assert!(length(subtract(centroid(&now[number]), centroid(&stride[number]))) < 1e-6, "{name}");
            let Some(other) = name.strip_prefix("left_") else { continue };
            let [x, y, z] = centroid(&now[number]);
            let mirrored = centroid(limb(&later, &format!("right_{other}")));
            assert!(length(subtract(mirrored, [-x, y, z])) < 1e-6, "{name} after a step");
        }
    }
    // Ten seconds are ten steps: each foot passes the other one five times.
    let lead: Vec<f64> = (0..1000)
        .map(|tick| walking_figure(2.0 + 0.01 * f64::from(tick)))
        .map(|figure| lower_end(&figure, "left_shin")[2] - lower_end(&figure, "right_shin")[2])
        .collect();
    let overtakes = lead.windows(2).filter(|pair| pair[0] < 0.0 && pair[1] >= 0.0).count();
    let longest = lead.iter().copied().fold(0.0, f64::max);
    assert_eq!(overtakes, 5);
    assert!((0.4..0.9).contains(&longest), "a step of {longest} m");
}

#[test]
fn knees_bend_backwards_only_and_the_pelvis_stays() {
    for tick in 0..60 {
        let time = 0.07 * f64::from(tick);
        let figure = walking_figure(time);
        for side in ["left", "right"] {
            let axis = |name: &str| {
                let mesh = limb(&figure, &format!("{side}_{name}"));
                subtract(point(mesh.positions[0]), point(*mesh.positions.last().unwrap()))
            };
            // A shin that bends backwards relative to its thigh rotates about x, from y towards z.
            let (thigh, shin) = (axis("thigh"), axis("shin"));
            let bend = cross(thigh, shin)[0].atan2(dot(thigh, shin));
            assert!((-1e-6..1.0).contains(&bend), "the {side} knee bends by {bend} at {time} s");
            assert!(limb(&figure, &format!("{side}_shin")).positions.iter().all(|position| position[1] > -0.93));
        }
        let offset = point(pelvis_offset(time));
        assert!(length(offset) < 0.02);
        assert!(length(subtract(centroid(limb(&figure, "pelvis")), offset)) < 1e-6);
    }
}

/// A leg of 0.9 m that swings by 0.42 rad and bends by 0.7 rad once in two seconds moves at most at (0.42 + 0.7) · π ·
/// 0.9 m/s, and accelerates at most at π times that. The ease-in adds its own rate of 1.875 / s.
#[test]
fn figure_moves_without_a_jump_of_place_or_speed() {
    const TICK: f64 = 1e-3;
    let speed = (0.42 + 0.7) * 0.9 * (std::f64::consts::PI + 1.875);
    let acceleration = speed * 2.0 * std::f64::consts::PI;
    // Coordinates below 1 m are rounded by 6e-8 m.
    let noise = 5e-7;
    for name in ["left_shin", "right_thigh", "right_forearm", "pelvis"] {
        let places: Vec<Point> =
            (-100..3200).map(|tick| lower_end(&walking_figure(f64::from(tick) * TICK), name)).collect();
        for around in places.windows(3) {
            let [before, after] = [subtract(around[1], around[0]), subtract(around[2], around[1])];
            assert!(length(before) < speed * TICK + noise, "{name}: {before:?} in a tick");
            assert!(length(subtract(after, before)) < acceleration * TICK * TICK + noise, "{name} jumps");
        }
    }
}

#[test]
fn skirt_is_one_cone_from_waist_to_knees() {
    for (rings, segments) in [(24, 64), (1, 3), (17, 33)] {
        let mesh = skirt(rings, segments);
        assert_eq!(mesh.triangles.len(), 2 * rings * segments);
        assert_eq!(mesh.positions.len(), (rings + 1) * segments);
        let edges = edges(&mesh);
        assert!(edges.values().all(|[up, down]| up.len() <= 1 && down.len() <= 1));
        let border: Vec<usize> = edges
            .iter()
            .filter(|(_, [up, down])| up.is_empty() || down.is_empty())
            .flat_map(|(ends, _)| ends.map(|end| end as usize))
            .collect();
        let hem = rings * segments..(rings + 1) * segments;
        let waist = skirt_waist_vertices(segments);
        assert_eq!(border.len(), 4 * segments);
        assert!(border.iter().all(|vertex| waist.contains(vertex) || hem.contains(vertex)));
        for (vertex, position) in mesh.positions.iter().enumerate() {
            let y = f64::from(position[1]);
            assert!((SKIRT_HEM - 1e-7..=SKIRT_WAIST + 1e-7).contains(&y));
            assert_eq!(waist.contains(&vertex), (y - SKIRT_WAIST).abs() < 1e-6);
        }
        for [a, b, c] in corners(&mesh) {
            let middle: Point = std::array::from_fn(|axis| a[axis] + b[axis] + c[axis]);
            assert!(dot(cross(subtract(b, a), subtract(c, a)), [middle[0], 0.0, middle[2]]) > 0.0, "faces inwards");
        }
    }
}

/// Distances are sampled at vertices, at the middles of edges, and at centroids.
#[test]
fn skirt_starts_clear_of_the_figure() {
    let mesh = skirt(24, 64);
    assert!((2_000..=4_000).contains(&mesh.triangles.len()));
    let mut samples: Vec<Point> = mesh.positions.iter().map(|&position| point(position)).collect();
    for [a, b, c] in corners(&mesh) {
        samples.push(std::array::from_fn(|axis| (a[axis] + b[axis] + c[axis]) / 3.0));
        // Samples inner edges twice, which is harmless.
        samples.extend([[a, b], [b, c], [c, a]].map(|[a, b]| std::array::from_fn(|axis| 0.5 * (a[axis] + b[axis]))));
    }
    let longest = edge_lengths(&mesh).into_iter().fold(0.0, f64::max);
    // The middles of edges split a triangle into four of half the size. No point is farther from their corners than
    // their circumradius, which for acute triangles is at most 1/√3 of the longest edge.
    let is_acute = |[a, b, c]: [Point; 3]| {
        [[a, b, c], [b, c, a], [c, a, b]].iter().all(|&[a, b, c]| dot(subtract(b, a), subtract(c, a)) > 0.0)
    };
    assert!(corners(&mesh).all(is_acute));
    let unseen = 0.5 * longest / 3.0_f64.sqrt();
    let figure = walking_figure(0.0);
    for (name, limb) in FIGURE_LIMBS.iter().zip(&figure) {
        let triangles: Vec<[Point; 3]> = corners(limb).collect();
        let nearest = samples
            .iter()
            .flat_map(|&sample| triangles.iter().map(move |&triangle| point_triangle(sample, triangle)))
            .fold(f64::INFINITY, f64::min);
        assert!(nearest - unseen > 0.01, "the {name} is {nearest} from the skirt, within {unseen}");
        assert!(nearest > 0.025, "the {name} is {nearest} from the skirt");
    }
}

/// The rest shape is in the way of the legs. Otherwise nothing would touch the skirt in the scene.
#[test]
fn walking_legs_reach_through_the_skirt_at_rest() {
    let mesh = skirt(24, 64);
    let profile = |y: f64| {
        let row = ((SKIRT_WAIST - y) / (SKIRT_WAIST - SKIRT_HEM) * 24.0).round() as usize;
        let row = &mesh.positions[row * 64..(row + 1) * 64];
        [0, 2].map(|axis| row.iter().map(|position| f64::from(position[axis])).fold(0.0, f64::max))
    };
    let reaches_through = |time: f64| {
        let figure = walking_figure(time);
        let thighs = ["left_thigh", "right_thigh"].map(|name| limb(&figure, name));
        thighs.iter().flat_map(|thigh| &thigh.positions).map(|&position| point(position)).any(|[x, y, z]| {
            let [width, depth] = profile(y.clamp(SKIRT_HEM, SKIRT_WAIST));
            (SKIRT_HEM..SKIRT_WAIST).contains(&y) && (x / width).hypot(z / depth) > 1.0
        })
    };
    assert!(!reaches_through(0.0));
    let times = (0..20).map(|step| FIGURE_EASE + 0.1 * f64::from(step));
    assert!(times.filter(|&time| reaches_through(time)).count() >= 4);
}
