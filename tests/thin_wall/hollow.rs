//! Hollow bodies: closed walls, most of them curved in two directions, with sides that are meshed unlike and uneven.

use std::f64::consts::{PI, TAU};

use circumsphere_support::{
    random::Random,
    scenes::{Mesh, cuboid, icosphere, merge, torus},
};
use glam::DVec3;

use super::{find, truth};

/// A mesh with its vertices moved.
fn moved(mut mesh: Mesh, mut to: impl FnMut(DVec3) -> DVec3) -> Mesh {
    for position in &mut mesh.positions {
        *position = to(DVec3::from_array(position.map(f64::from))).as_vec3().to_array();
    }
    mesh
}

fn inside_out(mut mesh: Mesh) -> Mesh {
    mesh.triangles.iter_mut().for_each(|corners| corners.reverse());
    mesh
}

/// Moves every vertex by up to `most` along each axis.
fn rough(mesh: Mesh, most: f64) -> Mesh {
    let mut random = Random::new(3);
    moved(mesh, |point| point + DVec3::from_array([0; 3].map(|_| most * f64::from(random.signed_unit()))))
}

/// A sphere with a wall of about 0.15. Its outside is fine and has a relief, its inside is coarse.
fn sphere(relief: f64) -> Mesh {
    let outside = moved(icosphere(4, 1.0), |point| {
        point * (1.0 + relief * libm::sin(5.0 * point.x) * libm::sin(5.0 * point.y + 1.0))
    });
    merge(&[outside, inside_out(icosphere(3, 0.85).rotate([1.0, 0.3, 0.0], 0.5))])
}

fn ring() -> Mesh {
    merge(&[torus(1.0, 0.4, 96, 48), inside_out(torus(1.0, 0.34, 80, 40).rotate([0.0, 1.0, 0.0], 0.05))])
}

/// Turns a line from the axis to the axis, given as radius and height, around y.
fn turned(line: &[[f64; 2]], parts: usize) -> Mesh {
    let mut mesh = Mesh::default();
    let rows = line.len() - 2;
    mesh.positions.push([0.0, line[0][1] as f32, 0.0]);
    for &[radius, height] in &line[1..=rows] {
        for part in 0..parts {
            let angle = TAU * part as f64 / parts as f64;
            let point = DVec3::new(radius * libm::cos(angle), height, radius * libm::sin(angle));
            mesh.positions.push(point.as_vec3().to_array());
        }
    }
    mesh.positions.push([0.0, line[rows + 1][1] as f32, 0.0]);
    let last = mesh.positions.len() as u32 - 1;
    let vertex = |row: usize, part: usize| (1 + row * parts + part % parts) as u32;
    for part in 0..parts {
        mesh.triangles.push([0, vertex(0, part), vertex(0, part + 1)]);
        for row in 1..rows {
            let [a, b] = [vertex(row - 1, part), vertex(row - 1, part + 1)];
            let [c, d] = [vertex(row, part + 1), vertex(row, part)];
            mesh.triangles.extend([[a, d, c], [a, c, b]]);
        }
        mesh.triangles.push([last, vertex(rows - 1, part + 1), vertex(rows - 1, part)]);
    }
    mesh
}

/// A vase of height 2 with a round bottom and an opening at the top, with a wall of 0.06.
fn vase() -> Mesh {
    let outline = |along: f64, inward: f64| {
        // A quarter of an ellipse, then a waist.
        let fall = 0.5 * PI * along.min(0.4) / 0.4;
        let belly = (0.6 - inward) * libm::sin(fall);
        let waist = 0.15 * libm::sin(PI * (along - 0.4).max(0.0) / 0.6).powi(2);
        let height = if along < 0.4 {
            (0.6 - inward) * (1.0 - libm::cos(fall)) + inward
        } else {
            0.6 + 1.4 * (along - 0.4) / 0.6
        };
        [belly - waist, height]
    };
    let outside = (0..=60).map(|row| outline(f64::from(row) / 60.0, 0.0));
    let inside = (0..=60).rev().map(|row| outline(f64::from(row) / 60.0, 0.06));
    turned(&outside.chain(inside).collect::<Vec<_>>(), 48)
}

/// A hollow box, bent around z.
fn bent_box() -> Mesh {
    let hollow = merge(&[cuboid([2.0, 0.4, 0.6], 16), inside_out(cuboid([1.94, 0.34, 0.54], 16))]);
    moved(hollow, |point| {
        let (angle, radius) = (point.x / 3.0, 3.0 + point.y);
        DVec3::new(radius * libm::sin(angle), radius * libm::cos(angle) - 3.0, point.z)
    })
}

/// Finds the walls. At least 0.95 of all area is replaced by at most half of the triangles, within `most` thicknesses.
fn check(name: &str, mesh: &Mesh, most: f64) {
    let (walls, deviation) = find(mesh);
    let share = walls.abstracted_area / walls.area_before;
    println!(
        "{name}: {share:.4} of the area, {} of {} triangles, {:.4} thicknesses",
        walls.triangles.len(),
        mesh.triangles.len(),
        deviation.over_thickness
    );
    assert!(share >= 0.95, "{name}: {share}, {:?}", walls.left_out);
    assert!(2 * walls.triangles.len() <= mesh.triangles.len(), "{name}: {} triangles", walls.triangles.len());
    assert!(deviation.over_thickness <= most, "{name}: {deviation:?}");
    truth::check(name, mesh, &walls, &deviation);
    truth::probe(name, mesh, &walls, &deviation, 1_000);
}

#[test]
fn hollow_bodies_become_sheets() {
    check("sphere", &sphere(0.0), 0.05);
    check("ring", &ring(), 0.05);
    check("vase", &vase(), 0.05);
}

#[test]
fn relief_on_one_side_is_followed() {
    check("sphere with a relief", &sphere(0.03), 0.05);
}

#[test]
fn rough_walls_become_sheets() {
    // Vertices stray by up to a twentieth of the thickness along each axis, so by up to 0.087 thicknesses. The rest is as
    // for even walls.
    const MOST: f64 = 0.15;
    check("rough sphere", &rough(sphere(0.03), 0.0075), MOST);
    check("rough ring", &rough(ring(), 0.003), MOST);
    check("rough vase", &rough(vase(), 0.003), MOST);
}

#[test]
fn bent_boxes_become_sheets() {
    let (walls, deviation) = find(&bent_box());
    assert!(walls.abstracted_area >= 0.999 * walls.area_before, "{:?}", walls.left_out);
    assert!(deviation.over_thickness <= 0.05, "{deviation:?}");
}

#[test]
fn a_body_that_is_inside_out_has_the_same_walls() {
    for body in [vase(), bent_box()] {
        let [(walls, deviation), (turned, turned_deviation)] = [find(&body), find(&inside_out(body.clone()))];
        assert!(!walls.regions.is_empty() && turned.regions.len() == walls.regions.len());
        assert!((turned.abstracted_area - walls.abstracted_area).abs() <= 1e-3 * walls.area_before);
        assert!((turned_deviation.over_thickness - deviation.over_thickness).abs() <= 0.01);
    }
}
