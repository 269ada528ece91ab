//! The pile and its tray.

use std::collections::BTreeSet;

use circumsphere_support::scenes::{
    Mesh, PILE_BODIES, PILE_BODY_REACH, PILE_TRAY_SIZE, RIB_HEIGHT, RIB_TOP, RIB_WIDTH, TRAY_THICKNESS, pile_body,
    pile_start, pile_tray, ribbed_tray, soft_shapes,
};

use super::geometry::{assert_closed, bounds, edge_lengths, length, point, volume, winding};

/// Smallest initial distance between bodies, in meters.
const APART: f64 = 0.005;

#[test]
fn shapes_are_five_closed_bodies_of_a_few_hundred_triangles() {
    for (number, mesh) in soft_shapes().iter().enumerate() {
        assert_closed(mesh, &format!("shape {number}"));
        assert!((150..=350).contains(&mesh.triangles.len()), "shape {number}: {}", mesh.triangles.len());
        let [lowest, highest] = bounds(mesh);
        let longest = (0..3).map(|axis| highest[axis] - lowest[axis]).fold(0.0, f64::max);
        assert!((0.08..0.125).contains(&longest), "shape {number} is {longest} long");
    }
}

#[test]
fn pile_mixes_all_shapes_and_sizes() {
    let bodies: Vec<_> = (0..PILE_BODIES).map(pile_body).collect();
    for (number, mesh) in bodies.iter().enumerate() {
        assert_closed(mesh, &format!("body {number}"));
        let reach = mesh.positions.iter().map(|&position| length(point(position))).fold(0.0, f64::max);
        assert!(reach <= f64::from(PILE_BODY_REACH) + 1e-7, "body {number} reaches {reach}");
        assert_eq!(*mesh, pile_body(number));
    }
    // The filled share of a body's bounding ball identifies its shape, for any size and rotation.
    let filled = |mesh: &Mesh| {
        let reach = mesh.positions.iter().map(|&position| length(point(position))).fold(0.0, f64::max);
        volume(mesh) / reach.powi(3)
    };
    let counts = soft_shapes()
        .map(|shape| bodies.iter().filter(|body| (filled(body) / filled(&shape) - 1.0).abs() < 1e-4).count());
    assert_eq!(counts.iter().sum::<usize>(), PILE_BODIES);
    assert!(counts.iter().all(|&count| count >= 10), "{counts:?}");
    let volumes: BTreeSet<u64> = bodies.iter().map(|mesh| volume(mesh).to_bits()).collect();
    assert!(volumes.len() > 90, "only {} sizes", volumes.len());
}

#[test]
fn pile_starts_without_contact() {
    let boxes: Vec<_> =
        (0..PILE_BODIES).map(|number| bounds(&pile_body(number).translate(pile_start(number)))).collect();
    for (number, first) in boxes.iter().enumerate() {
        for (other, second) in boxes.iter().enumerate().take(number) {
            let gap = (0..3)
                .map(|axis| (first[0][axis] - second[1][axis]).max(second[0][axis] - first[1][axis]))
                .fold(f64::NEG_INFINITY, f64::max);
            assert!(gap > APART, "bodies {other} and {number} are {gap} apart");
        }
        let [lowest, highest] = first;
        assert!(lowest[1] > f64::from(RIB_HEIGHT) + APART, "body {number} starts in the ribs");
        for axis in [0, 2] {
            let wall = 0.5 * f64::from(PILE_TRAY_SIZE[axis]) - APART;
            assert!(lowest[axis] > -wall && highest[axis] < wall, "body {number} starts in a wall");
        }
    }
    let middle = pile_start(17);
    let jittered = (0..PILE_BODIES).filter(|&number| number % 16 == 1 && pile_start(number)[0] != middle[0]).count();
    assert!(jittered >= 5, "layers are directly above each other");
}

/// A box with a cavity, and bars with a trapezoidal section. All faces are planar, so the volume is exact up to the
/// rounding of coordinates.
#[test]
fn tray_is_one_closed_solid_of_its_closed_form() {
    for (size, ribs) in [([0.72, 0.72, 0.3], 4), ([1.0, 0.5, 0.2], 0), ([0.5, 1.1, 0.05], 7)] {
        let [width, depth, height] = size.map(|coordinate: f32| f64::from(coordinate));
        let mesh = ribbed_tray(size[0], size[1], size[2], ribs);
        assert_closed(&mesh, "tray");
        let [thickness, rib_height, rib_width, rib_top] =
            [TRAY_THICKNESS, RIB_HEIGHT, RIB_WIDTH, RIB_TOP].map(f64::from);
        let outer = (width + 2.0 * thickness) * (depth + 2.0 * thickness) * (height + thickness);
        let bars = ribs as f64 * depth * rib_height * 0.5 * (rib_width + rib_top);
        let exact = outer - width * depth * height + bars;
        assert!((volume(&mesh) / exact - 1.0).abs() < 1e-5, "{} for {exact}", volume(&mesh));

        let lengths = edge_lengths(&mesh);
        let longest = lengths.iter().copied().fold(0.0, f64::max);
        let shortest = lengths.iter().copied().fold(f64::INFINITY, f64::min);
        assert!((0.07..0.114).contains(&longest) && shortest > 0.002, "{shortest} to {longest}");
        assert!((500..3_000).contains(&mesh.triangles.len()), "{}", mesh.triangles.len());

        // Filled and empty places, away from the lines of the lattice.
        let is_filled = |x: f64, y: f64, z: f64| winding(&mesh, [x, y, z]) > 0.5;
        let (x, z) = (0.5 * (width + thickness), 0.5 * (depth + thickness));
        for y in [-0.011, 0.023, height - 0.003] {
            assert!(is_filled(x, y, 0.013) && is_filled(-x, y, 0.013), "no wall at {y}");
            assert!(is_filled(0.013, y, z) && is_filled(0.013, y, -z), "no wall at {y}");
            assert!(!is_filled(x + thickness, y, 0.013) && !is_filled(0.013, y, z + thickness));
        }
        assert!(!is_filled(0.013, height + 0.003, 0.013) && !is_filled(0.013, -thickness - 0.003, 0.013));
        for rib in 0..=ribs {
            let rib_middle = width * ((rib + 1) as f64 / (ribs + 1) as f64 - 0.5);
            let floor_middle = rib_middle - 0.5 * width / (ribs + 1) as f64;
            for z in [-0.45 * depth, 0.011, 0.45 * depth] {
                assert!(is_filled(floor_middle, -0.013, z) && !is_filled(floor_middle, 0.003, z));
                if rib < ribs {
                    assert!(is_filled(rib_middle, rib_height - 0.001, z) && !is_filled(rib_middle, 0.021, z));
                    // Just inside and just outside the sloping flank, halfway up.
                    let flank = 0.25 * (rib_width + rib_top);
                    assert!(is_filled(rib_middle + flank - 0.001, 0.01, z));
                    assert!(!is_filled(rib_middle + flank + 0.001, 0.01, z));
                }
            }
        }
    }
    assert_eq!(pile_tray(), ribbed_tray(PILE_TRAY_SIZE[0], PILE_TRAY_SIZE[2], PILE_TRAY_SIZE[1], 4));
}
