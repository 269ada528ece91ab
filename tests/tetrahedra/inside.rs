//! One point and one tetrahedron.

use bevy_circumsphere::kernel::tetrahedra::inside::{barycentric_inside, signed_volume};
use circumsphere_support::random::Random;
use glam::DVec3;

use crate::exact::{Grid, Whole, below, parts_inside, volume};

const UNIT: [DVec3; 4] = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];

#[test]
fn weights_in_the_unit_tetrahedron_are_the_coordinates() {
    for point in [[0.25, 0.25, 0.25], [0.5, 0.125, 0.25], [0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.5, 0.0, 0.5]] {
        let [x, y, z] = point;
        let expected = [1.0 - x - y - z, x, y, z];
        assert_eq!(barycentric_inside(&UNIT, DVec3::from_array(point)), Some(expected));
        let [a, b, c, d] = UNIT;
        let [other_a, other_b, other_c, other_d] = expected;
        let turned = barycentric_inside(&[a, c, b, d], DVec3::from_array(point));
        assert_eq!(turned, Some([other_a, other_c, other_b, other_d]), "the other winding");
    }
    for point in [[-f64::MIN_POSITIVE, 0.1, 0.1], [0.5, 0.5, f64::EPSILON], [1.0, 1.0, 1.0], [f64::NAN, 0.0, 0.0]] {
        assert_eq!(barycentric_inside(&UNIT, DVec3::from_array(point)), None, "{point:?}");
    }
    assert_eq!(signed_volume(&UNIT), 1.0, "six times the volume, positive if wound like the axes");
}

#[test]
fn a_tetrahedron_without_volume_contains_nothing() {
    let flat = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::new(0.5, 0.5, 0.0)];
    let needle = [DVec3::ZERO, DVec3::X, 2.0 * DVec3::X, 3.0 * DVec3::X];
    for corners in [flat, needle, [DVec3::ONE; 4]] {
        assert_eq!(signed_volume(&corners), 0.0);
        for point in [corners[0], corners[1], DVec3::new(0.25, 0.25, 0.0)] {
            assert_eq!(barycentric_inside(&corners, point), None);
        }
    }
}

/// Compares random tetrahedra and points with integers. Returns how many points were inside, and how many of these on a
/// face.
fn compare(grid: Grid, corners: impl Fn(&mut Random) -> [Whole; 4], rounds: usize) -> [usize; 2] {
    let mut random = Random::new(30);
    let mut counts = [0; 2];
    for round in 0..rounds {
        let corners = corners(&mut random);
        // Half of the points are near a corner or a point of an edge, where the decision is hard.
        let point = match round % 4 {
            0 | 1 => grid.random(&mut random),
            2 => corners[round / 4 % 4].map(|coordinate| coordinate + below(&mut random, 3) - 1),
            _ => [0, 1, 2].map(|axis: usize| (corners[0][axis] + corners[1][axis]).div_euclid(2)),
        };
        let own = barycentric_inside(&corners.map(|corner| grid.exact_point(corner)), grid.exact_point(point));
        let truth = parts_inside(corners, point);
        assert_eq!(own.is_some(), truth.is_some(), "{corners:?} {point:?}");
        let (Some(own), Some(truth)) = (own, truth) else { continue };
        counts[0] += 1;
        counts[1] += usize::from(truth.contains(&0));
        let whole = volume(corners).unsigned_abs() as f64;
        for (own, truth) in own.into_iter().zip(truth) {
            assert_eq!(own == 0.0, truth == 0);
            assert!(own >= 0.0);
            // A determinant of differences of 24 bits rounds by some 2^-50 of its largest terms, which are as large as
            // the box of the tetrahedron.
            let slack = 1.0e-14 * grid_volume(&corners) / whole;
            assert!((own - truth as f64 / whole).abs() <= 1.0e-12 + slack, "{own} {truth} {whole}");
        }
    }
    counts
}

fn grid_volume(corners: &[Whole; 4]) -> f64 {
    let side = |axis: usize| {
        let along = corners.map(|corner| corner[axis]);
        (along.iter().max().expect("four") - along.iter().min().expect("four")) as f64
    };
    [0, 1, 2].map(side).into_iter().fold(0.0, f64::max).powi(3)
}

#[test]
fn random_tetrahedra_agree_with_integers() {
    let coarse = compare(Grid::COARSE, |random| [(); 4].map(|()| Grid::COARSE.random(random)), 200_000);
    assert!(coarse[0] > 5_000 && coarse[1] > 2_000, "{coarse:?} points inside and on faces");
    let fine = compare(Grid::FINE, |random| [(); 4].map(|()| Grid::FINE.random(random)), 200_000);
    assert!(fine[0] > 5_000, "{fine:?} points inside and on faces");
}

#[test]
fn slivers_agree_with_integers() {
    // Nearly flat: the fourth corner is within a unit of the plane of the others. The point is too, half of the time.
    let grid = Grid::FINE;
    let mut random = Random::new(31);
    let (mut inside, mut outside, mut flat) = (0, 0, 0);
    for round in 0..200_000 {
        let mut plane = || {
            let [x, y, _] = grid.random(&mut random);
            [x / 4, y / 4, (x + y) / 8]
        };
        let (mut corners, mut point) = ([plane(), plane(), plane(), plane()], plane());
        corners[3][2] += below(&mut random, 3) - 1;
        if round % 2 == 0 {
            // Close to the middle of three corners.
            point = [0, 1, 2].map(|axis: usize| (corners[0][axis] + corners[1][axis] + corners[3][axis]).div_euclid(3));
        }
        let truth = parts_inside(corners, point);
        let own = barycentric_inside(&corners.map(|corner| grid.exact_point(corner)), grid.exact_point(point));
        assert_eq!(own.is_some(), truth.is_some(), "{corners:?} {point:?}");
        flat += usize::from(volume(corners) == 0);
        *if truth.is_some() { &mut inside } else { &mut outside } += 1;
    }
    assert!(inside > 1_000 && outside > 1_000, "{inside} inside, {outside} outside, {flat} flat");
}
