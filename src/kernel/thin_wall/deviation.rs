//! How far the thickened sheet and the original surface are apart.

use glam::DVec3;

use super::{
    body::{Body, Facets},
    pairing::lattice,
    sheet::Sheet,
    thicken::Thickened,
    walls::{NO_WALL, Role, Walls},
};

/// Samples per half-thickness, along each direction, unless the mesh is so large that there would be too many.
const SAMPLES_PER_HALF: f64 = 2.0;

/// The most samples in either direction, about.
const MOST_SAMPLES: f64 = 100_000.0;

/// The most rows of samples in one triangle.
const MOST_ROWS: usize = 200;

/// A triangle is a part of a rim if it is nowhere farther than this share of the thickness from the thickened sheet.
/// Rounded and chamfered rims are.
const COVER_SHARE: f64 = 0.24;

/// The largest distance between the thickened sheets with what is left, and the original surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Deviation {
    /// The largest distance of a point of either surface from the other one, in the unit of the positions.
    pub hausdorff: f64,
    /// The largest ratio of such a distance to the thickness of the wall there.
    pub over_thickness: f64,
    /// The point at which that ratio is largest.
    pub place: DVec3,
    /// The distance between neighboring samples, in the unit of the positions. Vertices and middles of edges are
    /// sampled, too.
    pub spacing: f64,
    /// The number of samples in both directions.
    pub samples: usize,
}

impl Deviation {
    /// Takes a sample into account. Returns its distance in thicknesses.
    fn add(&mut self, place: DVec3, distance: f64, half: f64) -> f64 {
        self.samples += 1;
        self.hausdorff = self.hausdorff.max(distance);
        let ratio = if half > 0.0 { distance / (2.0 * half) } else { 0.0 };
        if ratio > self.over_thickness {
            self.over_thickness = ratio;
            self.place = place;
        }
        ratio
    }

    /// Measures. `is_replaced` tells which triangles of the body the sheet replaces. Returns the largest distance at each
    /// triangle of the body, too, in thicknesses: from it, and from the part of the sheet that it has become.
    pub(super) fn measure(body: &Body, sheet: &Sheet, thick: &Thickened, is_replaced: &[bool]) -> (Self, Vec<f64>) {
        let mut errors = vec![0.0_f64; is_replaced.len()];
        let replaced = || (0..is_replaced.len()).filter(|&triangle| is_replaced[triangle]);
        let area: f64 = replaced().map(|triangle| body.areas[triangle]).sum::<f64>() + 0.0;
        let mean_half = {
            let count = thick.surface.corners.len().max(1) as f64;
            (0..thick.surface.corners.len() as u32).map(|triangle| thick.half(triangle)).sum::<f64>() / count
        };
        let spacing = (mean_half / SAMPLES_PER_HALF).max((area / MOST_SAMPLES).sqrt());
        let mut deviation = Self { spacing, ..Self::default() };
        if spacing == 0.0 {
            return (deviation, errors);
        }
        // Left triangles are part of both surfaces.
        let left = Facets::new(
            (0..is_replaced.len())
                .filter(|&triangle| !is_replaced[triangle])
                .map(|triangle| body.facets.corners[triangle])
                .collect(),
        );
        for triangle in replaced() {
            for point in samples(&body.facets.corners[triangle], spacing) {
                let Some((near, closest)) = thick.surface.closest(point, f64::MAX.sqrt(), |_, _| true) else {
                    continue;
                };
                let distance = closest.distance(point);
                let from_left = left.closest(point, distance, |_, _| true).map(|(_, closest)| closest.distance(point));
                let error = deviation.add(point, from_left.unwrap_or(distance), thick.half(near));
                errors[triangle] = errors[triangle].max(error);
            }
        }
        let is_rimless = without_rim(body, sheet, is_replaced);
        let strips = thick.surface.corners.len() - thick.strips.len();
        for triangle in 0..thick.surface.corners.len() {
            // The original encloses the strips towards what is left, and an open original has no rim to compare with.
            if triangle >= strips && thick.strips[triangle - strips].iter().all(|&end| is_rimless[end as usize]) {
                continue;
            }
            let face = sheet.faces[thick.sources[triangle] as usize] as usize;
            for point in samples(&thick.surface.corners[triangle], spacing) {
                if thick.contains(point) {
                    continue;
                }
                if let Some((_, closest)) = body.facets.closest(point, f64::MAX.sqrt(), |_, _| true) {
                    let error = deviation.add(point, closest.distance(point), thick.half(triangle as u32));
                    errors[face] = errors[face].max(error);
                }
            }
        }
        (deviation, errors)
    }
}

/// Which vertices of the sheet were at triangles of the body that are left, or at its border.
fn without_rim(body: &Body, sheet: &Sheet, is_replaced: &[bool]) -> Vec<bool> {
    let mut is_rimless = vec![false; body.points.len()];
    for triangle in (0..is_replaced.len()).filter(|&triangle| !is_replaced[triangle]) {
        for vertex in body.vertices(triangle) {
            is_rimless[vertex] = true;
        }
    }
    for triangle in 0..body.triangle_count() {
        let vertices = body.vertices(triangle);
        for edge in (0..3).filter(|&edge| body.is_border(triangle, edge)) {
            is_rimless[vertices[edge]] = true;
            is_rimless[vertices[(edge + 1) % 3]] = true;
        }
    }
    sheet.origins.iter().map(|ends| ends.iter().all(|&end| is_rimless[end as usize])).collect()
}

/// Points all over a triangle, with its corners and the middles of its edges.
fn samples(corners: &[DVec3; 3], spacing: f64) -> impl Iterator<Item = DVec3> {
    let [a, b, c] = *corners;
    let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
    let size = (b - a).cross(c - a).length().sqrt().max(0.125 * longest);
    #[expect(clippy::cast_sign_loss, reason = "at least 1")]
    let rows = ((size / spacing).ceil().max(1.0) as usize).min(MOST_ROWS);
    let corners = [a, b, c];
    lattice(corners, rows).chain(corners).chain([a.midpoint(b), b.midpoint(c), c.midpoint(a)])
}

/// For each triangle without a role, the wall of whose rim it is a part, or [`NO_WALL`].
pub(super) fn covered(body: &Body, sheet: &Sheet, thick: &Thickened, walls: &Walls) -> Vec<u32> {
    let wall = |near: u32| sheet.walls[thick.sources[near as usize] as usize];
    (0..body.triangle_count())
        .map(|triangle| match walls.roles[triangle] {
            Role::Rest => cover(body, thick, triangle).map_or(NO_WALL, wall),
            _ => NO_WALL,
        })
        .collect()
}

/// The triangle of the thickened surface that stands for a triangle of the body, if that runs along it everywhere.
fn cover(body: &Body, thick: &Thickened, triangle: usize) -> Option<u32> {
    const ROWS: usize = 3;
    let corners = body.facets.corners[triangle];
    let mut nearest = None;
    for point in corners.into_iter().chain(lattice(corners, ROWS)) {
        let (near, closest) = thick.surface.closest(point, thick.reach(), |_, _| true)?;
        if closest.distance(point) > 2.0 * COVER_SHARE * thick.half(near) {
            return None;
        }
        nearest = Some(near);
    }
    nearest
}
