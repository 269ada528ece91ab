//! One curvature value per triangle, from its neighbors across shared edges, and the dihedral angles on the way.
//!
//! Two estimators: the signed edge curvature `β/d`, β the dihedral angle and `d` the distance of the unfolded
//! centroids across the edge; and the angle deficit of the dual mesh (centroids joined across edges), whose root over
//! the dual area is the mean curvature at valence three. First geometric stage of the sphere methods; `circumsphere`
//! reads what it writes.

#![expect(clippy::inline_always, reason = "what is not inlined is not compiled for the chosen instruction set")]

use core::f32::consts::FRAC_PI_2;

use fearless_simd::{Level, dispatch, f32x8, prelude::*};
use glam::Vec3;

use super::{
    ids::EdgeId,
    lanes::{TriangleLanes, VectorLanes, VectorRows, WIDTH, arc_tangent, stored},
    share::{LEAST_SHARE, OneByOne, PART, Share},
    topology::{Hinge, SurfaceTopology},
};

/// How the curvature of a triangle is estimated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CurvatureEstimator {
    /// The edge of largest `|β/d|`, signed: positive where the surface is convex seen from the side its normals point
    /// to. Holds on stretched meshes and at boundaries.
    #[default]
    SignedEdge,
    /// `sqrt(max(2π − Σα, 0) / A)` of the dual mesh at the triangle's centroid: the source paper's estimator, with
    /// the sum of the dual triangles' areas. At least 0. Needs all three neighbors: elsewhere the signed edge
    /// curvature stands in.
    DualAngleDeficit,
}

/// Curvatures and dihedral angles of a surface's triangles, and the buffers they are computed in.
#[derive(Clone, Debug, Default)]
pub struct Curvatures {
    /// Curvature of each triangle, in 1/length.
    pub curvatures: Vec<f32>,
    /// Dihedral angle across edge `k` of each triangle, in radians from −π to π: positive where convex, 0 at a
    /// boundary and next to a triangle without area.
    pub dihedrals: Vec<[f32; 3]>,
    /// How far the surface's normal turns away from each triangle's own before the next triangle takes over: the largest
    /// angle to a neighbor, in radians from 0 to π; at a boundary at least π/2, as a rim is met from any side.
    pub spreads: Vec<f32>,
    faces: Vec<Face>,
    centroids: Vec<Vec3>,
    bends: Vec<Bend>,
}

/// A triangle as its edges see it.
#[derive(Clone, Copy, Debug, Default)]
struct Face {
    /// Of length 1, or zero where the triangle has no area.
    normal: Vec3,
    doubled_area: f32,
}

/// How the surface bends across an edge: the dihedral angle, or what there is instead of one, and the curvature.
#[derive(Clone, Copy, Debug, Default)]
struct Bend {
    dihedral: f32,
    curvature: f32,
}

impl Bend {
    /// Where there is no triangle on the other side: no angle is as large.
    const RIM: Self = Self { dihedral: f32::INFINITY, curvature: 0.0 };

    /// Where there are several, each with an angle of its own.
    const BRANCH: Self = Self { dihedral: f32::NAN, curvature: 0.0 };

    #[inline]
    fn branches(self) -> bool {
        self.dihedral.is_nan()
    }

    /// 0 where there is none.
    #[inline]
    fn dihedral(self) -> f32 {
        if self.dihedral == f32::INFINITY { 0.0 } else { self.dihedral }
    }

    /// How far the surface's normal turns, π/2 at a rim.
    #[inline]
    fn turn(self) -> f32 {
        if self.dihedral == f32::INFINITY { FRAC_PI_2 } else { self.dihedral.abs() }
    }
}

/// Eight edges with a triangle on either side.
struct HingeLanes<S: Simd> {
    /// From one end to the other, as the first triangle runs through it.
    along: VectorLanes<S>,
    normals: [VectorLanes<S>; 2],
    doubled_areas: [f32x8<S>; 2],
    /// -1 where the second triangle is turned inside out.
    facing: f32x8<S>,
    /// 0 where there is no triangle on the other side.
    folds: f32x8<S>,
}

impl<S: Simd> HingeLanes<S> {
    #[inline(always)]
    fn gather(simd: S, hinges: &[Hinge], faces: &[Face], positions: &[Vec3]) -> Self {
        let (mut along, mut normals) = (VectorRows::ZERO, [VectorRows::ZERO; 2]);
        let (mut doubled_areas, mut facing, mut folds) = ([[0.0; WIDTH]; 2], [0.0; WIDTH], [0.0; WIDTH]);
        for (lane, hinge) in hinges.iter().enumerate().take(WIDTH) {
            let Hinge::Fold { triangles, ends: [from, to], turned } = *hinge else { continue };
            folds[lane] = 1.0;
            facing[lane] = if turned { -1.0 } else { 1.0 };
            along.set(lane, positions[to as usize] - positions[from as usize]);
            for side in 0..2 {
                let face = &faces[triangles[side] as usize];
                normals[side].set(lane, face.normal);
                doubled_areas[side][lane] = face.doubled_area;
            }
        }
        Self {
            along: VectorLanes::load(simd, &along),
            normals: [VectorLanes::load(simd, &normals[0]), VectorLanes::load(simd, &normals[1])],
            doubled_areas: [f32x8::from_slice(simd, &doubled_areas[0]), f32x8::from_slice(simd, &doubled_areas[1])],
            facing: f32x8::from_slice(simd, &facing),
            folds: f32x8::from_slice(simd, &folds),
        }
    }

    /// The dihedral angle and the curvature across each edge; 0 where either triangle has no area.
    #[inline(always)]
    fn bend(&self) -> [f32x8<S>; 2] {
        let simd = self.facing.simd;
        let (normal, other) = (self.normals[0], self.normals[1].scaled(self.facing));
        let sine = normal.cross(other).dot(self.along.normalized().0);
        let cosine = normal.dot(other);
        let (flat, one) = (f32x8::splat(simd, 0.0), f32x8::splat(simd, 1.0));
        let has_areas = normal.dot(normal).simd_gt(0.0) & other.dot(other).simd_gt(0.0);
        let dihedral = arc_tangent(sine, has_areas.select(cosine, one));
        let dihedral = (has_areas & self.folds.simd_gt(0.0)).select(dihedral, flat);
        let length = self.along.dot(self.along).sqrt();
        // (h_i + h_j) / 3 with h = doubled area / length.
        let distance = (self.doubled_areas[0] + self.doubled_areas[1]) / (length * 3.0);
        let has_distance = distance.simd_gt(0.0) & distance.is_finite();
        [dihedral, has_distance.select(dihedral / distance, flat)]
    }
}

impl Curvatures {
    /// Measures the surface at the given positions.
    pub fn measure(&mut self, topology: &SurfaceTopology, positions: &[Vec3], estimator: CurvatureEstimator) {
        self.measure_on(&OneByOne, topology, positions, estimator);
    }

    /// The same in tasks that may be shared.
    pub fn measure_on(
        &mut self,
        share: &impl Share,
        topology: &SurfaceTopology,
        positions: &[Vec3],
        estimator: CurvatureEstimator,
    ) {
        let Self { faces, bends, .. } = self;
        faces.resize(topology.triangles().len(), Face::default());
        let parts = topology.triangles().chunks(PART).zip(faces.chunks_mut(PART));
        share.hand_out(parts, topology.triangles().len() / LEAST_SHARE, |(triangles, faces)| {
            dispatch!(Level::new(), simd => measure_faces(simd, triangles, positions, faces));
        });
        bends.resize(topology.edges().len(), Bend::default());
        let parts = topology.hinges().chunks(PART).zip(bends.chunks_mut(PART));
        share.hand_out(parts, topology.edges().len() / LEAST_SHARE, |(hinges, bends)| {
            measure_bends(hinges, faces, positions, bends);
        });
        self.centroids.clear();
        if estimator == CurvatureEstimator::DualAngleDeficit {
            self.centroids.extend(topology.triangles().iter().map(|corners| {
                let [a, b, c] = corners.map(|vertex| positions[vertex as usize]);
                a + ((b - a) + (c - a)) / 3.0
            }));
        }
        self.measure_triangles(share, topology, positions);
        if estimator == CurvatureEstimator::DualAngleDeficit {
            for triangle in 0..topology.triangles().len() {
                if let Some(curvature) = self.dual_angle_deficit(topology, triangle) {
                    self.curvatures[triangle] = curvature;
                }
            }
        }
    }

    fn measure_triangles(&mut self, share: &impl Share, topology: &SurfaceTopology, positions: &[Vec3]) {
        let count = topology.triangles().len();
        let [mut curvatures, mut spreads] = [&mut self.curvatures, &mut self.spreads].map(std::mem::take);
        let mut dihedrals = std::mem::take(&mut self.dihedrals);
        curvatures.resize(count, 0.0);
        dihedrals.resize(count, [0.0; 3]);
        spreads.resize(count, 0.0);
        let written = curvatures.chunks_mut(PART).zip(dihedrals.chunks_mut(PART)).zip(spreads.chunks_mut(PART));
        let parts = topology.triangle_edges().chunks(PART).zip(written).enumerate();
        share.hand_out(parts, count / LEAST_SHARE, |(part, (edges, ((curvatures, dihedrals), spreads)))| {
            let written = curvatures.iter_mut().zip(dihedrals).zip(spreads);
            for (triangle, (edges, ((curvature, dihedrals), spread))) in (part * PART..).zip(edges.iter().zip(written))
            {
                let bends = self.bends_of(topology, positions, triangle, edges);
                *dihedrals = bends.map(Bend::dihedral);
                *spread =
                    bends.map(Bend::turn).into_iter().fold(0.0, |most, turn| if turn > most { turn } else { most });
                let steeper =
                    |most: f32, bend: &Bend| if bend.curvature.abs() > most.abs() { bend.curvature } else { most };
                let steepest = bends.iter().fold(0.0, steeper);
                *curvature = if steepest.is_finite() { steepest } else { f32::MAX };
            }
        });
        (self.curvatures, self.dihedrals, self.spreads) = (curvatures, dihedrals, spreads);
    }

    /// The bends across the edges of a triangle.
    #[inline]
    fn bends_of(&self, topology: &SurfaceTopology, positions: &[Vec3], triangle: usize, edges: &[u32; 3]) -> [Bend; 3] {
        let mut bends = edges.map(|edge| self.bends[edge as usize]);
        if bends.iter().any(|bend| bend.branches()) {
            for k in 0..3 {
                if bends[k].branches() {
                    bends[k] = self.steepest_bend(topology, positions, triangle, k);
                }
            }
        }
        bends
    }

    /// The bend across edge `k` of a triangle to that of several neighbors which folds most.
    #[cold]
    fn steepest_bend(&self, topology: &SurfaceTopology, positions: &[Vec3], triangle: usize, k: usize) -> Bend {
        let (own, edge) = (triangle as u32, topology.triangle_edges()[triangle][k]);
        let corners = topology.triangles()[triangle];
        // As the first one of the triangle's edges that is this one: a triangle may run through an edge twice.
        let side = (0..3).find(|&side| topology.triangle_edges()[triangle][side] == edge).unwrap_or(k);
        let mut steepest = Bend::default();
        for &other in topology.triangles_of_edge(EdgeId(edge)).iter().filter(|&&other| other != own) {
            let hinge = Hinge::Fold {
                triangles: [own, other],
                ends: [corners[side], corners[(side + 1) % 3]],
                turned: topology.runs_forward(own, edge) == topology.runs_forward(other, edge),
            };
            let mut bend = [Bend::default()];
            measure_bends(&[hinge], &self.faces, positions, &mut bend);
            if bend[0].turn() > steepest.turn() {
                steepest = bend[0];
            }
        }
        steepest
    }

    /// `None` where the triangle has not exactly one neighbor across each edge, or the dual triangles have no area.
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

#[inline(always)]
fn measure_faces<S: Simd>(simd: S, triangles: &[[u32; 3]], positions: &[Vec3], faces: &mut [Face]) {
    let nothing = VectorLanes::splat(simd, Vec3::ZERO);
    for (triangles, faces) in triangles.chunks(WIDTH).zip(faces.chunks_mut(WIDTH)) {
        let [a, b, c] = TriangleLanes::gather(simd, positions, triangles).0;
        let (u, v) = (b - a, c - a);
        // Scaled first: the square of an area is of order length⁴ and leaves the range of f32 before lengths do.
        let extent_u = u.x.abs().max(u.y.abs()).max(u.z.abs());
        let extent = extent_u.max(v.x.abs()).max(v.y.abs()).max(v.z.abs());
        let has_extent = extent.simd_gt(0.0);
        let normal = VectorLanes::select(has_extent, u.over(extent).cross(v.over(extent)), nothing);
        let doubled_areas = stored(normal.dot(normal).sqrt() * extent * extent);
        let normals = normal.normalized().0.stored();
        for (lane, face) in faces.iter_mut().enumerate().take(WIDTH) {
            *face = Face { normal: normals.get(lane), doubled_area: doubled_areas[lane] };
        }
    }
}

fn measure_bends(hinges: &[Hinge], faces: &[Face], positions: &[Vec3], bends: &mut [Bend]) {
    dispatch!(Level::new(), simd => {
        for (hinges, bends) in hinges.chunks(WIDTH).zip(bends.chunks_mut(WIDTH)) {
            let [dihedrals, curvatures] = HingeLanes::gather(simd, hinges, faces, positions).bend();
            write_bends(hinges, &stored(dihedrals), &stored(curvatures), bends);
        }
    });
}

#[inline(always)]
fn write_bends(hinges: &[Hinge], dihedrals: &[f32; WIDTH], curvatures: &[f32; WIDTH], bends: &mut [Bend]) {
    for (lane, (hinge, bend)) in hinges.iter().zip(bends).enumerate().take(WIDTH) {
        let (dihedral, curvature) = (dihedrals[lane], curvatures[lane]);
        *bend = match hinge {
            Hinge::Rim => Bend::RIM,
            Hinge::Fold { .. } => Bend { dihedral, curvature },
            Hinge::Branch => Bend::BRANCH,
        };
    }
}
