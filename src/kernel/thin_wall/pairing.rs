//! Pairs opposite faces, and measures the thickness between them.
//!
//! A point looks for the closest point that faces the other way and lies inward of it, and sees it through the body. The
//! plane there, not the point, gives the thickness: the foot of a rib, where the opposite face has a gap, gets the
//! thickness of the plate around it. (Like the shape diameter of Shapira, Shamir, and Cohen-Or 2008, but only between
//! faces that are nearly parallel.)

use glam::DVec3;

use super::{
    body::{Body, NO_TRIANGLE},
    settings::ThinWallSettings,
};

/// The opposite point lies within this cosine of the inward normal.
const INWARD_COSINE: f64 = 0.5;

/// Two points are a wall only if either sees the other about as far away.
const MUTUAL_RATIO: f64 = 1.5;

/// The share of a triangle's samples that must be paired.
const PAIRED_SHARE: f64 = 0.6;

/// The least number of samples of a mesh. It has more if it has more triangles.
const LEAST_SAMPLES: f64 = 12_000.0;

/// The most rows of samples in one triangle.
const MOST_ROWS: usize = 24;

/// What is opposite a point of a face.
#[derive(Clone, Copy, Debug)]
pub(super) struct Opposite {
    pub(super) triangle: u32,
    /// The depth of the middle below the face: the radius of the ball that touches both faces.
    pub(super) depth: f64,
    /// Half the thickness across the middle surface.
    pub(super) half: f64,
}

/// The plane opposite a face.
#[derive(Clone, Copy, Debug)]
pub(super) struct OppositePlane {
    pub(super) triangle: u32,
    point: DVec3,
    normal: DVec3,
}

impl OppositePlane {
    /// What is opposite `point` on a face with normal `normal`, if the plane goes on to there.
    pub(super) fn at(&self, point: DVec3, normal: DVec3) -> Option<Opposite> {
        let cosine = -normal.dot(self.normal);
        let distance = self.normal.dot(self.point - point);
        let depth = distance / (1.0 + cosine);
        // cos(α/2) = sqrt((1 + cos α)/2)
        let half = depth / (0.5 * (1.0 + cosine)).sqrt();
        (depth > 0.0).then_some(Opposite { triangle: self.triangle, depth, half })
    }
}

/// A point of a triangle, and what is opposite it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sample {
    pub(super) point: DVec3,
    pub(super) opposite: Option<Opposite>,
}

/// The samples of all triangles.
pub(super) struct Pairing {
    samples: Vec<Sample>,
    /// Where the samples of each triangle begin, and the end.
    first: Vec<usize>,
    /// Which triangles are paired.
    pub(super) is_paired: Vec<bool>,
    /// The farthest that was looked.
    pub(super) range: f64,
}

impl Pairing {
    pub(super) fn new(body: &Body, settings: &ThinWallSettings) -> Self {
        let total: f64 = body.areas.iter().sum();
        let range = (0.5 * total).sqrt() / f64::from(settings.least_extent);
        let spacing = (total / LEAST_SAMPLES).sqrt();
        let mut samples = Vec::new();
        let mut first = vec![0];
        for (triangle, corners) in body.facets.corners.iter().enumerate() {
            if body.normals[triangle] != DVec3::ZERO && body.duplicate_of[triangle] == NO_TRIANGLE {
                let longest = (0..3).map(|k| corners[k].distance(corners[(k + 1) % 3])).fold(0.0, f64::max);
                let size = body.areas[triangle].sqrt().max(0.25 * longest);
                #[expect(clippy::cast_sign_loss, reason = "at least 1")]
                let rows = ((size / spacing).round().max(1.0) as usize).min(MOST_ROWS);
                let opposite = |point| {
                    opposite_plane(body, settings, triangle, point, range)
                        .and_then(|plane| plane.at(point, body.normals[triangle]))
                        .filter(|opposite| opposite.depth > body.rounding)
                };
                samples.extend(lattice(*corners, rows).map(|point| Sample { point, opposite: opposite(point) }));
            }
            first.push(samples.len());
        }
        let mut pairing = Self { samples, first, is_paired: Vec::new(), range };
        pairing.drop_one_sided();
        pairing.is_paired = (0..body.triangle_count())
            .map(|triangle| {
                let samples = pairing.of(triangle);
                let paired = samples.iter().filter(|sample| sample.opposite.is_some()).count();
                paired > 0 && paired as f64 >= PAIRED_SHARE * samples.len() as f64
            })
            .collect();
        pairing
    }

    /// The samples of a triangle. None if it has no normal.
    pub(super) fn of(&self, triangle: usize) -> &[Sample] {
        &self.samples[self.first[triangle]..self.first[triangle + 1]]
    }

    /// Drops what is opposite a sample if that does not see the sample about as near: a rib's top sees the far side of
    /// the plate, which sees the near one.
    fn drop_one_sided(&mut self) {
        let mut is_mutual = vec![true; self.samples.len()];
        for (sample, is_mutual) in self.samples.iter().zip(&mut is_mutual) {
            let Some(own) = sample.opposite else { continue };
            let there = self.of(own.triangle as usize).iter();
            let nearest = there.min_by(|a, b| {
                a.point.distance_squared(sample.point).total_cmp(&b.point.distance_squared(sample.point))
            });
            let other = nearest.and_then(|nearest| nearest.opposite);
            *is_mutual = other.is_some_and(|other| own.half <= MUTUAL_RATIO * other.half);
        }
        for (sample, is_mutual) in self.samples.iter_mut().zip(is_mutual) {
            if !is_mutual {
                sample.opposite = None;
            }
        }
    }
}

/// The centers of the `rows`² triangles into which a triangle is cut.
pub(super) fn lattice(corners: [DVec3; 3], rows: usize) -> impl Iterator<Item = DVec3> {
    let [origin, b, c] = corners;
    let (u, v) = ((b - origin) / rows as f64, (c - origin) / rows as f64);
    (0..rows).flat_map(move |i| {
        (0..rows - i).flat_map(move |j| {
            let corner = origin + u * i as f64 + v * j as f64;
            let upper = (i + j + 1 < rows).then_some(corner + (u + v) * (2.0 / 3.0));
            std::iter::once(corner + (u + v) / 3.0).chain(upper)
        })
    })
}

/// The plane of the face opposite a point of `triangle`.
pub(super) fn opposite_plane(
    body: &Body,
    settings: &ThinWallSettings,
    triangle: usize,
    point: DVec3,
    range: f64,
) -> Option<OppositePlane> {
    let normal = body.normals[triangle];
    let opposed = settings.opposed_cosine();
    let (triangle, closest) = body.facets.closest(point, range, |other, closest| {
        let way = closest - point;
        let depth = -way.dot(normal);
        -normal.dot(body.normals[other as usize]) >= opposed
            && depth > body.rounding
            && depth >= INWARD_COSINE * way.length()
    })?;
    let is_seen = !body.facets.blocks(point, closest);
    is_seen.then(|| OppositePlane { triangle, point: closest, normal: body.normals[triangle as usize] })
}
