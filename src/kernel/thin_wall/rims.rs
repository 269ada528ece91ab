//! Extends sheets into rounded and chamfered rims.
//!
//! A sheet ends where the faces of its wall do, and its thickness ends there at a right angle. A rim that bulges farther is
//! replaced best by one that ends between its edges and its tip.

use glam::DVec3;

use super::{
    body::Body,
    seams::Places,
    sheet::{Constraint, FARTHEST_MOVE, Sheet, meet},
    walls::Walls,
};

/// How far to extend, as a share of the way to the tip of the rim. Of a semicircle and of a wedge of 45°, no part is then
/// farther than a quarter of the thickness from the square rim.
const SHARE: f64 = 2.0 / 3.0;

/// A rim does not bulge farther than this, in half-thicknesses: beyond is something else.
const MOST_BULGE: f64 = 1.6;

/// Bulges below this share of half the thickness are none.
const LEAST_BULGE: f64 = 0.05;

/// Where to look, in half-thicknesses from the middle: a ray exactly through an edge may miss both of its triangles.
const RAYS: [f64; 3] = [-0.07, 0.0, 0.05];

/// How far within the sheet rays start, in half-thicknesses.
const RAY_START: f64 = 0.3;

/// A border nearer than this share of half the thickness to another part of the sheet is attached there.
const ATTACHED_SHARE: f64 = 0.05;

/// Moves the free borders of a sheet outwards, except those towards walls that are left.
pub(super) fn extend(body: &Body, walls: &Walls, sheet: &mut Sheet) {
    let mut is_beside_left = vec![false; body.points.len()];
    for triangle in (0..body.triangle_count()).filter(|&triangle| walls.is_left(triangle)) {
        for vertex in body.vertices(triangle) {
            is_beside_left[vertex] = true;
        }
    }
    let places = Places::new(sheet);
    let place_count = places.of.iter().map(|&place| place as usize + 1).max().unwrap_or(0);
    let middle = sheet.facets();
    let mut constraints: Vec<Vec<Constraint>> = vec![Vec::new(); place_count];
    for (triangle, edge) in places.borders() {
        let corners = sheet.corners(triangle);
        let [a, b, c] = [edge, (edge + 1) % 3, (edge + 2) % 3].map(|k| corners[k]);
        let along = (b - a).normalize_or_zero();
        let out = -(c - a).reject_from_normalized(along).normalize_or_zero();
        let ends = [edge, (edge + 1) % 3].map(|k| sheet.triangles[triangle][k]);
        let is_beside = |end: u32| sheet.origins[end as usize].iter().all(|&origin| is_beside_left[origin as usize]);
        if along == DVec3::ZERO || out == DVec3::ZERO || ends.into_iter().all(is_beside) {
            continue;
        }
        let half = 0.5 * ends.map(|vertex| sheet.halves[vertex as usize]).iter().sum::<f64>();
        let point = a.midpoint(b);
        let is_attached = middle
            .closest(point, ATTACHED_SHARE * half, |other, _| {
                let is_beside = ends.iter().any(|&end| {
                    let place = places.of[end as usize];
                    sheet.triangles[other as usize].iter().any(|&vertex| places.of[vertex as usize] == place)
                });
                !is_beside
            })
            .is_some();
        let normal = along.cross(out);
        let bulge = RAYS
            .iter()
            .filter_map(|share| {
                let from = point - out * (RAY_START * half) + normal * (share * half);
                body.facets.first_hit(from, out, (RAY_START + MOST_BULGE) * half)
            })
            .fold(f64::INFINITY, f64::min)
            - RAY_START * half;
        // A border that does not move holds its ends.
        let is_rim = !is_attached && bulge > LEAST_BULGE * half && bulge <= MOST_BULGE * half;
        let depth = if is_rim { SHARE * bulge } else { 0.0 };
        for end in ends {
            let weight = a.distance(b);
            constraints[places.of[end as usize] as usize].push(Constraint { normal: -out, depth, weight });
        }
    }
    for (point, &place) in sheet.points.iter_mut().zip(&places.of) {
        let around = &constraints[place as usize];
        if around.iter().any(|constraint| constraint.depth > 0.0) {
            *point += meet(around, FARTHEST_MOVE);
        }
    }
}
