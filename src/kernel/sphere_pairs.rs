//! The approximate stages over a list of candidate pairs: sphere overlap, cone test, and the contacts they amount to.
//!
//! Reads candidate pairs and the spheres of both sides, writes the pairs that pass and their contacts, eight pairs at a
//! time. Spheres are kept in the frame of their own surface; those of a moved side are brought over pair by pair.

#![expect(clippy::inline_always, reason = "what is not inlined is not compiled for the chosen instruction set")]

use super::{
    circumsphere::{Ball, OffsetSpheres},
    cone::{Cap, SafetyCones, cap_contact, spheres_overlap},
    contact::{CompactContact, FacePlace, TouchingPair},
    ids::TriangleId,
    lanes::{CapContactLanes, CapLanes, DoubleLanes, Lanes, Mask, PairLanes, TrianglePairLanes, VectorLanes, WIDTH},
    pair::{FoundPairs, PairSettings, SurfaceSide, without_neighbors},
    pair_fate::{PairFate, StepObserver, Unobserved},
    pose::Pose,
    sphere_rows::{BallRows, CapRows, RowLanes, TriangleRow, rounded_corners},
};

/// The enclosing balls of one side, and the way to the frame of the pair.
#[derive(Clone, Copy)]
pub struct BallSide<'a> {
    /// The surface in the frame of the pair.
    pub surface: SurfaceSide<'a>,
    /// One ball a triangle, in the side's own frame.
    pub balls: &'a [Ball],
    /// From the side's own frame to the frame of the pair; `None` where they are the same.
    pub pose: Option<&'a Pose>,
    /// [Its rows](Self::rows), where somebody has made them, and the side has not been moved.
    pub rows: Option<&'a BallRows>,
}

impl BallSide<'_> {
    /// Writes a row for each triangle: worth it where most triangles are in several pairs.
    pub fn rows(&self, rows: &mut BallRows) {
        rows.fill((0..self.balls.len() as u32).map(|triangle| self.row(triangle)));
    }

    #[inline(always)]
    fn row(&self, triangle: u32) -> TriangleRow {
        TriangleRow::of_ball(rounded_corners(&self.surface, triangle), &self.ball(triangle))
    }

    #[inline(always)]
    fn gather<const SIDE: usize>(&self, pairs: &[[u32; 2]], lanes: &mut RowLanes) {
        match self.rows {
            Some(rows) => lanes.gather_balls::<SIDE>(rows, pairs),
            None => self.gather_one_by_one::<SIDE>(pairs, lanes),
        }
    }

    // Kept apart, so that the lanes come from memory: of numbers it has just loaded one by one the compiler makes
    // no vectors.
    #[inline(never)]
    fn gather_one_by_one<const SIDE: usize>(&self, pairs: &[[u32; 2]], lanes: &mut RowLanes) {
        for (lane, pair) in pairs.iter().enumerate().take(WIDTH) {
            lanes.set(lane, &self.row(pair[SIDE]), [0.0; 2]);
        }
    }

    /// One triangle's ball in the frame of the pair.
    #[inline(always)]
    #[must_use]
    pub fn ball(&self, triangle: u32) -> Ball {
        let ball = self.balls[triangle as usize];
        let Some(pose) = self.pose else { return ball };
        Ball {
            center: pose.transform_point(ball.center.as_dvec3()).as_vec3(),
            radius: (f64::from(ball.radius) * pose.scale()) as f32,
        }
    }
}

/// The offset spheres and cones of one side, and the way to the frame of the pair.
#[derive(Clone, Copy)]
pub struct CapSide<'a> {
    /// The surface in the frame of the pair. A sheet, which has no inside, has a cap on either side of each triangle.
    pub surface: SurfaceSide<'a>,
    /// Offset spheres, in the side's own frame.
    pub spheres: &'a OffsetSpheres,
    /// Safety cones, in the side's own frame.
    pub cones: &'a SafetyCones,
    /// From the side's own frame to the frame of the pair; `None` where they are the same.
    pub pose: Option<&'a Pose>,
    /// [Its rows](Self::rows), where somebody has made them, and the side has not been moved.
    pub rows: Option<&'a CapRows>,
}

impl CapSide<'_> {
    /// Writes a row for each triangle: worth it where most triangles are in several pairs.
    pub fn rows(&self, rows: &mut CapRows) {
        rows.fill((0..self.spheres.radii.len() as u32).map(|triangle| self.row(triangle)));
    }

    #[inline(always)]
    fn row(&self, triangle: u32) -> (TriangleRow, [f32; 2]) {
        TriangleRow::of_cap(rounded_corners(&self.surface, triangle), &self.cap(triangle))
    }

    #[inline(always)]
    fn gather<const SIDE: usize>(&self, pairs: &[[u32; 2]], lanes: &mut RowLanes) {
        match self.rows {
            Some(rows) => lanes.gather_caps::<SIDE>(rows, pairs),
            None => self.gather_one_by_one::<SIDE>(pairs, lanes),
        }
    }

    #[inline(never)]
    fn gather_one_by_one<const SIDE: usize>(&self, pairs: &[[u32; 2]], lanes: &mut RowLanes) {
        for (lane, pair) in pairs.iter().enumerate().take(WIDTH) {
            let (row, rest) = self.row(pair[SIDE]);
            lanes.set(lane, &row, rest);
        }
    }

    /// One triangle's sphere and cone in the frame of the pair.
    #[inline(always)]
    #[must_use]
    pub fn cap(&self, triangle: u32) -> Cap {
        let cap = Cap::of(self.spheres, self.cones, triangle as usize);
        let Some(pose) = self.pose else { return cap };
        let scale = pose.scale();
        Cap {
            center: pose.transform_point(cap.center.as_dvec3()).as_vec3(),
            radius: (f64::from(cap.radius) * scale) as f32,
            height: (f64::from(cap.height) * scale) as f32,
            axis: pose.transform_direction(cap.axis.as_dvec3()).as_vec3(),
            cosine: cap.cosine,
        }
    }
}

/// Appends the candidates whose enclosing balls come within range. In a self-collision, pairs that share a vertex are
/// left out.
pub fn overlapping_balls(
    a: &BallSide<'_>,
    b: &BallSide<'_>,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    overlapping: &mut Vec<[u32; 2]>,
) {
    overlapping_balls_in_steps(a, b, candidates, settings, overlapping, &mut Unobserved);
}

/// [`overlapping_balls`], telling after each step which pairs are left.
pub(super) fn overlapping_balls_in_steps<O: StepObserver>(
    a: &BallSide<'_>,
    b: &BallSide<'_>,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    overlapping: &mut Vec<[u32; 2]>,
    observer: &mut O,
) {
    let reach = (settings.range / settings.scale) as f32;
    let (before, topology) = (overlapping.len(), a.surface.topology);
    if O::ASKS {
        observer.passed(PairFate::Neighbors, without_neighbors(&a.surface, candidates, settings).iter().copied());
    }
    append_where(candidates, overlapping, |[triangle_a, triangle_b]| {
        let (ball_a, ball_b) = (a.ball(triangle_a), b.ball(triangle_b));
        let meet = spheres_overlap(ball_a.center, ball_a.radius, ball_b.center, ball_b.radius, reach);
        meet & !(settings.same_surface && topology.share_vertex(TriangleId(triangle_a), TriangleId(triangle_b)))
    });
    if O::ASKS {
        observer.passed(PairFate::Spheres, overlapping[before..].iter().copied());
    }
}

/// Appends those of `pairs` that `keep`, without a branch that would be hard to predict.
#[inline]
fn append_where(pairs: &[[u32; 2]], kept: &mut Vec<[u32; 2]>, keep: impl Fn([u32; 2]) -> bool) {
    let mut block = [[0; 2]; 64];
    for pairs in pairs.chunks(block.len()) {
        let mut count = 0;
        for &pair in pairs {
            block[count] = pair;
            count += usize::from(keep(pair));
        }
        kept.extend_from_slice(&block[..count]);
    }
}

/// Appends the candidates whose offset spheres come within range and, where asked, which neither their planes nor the
/// line between the sphere centers separate by more. In a self-collision, pairs that share a vertex are left out.
pub fn overlapping_caps(
    a: &CapSide<'_>,
    b: &CapSide<'_>,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    overlapping: &mut Vec<[u32; 2]>,
) {
    overlapping_caps_in_steps(a, b, candidates, settings, overlapping, &mut Unobserved);
}

/// [`overlapping_caps`], telling after each step which pairs are left.
pub(super) fn overlapping_caps_in_steps<O: StepObserver>(
    a: &CapSide<'_>,
    b: &CapSide<'_>,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    overlapping: &mut Vec<[u32; 2]>,
    observer: &mut O,
) {
    let steps: &[PairFate] =
        if settings.cull { &[PairFate::Planes, PairFate::Spheres, PairFate::CenterLine] } else { &[PairFate::Spheres] };
    if O::ASKS {
        let mut left = without_neighbors(&a.surface, candidates, settings).into_owned();
        observer.passed(PairFate::Neighbors, left.iter().copied());
        for &step in steps {
            let mut passed = Vec::new();
            keep_overlapping_caps(a, b, &left, &[step], settings, &mut passed);
            observer.passed(step, passed.iter().copied());
            left = passed;
        }
        overlapping.extend(left);
        return;
    }
    let before = overlapping.len();
    keep_overlapping_caps(a, b, candidates, steps, settings, overlapping);
    if settings.same_surface {
        // Last: the fewest pairs are left.
        let mut count = before;
        for place in before..overlapping.len() {
            let [triangle_a, triangle_b] = overlapping[place];
            overlapping[count] = [triangle_a, triangle_b];
            let neighbors = a.surface.topology.share_vertex(TriangleId(triangle_a), TriangleId(triangle_b));
            count += usize::from(!neighbors);
        }
        overlapping.truncate(count);
    }
}

/// The caps of eight pairs of triangles, of sheets those that face the other triangle.
#[inline(always)]
fn facing_caps(a: &CapSide<'_>, b: &CapSide<'_>, rows: &[RowLanes; 2]) -> [CapLanes; 2] {
    let [cap_a, cap_b] = [rows[0].cap(), rows[1].cap()];
    let centers = [cap_a.in_plane_center(), cap_b.in_plane_center()];
    [
        if a.surface.one_sided { cap_a } else { cap_a.facing(centers[1]) },
        if b.surface.one_sided { cap_b } else { cap_b.facing(centers[0]) },
    ]
}

/// Appends the pairs that pass all of some steps.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2+fma", "x86_64+avx"))]
fn keep_overlapping_caps(
    a: &CapSide<'_>,
    b: &CapSide<'_>,
    pairs: &[[u32; 2]],
    steps: &[PairFate],
    settings: &PairSettings,
    kept: &mut Vec<[u32; 2]>,
) {
    let [planes, spheres, center_line] =
        [PairFate::Planes, PairFate::Spheres, PairFate::CenterLine].map(|step| steps.contains(&step));
    let reach = (settings.range / settings.scale) as f32;
    let rounded_reach = Lanes::splat(reach + a.surface.rounding() + b.surface.rounding());
    let mut rows = [RowLanes::EMPTY; 2];
    for pairs in pairs.chunks(WIDTH) {
        a.gather::<0>(pairs, &mut rows[0]);
        b.gather::<1>(pairs, &mut rows[1]);
        let corners = PairLanes::of_corners(&rows[0].corners(), &rows[1].corners());
        let mut apart = Mask([0; WIDTH]);
        if planes {
            let along_normals = corners.excess_along_normals(rounded_reach);
            apart = apart.or(along_normals.greater_than(Lanes::ZERO));
        }
        let [cap_a, cap_b] = facing_caps(a, b, &rows);
        if spheres {
            apart = apart.or(cap_a.overlap(&cap_b, Lanes::splat(reach)).not());
        }
        if center_line {
            let line = cap_a.center - cap_b.center;
            apart = apart.or(corners.excess_along(line, rounded_reach).greater_than(Lanes::ZERO));
        }
        keep(pairs, &apart, kept);
    }
}

/// Appends the pairs that are not apart. Kept apart itself: numbers that are stored side by side are computed side by side.
#[inline(never)]
fn keep(pairs: &[[u32; 2]], apart: &Mask, kept: &mut Vec<[u32; 2]>) {
    let (mut block, mut count) = ([[0; 2]; WIDTH], 0);
    for (&pair, apart) in pairs.iter().zip(apart.0) {
        block[count] = pair;
        count += usize::from(apart == 0);
    }
    kept.extend_from_slice(&block[..count]);
}

/// Eight contacts of two whole triangles by their spheres, in the frame of the pair.
struct FaceContacts {
    /// Contact points on the first and the second side.
    points: [VectorLanes; 2],
    /// From the second side to the first.
    normal: VectorLanes,
    /// From one point to the other, along the normal.
    gap: DoubleLanes,
    /// What the distance of the two is at least, as far as the method knows; at least 0.
    distance: DoubleLanes,
    /// Where there is any contact.
    meet: Mask,
}

/// What is written of eight contacts. In memory, and for the same reason as the lanes that are gathered.
struct WrittenContacts {
    barycentrics: [[Lanes; 2]; 2],
    point_b: VectorLanes,
    normal: VectorLanes,
    /// In world units, like the distance.
    gap: DoubleLanes,
    distance: DoubleLanes,
    meet: Mask,
}

impl FaceContacts {
    #[inline(always)]
    fn write(self, triangles: &TrianglePairLanes, settings: &PairSettings) -> WrittenContacts {
        let scale = DoubleLanes::splat(settings.scale);
        let distance = self.distance * scale;
        WrittenContacts {
            barycentrics: [triangles.a.barycentrics(self.points[0]), triangles.b.barycentrics(self.points[1])],
            point_b: self.points[1],
            normal: self.normal,
            // Along the normal the two may be farther apart than what counts as the pair's distance.
            gap: (self.gap * scale).min(distance),
            distance,
            meet: self.meet,
        }
    }
}

impl WrittenContacts {
    /// Counts the pairs by their distances, and reports their contacts. A pair that is listed twice in a row has one.
    #[inline(never)]
    fn push(&self, pairs: &[[u32; 2]], settings: &PairSettings, found: &mut FoundPairs) {
        for (lane, &[triangle_a, triangle_b]) in pairs.iter().enumerate().take(WIDTH) {
            if self.meet.0[lane] == 0 {
                continue;
            }
            let (distance, gap) = (self.distance.0[lane], self.gap.0[lane]);
            found.nearest = found.nearest.min(distance.max(0.0));
            if distance <= settings.contact_distance {
                found.touching.push(TouchingPair { triangle_a, triangle_b, distance: gap.max(0.0) });
            }
            if distance <= settings.reported_distance {
                let weights = |side: usize| self.barycentrics[side].each_ref().map(|weights| weights.0[lane]);
                let place = FacePlace {
                    barycentrics: [weights(0), weights(1)],
                    point_b: self.point_b.get(lane),
                    normal: self.normal.get(lane),
                    distance: gap as f32,
                };
                let contact = CompactContact::between_faces([triangle_a, triangle_b], settings.same_surface, place);
                if found.contacts.last().is_none_or(|last| last.key != contact.key) {
                    found.contacts.push(contact);
                }
            }
        }
    }
}

/// Appends the contacts of pairs whose enclosing balls overlap.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2+fma", "x86_64+avx"))]
pub fn ball_contacts(
    a: &BallSide<'_>,
    b: &BallSide<'_>,
    overlapping: &[[u32; 2]],
    settings: &PairSettings,
    found: &mut FoundPairs,
) {
    found.touching.reserve(overlapping.len());
    found.contacts.reserve(overlapping.len());
    let mut triangles = TrianglePairLanes::EMPTY;
    let mut rows = [RowLanes::EMPTY; 2];
    let up = VectorLanes { x: Lanes::ZERO, y: Lanes::splat(1.0), z: Lanes::ZERO };
    for pairs in overlapping.chunks(WIDTH) {
        a.gather::<0>(pairs, &mut rows[0]);
        b.gather::<1>(pairs, &mut rows[1]);
        triangles.a.fetch::<0>(&a.surface, pairs, &rows[0].corners());
        triangles.b.fetch::<1>(&b.surface, pairs, &rows[1].corners());
        let [own, other] = [rows[0].center(), rows[1].center()];
        let [own_radius, other_radius] = [rows[0].radius(), rows[1].radius()];
        let between = own.widened() - other.widened();
        let normal = between.normalized_or(up.widened()).rounded();
        let gap = between.dot(between).sqrt() - own_radius.widened() - other_radius.widened();
        let contacts = FaceContacts {
            points: [own - normal.scaled(own_radius), other.plus(normal.scaled(other_radius))],
            normal,
            gap,
            // Candidates reach as far as the margin: without it, only what their boxes let through would be here.
            distance: gap.max(triangles.box_gap()),
            meet: Mask([u32::MAX; WIDTH]),
        };
        contacts.write(&triangles, settings).push(pairs, settings, found);
    }
}

/// Appends the pairs that pass the cone test to `meeting`, and what contacts they amount to to `found`.
#[multiversion::multiversion(targets("x86_64+avx512f+avx512vl+avx512bw+avx512dq", "x86_64+avx2+fma", "x86_64+avx"))]
pub fn meeting_caps(
    a: &CapSide<'_>,
    b: &CapSide<'_>,
    overlapping: &[[u32; 2]],
    settings: &PairSettings,
    meeting: &mut Vec<[u32; 2]>,
    found: &mut FoundPairs,
) {
    meeting.reserve(overlapping.len());
    found.touching.reserve(overlapping.len());
    found.contacts.reserve(overlapping.len());
    let mut triangles = TrianglePairLanes::EMPTY;
    let mut rows = [RowLanes::EMPTY; 2];
    for pairs in overlapping.chunks(WIDTH) {
        a.gather::<0>(pairs, &mut rows[0]);
        b.gather::<1>(pairs, &mut rows[1]);
        let [cap_a, cap_b] = facing_caps(a, b, &rows);
        triangles.a.fetch::<0>(&a.surface, pairs, &rows[0].corners());
        triangles.b.fetch::<1>(&b.surface, pairs, &rows[1].corners());
        let (mut contact, mut meet, extraordinary) = cap_a.contact(&cap_b);
        if extraordinary.any() {
            settle(&cap_a, &cap_b, &extraordinary, &mut contact, &mut meet);
        }
        keep(pairs, &meet.not(), meeting);
        let between = cap_a.center.widened() - cap_b.center.widened();
        let spheres = between.dot(between).sqrt() - cap_a.radius.widened() - cap_b.radius.widened();
        // Boxes always: candidates reach as far as the margin, and the pairs must not depend on it.
        let mut distance = spheres.max(triangles.box_gap());
        if settings.cull {
            distance = distance.max(triangles.gap_along_normals_and(contact.direction.widened()));
        }
        let contacts = FaceContacts {
            points: [contact.point_a, contact.point_b],
            normal: contact.direction.negated(),
            gap: contact.gap.widened(),
            distance,
            meet,
        };
        contacts.write(&triangles, settings).push(pairs, settings, found);
    }
}

/// Tests the pairs that eight at a time cannot be told of, one by one.
#[cold]
#[inline(never)]
fn settle(a: &CapLanes, b: &CapLanes, extraordinary: &Mask, contacts: &mut CapContactLanes, meet: &mut Mask) {
    for lane in (0..WIDTH).filter(|&lane| extraordinary.0[lane] != 0) {
        let contact = cap_contact(&a.get(lane), &b.get(lane));
        meet.0[lane] = if contact.is_some() { u32::MAX } else { 0 };
        if let Some(contact) = contact {
            contacts.point_a.set(lane, contact.point_a);
            contacts.point_b.set(lane, contact.point_b);
            contacts.direction.set(lane, contact.direction);
            contacts.gap.0[lane] = contact.gap;
        }
    }
}
