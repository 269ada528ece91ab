//! Before the exact test: the rows of those surfaces whose triangles are in many of its pairs.

use bevy_ecs::prelude::*;

use super::{
    bounds::TriangleBounds,
    broad_phase::{OtherSide, SurfacePair},
    parallel::fill_chunks,
};
use crate::{
    kernel::mesh::corner_rows::CornerRows,
    surface::{ActiveSurfaces, ContactMethod, SurfacePositions},
};

/// Rows that one thread writes at a time.
const CHUNK: usize = 4096;

/// The rows of a surface's triangles, as old as the tick in which they were needed last.
#[derive(Component, Clone, Debug, Default)]
pub struct SurfaceRows {
    rows: CornerRows,
    /// How many times the boxes had been computed when the rows followed them last.
    followed: u64,
}

impl SurfaceRows {
    /// The rows, where they are those of the positions that the boxes are of.
    pub(super) fn current(&self, bounds: &TriangleBounds) -> Option<&CornerRows> {
        (self.followed == bounds.computed()).then_some(&self.rows)
    }
}

/// Makes the rows of the surfaces that are in more of `pairs` than they have triangles.
pub(super) fn fill_rows<'a>(
    active: &ActiveSurfaces,
    pairs: impl Iterator<Item = &'a SurfacePair>,
    threads: usize,
    counts: &mut Vec<usize>,
    surfaces: &mut Query<(&SurfacePositions, &TriangleBounds, &mut SurfaceRows)>,
) {
    counts.clear();
    counts.resize(active.surfaces.len(), 0);
    for pair in pairs.filter(|pair| matches!(pair.method, ContactMethod::Closest | ContactMethod::Refined)) {
        if let OtherSide::Surface(second) = pair.second {
            counts[pair.first] += pair.triangles.len();
            counts[second] += pair.triangles.len();
        }
    }
    for (surface, &count) in active.surfaces.iter().zip(counts.iter()) {
        let Ok((positions, bounds, mut rows)) = surfaces.get_mut(surface.entity) else { continue };
        let triangles = surface.topology.triangles();
        if count < triangles.len() || rows.current(bounds).is_some() {
            continue;
        }
        let SurfaceRows { rows, followed } = &mut *rows;
        *followed = bounds.computed();
        fill_chunks(triangles, rows.resize(triangles.len()), CHUNK, threads, |first, _, rows| {
            CornerRows::fill(rows, first as u32, &surface.topology, &positions.0);
        });
    }
}
