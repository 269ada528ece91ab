//! Draws the curved patches of smooth surfaces, over the outlines of their flat triangles.
//!
//! Everything is drawn in the surface's own frame, together with the pose.

use glam::Vec3;
use rerun::{AsComponents, LineStrips3D, Mesh3D};

use super::{
    colors,
    names::{Names, transform},
    recorder::{Layer, TickWriter, path, row_bytes},
    values,
};
use crate::{
    debug::{
        LevelOfDetail,
        patches::{SEGMENTS, outline, smooth, triangles, weights},
        tick::{Detected, Touches},
    },
    kernel::smooth::patch::Patch,
};

/// The numbers of points and triangles of a patch as it is drawn.
const POINTS: usize = ((SEGMENTS + 1) * (SEGMENTS + 2) / 2) as usize;
const TRIANGLES: usize = (SEGMENTS * SEGMENTS) as usize;

/// Bytes of a patch: positions and normals, triangles, the outline, and a number.
const BYTES: usize = 24 * POINTS + 12 * TRIANGLES + 4 * 12 + 4 + 4;

pub(super) fn draw(
    writer: &mut TickWriter,
    detected: &Detected,
    level: LevelOfDetail,
    names: &Names,
    touches: &Touches,
) {
    let smooth: Vec<_> = smooth(detected, level, touches).collect();
    let count = smooth.iter().map(|(.., triangles)| triangles.len()).sum();
    let filled = smooth.iter().filter(|(.., triangles)| !triangles.is_empty()).count();
    let mut share = writer.share(Layer::Patches, count, BYTES, filled, row_bytes(10));
    for (surface, state, wanted) in smooth {
        let kept: Vec<u32> = share.places(wanted.len()).into_iter().map(|place| wanted[place]).collect();
        if kept.is_empty() {
            continue;
        }
        let Some(patches) = state.patches(&surface.topology, &kept) else { continue };
        let at_points = |value: fn(&Patch, &[f64; 3]) -> Vec3| {
            let all = patches.iter().flat_map(move |patch| weights().map(move |weights| value(patch, &weights)));
            all.map(|value| value.to_array())
        };
        let own = |patch: usize| triangles().map(move |corners| corners.map(|point| point + (patch * POINTS) as u32));
        let mesh = Mesh3D::update_fields()
            .with_vertex_positions(at_points(|patch, weights| patch.point(weights).as_vec3()))
            .with_vertex_normals(at_points(|patch, weights| patch.normal(weights).as_vec3()))
            .with_triangle_indices((0..patches.len()).flat_map(own))
            .with_albedo_factor(colors::PATCHES);
        let outlines = patches.iter().map(|patch| outline(patch).map(|corner| corner.to_array()));
        let outlines = LineStrips3D::new(outlines).with_colors([colors::OUTLINES]).with_radii([colors::THIN]);
        let pose = transform(&surface.pose);
        let rows: [&dyn AsComponents; 4] = [&mesh, &outlines, &values::triangles(&kept), &pose];
        writer.passing_row(path([Layer::Patches.name(), &names.of(surface.entity)]), &rows);
    }
}
