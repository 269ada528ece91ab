//! Surfaces that pass through each other between two ticks: closed forms, the certified times of the reference, and
//! cases that are not swept.

use bevy_app::prelude::*;
use bevy_circumsphere::{
    PreviousPositions,
    detection::{DetectionDiagnostics, StageDiagnostics, SweptImpacts},
    geometry::{Feature, FeatureKind},
    prelude::*,
};
use bevy_ecs::{prelude::*, system::RunSystemOnce};
use bevy_transform::components::Transform;
use circumsphere_support::{
    recording::{read_recording, recordings_folder},
    scenes::{Mesh, cuboid, icosphere, sheet_stack},
};
use circumsphere_truth::{ImpactTruth, MovingMesh, exact_weld, triangle_impacts_tree};
use glam::{DVec3, Quat, Vec3};

use crate::world::{
    Called, THIN, app, assert_near_vector, at, ball, fingerprint, insert, place, points, sheet, spawn, surface,
    write_positions,
};

/// The thickness of [`THIN`] surfaces.
const THICKNESS: f32 = 0.05;

/// How much too early an impact may be reported. Relative positions are exact or rounded to f64. The kernel resolves
/// 1.4e-14 of a size of a few units, and paths are at least a twentieth long.
const EARLY: f64 = 1.0e-10;

/// The values of an impact, as a reader sees them.
#[derive(Clone, Debug, PartialEq)]
pub struct Seen {
    a: Entity,
    pub b: Entity,
    pub time: f64,
    pub cause: ImpactCause,
    kind: FeatureKind,
    features: (Feature, Feature),
    pub triangles: (Option<TriangleId>, Option<TriangleId>),
    barycentrics: ([f32; 3], [f32; 3]),
    pub normal: Vec3,
    pub stencil: Vec<bevy_circumsphere::StencilEntry>,
}

impl From<Impact<'_>> for Seen {
    fn from(impact: Impact<'_>) -> Self {
        Self {
            a: impact.a(),
            b: impact.b(),
            time: impact.time(),
            cause: impact.cause(),
            kind: impact.kind(),
            features: impact.features(),
            triangles: impact.triangles(),
            barycentrics: impact.barycentrics(),
            normal: impact.normal(),
            stencil: impact.stencil().to_vec(),
        }
    }
}

fn read<T: Send + 'static>(app: &mut App, read: impl Fn(SurfaceImpacts) -> T + Send + Sync + 'static) -> T {
    app.world_mut().run_system_once(move |impacts: SurfaceImpacts| read(impacts)).expect("impacts can be read")
}

pub fn all(app: &mut App) -> Vec<Seen> {
    read(app, |impacts| impacts.iter().map(Seen::from).collect())
}

pub fn first(app: &mut App, a: Entity, b: Entity) -> Option<Seen> {
    read(app, move |impacts| impacts.first(a, b).map(Seen::from))
}

fn diagnostics(app: &App) -> &DetectionDiagnostics {
    app.world().resource::<DetectionDiagnostics>()
}

/// The diagnostics of the stage, if it ran.
fn stage(app: &App) -> Option<StageDiagnostics> {
    diagnostics(app).stages.iter().find(|stage| stage.name == "swept").copied()
}

#[track_caller]
fn assert_time(found: f64, expected: f64, what: impl std::fmt::Debug) {
    assert!(found <= expected && found > expected - EARLY, "{what:?}: {found} is not just before {expected}");
}

/// The current vertices of a surface in the world.
fn world_points(app: &App, entity: Entity) -> Vec<DVec3> {
    let transform = app.world().get::<Transform>(entity).expect("the entity has a transform");
    // An f32 rotation is normalized to only seven digits, so normalize it again in f64.
    let turn = transform.rotation.as_dquat().normalize();
    let positions = app.world().get::<SurfacePositions>(entity).expect("the entity is a surface");
    let to_world =
        |position: &Vec3| turn * (position.as_dvec3() * transform.scale.as_dvec3()) + transform.translation.as_dvec3();
    positions.0.iter().map(to_world).collect()
}

/// The time at which the first vertex comes down to a height. This is the closed form for a body that meets a plane
/// with a vertex first, and not with an edge.
fn first_down_to(start: &[DVec3], end: &[DVec3], height: f64) -> f64 {
    let times = start.iter().zip(end).filter(|(start, end)| start.y > height && end.y <= height);
    times.map(|(start, end)| (start.y - height) / (start.y - end.y)).fold(f64::INFINITY, f64::min)
}

/// A sheet and a swept ball above it, after the tick in which both were new.
struct Fall {
    app: App,
    sheet: Entity,
    ball: Entity,
}

impl Fall {
    fn new(mesh: &Mesh, start: Transform) -> Self {
        let mut app = app();
        let sheet = spawn(&mut app, &sheet(), (THIN, Called("sheet")));
        let ball = spawn(&mut app, mesh, (THIN, start, SweptCollision, Called("ball")));
        app.update();
        assert_eq!(all(&mut app), [], "nothing has moved yet");
        Self { app, sheet, ball }
    }

    /// Moves the ball to another place, and returns when it meets the sheet's plane on its way.
    fn move_to(&mut self, end: Transform) -> f64 {
        let before = world_points(&self.app, self.ball);
        insert(&mut self.app, self.ball, end);
        self.app.update();
        first_down_to(&before, &world_points(&self.app, self.ball), 0.0)
    }

    fn first(&mut self) -> Option<Seen> {
        first(&mut self.app, self.ball, self.sheet)
    }
}

fn small_ball() -> Mesh {
    icosphere(1, 0.05)
}

#[test]
fn a_small_body_never_passes_a_sheet_unseen_however_fast_it_is() {
    for thicknesses in [1.0, 10.0, 100.0, 1000.0, 100_000.0] {
        for share in [0.01, 0.4, 0.99] {
            // Straight down and slanted, into the inside of triangles.
            for aside in [Vec3::ZERO, Vec3::new(0.3, 0.0, -0.2)] {
                let way = thicknesses * THICKNESS;
                let start = Vec3::new(0.1, 0.05 + share * way, 0.2);
                let mut fall = Fall::new(&small_ball(), Transform::from_translation(start - aside * share));
                let end = start + aside * (1.0 - share) - Vec3::Y * way;
                let expected = fall.move_to(Transform::from_translation(end));
                let what = (thicknesses, share, aside);
                let seen = fall.first().unwrap_or_else(|| panic!("{what:?}: it went through undetected"));
                assert!(seen.time <= expected, "{what:?}: {} is later than {expected}", seen.time);
                assert!(
                    seen.time > expected - 1.0e-6 * expected.min(1.0 / f64::from(thicknesses)),
                    "{what:?}: {}",
                    seen.time
                );
                assert_eq!((seen.cause, seen.kind), (ImpactCause::Reached, FeatureKind::VertexFace), "{what:?}");
                assert_near_vector(seen.normal, Vec3::NEG_Y, 1.0e-6, what);
            }
        }
    }
}

#[test]
fn an_impact_is_where_both_surfaces_are_at_its_time() {
    let turned = Quat::from_rotation_x(0.4) * Quat::from_rotation_z(0.9);
    let mut fall = Fall::new(&ball(), at(0.1, 0.8, 0.2).with_rotation(turned));
    let before = [fall.ball, fall.sheet].map(|entity| world_points(&fall.app, entity));
    fall.move_to(at(-0.3, -1.9, 0.4).with_rotation(turned.inverse()).with_scale(Vec3::splat(1.5)));
    let after = [fall.ball, fall.sheet].map(|entity| world_points(&fall.app, entity));
    let ball = fall.ball;
    let impacts: Vec<Seen> = read(&mut fall.app, move |impacts| impacts.impacts_with(ball).map(Seen::from).collect());
    assert!(impacts.len() > 100, "{}", impacts.len());
    for seen in &impacts {
        assert_eq!([seen.a, seen.b], [fall.ball, fall.sheet]);
        let point = |side: usize| -> DVec3 {
            let (entity, sign) = [(fall.ball, -1.0), (fall.sheet, 1.0)][side];
            let entries = seen.stencil.iter().filter(|entry| entry.entity == entity);
            entries
                .map(|entry| {
                    let vertex = entry.vertex.index();
                    before[side][vertex].lerp(after[side][vertex], seen.time) * f64::from(entry.weight) * sign
                })
                .sum()
        };
        // Weights are rounded to f32.
        assert!(point(0).distance(point(1)) < 1.0e-6, "{seen:?}: {} {}", point(0), point(1));
        assert!((seen.normal.length() - 1.0).abs() < 1.0e-6, "{seen:?}");
        // A vertex of the sheet that meets a face of the ball need not move across that face.
        let corners = |weights: [f32; 3]| weights.iter().filter(|&&weight| weight != 0.0).count();
        let (of_ball, of_sheet) = seen.barycentrics;
        assert_eq!(corners(of_ball) + corners(of_sheet), seen.stencil.len());
    }
    let whole = all(&mut fall.app);
    assert!(whole.len() == impacts.len() && whole.is_sorted_by_key(|seen| (seen.triangles.0, seen.triangles.1)));
    let earliest = impacts.iter().map(|seen| seen.time).fold(1.0, f64::min);
    assert_eq!(fall.first().expect("the first impact is among them").time, earliest);
}

#[test]
fn impacts_read_the_other_way_round_from_their_other_side() {
    let mut fall = Fall::new(&small_ball(), at(0.1, 1.0, 0.2));
    fall.move_to(at(0.1, -1.0, 0.2));
    let (sheet, ball) = (fall.sheet, fall.ball);
    let of = |app: &mut App, entity: Entity| -> Vec<Seen> {
        read(app, move |impacts| impacts.impacts_with(entity).map(Seen::from).collect())
    };
    let (whole, by_ball, by_sheet) = (all(&mut fall.app), of(&mut fall.app, ball), of(&mut fall.app, sheet));
    assert!(whole.len() > 10 && whole == by_sheet && by_ball.len() == whole.len());
    for (one, other) in by_ball.iter().zip(&by_sheet) {
        assert_eq!((one.a, one.b, one.time, one.cause), (other.b, other.a, other.time, other.cause));
        assert_eq!(one.normal, -other.normal);
        assert_eq!(one.triangles, (other.triangles.1, other.triangles.0));
        assert_eq!(one.features, (other.features.1, other.features.0));
        assert_eq!(one.barycentrics, (other.barycentrics.1, other.barycentrics.0));
    }
    assert!(whole.is_sorted_by_key(|seen| (seen.triangles.0, seen.triangles.1)));
    let between = |app: &mut App, a: Entity, b: Entity| -> Vec<Seen> {
        read(app, move |impacts| impacts.between(a, b).map(Seen::from).collect())
    };
    assert_eq!(between(&mut fall.app, ball, sheet), by_ball);
    assert_eq!(between(&mut fall.app, sheet, ball), by_sheet);
    assert_eq!(between(&mut fall.app, ball, ball), []);
    assert_eq!(first(&mut fall.app, sheet, sheet), None);
}

#[test]
fn a_body_that_turns_meets_by_the_straight_ways_of_its_vertices() {
    // A bar above the sheet that is rotated about its own end, by up to half a turn.
    let bar = cuboid([0.8, 0.05, 0.05], 1).translate([0.8, 0.0, 0.0]);
    let start = at(-0.7, 0.4, 0.1).with_rotation(Quat::from_rotation_y(0.1));
    for (angle, passes) in [(-0.7_f32, true), (-1.5, true), (-2.5, true), (-3.1, false)] {
        let mut fall = Fall::new(&bar, start);
        let expected = fall.move_to(start.with_rotation(Quat::from_rotation_z(angle) * Quat::from_rotation_x(0.05)));
        // On the arc of half a turn it would pass the sheet. On straight paths it does not.
        assert_eq!(expected <= 1.0, passes, "{angle}: {expected}");
        match fall.first() {
            Some(seen) => assert_time(seen.time, expected, angle),
            None => assert!(!passes, "{angle}: the impact at {expected} is missing"),
        }
    }
}

#[test]
fn far_from_the_origin_times_are_as_precise() {
    for far in [Vec3::splat(1.0e5), Vec3::new(-1.0e6, 1.0e6, 3.0e5)] {
        for turn in [Quat::IDENTITY, Quat::from_rotation_y(0.8)] {
            let mut fall = Fall::new(&small_ball(), at(0.125, 0.5, 0.25));
            let here = fall.move_to(at(0.25, -2.25, 0.125));
            let near = fall.first().expect("there is an impact").time;
            assert_time(near, here, "near");

            let mut app = app();
            let sheet = spawn(&mut app, &sheet(), (THIN, Transform::from_translation(far).with_rotation(turn)));
            let ball = spawn(&mut app, &small_ball(), (THIN, SweptCollision));
            // Sixteenths are exact in f32 at 10^6.
            place(&mut app, ball, far + Vec3::new(0.125, 0.5, 0.25));
            app.update();
            place(&mut app, ball, far + Vec3::new(0.25, -2.25, 0.125));
            app.update();
            let there = first(&mut app, ball, sheet).expect("there is an impact there too").time;
            // 64 ε times 4, the size of the bodies and their path, over that path. No digits are lost at 10^6.
            assert!(there <= here && there > here - 1.0e-12, "{far} {turn}: {there}, {here}");
        }
    }
}

#[test]
fn two_fast_bodies_meet_between_their_ways() {
    let mut app = app();
    let upper = spawn(&mut app, &ball(), (THIN, at(0.0, 4.0, 0.0), SweptCollision));
    let lower = spawn(&mut app, &ball(), (THIN, at(0.0, -1.0, 0.0), SweptCollision));
    app.update();
    place(&mut app, upper, Vec3::new(3.0, -6.0, 0.0));
    place(&mut app, lower, Vec3::new(3.0, 4.0, 0.0));
    app.update();
    // The poles are 4 apart. The relative motion is 15, and both also move sideways together.
    let seen = first(&mut app, upper, lower).expect("the bodies meet");
    assert_time(seen.time, 4.0 / 15.0, "poles");
    assert_near_vector(seen.normal, Vec3::NEG_Y, 1.0e-6, "up");
    // If only one of them is swept, the other counts as standing where it is now, and the paths do not cross.
    insert(&mut app, upper, at(0.0, 4.0, 0.0));
    insert(&mut app, lower, at(0.0, -1.0, 0.0));
    app.world_mut().entity_mut(lower).remove::<SweptCollision>();
    app.update();
    place(&mut app, upper, Vec3::new(3.0, -6.0, 0.0));
    place(&mut app, lower, Vec3::new(3.0, 4.0, 0.0));
    app.update();
    assert_eq!(first(&mut app, upper, lower), None);
}

#[test]
fn a_large_surface_that_falls_on_a_small_one_meets_it_too() {
    let mut app = app();
    let sheet = spawn(&mut app, &sheet(), (THIN, at(0.0, 3.0, 0.0), SweptCollision));
    let ball = spawn(&mut app, &small_ball(), (THIN, at(0.1, 0.0, 0.2)));
    app.update();
    place(&mut app, sheet, Vec3::new(0.0, -1.0, 0.0));
    app.update();
    let top = world_points(&app, ball).iter().map(|point| point.y).fold(f64::MIN, f64::max);
    let seen = first(&mut app, sheet, ball).expect("there is an impact");
    assert_time(seen.time, (3.0 - top) / 4.0, "down on the pole");
    assert_near_vector(seen.normal, Vec3::NEG_Y, 1.0e-6, "the sheet is above");
}

#[test]
fn nothing_is_found_of_surfaces_that_do_not_ask() {
    let mut app = app();
    let sheet = spawn(&mut app, &sheet(), (THIN, SweptCollision));
    let ball = spawn(&mut app, &small_ball(), (THIN, at(0.1, 1.0, 0.2)));
    app.update();
    place(&mut app, ball, Vec3::new(0.1, -1.0, 0.2));
    app.update();
    assert_eq!((all(&mut app).len(), stage(&app)), (0, None), "the sheet asks, but it has not moved");
    app.world_mut().entity_mut(sheet).remove::<SweptCollision>();
    place(&mut app, ball, Vec3::new(0.1, 1.0, 0.2));
    app.update();
    assert_eq!((all(&mut app).len(), stage(&app)), (0, None));
    insert(&mut app, ball, SweptCollision);
    app.update();
    place(&mut app, ball, Vec3::new(0.1, -1.0, 0.2));
    app.update();
    assert!(all(&mut app).len() > 10 && stage(&app).is_some());
    app.update();
    assert_eq!((all(&mut app).len(), stage(&app)), (0, None), "impacts are of one tick");
}

#[test]
fn slow_surfaces_cost_no_tree_and_resting_ones_keep_theirs() {
    let mut fall = Fall::new(&small_ball(), at(0.1, 0.2, 0.2));
    for step in 0..4_u8 {
        // Nearly half a thickness per tick, onto the sheet.
        fall.move_to(at(0.1, 0.2 - 0.024 * f32::from(step), 0.2));
        assert_eq!((stage(&fall.app), diagnostics(&fall.app).swept_trees_built), (None, 0), "{step}");
    }
    let counts = |app: &App| (diagnostics(app).swept_trees_built, diagnostics(app).swept_trees_refitted);
    let mut built = Vec::new();
    for step in 0..4_u8 {
        fall.move_to(at(0.1, if step % 2 == 0 { -1.0 } else { 1.0 }, 0.2));
        let line = stage(&fall.app).expect("the ball is swept");
        assert_eq!(line.pairs_out, all(&mut fall.app).len());
        assert!(line.pairs_out > 10 && line.pairs_in >= line.pairs_out, "{line:?}");
        built.push(counts(&fall.app));
    }
    assert_eq!(built, [(1, 0), (0, 0), (0, 0), (0, 0)]);
    // The sheet moves as a whole, so the boxes in its own frame stay the same.
    place(&mut fall.app, fall.sheet, Vec3::new(0.5, 0.0, 0.0));
    fall.move_to(at(0.1, -1.0, 0.2));
    assert_eq!(counts(&fall.app), (0, 0));
    let bulged: Vec<Vec3> = points(&sheet()).iter().map(|p| *p + Vec3::Y * 0.01 * p.x).collect();
    write_positions(&mut fall.app, fall.sheet, &bulged);
    fall.move_to(at(0.1, 1.0, 0.2));
    assert_eq!(counts(&fall.app), (0, 1));
    assert!(all(&mut fall.app).len() > 10);
    // Far away from the sheet nothing is tested, however fast.
    fall.move_to(at(90.0, 1.0, 0.2));
    fall.move_to(at(90.0, -1.0, 0.2));
    assert_eq!(stage(&fall.app), None);
}

#[test]
fn what_flies_together_is_not_fast() {
    let mut app = app();
    let sheet = spawn(&mut app, &sheet(), (THIN, SweptCollision, SelfCollision));
    let ball = spawn(&mut app, &small_ball(), (THIN, at(0.1, 0.06, 0.2), SweptCollision));
    app.update();
    for step in 1..4_u8 {
        let flown = Vec3::new(50.0, -30.0, 20.0) * f32::from(step);
        place(&mut app, sheet, flown);
        place(&mut app, ball, flown + Vec3::new(0.1, 0.06, 0.2));
        app.update();
        assert_eq!((all(&mut app).len(), stage(&app)), (0, None), "{step}");
    }
    // As fast as before, but the ball also passes through the sheet.
    let flown = Vec3::new(200.0, -120.0, 80.0);
    place(&mut app, sheet, flown);
    let before = world_points(&app, ball);
    place(&mut app, ball, flown + Vec3::new(0.1, -0.19, 0.2));
    let after = world_points(&app, ball);
    app.update();
    let relative = |points: Vec<DVec3>, height: f64| -> Vec<DVec3> {
        points.iter().map(|point| *point - DVec3::Y * height).collect()
    };
    let expected = first_down_to(&relative(before, -90.0), &relative(after, -120.0), 0.0);
    assert_time(first(&mut app, ball, sheet).expect("there is an impact").time, expected, "relative motion");
}

#[test]
fn a_jump_is_no_way() {
    let mut fall = Fall::new(&small_ball(), at(0.1, 1.0, 0.2));
    insert(&mut fall.app, fall.ball, Teleported);
    fall.move_to(at(0.1, -1.0, 0.2));
    assert_eq!(all(&mut fall.app), []);
    fall.move_to(at(0.1, 1.0, 0.2));
    assert!(fall.first().is_some(), "swept from where it jumped to");
    // A parent of a parent that jumps takes it along, and once.
    let roots = [Transform::default(); 2].map(|root| fall.app.world_mut().spawn(root).id());
    fall.app.world_mut().entity_mut(roots[0]).insert(ChildOf(roots[1]));
    fall.app.world_mut().entity_mut(fall.ball).insert(ChildOf(roots[0]));
    for (jumps, height) in [(true, -2.0), (false, 0.0)] {
        let mut root = fall.app.world_mut().entity_mut(roots[1]);
        root.insert(Transform::from_xyz(0.0, height, 0.0));
        if jumps {
            root.insert(Teleported);
        }
        fall.app.update();
        assert_eq!(fall.first().is_none(), jumps);
        assert!(!fall.app.world().entity(roots[1]).contains::<Teleported>());
    }
    fall.app.world_mut().entity_mut(fall.ball).remove::<ChildOf>();
    // Disabled for a tick, then back on the other side.
    insert(&mut fall.app, fall.ball, SurfaceDisabled);
    fall.app.update();
    fall.app.world_mut().entity_mut(fall.ball).remove::<SurfaceDisabled>();
    fall.move_to(at(0.1, -1.0, 0.2));
    assert_eq!(all(&mut fall.app), []);
    // A surface that requests sweeping again has no past.
    fall.app.world_mut().entity_mut(fall.ball).remove::<SweptCollision>();
    assert!(!fall.app.world().entity(fall.ball).contains::<PreviousPositions>());
    fall.move_to(at(0.1, 1.0, 0.2));
    insert(&mut fall.app, fall.ball, SweptCollision);
    fall.move_to(at(0.1, -1.0, 0.2));
    assert_eq!(all(&mut fall.app), []);
    fall.move_to(at(0.1, 1.0, 0.2));
    assert!(fall.first().is_some());
    // Quarantined for its positions, then back on the other side.
    let healthy = points(&small_ball());
    let mut spoiled = healthy.clone();
    spoiled[3].x = f32::NAN;
    write_positions(&mut fall.app, fall.ball, &spoiled);
    fall.app.update();
    assert_eq!(all(&mut fall.app), []);
    write_positions(&mut fall.app, fall.ball, &healthy);
    fall.move_to(at(0.1, -1.0, 0.2));
    assert_eq!(all(&mut fall.app), []);
    // The same holds if only the mesh is replaced.
    let (other, positions) = surface(&icosphere(2, 0.05));
    insert(&mut fall.app, fall.ball, (other, positions));
    fall.move_to(at(0.1, 1.0, 0.2));
    assert_eq!(all(&mut fall.app), []);
}

#[test]
fn what_is_despawned_is_forgotten() {
    let mut fall = Fall::new(&small_ball(), at(0.1, 1.0, 0.2));
    fall.move_to(at(0.1, -1.0, 0.2));
    assert!(fall.first().is_some());
    fall.app.world_mut().despawn(fall.ball);
    fall.app.update();
    assert_eq!(all(&mut fall.app), []);
    let again = spawn(&mut fall.app, &small_ball(), (THIN, at(0.1, -1.0, 0.2), SweptCollision));
    fall.app.update();
    fall.app.world_mut().despawn(fall.sheet);
    place(&mut fall.app, again, Vec3::new(0.1, 1.0, 0.2));
    fall.app.update();
    assert_eq!(all(&mut fall.app), []);
}

#[test]
fn surfaces_that_do_not_meet_by_their_layers_pass_through_each_other() {
    let mut fall = Fall::new(&small_ball(), at(0.1, 1.0, 0.2));
    insert(&mut fall.app, fall.ball, SurfaceLayers { memberships: 2, filters: 2 });
    fall.move_to(at(0.1, -1.0, 0.2));
    assert_eq!((all(&mut fall.app).len(), stage(&fall.app)), (0, None));
    insert(&mut fall.app, fall.sheet, SurfaceLayers { memberships: 1, filters: 2 });
    insert(&mut fall.app, fall.ball, SurfaceLayers { memberships: 2, filters: 1 });
    fall.move_to(at(0.1, 1.0, 0.2));
    assert!(fall.first().is_some());
    insert(&mut fall.app, fall.sheet, SurfaceDisabled);
    fall.move_to(at(0.1, -1.0, 0.2));
    assert_eq!(all(&mut fall.app), []);
}

#[test]
fn a_target_is_swept_to_instead() {
    let mut fall = Fall::new(&small_ball(), at(0.1, 1.0, 0.2));
    let below: Vec<Vec3> = points(&small_ball()).iter().map(|position| *position - Vec3::Y * 3.0).collect();
    let start = world_points(&fall.app, fall.ball);
    let end: Vec<DVec3> = below.iter().map(|p| p.as_dvec3() + at(0.1, 1.0, 0.2).translation.as_dvec3()).collect();
    let expected = first_down_to(&start, &end, 0.0);
    insert(&mut fall.app, fall.ball, SweptTarget(below.clone()));
    for _ in 0..2 {
        fall.app.update();
        assert_time(fall.first().expect("the target is below the sheet").time, expected, "target");
    }
    // The ball has passed the sheet since the last tick, but only its target counts, and that is on the same side.
    let here = points(&small_ball());
    insert(&mut fall.app, fall.ball, SweptTarget(here.clone()));
    fall.move_to(at(0.1, -1.0, 0.2));
    assert_eq!(all(&mut fall.app), []);
    // Without a usable target, the motion since the last tick counts again.
    let mut spoiled = here.clone();
    spoiled[0].z = f32::INFINITY;
    for (place, unusable) in [Vec::new(), here[1..].to_vec(), spoiled].into_iter().enumerate() {
        insert(&mut fall.app, fall.ball, SweptTarget(unusable));
        fall.move_to(at(0.1, if place % 2 == 0 { 1.0 } else { -1.0 }, 0.2));
        assert!(fall.first().is_some(), "{place}");
    }
    // Not after a jump, unless a solver gives a target for the motion from there.
    insert(&mut fall.app, fall.ball, (SweptTarget::default(), Teleported));
    fall.move_to(at(0.1, -1.0, 0.2));
    assert_eq!(all(&mut fall.app), []);
    fall.move_to(at(0.1, 1.0, 0.2));
    insert(&mut fall.app, fall.ball, (SweptTarget(below), Teleported));
    fall.app.update();
    let time = fall.first().expect("the target is below the sheet").time;
    assert!(time > 0.0 && time < 1.0, "{time}");
    // Nor for a surface that does not request sweeping.
    fall.app.world_mut().entity_mut(fall.ball).remove::<SweptCollision>();
    fall.app.update();
    fall.app.update();
    assert_eq!(all(&mut fall.app), []);
}

#[test]
fn a_surface_is_swept_against_itself_where_it_asks() {
    let pages = sheet_stack(2, 1.0, 4);
    let through: Vec<Vec3> = {
        let middle = points(&pages).iter().map(|p| p.y).fold(f32::MIN, f32::max) - 0.5;
        points(&pages).iter().map(|p| if p.y > middle { *p - Vec3::Y * 4.0 } else { *p }).collect()
    };
    for asks in [true, false] {
        let mut app = app();
        let entity = spawn(&mut app, &pages, (THIN, SweptCollision));
        if asks {
            insert(&mut app, entity, SelfCollision);
        }
        app.update();
        write_positions(&mut app, entity, &through);
        app.update();
        let found = all(&mut app);
        assert_eq!(found.is_empty(), !asks);
        for seen in &found {
            assert_eq!([seen.a, seen.b], [entity; 2]);
            assert!(seen.triangles.0 < seen.triangles.1);
            assert_time(seen.time, 0.25, "a gap of 1 on a way of 4");
        }
        assert_eq!(first(&mut app, entity, entity).is_some(), asks);
    }
}

#[test]
fn contacts_are_the_same_with_and_without() {
    let run = |swept: bool| {
        let mut app = app();
        let sheet = spawn(&mut app, &sheet(), (THIN, Called("sheet"), SelfCollision));
        let bodies = [("one", 0.53), ("two", 0.5), ("three", 3.0)].map(|(name, height)| {
            let body = spawn(&mut app, &ball(), (THIN, Called(name), at(0.1, height, 0.2)));
            if swept {
                insert(&mut app, body, SweptCollision);
                insert(&mut app, sheet, SweptCollision);
            }
            body
        });
        let mut prints = Vec::new();
        for tick in 0..6_u8 {
            app.update();
            prints.push(fingerprint(&app));
            place(&mut app, bodies[0], Vec3::new(0.1, 0.53 - 0.01 * f32::from(tick), 0.2));
            place(&mut app, bodies[2], Vec3::new(0.1, if tick % 2 == 0 { -3.0 } else { 3.0 }, 0.2));
            if tick == 3 {
                assert_eq!(all(&mut app).is_empty(), !swept);
            }
        }
        prints
    };
    let without = run(false);
    assert!(without.iter().all(|tick| tick.iter().any(|(.., records)| records.len() > 3)));
    assert_eq!(run(true), without);
}

/// A swarm of balls that fly through two large sheets and through each other.
#[cfg(feature = "parallel")]
fn swarm(threads: usize) -> SweptImpacts {
    let mut app = app();
    app.insert_resource(CircumsphereSettings { threads, ..Default::default() });
    let wide = circumsphere_support::scenes::grid(60, 60, 4.0, 4.0, circumsphere_support::scenes::Diagonals::Uniform);
    for height in [0.0, -0.4] {
        spawn(&mut app, &wide, (THIN, at(0.0, height, 0.0)));
    }
    let balls: Vec<Entity> = (0..6_u8)
        .map(|k| spawn(&mut app, &icosphere(2, 0.5), (THIN, at(0.3 * f32::from(k), 1.0, 0.1), SweptCollision)))
        .collect();
    app.update();
    for (ball, x) in balls.into_iter().zip([0.0_f32, 1.0, -1.0, 0.4, -0.3, 0.8]) {
        place(&mut app, ball, Vec3::new(x, -3.0, 0.2 * x));
    }
    app.update();
    app.world().resource::<SweptImpacts>().clone()
}

#[test]
#[cfg(feature = "parallel")]
fn impacts_are_the_same_to_the_last_bit_for_any_number_of_threads() {
    use bevy_tasks::{ComputeTaskPool, TaskPoolBuilder};

    let pool = ComputeTaskPool::get_or_init(|| TaskPoolBuilder::new().num_threads(crate::world::POOL_THREADS).build());
    assert!(pool.thread_num() > 1, "the task pool has one thread, so there is nothing to compare");
    // `Debug` writes the shortest number that reads back as the same float.
    let print = |found: &SweptImpacts| -> Vec<String> {
        found.pairs.iter().map(|pair| format!("{} {} {:?}", pair.a, pair.b, pair.impacts)).collect()
    };
    let alone = swarm(1);
    // 320 triangles make 40 leaves, which are shared out in groups of 4.
    assert!(alone.pairs.len() >= 12 && alone.pairs.iter().any(|pair| pair.impacts.len() > 1000));
    for threads in [2, 3, 0] {
        assert_eq!(print(&swarm(threads)), print(&alone), "{threads} threads");
    }
}

#[test]
fn a_recording_meets_itself_when_the_reference_says_so() {
    let Some(folder) = recordings_folder() else { return };
    let path = folder.join("two_cubes_close_to_intersecting.bin");
    let recording = read_recording(&[path]).expect("the recording can be read");
    let frame =
        |number: usize| -> Vec<Vec3> { recording.frames[number].iter().copied().map(Vec3::from_array).collect() };
    let [before, after] = [frame(0), frame(1)];
    let mut app = app();
    let (surface, positions) = DeformableSurface::from_mesh(&before, &recording.triangles).expect("the mesh is valid");
    // Without thickness, everything that moves is fast.
    let bundle = (surface, positions, SurfaceThickness::World(0.0), SweptCollision, SelfCollision);
    let entity = app.world_mut().spawn(bundle).id();
    app.update();
    write_positions(&mut app, entity, &after);
    app.update();
    let found = all(&mut app);

    let wide = |positions: &[Vec3]| positions.iter().map(|position| position.as_dvec3()).collect::<Vec<_>>();
    let (start, end) = (wide(&before), wide(&after));
    let weld = exact_weld(&start);
    let triangles = &recording.triangles;
    let truth = MovingMesh { start: &start, end: &end, triangles, weld: &weld };
    let (mut certain, mut possible) = (0, 0);
    for impact in triangle_impacts_tree(&truth, 0.0) {
        let names = (TriangleId(impact.triangle_a), TriangleId(impact.triangle_b));
        let seen = found.iter().find(|seen| seen.triangles == (Some(names.0), Some(names.1)));
        possible += usize::from(seen.is_some());
        let ImpactTruth::First { latest, .. } = impact.truth else { continue };
        assert!(seen.is_some_and(|seen| seen.time <= latest), "{impact:?}: {seen:?}");
        certain += 1;
    }
    println!("{certain} certain impacts, {} found", found.len());
    let shares = |a: TriangleId, b: TriangleId| {
        let welded = |triangle: TriangleId| triangles[triangle.index()].map(|vertex| weld[vertex as usize]);
        welded(a).iter().any(|vertex| welded(b).contains(vertex))
    };
    let are_strangers = |seen: &&Seen| matches!(seen.triangles, (Some(a), Some(b)) if !shares(a, b));
    let strangers = found.iter().filter(are_strangers).count();
    assert!(certain > 10, "{certain}");
    assert_eq!(strangers, possible, "the reference certifies that all other pairs stay apart");
}
