//! Turns thin-walled meshes into single-layer sheets with thickness, when assets are made.
//!
//! A closed mesh with thin walls costs two layers of triangles, which collide with each other. As a sheet with thickness
//! it costs one, and nothing is between its sides. [`ThinWalls::find`] pairs the opposite faces of a mesh, moves one side
//! of each wall to the middle, and drops the other side and the rim. What is not thin stays as it was.
//!
//! Faces are paired by closest points with opposed normals, after the shape diameter of Shapira, Shamir, and Cohen-Or
//! (2008). Walls that meet are joined where their middle surfaces meet. Lengths are in the unit of the positions.

mod body;
mod depths;
mod deviation;
mod fit;
mod pairing;
mod regions;
mod rims;
mod seams;
mod segments;
mod settings;
mod sheet;
mod thicken;
mod walls;

use glam::Vec3;

pub use self::{
    deviation::Deviation,
    regions::{LeftOut, LeftOutReason, RegionKind, ThinRegion},
    settings::ThinWallSettings,
};
pub use crate::kernel::mesh::validation::TopologyError;

use self::{
    body::Body, depths::CornerDepths, pairing::Pairing, regions::Fate, segments::Segments, sheet::Sheet,
    thicken::Thickened, walls::Walls,
};
use crate::kernel::mesh::volume::enclosed_volume;

/// A sheet farther than this share of its thickness from its wall does not replace it.
const MOST_DEVIATION: f64 = 0.25;

/// So much of the thin area is replaced in any case, if it can be.
const LEAST_REPLACED: f64 = 0.9;

/// The largest share that each of several passes accepts. What is worst is left first, because its neighbors are often
/// accurate without it.
const PASSES: [f64; 9] =
    [0.7, 0.5, 0.4, 0.3, MOST_DEVIATION, MOST_DEVIATION, MOST_DEVIATION, MOST_DEVIATION, MOST_DEVIATION];

/// Stands for a vertex that no triangle has named yet.
const UNUSED: u32 = u32::MAX;

/// A mesh with its thin walls replaced by sheets.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ThinWalls {
    /// The vertex positions: those of the sheets, and those of what is left. The positions of the original if nothing is
    /// thin.
    pub positions: Vec<Vec3>,
    /// Half the thickness at each vertex. 0 at the vertices of what is left.
    pub half_thickness: Vec<f32>,
    /// Three vertices for each triangle: first those of the sheets, then those of what is left.
    pub triangles: Vec<[u32; 3]>,
    /// The region of each triangle of the sheets, as an index. The triangles after these are what is left.
    pub sheet_regions: Vec<u32>,
    /// For each triangle that is left, which one of the original it is, ascending.
    pub left: Vec<u32>,
    /// The walls that have become sheets, largest first.
    pub regions: Vec<ThinRegion>,
    /// What stays as it was, by reason.
    pub left_out: Vec<LeftOut>,
    /// The area of the original.
    pub area_before: f64,
    /// The area of walls that are thin, both sides and rims: what is replaced, and what is thin but left.
    pub thin_area: f64,
    /// The area that the sheets replace.
    pub abstracted_area: f64,
}

impl ThinWalls {
    /// Finds the thin walls of a mesh, and replaces them by sheets. Vertices at equal positions are one.
    ///
    /// Takes closed and open meshes, non-manifold ones, slivers, and duplicates. A closed mesh that is inside out, such as a
    /// mirrored one, is taken as if it were turned.
    ///
    /// # Errors
    /// If there is no triangle, a position is not finite, or a triangle names a vertex that does not exist.
    pub fn find(
        positions: &[Vec3],
        triangles: &[[u32; 3]],
        settings: &ThinWallSettings,
    ) -> Result<(Self, Deviation), TopologyError> {
        let body = Body::new(positions, triangles)?;
        if !(body.topology.is_closed() && enclosed_volume(&body.points, triangles) < 0.0) {
            return Ok(Self::find_outward(&body, positions, triangles, settings));
        }
        let inside_out: Vec<[u32; 3]> = triangles.iter().copied().map(turned).collect();
        let body = Body::new(positions, &inside_out)?;
        let (mut walls, deviation) = Self::find_outward(&body, positions, &inside_out, settings);
        let left = walls.sheet_regions.len()..;
        walls.triangles[left].iter_mut().for_each(|corners| *corners = turned(*corners));
        Ok((walls, deviation))
    }

    /// Finds the thin walls of a mesh that is wound outward.
    fn find_outward(
        body: &Body,
        positions: &[Vec3],
        triangles: &[[u32; 3]],
        settings: &ThinWallSettings,
    ) -> (Self, Deviation) {
        let pairing = Pairing::new(body, settings);
        let segments = Segments::new(body, &pairing, settings);
        let is_thin = segments::thin_triangles(body, &pairing, &segments, settings);
        let depths = CornerDepths::new(body, &pairing, &segments, settings, &is_thin);
        let mut walls = Walls::new(body, &pairing, &segments, &depths, &is_thin);
        let mut is_inaccurate = vec![false; body.triangle_count()];
        let mut passes = PASSES.into_iter();
        let (sheet, fates, deviation) = loop {
            let mut sheet = Sheet::new(body, &pairing, &segments, &depths, &walls);
            seams::connect(&mut sheet);
            rims::extend(body, &walls, &mut sheet);
            fit::fit(body, &pairing, &segments, &mut sheet);
            let thick = Thickened::new(body, &segments, &sheet);
            let covered = deviation::covered(body, &sheet, &thick, &walls);
            let fates = regions::fates(body, &pairing, &segments, &walls, &is_thin, &is_inaccurate, &covered);
            let is_replaced: Vec<bool> = fates.iter().copied().map(Fate::is_replaced).collect();
            let (deviation, errors) = Deviation::measure(body, &sheet, &thick, &is_replaced);
            // Passes without anything to leave are skipped.
            let found =
                passes.by_ref().map(|most| inaccurate(body, &fates, &errors, most)).find(|found| !found.is_empty());
            let Some(found) = found else { break (sheet, fates, deviation) };
            for triangle in found {
                is_inaccurate[triangle] = true;
            }
            walls.leave(body, &pairing, &is_inaccurate);
        };
        let (regions, region_of) = regions::regions(body, &segments, &walls, &sheet, &fates);
        let left_out = regions::left_out(body, &fates);
        let mut found = Self {
            // The sum of nothing is −0.
            area_before: body.areas.iter().sum::<f64>() + 0.0,
            abstracted_area: regions.iter().map(|region| region.area).sum::<f64>() + 0.0,
            sheet_regions: sheet.walls.iter().map(|&wall| region_of[wall as usize]).collect(),
            left: (0..body.triangle_count())
                .filter(|&triangle| !fates[triangle].is_replaced())
                .map(|triangle| triangle as u32)
                .collect(),
            regions,
            left_out,
            ..Self::default()
        };
        found.thin_area = found.abstracted_area
            + found.left_out.iter().filter(|left| left.reason.is_thin()).map(|left| left.area).sum::<f64>();
        found.assemble(positions, triangles, &sheet);
        (found, deviation)
    }

    fn assemble(&mut self, positions: &[Vec3], triangles: &[[u32; 3]], sheet: &Sheet) {
        if sheet.triangles.is_empty() {
            self.positions = positions.to_vec();
            self.triangles = triangles.to_vec();
            self.half_thickness = vec![0.0; positions.len()];
            return;
        }
        let mut add = |corners: [u32; 3], names: &mut Vec<u32>, position: &dyn Fn(usize) -> (Vec3, f32)| {
            let corners = corners.map(|vertex| {
                let name = &mut names[vertex as usize];
                if *name == UNUSED {
                    *name = self.positions.len() as u32;
                    let (position, half) = position(vertex as usize);
                    self.positions.push(position);
                    self.half_thickness.push(half);
                }
                *name
            });
            self.triangles.push(corners);
        };
        let mut names = vec![UNUSED; sheet.points.len()];
        for &corners in &sheet.triangles {
            add(corners, &mut names, &|vertex| (sheet.points[vertex].as_vec3(), sheet.halves[vertex] as f32));
        }
        let mut names = vec![UNUSED; positions.len()];
        for &triangle in &self.left {
            add(triangles[triangle as usize], &mut names, &|vertex| (positions[vertex], 0.0));
        }
    }
}

/// The same triangle, wound the other way.
fn turned([a, b, c]: [u32; 3]) -> [u32; 3] {
    [a, c, b]
}

/// The triangles whose sheet is too far from them, worst first, as many as may be left.
fn inaccurate(body: &Body, fates: &[Fate], errors: &[f64], most: f64) -> Vec<usize> {
    let (mut replaced, mut thin) = (0.0, 0.0);
    for (fate, area) in fates.iter().zip(&body.areas) {
        match fate {
            Fate::Replaced { .. } => (replaced, thin) = (replaced + area, thin + area),
            Fate::Left(reason) => thin += if reason.is_thin() { *area } else { 0.0 },
        }
    }
    let mut found: Vec<usize> =
        (0..fates.len()).filter(|&triangle| errors[triangle] > most && fates[triangle].is_replaced()).collect();
    found.sort_by(|&a, &b| errors[b].total_cmp(&errors[a]).then(a.cmp(&b)));
    let mut room = replaced - LEAST_REPLACED * thin;
    found.retain(|&triangle| {
        // What is opposite is left, too.
        room -= 2.0 * body.areas[triangle];
        room >= 0.0
    });
    found
}
