//! All touching pairs of triangles of one or two meshes, with their distances, and the comparison of a found list.
//!
//! Brute force is the definition. The tree gives the same list fast enough for meshes of 100,000 triangles, and tests
//! compare the two. Filters of the production pipeline (layers, rings, masks) are not part of the reference. Only
//! triangles of one mesh that share a vertex are left out.

use super::box_tree::{Box3, BoxTree};
use super::triangle_pair::triangle_distance;
use glam::DVec3;
use std::collections::{BTreeMap, BTreeSet};

/// Two triangles that touch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReferencePair {
    /// Index of a triangle. Within one mesh, the smaller of the two indices. Between meshes, an index in the first
    /// mesh.
    pub triangle_a: u32,
    /// Index of the other triangle. Between meshes, an index in the second mesh.
    pub triangle_b: u32,
    /// Their distance in the unit of the positions. 0 if they cross.
    pub distance: f64,
}

/// For each vertex, the smallest index of a vertex at exactly the same position. -0.0 equals 0.0, and a vertex with a
/// NaN coordinate equals others with the same bits.
#[must_use]
pub fn exact_weld(positions: &[DVec3]) -> Vec<u32> {
    // Adding 0.0 turns -0.0 into 0.0 and changes nothing else.
    let key = |position: &DVec3| position.to_array().map(|coordinate| (coordinate + 0.0).to_bits());
    let mut first_at = BTreeMap::new();
    positions.iter().zip(0u32..).map(|(position, index)| *first_at.entry(key(position)).or_insert(index)).collect()
}

/// Mean length of a mesh's edges, each counted once after welding. 0 without edges.
///
/// `weld` maps each vertex to its representative ([`exact_weld`]). Edges from a vertex to itself are not counted.
#[must_use]
pub fn mean_edge_length(positions: &[DVec3], triangles: &[[u32; 3]], weld: &[u32]) -> f64 {
    let mut edges = BTreeSet::new();
    for triangle in triangles {
        let [a, b, c] = triangle.map(|vertex| weld[vertex as usize]);
        for (start, end) in [(a, b), (b, c), (c, a)] {
            if start != end {
                edges.insert((start.min(end), start.max(end)));
            }
        }
    }
    let total: f64 =
        edges.iter().map(|&(start, end)| positions[start as usize].distance(positions[end as usize])).sum();
    if edges.is_empty() { 0.0 } else { total / edges.len() as f64 }
}

/// All pairs of triangles of a mesh that share no vertex and whose distance is at most `distance`, sorted by indices.
/// Every pair is measured.
///
/// `positions` are vertex positions, `triangles` index them, and `weld` maps each vertex to its representative
/// ([`exact_weld`], or the identity for no welding). Triangles with a coordinate that is not finite touch nothing. To
/// judge a kernel, pass its contact distance with a margin, such as `distance · (1 + 2e-4)`, and leave the close
/// decisions to [`compare`].
///
/// Panics if an index is out of range.
#[must_use]
pub fn touching_pairs_brute_force(
    positions: &[DVec3],
    triangles: &[[u32; 3]],
    weld: &[u32],
    distance: f64,
) -> Vec<ReferencePair> {
    let corners = finite_corners(positions, triangles);
    let mut pairs = Vec::new();
    for i in 0..triangles.len() {
        for j in i + 1..triangles.len() {
            if !share_vertex(&triangles[i], &triangles[j], weld) {
                pairs.extend(touching(&corners, i, &corners, j, distance));
            }
        }
    }
    pairs
}

/// The same list as [`touching_pairs_brute_force`], found with a tree of boxes.
#[must_use]
pub fn touching_pairs_tree(
    positions: &[DVec3],
    triangles: &[[u32; 3]],
    weld: &[u32],
    distance: f64,
) -> Vec<ReferencePair> {
    let corners = finite_corners(positions, triangles);
    let mut pairs = Vec::new();
    box_tree(&corners).visit_self(distance, &mut |i, j| {
        if !share_vertex(&triangles[i], &triangles[j], weld) {
            pairs.extend(touching(&corners, i, &corners, j, distance));
        }
    });
    sort(&mut pairs);
    pairs
}

/// All pairs of a triangle of one mesh and a triangle of another whose distance is at most `distance`, sorted by
/// indices. Every pair is measured. The positions of both meshes are in one frame. If vertices of the two meshes
/// coincide, their triangles touch.
///
/// Panics if an index is out of range.
#[must_use]
pub fn touching_pairs_between_brute_force(
    positions_a: &[DVec3],
    triangles_a: &[[u32; 3]],
    positions_b: &[DVec3],
    triangles_b: &[[u32; 3]],
    distance: f64,
) -> Vec<ReferencePair> {
    let corners_a = finite_corners(positions_a, triangles_a);
    let corners_b = finite_corners(positions_b, triangles_b);
    let mut pairs = Vec::new();
    for i in 0..triangles_a.len() {
        for j in 0..triangles_b.len() {
            pairs.extend(touching(&corners_a, i, &corners_b, j, distance));
        }
    }
    pairs
}

/// The same list as [`touching_pairs_between_brute_force`], found with two trees of boxes.
#[must_use]
pub fn touching_pairs_between_tree(
    positions_a: &[DVec3],
    triangles_a: &[[u32; 3]],
    positions_b: &[DVec3],
    triangles_b: &[[u32; 3]],
    distance: f64,
) -> Vec<ReferencePair> {
    let corners_a = finite_corners(positions_a, triangles_a);
    let corners_b = finite_corners(positions_b, triangles_b);
    let mut pairs = Vec::new();
    box_tree(&corners_a).visit_between(&box_tree(&corners_b), distance, &mut |i, j| {
        pairs.extend(touching(&corners_a, i, &corners_b, j, distance));
    });
    sort(&mut pairs);
    pairs
}

/// All pairs of triangles of a mesh whose boxes overlap when each is grown by half of `distance`, including pairs that
/// share a vertex. Smaller index first, sorted. Every broad phase must find at least these.
#[must_use]
pub fn box_pairs(positions: &[DVec3], triangles: &[[u32; 3]], distance: f64) -> Vec<(u32, u32)> {
    let corners = finite_corners(positions, triangles);
    let mut pairs = Vec::new();
    box_tree(&corners).visit_self(distance, &mut |i, j| pairs.push((i as u32, j as u32)));
    pairs.sort_unstable();
    pairs
}

/// How a list of found pairs compares with the reference.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Comparison {
    /// Reference pairs that had to be found and were not.
    pub missed: Vec<ReferencePair>,
    /// Found pairs, each listed once, that are farther apart than the band allows or not pairs of the reference at all.
    pub false_pairs: Vec<(u32, u32)>,
    /// Pairs that were found again after the first time.
    pub duplicates: Vec<(u32, u32)>,
    /// Reference pairs within the band. They may be found or not.
    pub in_band: usize,
    /// Reference pairs that had to be found and were.
    pub matched: usize,
    /// Largest |found distance − reference distance| over the found pairs that are matched or in the band, in the unit
    /// of the positions. Infinite if a found distance is NaN.
    pub worst_distance_error: f64,
    /// The pair with that error. `None` if every error is 0.
    pub worst_pair: Option<(u32, u32)>,
}

impl Comparison {
    /// Whether the found list is right as a set, without missed, false, or duplicate pairs.
    #[must_use]
    pub fn is_exact(&self) -> bool {
        self.missed.is_empty() && self.false_pairs.is_empty() && self.duplicates.is_empty()
    }
}

/// Compares found pairs (triangle, triangle, distance) with the reference at contact distance `distance`.
///
/// `truth` must have been computed for `distance · (1 + band)` or more. Pairs up to `distance · (1 − band)` must be
/// found, and pairs above `distance · (1 + band)` must not. In the `band` between them, which is relative to
/// `distance`, either is right, because rounding in the tested kernel decides. Found pairs must list their triangles in
/// the order of the reference (within one mesh, smaller index first). The reverse order counts as false.
#[must_use]
pub fn compare(found: &[(u32, u32, f64)], truth: &[ReferencePair], distance: f64, band: f64) -> Comparison {
    let required_up_to = distance * (1.0 - band);
    let allowed_up_to = distance * (1.0 + band);
    let true_distance: BTreeMap<(u32, u32), f64> =
        truth.iter().map(|pair| ((pair.triangle_a, pair.triangle_b), pair.distance)).collect();

    let mut comparison = Comparison::default();
    let mut seen = BTreeSet::new();
    for &(triangle_a, triangle_b, found_distance) in found {
        let key = (triangle_a, triangle_b);
        if !seen.insert(key) {
            comparison.duplicates.push(key);
            continue;
        }
        match true_distance.get(&key) {
            Some(&true_distance) if true_distance <= allowed_up_to => {
                let difference = (found_distance - true_distance).abs();
                let error = if difference.is_nan() { f64::INFINITY } else { difference };
                if error > comparison.worst_distance_error {
                    comparison.worst_distance_error = error;
                    comparison.worst_pair = Some(key);
                }
            }
            _ => comparison.false_pairs.push(key),
        }
    }
    for pair in truth {
        if pair.distance <= required_up_to {
            if seen.contains(&(pair.triangle_a, pair.triangle_b)) {
                comparison.matched += 1;
            } else {
                comparison.missed.push(*pair);
            }
        } else if pair.distance <= allowed_up_to {
            comparison.in_band += 1;
        }
    }
    comparison
}

/// The corners of each triangle. `None` for a triangle with a coordinate that is not finite.
fn finite_corners(positions: &[DVec3], triangles: &[[u32; 3]]) -> Vec<Option<[DVec3; 3]>> {
    triangles
        .iter()
        .map(|triangle| {
            let corners = triangle.map(|vertex| positions[vertex as usize]);
            corners.iter().all(|corner| corner.is_finite()).then_some(corners)
        })
        .collect()
}

/// Whether two features have a vertex in common after welding.
pub(super) fn share_vertex(a: &[u32], b: &[u32], weld: &[u32]) -> bool {
    a.iter().any(|&one| b.iter().any(|&other| weld[one as usize] == weld[other as usize]))
}

fn touching(
    corners_a: &[Option<[DVec3; 3]>],
    i: usize,
    corners_b: &[Option<[DVec3; 3]>],
    j: usize,
    limit: f64,
) -> Option<ReferencePair> {
    let (Some(a), Some(b)) = (&corners_a[i], &corners_b[j]) else {
        return None;
    };
    let distance = triangle_distance(a, b);
    (distance <= limit).then_some(ReferencePair { triangle_a: i as u32, triangle_b: j as u32, distance })
}

fn box_tree(corners: &[Option<[DVec3; 3]>]) -> BoxTree {
    BoxTree::new(corners.iter().map(|corners| corners.as_ref().map(Box3::of)).collect())
}

fn sort(pairs: &mut [ReferencePair]) {
    pairs.sort_unstable_by_key(|pair| (pair.triangle_a, pair.triangle_b));
}
