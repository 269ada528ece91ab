//! The character with one skin over two bones, and its skirt.

use circumsphere_support::scenes::{
    CHARACTER_CIRCLE, CHARACTER_EASE, CHARACTER_LEG, CHARACTER_SPEEDS, CHARACTER_TIP_SPEED, CHARACTER_TORSO,
    CHARACTER_WAIST_GAP, Character, CharacterFineness, Mesh, character_skirt, character_waist_vertices,
};

use super::geometry::{
    Point, assert_closed, corners, cross, dot, edges, length, point, point_triangle, subtract, volume, winding,
};

/// Coordinates up to 16 m are rounded by a micrometer.
const ROUNDING: f64 = 2e-6;

const FINENESSES: [CharacterFineness; 2] = [CharacterFineness::Coarse, CharacterFineness::Fine];

fn at(character: &Character, time: f64) -> Mesh {
    Mesh { positions: character.positions(time), triangles: character.rest().triangles.clone() }
}

fn unit_normals(mesh: &Mesh) -> Vec<Point> {
    let normal = |[a, b, c]: [Point; 3]| cross(subtract(b, a), subtract(c, a));
    corners(mesh).map(normal).map(|normal| normal.map(|coordinate| coordinate / length(normal))).collect()
}

/// Distance of a point from a surface.
fn distance(mesh: &Mesh, point: Point) -> f64 {
    corners(mesh).map(|triangle| point_triangle(point, triangle)).fold(f64::INFINITY, f64::min)
}

#[test]
fn characters_have_the_vertices_they_are_said_to_have() {
    let counts = FINENESSES.map(|fineness| Character::new(fineness, 0.0).rest().positions.len());
    assert_eq!(counts, [684, 1024]);
}

#[test]
fn a_character_is_closed_faces_outward_and_never_folds() {
    for fineness in FINENESSES {
        for speed in CHARACTER_SPEEDS {
            let character = Character::new(fineness, speed);
            let standing = volume(character.rest());
            for step in 0..40 {
                let mesh = at(&character, 0.087 * f64::from(step));
                assert_closed(&mesh, "the character");
                let share = volume(&mesh) / standing;
                // Linear blending loses volume at the inner side of a bend. The total volume is nearly constant.
                assert!((0.9..1.05).contains(&share), "{speed} m/s, step {step}: {share}");
                let normals = unit_normals(&mesh);
                for [up, down] in edges(&mesh).values() {
                    let bend = dot(normals[up[0]], normals[down[0]]);
                    assert!(bend > 0.0, "{speed} m/s, step {step}: two triangles fold over");
                }
            }
        }
    }
}

#[test]
fn a_character_stands_at_first_and_moves_no_faster_than_it_is_said_to() {
    const TICK: f64 = 1e-3;
    for speed in CHARACTER_SPEEDS {
        let character = Character::new(CharacterFineness::Coarse, speed);
        assert_eq!(character.positions(0.0), character.rest().positions);
        assert_eq!(character.positions(-1.0), character.rest().positions);
        let (mut fastest_tip, mut farthest) = (0.0_f64, 0.0_f64);
        let tip = character.rest().positions.len() - 1;
        let waist = [[0.0, 0.0, 0.0], [0.13, 0.0, 0.0]];
        let mut last = (character.positions(0.0), character.follow_torso(0.0, &waist));
        for tick in 1..3000 {
            let time = f64::from(tick) * TICK;
            let now = (character.positions(time), character.follow_torso(time, &waist));
            let ways = |now: &[[f32; 3]], last: &[[f32; 3]]| -> Vec<f64> {
                now.iter().zip(last).map(|(&now, &last)| length(subtract(point(now), point(last))) / TICK).collect()
            };
            let waist_speed = ways(&now.1, &last.1)[0];
            // The bob adds at most 0.015 · 2 π · 2 f, plus a little while it grows.
            assert!(waist_speed < speed + 0.8, "the waist moves at {waist_speed} m/s instead of {speed}");
            let speeds = ways(&now.0, &last.0);
            farthest = speeds.iter().fold(farthest, |most, &speed| most.max(speed));
            fastest_tip = fastest_tip.max(speeds[tip]);
            last = now;
        }
        // The tip also moves with the body, and is farther out on the circle than the waist.
        assert!(farthest < 1.1 * speed + CHARACTER_TIP_SPEED + 3.0, "{farthest} m/s at {speed}");
        assert!(
            fastest_tip > speed + 0.5 * CHARACTER_TIP_SPEED.min(1.5 + 0.85 * speed),
            "{fastest_tip} m/s at {speed}"
        );
    }
    let [[x, y, z]] = *Character::new(CharacterFineness::Coarse, 5.0).follow_torso(3.0, &[[0.0; 3]]) else { panic!() };
    let angle = 5.0 * (3.0 - 0.5 * CHARACTER_EASE) / CHARACTER_CIRCLE;
    let expected = [CHARACTER_CIRCLE * (1.0 - angle.cos()), y.into(), CHARACTER_CIRCLE * angle.sin()];
    assert!(length(subtract(point([x, y, z]), expected)) < ROUNDING);
}

#[test]
fn the_waist_of_a_skirt_keeps_its_gap_to_the_skin_at_all_times() {
    for fineness in FINENESSES {
        for (rings, segments) in [(10, 24), (16, 40)] {
            let skirt = character_skirt(rings, segments);
            let rest = Character::new(fineness, 0.0).rest().clone();
            for &position in &skirt.positions {
                let clearance = distance(&rest, point(position));
                assert!(clearance > CHARACTER_WAIST_GAP - ROUNDING, "{clearance} m at {position:?}");
                assert!(winding(&rest, point(position)).abs() < 0.5);
            }
            // The other direction covers edges: vertices of the skin keep their distance from the faces of the skirt.
            for &position in &rest.positions {
                let clearance = distance(&skirt, point(position));
                assert!(clearance > CHARACTER_WAIST_GAP - ROUNDING, "{clearance} m at {position:?}");
            }
            let waist = &skirt.positions[character_waist_vertices(segments)];
            for speed in CHARACTER_SPEEDS {
                let character = Character::new(fineness, speed);
                for step in 0..30 {
                    let time = 0.113 * f64::from(step);
                    let mesh = at(&character, time);
                    for &pin in &character.follow_torso(time, waist) {
                        let clearance = distance(&mesh, point(pin));
                        assert!(clearance > 0.9 * CHARACTER_WAIST_GAP, "{clearance} m at {time} s and {speed} m/s");
                        assert!(winding(&mesh, point(pin)).abs() < 0.5);
                    }
                }
            }
        }
    }
}

#[test]
fn poses_are_those_of_the_skin() {
    let turned = |(translation, [x, y, z, w]): ([f32; 3], [f32; 4]), at: Point| {
        let axis = point([x, y, z]);
        let twice = cross(axis, at).map(|coordinate| 2.0 * coordinate);
        let turned = cross(axis, twice);
        std::array::from_fn(|i| at[i] + f64::from(w) * twice[i] + turned[i] + f64::from(translation[i]))
    };
    for speed in CHARACTER_SPEEDS {
        let character = Character::new(CharacterFineness::Coarse, speed);
        let rest = &character.rest().positions;
        for step in 0..20 {
            let time = 0.21 * f64::from(step);
            let now = character.positions(time);
            let (top, tip) = (0, rest.len() - 1);
            let upper = turned(character.torso_pose(time), point(rest[top]));
            assert!(length(subtract(upper, point(now[top]))) < 4.0 * ROUNDING);
            // The hip is 0.2 m below the waist.
            let lower = turned(character.leg_pose(time), subtract(point(rest[tip]), [0.0, -0.2, 0.0]));
            assert!(length(subtract(lower, point(now[tip]))) < 4.0 * ROUNDING);
        }
    }
    let rest = Character::new(CharacterFineness::Fine, 0.0).rest().clone();
    for ((low, high, radius), origin) in [(CHARACTER_TORSO, 0.0), (CHARACTER_LEG, -0.2)] {
        for center in [low, high] {
            let center = [f64::from(center[0]), f64::from(center[1]) + origin, f64::from(center[2])];
            assert!(winding(&rest, center).abs() > 0.5 && distance(&rest, center) > f64::from(radius));
        }
    }
}
