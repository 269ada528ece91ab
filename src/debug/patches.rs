//! The curved patches of smooth surfaces as points and triangles, in the surface's own frame.

use glam::{DVec3, Vec3};

use super::{
    LevelOfDetail,
    tick::{Detected, Touches},
};
use crate::{detection::SurfaceState, kernel::smooth::patch::Patch, surface::ActiveSurface};

/// Each edge of a patch is drawn as this many segments.
pub(super) const SEGMENTS: u32 = 4;

/// The weights of the corners at the points, row by row from the first corner.
pub(super) fn weights() -> impl Iterator<Item = [f64; 3]> {
    let share = |part: u32| f64::from(part) / f64::from(SEGMENTS);
    (0..=SEGMENTS).flat_map(move |row| (0..=row).map(move |at| [1.0 - share(row), share(row - at), share(at)]))
}

/// The triangles between the points.
pub(super) fn triangles() -> impl Iterator<Item = [u32; 3]> {
    // A row begins after those above it.
    let point = |row: u32, at: u32| row * (row + 1) / 2 + at;
    (0..SEGMENTS).flat_map(move |row| {
        let upright = (0..=row).map(move |at| [point(row, at), point(row + 1, at), point(row + 1, at + 1)]);
        let turned = (0..row).map(move |at| [point(row, at), point(row + 1, at + 1), point(row, at + 1)]);
        upright.chain(turned)
    })
}

/// The flat triangle below a patch.
pub(super) fn outline(patch: &Patch) -> [Vec3; 4] {
    let [a, b, c] = patch.corners.map(DVec3::as_vec3);
    [a, b, c, a]
}

/// The smooth surfaces, with the triangles whose patches are shown at a level of detail.
pub(super) fn smooth<'a>(
    detected: &'a Detected,
    level: LevelOfDetail,
    touches: &'a Touches,
) -> impl Iterator<Item = (&'a ActiveSurface, &'a SurfaceState, Vec<u32>)> {
    detected.active.surfaces.iter().enumerate().filter_map(move |(place, surface)| {
        let state = detected.states.get(surface.entity).filter(|state| state.is_smooth())?;
        Some((surface, state, touches.triangles(level, place)))
    })
}
