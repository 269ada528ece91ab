//! Draws pairs of triangles whose boxes overlap, by their fate.

use glam::{DVec3, Vec3};
use rerun::{AsComponents, LineStrips3D};

use super::{
    colors,
    recorder::{Layer, TickWriter, path, row_bytes},
    settings::LevelOfDetail,
    tick::{ALL_PAIRS, Detected, MANY_PAIRS, Names, Touches},
    values,
};
use crate::{
    detection::{OtherSide, SurfacePair},
    kernel::pair_fate::PairFate,
    surface::ActiveSurface,
};

/// A pair of surfaces, with its pairs of triangles by fate.
struct DrawnPair<'a> {
    pair: &'a SurfacePair,
    name: String,
    by_fate: Vec<Vec<[u32; 2]>>,
}

/// Draws all pairs.
pub(super) fn draw(
    writer: &mut TickWriter,
    detected: &Detected,
    level: LevelOfDetail,
    names: &Names,
    touches: &Touches,
) {
    if level == LevelOfDetail::Off {
        return;
    }
    let mut drawn = Vec::new();
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
        drawn.push(DrawnPair { pair, name: names.of_pair(detected.sides(pair)), by_fate });
    }
    drawn.retain(|pair: &DrawnPair| pair.by_fate.iter().any(|pairs| !pairs.is_empty()));
    let is_mixed = drawn.len() > MANY_PAIRS;
    // Look up positions once, because checking the positions of a surface visits all of them.
    let place = |surface| Placed { surface, positions: detected.surface(surface).map(|(positions, _)| positions) };
    let placed: Vec<Placed> = detected.active.surfaces.iter().map(place).collect();
    // Start with the pairs that passed the most steps: they are the most informative.
    for fate in PairFate::ALL.into_iter().rev() {
        let lists = || drawn.iter().map(|drawn| &drawn.by_fate[fate as usize]);
        let filled = if is_mixed { 1 } else { lists().filter(|pairs| !pairs.is_empty()).count() };
        let mut share = writer.share(Layer::Pairs, lists().map(Vec::len).sum(), 4 * 12 + 4 + 8, filled, row_bytes(6));
        let mut row = Row::default();
        for DrawnPair { pair, name, by_fate } in &drawn {
            let pairs = &by_fate[fate as usize];
            for place in share.places(pairs.len()) {
                row.lines.push(line(&placed, pair, pairs[place]));
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

/// A line between the centers of two triangles. For a pair with a rigid shape, the outline of the triangle.
fn line(surfaces: &[Placed], pair: &SurfacePair, [a, b]: [u32; 2]) -> Vec<[f32; 3]> {
    let first = surfaces[pair.first].corners(a);
    match pair.second {
        OtherSide::Surface(second) => {
            let center = |corners: [DVec3; 3]| (corners.iter().sum::<DVec3>() / 3.0).as_vec3().to_array();
            vec![center(first), center(surfaces[second].corners(b))]
        }
        OtherSide::Shape(_) => [0, 1, 2, 0].map(|corner| first[corner].as_vec3().to_array()).to_vec(),
    }
}

/// A surface and its vertices in its own frame; `None` if it is gone.
struct Placed<'a> {
    surface: &'a ActiveSurface,
    positions: Option<&'a [Vec3]>,
}

impl Placed<'_> {
    /// The corners of a triangle in world space; all at the origin if the surface is gone.
    fn corners(&self, triangle: u32) -> [DVec3; 3] {
        let Some(positions) = self.positions else { return [DVec3::ZERO; 3] };
        self.surface.topology.triangles()[triangle as usize]
            .map(|vertex| self.surface.pose.transform_point(positions[vertex as usize].as_dvec3()))
    }
}
