//! One curvature value per triangle, from its neighbors across shared edges, and the dihedral angles.
//!
//! Two estimators: the signed edge curvature `β/d`, with β the dihedral angle and `d` the distance of the unfolded
//! centroids across the edge; and the angle deficit of the dual mesh (centroids joined across edges). The square root
//! of the deficit over the dual area is the mean curvature at valence three. First geometric stage of the sphere
//! methods; `circumsphere` reads its results.

use core::f32::consts::FRAC_PI_2;

use fearless_simd::{f32x4, f32x8, mask32x8, prelude::*};
use glam::Vec3;

use crate::kernel::{
    mesh::{
        ids::EdgeId,
        topology::{Hinge, SurfaceTopology},
    },
    simd::{
        lanes::{TriangleLanes, VectorLanes, WIDTH, arc_tangent, columns, rows, store_first},
        parallel::{LEAST_SHARE, PART, Parallel, Sequential},
    },
};

/// How the curvature of a triangle is estimated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum CurvatureEstimator {
    /// The edge with the largest `|β/d|`, signed: positive where the surface is convex, seen from the side that its
    /// normals point to. Works on stretched meshes and at boundaries.
    #[default]
    SignedEdge,
    /// `sqrt(max(2π − Σα, 0) / A)` of the dual mesh at the triangle's centroid: the source paper's estimator, with the
    /// sum of the dual triangles' areas. At least 0. Needs all three neighbors. Without them the signed edge curvature
    /// is used.
    DualAngleDeficit,
}

/// Curvatures and dihedral angles of a surface's triangles, and the buffers that they are computed in.
#[derive(Clone, Debug, Default)]
pub struct Curvatures {
    /// Curvature of each triangle, in 1/length. For a smooth surface the signed curvature of its osculating sphere:
    /// greater than 0 where it is convex.
    pub curvatures: Vec<f32>,
    /// Dihedral angle across edge `k` of each triangle, in radians from −π to π. Positive where convex, 0 at a boundary
    /// and next to a triangle without area.
    pub dihedrals: Vec<[f32; 3]>,
    /// How far the surface's normal turns away from each triangle's own before the next triangle takes over: the
    /// largest angle to a neighbor, in radians from 0 to π. At a boundary at least π/2, because a rim is met from any
    /// side.
    pub spreads: Vec<f32>,
    faces: Vec<Face>,
    centroids: Vec<Vec3>,
    /// Dihedral angle and curvature of each edge, see [`Bend`].
    bends: Vec<[f32; 2]>,
}

/// A triangle's normal, a unit vector or zero if the triangle has no area, and its doubled area.
type Face = [f32; 4];

/// How the surface bends across an edge: the dihedral angle, or a marker instead of one, and the curvature.
#[derive(Clone, Copy, Debug, Default)]
struct Bend {
    dihedral: f32,
    curvature: f32,
}

impl From<[f32; 2]> for Bend {
    #[inline]
    fn from([dihedral, curvature]: [f32; 2]) -> Self {
        Self { dihedral, curvature }
    }
}

impl Bend {
    /// No triangle on the other side. No angle is as large.
    const RIM: Self = Self { dihedral: f32::INFINITY, curvature: 0.0 };

    /// Several triangles on the other side, each with its own angle.
    const BRANCH: Self = Self { dihedral: f32::NAN, curvature: 0.0 };

    #[inline]
    fn branches(self) -> bool {
        self.dihedral.is_nan()
    }

    /// The dihedral angle, or 0 if there is none.
    #[inline]
    fn dihedral(self) -> f32 {
        if self.dihedral == f32::INFINITY { 0.0 } else { self.dihedral }
    }

    /// How far the surface's normal turns. π/2 at a rim.
    #[inline]
    fn turn(self) -> f32 {
        if self.dihedral == f32::INFINITY { FRAC_PI_2 } else { self.dihedral.abs() }
    }
}

/// Eight edges with a triangle on each side.
struct HingeLanes<S: Simd> {
    /// From one end to the other, in the direction of the first triangle.
    along: VectorLanes<S>,
    normals: [VectorLanes<S>; 2],
    doubled_areas: [f32x8<S>; 2],
    /// Where the second triangle is inverted.
    turned: mask32x8<S>,
    /// Where there are two triangles.
    folds: mask32x8<S>,
    /// Where there are more.
    branches: mask32x8<S>,
}

impl<S: Simd> HingeLanes<S> {
    #[cfg_attr(not(unoptimized), inline(always))]
    fn gather(simd: S, hinges: &[Hinge], faces: &[Face], positions: &[Vec3]) -> Self {
        let (mut folds, mut turns, mut branches) = (0, 0, 0);
        let mut places = [[[0; 2]; 2]; WIDTH];
        for (lane, hinge) in hinges.iter().enumerate().take(WIDTH) {
            match *hinge {
                Hinge::Rim => {}
                Hinge::Fold { triangles, ends, turned } => {
                    folds |= 1 << lane;
                    turns |= u64::from(turned) << lane;
                    places[lane] = [triangles, ends];
                }
                Hinge::Branch => branches |= 1 << lane,
            }
        }
        // If there is no fold, the first elements are read: a loop without branches keeps everything in registers.
        let (mut along, mut sides) = ([Vec3::ZERO; WIDTH], [[f32x4::splat(simd, 0.0); WIDTH]; 2]);
        for lane in 0..WIDTH {
            let [triangles, [from, to]] = places[lane];
            along[lane] = positions[to as usize] - positions[from as usize];
            for side in 0..2 {
                sides[side][lane] = f32x4::load_array(simd, faces[triangles[side] as usize]);
            }
        }
        let [x, y, z, doubled_area] = columns(sides[0]);
        let [other_x, other_y, other_z, other_doubled_area] = columns(sides[1]);
        Self {
            along: VectorLanes::of(simd, along),
            normals: [VectorLanes { x, y, z }, VectorLanes { x: other_x, y: other_y, z: other_z }],
            doubled_areas: [doubled_area, other_doubled_area],
            turned: mask32x8::from_bitmask(simd, turns),
            folds: mask32x8::from_bitmask(simd, folds),
            branches: mask32x8::from_bitmask(simd, branches),
        }
    }

    /// The dihedral angle and the curvature across each edge; 0 where either triangle has no area.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn bend(&self) -> [f32x8<S>; 2] {
        let simd = self.doubled_areas[0].simd;
        let (flat, one) = (f32x8::splat(simd, 0.0), f32x8::splat(simd, 1.0));
        let (normal, other) = (self.normals[0], self.normals[1].scaled(self.turned.select(-one, one)));
        let sine = normal.cross(other).dot(self.along.normalized().0);
        let cosine = normal.dot(other);
        let has_areas = normal.dot(normal).simd_gt(0.0) & other.dot(other).simd_gt(0.0);
        let dihedral = arc_tangent(sine, has_areas.select(cosine, one));
        let dihedral = has_areas.select(dihedral, flat);
        let length = self.along.dot(self.along).sqrt();
        // (h_i + h_j) / 3 with h = doubled area / length.
        let distance = (self.doubled_areas[0] + self.doubled_areas[1]) / (length * 3.0);
        let has_distance = distance.simd_gt(0.0) & distance.is_finite();
        let curvature = has_distance.select(dihedral / distance, flat);
        let [rim, branch] = [Bend::RIM, Bend::BRANCH].map(|bend| f32x8::splat(simd, bend.dihedral));
        let unfolded = self.branches.select(branch, rim);
        [self.folds.select(dihedral, unfolded), self.folds.select(curvature, flat)]
    }
}

/// The results for consecutive triangles.
struct Measured<'a> {
    curvatures: &'a mut [f32],
    dihedrals: &'a mut [[f32; 3]],
    spreads: &'a mut [f32],
}

/// The bends across the edges of eight triangles.
struct BendLanes<S: Simd> {
    dihedrals: [f32x8<S>; 3],
    curvatures: [f32x8<S>; 3],
}

impl<S: Simd> BendLanes<S> {
    #[cfg_attr(not(unoptimized), inline(always))]
    fn gather(simd: S, bends: &[[f32; 2]], edges: &[[u32; 3]]) -> Self {
        if let Some(edges) = edges.first_chunk() {
            return Self::gather_all(simd, bends, edges);
        }
        let mut block = [[0; 3]; WIDTH];
        block[..edges.len()].copy_from_slice(edges);
        Self::gather_all(simd, bends, &block)
    }

    #[cfg_attr(not(unoptimized), inline(always))]
    fn gather_all(simd: S, bends: &[[f32; 2]], edges: &[[u32; 3]; WIDTH]) -> Self {
        let (mut pairs, mut others) = ([f32x4::splat(simd, 0.0); WIDTH], [f32x4::splat(simd, 0.0); WIDTH]);
        for (lane, &[first, second, third]) in edges.iter().enumerate() {
            let ([a, b], [c, d], [e, f]) = (bends[first as usize], bends[second as usize], bends[third as usize]);
            pairs[lane] = f32x4::load_array(simd, [a, b, c, d]);
            others[lane] = f32x4::load_array(simd, [e, f, 0.0, 0.0]);
        }
        let ([a, b, c, d], [e, f, ..]) = (columns(pairs), columns(others));
        Self { dihedrals: [a, c, e], curvatures: [b, d, f] }
    }

    /// Whether any of the edges has more than two triangles.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn branch(&self) -> bool {
        let [a, b, c] = self.dihedrals;
        (a.is_nan() | b.is_nan() | c.is_nan()).any_true()
    }

    /// [`Bend::dihedral`]
    #[cfg_attr(not(unoptimized), inline(always))]
    fn dihedrals(&self) -> VectorLanes<S> {
        let [x, y, z] = self.dihedrals;
        let (rim, flat) = (Bend::RIM.dihedral, f32x8::splat(x.simd, 0.0));
        VectorLanes {
            x: x.simd_eq(rim).select(flat, x),
            y: y.simd_eq(rim).select(flat, y),
            z: z.simd_eq(rim).select(flat, z),
        }
    }

    /// The largest [`Bend::turn`].
    #[cfg_attr(not(unoptimized), inline(always))]
    fn spread(&self) -> f32x8<S> {
        let simd = self.dihedrals[0].simd;
        let mut most = f32x8::splat(simd, 0.0);
        for dihedral in self.dihedrals {
            let is_rim = dihedral.simd_eq(Bend::RIM.dihedral);
            most = most.max(is_rim.select(f32x8::splat(simd, FRAC_PI_2), dihedral.abs()));
        }
        most
    }

    /// The curvature with the largest magnitude.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn curvature(&self) -> f32x8<S> {
        let simd = self.curvatures[0].simd;
        let mut steepest = f32x8::splat(simd, 0.0);
        for curvature in self.curvatures {
            steepest = curvature.abs().simd_gt(steepest.abs()).select(curvature, steepest);
        }
        steepest.is_finite().select(steepest, f32x8::splat(simd, f32::MAX))
    }
}

impl Curvatures {
    /// Measures the surface at the given positions.
    pub fn measure(&mut self, topology: &SurfaceTopology, positions: &[Vec3], estimator: CurvatureEstimator) {
        self.measure_on(&Sequential, topology, positions, estimator);
    }

    /// Like [`measure`](Self::measure), in tasks that `parallel` may distribute.
    pub fn measure_on(
        &mut self,
        parallel: &impl Parallel,
        topology: &SurfaceTopology,
        positions: &[Vec3],
        estimator: CurvatureEstimator,
    ) {
        let Self { faces, bends, .. } = self;
        faces.resize(topology.triangles().len(), [0.0; 4]);
        let parts = topology.triangles().chunks(PART).zip(faces.chunks_mut(PART));
        parallel.run_tasks(parts, topology.triangles().len() / LEAST_SHARE, |(triangles, faces)| {
            dispatch!(simd => measure_faces(simd, triangles, positions, faces));
        });
        bends.resize(topology.edges().len(), [0.0; 2]);
        let parts = topology.hinges().chunks(PART).zip(bends.chunks_mut(PART));
        parallel.run_tasks(parts, topology.edges().len() / LEAST_SHARE, |(hinges, bends)| {
            measure_bends(hinges, faces, positions, bends);
        });
        self.centroids.clear();
        if estimator == CurvatureEstimator::DualAngleDeficit {
            self.centroids.extend(topology.triangles().iter().map(|corners| {
                let [a, b, c] = corners.map(|vertex| positions[vertex as usize]);
                a + ((b - a) + (c - a)) / 3.0
            }));
        }
        self.measure_triangles(parallel, topology, positions);
        if estimator == CurvatureEstimator::DualAngleDeficit {
            for triangle in 0..topology.triangles().len() {
                if let Some(curvature) = self.dual_angle_deficit(topology, triangle) {
                    self.curvatures[triangle] = curvature;
                }
            }
        }
    }

    fn measure_triangles(&mut self, parallel: &impl Parallel, topology: &SurfaceTopology, positions: &[Vec3]) {
        let count = topology.triangles().len();
        let [mut curvatures, mut spreads] = [&mut self.curvatures, &mut self.spreads].map(std::mem::take);
        let mut dihedrals = std::mem::take(&mut self.dihedrals);
        curvatures.resize(count, 0.0);
        dihedrals.resize(count, [0.0; 3]);
        spreads.resize(count, 0.0);
        let written = curvatures.chunks_mut(PART).zip(dihedrals.chunks_mut(PART)).zip(spreads.chunks_mut(PART));
        parallel.run_tasks(written.enumerate(), count / LEAST_SHARE, |(part, ((curvatures, dihedrals), spreads))| {
            let measured = Measured { curvatures, dihedrals, spreads };
            dispatch!(simd => self.measure_part(simd, topology, positions, part * PART, measured));
        });
        (self.curvatures, self.dihedrals, self.spreads) = (curvatures, dihedrals, spreads);
    }

    /// Measures consecutive triangles, starting with `first`.
    #[cfg_attr(not(unoptimized), inline(always))]
    fn measure_part<S: Simd>(
        &self,
        simd: S,
        topology: &SurfaceTopology,
        positions: &[Vec3],
        first: usize,
        measured: Measured<'_>,
    ) {
        let Measured { curvatures, dihedrals, spreads } = measured;
        let edges = topology.triangle_edges()[first..].chunks(WIDTH);
        let blocks = curvatures.chunks_mut(WIDTH).zip(dihedrals.chunks_mut(WIDTH)).zip(spreads.chunks_mut(WIDTH));
        for (block, (edges, ((curvatures, dihedrals), spreads))) in edges.zip(blocks).enumerate() {
            let bends = BendLanes::gather(simd, &self.bends, edges);
            if bends.branch() {
                let measured = Measured { curvatures, dihedrals, spreads };
                self.measure_one_by_one(topology, positions, first + block * WIDTH, measured);
                continue;
            }
            bends.dihedrals().write(dihedrals);
            store_first(bends.spread(), spreads);
            store_first(bends.curvature(), curvatures);
        }
    }

    /// Like `measure_part`, if an edge may have several triangles.
    #[cold]
    #[inline(never)]
    fn measure_one_by_one(
        &self,
        topology: &SurfaceTopology,
        positions: &[Vec3],
        first: usize,
        Measured { curvatures, dihedrals, spreads }: Measured<'_>,
    ) {
        let written = curvatures.iter_mut().zip(dihedrals).zip(spreads);
        for (triangle, ((curvature, dihedrals), spread)) in (first..).zip(written) {
            let bends = self.bends_of(topology, positions, triangle, &topology.triangle_edges()[triangle]);
            *dihedrals = bends.map(Bend::dihedral);
            *spread = bends.map(Bend::turn).into_iter().fold(0.0, |most, turn| if turn > most { turn } else { most });
            let steeper =
                |most: f32, bend: &Bend| if bend.curvature.abs() > most.abs() { bend.curvature } else { most };
            let steepest = bends.iter().fold(0.0, steeper);
            *curvature = if steepest.is_finite() { steepest } else { f32::MAX };
        }
    }

    /// The bends across the edges of a triangle.
    #[inline]
    fn bends_of(&self, topology: &SurfaceTopology, positions: &[Vec3], triangle: usize, edges: &[u32; 3]) -> [Bend; 3] {
        let mut bends = edges.map(|edge| Bend::from(self.bends[edge as usize]));
        if bends.iter().any(|bend| bend.branches()) {
            for k in 0..3 {
                if bends[k].branches() {
                    bends[k] = self.steepest_bend(topology, positions, triangle, k);
                }
            }
        }
        bends
    }

    /// The bend across edge `k` of a triangle, to whichever of several neighbors folds most.
    #[cold]
    fn steepest_bend(&self, topology: &SurfaceTopology, positions: &[Vec3], triangle: usize, k: usize) -> Bend {
        let (own, edge) = (triangle as u32, topology.triangle_edges()[triangle][k]);
        let corners = topology.triangles()[triangle];
        // Uses the first of the triangle's edges that is this edge: a triangle may traverse an edge twice.
        let side = (0..3).find(|&side| topology.triangle_edges()[triangle][side] == edge).unwrap_or(k);
        let mut steepest = Bend::default();
        for &other in topology.triangles_of_edge(EdgeId(edge)).iter().filter(|&&other| other != own) {
            let hinge = Hinge::Fold {
                triangles: [own, other],
                ends: [corners[side], corners[(side + 1) % 3]],
                turned: topology.runs_forward(own, edge) == topology.runs_forward(other, edge),
            };
            let mut bend = [[0.0; 2]];
            measure_bends(&[hinge], &self.faces, positions, &mut bend);
            let [bend] = bend.map(Bend::from);
            if bend.turn() > steepest.turn() {
                steepest = bend;
            }
        }
        steepest
    }

    /// `None` if the triangle does not have exactly one neighbor across each edge, or the dual triangles have no area.
    fn dual_angle_deficit(&self, topology: &SurfaceTopology, triangle: usize) -> Option<f32> {
        let own = triangle as u32;
        let mut spokes = [Vec3::ZERO; 3];
        for k in 0..3 {
            let edge = EdgeId(topology.triangle_edges()[triangle][k]);
            let &[first, second] = topology.triangles_of_edge(edge) else { return None };
            let neighbor = if first == own { second } else { first };
            spokes[k] = self.centroids[neighbor as usize] - self.centroids[triangle];
        }
        let (mut angles, mut doubled_areas) = (0.0, 0.0);
        for k in 0..3 {
            let (u, v) = (spokes[k], spokes[(k + 1) % 3]);
            let doubled_area = u.cross(v).length();
            angles += bevy_math::ops::atan2(doubled_area, u.dot(v));
            doubled_areas += doubled_area;
        }
        let deficit = (core::f32::consts::TAU - angles).max(0.0);
        let curvature = bevy_math::ops::sqrt(2.0 * deficit / doubled_areas);
        curvature.is_finite().then_some(curvature)
    }
}

#[cfg_attr(not(unoptimized), inline(always))]
fn measure_faces<S: Simd>(simd: S, triangles: &[[u32; 3]], positions: &[Vec3], faces: &mut [Face]) {
    let nothing = VectorLanes::splat(simd, Vec3::ZERO);
    for (triangles, faces) in triangles.chunks(WIDTH).zip(faces.chunks_mut(WIDTH)) {
        let [a, b, c] = TriangleLanes::gather(simd, positions, triangles).0;
        let (u, v) = (b - a, c - a);
        // Scaled first: the square of an area is of order length⁴, and leaves the range of f32 before lengths do.
        let extent_u = u.x.abs().max(u.y.abs()).max(u.z.abs());
        let extent = extent_u.max(v.x.abs()).max(v.y.abs()).max(v.z.abs());
        let has_extent = extent.simd_gt(0.0);
        let normal = VectorLanes::select(has_extent, u.over(extent).cross(v.over(extent)), nothing);
        let doubled_area = normal.dot(normal).sqrt() * extent * extent;
        let VectorLanes { x, y, z } = normal.normalized().0;
        for (face, row) in faces.iter_mut().zip(rows([x, y, z, doubled_area])) {
            row.store_slice(face);
        }
    }
}

fn measure_bends(hinges: &[Hinge], faces: &[Face], positions: &[Vec3], bends: &mut [[f32; 2]]) {
    dispatch!(simd => {
        for (hinges, bends) in hinges.chunks(WIDTH).zip(bends.chunks_mut(WIDTH)) {
            let [dihedrals, curvatures] = HingeLanes::gather(simd, hinges, faces, positions).bend();
            let (low, high) = dihedrals.interleave(curvatures);
            let (first, second) = bends.split_at_mut(bends.len().min(WIDTH / 2));
            store_first(low, first.as_flattened_mut());
            store_first(high, second.as_flattened_mut());
        }
    });
}
