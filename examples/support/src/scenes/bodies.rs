//! Closed bodies for scenes of soft and rigid bodies. All lengths are in meters.
//!
//! The organ is a radial graph over the sphere: it has one point per direction, so it cannot cross itself.

use std::f64::consts::FRAC_PI_2;

use super::points::{Point, cross, subtract, unit};
use super::revolution::{Circle, revolve};
use super::shapes::box_lattice;
use super::{Mesh, icosphere};

/// Segments around a [`needle`].
const NEEDLE_SEGMENTS: usize = 8;

/// Bands of triangles along the shaft of a [`needle`].
const NEEDLE_BANDS: usize = 5;

/// Share of a [`needle`]'s length that is its point.
const NEEDLE_POINT: f64 = 0.2;

/// Half the size of the [`organ`] along x, y, and z without its lobes, in meters.
const ORGAN_HALF_EXTENTS: Point = [0.095, 0.055, 0.07];

/// A closed capsule around the y axis, centered at the origin: all points at `radius` meters from the segment that
/// extends `half_length` meters up and down.
///
/// The vertices are on the capsule. Circles on the cylinder have `segments_around` vertices. Circles on the caps have
/// fewer, in proportion to their length, so that triangles are nearly equilateral if the distance between circles
/// matches that between their vertices. The first vertex is the upper pole, and the last one the lower.
///
/// # Panics
///
/// If `segments_around` is below 3, another number is 0, or a length is not positive.
pub fn capsule(
    radius: f32,
    half_length: f32,
    segments_around: usize,
    segments_along_cylinder: usize,
    rings_per_cap: usize,
) -> Mesh {
    assert!(segments_around >= 3, "a capsule needs at least 3 segments around");
    assert!(segments_along_cylinder > 0 && rings_per_cap > 0, "a capsule needs 1 segment along and 1 ring per cap");
    assert!(radius > 0.0 && half_length > 0.0, "the lengths of a capsule must be positive");
    let (radius, half_length) = (f64::from(radius), f64::from(half_length));
    // From the pole to just before the equator, relative to the center of a cap.
    let cap: Vec<Circle> = (1..rings_per_cap)
        .map(|ring| {
            let angle = FRAC_PI_2 * ring as f64 / rings_per_cap as f64;
            let segments = (segments_around as f64 * libm::sin(angle)).round() as usize;
            Circle { height: radius * libm::cos(angle), radius: radius * libm::sin(angle), segments: segments.max(3) }
        })
        .collect();
    let mut circles = vec![Circle::point(half_length + radius)];
    circles.extend(cap.iter().map(|circle| Circle { height: half_length + circle.height, ..*circle }));
    circles.extend((0..=segments_along_cylinder).map(|segment| {
        let height = half_length * (1.0 - 2.0 * segment as f64 / segments_along_cylinder as f64);
        Circle { height, radius, segments: segments_around }
    }));
    circles.extend(cap.iter().rev().map(|circle| Circle { height: -half_length - circle.height, ..*circle }));
    circles.push(Circle::point(-half_length - radius));
    revolve(&circles)
}

/// A closed needle of 96 triangles along the y axis, with its tip at the origin and its flat head `length` meters
/// above.
///
/// Its shaft has the given `radius` in meters. The lowest fifth is the point, a cone. The triangles are as slender as
/// the needle. The last vertex is the tip.
///
/// # Panics
///
/// If a length is not positive.
pub fn needle(length: f32, radius: f32) -> Mesh {
    assert!(length > 0.0 && radius > 0.0, "the lengths of a needle must be positive");
    let (length, radius) = (f64::from(length), f64::from(radius));
    let mut circles = vec![Circle::point(length)];
    circles.extend((0..=NEEDLE_BANDS).map(|band| {
        let share = band as f64 / NEEDLE_BANDS as f64;
        Circle { height: length * (1.0 - (1.0 - NEEDLE_POINT) * share), radius, segments: NEEDLE_SEGMENTS }
    }));
    circles.push(Circle::point(0.0));
    revolve(&circles)
}

/// A closed, smooth body of about 0.2 m along x, with two lobes and a shallow cleft between them, like a liver.
///
/// The origin is inside, and the smooth back faces up along y. It is an [`icosphere`] of that `level` with displaced
/// vertices: 1,280 triangles at level 3, 5,120 at level 4. Every level samples the same surface.
pub fn organ(level: u32) -> Mesh {
    let mut mesh = icosphere(level, 1.0);
    for position in &mut mesh.positions {
        *position = organ_point(unit(position.map(f64::from))).map(|coordinate| coordinate as f32);
    }
    mesh
}

/// The closed target that a [`needle`] is shot at: the [`organ`] with 1,280 triangles.
pub fn closed_target() -> Mesh {
    organ(3)
}

/// The point of the organ's surface in a direction, a unit vector of the sphere before it is stretched.
pub(super) fn organ_point(direction: Point) -> Point {
    let [x, y, z] = direction;
    let lobes = 0.10 * x + 0.06 * (x * x - z * z) + 0.20 * x * y * z;
    // The lower side is hollow, where other organs would be.
    let below = 0.5 * (1.0 - y);
    let hollow = 0.10 * below * below * below * below;
    // The cleft runs over the front and the lower side only. The upper side stays smooth.
    let across = (x + 0.2) / 0.25;
    let side = 0.5 * (1.0 + 0.8 * z - 0.6 * y);
    let cleft = 0.26 * libm::exp(-across * across) * side * side * side;
    let radius = 1.0 + lobes - hollow - cleft;
    std::array::from_fn(|axis| radius * direction[axis] * ORGAN_HALF_EXTENTS[axis])
}

/// The outward unit normal of the organ at [`organ_point`] of a direction, which must not be ±z.
pub(super) fn organ_normal(direction: Point) -> Point {
    // Differences over twice this arc are accurate to 1e-10 of the surface's size, far below the precision of f32.
    const STEP: f64 = 1e-5;
    let first = unit(cross([0.0, 0.0, 1.0], direction));
    let second = cross(direction, first);
    let tangent = |side: Point| {
        let at = |step: f64| organ_point(unit(std::array::from_fn(|axis| direction[axis] + step * side[axis])));
        subtract(at(STEP), at(-STEP))
    };
    unit(cross(tangent(first), tangent(second)))
}

/// A closed ball around the origin with four lobes, between 3/4 and 5/4 of `radius` meters from it.
///
/// It is an [`icosphere`] of that `level` with radially displaced vertices, so it does not cross itself.
pub fn lobed_ball(level: u32, radius: f32) -> Mesh {
    let mut mesh = icosphere(level, 1.0);
    for position in &mut mesh.positions {
        let direction = unit(position.map(f64::from));
        // The product of the coordinates is at most 1 / sqrt(27), on the space diagonals.
        let lobes = 0.25 * 27.0_f64.sqrt() * direction[0] * direction[1] * direction[2];
        *position = direction.map(|coordinate| (coordinate * (1.0 + lobes) * f64::from(radius)) as f32);
    }
    mesh
}

/// A closed box around the origin that extends `half_extents` meters, with edges rounded by `rounding` meters.
///
/// It has 12 n² triangles for n `subdivisions`. The faces between the rounded edges are flat. The cells beyond them
/// form the rounded edges.
///
/// # Panics
///
/// If `subdivisions` is 0, or `rounding` is not below the smallest half extent.
pub fn rounded_cuboid(half_extents: [f32; 3], rounding: f32, subdivisions: usize) -> Mesh {
    assert!(half_extents.iter().all(|&extent| rounding < extent), "the rounding must be smaller than the box");
    let rounding = f64::from(rounding);
    let mut mesh = box_lattice([subdivisions; 3]);
    for position in &mut mesh.positions {
        let half = half_extents.map(f64::from);
        let core: Point = half.map(|extent| extent - rounding);
        let flat: Point = std::array::from_fn(|axis| f64::from(position[axis]) * half[axis]);
        let inner: Point = std::array::from_fn(|axis| flat[axis].clamp(-core[axis], core[axis]));
        // Every point of the box's surface is outside the core, so the direction exists.
        let outward = unit(subtract(flat, inner));
        *position = std::array::from_fn(|axis| (inner[axis] + rounding * outward[axis]) as f32);
    }
    mesh
}

/// A closed box of half size 1 m around the origin with edges rounded by `rounding` meters, meshed as CAD programs mesh
/// it: two triangles for each flat face, and `strips` narrow strips for each half of a rounded edge. The six sides do
/// not share vertices.
///
/// # Panics
///
/// If `strips` is 0, or `rounding` is not between 0 and 1.
pub fn cad_box(rounding: f64, strips: usize) -> Mesh {
    assert!(strips > 0 && rounding > 0.0 && rounding < 1.0, "a rounded box has strips, and edges below its size");
    // Around each side, coordinates run over the arc of one edge, the flat part, and the arc of the other edge.
    let arc = |step: usize| libm::tan(0.5 * FRAC_PI_2 * step as f64 / strips as f64);
    let before = (0..=strips).map(|step| (-arc(strips - step), -1.0));
    let around: Vec<(f64, f64)> = before.chain((0..=strips).map(|step| (arc(step), 1.0))).collect();
    let width = around.len() as u32;
    let mut mesh = Mesh::default();
    for side in 0..6 {
        let (sign, axis) = (if side < 3 { 1.0 } else { -1.0 }, side % 3);
        let at = |u: f64, v: f64| {
            let mut point = [0.0; 3];
            (point[axis], point[(axis + 1) % 3], point[(axis + 2) % 3]) = (sign * u, v, sign);
            point
        };
        let first = mesh.positions.len() as u32;
        for &(along, side) in &around {
            for &(across, other_side) in &around {
                let (direction, corner) = (unit(at(along, across)), at(side, other_side));
                mesh.positions
                    .push(std::array::from_fn(|k| (corner[k] * (1.0 - rounding) + direction[k] * rounding) as f32));
            }
        }
        for row in 0..width - 1 {
            for column in 0..width - 1 {
                let at = first + row * width + column;
                mesh.triangles.extend([[at, at + width, at + width + 1], [at, at + width + 1, at + 1]]);
            }
        }
    }
    mesh
}
