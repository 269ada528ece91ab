//! Makes rows before the exact test, for surfaces whose triangles are in many of its pairs.

use crate::{
    detection::{
        pairs::{OtherSide, SurfacePair},
        parallel::fill_chunks,
        state::{SurfaceState, rows::SurfaceRows},
    },
    kernel::mesh::corner_rows::CornerRows,
    surface::{ActiveSurfaces, ContactMethod},
};

/// Rows per task.
const CHUNK: usize = 4096;

/// Makes the rows of surfaces that are in at least as many of `pairs` as they have triangles.
pub(in crate::detection) fn fill_rows<'a>(
    active: &ActiveSurfaces,
    pairs: impl Iterator<Item = &'a SurfacePair>,
    threads: usize,
    counts: &mut Vec<usize>,
    states: &mut [SurfaceState],
) {
    counts.clear();
    counts.resize(active.surfaces.len(), 0);
    for pair in pairs.filter(|pair| matches!(pair.method, ContactMethod::Closest | ContactMethod::Exact)) {
        if let OtherSide::Surface(second) = pair.second {
            counts[pair.first] += pair.triangles.len();
            counts[second] += pair.triangles.len();
        }
    }
    for ((surface, state), &count) in active.surfaces.iter().zip(states).zip(counts.iter()) {
        let SurfaceState { rows, bounds, .. } = state;
        let triangles = surface.topology.triangles();
        if count < triangles.len() || rows.current(bounds).is_some() {
            continue;
        }
        let SurfaceRows { rows, version } = rows;
        *version = bounds.version();
        fill_chunks(triangles, rows.resize(triangles.len()), CHUNK, threads, |first, _, rows| {
            CornerRows::fill(rows, first as u32, &surface.topology, bounds.positions());
        });
    }
}
