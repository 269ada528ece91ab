//! Curvature, spheres, and cones on any bit patterns. Nothing panics, finite input gives no NaN, and for coordinates of
//! reasonable magnitude every ball contains its triangle, fresh or stale.

use bevy_circumsphere::kernel::{
    pair::{FoundPairs, PairSettings},
    spheres::{
        circumsphere::{
            Ball, OffsetSpheres, RecipeSettings, circumcenter, curvature_factor, enclosing_balls, in_plane_center,
        },
        cone::SafetyCones,
        contacts::{FoundSpheres, ball_contacts, meeting_caps, overlapping_ball_contacts},
        curvature::{CurvatureEstimator, Curvatures},
        pairs::{BallSide, CapSide, overlapping_caps},
    },
};
use glam::Vec3;

use crate::{input::Input, meshes::FuzzedSurface};

/// The largest height of a sphere's center that the plugin's settings allow, in radii.
const LARGEST_PHI: f32 = 1.0e6;

/// A surface, the positions it moves to, and the settings of its spheres.
pub fn spheres(bytes: &[u8]) {
    let mut input = Input::new(bytes);
    let flags = input.byte();
    let flag = |bit: u8| flags & (1 << bit) != 0;
    let estimator = if flag(0) { CurvatureEstimator::DualAngleDeficit } else { CurvatureEstimator::SignedEdge };
    let recipe = RecipeSettings {
        sphere_offset: positive(&mut input, flag(1)).min(LARGEST_PHI),
        curvature_threshold: positive(&mut input, flag(2)).max(f32::MIN_POSITIVE),
        refit_threshold: positive(&mut input, flag(3)),
    };
    let written = input.coordinates();
    let mut surface = FuzzedSurface::new(&mut input, written);
    let mut state = State::default();
    let mut moved = true;
    while moved {
        state.follow(&surface, estimator, recipe);
        if surface.is_finite() {
            state.check(&surface);
            detect(&surface, &state, flag(4), flag(5));
        }
        moved = !input.is_empty();
        if moved {
            let written = input.coordinates();
            surface.positions = input.points(surface.positions.len(), written);
        }
    }
}

/// A non-negative number: any bit pattern without its sign, or one byte in eighths. NaN becomes 0.
fn positive(input: &mut Input<'_>, any: bool) -> f32 {
    let value = if any { input.float().abs() } else { f32::from(input.byte()) / 8.0 };
    if value.is_nan() { 0.0 } else { value.min(f32::MAX) }
}

#[derive(Default)]
struct State {
    curvatures: Curvatures,
    spheres: OffsetSpheres,
    cones: SafetyCones,
    balls: Vec<Ball>,
    was_finite: bool,
}

impl State {
    fn follow(&mut self, surface: &FuzzedSurface, estimator: CurvatureEstimator, recipe: RecipeSettings) {
        let FuzzedSurface { topology, positions } = surface;
        if !self.was_finite {
            // The plugin quarantines a surface while it is not finite, and discards its spheres.
            self.spheres.forget();
            self.cones = SafetyCones::default();
        }
        self.was_finite = surface.is_finite();
        self.curvatures.measure(topology, positions, estimator);
        let Curvatures { curvatures, dihedrals, .. } = &self.curvatures;
        self.spheres.refit(positions, topology.triangles(), curvatures, dihedrals, recipe, &mut self.cones);
        enclosing_balls(positions, topology.triangles(), &mut self.balls);
    }

    /// For finite positions.
    fn check(&self, surface: &FuzzedSurface) {
        let what = |triangle: usize| {
            format!("triangle {triangle} at {:?}", surface.corners(triangle as u32).map(|corner| corner.to_array()))
        };
        for triangle in 0..surface.topology.triangles().len() {
            let corners = surface.corners(triangle as u32);
            let curvature = self.curvatures.curvatures[triangle];
            assert!(!curvature.is_nan(), "the curvature is NaN: {}", what(triangle));
            let dihedrals = self.curvatures.dihedrals[triangle];
            // The largest angle in f32 rounds to slightly more than π.
            assert!(dihedrals.iter().all(|angle| angle.abs() <= std::f32::consts::PI), "{dihedrals:?}");
            assert_no_nan(in_plane_center(corners), "in-plane center", &what(triangle));
            assert_no_nan(self.balls[triangle], "enclosing ball", &what(triangle));
            let sphere = Ball { center: self.spheres.centers[triangle], radius: self.spheres.radii[triangle] };
            assert_no_nan(sphere, "offset sphere", &what(triangle));
            assert!(!self.spheres.heights[triangle].is_nan(), "the height is NaN: {}", what(triangle));
            let (axis, cosine) = (self.cones.axes[triangle], self.cones.cosines[triangle]);
            assert!(!axis.is_nan() && !cosine.is_nan(), "the cone is NaN: {axis} {cosine} {}", what(triangle));
            assert!((-1.0..=1.0).contains(&cosine), "{cosine} is not a cosine: {}", what(triangle));
            if let Some((_, offset, radius)) = circumcenter(corners) {
                assert!(!offset.is_nan() && radius >= 0.0, "the circumcenter is NaN: {}", what(triangle));
            }
            assert!(
                (0.0..=1.0).contains(&curvature_factor(curvature, sphere.radius.min(f32::MAX), 1.0)),
                "{}",
                what(triangle)
            );
            if surface.is_sane() {
                for (name, ball) in [("enclosing ball", self.balls[triangle]), ("offset sphere", sphere)] {
                    assert_contains(ball, corners, name);
                }
            }
        }
    }
}

fn assert_no_nan(ball: Ball, name: &str, what: &str) {
    assert!(!ball.center.is_nan() && ball.radius >= 0.0, "the {name} {ball:?} is invalid: {what}");
}

fn assert_contains(ball: Ball, corners: [Vec3; 3], name: &str) {
    for corner in corners {
        let distance = corner.as_dvec3().distance(ball.center.as_dvec3());
        assert!(distance <= f64::from(ball.radius), "the {name} {ball:?} does not contain {corner}: {corners:?}");
    }
}

/// The stages over pairs, for the surface with itself.
fn detect(surface: &FuzzedSurface, state: &State, cull: bool, one_sided: bool) {
    let FuzzedSurface { topology, positions } = surface;
    let side = surface.side(one_sided, false);
    let count = topology.triangles().len() as u32;
    let candidates: Vec<[u32; 2]> = (0..count).flat_map(|a| (a + 1..count).map(move |b| [a, b])).collect();
    let distance = 0.5;
    let settings = PairSettings {
        contact_distance: distance,
        reported_distance: distance,
        range: distance,
        scale: 1.0,
        bulge: 0.0,
        cull,
        same_surface: true,
        any_left_out: false,
    };
    let (mut found, mut overlapping) = (FoundPairs::default(), Vec::new());
    let balls = BallSide { surface: side, balls: &state.balls, pose: None, rows: None };
    let mut noted = FoundSpheres::default();
    overlapping_ball_contacts(&balls, &balls, &candidates, &settings, &mut overlapping, &mut noted);
    ball_contacts(&balls, &balls, &overlapping, &settings, &mut found);
    check_found(&found, "balls", positions);
    let counts = [found.touching.len(), found.contacts.len()];
    assert_eq!([noted.touching, noted.contacts(&overlapping).count()], counts, "in one pass: {positions:?}");
    assert_eq!(noted.nearest, found.nearest, "in one pass: {positions:?}");

    found.clear();
    overlapping.clear();
    let mut meeting = Vec::new();
    let caps = CapSide { surface: side, spheres: &state.spheres, cones: &state.cones, pose: None, rows: None };
    overlapping_caps(&caps, &caps, &candidates, &settings, &mut overlapping);
    meeting_caps(&caps, &caps, &overlapping, &settings, &mut meeting, &mut found);
    assert!(found.contacts.len() <= meeting.len(), "caps that do not meet have a contact: {positions:?}");
    check_found(&found, "caps", positions);
}

fn check_found(found: &FoundPairs, what: &str, positions: &[Vec3]) {
    assert!(found.nearest >= 0.0, "{what}: the nearest is {} away: {positions:?}", found.nearest);
    for pair in &found.touching {
        assert!(pair.distance >= 0.0, "{what}: {pair:?}: {positions:?}");
    }
    for contact in &found.contacts {
        let numbers = [contact.barycentric_a, contact.barycentric_b];
        assert!(numbers.iter().flatten().all(|weight| !weight.is_nan()), "{what}: {contact:?}: {positions:?}");
        assert!(
            !(contact.normal.is_nan() || contact.point_b.is_nan() || contact.distance.is_nan()),
            "{what}: {contact:?}: {positions:?}"
        );
    }
}
