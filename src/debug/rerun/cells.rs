//! Draws the occupied cells of spatial hashes.

use std::collections::BTreeMap;

use rerun::{AnyValues, AsComponents, Boxes3D, FillMode};

use super::{
    colors,
    names::{Names, transform},
    recorder::{Layer, TickWriter, path, row_bytes},
    values,
};
use crate::{
    debug::{
        LevelOfDetail,
        tick::{Detected, Touches},
    },
    detection::{Frame, OtherSide, SurfacePair, UsedHash},
    kernel::{mesh::bounds::Aabb, spatial_hash::OccupiedCell},
};

/// The cells of one level in the frame of one surface: where they are, and how many triangles are in each.
type Cells = Vec<(Aabb, u32)>;

/// Draws the cells of all pairs of surfaces, below the surface in whose frame they are.
pub(super) fn draw(
    writer: &mut TickWriter,
    detected: &Detected,
    hash: Option<UsedHash>,
    level: LevelOfDetail,
    names: &Names,
    touches: &Touches,
) {
    let Some(hash) = hash.filter(|_| level != LevelOfDetail::Off) else { return };
    let mut by_level: BTreeMap<(usize, u8), Cells> = BTreeMap::new();
    for pair in &detected.candidates.pairs {
        let Some(sides) = surfaces(pair) else { continue };
        let framed = sides[usize::from(pair.frame == Frame::Second)];
        let firsts = detected.active.surfaces[pair.first].topology.triangles().len();
        let is_wanted = |cell: &OccupiedCell| {
            cell.items.iter().any(|&item| match (item as usize).checked_sub(firsts) {
                None => touches.wants(level, sides[0], item),
                Some(second) => touches.wants(level, sides[1], second as u32),
            })
        };
        for cell in hash.occupied_cells(&detected.active, &detected.states, pair).into_iter().filter(is_wanted) {
            by_level.entry((framed, cell.level)).or_default().push((cell.bounds, cell.items.len() as u32));
        }
    }
    let count = by_level.values().map(Vec::len).sum();
    let mut share = writer.share(Layer::Cells, count, 12 + 12 + 4, by_level.len(), row_bytes(8));
    for (&(framed, level), cells) in &by_level {
        let kept: Cells = share.places(cells.len()).into_iter().map(|place| cells[place]).collect();
        if kept.is_empty() {
            continue;
        }
        let surface = &detected.active.surfaces[framed];
        let counts: Vec<u32> = kept.iter().map(|&(_, count)| count).collect();
        let boxes = Boxes3D::from_centers_and_half_sizes(
            kept.iter().map(|(bounds, _)| ((bounds.min + bounds.max) * 0.5).to_array()),
            kept.iter().map(|(bounds, _)| ((bounds.max - bounds.min) * 0.5).to_array()),
        )
        .with_colors([colors::LEVELS[usize::from(level) % colors::LEVELS.len()]])
        .with_fill_mode(FillMode::MajorWireframe)
        .with_radii([colors::THIN]);
        let values = values::whole(AnyValues::default(), "triangles", &counts);
        let rows: [&dyn AsComponents; 3] = [&boxes, &values, &transform(&surface.pose)];
        let group = format!("level {level:02}");
        writer.passing_row(path([Layer::Cells.name(), &names.of(surface.entity), &group]), &rows);
    }
}

/// The sides of a pair of surfaces. `None` if one is a shape.
fn surfaces(pair: &SurfacePair) -> Option<[usize; 2]> {
    match pair.second {
        OtherSide::Surface(second) => Some([pair.first, second]),
        OtherSide::Shape(_) => None,
    }
}
