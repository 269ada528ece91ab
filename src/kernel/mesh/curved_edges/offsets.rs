//! The `c` of edges, eight at a time.

use fearless_simd::{f32x4, f32x8, mask32x8, prelude::*};
use glam::{Vec3, Vec3A};

use super::{GUARD, MOST_OF_EDGE, faces::Face, selection::Selection};
use crate::kernel::{
    mesh::{
        fans::{EdgeSides, NONE},
        smooth_normal::CreaseAngle,
        topology::SurfaceTopology,
    },
    simd::{
        lanes::{VectorLanes, WIDTH, stored, transposed},
        parallel::Parallel,
    },
};

/// Keeps nearly parallel normals solvable.
const DAMPING: f32 = 1.0e-3;

/// Computes for each selected edge how smooth it is: 1 inside a curved surface and at boundaries, 0 at a crease.
pub(super) fn compute_softness(
    parallel: &impl Parallel,
    selection: &Selection,
    sides: &[EdgeSides],
    faces: &[Face],
    crease: CreaseAngle,
    softness: &mut Vec<f32>,
) {
    softness.resize(sides.len(), 1.0);
    parallel.run_tasks(selection.parts(softness), selection.share(), |mut softness| {
        dispatch!(simd => {
            for items in softness.items.chunks(WIDTH) {
                let [first, second] = EightEdges::new(sides, items).faces(simd, faces);
                let soft = stored(crease.softness_in_lanes(simd, first.normal - second.normal));
                for (&item, soft) in items.iter().zip(soft) {
                    *softness.of(item) = soft;
                }
            }
        });
    });
}

/// What edges are computed from.
#[derive(Clone, Copy)]
pub(super) struct Edges<'a> {
    pub(super) topology: &'a SurfaceTopology,
    pub(super) positions: &'a [Vec3],
    pub(super) faces: &'a [Face],
    pub(super) softness: &'a [f32],
    pub(super) normals: &'a [Vec3A],
    pub(super) crease: CreaseAngle,
}

impl Edges<'_> {
    /// Computes the `c` of the selected edges.
    pub(super) fn compute(&self, parallel: &impl Parallel, selection: &Selection, offsets: &mut Vec<Vec3>) {
        let sides = self.topology.fans().edges();
        offsets.resize(sides.len(), Vec3::ZERO);
        parallel.run_tasks(selection.parts(offsets), selection.share(), |mut offsets| {
            dispatch!(simd => {
                for items in offsets.items.chunks(WIDTH) {
                    let own = self.offsets(simd, sides, items).stored();
                    for (lane, &item) in items.iter().enumerate() {
                        let is_apart = self.topology.is_welded() && self.are_apart(&sides[item as usize], item);
                        *offsets.of(item) = if is_apart { Vec3::ZERO } else { own.get(lane) };
                    }
                }
            });
        });
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn offsets<S: Simd>(&self, simd: S, sides: &[EdgeSides], items: &[u32]) -> VectorLanes<S> {
        let edges = EightEdges::new(sides, items);
        let [face, other] = edges.faces(simd, self.faces);
        let along = edges.along(simd, self.positions);
        let [own_normals, other_normals] = edges.normals(simd, self.normals);
        let own = SideLanes::new(simd, self.crease, &face, &own_normals, along);
        let beyond = SideLanes::new(simd, self.crease, &other, &other_normals, along);
        let (one, half) = (f32x8::splat(simd, 1.0), f32x8::splat(simd, 0.5));
        let mut soft = [1.0; WIDTH];
        for (soft, &item) in soft.iter_mut().zip(items) {
            *soft = self.softness[item as usize];
        }
        let soft = f32x8::from_slice(simd, &soft);
        let mut offset = own.offset.plus(beyond.offset).scaled(half);
        let is_crease = soft.simd_lt(1.0);
        if is_crease.any_true() {
            let blended = offset.scaled(soft).plus(on_crease(&own, &beyond).scaled(one - soft));
            offset = VectorLanes::select(is_crease, blended, offset);
        }
        let offset = offset.scaled(own.fits.min(beyond.fits));
        // Not longer than the guard allows.
        let limit = face.height.min(other.height) * (GUARD / MOST_OF_EDGE);
        let length = offset.dot(offset).sqrt();
        let offset = offset.scaled((limit / length.max(f32::MIN_POSITIVE)).min(1.0));
        let has_area = face.squared().simd_gt(0.5) & other.squared().simd_gt(0.5) & length.is_finite();
        let is_curved = has_area & mask32x8::from_bitmask(simd, u64::from(edges.curved));
        VectorLanes::select(is_curved, offset, VectorLanes::splat(simd, Vec3::ZERO))
    }

    /// Whether vertices that were welded at an end of the edge have moved apart.
    #[inline]
    fn are_apart(&self, sides: &EdgeSides, edge: u32) -> bool {
        let other = sides.triangles[1] as usize;
        if sides.triangles[1] == NONE {
            return false;
        }
        let edges = self.topology.triangle_edges()[other];
        let from = edges.iter().position(|&own| own == edge).unwrap_or_default();
        let corners = self.topology.triangles()[other];
        let ends = [corners[(from + 1) % 3], corners[from]];
        (0..2).any(|end| self.positions[ends[end] as usize] != self.positions[sides.ends[end] as usize])
    }
}

/// The sides of up to eight edges. A boundary has its only triangle on both sides.
struct EightEdges {
    sides: [EdgeSides; WIDTH],
    /// Edges that may be curved, one bit each.
    curved: u32,
}

impl EightEdges {
    #[cfg_attr(not(unoptimized), inline(always))]
    fn new(sides: &[EdgeSides], items: &[u32]) -> Self {
        let mut edges = Self { sides: [EdgeSides::AT_ZERO; WIDTH], curved: 0 };
        for (lane, (own, &item)) in edges.sides.iter_mut().zip(items).enumerate() {
            let sides = &sides[item as usize];
            if sides.triangles[0] != NONE {
                *own = sides.doubled();
                edges.curved |= 1 << lane;
            }
        }
        edges
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn faces<S: Simd>(&self, simd: S, faces: &[Face]) -> [FaceLanes<S>; 2] {
        let mut rows = [[f32x8::splat(simd, 0.0); WIDTH]; 2];
        for lane in 0..WIDTH {
            let [first, second] = self.sides[lane].triangles;
            rows[0][lane] = f32x8::from_slice(simd, faces[first as usize].row());
            rows[1][lane] = f32x8::from_slice(simd, faces[second as usize].row());
        }
        let [first, second] = rows;
        [FaceLanes::new(first), FaceLanes::new(second)]
    }

    /// From the start of each edge to its end.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn along<S: Simd>(&self, simd: S, positions: &[Vec3]) -> VectorLanes<S> {
        let mut along = [Vec3::ZERO; WIDTH];
        for lane in 0..WIDTH {
            let [start, end] = self.sides[lane].ends;
            along[lane] = positions[end as usize] - positions[start as usize];
        }
        VectorLanes::of(simd, along)
    }

    /// The normals at both ends, for each side.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn normals<S: Simd>(&self, simd: S, normals: &[Vec3A]) -> [[VectorLanes<S>; 2]; 2] {
        let mut rows = [[f32x4::splat(simd, 0.0); WIDTH]; 4];
        for lane in 0..WIDTH {
            for (number, &slot) in self.sides[lane].slots.as_flattened().iter().enumerate() {
                let [x, y, z] = normals[slot as usize].to_array();
                rows[number][lane] = f32x4::load_array(simd, [x, y, z, 0.0]);
            }
        }
        let [a, b, c, d] = rows;
        [[VectorLanes::of_rows(a), VectorLanes::of_rows(b)], [VectorLanes::of_rows(c), VectorLanes::of_rows(d)]]
    }
}

/// Eight faces.
struct FaceLanes<S: Simd> {
    normal: VectorLanes<S>,
    height: f32x8<S>,
}

impl<S: Simd> FaceLanes<S> {
    #[cfg_attr(not(unoptimized), inline(always))]
    fn new(rows: [f32x8<S>; WIDTH]) -> Self {
        let [x, y, z, _, _, _, height, _] = transposed(rows);
        Self { normal: VectorLanes { x, y, z }, height }
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn squared(&self) -> f32x8<S> {
        self.normal.dot(self.normal)
    }
}

/// The `c` of eight edges by one of the triangles beside each.
struct SideLanes<S: Simd> {
    offset: VectorLanes<S>,
    /// The sum of the normals at both ends.
    normal: VectorLanes<S>,
    /// From 1 to 0: how well these normals agree with the face.
    fits: f32x8<S>,
}

impl<S: Simd> SideLanes<S> {
    #[cfg_attr(not(unoptimized), inline(always))]
    fn new(
        simd: S,
        crease: CreaseAngle,
        face: &FaceLanes<S>,
        &[start, end]: &[VectorLanes<S>; 2],
        along: VectorLanes<S>,
    ) -> Self {
        let (rise, fall) = (along.dot(end) * 0.5, along.dot(start) * 0.5);
        let fits =
            crease.softness_in_lanes(simd, start - face.normal) * crease.softness_in_lanes(simd, end - face.normal);
        Self { offset: end.scaled(rise) - start.scaled(fall), normal: start.plus(end), fits }
    }
}

/// The `c` of an edge between two curved surfaces: the shortest vector that rises over each of them like its own `c`.
/// By least squares where the two are nearly one, or turn back on themselves.
#[cfg_attr(not(unoptimized), inline(always))]
fn on_crease<S: Simd>(own: &SideLanes<S>, other: &SideLanes<S>) -> VectorLanes<S> {
    let ((first, _), (second, _)) = (own.normal.normalized(), other.normal.normalized());
    let (rise, other_rise) = (own.offset.dot(first), other.offset.dot(second));
    // The shortest solution is a sum of both normals.
    let cosine = first.dot(second);
    let determinant = (1.0 + DAMPING) * (1.0 + DAMPING) - cosine * cosine;
    let share = (rise * (1.0 + DAMPING) - cosine * other_rise) / determinant;
    let other_share = (other_rise * (1.0 + DAMPING) - cosine * rise) / determinant;
    first.scaled(share).plus(second.scaled(other_share))
}
