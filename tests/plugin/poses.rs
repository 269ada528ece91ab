//! Where bodies stand in the world does not change how they touch.

use bevy_app::prelude::*;
use bevy_circumsphere::{detection::CandidateTrianglePairs, prelude::*};
use bevy_ecs::prelude::*;
use bevy_transform::components::Transform;
use circumsphere_support::scenes::{Mesh, icosphere};
use glam::{Quat, Vec3};

use crate::world::{
    Seen, THIN, app, assert_all_consistent, assert_near, assert_near_vector, assert_swapped, at, ball, between,
    deepest, insert, rounding, sheet, spawn, status, store, surface,
};

const FAR: [Vec3; 3] = [Vec3::new(1.0e6, -1.0e6, 1.0e6), Vec3::new(-1.0e4, 0.0, 3.0e4), Vec3::new(0.0, 1.0e6, 0.0)];

fn thickness(scale: f32) -> SurfaceThickness {
    SurfaceThickness::World(0.05 * scale)
}

/// Positions are rounded once in the frame of the pair: 4 units in the last place of its largest coordinate, which is
/// half the width of the sheet and the height of the ball.
fn band() -> f32 {
    rounding(4.0)
}

/// Compares contacts with those of the same bodies elsewhere, `scale` times as large and rotated by `turn`.
#[track_caller]
fn assert_same(here: &[Seen], elsewhere: &[Seen], scale: f32, turn: impl Fn(Vec3) -> Vec3, what: &str) {
    let keys = |contacts: &[Seen]| contacts.iter().map(|contact| (contact.key, contact.triangles)).collect::<Vec<_>>();
    assert!(here.len() > 3, "{what}: nothing to compare");
    assert_eq!(keys(here), keys(elsewhere), "{what}");
    for (one, other) in here.iter().zip(elsewhere) {
        assert_near(other.distance / scale, one.distance, band(), (what, one));
        assert_near(other.separation / scale, one.separation, band(), (what, one));
        // A direction between points at a distance d is as accurate as the points, relative to d.
        let tolerance = 1.0e-5 + 2.0 * band() / one.distance.abs().max(1.0e-3);
        assert_near_vector(other.normal, turn(one.normal), tolerance, (what, one));
        for (weights, others) in
            [(one.barycentrics.0, other.barycentrics.0), (one.barycentrics.1, other.barycentrics.1)]
        {
            let (weights, others) = (Vec3::from(weights), Vec3::from(others));
            // The closest points of nearly parallel edges slide along the edges.
            assert_near_vector(others, weights, 1.0e-3, (what, one));
        }
    }
}

struct Pair {
    app: App,
    sheet: Entity,
    ball: Entity,
}

impl Pair {
    fn new(mesh: &Mesh) -> Self {
        let mut app = app();
        let sheet = spawn(&mut app, &sheet(), thickness(1.0));
        let ball = spawn(&mut app, mesh, (thickness(1.0), ball_place()));
        Self { app, sheet, ball }
    }

    fn under(mesh: &Mesh, parent: Transform, scale: f32) -> Self {
        let mut pair = Self::new(mesh);
        let parent = pair.app.world_mut().spawn(parent).id();
        insert(&mut pair.app, pair.sheet, (ChildOf(parent), thickness(scale)));
        insert(&mut pair.app, pair.ball, (ChildOf(parent), thickness(scale)));
        pair
    }

    fn contacts(&mut self) -> Vec<Seen> {
        self.app.update();
        for entity in [self.sheet, self.ball] {
            assert_eq!(status(&self.app, entity), SurfaceStatus::Active);
        }
        between(&mut self.app, self.sheet, self.ball)
    }
}

/// Off the axes and rotated, so that no two features are equally near.
fn ball_place() -> Transform {
    at(0.11, 0.53, 0.23).with_rotation(Quat::from_rotation_z(0.02) * Quat::from_rotation_y(0.3))
}

/// A coarse ball is moved into the frame of the sheet. With a fine ball, the sheet is moved.
fn balls() -> [Mesh; 2] {
    [icosphere(1, 0.5), icosphere(3, 0.5)]
}

#[test]
fn children_of_a_far_parent_touch_as_at_the_origin() {
    for mesh in balls() {
        let here = Pair::new(&mesh).contacts();
        for far in FAR {
            for rotation in [Quat::IDENTITY, Quat::from_rotation_x(0.7) * Quat::from_rotation_y(-1.2)] {
                let parent = Transform::from_translation(far).with_rotation(rotation);
                let there = Pair::under(&mesh, parent, 1.0).contacts();
                assert_same(&here, &there, 1.0, |normal| rotation * normal, "far parent");
            }
        }
    }
}

#[test]
fn far_bodies_without_a_parent_touch_as_at_the_origin() {
    for mesh in balls() {
        // Sixteenths are exact in f32 at 10^6.
        let offset = Vec3::new(0.125, 0.5, 0.1875);
        let mesh = mesh.scale(0.94);
        let mut pair = Pair::new(&mesh);
        insert(&mut pair.app, pair.ball, Transform::from_translation(offset));
        let here = pair.contacts();
        assert_near(deepest(&here).distance, 0.03, band(), "radius 0.47");
        for far in FAR {
            insert(&mut pair.app, pair.sheet, Transform::from_translation(far));
            insert(&mut pair.app, pair.ball, Transform::from_translation(far + offset));
            let there = pair.contacts();
            assert_same(&here, &there, 1.0, |normal| normal, "far bodies");
        }
    }
}

#[test]
fn a_scaled_family_touches_at_scaled_distances() {
    for mesh in balls() {
        let here = Pair::new(&mesh).contacts();
        for scale in [0.5, 2.0, 100.0, 0.01] {
            let rotation = Quat::from_rotation_x(0.3);
            let parent = at(3.0, 2.0, -1.0).with_rotation(rotation).with_scale(Vec3::splat(scale));
            let there = Pair::under(&mesh, parent, scale).contacts();
            assert_same(&here, &there, scale, |normal| rotation * normal, "scaled parent");
        }
    }
}

#[test]
fn a_scale_is_the_same_as_a_larger_mesh() {
    for mesh in balls() {
        let here = Pair::new(&mesh).contacts();
        // Powers of 2 are exact.
        for scale in [0.5, 2.0, 128.0] {
            let mut pair = Pair::new(&mesh.clone().scale(1.0 / scale));
            insert(&mut pair.app, pair.ball, ball_place().with_scale(Vec3::splat(scale)));
            assert_same(&here, &pair.contacts(), 1.0, |normal| normal, "scaled ball");
            insert(&mut pair.app, pair.sheet, surface(&sheet().scale(1.0 / scale)));
            insert(&mut pair.app, pair.sheet, Transform::from_scale(Vec3::splat(scale)));
            assert_same(&here, &pair.contacts(), 1.0, |normal| normal, "both scaled");
        }
    }
}

#[test]
fn a_thickness_in_edges_grows_with_the_scale_and_one_in_the_world_does_not() {
    let mut pair = Pair::new(&ball());
    for scale in [1.0, 3.0] {
        insert(&mut pair.app, pair.ball, (ball_place().with_scale(Vec3::splat(scale)), thickness(1.0)));
        insert(&mut pair.app, pair.sheet, (SurfaceThickness::World(0.0), at(0.0, 0.53 - 0.53 * scale, 0.0)));
        insert(&mut pair.app, pair.ball, SurfaceThickness::World(0.25));
        pair.app.update();
        assert_near(store(&pair.app).pairs()[0].contact_distance, 0.25, rounding(1.0), scale);
        insert(&mut pair.app, pair.ball, SurfaceThickness::MeanEdges(1.0));
        pair.app.update();
        // The edges of a fine ball of radius 0.5 are 0.137 to 0.163 long.
        let edge = store(&pair.app).pairs()[0].contact_distance / scale;
        assert!((0.137..0.164).contains(&edge), "{edge}");
    }
}

#[test]
fn mirrored_solids_keep_their_inside() {
    let mirrors = [Vec3::new(-1.0, 1.0, 1.0), Vec3::new(1.0, -1.0, 1.0), Vec3::new(1.0, 1.0, -1.0), Vec3::NEG_ONE];
    let both = [(true, false), (false, true), (true, true)];
    for mesh in balls() {
        for mirror in mirrors {
            for (mirror_ball, mirror_sheet) in both {
                // Above the sheet, and with the lowest vertex just below it.
                for distance in [0.03, -0.02] {
                    let mut pair = Pair::new(&mesh);
                    let mut ball = at(0.11, 0.5 + distance, 0.23);
                    if mirror_ball {
                        ball.scale = mirror;
                    }
                    insert(&mut pair.app, pair.ball, ball);
                    if mirror_sheet {
                        insert(&mut pair.app, pair.sheet, Transform::from_scale(mirror));
                    }
                    let contacts = pair.contacts();
                    let what = (mirror, mirror_ball, mirror_sheet, distance);
                    assert_near(deepest(&contacts).distance, distance, band(), what);
                    assert_near_vector(deepest(&contacts).normal, Vec3::Y, 1.0e-4, what);
                    assert_all_consistent(pair.app.world(), &contacts, 4.0);
                }
            }
            // A mirrored parent.
            let here = Pair::new(&mesh).contacts();
            let there = Pair::under(&mesh, Transform::from_scale(mirror * 2.0), 2.0).contacts();
            assert_same(&here, &there, 2.0, |normal| normal * mirror, "mirrored parent");
        }
    }
}

#[test]
fn positions_in_the_world_do_not_follow_the_transform() {
    let mut pair = Pair::new(&ball().translate([0.11, 0.53, 0.23]));
    insert(&mut pair.app, pair.ball, (SurfaceFrame::World, Transform::default()));
    let here = pair.contacts();
    assert_near(deepest(&here).distance, 0.03, band(), "in the world");
    let parent = pair.app.world_mut().spawn(at(7.0, 8.0, 9.0).with_scale(Vec3::new(1.0, 2.0, 3.0))).id();
    insert(&mut pair.app, pair.ball, (at(1.0, 2.0, 3.0).with_scale(Vec3::splat(5.0)), ChildOf(parent)));
    assert_eq!(pair.contacts(), here);
    // The sheet moves away from the ball.
    insert(&mut pair.app, pair.sheet, at(0.0, -0.04, 0.0));
    assert_near(deepest(&pair.contacts()).distance, 0.07, band(), "sheet moved");
    insert(&mut pair.app, pair.ball, SurfaceFrame::Local);
    pair.app.update();
    assert!(matches!(status(&pair.app, pair.ball), SurfaceStatus::Quarantined(QuarantineReason::Pose(_))));
}

#[test]
fn a_turned_pair_touches_as_an_upright_one() {
    for mesh in balls() {
        let here = Pair::new(&mesh).contacts();
        for turn in 1..8 {
            let rotation = Quat::from_rotation_x(0.7 * turn as f32) * Quat::from_rotation_z(0.4 * turn as f32);
            let mut pair = Pair::new(&mesh);
            let place = ball_place();
            insert(&mut pair.app, pair.sheet, Transform::from_rotation(rotation));
            let turned = Transform {
                translation: rotation * place.translation,
                rotation: rotation * place.rotation,
                scale: Vec3::ONE,
            };
            insert(&mut pair.app, pair.ball, turned);
            let there = pair.contacts();
            assert_same(&here, &there, 1.0, |normal| rotation * normal, "turned");
            let swapped = between(&mut pair.app, pair.ball, pair.sheet);
            there.iter().zip(&swapped).for_each(|(one, other)| assert_swapped(one, other));
        }
    }
}

/// The two balls overlap by a tenth of their size. A plane that cuts a cap of this height off a ball of radius 1 meets
/// the sphere within 25 degrees, and the box of the other ball reaches no farther.
#[test]
fn only_what_reaches_the_other_surface_is_moved() {
    let mut app = app();
    let turned = |x: f32, turn: f32| Transform::from_xyz(x, 0.0, 0.0).with_rotation(Quat::from_rotation_x(turn));
    for (x, turn) in [(0.0, 0.3), (1.9, 1.0)] {
        spawn(&mut app, &icosphere(4, 1.0), (thickness(0.2), turned(x, turn)));
    }
    app.update();
    assert!(store(&app).touching_count() > 10);
    let [pair] = app.world().resource::<CandidateTrianglePairs>().pairs() else { panic!("there are two balls") };
    let moved = pair.moved_positions.iter().filter(|position| position.is_finite()).count();
    let whole = pair.moved_positions.len();
    assert!(pair.is_moved() && moved > 10 && moved * 5 < whole, "{moved} of {whole} vertices");
    for &[_, triangle] in &pair.triangles {
        assert!(pair.moved_triangles.iter().any(|&(moved, _)| moved == triangle), "{triangle} was not moved");
    }
}

/// The scale of the entity is in the shape already, and may be another for each axis.
#[test]
fn what_is_scaled_already_follows_rotation_and_translation_alone() {
    let turn = Quat::from_rotation_z(0.7) * Quat::from_rotation_x(0.4);
    let scale = Vec3::new(0.5, 3.0, 1.5);
    let mut app = app();
    let parent = Transform { translation: Vec3::new(4.0, 5.0, 6.0), rotation: turn, scale };
    let parent = app.world_mut().spawn(parent).id();
    let child = Transform { scale: Vec3::new(2.0, 0.25, 1.0), ..at(1.0, -1.0, 2.0) };
    let cuboid = RigidShape(SharedShape::cuboid(0.3, 0.2, 0.4));
    let shape = app.world_mut().spawn((cuboid, SurfaceFrame::Unscaled, child, ChildOf(parent))).id();
    let own = Vec3::new(4.0, 5.0, 6.0) + turn * (scale * Vec3::new(1.0, -1.0, 2.0));
    // A sheet over its upper side, in a frame that the same is true of.
    let over = Transform { translation: own + turn * Vec3::Y * 0.23, rotation: turn, scale: Vec3::new(7.0, 2.0, 3.0) };
    let sheet = spawn(&mut app, &sheet(), (THIN, over, SurfaceFrame::Unscaled));
    app.update();
    assert_near(deepest(&between(&mut app, sheet, shape)).distance, 0.03, rounding(16.0), "over it");
    for surface in [sheet, shape] {
        insert(&mut app, surface, SurfaceFrame::Local);
    }
    app.update();
    for surface in [sheet, shape] {
        assert!(matches!(status(&app, surface), SurfaceStatus::Quarantined(QuarantineReason::Pose(_))));
    }
}
