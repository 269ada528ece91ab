//! Fits thickened sheets to both sides of their walls.
//!
//! The carrier of a sheet knows the thickness at its own vertices. Where the other side is uneven in between, each vertex
//! moves along its normal, and changes its thickness, by the mean distances of both sides around it.

use glam::DVec3;

use super::{
    body::Body,
    pairing::Pairing,
    seams::Places,
    segments::{NO_SEGMENT, Segments},
    sheet::Sheet,
    thicken::Thickened,
};
use crate::kernel::mesh::barycentric::barycentric_of;

/// How often vertices move. More rounds hardly bring the sides closer.
const ROUNDS: usize = 4;

/// Faces within this cosine of each other's normal are the same side.
const SIDE_COSINE: f64 = 0.5;

/// Faces farther from a side than this share of the largest half-thickness are no part of it.
const NEAR: f64 = 0.5;

/// The farthest that a side moves in a round, in half-thicknesses.
const MOST_STEP: f64 = 0.25;

/// Sides that are nearer than this, in half-thicknesses, fit.
const LEAST_STEP: f64 = 2.0e-3;

/// Walls whose half-thicknesses differ by less than this share are equally thick: what differs is how their triangles lie.
const EVEN: f64 = 0.01;

/// The weighted distance of the original from one side of a sheet at a vertex: positive outward.
#[derive(Clone, Copy, Default)]
struct Gap {
    sum: f64,
    weight: f64,
}

impl Gap {
    fn add(&mut self, distance: f64, weight: f64) {
        self.sum += weight * distance;
        self.weight += weight;
    }

    fn step(self, half: f64) -> f64 {
        if self.weight > 0.0 { (self.sum / self.weight).clamp(-MOST_STEP * half, MOST_STEP * half) } else { 0.0 }
    }
}

/// Moves the vertices of sheets along their normals, and changes their thickness, where nothing else is attached.
pub(super) fn fit(body: &Body, pairing: &Pairing, segments: &Segments, sheet: &mut Sheet) {
    let places = Places::new(sheet);
    let is_free = free(segments, sheet, &places);
    for _ in 0..ROUNDS {
        let mut around = vec![DVec3::ZERO; is_free.len()];
        let mut ways = Vec::with_capacity(sheet.triangles.len());
        for (triangle, corners) in sheet.triangles.iter().enumerate() {
            let [a, b, c] = sheet.corners(triangle);
            let normal = (b - a).cross(c - a);
            let is_turned = normal.dot(body.normals[sheet.faces[triangle] as usize]) < 0.0;
            let way = if is_turned { -normal } else { normal };
            ways.push(way.normalize_or_zero());
            for &corner in corners {
                around[places.of[corner as usize] as usize] += way;
            }
        }
        let gaps = gaps(body, segments, pairing, sheet, &places, &ways);
        let mut is_moved = false;
        for (vertex, &place) in places.of.iter().enumerate() {
            let half = sheet.halves[vertex];
            let [first, second] = gaps[place as usize].map(|gap| gap.step(half));
            if is_free[place as usize] && first.abs().max(second.abs()) > LEAST_STEP * half {
                sheet.points[vertex] += around[place as usize].normalize_or_zero() * (0.5 * (first - second));
                sheet.halves[vertex] = half + 0.5 * (first + second);
                is_moved = true;
            }
        }
        if !is_moved {
            break;
        }
    }
    level(sheet);
}

/// Gives walls that are equally thick everywhere one thickness. A sheet that is as thick everywhere is far cheaper to test
/// than one that varies.
fn level(sheet: &mut Sheet) {
    let mut spans = vec![[f64::INFINITY, 0.0]; sheet.walls.iter().map(|&wall| wall as usize + 1).max().unwrap_or(0)];
    for (corners, &wall) in sheet.triangles.iter().zip(&sheet.walls) {
        let [least, largest] = &mut spans[wall as usize];
        for &corner in corners {
            let half = sheet.halves[corner as usize];
            (*least, *largest) = (least.min(half), largest.max(half));
        }
    }
    let is_even = |least: f64, largest: f64| largest <= least * (1.0 + EVEN);
    let mut even: Vec<usize> = (0..spans.len()).filter(|&wall| is_even(spans[wall][0], spans[wall][1])).collect();
    even.sort_by(|&a, &b| spans[a][0].total_cmp(&spans[b][0]).then(a.cmp(&b)));
    let mut levels = vec![None; spans.len()];
    while let Some(&thinnest) = even.first() {
        let least = spans[thinnest][0];
        let (equal, others): (Vec<usize>, Vec<usize>) =
            even.into_iter().partition(|&wall| is_even(least, spans[wall][1]));
        let largest = equal.iter().map(|&wall| spans[wall][1]).fold(0.0, f64::max);
        for &wall in &equal {
            levels[wall] = Some(0.5 * (least + largest));
        }
        even = others;
    }
    // Where walls of different thickness meet, a vertex keeps its own.
    let mut level_at = vec![None; sheet.halves.len()];
    for (corners, &wall) in sheet.triangles.iter().zip(&sheet.walls) {
        let level = levels[wall as usize];
        for &corner in corners {
            let at = &mut level_at[corner as usize];
            *at = Some(if at.is_none_or(|other| other == level) { level } else { None });
        }
    }
    for (half, level) in sheet.halves.iter_mut().zip(level_at) {
        *half = level.flatten().unwrap_or(*half);
    }
}

/// The places of vertices that are within one smooth face of one wall.
fn free(segments: &Segments, sheet: &Sheet, places: &Places) -> Vec<bool> {
    let count = places.of.iter().map(|&place| place as usize + 1).max().unwrap_or(0);
    let mut segment_at = vec![NO_SEGMENT; count];
    let mut is_free = vec![true; count];
    for (corners, &face) in sheet.triangles.iter().zip(&sheet.faces) {
        let segment = segments.of[face as usize];
        for &corner in corners {
            let place = places.of[corner as usize] as usize;
            is_free[place] &= segment_at[place] == NO_SEGMENT || segment_at[place] == segment;
            segment_at[place] = segment;
        }
    }
    is_free
}

/// The distances of the original from both sides of a sheet at each place, sampled on either.
fn gaps(
    body: &Body,
    segments: &Segments,
    pairing: &Pairing,
    sheet: &Sheet,
    places: &Places,
    ways: &[DVec3],
) -> Vec<[Gap; 2]> {
    let thick = Thickened::new(body, segments, sheet);
    let side_count = 2 * ways.len();
    let out = |side: usize| [ways[side / 2], -ways[side / 2]][side % 2];
    let mut gaps = vec![[Gap::default(); 2]; places.of.len()];
    let mut add = |side: usize, point: DVec3, distance: f64, weight: f64| {
        let weights = barycentric_of(&thick.surface.corners[side], point);
        for (share, &corner) in weights.iter().zip(&sheet.triangles[side / 2]) {
            gaps[places.of[corner as usize] as usize][side % 2].add(distance, share * weight);
        }
    };
    for triangle in 0..body.triangle_count() {
        let samples = pairing.of(triangle);
        for sample in samples {
            let near = thick.surface.closest(sample.point, NEAR * thick.reach(), |near, _| {
                (near as usize) < side_count && out(near as usize).dot(body.normals[triangle]) >= SIDE_COSINE
            });
            if let Some((near, closest)) = near {
                let distance = (sample.point - closest).dot(out(near as usize));
                add(near as usize, closest, distance, body.areas[triangle] / samples.len() as f64);
            }
        }
    }
    for side in 0..side_count {
        let [a, b, c] = thick.surface.corners[side];
        let center = (a + b + c) / 3.0;
        let near = body
            .facets
            .closest(center, NEAR * thick.reach(), |near, _| out(side).dot(body.normals[near as usize]) >= SIDE_COSINE);
        if let Some((_, closest)) = near.filter(|_| !thick.contains(center)) {
            add(side, center, (closest - center).dot(out(side)), 0.5 * (b - a).cross(c - a).length());
        }
    }
    gaps
}
