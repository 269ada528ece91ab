//! Splits paired faces into smooth segments, and decides where a wall is thin: where it extends much farther than it is
//! thick.

use glam::DVec3;

use super::{
    body::{Body, Facets},
    pairing::{Pairing, Sample},
    settings::ThinWallSettings,
};

/// Marks a triangle in no segment.
pub(super) const NO_SEGMENT: u32 = u32::MAX;

/// A disc that is wide enough stands for what is within so many of its radii: discs do not fill corners.
const CORNER_REACH: f64 = 2.0;

/// A body has thin walls only if they are this share of its area. Otherwise they are the sharp edges of a solid.
const LEAST_SHARE: f64 = 0.25;

/// A gap in a face is filled if its area is no more than this multiple of the squared thickness around it. A hole
/// through a wall is larger: its inside is as wide as the wall is thick, all around.
const GAP_AREA: f64 = 1.0;

/// The triangles of a mesh in disjoint sets.
pub(super) struct Sets(Vec<u32>);

impl Sets {
    pub(super) fn new(count: usize) -> Self {
        Self((0..count as u32).collect())
    }

    pub(super) fn find(&mut self, mut item: usize) -> usize {
        while self.0[item] as usize != item {
            self.0[item] = self.0[self.0[item] as usize];
            item = self.0[item] as usize;
        }
        item
    }

    /// Joins two sets. The lower number names the result.
    pub(super) fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.find(a), self.find(b));
        self.0[a.max(b)] = a.min(b) as u32;
    }
}

/// Connected paired triangles without a crease between them.
pub(super) struct Segments {
    /// The segment of each triangle.
    pub(super) of: Vec<u32>,
    pub(super) count: usize,
}

impl Segments {
    pub(super) fn new(body: &Body, pairing: &Pairing, settings: &ThinWallSettings) -> Self {
        let crease = settings.crease_cosine();
        let mut sets = Sets::new(body.triangle_count());
        for triangle in (0..body.triangle_count()).filter(|&triangle| pairing.is_paired[triangle]) {
            for other in body.neighbors(triangle) {
                if pairing.is_paired[other] && body.normals[triangle].dot(body.normals[other]) >= crease {
                    sets.join(triangle, other);
                }
            }
        }
        let mut of = vec![NO_SEGMENT; body.triangle_count()];
        let mut count = 0;
        for triangle in (0..body.triangle_count()).filter(|&triangle| pairing.is_paired[triangle]) {
            let root = sets.find(triangle);
            // The lowest triangle of a set names it, so its segment is known.
            of[triangle] = if root == triangle { count } else { of[root] };
            count += u32::from(root == triangle);
        }
        let mut segments = Self { of, count: count as usize };
        segments.fill_gaps(body, pairing);
        segments
    }

    /// Adds small unpaired gaps to the segment around them: noise on a face.
    fn fill_gaps(&mut self, body: &Body, pairing: &Pairing) {
        let mut is_seen = vec![false; body.triangle_count()];
        for start in 0..body.triangle_count() {
            if is_seen[start] || self.of[start] != NO_SEGMENT {
                continue;
            }
            is_seen[start] = true;
            let mut gap = vec![start];
            let mut around: Vec<usize> = Vec::new();
            let mut has_border = false;
            let mut place = 0;
            while place < gap.len() {
                for edge in 0..3 {
                    match body.neighbor(gap[place], edge) {
                        Some(other) if self.of[other] != NO_SEGMENT => around.push(other),
                        Some(other) if !is_seen[other] => {
                            is_seen[other] = true;
                            gap.push(other);
                        }
                        Some(_) => {}
                        None => has_border = true,
                    }
                }
                place += 1;
            }
            let Some(&first) = around.first() else { continue };
            if has_border || around.iter().any(|&other| self.of[other] != self.of[first]) {
                continue;
            }
            let halves =
                around.iter().flat_map(|&other| pairing.of(other)).filter_map(|sample| Some(sample.opposite?.half));
            let (sum, number) = halves.fold((0.0, 0.0), |(sum, number), half| (sum + half, number + 1.0));
            let area: f64 = gap.iter().map(|&triangle| body.areas[triangle]).sum();
            if number > 0.0 && area <= GAP_AREA * (2.0 * sum / number).powi(2) {
                for triangle in gap {
                    self.of[triangle] = self.of[first];
                }
            }
        }
    }
}

/// How wide segments are.
pub(super) struct Extents {
    /// The samples of each segment, each with its distance from the border.
    discs: Vec<Vec<Disc>>,
}

struct Disc {
    triangle: usize,
    center: DVec3,
    radius: f64,
    half: f64,
    /// Of the angle between the two sides.
    cosine: f64,
}

impl Extents {
    pub(super) fn new(body: &Body, pairing: &Pairing, segments: &Segments) -> Self {
        let mut own = vec![0.0; segments.count];
        let mut opposite = vec![0.0; segments.count];
        let mut borders = (Vec::new(), Vec::new());
        for triangle in 0..body.triangle_count() {
            let segment = segments.of[triangle];
            if segment == NO_SEGMENT {
                continue;
            }
            own[segment as usize] += body.areas[triangle];
            let samples = pairing.of(triangle);
            let share = body.areas[triangle] / samples.len().max(1) as f64;
            for there in samples.iter().filter_map(|sample| sample.opposite) {
                let other = segments.of[there.triangle as usize];
                if other != NO_SEGMENT {
                    opposite[other as usize] += share;
                }
            }
            let corners = &body.facets.corners[triangle];
            for edge in 0..3 {
                if body.neighbor(triangle, edge).is_none_or(|other| segments.of[other] != segment) {
                    let end = corners[(edge + 1) % 3];
                    borders.0.push([corners[edge], end, end]);
                    borders.1.push(segment);
                }
            }
        }
        // For each segment, half the side of a square with its area, or with the area opposite it if that is less.
        let largest: Vec<f64> =
            own.iter().zip(&opposite).map(|(own, opposite)| 0.5 * own.min(*opposite).sqrt()).collect();
        let (edges, owners) = (Facets::new(borders.0), borders.1);
        let mut discs: Vec<Vec<Disc>> = (0..segments.count).map(|_| Vec::new()).collect();
        for triangle in 0..body.triangle_count() {
            let segment = segments.of[triangle];
            if segment == NO_SEGMENT {
                continue;
            }
            for &Sample { point, opposite } in pairing.of(triangle) {
                let Some(opposite) = opposite else { continue };
                let most = largest[segment as usize];
                let border = edges.closest(point, most, |edge, _| owners[edge as usize] == segment);
                let radius = border.map_or(most, |(_, closest)| closest.distance(point));
                discs[segment as usize].push(Disc {
                    triangle,
                    center: point,
                    radius,
                    half: opposite.half,
                    cosine: 2.0 * (opposite.depth / opposite.half).powi(2) - 1.0,
                });
            }
        }
        for discs in &mut discs {
            discs.sort_by(|a, b| b.radius.total_cmp(&a.radius).then(a.triangle.cmp(&b.triangle)));
        }
        Self { discs }
    }

    /// Marks the triangles of a segment around which it extends at least `extent` times as far as it is thick.
    pub(super) fn mark_wide(&self, segment: usize, extent: f64, pairing: &Pairing, is_wide: &mut [bool]) {
        let discs = &self.discs[segment];
        // A disc is a wall only if its thickness does not change by more than itself from end to end: a wedge does.
        let least_cosine = extent / (1.0 + extent * extent).sqrt();
        let centers: Vec<&Disc> =
            discs.iter().filter(|disc| disc.radius >= extent * disc.half && disc.cosine >= least_cosine).collect();
        let mut wide_samples: Vec<usize> = Vec::new();
        for sample in discs {
            let is_covered = centers
                .iter()
                .take_while(|disc| disc.radius >= extent * sample.half)
                .any(|disc| disc.center.distance(sample.center) <= CORNER_REACH * disc.radius);
            if is_covered {
                wide_samples.push(sample.triangle);
            }
        }
        wide_samples.sort_unstable();
        for samples in wide_samples.chunk_by(|a, b| a == b) {
            let triangle = samples[0];
            is_wide[triangle] = pairing.is_paired[triangle] && 2 * samples.len() >= pairing.of(triangle).len();
        }
    }
}

/// Which triangles are of thin walls: those around which a segment is wide, those opposite them, and narrower ones that
/// stand on them.
pub(super) fn thin_triangles(
    body: &Body,
    pairing: &Pairing,
    segments: &Segments,
    settings: &ThinWallSettings,
) -> Vec<bool> {
    let extents = Extents::new(body, pairing, segments);
    let mark = |extent: f32| {
        let mut is_wide = vec![false; body.triangle_count()];
        for segment in 0..segments.count {
            extents.mark_wide(segment, f64::from(extent), pairing, &mut is_wide);
        }
        opposite_too(body, pairing, &is_wide)
    };
    let mut is_thin = mark(settings.least_extent);
    let is_rib = mark(settings.least_rib_extent);
    let mut open: Vec<usize> = (0..is_thin.len()).filter(|&triangle| is_thin[triangle]).collect();
    while let Some(triangle) = open.pop() {
        for other in body.neighbors(triangle).filter(|&other| is_rib[other]) {
            // Within a segment, what is too narrow stays so.
            if !is_thin[other] && segments.of[other] != segments.of[triangle] {
                let before = open.len();
                spread(body, segments, &is_rib, &mut is_thin, other, &mut open);
                debug_assert!(open.len() > before, "the neighbor itself is new");
            }
        }
    }
    let mut is_thin = opposite_too(body, pairing, &is_thin);
    add_gaps(body, pairing, segments, &mut is_thin);
    drop_few(body, &mut is_thin);
    is_thin
}

/// Marks the filled gaps in thin faces.
fn add_gaps(body: &Body, pairing: &Pairing, segments: &Segments, is_thin: &mut [bool]) {
    let is_gap = |triangle: usize| segments.of[triangle] != NO_SEGMENT && !pairing.is_paired[triangle];
    let mut open: Vec<usize> = (0..is_thin.len()).filter(|&triangle| is_thin[triangle]).collect();
    while let Some(triangle) = open.pop() {
        for other in body.neighbors(triangle) {
            if is_gap(other) && !is_thin[other] {
                is_thin[other] = true;
                open.push(other);
            }
        }
    }
}

/// Drops the thin triangles of bodies that are mostly solid.
fn drop_few(body: &Body, is_thin: &mut [bool]) {
    let (component, count) = body.topology.components();
    let mut areas = vec![[0.0; 2]; count];
    for (triangle, &component) in component.iter().enumerate() {
        let [thin, all] = &mut areas[component as usize];
        *thin += if is_thin[triangle] { body.areas[triangle] } else { 0.0 };
        *all += body.areas[triangle];
    }
    for (is_thin, &component) in is_thin.iter_mut().zip(component) {
        let [thin, all] = areas[component as usize];
        *is_thin &= thin >= LEAST_SHARE * all;
    }
}

/// Marks the rib triangles of a segment that are connected to `start`, and appends them to `open`.
fn spread(
    body: &Body,
    segments: &Segments,
    is_rib: &[bool],
    is_thin: &mut [bool],
    start: usize,
    open: &mut Vec<usize>,
) {
    let first = open.len();
    is_thin[start] = true;
    open.push(start);
    let mut place = first;
    while place < open.len() {
        for other in body.neighbors(open[place]) {
            if is_rib[other] && !is_thin[other] && segments.of[other] == segments.of[start] {
                is_thin[other] = true;
                open.push(other);
            }
        }
        place += 1;
    }
}

/// The marked triangles, and those with at least half of their samples opposite marked ones.
fn opposite_too(body: &Body, pairing: &Pairing, is_marked: &[bool]) -> Vec<bool> {
    (0..body.triangle_count())
        .map(|triangle| {
            let opposites = pairing.of(triangle).iter().filter_map(|sample| sample.opposite);
            let marked = opposites.filter(|opposite| is_marked[opposite.triangle as usize]).count();
            let is_opposite = pairing.is_paired[triangle] && 2 * marked >= pairing.of(triangle).len();
            is_marked[triangle] || (is_opposite && marked > 0)
        })
        .collect()
}
