//! Shared by the kernel's tests: closed forms in f64, and random triangles of a given shape.

use bevy_circumsphere::kernel::{
    mesh::topology::SurfaceTopology,
    spheres::{
        circumsphere::{OffsetSpheres, RecipeSettings},
        cone::SafetyCones,
        curvature::{CurvatureEstimator, Curvatures},
    },
};
use circumsphere_support::scenes::Mesh;
use glam::{DQuat, DVec3, Vec3};

use crate::common::Random;

/// Half a unit in the last place of an f32, relative: the error of one rounding.
pub const ROUNDING: f64 = f32::EPSILON as f64 * 0.5;

pub fn positions(mesh: &Mesh) -> Vec<Vec3> {
    mesh.positions.iter().copied().map(Vec3::from).collect()
}

pub fn exact(corners: [Vec3; 3]) -> [DVec3; 3] {
    corners.map(Vec3::as_dvec3)
}

pub fn corners(positions: &[Vec3], triangle: [u32; 3]) -> [Vec3; 3] {
    triangle.map(|vertex| positions[vertex as usize])
}

/// Triangles that share no vertex, three vertices each.
pub fn independent(triangles: &[[Vec3; 3]]) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let count = triangles.len() as u32;
    (triangles.concat(), (0..count).map(|triangle| [0, 1, 2].map(|corner| 3 * triangle + corner)).collect())
}

pub fn random_rotation(random: &mut Random) -> DQuat {
    DQuat::from_axis_angle(random.direction(), random.range(-3.2, 3.2))
}

pub fn longest_edge(corners: &[DVec3; 3]) -> f64 {
    (0..3).map(|k| corners[k].distance(corners[(k + 1) % 3])).fold(0.0, f64::max)
}

pub fn largest_coordinate(points: &[DVec3]) -> f64 {
    points.iter().map(|point| point.abs().max_element()).fold(0.0, f64::max)
}

/// The angle at a corner.
pub fn angle_at(corners: &[DVec3; 3], corner: usize) -> f64 {
    let (u, v) = (corners[(corner + 1) % 3] - corners[corner], corners[(corner + 2) % 3] - corners[corner]);
    u.cross(v).length().atan2(u.dot(v))
}

/// The largest angle and its corner.
pub fn largest_angle(corners: &[DVec3; 3]) -> (f64, usize) {
    (0..3).map(|corner| (angle_at(corners, corner), corner)).fold((0.0, 0), |a, b| if b.0 > a.0 { b } else { a })
}

/// A triangle in coordinates along and across one of its edges.
pub struct Planar {
    pub start: DVec3,
    pub along: DVec3,
    pub across: DVec3,
    pub length: f64,
    /// The third corner.
    pub apex: [f64; 2],
}

impl Planar {
    /// Seen from the edge opposite `apex`.
    pub fn new(corners: &[DVec3; 3], apex: usize) -> Self {
        let (start, end) = (corners[(apex + 1) % 3], corners[(apex + 2) % 3]);
        let (along, length) = ((end - start).normalize(), (end - start).length());
        let offset = corners[apex] - start;
        let rest = offset - along * offset.dot(along);
        // Repeated, so that a sliver's second direction is perpendicular to the first to full precision.
        let rest = rest - along * rest.dot(along);
        Self { start, along, across: rest.normalize(), length, apex: [offset.dot(along), rest.length()] }
    }

    /// How far across the edge the point of its perpendicular bisector lies that is equally far from the ends and the
    /// apex.
    pub fn circumcenter_across(&self) -> f64 {
        let [x, y] = self.apex;
        (y * y + x * x - x * self.length) / (2.0 * y)
    }

    pub fn at_middle(&self, across: f64) -> DVec3 {
        self.start + self.along * (0.5 * self.length) + self.across * across
    }
}

/// Circumcenter and circumradius, from the perpendicular bisector of the longest edge.
pub fn circumcircle(corners: &[DVec3; 3]) -> (DVec3, f64) {
    let planar = Planar::new(corners, largest_angle(corners).1);
    let across = planar.circumcenter_across();
    (planar.at_middle(across), across.hypot(0.5 * planar.length))
}

/// The in-plane center and its distance from the ends of the longest edge, as the kernel documents them: the
/// circumcenter, but at most √3 half edges outside the longest edge.
pub fn bounded_center(corners: &[DVec3; 3]) -> (DVec3, f64) {
    let planar = Planar::new(corners, largest_angle(corners).1);
    let half = 0.5 * planar.length;
    let across = planar.circumcenter_across().max(-3f64.sqrt() * half);
    (planar.at_middle(across), across.hypot(half))
}

/// A triangle with two given angles and a given longest edge, rotated at random, moved by `offset`, in stored
/// precision.
pub fn triangle_with_angles(random: &mut Random, first: f64, second: f64, longest: f64, offset: DVec3) -> [Vec3; 3] {
    let third = std::f64::consts::PI - first - second;
    // Law of sines for the longest edge.
    let unit = longest / first.sin().max(second.sin()).max(third.sin());
    let mut corners = [
        DVec3::ZERO,
        DVec3::X * (unit * third.sin()),
        DVec3::new(first.cos(), first.sin(), 0.0) * (unit * second.sin()),
    ];
    corners.rotate_left(random.below(3));
    if random.below(2) == 0 {
        corners.swap(0, 1);
    }
    let (turn, shift) = (random_rotation(random), random.vector() * longest);
    corners.map(|corner| (turn * (corner + shift) + offset).as_vec3())
}

/// Spheres and cones at one moment, from measured curvature.
pub struct Spheres {
    pub topology: SurfaceTopology,
    pub curvatures: Curvatures,
    pub offset: OffsetSpheres,
    pub cones: SafetyCones,
    pub settings: RecipeSettings,
}

impl Spheres {
    pub fn new(positions: &[Vec3], triangles: &[[u32; 3]], settings: RecipeSettings) -> Self {
        let mut spheres = Self {
            topology: SurfaceTopology::new(positions, triangles).expect("the mesh is valid"),
            curvatures: Curvatures::default(),
            offset: OffsetSpheres::default(),
            cones: SafetyCones::default(),
            settings,
        };
        assert_eq!(spheres.update(positions), triangles.len(), "the first update makes every recipe");
        spheres
    }

    /// Runs one tick. Returns the number of refreshed recipes.
    pub fn update(&mut self, positions: &[Vec3]) -> usize {
        self.curvatures.measure(&self.topology, positions, CurvatureEstimator::SignedEdge);
        let (curvatures, dihedrals) = (&self.curvatures.curvatures, &self.curvatures.dihedrals);
        let triangles = self.topology.triangles();
        self.offset.refit(positions, triangles, curvatures, dihedrals, self.settings, &mut self.cones)
    }
}
