//! Curvature, spheres, and cones of any mesh at any size: never NaN, and balls contain their triangles however stale.

use crate::strategies::{mesh, motion, placement};
use bevy_circumsphere::{
    geometry::{CurvatureEstimator, SurfaceTopology},
    kernel::spheres::{
        circumsphere::{
            Ball, OffsetSpheres, RecipeSettings, circumcenter, curvature_factor, enclosing_balls, in_plane_center,
        },
        cone::{Cap, SafetyCones, cap_contact},
        curvature::Curvatures,
    },
};
use glam::Vec3;
use proptest::prelude::*;

use crate::harness::{Count, for_all, points};

/// Settings of recipes that the plugin accepts, useful or not.
fn recipe() -> impl Strategy<Value = RecipeSettings> {
    let phi = prop_oneof![Just(0.0f32), 0.1f32..10.0, Just(1.0e6)];
    let curvature_threshold = prop_oneof![0.1f32..5.0, Just(f32::MIN_POSITIVE), Just(f32::MAX)];
    let delta = prop_oneof![Just(0.0f32), 0.1f32..2.0, Just(f32::MAX)];
    (phi, curvature_threshold, delta).prop_map(|(phi, curvature_threshold, delta)| RecipeSettings {
        sphere_offset: phi,
        curvature_threshold,
        refit_threshold: delta,
    })
}

fn estimator() -> impl Strategy<Value = CurvatureEstimator> {
    prop_oneof![Just(CurvatureEstimator::SignedEdge), Just(CurvatureEstimator::DualAngleDeficit)]
}

/// Any finite number, by its bits.
fn finite() -> impl Strategy<Value = f32> {
    any::<u32>().prop_map(f32::from_bits).prop_filter("finite", |value| value.is_finite())
}

fn finite_point() -> impl Strategy<Value = Vec3> {
    prop::array::uniform3(finite()).prop_map(Vec3::from_array)
}

/// Follows a surface through its positions.
#[derive(Default)]
struct Spheres {
    curvatures: Curvatures,
    offset: OffsetSpheres,
    cones: SafetyCones,
    enclosing: Vec<Ball>,
}

impl Spheres {
    /// Returns the number of refreshed recipes.
    fn follow(
        &mut self,
        topology: &SurfaceTopology,
        positions: &[Vec3],
        estimator: CurvatureEstimator,
        recipe: RecipeSettings,
    ) -> usize {
        let triangles = topology.triangles();
        self.curvatures.measure(topology, positions, estimator);
        enclosing_balls(positions, triangles, &mut self.enclosing);
        let Curvatures { curvatures, dihedrals, .. } = &self.curvatures;
        self.offset.refit(positions, triangles, curvatures, dihedrals, recipe, &mut self.cones)
    }

    fn ball(&self, triangle: usize) -> Ball {
        Ball { center: self.offset.centers[triangle], radius: self.offset.radii[triangle] }
    }

    fn assert_numbers(&self, corners: &[[Vec3; 3]]) {
        for (triangle, corners) in corners.iter().enumerate() {
            assert!(!self.curvatures.curvatures[triangle].is_nan(), "curvature of {corners:?}");
            let dihedrals = self.curvatures.dihedrals[triangle];
            assert!(dihedrals.iter().all(|angle| angle.abs() <= std::f32::consts::PI), "{dihedrals:?} of {corners:?}");
            for ball in [self.ball(triangle), self.enclosing[triangle], in_plane_center(*corners)] {
                assert!(!ball.center.is_nan() && ball.radius >= 0.0, "{ball:?} of {corners:?}");
            }
            assert!(self.offset.heights[triangle] >= 0.0, "{} of {corners:?}", self.offset.heights[triangle]);
            let (axis, cosine) = (self.cones.axes[triangle], self.cones.cosines[triangle]);
            assert!(axis.is_finite() && (-1.0..=1.0).contains(&cosine), "{axis} {cosine} of {corners:?}");
            if let Some((_, offset, radius)) = circumcenter(*corners) {
                assert!(!offset.is_nan() && radius >= 0.0, "{offset} {radius} of {corners:?}");
            }
        }
    }
}

fn all_corners(positions: &[Vec3], triangles: &[[u32; 3]]) -> Vec<[Vec3; 3]> {
    triangles.iter().map(|corners| corners.map(|vertex| positions[vertex as usize])).collect()
}

#[test]
fn balls_contain_their_triangles_however_stale() {
    let (stale, outgrown) = (Count::default(), Count::default());
    let motions = prop::collection::vec(motion(), 1..5);
    let case = (mesh(), motions, placement(), estimator(), recipe());
    for_all(file!(), 1500, case, |(mesh, motions, placement, estimator, recipe)| {
        let rest = points(&placement.apply(mesh.clone()));
        let topology = SurfaceTopology::new(&rest, &mesh.triangles).expect("it is valid");
        let mut spheres = Spheres::default();
        spheres.follow(&topology, &rest, estimator, recipe);
        let mut current = mesh;
        for motion in motions {
            let first: Vec<Ball> = (0..topology.triangles().len()).map(|triangle| spheres.ball(triangle)).collect();
            current = motion.apply(current);
            let positions = points(&placement.apply(current.clone()));
            let refreshed = spheres.follow(&topology, &positions, estimator, recipe);
            stale.add(topology.triangles().len() - refreshed);
            let corners = all_corners(&positions, topology.triangles());
            spheres.assert_numbers(&corners);
            for (triangle, corners) in corners.iter().enumerate() {
                for ball in [spheres.ball(triangle), spheres.enclosing[triangle]] {
                    assert!(corners.iter().all(|&corner| contains(ball, corner)), "{ball:?} without {corners:?}");
                }
                outgrown.add(usize::from(!corners.iter().all(|&corner| contains(first[triangle], corner))));
            }
        }
    });
    stale.assert_at_least(50_000, "spheres with a stale recipe");
    // A sphere that was not updated would have failed.
    outgrown.assert_at_least(50_000, "triangles outside of their last sphere");
}

/// In f64, without slack: radii are measured from the stored center and enlarged by more than their rounding.
fn contains(ball: Ball, corner: Vec3) -> bool {
    corner.as_dvec3().distance(ball.center.as_dvec3()) <= f64::from(ball.radius)
}

#[test]
fn spheres_and_cones_are_numbers_for_any_finite_triangles() {
    let corners = prop::collection::vec(prop::array::uniform3(finite_point()), 1..4);
    // Triangles with common edges, which determine the curvature.
    let hinge = prop::array::uniform5(finite_point())
        .prop_map(|[a, b, c, d, e]| vec![[a, b, c], [b, a, d], [c, b, e], [a, c, e]]);
    for_all(file!(), 20_000, (prop_oneof![corners, hinge], estimator(), recipe()), |(corners, estimator, recipe)| {
        let positions: Vec<Vec3> = corners.iter().flatten().copied().collect();
        let triangles: Vec<[u32; 3]> = (0..corners.len() as u32).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
        let topology = SurfaceTopology::new(&positions, &triangles).expect("finite positions are accepted");
        let mut spheres = Spheres::default();
        spheres.follow(&topology, &positions, estimator, recipe);
        spheres.assert_numbers(&corners);
        // Stale: the same triangles with their vertices in a different order.
        let turned: Vec<Vec3> = corners.iter().rev().flat_map(|[a, b, c]| [*c, *a, *b]).collect();
        spheres.follow(&topology, &turned, estimator, recipe);
        spheres.assert_numbers(&all_corners(&turned, &triangles));
    });
}

#[test]
fn curvature_factors_and_cap_contacts_are_numbers_for_any_finite_input() {
    let met = Count::default();
    let cap = || {
        (finite_point(), finite(), finite(), prop::array::uniform3(-1.0f32..1.0), -1.0f32..1.0).prop_map(
            |(center, radius, height, axis, cosine)| {
                let radius = radius.abs();
                let axis = Vec3::from_array(axis).normalize_or_zero();
                Cap { center, radius, height: height.abs().min(radius), axis, cosine }
            },
        )
    };
    for_all(file!(), 20_000, (cap(), cap(), any::<bool>(), finite()), |(a, mut b, concentric, curvature)| {
        if concentric {
            b.center = a.center;
        }
        let factor = curvature_factor(curvature, a.radius, b.radius.max(f32::MIN_POSITIVE));
        assert!((0.0..=1.0).contains(&factor), "{factor} of {curvature}, {}, {}", a.radius, b.radius);
        if let Some(contact) = cap_contact(&a, &b) {
            met.add(1);
            assert!(!contact.point_a.is_nan() && !contact.point_b.is_nan(), "{contact:?} of {a:?} and {b:?}");
            assert!(contact.direction.is_finite() && !contact.gap.is_nan(), "{contact:?} of {a:?} and {b:?}");
        }
    });
    met.assert_at_least(5_000, "caps that met");
}
