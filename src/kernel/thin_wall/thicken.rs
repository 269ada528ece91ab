//! The surface of a sheet with its thickness: both sides, and strips along its borders.

use glam::DVec3;

use super::{
    body::Facets,
    seams::Places,
    sheet::{Constraint, Sheet, meet},
};
use crate::kernel::mesh::barycentric::barycentric_of;

/// What is this share of half a thickness below the surface is inside.
const INSIDE_SHARE: f64 = 0.98;

/// A sheet does not count within this share of half its thickness from its border.
const BORDER_SHARE: f64 = 0.02;

/// The surface of a sheet with thickness. Where walls meet, it includes what is inside of others.
pub(super) struct Thickened {
    pub(super) surface: Facets,
    /// For each triangle of the surface, the triangle of the sheet.
    pub(super) sources: Vec<u32>,
    /// The triangles of the sheet.
    middle: Facets,
    halves: Vec<[f64; 3]>,
    is_border: Vec<[bool; 3]>,
    most: f64,
}

impl Thickened {
    pub(super) fn new(sheet: &Sheet) -> Self {
        let places = Places::new(sheet);
        let offsets = corner_offsets(sheet, &places);
        let (mut corners, mut sources) = (Vec::new(), Vec::new());
        for triangle in 0..sheet.triangles.len() {
            let points = sheet.corners(triangle);
            corners.push([0, 1, 2].map(|k| points[k] + offsets[triangle][k][0]));
            corners.push([0, 1, 2].map(|k| points[k] + offsets[triangle][k][1]));
            sources.extend([triangle as u32; 2]);
        }
        let mut is_border = vec![[false; 3]; sheet.triangles.len()];
        for (triangle, edge) in places.borders() {
            is_border[triangle][edge] = true;
            let points = sheet.corners(triangle);
            let [a, b] = [edge, (edge + 1) % 3].map(|k| offsets[triangle][k].map(|offset| points[k] + offset));
            corners.push([a[0], a[1], b[1]]);
            corners.push([a[0], b[1], b[0]]);
            sources.extend([triangle as u32; 2]);
        }
        let halves =
            sheet.triangles.iter().map(|corners| corners.map(|vertex| sheet.halves[vertex as usize])).collect();
        Self {
            surface: Facets::new(corners),
            sources,
            middle: Facets::new((0..sheet.triangles.len()).map(|triangle| sheet.corners(triangle)).collect()),
            halves,
            is_border,
            most: sheet.halves.iter().copied().fold(0.0, f64::max),
        }
    }

    /// The largest half-thickness.
    pub(super) fn reach(&self) -> f64 {
        self.most
    }

    /// The mean half-thickness below a triangle of the surface.
    pub(super) fn half(&self, triangle: u32) -> f64 {
        self.halves[self.sources[triangle as usize] as usize].iter().sum::<f64>() / 3.0
    }

    /// Whether a point is inside of the thickened sheet, clearly below its surface.
    pub(super) fn contains(&self, point: DVec3) -> bool {
        let mut is_inside = false;
        self.middle.closest(point, self.most, |triangle, closest| {
            let corners = &self.middle.corners[triangle as usize];
            let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero();
            let height = (point - closest).dot(normal).abs();
            let aside = (point - closest).length_squared() - height * height;
            let weights = barycentric_of(corners, closest);
            let half: f64 = (0..3).map(|k| weights[k] * self.halves[triangle as usize][k]).sum();
            let near_border = (0..3).any(|k| {
                self.is_border[triangle as usize][k]
                    && distance_to_line(corners[k], corners[(k + 1) % 3], closest) < BORDER_SHARE * half
            });
            is_inside |= !near_border && height < INSIDE_SHARE * half && aside <= (BORDER_SHARE * half).powi(2);
            false
        });
        is_inside
    }
}

fn distance_to_line(a: DVec3, b: DVec3, point: DVec3) -> f64 {
    (point - a).reject_from_normalized((b - a).normalize_or_zero()).length()
}

/// The unit normal of a triangle of the sheet, on the side of the face that it was.
fn normal(sheet: &Sheet, triangle: usize) -> DVec3 {
    let [a, b, c] = sheet.corners(triangle);
    let normal = (b - a).cross(c - a).normalize_or_zero();
    if normal == DVec3::ZERO { sheet.normals[triangle] } else { normal }
}

/// For each corner of each triangle, the way to the two sides: half the thickness from the planes of all triangles of
/// the wall around it. Where two walls end at a common edge, both have the same corner, as in a miter joint.
fn corner_offsets(sheet: &Sheet, places: &Places) -> Vec<[[DVec3; 2]; 3]> {
    let normals: Vec<DVec3> = (0..sheet.triangles.len()).map(|triangle| normal(sheet, triangle)).collect();
    let place_count = places.of.iter().map(|&place| place as usize + 1).max().unwrap_or(0);
    let mut around: Vec<Vec<(usize, usize)>> = vec![Vec::new(); place_count];
    for (triangle, corners) in sheet.triangles.iter().enumerate() {
        for k in 0..3 {
            around[places.of[corners[k] as usize] as usize].push((triangle, k));
        }
    }
    let mut offsets = vec![[[DVec3::ZERO; 2]; 3]; sheet.triangles.len()];
    for (place, triangles) in around.iter().enumerate() {
        let mut walls: Vec<u32> = triangles.iter().map(|&(triangle, _)| sheet.walls[triangle]).collect();
        walls.sort_unstable();
        walls.dedup();
        let miter = miter_turn(sheet, places, place as u32, triangles, &walls);
        for &wall in &walls {
            let way = |side: f64| {
                let constraints: Vec<Constraint> = triangles
                    .iter()
                    .filter_map(|&(triangle, k)| {
                        let turn = if sheet.walls[triangle] == wall { 1.0 } else { miter? };
                        let half = sheet.halves[sheet.triangles[triangle][k] as usize];
                        Some(Constraint { normal: normals[triangle] * (side * turn), depth: half, weight: 1.0 })
                    })
                    .collect();
                -meet(&constraints)
            };
            let sides = [way(1.0), way(-1.0)];
            for &(triangle, k) in triangles.iter().filter(|&&(triangle, _)| sheet.walls[triangle] == wall) {
                offsets[triangle][k] = sides;
            }
        }
    }
    offsets
}

/// Whether exactly two walls end at a place, each at the other: 1 if they face the same side across their common edges, −1
/// if they face opposite sides. `None` otherwise.
fn miter_turn(sheet: &Sheet, places: &Places, place: u32, triangles: &[(usize, usize)], walls: &[u32]) -> Option<f64> {
    if walls.len() != 2 {
        return None;
    }
    let mut turn = None;
    for &(triangle, k) in triangles {
        for edge in [k, (k + 2) % 3] {
            let corners = sheet.triangles[triangle];
            let ends = [corners[edge], corners[(edge + 1) % 3]].map(|vertex| places.of[vertex as usize]);
            debug_assert!(ends.contains(&place), "the edge is at the corner");
            let at_edge = &places.edges[&[ends[0].min(ends[1]), ends[0].max(ends[1])]];
            let other_wall = at_edge.iter().any(|&(other, _)| sheet.walls[other as usize] != sheet.walls[triangle]);
            if !other_wall {
                continue;
            }
            let &[(a, edge_a), (b, edge_b)] = at_edge.as_slice() else { return None };
            let start =
                |triangle: u32, edge: u8| places.of[sheet.triangles[triangle as usize][usize::from(edge)] as usize];
            let found = if start(a, edge_a) == start(b, edge_b) { -1.0 } else { 1.0 };
            if turn.is_some_and(|turn: f64| turn != found) {
                return None;
            }
            turn = Some(found);
        }
    }
    turn
}
