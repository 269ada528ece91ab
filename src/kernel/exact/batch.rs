//! Contacts between features of one kind, eight side by side.
//!
//! What the screen has found to count needs no second look: its weights, points and directions follow, by the arithmetic of
//! `triangle_pair`, operation by operation. What is too close for a direction is left to that.

#![expect(clippy::inline_always, reason = "what is not inlined is not compiled for the chosen instruction set")]

use fearless_simd::{Level, dispatch, f64x8, prelude::*};

use self::{
    kernels::{edges_through_faces, pairs_of_edges, vertices_on_edges, vertices_over_faces},
    plan::{FIRST, Kind, ONE, PLANS, POINTS, Plan, SECOND},
};
use super::{FeatureSet, unique::RecentFeatures};
use crate::kernel::{
    contact::CompactContact,
    mesh::corner_rows::CornerRow,
    pair::{PairSettings, RowPair, SurfaceSide, can_penetrate, is_inside},
    pose::Pose,
    simd::lanes::{DoubleVectorLanes, DoubleVectorRows, VectorRows, WIDTH, first_lanes, rounded},
};

mod kernels;
mod plan;

/// Of separations whose square is smaller, the direction is left to the test of a pair alone, which scales them first.
const LEAST_SQUARED: f64 = 1.0e-150;

/// Eight pairs of triangles and what they report.
pub(in crate::kernel) struct Reports<'a> {
    /// The rows of either triangle.
    pub(in crate::kernel) rows: [[&'a CornerRow; WIDTH]; 2],
    /// What counts, as [`FeatureSet`](super::FeatureSet)s.
    pub(in crate::kernel) sets: [u64; WIDTH],
    /// What of that other pairs may report as well.
    pub(in crate::kernel) shared: [u64; WIDTH],
    /// The pairs with anything that counts.
    pub(in crate::kernel) with_any: u32,
    /// The pairs of which all that is on the boundaries of both is near enough to be reported, however it is rounded.
    pub(in crate::kernel) certain: u32,
    /// Distances up to this are none.
    pub(in crate::kernel) nothing: [f64; WIDTH],
}

/// One feature pair on its way.
#[derive(Clone, Copy)]
struct Task {
    /// Where the contact belongs.
    place: u32,
    /// Which features, as a bit of a [`FeatureSet`](super::FeatureSet).
    case: u8,
}

/// The tasks of one kind that wait for their company.
struct Batch {
    /// The points of either feature in their own surface's frame, see [`Plan`].
    points: [VectorRows; POINTS],
    /// The first corner of the first triangle.
    origin: VectorRows,
    /// Below this a distance is none.
    nothing: [f64; WIDTH],
    /// Where the feature named first is of the second triangle, one bit each.
    swapped: u64,
    /// Where the feature named first is the second edge of its triangle, and where the third.
    turned: [u64; 2],
    tasks: [Task; WIDTH],
    count: usize,
}

impl Batch {
    const EMPTY: Self = Self {
        points: [VectorRows::ZERO; POINTS],
        origin: VectorRows::ZERO,
        nothing: [0.0; WIDTH],
        swapped: 0,
        turned: [0; 2],
        tasks: [Task { place: 0, case: 0 }; WIDTH],
        count: 0,
    };

    /// Adds a task. Whether they are complete.
    #[inline(always)]
    fn push(&mut self, task: Task, plan: &Plan, rows: [&CornerRow; 2], nothing: f64) -> bool {
        let lane = self.count % WIDTH;
        for (points, &[side, corner]) in self.points.iter_mut().zip(&plan.points) {
            points.set(lane, rows[side as usize].own_corner(corner as usize));
        }
        self.origin.set(lane, rows[0].own_corner(0));
        self.nothing[lane] = nothing;
        self.swapped |= u64::from(plan.first_side) << lane;
        self.turned[0] |= u64::from(plan.turns & 1) << lane;
        self.turned[1] |= u64::from(plan.turns >> 1) << lane;
        self.tasks[lane] = task;
        self.count = lane + 1;
        self.count == WIDTH
    }

    fn clear(&mut self) {
        (self.count, self.swapped, self.turned) = (0, 0, [0; 2]);
    }
}

/// What comes out of a batch, rounded as contacts are.
struct Results {
    /// Rows that the weights of corners are taken from: 0, 1, the start and the end of the first feature where it is an edge,
    /// those of the second edge or of the face's first two corners; and two that stay empty.
    weights: [[f32; WIDTH]; 8],
    point_b: VectorRows,
    normal: VectorRows,
    distance: [f32; WIDTH],
    /// From the point on the second triangle to that on the first.
    separation: DoubleVectorRows,
    /// The contacts whose points are far enough apart for a direction, one bit each.
    reliable: u64,
    /// Those of them that are near enough to be reported.
    reported: u64,
}

/// All kinds of feature pairs, and what becomes of them.
pub(in crate::kernel) struct FeatureBatches<'a> {
    batches: [Batch; Kind::COUNT],
    results: Results,
    limits: Limits<'a>,
    sides: Sides<'a>,
    /// What was reported lately and may be again, on boundaries. Where sides can be inside each other only what is outside
    /// counts: of what is inside each pair has a way out of its own, some of which are dropped later.
    recent: RecentFeatures,
    /// What does not become a contact here.
    left: LeftOver,
}

/// What batches leave.
#[derive(Default)]
pub(in crate::kernel) struct LeftOver {
    /// Places of contacts between features too close for a direction: what they are only the test of the pair alone can tell.
    pub(in crate::kernel) doubtful: Vec<u32>,
    /// Whether a place is empty because its contact is too far away to be reported.
    pub(in crate::kernel) has_gaps: bool,
}

/// What of the surfaces decides about contacts.
#[derive(Clone, Copy)]
struct Sides<'a> {
    both: [&'a SurfaceSide<'a>; 2],
    same_surface: bool,
    /// Whether they can be inside each other.
    solid: bool,
}

impl<'a> FeatureBatches<'a> {
    pub(in crate::kernel) fn new(sides: [&'a SurfaceSide<'a>; 2], settings: &PairSettings) -> Self {
        let mut results = Results {
            weights: [[0.0; WIDTH]; 8],
            point_b: VectorRows::ZERO,
            normal: VectorRows::ZERO,
            distance: [0.0; WIDTH],
            separation: DoubleVectorRows::ZERO,
            reliable: 0,
            reported: 0,
        };
        results.weights[ONE as usize] = [1.0; WIDTH];
        Self {
            batches: [Batch::EMPTY; Kind::COUNT],
            results,
            limits: Limits {
                scale: settings.scale,
                reported: settings.reported_distance,
                poses: sides.map(|side| side.moved.map(|moved| moved.pose)),
            },
            sides: Sides { both: sides, same_surface: settings.same_surface, solid: can_penetrate(sides, settings) },
            recent: RecentFeatures::NONE,
            left: LeftOver::default(),
        }
    }

    /// Appends contacts for all that some of up to eight pairs report, pair by pair, and writes those of whatever is complete
    /// by that.
    #[inline(always)]
    pub(in crate::kernel) fn add(
        &mut self,
        pairs: &[[u32; 2]],
        reports: &mut Reports<'_>,
        asked: u32,
        contacts: &mut Vec<CompactContact>,
    ) {
        let Sides { both: sides, same_surface, solid } = self.sides;
        let mut left = reports.with_any & asked;
        // One loop over all features of all pairs: how many those of one pair are nobody can foresee.
        while left != 0 {
            let lane = left.trailing_zeros() as usize % WIDTH;
            let set = reports.sets[lane];
            let case = set.trailing_zeros() as usize % PLANS.len();
            let rest = set & set.wrapping_sub(1);
            reports.sets[lane] = rest;
            left ^= u32::from(rest == 0) << lane;

            let plan = &PLANS[case];
            let rows = [reports.rows[0][lane], reports.rows[1][lane]];
            let pair = RowPair { sides, triangles: pairs[lane], rows };
            let numbers = [pair.number(0, plan.parts[0] as usize), pair.number(1, plan.parts[1] as usize)];
            let is_shared = reports.shared[lane] >> case & 1 != 0;
            let named = CompactContact::named(pair.triangles, same_surface, plan.features, numbers, is_shared);
            let stays = reports.certain >> lane & 1 != 0;
            if case >= FeatureSet::BOUNDARY && self.recent.know(named.key, stays && !solid) {
                // The first contact of these features stays: this one would be dropped.
                continue;
            }
            let task = Task { place: contacts.len() as u32, case: case as u8 };
            contacts.push(named);
            if self.batches[plan.kind as usize].push(task, plan, rows, reports.nothing[lane]) {
                self.finish_kind(plan.kind, contacts);
            }
        }
    }

    /// Writes the contacts of all that is left.
    pub(in crate::kernel) fn finish(mut self, contacts: &mut [CompactContact]) -> LeftOver {
        for kind in [Kind::VertexFace, Kind::EdgeEdge, Kind::Piercing, Kind::VertexEdge] {
            if self.batches[kind as usize].count > 0 {
                self.finish_kind(kind, contacts);
            }
        }
        self.left
    }

    #[inline(never)]
    fn finish_kind(&mut self, kind: Kind, contacts: &mut [CompactContact]) {
        let Self { batches, results, left, limits, sides, recent } = self;
        let batch = &mut batches[kind as usize];
        // Each by itself: together they take more room than the stack of a thread has, where nothing is optimized.
        let level = Level::new();
        match kind {
            Kind::VertexFace => dispatch!(level, simd => vertices_over_faces(simd, batch, limits, results)),
            Kind::EdgeEdge => dispatch!(level, simd => pairs_of_edges(simd, batch, limits, results)),
            Kind::Piercing => dispatch!(level, simd => edges_through_faces(simd, batch, limits, results)),
            Kind::VertexEdge => dispatch!(level, simd => vertices_on_edges(simd, batch, limits, results)),
        }
        dispatch!(level, _simd => results.write(batch, *sides, contacts, recent, left));
    }
}

/// Up to where contacts are reported, how many world units one of the pair's frame is, and how points come there.
#[derive(Clone, Copy)]
struct Limits<'a> {
    scale: f64,
    reported: f64,
    poses: [Option<&'a Pose>; 2],
}

impl Results {
    /// Writes the contacts of a batch, and empties it.
    #[inline(always)]
    fn write(
        &self,
        batch: &mut Batch,
        sides: Sides<'_>,
        contacts: &mut [CompactContact],
        recent: &mut RecentFeatures,
        left: &mut LeftOver,
    ) {
        let asked = first_lanes(batch.count);
        let [reported, doubtful] = [self.reported & asked, !self.reliable & asked];
        for (lane, task) in batch.tasks.iter().enumerate() {
            if reported >> lane & 1 != 0 {
                let contact = &mut contacts[task.place as usize];
                let plan = &PLANS[task.case as usize % PLANS.len()];
                let weight = |row: u8| self.weights[row as usize % 8][lane];
                contact.barycentric_a = plan.weights[0].map(weight);
                contact.barycentric_b = plan.weights[1].map(weight);
                contact.point_b = self.point_b.get(lane);
                contact.normal = self.normal.get(lane);
                contact.distance = self.distance[lane];
                if sides.solid {
                    let triangles = [contact.triangle_a, contact.triangle_b];
                    if is_inside(sides.both, triangles, contact.features, self.separation.get(lane)) {
                        (contact.normal, contact.distance) = (-contact.normal, -contact.distance);
                    } else if task.case as usize >= FeatureSet::BOUNDARY {
                        recent.add(contact.key);
                    }
                }
            }
        }
        if reported != asked {
            for (lane, task) in batch.tasks.iter().enumerate() {
                if doubtful >> lane & 1 != 0 {
                    left.doubtful.push(task.place);
                } else if (asked & !reported) >> lane & 1 != 0 {
                    contacts[task.place as usize].drop_name();
                    left.has_gaps = true;
                }
            }
        }
        batch.clear();
    }

    /// Keeps separations, how long they are, and which of them and of their directions can be relied on. Returns the
    /// directions.
    #[inline(always)]
    fn set_distance<S: Simd>(
        &mut self,
        simd: S,
        separation: DoubleVectorLanes<S>,
        distance: f64x8<S>,
        batch: &Batch,
        limits: &Limits<'_>,
    ) -> DoubleVectorLanes<S> {
        let squared = separation.dot(separation);
        let is_something = distance.simd_gt(f64x8::from_slice(simd, &batch.nothing)) | distance.simd_eq(0.0);
        let reliable = squared.simd_gt(LEAST_SQUARED) & squared.simd_lt(f64::MAX) & is_something;
        let scaled = distance * limits.scale;
        self.reliable = reliable.to_bitmask();
        self.reported = (reliable & scaled.simd_le(limits.reported)).to_bitmask();
        rounded(scaled).store_slice(&mut self.distance);
        separation.store(&mut self.separation);
        separation.scaled(f64x8::splat(simd, 1.0) / squared.sqrt())
    }
}
