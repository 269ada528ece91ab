//! What the reported distance must be, by brute force in f64: nothing is shared with the production kernel.
//!
//! A thickened sheet is here the union of what is within half the thickness of its triangles. It ends squarely at borders,
//! and is round elsewhere: where triangles meet at an angle of 20°, a miter reaches 0.008 thicknesses farther.

use std::collections::BTreeMap;

use bevy_circumsphere::geometry::thin_wall::{Deviation, ThinWalls};
use circumsphere_support::{random::Random, scenes::Mesh};
use circumsphere_truth::point_triangle;
use glam::DVec3;

use super::{corners_of, sheet};

/// How far the true distance may exceed the reported one, in thicknesses: the miters of creases.
const MITER: f64 = 0.01;

/// What is this share of half a thickness below a side of a wall is inside of it.
const INSIDE: f64 = 0.98;

/// Random places on either surface.
const SAMPLES: usize = 500;

struct Triangle {
    corners: [DVec3; 3],
    halves: [f64; 3],
    /// Whether the sheet ends at the edge that starts at a corner.
    is_border: [bool; 3],
    min: DVec3,
    max: DVec3,
}

impl Triangle {
    fn new(corners: [DVec3; 3], halves: [f64; 3], is_border: [bool; 3]) -> Self {
        let half = halves[0].max(halves[1]).max(halves[2]);
        let [a, b, c] = corners;
        Self { corners, halves, is_border, min: a.min(b).min(c) - half, max: a.max(b).max(c) + half }
    }

    fn normal(&self) -> DVec3 {
        let [a, b, c] = self.corners;
        (b - a).cross(c - a).normalize_or_zero()
    }

    /// The distance of a point from the thickened triangle: negative inside.
    fn distance(&self, point: DVec3) -> f64 {
        let closest = point_triangle(point, &self.corners);
        let half: f64 = (0..3).map(|k| closest.barycentric[k] * self.halves[k]).sum();
        // Opposite an edge, the weight of its other corner is 0.
        let at_border = (0..3).any(|k| self.is_border[k] && closest.barycentric[(k + 2) % 3] <= 1e-12);
        if !at_border {
            return closest.distance - half;
        }
        let offset = point - closest.point;
        let height = offset.dot(self.normal()).abs();
        let beyond = (offset.length_squared() - height * height).max(0.0).sqrt();
        if beyond <= 1e-12 { height - half } else { beyond.hypot((height - half).max(0.0)) }
    }

    /// A random point, and the weights of the corners there.
    fn random(&self, random: &mut Random) -> (DVec3, [f64; 3]) {
        let (mut u, mut v) = (random.unit(), random.unit());
        if u + v > 1.0 {
            (u, v) = (1.0 - u, 1.0 - v);
        }
        let weights = [1.0 - u - v, u, v];
        ((0..3).map(|k| self.corners[k] * weights[k]).sum(), weights)
    }
}

/// Triangles without an order, thickened or not.
struct Solid(Vec<Triangle>);

impl Solid {
    /// The original surface.
    fn original(mesh: &Mesh) -> Self {
        let corners = |corners: &[u32; 3]| {
            corners.map(|corner| DVec3::from_array(mesh.positions[corner as usize].map(f64::from)))
        };
        Self(mesh.triangles.iter().map(|triangle| Triangle::new(corners(triangle), [0.0; 3], [false; 3])).collect())
    }

    /// The thickened sheets.
    fn sheets(walls: &ThinWalls) -> Self {
        let bits = |corner: u32| walls.positions[corner as usize].to_array().map(|value| (value + 0.0).to_bits());
        let edge = |corners: &[u32; 3], k: usize| {
            let mut ends = [bits(corners[k]), bits(corners[(k + 1) % 3])];
            ends.sort_unstable();
            ends
        };
        let mut users = BTreeMap::new();
        for corners in sheet(walls) {
            for k in 0..3 {
                *users.entry(edge(corners, k)).or_insert(0) += 1;
            }
        }
        let triangle = |corners: &[u32; 3]| {
            let halves = corners.map(|corner| f64::from(walls.half_thickness[corner as usize]));
            Triangle::new(corners_of(walls, corners), halves, [0, 1, 2].map(|k| users[&edge(corners, k)] == 1))
        };
        Self(sheet(walls).iter().map(triangle).collect())
    }

    /// The thickened sheets, and what is left.
    fn abstracted(walls: &ThinWalls) -> Self {
        let mut all = Self::sheets(walls);
        let left = walls.triangles[walls.sheet_regions.len()..].iter();
        all.0.extend(left.map(|corners| Triangle::new(corners_of(walls, corners), [0.0; 3], [false; 3])));
        all
    }

    /// The distance of a point: negative inside.
    fn distance(&self, point: DVec3) -> f64 {
        let mut nearest = f64::INFINITY;
        for triangle in &self.0 {
            let box_distance = (triangle.min - point).max(point - triangle.max).max(DVec3::ZERO).length();
            if box_distance <= nearest.max(0.0) {
                nearest = nearest.min(triangle.distance(point));
            }
        }
        nearest
    }
}

/// Triangles at random, the larger the likelier.
fn pick<'a>(triangles: &'a [Triangle]) -> impl Fn(&mut Random) -> &'a Triangle {
    let mut sum = 0.0;
    let sums: Vec<f64> = triangles
        .iter()
        .map(|triangle| {
            let [a, b, c] = triangle.corners;
            sum += (b - a).cross(c - a).length();
            sum
        })
        .collect();
    move |random| {
        let at = random.unit() * sum;
        &triangles[sums.partition_point(|&before| before <= at).min(sums.len() - 1)]
    }
}

fn thickest(walls: &ThinWalls) -> f64 {
    2.0 * f64::from(walls.half_thickness.iter().copied().fold(0.0, f32::max))
}

/// Checks the reported distance of a mesh without sharp edges.
pub(super) fn check(name: &str, mesh: &Mesh, walls: &ThinWalls, deviation: &Deviation) {
    let original = Solid::original(mesh);
    let (sheets, abstracted) = (Solid::sheets(walls), Solid::abstracted(walls));
    let thickness = thickest(walls);
    let mut random = Random::new(31);
    let mut outward = 0.0_f64;
    let next = pick(&original.0);
    for _ in 0..SAMPLES {
        let (point, _) = next(&mut random).random(&mut random);
        outward = outward.max(abstracted.distance(point));
    }
    let mut back = 0.0_f64;
    let mut seen = 0;
    let next = pick(&sheets.0);
    for place in 0..SAMPLES {
        let triangle = next(&mut random);
        let (point, weights) = triangle.random(&mut random);
        let half: f64 = (0..3).map(|k| weights[k] * triangle.halves[k]).sum();
        let point = point + triangle.normal() * [half, -half][place % 2];
        if sheets.distance(point) >= -(1.0 - INSIDE) * half {
            seen += 1;
            back = back.max(original.distance(point));
        }
    }
    println!(
        "{name}: {outward:.5} to the sheets, {back:.5} back, {:.5} reported, thickness {thickness:.5}",
        deviation.hausdorff
    );
    assert!(2 * seen > SAMPLES, "{name}: only {seen} points of the sides are outside of other walls");
    let most = deviation.hausdorff + MITER * thickness;
    assert!(outward <= most, "{name}: {outward} from the sheets, but {} is reported", deviation.hausdorff);
    assert!(back <= most, "{name}: {back} back from the sheets, but {} is reported", deviation.hausdorff);
}

/// No ball of `count` random ones that touches the original is farther from the sheets than the reported distance.
pub(super) fn probe(name: &str, mesh: &Mesh, walls: &ThinWalls, deviation: &Deviation, count: usize) {
    let (original, abstracted) = (Solid::original(mesh), Solid::abstracted(walls));
    let thickness = thickest(walls);
    let mut random = Random::new(7);
    let next = pick(&original.0);
    let (mut touching, mut lost, mut beyond) = (0, 0, Vec::new());
    for _ in 0..count {
        let (on, _) = next(&mut random).random(&mut random);
        let way = [0; 3].map(|_| f64::from(random.signed_unit()));
        let center = on + DVec3::from_array(way) * thickness;
        let radius = random.unit() * thickness;
        if original.distance(center) > radius {
            continue;
        }
        touching += 1;
        let gap = abstracted.distance(center) - radius;
        lost += usize::from(gap > 0.0);
        if gap > deviation.hausdorff + MITER * thickness {
            beyond.push((center, radius, gap));
        }
    }
    println!("{name}: {touching} of {count} balls touch the original, {lost} of them not the sheets");
    assert!(touching > count / 4, "{name}: {touching} balls touch the original");
    assert!(
        beyond.is_empty(),
        "{name}: {} contacts are lost beyond {}: {:?}",
        beyond.len(),
        deviation.hausdorff,
        beyond[0]
    );
}
