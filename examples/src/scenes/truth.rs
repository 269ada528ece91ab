//! Judges a scene in f64, independently of the detection that played it: triangles that cross, and vertices inside
//! surfaces and rigid shapes.

use super::Stage;
use bevy_circumsphere::prelude::*;
use bevy_ecs::prelude::*;
use bevy_transform::components::Transform;
use circumsphere_truth::{exact_weld, touching_pairs_tree};
use glam::{DQuat, DVec3, Vec3};
use parry3d::shape::{Shape, TypedShape};
use std::collections::HashMap;

/// Number of crossing pairs of triangles among those that may collide: of bodies with each other, with obstacles, and
/// with themselves if they have self-collision. Takes a second for 20,000 triangles.
pub fn crossing_pairs(stage: &Stage) -> usize {
    let (mut positions, mut triangles, mut weld, mut owners) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for (owner, entity) in stage.surfaces().enumerate() {
        let own = stage.world_positions(entity);
        let first = positions.len() as u32;
        // Neighbors are determined from the rest positions. Vertices that coincide later are not neighbors.
        let rest = if owner < stage.bodies.len() { exact_weld(stage.rest(entity)) } else { exact_weld(&own) };
        weld.extend(rest.iter().map(|vertex| first + vertex));
        let own_triangles = stage.surface(entity).topology().triangles();
        triangles.extend(own_triangles.iter().map(|corners| corners.map(|corner| first + corner)));
        owners.extend(own_triangles.iter().map(|_| owner));
        positions.extend(own);
    }
    let is_body = |owner: usize| owner < stage.bodies.len();
    let meets_itself: Vec<bool> =
        stage.surfaces().map(|entity| stage.app.world().get::<SelfCollision>(entity).is_some()).collect();
    let counts = |a: usize, b: usize| if a == b { meets_itself[a] } else { is_body(a) || is_body(b) };
    touching_pairs_tree(&positions, &triangles, &weld, 0.0)
        .iter()
        .filter(|pair| counts(owners[pair.triangle_a as usize], owners[pair.triangle_b as usize]))
        .count()
}

/// Number of body vertices with a coordinate that is not finite.
pub fn vertices_nowhere(stage: &Stage) -> usize {
    let nowhere = |&entity: &Entity| stage.positions(entity).iter().filter(|position| !position.is_finite()).count();
    stage.bodies.iter().map(nowhere).sum()
}

/// Number of body vertices inside another, closed surface.
pub fn vertices_inside(stage: &Stage) -> usize {
    let world: Vec<(Entity, Vec<DVec3>)> =
        stage.surfaces().map(|entity| (entity, stage.world_positions(entity))).collect();
    let mut count = 0;
    for (entity, positions) in &world {
        let topology = stage.surface(*entity).topology();
        if !topology.is_closed() {
            continue;
        }
        let closed = Closed::new(positions, topology.triangles());
        for (_, points) in world.iter().take(stage.bodies.len()).filter(|(other, _)| other != entity) {
            count += points.iter().filter(|&&point| closed.contains(point)).count();
        }
    }
    count
}

/// Depth in a rigid shape that counts as inside, in meters. Positions and poses of a few meters are rounded by about a
/// micrometer.
const ROUNDING: f64 = 1.0e-5;

/// Number of body vertices inside rigid shapes, or below shapes that are ground. Ground is a height field or a mesh
/// that is not closed, and faces up along its own y axis.
pub fn vertices_in_shapes(stage: &Stage) -> usize {
    let world: Vec<DVec3> = stage.bodies.iter().flat_map(|&body| stage.world_positions(body)).collect();
    let count = |&entity: &Entity| {
        let shape = stage.app.world().get::<RigidShape>(entity).expect("shapes are never removed");
        let transform = stage.app.world().get::<Transform>(entity).copied().unwrap_or_default();
        let (turn, offset) = (transform.rotation.as_dquat().normalize().inverse(), transform.translation.as_dvec3());
        let solid = Solid::of(&*shape.0);
        world.iter().filter(|&&point| solid.contains(turn * (point - offset))).count()
    };
    stage.shapes.iter().map(count).sum()
}

/// The volume of a rigid shape in its own frame, computed without any query of parry.
pub enum Solid {
    Ball(f64),
    Cuboid(DVec3),
    Capsule([DVec3; 2], f64),
    /// Below the plane through the origin with this outward normal.
    HalfSpace(DVec3),
    /// Half-height along y, and radius.
    Cylinder(f64, f64),
    Mesh(Vec<DVec3>, Vec<[u32; 3]>),
    /// Everything below triangles that face up.
    Ground(Vec<[DVec3; 3]>),
    Parts(Vec<(DQuat, DVec3, Self)>),
}

impl Solid {
    /// # Panics
    /// If no scene has a shape of this type.
    pub fn of(shape: &dyn Shape) -> Self {
        let doubles = |points: &[Vec3]| -> Vec<DVec3> { points.iter().map(|point| point.as_dvec3()).collect() };
        match shape.as_typed_shape() {
            TypedShape::Ball(ball) => Self::Ball(ball.radius.into()),
            TypedShape::Cuboid(cuboid) => Self::Cuboid(cuboid.half_extents.as_dvec3()),
            TypedShape::Capsule(capsule) => {
                Self::Capsule([capsule.segment.a, capsule.segment.b].map(Vec3::as_dvec3), capsule.radius.into())
            }
            TypedShape::HalfSpace(plane) => Self::HalfSpace(plane.normal.as_dvec3()),
            TypedShape::Cylinder(cylinder) => Self::Cylinder(cylinder.half_height.into(), cylinder.radius.into()),
            TypedShape::ConvexPolyhedron(hull) => {
                let (points, triangles) = hull.to_trimesh();
                Self::Mesh(doubles(&points), triangles)
            }
            TypedShape::TriMesh(mesh) => {
                let (points, triangles) = (doubles(mesh.vertices()), mesh.indices().to_vec());
                if is_closed(&triangles) { Self::Mesh(points, triangles) } else { Self::ground(&points, &triangles) }
            }
            TypedShape::HeightField(field) => {
                let (points, triangles) = field.to_trimesh();
                Self::ground(&doubles(&points), &triangles)
            }
            TypedShape::Compound(compound) => {
                let part = |(pose, part): &(parry3d::math::Pose, SharedShape)| {
                    (pose.rotation.as_dquat().normalize(), pose.translation.as_dvec3(), Self::of(&**part))
                };
                Self::Parts(compound.shapes().iter().map(part).collect())
            }
            _ => panic!("no scene has a {:?}", shape.shape_type()),
        }
    }

    fn ground(points: &[DVec3], triangles: &[[u32; 3]]) -> Self {
        Self::Ground(triangles.iter().map(|corners| corners.map(|corner| points[corner as usize])).collect())
    }

    /// Whether a point is deeper inside than the rounding tolerance.
    pub fn contains(&self, point: DVec3) -> bool {
        let depth = match self {
            Self::Ball(radius) => radius - point.length(),
            Self::Cuboid(half) => (*half - point.abs()).min_element(),
            Self::Capsule([start, end], radius) => {
                let axis = *end - *start;
                let share = ((point - *start).dot(axis) / axis.length_squared()).clamp(0.0, 1.0);
                radius - (point - *start - axis * share).length()
            }
            Self::HalfSpace(normal) => -normal.dot(point),
            Self::Cylinder(half_height, radius) => (half_height - point.y.abs()).min(radius - point.x.hypot(point.z)),
            Self::Mesh(points, triangles) => return Closed::new(points, triangles).contains(point),
            // The highest triangle above or below the point decides, because ground has no overhangs.
            Self::Ground(triangles) => {
                let heights = triangles.iter().filter_map(|corners| height_above(corners, point));
                heights.reduce(f64::max).unwrap_or(f64::NEG_INFINITY)
            }
            Self::Parts(parts) => {
                return parts.iter().any(|(turn, offset, part)| part.contains(turn.inverse() * (point - *offset)));
            }
        };
        depth > ROUNDING
    }
}

/// Height of a triangle above a point, along y. `None` if the point is beside it, or the triangle is vertical.
fn height_above(corners: &[DVec3; 3], point: DVec3) -> Option<f64> {
    let flat = |a: DVec3, b: DVec3| a.z * b.x - a.x * b.z;
    let [a, b, c] = corners.map(|corner| corner - point);
    let weights = [flat(b, c), flat(c, a), flat(a, b)];
    let area: f64 = weights.iter().sum();
    let is_within = area != 0.0 && weights.iter().all(|weight| weight * area.signum() >= 0.0);
    is_within.then(|| (a.y * weights[0] + b.y * weights[1] + c.y * weights[2]) / area)
}

/// Whether every edge is used once in each direction.
fn is_closed(triangles: &[[u32; 3]]) -> bool {
    let mut edges: HashMap<[u32; 2], [u32; 2]> = HashMap::new();
    for &[a, b, c] in triangles {
        for [from, to] in [[a, b], [b, c], [c, a]] {
            edges.entry([from.min(to), from.max(to)]).or_default()[usize::from(from > to)] += 1;
        }
    }
    edges.values().all(|&counts| counts == [1, 1])
}

/// A closed surface with either winding.
pub struct Closed<'a> {
    positions: &'a [DVec3],
    triangles: &'a [[u32; 3]],
    low: DVec3,
    high: DVec3,
}

impl<'a> Closed<'a> {
    pub fn new(positions: &'a [DVec3], triangles: &'a [[u32; 3]]) -> Self {
        let low = positions.iter().copied().fold(DVec3::INFINITY, DVec3::min);
        let high = positions.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
        Self { positions, triangles, low, high }
    }

    /// Whether the surface winds around the point.
    pub fn contains(&self, point: DVec3) -> bool {
        if point.cmplt(self.low).any() || point.cmpgt(self.high).any() {
            return false;
        }
        let mut winding = Winding::default();
        for corners in self.triangles {
            winding.add(corners.map(|corner| self.positions[corner as usize] - point));
        }
        winding.turns != 0
    }
}

/// Half the sum of solid angles: whole turns, and a complex number whose argument is the rest, at most half a turn either
/// way. A closed surface leaves no rest, and turns once around what is inside.
struct Winding {
    turns: i32,
    rest: [f64; 2],
}

impl Default for Winding {
    fn default() -> Self {
        Self { turns: 0, rest: [1.0, 0.0] }
    }
}

impl Winding {
    /// Adds the signed solid angle of a triangle as seen from the origin (van Oosterom and Strackee 1983). Half of it is
    /// the argument of a complex number. Numbers are multiplied where angles are added, which needs no arctangent.
    fn add(&mut self, [a, b, c]: [DVec3; 3]) {
        let [length_a, length_b, length_c] = [a.length(), b.length(), c.length()];
        let volume = a.dot(b.cross(c));
        let below = length_a * length_b * length_c + a.dot(b) * length_c + b.dot(c) * length_a + c.dot(a) * length_b;
        let [real, imaginary] = self.rest;
        let product = [real * below - imaginary * volume, real * volume + imaginary * below];
        let is_below = [imaginary, volume, product[1]].map(|part| part < 0.0);
        self.turns += match is_below {
            [false, false, true] => 1,
            [true, true, false] => -1,
            _ => 0,
        };
        let size = product[0].abs() + product[1].abs();
        if size > 0.0 {
            self.rest = product.map(|part| part / size);
        }
    }
}
