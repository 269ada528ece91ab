//! Contacts between features of one kind, eight at a time.
//!
//! Features that the screen has confirmed need no second test. Their weights, points, and directions are computed by
//! the operations of `triangle_pair`. Features that are too close for a direction are left to that module.

use fearless_simd::{f64x8, prelude::*};

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

/// If the square of a separation is smaller, the direction is left to the test of a single pair, which scales the
/// separation first.
const LEAST_SQUARED: f64 = 1.0e-150;

/// Eight pairs of triangles, and what they report.
pub(in crate::kernel) struct Reports<'a> {
    /// The rows of both triangles.
    pub(in crate::kernel) rows: [[&'a CornerRow; WIDTH]; 2],
    /// The features that count, as [`FeatureSet`](super::FeatureSet)s.
    pub(in crate::kernel) sets: [u64; WIDTH],
    /// Those of them that other pairs may report too.
    pub(in crate::kernel) shared: [u64; WIDTH],
    /// The pairs with any feature that counts.
    pub(in crate::kernel) with_any: u32,
    /// The pairs whose boundary features are all close enough to be reported, however they are rounded.
    pub(in crate::kernel) certain: u32,
    /// Distances up to this count as 0.
    pub(in crate::kernel) nothing: [f64; WIDTH],
}

/// One feature pair that waits for its batch.
#[derive(Clone, Copy)]
struct Task {
    /// The index of the contact.
    place: u32,
    /// The features, as a bit of a [`FeatureSet`](super::FeatureSet).
    case: u8,
}

/// The waiting tasks of one kind.
struct Batch {
    /// The points of both features in their own surface's frame, see [`Plan`].
    points: [VectorRows; POINTS],
    /// The first corner of the first triangle.
    origin: VectorRows,
    /// Distances up to this count as 0.
    nothing: [f64; WIDTH],
    /// Where the feature named first belongs to the second triangle, one bit each.
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

    /// Adds a task. Returns whether the batch is full.
    #[cfg_attr(not(unoptimized), inline(always))]
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

/// The results of a batch, rounded like contacts.
struct Results {
    /// Rows from which the weights of corners are taken: 0, 1, the start and end of the first feature if it is an edge,
    /// the start and end of the second edge or the first two corners of the face, and two rows that stay empty.
    weights: [[f32; WIDTH]; 8],
    point_b: VectorRows,
    normal: VectorRows,
    distance: [f32; WIDTH],
    /// From the point on the second triangle to the point on the first.
    separation: DoubleVectorRows,
    /// The contacts whose points are far enough apart for a direction, one bit each.
    reliable: u64,
    /// Those of them that are close enough to be reported.
    reported: u64,
}

/// All kinds of feature pairs, in batches.
pub(in crate::kernel) struct FeatureBatches<'a> {
    batches: [Batch; Kind::COUNT],
    results: Results,
    limits: Limits<'a>,
    sides: Sides<'a>,
    /// Features on boundaries that were reported recently and may be reported again. If the sides can be inside each
    /// other, only contacts outside count: inside, each pair has its own way out, and some of these are dropped later.
    recent: RecentFeatures,
    /// What does not become a contact here.
    left: LeftOver,
}

/// What batches leave to the caller.
#[derive(Default)]
pub(in crate::kernel) struct LeftOver {
    /// Indices of contacts between features that are too close for a direction. Only the test of a single pair can
    /// decide these.
    pub(in crate::kernel) doubtful: Vec<u32>,
    /// Whether entries are empty because their contacts are too far apart to be reported.
    pub(in crate::kernel) has_gaps: bool,
}

/// The properties of the surfaces that affect contacts.
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

    /// Appends contacts for everything that the `requested` pairs report, pair by pair, and computes each batch that
    /// becomes full.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(in crate::kernel) fn add(
        &mut self,
        pairs: &[[u32; 2]],
        reports: &mut Reports<'_>,
        requested: u32,
        contacts: &mut Vec<CompactContact>,
    ) {
        let Sides { both: sides, same_surface, solid } = self.sides;
        let mut left = reports.with_any & requested;
        // One loop over all features of all pairs: how many a pair has is unpredictable.
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
                // The first contact of these features is kept, so this one would be dropped.
                continue;
            }
            let task = Task { place: contacts.len() as u32, case: case as u8 };
            contacts.push(named);
            if self.batches[plan.kind as usize].push(task, plan, rows, reports.nothing[lane]) {
                self.finish_kind(plan.kind, contacts);
            }
        }
    }

    /// Computes the remaining contacts.
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
        // Dispatched one by one: together they exceed the stack of a thread in unoptimized builds.
        match kind {
            Kind::VertexFace => dispatch!(simd => vertices_over_faces(simd, batch, limits, results)),
            Kind::EdgeEdge => dispatch!(simd => pairs_of_edges(simd, batch, limits, results)),
            Kind::Piercing => dispatch!(simd => edges_through_faces(simd, batch, limits, results)),
            Kind::VertexEdge => dispatch!(simd => vertices_on_edges(simd, batch, limits, results)),
        }
        dispatch!(_ => results.write(batch, *sides, contacts, recent, left));
    }
}

/// The distance up to which contacts are reported, the world length of one unit of the pair's frame, and the transforms
/// to that frame.
#[derive(Clone, Copy)]
struct Limits<'a> {
    scale: f64,
    reported: f64,
    poses: [Option<&'a Pose>; 2],
}

impl Results {
    /// Writes the contacts of a batch, and clears it.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn write(
        &self,
        batch: &mut Batch,
        sides: Sides<'_>,
        contacts: &mut [CompactContact],
        recent: &mut RecentFeatures,
        left: &mut LeftOver,
    ) {
        let requested = first_lanes(batch.count);
        let [reported, doubtful] = [self.reported & requested, !self.reliable & requested];
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
        if reported != requested {
            for (lane, task) in batch.tasks.iter().enumerate() {
                if doubtful >> lane & 1 != 0 {
                    left.doubtful.push(task.place);
                } else if (requested & !reported) >> lane & 1 != 0 {
                    contacts[task.place as usize].drop_name();
                    left.has_gaps = true;
                }
            }
        }
        batch.clear();
    }

    /// Stores separations and distances, and which of them have a reliable direction. Returns the normals.
    #[cfg_attr(not(unoptimized), inline(always))]
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
        separation.scaled(f64x8::splat(simd, -1.0) / squared.sqrt())
    }
}
