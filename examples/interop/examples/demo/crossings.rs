//! What is in each other, by an f64 reference that shares nothing with the library.

use std::{fmt, ops::AddAssign};

use bevy::{math::DVec3, prelude::*};
use bevy_circumsphere::{
    prelude::*,
    response::{XpbdBody, XpbdGarment},
};
use circumsphere_truth::{
    exact_weld, point_triangle, touching_pairs_between_tree, touching_pairs_tree, triangles_cross,
};

use crate::balls::{Ball, RADIUS};

/// Distance that counts as none, in meters.
const NONE: f64 = 1.0e-9;

/// How deep a ball may be in a cloth by rounding, in meters: a few units in the last place of single-precision
/// coordinates of some meters.
const ROUNDING: f64 = 5.0e-6;

/// Pairs of triangles that cross, and triangles that are in a ball.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Crossings {
    cape_and_skin: usize,
    cape_and_itself: usize,
    flag_and_itself: usize,
    cloth_and_balls: usize,
}

impl Crossings {
    /// All together.
    pub fn total(&self) -> usize {
        self.cape_and_skin + self.cape_and_itself + self.flag_and_itself + self.cloth_and_balls
    }
}

impl AddAssign for Crossings {
    fn add_assign(&mut self, other: Self) {
        self.cape_and_skin += other.cape_and_skin;
        self.cape_and_itself += other.cape_and_itself;
        self.flag_and_itself += other.flag_and_itself;
        self.cloth_and_balls += other.cloth_and_balls;
    }
}

impl fmt::Display for Crossings {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            formatter,
            "cape and skin {}, cape and itself {}, flag and itself {}, cloth and balls {}",
            self.cape_and_skin, self.cape_and_itself, self.flag_and_itself, self.cloth_and_balls
        )
    }
}

/// A surface in the world.
struct Placed {
    is_garment: bool,
    is_cloth: bool,
    positions: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
}

impl Placed {
    fn corners(&self, triangle: u32) -> [DVec3; 3] {
        self.triangles[triangle as usize].map(|corner| self.positions[corner as usize])
    }

    fn crossings_with_itself(&self) -> usize {
        let weld = exact_weld(&self.positions);
        let pairs = touching_pairs_tree(&self.positions, &self.triangles, &weld, NONE);
        let crosses = |a, b| triangles_cross(&self.corners(a), &self.corners(b));
        pairs.iter().filter(|pair| crosses(pair.triangle_a, pair.triangle_b)).count()
    }

    fn crossings_with(&self, other: &Self) -> usize {
        let pairs =
            touching_pairs_between_tree(&self.positions, &self.triangles, &other.positions, &other.triangles, NONE);
        let crosses = |a, b| triangles_cross(&self.corners(a), &other.corners(b));
        pairs.iter().filter(|pair| crosses(pair.triangle_a, pair.triangle_b)).count()
    }
}

/// Counts them at the end of a tick.
pub fn count(world: &mut World) -> Crossings {
    world.run_system_cached(count_system).expect("it has only parameters that are always there")
}

type Surface = (
    Entity,
    &'static DeformableSurface,
    &'static SurfacePositions,
    &'static SurfaceFrame,
    Has<XpbdGarment>,
    Has<XpbdBody>,
);

fn count_system(surfaces: Query<Surface>, balls: Query<Entity, With<Ball>>, transforms: TransformHelper) -> Crossings {
    let pose = |entity| transforms.compute_global_transform(entity).expect("it has a transform");
    let placed: Vec<Placed> = surfaces
        .iter()
        .map(|(entity, surface, positions, frame, is_garment, is_cloth)| {
            let pose = if *frame == SurfaceFrame::World { GlobalTransform::IDENTITY } else { pose(entity) };
            let pose = pose.affine();
            let (matrix, offset) = (pose.matrix3.as_dmat3(), pose.translation.as_dvec3());
            Placed {
                is_garment,
                is_cloth,
                positions: positions.0.iter().map(|at| matrix * at.as_dvec3() + offset).collect(),
                triangles: surface.topology().triangles().to_vec(),
            }
        })
        .collect();
    let mut found = Crossings::default();
    for cloth in placed.iter().filter(|surface| surface.is_cloth) {
        if cloth.is_garment {
            found.cape_and_itself += cloth.crossings_with_itself();
            let skins = placed.iter().filter(|surface| !surface.is_cloth);
            found.cape_and_skin += skins.map(|skin| cloth.crossings_with(skin)).sum::<usize>();
        } else {
            found.flag_and_itself += cloth.crossings_with_itself();
        }
        for center in balls.iter().map(|ball| pose(ball).translation().as_dvec3()) {
            let is_inside = |&triangle: &u32| {
                point_triangle(center, &cloth.corners(triangle)).distance < f64::from(RADIUS) - ROUNDING
            };
            found.cloth_and_balls += (0..cloth.triangles.len() as u32).filter(is_inside).count();
        }
    }
    found
}
