//! Pairs of triangles whose boxes overlap, by their fate, and the lines that stand for them.

use glam::{DVec3, Vec3};

use super::{
    LevelOfDetail,
    tick::{Detected, Touches},
};
use crate::{
    detection::{OtherSide, SurfacePair},
    kernel::pair_fate::PairFate,
    surface::ActiveSurface,
};

/// A pair of surfaces, with its pairs of triangles by fate.
pub(super) struct PairsByFate<'a> {
    pub(super) pair: &'a SurfacePair,
    pub(super) by_fate: Vec<Vec<[u32; 2]>>,
}

/// All pairs of surfaces that have pairs of triangles at a level of detail.
pub(super) fn by_fate<'a>(detected: &'a Detected, level: LevelOfDetail, touches: &Touches) -> Vec<PairsByFate<'a>> {
    if level == LevelOfDetail::Off {
        return Vec::new();
    }
    let mut drawn: Vec<PairsByFate> = Vec::new();
    for (place, pair) in detected.candidates.pairs.iter().enumerate() {
        let wants = |&[first, second]: &[u32; 2]| {
            let wants_second = match pair.second {
                OtherSide::Surface(other) => touches.wants(level, other, second),
                OtherSide::Shape(_) => true,
            };
            wants_second && touches.wants(level, pair.first, first)
        };
        // Fates take as long as the stages, so they are only computed for pairs that are drawn.
        let wanted: Vec<[u32; 2]> = pair.triangles.iter().copied().filter(wants).collect();
        let fates = detected.fates.of_triangles(pair, &wanted).unwrap_or_default();
        let mut by_fate = vec![Vec::new(); PairFate::ALL.len()];
        for (triangles, fate) in wanted.into_iter().zip(fates) {
            by_fate[fate as usize].push(triangles);
        }
        // Slabs drop most pairs, and never wrongly.
        let parted = &mut by_fate[PairFate::Planes as usize];
        if level == LevelOfDetail::All {
            parted.extend(detected.fates.dropped_by_slabs(place, pair));
            by_fate[PairFate::Remembered as usize].extend(detected.fates.remembered(place, pair));
        } else {
            parted.clear();
        }
        drawn.push(PairsByFate { pair, by_fate });
    }
    drawn.retain(|pair| pair.by_fate.iter().any(|pairs| !pairs.is_empty()));
    drawn
}

/// A line between the centers of two triangles. For a pair with a rigid shape, the outline of the triangle.
pub(super) fn line(surfaces: &[Placed], pair: &SurfacePair, [a, b]: [u32; 2]) -> Vec<Vec3> {
    let first = surfaces[pair.first].corners(a);
    match pair.second {
        OtherSide::Surface(second) => {
            let center = |corners: [DVec3; 3]| (corners.iter().sum::<DVec3>() / 3.0).as_vec3();
            vec![center(first), center(surfaces[second].corners(b))]
        }
        OtherSide::Shape(_) => [0, 1, 2, 0].map(|corner| first[corner].as_vec3()).to_vec(),
    }
}

/// A surface and its vertices in its own frame; `None` if it is gone.
pub(super) struct Placed<'a> {
    surface: &'a ActiveSurface,
    positions: Option<&'a [Vec3]>,
}

impl<'a> Placed<'a> {
    /// All active surfaces. Checking the positions of a surface visits all of them, so it is done once.
    pub(super) fn all(detected: &'a Detected) -> Vec<Self> {
        let place = |surface| Self { surface, positions: detected.surface(surface).map(|(positions, _)| positions) };
        detected.active.surfaces.iter().map(place).collect()
    }

    /// The corners of a triangle in world space; all at the origin if the surface is gone.
    fn corners(&self, triangle: u32) -> [DVec3; 3] {
        let Some(positions) = self.positions else { return [DVec3::ZERO; 3] };
        self.surface.topology.triangles()[triangle as usize]
            .map(|vertex| self.surface.pose.transform_point(positions[vertex as usize].as_dvec3()))
    }
}
