//! Connects the sheets of walls that meet.
//!
//! Vertices of borders that have moved to one place get exactly the same position, so that whoever welds the sheet finds
//! them connected. A border gets a vertex where it passes one of another border.

use std::collections::BTreeMap;

use glam::DVec3;

use super::{body::Facets, sheet::Sheet};

/// Borders nearer than this share of half the thickness are one.
const SEAM_SHARE: f64 = 5.0e-2;

/// Exactly equal positions as one number, and the triangles at each edge.
pub(super) struct Places {
    /// The place of each vertex.
    pub(super) of: Vec<u32>,
    /// For the two places of an edge, lower first, its triangles, and which of their edges it is.
    pub(super) edges: BTreeMap<[u32; 2], Vec<(u32, u8)>>,
}

impl Places {
    pub(super) fn new(sheet: &Sheet) -> Self {
        let mut names = BTreeMap::new();
        let of: Vec<u32> = sheet
            .points
            .iter()
            .map(|point| {
                // Adding 0 turns −0 into 0.
                let bits = point.to_array().map(|coordinate| (coordinate + 0.0).to_bits());
                let next = names.len() as u32;
                *names.entry(bits).or_insert(next)
            })
            .collect();
        let mut edges: BTreeMap<[u32; 2], Vec<(u32, u8)>> = BTreeMap::new();
        for (corners, triangle) in sheet.triangles.iter().zip(0..) {
            for k in 0..3 {
                let ends = [of[corners[k] as usize], of[corners[(k + 1) % 3] as usize]];
                edges.entry([ends[0].min(ends[1]), ends[0].max(ends[1])]).or_default().push((triangle, k as u8));
            }
        }
        Self { of, edges }
    }

    /// The edges of walls: those of only one triangle of a wall, whether or not another wall is attached there.
    fn wall_borders(&self, sheet: &Sheet) -> Vec<(usize, usize)> {
        let mut borders = Vec::new();
        for triangles in self.edges.values() {
            let wall = |triangle: u32| sheet.walls[triangle as usize];
            borders.extend(
                triangles
                    .iter()
                    .filter(|&&(own, _)| triangles.iter().filter(|&&(other, _)| wall(other) == wall(own)).count() == 1)
                    .map(|&(triangle, edge)| (triangle as usize, usize::from(edge))),
            );
        }
        borders
    }

    /// The edges of one triangle only.
    pub(super) fn borders(&self) -> impl Iterator<Item = (usize, usize)> {
        self.edges.values().filter_map(|triangles| match triangles.as_slice() {
            &[(triangle, edge)] => Some((triangle as usize, usize::from(edge))),
            _ => None,
        })
    }
}

/// Connects borders.
pub(super) fn connect(sheet: &mut Sheet) {
    snap(sheet);
    drop_collapsed(sheet);
    split(sheet);
    drop_collapsed(sheet);
}

/// Gives border vertices that are near each other one position.
fn snap(sheet: &mut Sheet) {
    let places = Places::new(sheet);
    let mut is_border = vec![false; sheet.points.len()];
    for (triangle, edge) in places.wall_borders(sheet) {
        let corners = sheet.triangles[triangle];
        is_border[corners[edge] as usize] = true;
        is_border[corners[(edge + 1) % 3] as usize] = true;
    }
    let border: Vec<usize> = (0..is_border.len()).filter(|&vertex| is_border[vertex]).collect();
    let points = Facets::new(border.iter().map(|&vertex| [sheet.points[vertex]; 3]).collect());
    let mut moved: BTreeMap<u32, DVec3> = BTreeMap::new();
    for &vertex in &border {
        let point = sheet.points[vertex];
        let range = SEAM_SHARE * sheet.halves[vertex];
        let mut lowest = vertex;
        points.closest(point, range, |other, _| {
            lowest = lowest.min(border[other as usize]);
            false
        });
        if lowest != vertex {
            let target = moved.get(&places.of[lowest]).copied().unwrap_or(sheet.points[lowest]);
            moved.entry(places.of[vertex]).or_insert(target);
        }
    }
    for (vertex, place) in places.of.iter().enumerate() {
        if let Some(&target) = moved.get(place) {
            sheet.points[vertex] = target;
        }
    }
}

/// Drops triangles with two corners at one position.
fn drop_collapsed(sheet: &mut Sheet) {
    let points = &sheet.points;
    let is_kept: Vec<bool> = sheet
        .triangles
        .iter()
        .map(|corners| {
            let [a, b, c] = corners.map(|vertex| points[vertex as usize]);
            a != b && b != c && c != a
        })
        .collect();
    let mut kept = is_kept.iter();
    sheet.triangles.retain(|_| *kept.next().expect("one for each"));
    let mut kept = is_kept.iter();
    sheet.walls.retain(|_| *kept.next().expect("one for each"));
    let mut kept = is_kept.iter();
    sheet.faces.retain(|_| *kept.next().expect("one for each"));
}

/// Splits triangles whose border edges pass border vertices.
fn split(sheet: &mut Sheet) {
    let places = Places::new(sheet);
    let mut is_border = vec![[false; 3]; sheet.triangles.len()];
    let mut passed: BTreeMap<u32, usize> = BTreeMap::new();
    for (triangle, edge) in places.wall_borders(sheet) {
        is_border[triangle][edge] = true;
        for vertex in [sheet.triangles[triangle][edge], sheet.triangles[triangle][(edge + 1) % 3]] {
            passed.entry(places.of[vertex as usize]).or_insert(vertex as usize);
        }
    }
    let border: Vec<usize> = passed.into_values().collect();
    let points = Facets::new(border.iter().map(|&vertex| [sheet.points[vertex]; 3]).collect());
    let mut open: Vec<(usize, [bool; 3])> =
        is_border.into_iter().enumerate().filter(|(_, edges)| edges.contains(&true)).collect();
    while let Some((triangle, borders)) = open.pop() {
        let corners = sheet.triangles[triangle];
        let passing = (0..3).filter(|&edge| borders[edge]).find_map(|edge| {
            let ends = [corners[edge], corners[(edge + 1) % 3]].map(|vertex| vertex as usize);
            middle_vertex(sheet, &points, &border, ends).map(|(vertex, along)| (edge, vertex, along))
        });
        let Some((edge, vertex, along)) = passing else { continue };
        let [a, b, c] = [corners[edge], corners[(edge + 1) % 3], corners[(edge + 2) % 3]];
        let half = sheet.halves[a as usize] * (1.0 - along) + sheet.halves[b as usize] * along;
        let between = sheet.points.len() as u32;
        sheet.points.push(sheet.points[vertex]);
        sheet.halves.push(half);
        sheet.origins.push([sheet.origins[a as usize][0], sheet.origins[b as usize][1]]);
        let [first, second, third] = [edge, (edge + 1) % 3, (edge + 2) % 3].map(|edge| borders[edge]);
        let added = sheet.triangles.len();
        sheet.triangles[triangle] = [a, between, c];
        sheet.triangles.push([between, b, c]);
        sheet.walls.push(sheet.walls[triangle]);
        sheet.faces.push(sheet.faces[triangle]);
        open.push((triangle, [first, false, third]));
        open.push((added, [first, second, false]));
    }
}

/// The border vertex on the segment between two others that is nearest its middle, and where it is.
fn middle_vertex(sheet: &Sheet, points: &Facets, border: &[usize], ends: [usize; 2]) -> Option<(usize, f64)> {
    let [from, to] = ends.map(|vertex| sheet.points[vertex]);
    let way = to - from;
    let length = way.length();
    let seam = SEAM_SHARE * sheet.halves[ends[0]].min(sheet.halves[ends[1]]);
    let mut best: Option<(f64, usize, f64)> = None;
    points.closest(from.midpoint(to), 0.5 * length, |other, _| {
        let point = sheet.points[border[other as usize]];
        let along = (point - from).dot(way) / (length * length);
        // A seam may be so narrow that an end is beyond it only by rounding.
        let is_end = point == from || point == to;
        let is_between = !is_end && along * length > seam && (1.0 - along) * length > seam;
        if is_between && point.distance(from + way * along) <= seam {
            let vertex = border[other as usize];
            let off = (along - 0.5).abs();
            if best.is_none_or(|(least, number, _)| (off, vertex) < (least, number)) {
                best = Some((off, vertex, along));
            }
        }
        false
    });
    best.map(|(_, vertex, along)| (vertex, along))
}
