//! Draws pairs of triangles whose boxes overlap, by their fate.

use glam::Vec3;
use rerun::{AsComponents, LineStrips3D};

use super::{
    colors,
    names::{ALL_PAIRS, MANY_PAIRS, Names, sides},
    recorder::{Layer, TickWriter, path, row_bytes},
    values,
};
use crate::{
    debug::{
        LevelOfDetail,
        pairs::{PairsByFate, Placed, by_fate, line},
        tick::{Detected, Touches},
    },
    kernel::pair_fate::PairFate,
};

/// Draws all pairs.
pub(super) fn draw(
    writer: &mut TickWriter,
    detected: &Detected,
    level: LevelOfDetail,
    names: &Names,
    touches: &Touches,
) {
    let drawn = by_fate(detected, level, touches);
    let named: Vec<String> = drawn.iter().map(|drawn| names.of_pair(sides(&detected.active, drawn.pair))).collect();
    let is_mixed = drawn.len() > MANY_PAIRS;
    let placed = Placed::all(detected);
    // Start with the pairs that passed the most steps: they are the most informative.
    for fate in PairFate::ALL.into_iter().rev() {
        let lists = || drawn.iter().map(|drawn| &drawn.by_fate[fate as usize]);
        let filled = if is_mixed { 1 } else { lists().filter(|pairs| !pairs.is_empty()).count() };
        let mut share = writer.share(Layer::Pairs, lists().map(Vec::len).sum(), 4 * 12 + 4 + 8, filled, row_bytes(6));
        let mut row = Row::default();
        for (PairsByFate { pair, by_fate }, name) in drawn.iter().zip(&named) {
            let pairs = &by_fate[fate as usize];
            for place in share.places(pairs.len()) {
                row.lines.push(line(&placed, pair, pairs[place]).iter().map(Vec3::to_array).collect());
                row.triangles.push(pairs[place]);
                row.names.push(name);
            }
            if !is_mixed {
                std::mem::take(&mut row).write(writer, fate, name);
            }
        }
        row.write(writer, fate, ALL_PAIRS);
    }
}

/// Pairs of triangles that form one row.
#[derive(Default)]
struct Row<'a> {
    lines: Vec<Vec<[f32; 3]>>,
    triangles: Vec<[u32; 2]>,
    /// Names of their pairs of surfaces.
    names: Vec<&'a str>,
}

impl Row<'_> {
    fn write(self, writer: &mut TickWriter, fate: PairFate, name: &str) {
        if self.lines.is_empty() {
            return;
        }
        let strips = LineStrips3D::new(self.lines).with_colors([colors::fate(fate)]).with_radii([colors::THIN]);
        let mut values = values::triangle_pairs(&self.triangles);
        if name == ALL_PAIRS {
            values = values::texts(values, "pair", self.names.into_iter());
        }
        let rows: [&dyn AsComponents; 2] = [&strips, &values];
        writer.passing_row(path([Layer::Pairs.name(), fate.name(), name]), &rows);
    }
}
