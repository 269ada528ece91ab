//! Judges a cloth at the end of a scene in f64, whoever has moved it: triangles that cross, and vertices inside.

use circumsphere_examples::scenes::truth::Solid;
use circumsphere_support::scenes::Mesh;
use circumsphere_truth::{exact_weld, point_triangle, touching_pairs_between_tree, touching_pairs_tree};
use glam::DVec3;
use serde::Serialize;

use crate::cloth_scenes::{ClothScene, Obstacle};

/// What is wrong with the end of a scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Crossings {
    /// Pairs of triangles of the cloth that cross, without neighbors.
    pub with_itself: usize,
    /// Pairs of a triangle of the cloth and one of the obstacle that cross. If the obstacle is a ball without a mesh,
    /// triangles of the cloth that reach into it.
    pub with_obstacle: usize,
    /// Vertices inside the obstacle or below the ground. Vertices with a coordinate that is not finite count too.
    /// Otherwise a cloth that has exploded would pass for one that was stopped.
    pub vertices_inside: usize,
}

impl Crossings {
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }

    /// Judges the cloth of a scene at these vertex positions.
    ///
    /// # Panics
    /// If the number of positions is not that of the cloth's vertices.
    pub fn of(scene: &ClothScene, positions: &[[f32; 3]]) -> Self {
        let rest = doubles(&scene.cloth.positions);
        let positions = doubles(positions);
        assert_eq!(positions.len(), rest.len(), "a position per vertex");
        let triangles = &scene.cloth.triangles;
        let finite: Vec<DVec3> = positions.iter().copied().filter(|position| position.is_finite()).collect();
        let count = |solid: Solid| finite.iter().filter(|&&point| solid.contains(point)).count();
        let inside = match &scene.obstacle {
            Obstacle::Ball(radius) => count(Solid::Ball(f64::from(*radius))),
            Obstacle::Closed(mesh) => count(Solid::Mesh(doubles(&mesh.positions), mesh.triangles.clone())),
            Obstacle::Ground(mesh) => vertices_below(&finite, mesh),
        };
        let with_obstacle = match &scene.obstacle {
            Obstacle::Ball(radius) => triangles_in_ball(f64::from(*radius), &positions, triangles),
            Obstacle::Closed(mesh) | Obstacle::Ground(mesh) => {
                let fixed = doubles(&mesh.positions);
                touching_pairs_between_tree(&positions, triangles, &fixed, &mesh.triangles, 0.0).len()
            }
        };
        Self {
            // Neighbors are determined at rest. Vertices that coincide later are not neighbors.
            with_itself: touching_pairs_tree(&positions, triangles, &exact_weld(&rest), 0.0).len(),
            with_obstacle,
            vertices_inside: inside + positions.len() - finite.len(),
        }
    }
}

fn doubles(positions: &[[f32; 3]]) -> Vec<DVec3> {
    positions.iter().map(|position| DVec3::from_array(position.map(f64::from))).collect()
}

/// Number of triangles with a point inside a ball around the origin.
fn triangles_in_ball(radius: f64, positions: &[DVec3], triangles: &[[u32; 3]]) -> usize {
    let ball = Solid::Ball(radius);
    let corners = triangles.iter().map(|triangle| triangle.map(|vertex| positions[vertex as usize]));
    let finite = corners.filter(|corners| corners.iter().all(|corner| corner.is_finite()));
    finite.filter(|corners| ball.contains(point_triangle(DVec3::ZERO, corners).point)).count()
}

/// Number of points below ground. A point is below if the line from it straight up to the highest ground meets ground.
fn vertices_below(points: &[DVec3], ground: &Mesh) -> usize {
    let ground_positions = doubles(&ground.positions);
    let top = ground_positions.iter().fold(f64::NEG_INFINITY, |top, position| top.max(position.y));
    let ends = points.iter().map(|point| DVec3::new(point.x, point.y.max(top), point.z));
    let lines: Vec<DVec3> = points.iter().copied().chain(ends).collect();
    // A triangle without area counts as a segment.
    let count = points.len() as u32;
    let segments: Vec<[u32; 3]> = (0..count).map(|point| [point, count + point, count + point]).collect();
    let mut met: Vec<u32> = touching_pairs_between_tree(&lines, &segments, &ground_positions, &ground.triangles, 0.0)
        .iter()
        .map(|pair| pair.triangle_a)
        .collect();
    met.dedup();
    met.len()
}
