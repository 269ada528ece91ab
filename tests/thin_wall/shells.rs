//! Curved walls whose middle surface has a closed form, with rims of several shapes, and meshed badly.

use std::{
    collections::BTreeMap,
    f64::consts::{FRAC_PI_2, PI, TAU},
};

use bevy_circumsphere::geometry::thin_wall::ThinWalls;
use circumsphere_support::{
    random::Random,
    scenes::{Mesh, Panel, cuboid, icosphere, merge, panel},
};
use glam::{DVec2, DVec3, Vec3};

use super::{find, sheet};

/// The shape of a rim: how many parts it has, and how far it bulges, in half-thicknesses. A bulge of 1 is a semicircle.
type Rim = (usize, f64);

const SQUARE: Rim = (1, 0.0);
const CHAMFERED: Rim = (3, 0.6);
const ROUNDED: Rim = (6, 1.0);

/// A wall around a middle surface over the unit square, as a closed solid wound outward.
struct Shell<'a> {
    cells: [usize; 2],
    middle: &'a dyn Fn(DVec2) -> DVec3,
    thickness: &'a dyn Fn(DVec2) -> f64,
    /// Whether it closes to a ring along the first coordinate.
    is_ring: bool,
    hole: &'a dyn Fn(DVec2) -> bool,
    rim: Rim,
    /// How far vertices within each side stray, in cells, with a random diagonal in each cell.
    jitter: f64,
}

impl Shell<'_> {
    fn normal(&self, at: DVec2) -> DVec3 {
        const STEP: f64 = 1e-4;
        let along = |step: DVec2| (self.middle)(at + step) - (self.middle)(at - step);
        along(DVec2::X * STEP).cross(along(DVec2::Y * STEP)).normalize()
    }

    fn mesh(&self) -> Mesh {
        let [columns, rows] = self.cells;
        let mut random = Random::new(11);
        let size = DVec2::new(columns as f64, rows as f64);
        let is_filled = |column: usize, row: usize| {
            let column = if self.is_ring { column % columns } else { column };
            column < columns && row < rows && !(self.hole)(DVec2::new(column as f64 + 0.5, row as f64 + 0.5) / size)
        };
        // Counter-clockwise around each cell: its corners, and the cell beyond the edge that starts there.
        let before = |place: usize| if self.is_ring { place + columns - 1 } else { place.wrapping_sub(1) };
        let edges = |column: usize, row: usize| {
            [
                ([column, row], [column, row.wrapping_sub(1)]),
                ([column + 1, row], [column + 1, row]),
                ([column + 1, row + 1], [column, row + 1]),
                ([column, row + 1], [before(column), row]),
            ]
        };
        let key = |[column, row]: [usize; 2]| [if self.is_ring { column % columns } else { column }, row];
        let uv = |[column, row]: [usize; 2]| DVec2::new(column as f64, row as f64) / size;
        let cells: Vec<[usize; 2]> = (0..columns)
            .flat_map(|column| (0..rows).map(move |row| [column, row]))
            .filter(|&[column, row]| is_filled(column, row))
            .collect();
        // Border edges, and the way outward at their vertices.
        let mut outward: BTreeMap<[usize; 2], DVec3> = BTreeMap::new();
        let mut borders = Vec::new();
        for &[column, row] in &cells {
            let around = edges(column, row);
            for (place, &(from, beyond)) in around.iter().enumerate() {
                if !is_filled(beyond[0], beyond[1]) {
                    let to = around[(place + 1) % 4].0;
                    let along = (self.middle)(uv(to)) - (self.middle)(uv(from));
                    let way = along.cross(self.normal(uv(from).midpoint(uv(to)))).normalize();
                    for end in [from, to] {
                        *outward.entry(key(end)).or_default() += way;
                    }
                    borders.push([key(from), key(to)]);
                }
            }
        }
        let mut mesh = Mesh::default();
        let mut names = BTreeMap::new();
        let mut strays = random.clone();
        let mut vertex = |mesh: &mut Mesh, place: [usize; 2], level: usize| {
            *names.entry((place, level)).or_insert_with(|| {
                let out = outward.get(&place).map_or(DVec3::ZERO, |way| way.normalize());
                let stray = if outward.contains_key(&place) { 0.0 } else { self.jitter };
                let at = uv(place)
                    + DVec2::new(f64::from(strays.signed_unit()), f64::from(strays.signed_unit())) * stray / size;
                let angle = PI * (level as f64 / self.rim.0 as f64 - 0.5);
                let half = 0.5 * (self.thickness)(at);
                let position = (self.middle)(at)
                    + self.normal(at) * (half * libm::sin(angle))
                    + out * (half * self.rim.1 * libm::cos(angle));
                mesh.positions.push(position.as_vec3().to_array());
                mesh.positions.len() as u32 - 1
            })
        };
        let mut quad = |mesh: &mut Mesh, corners: [([usize; 2], usize); 4], turn: bool| {
            let mut corners = corners.map(|(place, level)| vertex(mesh, place, level));
            if turn {
                corners.rotate_left(1);
            }
            let [a, b, c, d] = corners;
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        };
        let top = self.rim.0;
        for &[column, row] in &cells {
            let corners = edges(column, row).map(|(corner, _)| key(corner));
            let turns = [0, 1].map(|_| self.jitter > 0.0 && random.below(2) == 1);
            quad(&mut mesh, corners.map(|corner| (corner, top)), turns[0]);
            let [a, b, c, d] = corners;
            quad(&mut mesh, [d, c, b, a].map(|corner| (corner, 0)), turns[1]);
        }
        for [from, to] in borders {
            for level in 0..top {
                quad(&mut mesh, [(from, level), (to, level), (to, level + 1), (from, level + 1)], false);
            }
        }
        mesh
    }
}

/// A ring with a radius and a height, wound around y, its first side outward.
fn pipe(at: DVec2) -> DVec3 {
    let angle = -TAU * at.x;
    DVec3::new(0.5 * libm::cos(angle), 3.0 * at.y, 0.5 * libm::sin(angle))
}

/// The lower half of a unit sphere, with a small hole in its bottom.
fn bowl(at: DVec2) -> DVec3 {
    let (angle, fall) = (-TAU * at.x, FRAC_PI_2 * (0.05 + 0.95 * at.y));
    DVec3::new(libm::sin(fall) * libm::cos(angle), -libm::cos(fall), libm::sin(fall) * libm::sin(angle))
}

/// A panel as of a car's roof.
fn roof(at: DVec2) -> DVec3 {
    let [u, v] = [2.0 * at.x - 1.0, 2.0 * at.y - 1.0];
    DVec3::new(u, 0.3 * (1.0 - u * u) + 0.2 * (1.0 - v * v), -0.75 * v)
}

const PLAIN: Shell = Shell {
    cells: [48, 24],
    middle: &pipe,
    thickness: &|_| 0.03,
    is_ring: true,
    hole: &|_| false,
    rim: SQUARE,
    jitter: 0.0,
};

/// Finds the walls. All of the area is replaced by at most half of the triangles, within `most` thicknesses.
fn check(name: &str, mesh: &Mesh, most: f64) -> ThinWalls {
    let (walls, deviation) = find(mesh);
    println!("{name}: {:.4} thicknesses, {:?}", deviation.over_thickness, walls.left_out);
    assert!(walls.abstracted_area >= 0.999 * walls.area_before, "{name}: {:?}", walls.left_out);
    assert!(2 * walls.triangles.len() <= mesh.triangles.len(), "{name}: {} triangles", walls.triangles.len());
    assert!(deviation.over_thickness <= most, "{name}: {deviation:?}");
    walls
}

#[test]
fn pipes_and_bowls_have_their_middle_radius() {
    // The chords of a circle of n parts are off by up to 1 − cos(π / n) of the radius.
    let pipe_flatness = 0.5 * (1.0 - (PI / 48.0).cos());
    for (name, taper) in [("pipe", 0.0), ("pipe of varying thickness", 0.04)] {
        let walls = check(name, &Shell { thickness: &|at| 0.02 + taper * at.y, ..PLAIN }.mesh(), 0.05);
        for (position, half) in walls.positions.iter().zip(&walls.half_thickness) {
            let radius = f64::from(position.x).hypot(f64::from(position.z));
            assert!((radius - 0.5).abs() <= 2.0 * pipe_flatness, "{name}: {radius}");
            let expected = 0.5 * (0.02 + taper * f64::from(position.y) / 3.0);
            assert!((f64::from(*half) - expected).abs() <= 2.0 * pipe_flatness, "{name}: {half}, not {expected}");
        }
    }
    let walls = check("bowl", &Shell { middle: &bowl, ..PLAIN }.mesh(), 0.05);
    let flatness = 1.0 - (PI / 48.0).cos();
    assert!(walls.positions.iter().all(|position| (position.as_dvec3().length() - 1.0).abs() <= 2.0 * flatness));
}

#[test]
fn rims_of_any_shape_are_replaced() {
    for (rim_name, rim) in [("chamfered", CHAMFERED), ("rounded", ROUNDED)] {
        for (name, middle, is_ring) in
            [("pipe", &pipe as &dyn Fn(DVec2) -> DVec3, true), ("bowl", &bowl, true), ("roof", &roof, false)]
        {
            // A square rim is off by 0.24 thicknesses at most.
            let shell = Shell { middle, is_ring, rim, cells: [48, 24], ..PLAIN };
            let walls = check(&format!("{name}, {rim_name}"), &shell.mesh(), 0.25);
            if name == "pipe" {
                let top = walls.positions.iter().map(|position| position.y).fold(0.0, f32::max);
                let tip = 3.0 + 0.015 * rim.1 as f32;
                assert!(top > 3.001 && top < tip, "{top} is not between the edges and the tip, {tip}");
            }
        }
    }
}

#[test]
fn jittered_panels_with_holes_are_replaced() {
    let hole = |at: DVec2| at.distance(DVec2::splat(0.5)) < 0.15 || (at.x < 0.4 && at.x > 0.2 && at.y < 0.3);
    let roof = Shell { middle: &roof, is_ring: false, cells: [40, 30], ..PLAIN };
    check("roof with holes", &Shell { hole: &hole, ..roof }.mesh(), 0.05);
    let jittered = Shell { hole: &hole, jitter: 0.2, ..roof };
    check("jittered", &jittered.mesh(), 0.05);
    // The sides are cut into different facets. Where the wall is thinnest, coarser ones are farther apart than the bar.
    let tapered = Shell { thickness: &|at| 0.01 + 0.02 * at.x, cells: [60, 45], ..jittered };
    check("tapered", &tapered.mesh(), 0.05);
}

#[test]
fn folded_faces_come_to_an_end() {
    // Vertices stray into neighboring cells, so triangles turn over and are opposite each other at no distance.
    for cells in [[24, 18], [60, 45]] {
        let (walls, _) = find(&Shell { middle: &roof, is_ring: false, cells, jitter: 0.5, ..PLAIN }.mesh());
        assert!(walls.abstracted_area >= 0.8 * walls.area_before, "{:?}", walls.left_out);
    }
}

#[test]
fn corners_of_boxes_are_mitered() {
    let mut inside = cuboid([0.96, 0.76, 0.56], 3);
    inside.triangles.iter_mut().for_each(|corners| corners.reverse());
    let walls = check("box", &merge(&[cuboid([1.0, 0.8, 0.6], 4), inside]), 1e-4);
    for position in &walls.positions {
        // Halfway between the outer and the inner half size.
        let at = position.abs() - Vec3::new(0.98, 0.78, 0.58);
        assert!(at.max_element().abs() <= 1e-6, "{position} is in no middle");
    }
}

#[test]
fn spheres_whose_sides_are_meshed_unlike_stay_closed() {
    let mut inside = icosphere(3, 0.95).rotate([1.0, 0.3, 0.0], 0.5);
    inside.triangles.iter_mut().for_each(|corners| corners.reverse());
    let (walls, deviation) = find(&merge(&[icosphere(4, 1.0), inside]));
    assert!(walls.abstracted_area >= 0.999 * walls.area_before);
    assert!(deviation.over_thickness <= 0.25, "{deviation:?}");
    assert_eq!(super::borders(&walls), []);
}

/// Cuts a third of the triangles at random points within them, `rounds` times: slivers.
fn shatter(mut mesh: Mesh, rounds: usize) -> Mesh {
    let mut random = Random::new(5);
    for _ in 0..rounds {
        for triangle in 0..mesh.triangles.len() {
            if random.below(3) > 0 {
                continue;
            }
            let [a, b, c] = mesh.triangles[triangle];
            let weights = [0; 3].map(|_| random.unit() + 0.02);
            let total: f64 = weights.iter().sum();
            let between = std::array::from_fn(|axis| {
                let corners = [a, b, c].map(|corner| f64::from(mesh.positions[corner as usize][axis]));
                ((0..3).map(|k| corners[k] * weights[k]).sum::<f64>() / total) as f32
            });
            let middle = mesh.positions.len() as u32;
            mesh.positions.push(between);
            mesh.triangles[triangle] = [a, b, middle];
            mesh.triangles.extend([[b, c, middle], [c, a, middle]]);
        }
    }
    mesh
}

#[test]
fn slivers_do_not_tilt_the_sheet() {
    check("ribs of slivers", &shatter(panel(&Panel::ribbed()), 3), 0.05);
}

#[test]
fn ribs_far_from_the_origin_are_found() {
    let turned = panel(&Panel::ribbed()).rotate([1.0, 2.0, 3.0], 0.7);
    let far = turned.translate([1000.0, 1000.0, -1000.0]);
    let walls = check("far away", &far, 0.05);
    // Coordinates are rounded to 1/100 of the thickness.
    assert!(sheet(&walls).len() == walls.triangles.len());
    assert_eq!(walls.regions.len(), 8);
}
