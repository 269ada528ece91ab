//! Joins opposite segments to walls, and chooses the side of each wall that carries its sheet.
//!
//! The segments of a wall get one of two colors, so that opposite ones differ. Where that is impossible, because three
//! or more segments face each other in turn, one side of each pair of patches is chosen alone. No wall is lost, and none
//! is kept twice.

use std::collections::BTreeMap;

use super::{
    body::Body,
    depths::CornerDepths,
    pairing::Pairing,
    segments::{NO_SEGMENT, Segments, Sets},
};

/// Two segments are one wall if they face each other over this share of the smaller one.
const FACING_SHARE: f64 = 0.2;

/// Sides whose depths err by less than this, in half-thicknesses, are equally good.
const SMALL_ERROR: f64 = 0.02;

/// The side that has other walls attached may have so many times the triangles of the other one: its sheet is connected
/// to theirs at shared vertices.
const WORTH_OF_JOINTS: f64 = 1.5;

/// Marks a triangle of no wall.
pub(super) const NO_WALL: u32 = u32::MAX;

/// What becomes of a triangle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Role {
    /// It becomes a part of the sheet.
    Carrier,
    /// It is opposite the sheet's carrier, and dropped.
    Opposite,
    /// It stays.
    Rest,
}

/// The walls of a body.
pub(super) struct Walls {
    /// The wall of each segment, or [`NO_WALL`].
    pub(super) of_segment: Vec<u32>,
    pub(super) count: usize,
    pub(super) roles: Vec<Role>,
    /// The roles before any wall was left for being inaccurate.
    pub(super) intended: Vec<Role>,
}

/// For each thin triangle, the segment opposite most of it.
fn partners(body: &Body, pairing: &Pairing, segments: &Segments, is_thin: &[bool]) -> Vec<u32> {
    let mut partners = vec![NO_SEGMENT; body.triangle_count()];
    for triangle in (0..body.triangle_count()).filter(|&triangle| is_thin[triangle]) {
        let opposites = pairing.of(triangle).iter().filter_map(|sample| sample.opposite);
        let mut found: Vec<u32> = opposites
            .map(|opposite| segments.of[opposite.triangle as usize])
            .filter(|&segment| segment != NO_SEGMENT)
            .collect();
        found.sort_unstable();
        let most = found.chunk_by(|a, b| a == b).max_by_key(|same| (same.len(), std::cmp::Reverse(same[0])));
        partners[triangle] = most.map_or(NO_SEGMENT, |same| same[0]);
    }
    partners
}

/// Disjoint sets whose items are on either of two sides.
struct TwoSided {
    parent: Vec<usize>,
    is_turned: Vec<bool>,
}

impl TwoSided {
    fn new(count: usize) -> Self {
        Self { parent: (0..count).collect(), is_turned: vec![false; count] }
    }

    /// The name of an item's set, and on which side of it the item is.
    fn find(&self, mut item: usize) -> (usize, bool) {
        let mut side = false;
        while self.parent[item] != item {
            side ^= self.is_turned[item];
            item = self.parent[item];
        }
        (item, side)
    }

    /// Puts two items on different sides, unless they are in one set already.
    fn oppose(&mut self, a: usize, b: usize) {
        let ((a, side_a), (b, side_b)) = (self.find(a), self.find(b));
        if a != b {
            let (low, high) = (a.min(b), a.max(b));
            self.parent[high] = low;
            self.is_turned[high] = side_a == side_b;
        }
    }
}

/// One side of a wall.
#[derive(Clone, Copy, Default)]
struct Side {
    triangles: f64,
    area: f64,
    squared_error: f64,
    joints: usize,
}

impl Side {
    fn error(&self) -> f64 {
        if self.area > 0.0 { (self.squared_error / self.area).sqrt() } else { f64::INFINITY }
    }

    fn cost(&self) -> f64 {
        if self.joints > 0 { self.triangles } else { WORTH_OF_JOINTS * self.triangles }
    }

    /// Whether it carries the sheet better than the other side.
    fn is_better(&self, other: &Self) -> bool {
        let (own, others) = (self.error().max(SMALL_ERROR), other.error().max(SMALL_ERROR));
        if own != others && (own > 1.5 * others || others > 1.5 * own) {
            return own < others;
        }
        (self.cost(), -self.area) <= (other.cost(), -other.area)
    }
}

impl Walls {
    pub(super) fn new(
        body: &Body,
        pairing: &Pairing,
        segments: &Segments,
        depths: &CornerDepths,
        is_thin: &[bool],
    ) -> Self {
        let partners = partners(body, pairing, segments, is_thin);
        let mut own = vec![0.0; segments.count];
        let mut patches: BTreeMap<(u32, u32), f64> = BTreeMap::new();
        for triangle in (0..body.triangle_count()).filter(|&triangle| is_thin[triangle]) {
            let segment = segments.of[triangle];
            own[segment as usize] += body.areas[triangle];
            if partners[triangle] != NO_SEGMENT {
                *patches.entry((segment, partners[triangle])).or_default() += body.areas[triangle];
            }
        }
        let patch = |a, b| patches.get(&(a, b)).copied().unwrap_or(0.0);
        let mut facing: Vec<(f64, usize, usize)> = patches
            .keys()
            .filter(|&&(a, b)| a < b || (a > b && !patches.contains_key(&(b, a))))
            .map(|&(a, b)| (patch(a, b) + patch(b, a), a.min(b) as usize, a.max(b) as usize))
            .filter(|&(area, a, b)| area >= FACING_SHARE * own[a].min(own[b]))
            .collect();
        facing.sort_by(|a, b| b.0.total_cmp(&a.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        let mut sides = TwoSided::new(segments.count);
        let mut sets = Sets::new(segments.count);
        for &(_, a, b) in &facing {
            sides.oppose(a, b);
            sets.join(a, b);
        }
        let (of_segment, count) = number(&mut sets, &own);
        let color: Vec<bool> = (0..segments.count).map(|segment| sides.find(segment).1).collect();

        let mut measured = vec![[Side::default(); 2]; count];
        for triangle in (0..body.triangle_count()).filter(|&triangle| is_thin[triangle]) {
            let segment = segments.of[triangle] as usize;
            let wall = of_segment[segment];
            let side = &mut measured[wall as usize][usize::from(color[segment])];
            side.triangles += 1.0;
            side.area += body.areas[triangle];
            side.squared_error += depths.squared_error(body, pairing, triangle);
            side.joints += body
                .neighbors(triangle)
                .filter(|&other| is_thin[other] && of_segment[segments.of[other] as usize] != wall)
                .count();
        }
        let carrier: Vec<bool> = measured.iter().map(|[first, second]| !first.is_better(second)).collect();

        let is_carrier = |segment: u32| color[segment as usize] == carrier[of_segment[segment as usize] as usize];
        let roles = (0..body.triangle_count())
            .map(|triangle| {
                let (segment, partner) = (segments.of[triangle], partners[triangle]);
                let is_wall = |segment: u32| segment != NO_SEGMENT && of_segment[segment as usize] != NO_WALL;
                if is_thin[triangle] && !pairing.is_paired[triangle] && is_wall(segment) {
                    return if is_carrier(segment) { Role::Carrier } else { Role::Opposite };
                }
                if !is_thin[triangle] || !is_wall(partner) || partner == segment {
                    return Role::Rest;
                }
                let is_larger = (patch(segment, partner), partner) > (patch(partner, segment), segment);
                let carries = if is_carrier(segment) == is_carrier(partner) { is_larger } else { is_carrier(segment) };
                if carries { Role::Carrier } else { Role::Opposite }
            })
            .collect();
        let mut walls = Self { of_segment, count, roles, intended: Vec::new() };
        walls.drop_lonely(body, pairing);
        walls.intended.clone_from(&walls.roles);
        walls
    }

    /// Leaves some triangles, and those opposite them.
    pub(super) fn leave(&mut self, body: &Body, pairing: &Pairing, is_inaccurate: &[bool]) {
        for (role, &is_inaccurate) in self.roles.iter_mut().zip(is_inaccurate) {
            *role = if is_inaccurate { Role::Rest } else { *role };
        }
        self.drop_lonely(body, pairing);
    }

    /// Whether a triangle of a wall has been left.
    pub(super) fn is_left(&self, triangle: usize) -> bool {
        self.roles[triangle] == Role::Rest && self.intended[triangle] != Role::Rest
    }

    /// Leaves triangles where most of what is opposite them is not of a wall.
    fn drop_lonely(&mut self, body: &Body, pairing: &Pairing) {
        // Each pass leaves one more row of triangles around what is left.
        const PASSES: usize = 4;
        for _ in 0..PASSES {
            let before = self.roles.clone();
            for triangle in 0..body.triangle_count() {
                let wanted = match before[triangle] {
                    Role::Carrier => Role::Opposite,
                    Role::Opposite => Role::Carrier,
                    Role::Rest => continue,
                };
                if !pairing.is_paired[triangle] {
                    let alike = body.neighbors(triangle).filter(|&other| before[other] == before[triangle]).count();
                    if alike < 2 {
                        self.roles[triangle] = Role::Rest;
                    }
                    continue;
                }
                let opposites = || pairing.of(triangle).iter().filter_map(|sample| sample.opposite);
                let there = opposites().filter(|opposite| before[opposite.triangle as usize] == wanted).count();
                if 2 * there < opposites().count() {
                    self.roles[triangle] = Role::Rest;
                }
            }
            if before == self.roles {
                break;
            }
        }
    }
}

/// Numbers the walls of segments with thin triangles, in the order of their first segment.
fn number(sets: &mut Sets, thin_area: &[f64]) -> (Vec<u32>, usize) {
    let mut of_segment = vec![NO_WALL; thin_area.len()];
    let mut names = BTreeMap::new();
    for segment in (0..thin_area.len()).filter(|&segment| thin_area[segment] > 0.0) {
        let next = names.len() as u32;
        of_segment[segment] = *names.entry(sets.find(segment)).or_insert(next);
    }
    (of_segment, names.len())
}
