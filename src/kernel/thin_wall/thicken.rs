//! The surface of a sheet with its thickness: both sides, and strips along its borders.

use glam::DVec3;

use super::{
    body::{Body, Facets},
    depths::corner_angle,
    seams::Places,
    segments::Segments,
    sheet::{Constraint, FARTHEST_MOVE, FARTHEST_SMOOTH_MOVE, Sheet, meet},
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
    /// The vertices of the sheet at the border of each strip. The strips are the last triangles of the surface.
    pub(super) strips: Vec<[u32; 2]>,
    /// The triangles of the sheet.
    middle: Facets,
    halves: Vec<[f64; 3]>,
    is_border: Vec<[bool; 3]>,
    most: f64,
}

impl Thickened {
    pub(super) fn new(body: &Body, segments: &Segments, sheet: &Sheet) -> Self {
        let places = Places::new(sheet);
        let offsets = corner_offsets(body, segments, sheet, &places);
        let (mut corners, mut sources, mut strips) = (Vec::new(), Vec::new(), Vec::new());
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
            strips.extend([[edge, (edge + 1) % 3].map(|k| sheet.triangles[triangle][k]); 2]);
        }
        let halves =
            sheet.triangles.iter().map(|corners| corners.map(|vertex| sheet.halves[vertex as usize])).collect();
        Self {
            surface: Facets::new(corners),
            sources,
            strips,
            middle: sheet.facets(),
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
            let weights = barycentric_of(corners, closest);
            let half: f64 = (0..3).map(|k| weights[k] * self.halves[triangle as usize][k]).sum();
            let near_border = (0..3).any(|k| {
                self.is_border[triangle as usize][k]
                    && distance_to_line(corners[k], corners[(k + 1) % 3], closest) < BORDER_SHARE * half
            });
            // Beyond a crease, the closest point is on it.
            is_inside |= !near_border && point.distance_squared(closest) < (INSIDE_SHARE * half).powi(2);
            false
        });
        is_inside
    }
}

fn distance_to_line(a: DVec3, b: DVec3, point: DVec3) -> f64 {
    (point - a).reject_from_normalized((b - a).normalize_or_zero()).length()
}

/// The unit normal of a triangle of the sheet, on the side of the face that it was.
fn normal(body: &Body, sheet: &Sheet, triangle: usize) -> DVec3 {
    let [a, b, c] = sheet.corners(triangle);
    let normal = (b - a).cross(c - a).normalize_or_zero();
    let before = body.normals[sheet.faces[triangle] as usize];
    if normal == DVec3::ZERO {
        before
    } else if normal.dot(before) < 0.0 {
        // Turned over in its plane, when its corners moved along it.
        -normal
    } else {
        normal
    }
}

/// For each corner of each triangle, the way to the two sides: half the thickness from the planes of all triangles of the
/// fan around it. Where walls end at common edges, they have the same corner, as in a miter joint.
fn corner_offsets(body: &Body, segments: &Segments, sheet: &Sheet, places: &Places) -> Vec<[[DVec3; 2]; 3]> {
    let normals: Vec<DVec3> = (0..sheet.triangles.len()).map(|triangle| normal(body, sheet, triangle)).collect();
    let place_count = places.of.iter().map(|&place| place as usize + 1).max().unwrap_or(0);
    let mut around: Vec<Vec<(usize, usize)>> = vec![Vec::new(); place_count];
    for (triangle, corners) in sheet.triangles.iter().enumerate() {
        for k in 0..3 {
            around[places.of[corners[k] as usize] as usize].push((triangle, k));
        }
    }
    let mut offsets = vec![[[DVec3::ZERO; 2]; 3]; sheet.triangles.len()];
    for triangles in &around {
        for fan in fans(sheet, places, triangles) {
            let segment = |&(place, _): &(usize, f64)| segments.of[sheet.faces[triangles[place].0] as usize];
            let is_smooth = fan.iter().all(|own| segment(own) == segment(&fan[0]));
            let farthest = if is_smooth { FARTHEST_SMOOTH_MOVE } else { FARTHEST_MOVE };
            let way = |side: f64| {
                let constraints: Vec<Constraint> = fan
                    .iter()
                    .map(|&(place, turn)| {
                        let (triangle, k) = triangles[place];
                        let half = sheet.halves[sheet.triangles[triangle][k] as usize];
                        let points = sheet.corners(triangle);
                        let weight = corner_angle(points[(k + 1) % 3] - points[k], points[(k + 2) % 3] - points[k]);
                        Constraint { normal: normals[triangle] * (side * turn), depth: half, weight }
                    })
                    .collect();
                -meet(&constraints, farthest)
            };
            let sides = [way(1.0), way(-1.0)];
            for &(place, turn) in &fan {
                let (triangle, k) = triangles[place];
                offsets[triangle][k] = if turn > 0.0 { sides } else { [sides[1], sides[0]] };
            }
        }
    }
    offsets
}

/// The triangles around a place in fans: connected across edges of two triangles, and within a wall across the edges at
/// which other walls are attached. Each as a place in `triangles`, with 1 if it faces the same side as the first of its
/// fan, or −1.
fn fans(sheet: &Sheet, places: &Places, triangles: &[(usize, usize)]) -> Vec<Vec<(usize, f64)>> {
    let mut fans: Vec<Vec<(usize, f64)>> = Vec::new();
    let mut is_seen = vec![false; triangles.len()];
    for first in 0..triangles.len() {
        if is_seen[first] {
            continue;
        }
        is_seen[first] = true;
        let mut fan = vec![(first, 1.0)];
        let mut next = 0;
        while next < fan.len() {
            let (own, turn) = fan[next];
            let (triangle, k) = triangles[own];
            for edge in [k, (k + 2) % 3] {
                let Some((other, relative)) = across(sheet, places, triangle, edge) else { continue };
                let found = triangles.iter().position(|&(triangle, _)| triangle == other);
                if let Some(other) = found.filter(|&other| !is_seen[other]) {
                    is_seen[other] = true;
                    fan.push((other, turn * relative));
                }
            }
            next += 1;
        }
        fans.push(fan);
    }
    fans
}

/// The triangle that continues the sheet across an edge, and 1 if it faces the same side, or −1.
fn across(sheet: &Sheet, places: &Places, triangle: usize, edge: usize) -> Option<(usize, f64)> {
    let corners = sheet.triangles[triangle];
    let start = places.of[corners[edge] as usize];
    let end = places.of[corners[(edge + 1) % 3] as usize];
    let at_edge = &places.edges[&[start.min(end), start.max(end)]];
    let mut others = at_edge.iter().filter(|&&(other, _)| {
        let is_same_wall = sheet.walls[other as usize] == sheet.walls[triangle];
        other as usize != triangle && (at_edge.len() == 2 || is_same_wall)
    });
    let &(other, other_edge) = others.next().filter(|_| others.next().is_none())?;
    let other_start = places.of[sheet.triangles[other as usize][usize::from(other_edge)] as usize];
    Some((other as usize, if other_start == start { -1.0 } else { 1.0 }))
}
