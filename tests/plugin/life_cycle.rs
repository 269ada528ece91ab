//! One full life cycle of a sheet and a ball, and shorter ones for the remaining cases.

use bevy_app::prelude::*;
use bevy_circumsphere::prelude::*;
use bevy_ecs::prelude::*;
use bevy_transform::{TransformPlugin, components::Transform};
use circumsphere_support::scenes::{cuboid, icosphere, sheet_stack};
use glam::{Quat, Vec3};

use crate::world::{
    Announcement::{self, Ended, Started},
    By, Journal, OVER_A_FACE, THIN, all, announced, app, assert_consistent, assert_near, assert_near_vector,
    assert_swapped, at, ball, between, deepest, fixed_app, fixed_app_with, insert, keep_journal, messages, observe, of,
    place, points, rounding, set_ticks, sheet, spawn, status, store, surface, write_positions,
};

#[derive(Clone, Copy, Debug, PartialEq)]
enum Clock {
    Update,
    Fixed(u32),
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Family {
    /// Sheet and ball stand in the world.
    Alone,
    /// Both are children of one carrier, which moves and rotates in every frame.
    Carried,
    /// The ball is moved by its grandparent.
    Grandchild,
}

/// The largest distance of a body from the origin.
const SIZE: f32 = 24.0;

struct Scene {
    app: App,
    clock: Clock,
    family: Family,
    carrier: Entity,
    sheet: Entity,
    ball: Entity,
    frames: u32,
    heard: Vec<(u64, By, Announcement)>,
}

impl Scene {
    fn new(clock: Clock, family: Family, propagation: bool) -> Self {
        let propagate = |app: &mut App| {
            if propagation {
                app.add_plugins(TransformPlugin);
            }
        };
        let mut app = match clock {
            Clock::Update => {
                let mut app = app();
                propagate(&mut app);
                app
            }
            Clock::Fixed(ticks) => fixed_app_with(ticks, propagate),
        };
        match clock {
            Clock::Update => keep_journal(&mut app, Update),
            Clock::Fixed(_) => keep_journal(&mut app, FixedPostUpdate),
        }
        let carrier = app.world_mut().spawn(Transform::default()).id();
        let sheet = spawn(&mut app, &sheet(), (THIN, ContactEventsEnabled));
        let ball = app.world_mut().spawn_empty().id();
        match family {
            Family::Alone => {}
            Family::Carried => {
                insert(&mut app, sheet, ChildOf(carrier));
                insert(&mut app, ball, ChildOf(carrier));
            }
            Family::Grandchild => {
                let arm = app.world_mut().spawn((at(0.0, 0.0, 0.25), ChildOf(carrier))).id();
                insert(&mut app, ball, ChildOf(arm));
            }
        }
        let mut scene = Self { app, clock, family, carrier, sheet, ball, frames: 0, heard: Vec::new() };
        scene.dress(ball);
        observe(&mut scene.app, sheet);
        scene
    }

    /// Turns an entity into the ball of the scene.
    fn dress(&mut self, entity: Entity) {
        self.ball = entity;
        insert(&mut self.app, entity, (surface(&ball()), THIN, ContactEventsEnabled));
        observe(&mut self.app, entity);
        self.ball_at(2.0);
    }

    /// Puts the ball's center `height` above the sheet.
    fn ball_at(&mut self, height: f32) {
        let place_of_ball = OVER_A_FACE + Vec3::Y * height;
        match self.family {
            Family::Grandchild => place(&mut self.app, self.carrier, place_of_ball - Vec3::Z * 0.25),
            Family::Alone | Family::Carried => place(&mut self.app, self.ball, place_of_ball),
        }
    }

    fn up(&self) -> Vec3 {
        match self.family {
            Family::Carried => self.app.world().get::<Transform>(self.carrier).expect("it exists").rotation * Vec3::Y,
            Family::Alone | Family::Grandchild => Vec3::Y,
        }
    }

    /// Runs one frame. Its changes are announced in its first tick.
    fn frame(&mut self) {
        self.frames += 1;
        if self.family == Family::Carried {
            let turns = self.frames as f32;
            let rotation = Quat::from_rotation_z(0.3 * turns) * Quat::from_rotation_x(0.17 * turns);
            let mut carrier = self.app.world_mut().get_mut::<Transform>(self.carrier).expect("the entity exists");
            *carrier = Transform::from_xyz(0.3 * turns, -0.1 * turns, 0.2 * turns).with_rotation(rotation);
        }
        let before = store(&self.app).tick();
        if let Clock::Fixed(ticks) = self.clock
            && self.frames.is_multiple_of(2)
        {
            // In a frame without a tick, changes have no effect.
            let contacts = all(&mut self.app);
            set_ticks(&mut self.app, 0);
            self.app.update();
            set_ticks(&mut self.app, ticks);
            assert_eq!(store(&self.app).tick(), before);
            assert_eq!(all(&mut self.app).len(), contacts.len());
            assert_eq!(announced(&mut self.app), []);
        }
        self.app.update();
        let ticks = match self.clock {
            Clock::Update => 1,
            Clock::Fixed(ticks) => u64::from(ticks),
        };
        assert_eq!(store(&self.app).tick(), before + ticks);
        self.heard = announced(&mut self.app);
        assert!(self.heard.iter().all(|(tick, ..)| *tick == before + 1), "{:?} after {before}", self.heard);
    }

    fn heard_by(&self, listener: By) -> Vec<Announcement> {
        self.heard.iter().filter(|(_, by, _)| *by == listener).map(|(.., announcement)| announcement.clone()).collect()
    }

    #[track_caller]
    fn expect_announced(&self, messages: &[Announcement], events: &[Announcement]) {
        assert_eq!(self.heard_by(By::Message), messages);
        assert_eq!(self.heard_by(By::Observer), events);
        assert_eq!(self.heard_by(By::OwnObserver), events);
    }

    #[track_caller]
    fn expect_silence(&self) {
        self.expect_announced(&[], &[]);
    }

    #[track_caller]
    fn expect_started(&self) {
        let (sheet, ball) = (self.sheet, self.ball);
        self.expect_announced(&[Started(sheet, ball)], &[Started(sheet, ball), Started(ball, sheet)]);
    }

    #[track_caller]
    fn expect_ended(&self) {
        let (sheet, ball) = (self.sheet, self.ball);
        self.expect_announced(&[Ended(sheet, ball)], &[Ended(sheet, ball), Ended(ball, sheet)]);
    }

    /// Expects the ball to touch the sheet at a distance of `distance`.
    #[track_caller]
    fn expect_touch(&mut self, distance: f32) {
        self.expect_contact(distance, 0.1);
        assert!(between(&mut self.app, self.sheet, self.ball).iter().all(|contact| contact.separation <= 0.0));
        assert!(store(&self.app).touching_count() > 0);
    }

    #[track_caller]
    fn expect_contact(&mut self, distance: f32, contact_distance: f32) {
        let contacts = between(&mut self.app, self.sheet, self.ball);
        let nearest = deepest(&contacts);
        assert_eq!((nearest.a, nearest.b), (ContactSide::Surface(self.sheet), ContactSide::Surface(self.ball)));
        assert_near(nearest.distance, distance, rounding(SIZE), nearest);
        assert_near(nearest.separation, distance - contact_distance, rounding(SIZE), nearest);
        assert_near_vector(nearest.normal, self.up(), 1.0e-5, "directions have about 7 digits");
        for contact in &contacts {
            assert_consistent(self.app.world(), contact, SIZE);
        }
        let swapped = between(&mut self.app, self.ball, self.sheet);
        assert_eq!(contacts.len(), swapped.len());
        for (one, other) in contacts.iter().zip(&swapped) {
            assert_swapped(one, other);
        }
        assert_eq!(of(&mut self.app, self.sheet), contacts);
        assert_eq!(of(&mut self.app, self.ball), swapped);
        assert_eq!(all(&mut self.app), contacts);
    }

    #[track_caller]
    fn expect_nothing(&mut self) {
        assert_eq!(all(&mut self.app), []);
        assert_eq!(of(&mut self.app, self.sheet), []);
        assert!(store(&self.app).touching_count() == 0);
    }
}

#[expect(clippy::too_many_lines, reason = "one life, told in order")]
fn live(clock: Clock, family: Family, propagation: bool) {
    let mut scene = Scene::new(clock, family, propagation);

    // Far apart, in contact, at rest, apart, in contact.
    scene.frame();
    scene.expect_silence();
    scene.expect_nothing();
    assert_eq!(status(&scene.app, scene.ball), SurfaceStatus::Active);
    scene.ball_at(0.53);
    scene.frame();
    scene.expect_started();
    scene.expect_touch(0.03);
    scene.ball_at(0.55);
    scene.frame();
    scene.expect_silence();
    scene.expect_touch(0.05);
    scene.ball_at(0.7);
    scene.frame();
    scene.expect_ended();
    scene.expect_nothing();
    scene.ball_at(0.53);
    scene.frame();
    scene.expect_started();

    // Disabled and enabled again.
    insert(&mut scene.app, scene.ball, SurfaceDisabled);
    scene.frame();
    scene.expect_ended();
    scene.expect_nothing();
    assert_eq!(status(&scene.app, scene.ball), SurfaceStatus::Disabled);
    scene.app.world_mut().entity_mut(scene.ball).remove::<SurfaceDisabled>();
    scene.frame();
    scene.expect_started();
    scene.expect_touch(0.03);
    assert_eq!(status(&scene.app, scene.ball), SurfaceStatus::Active);

    // Remove the surface and insert it again. Then insert another mesh, and the first one again.
    scene.app.world_mut().entity_mut(scene.ball).remove::<DeformableSurface>();
    scene.frame();
    scene.expect_ended();
    scene.expect_nothing();
    insert(&mut scene.app, scene.ball, surface(&ball()));
    scene.frame();
    scene.expect_started();
    scene.expect_touch(0.03);
    for mesh in [cuboid([0.5; 3], 1), icosphere(3, 0.5), ball()] {
        insert(&mut scene.app, scene.ball, surface(&mesh));
        scene.frame();
        scene.expect_silence();
        scene.expect_touch(0.03);
    }

    // Removed and inserted again between two detections: no contact has ended.
    scene.app.world_mut().entity_mut(scene.ball).remove::<DeformableSurface>();
    insert(&mut scene.app, scene.ball, surface(&ball()));
    scene.frame();
    scene.expect_silence();
    scene.expect_touch(0.03);

    // Teleported away, and teleported back.
    scene.ball_at(3.0);
    insert(&mut scene.app, scene.ball, Teleported);
    scene.frame();
    scene.expect_ended();
    scene.expect_nothing();
    assert!(!scene.app.world().entity(scene.ball).contains::<Teleported>());
    scene.ball_at(0.53);
    insert(&mut scene.app, scene.ball, Teleported);
    scene.frame();
    scene.expect_started();
    scene.expect_touch(0.03);

    change_components(&mut scene);
    change_methods(&mut scene);

    // The mesh deforms: the whole sheet moves down, then up again.
    let lowered: Vec<Vec3> = points(&sheet()).iter().map(|point| *point - Vec3::Y).collect();
    write_positions(&mut scene.app, scene.sheet, &lowered);
    scene.frame();
    scene.expect_ended();
    scene.expect_nothing();
    scene.ball_at(-0.46);
    scene.frame();
    scene.expect_started();
    scene.expect_touch(0.04);
    write_positions(&mut scene.app, scene.sheet, &points(&sheet()));
    scene.ball_at(0.53);
    scene.frame();
    scene.expect_silence();
    scene.expect_touch(0.03);

    // After a despawn, only the remaining side receives events.
    let (sheet, old) = (scene.sheet, scene.ball);
    scene.app.world_mut().despawn(old);
    scene.frame();
    scene.expect_announced(&[Ended(sheet, old)], &[Ended(sheet, old)]);
    scene.expect_nothing();
    assert_eq!(of(&mut scene.app, old), []);

    let parent = match scene.family {
        Family::Alone => None,
        Family::Carried => Some(scene.carrier),
        Family::Grandchild => Some(scene.app.world_mut().spawn((at(0.0, 0.0, 0.25), ChildOf(scene.carrier))).id()),
    };
    let new = scene.app.world_mut().spawn_empty().id();
    if let Some(parent) = parent {
        insert(&mut scene.app, new, ChildOf(parent));
    }
    scene.dress(new);
    scene.frame();
    scene.expect_silence();
    scene.ball_at(0.53);
    scene.frame();
    scene.expect_started();
    scene.expect_touch(0.03);
    // Despawn the sheet.
    scene.app.world_mut().despawn(sheet);
    scene.frame();
    scene.expect_announced(&[Ended(sheet, new)], &[Ended(new, sheet)]);
    scene.expect_nothing();
}

fn change_components(scene: &mut Scene) {
    // Thickness: 0.03 is more than 0.001 + 0.001.
    for entity in [scene.sheet, scene.ball] {
        insert(&mut scene.app, entity, SurfaceThickness::World(0.001));
    }
    scene.frame();
    scene.expect_ended();
    scene.expect_nothing();

    // A margin reports the contact from a distance, and sends no event.
    scene.app.world_mut().resource_mut::<CircumsphereSettings>().margin = 0.04;
    scene.frame();
    scene.expect_silence();
    scene.expect_contact(0.03, 0.002);
    assert!(store(&scene.app).touching_count() == 0);
    scene.app.world_mut().resource_mut::<CircumsphereSettings>().margin = 0.0;
    scene.frame();
    scene.expect_silence();
    scene.expect_nothing();

    for entity in [scene.sheet, scene.ball] {
        insert(&mut scene.app, entity, THIN);
    }
    scene.frame();
    scene.expect_started();
    scene.expect_touch(0.03);

    // Layers of either side, changed in place.
    for entity in [scene.sheet, scene.ball] {
        scene.app.world_mut().get_mut::<SurfaceLayers>(entity).expect("the entity is a surface").filters = 0b10;
        scene.frame();
        scene.expect_ended();
        scene.expect_nothing();
        scene.app.world_mut().get_mut::<SurfaceLayers>(entity).expect("the entity is a surface").filters = 0b11;
        scene.frame();
        scene.expect_started();
        scene.expect_touch(0.03);
    }

    // The ball's lowest vertex is just below the sheet. As a solid, the ball is pushed out. As a sheet without history,
    // it counts as above.
    scene.ball_at(0.48);
    scene.frame();
    scene.expect_silence();
    scene.expect_touch(-0.02);
    insert(&mut scene.app, scene.ball, (Sidedness::TwoSided, Teleported));
    scene.frame();
    scene.expect_silence();
    let contacts = between(&mut scene.app, scene.sheet, scene.ball);
    assert!(contacts.iter().all(|contact| contact.distance >= 0.0), "{contacts:?}");
    scene.app.world_mut().entity_mut(scene.ball).insert(Sidedness::Auto);
    scene.frame();
    scene.expect_touch(-0.02);
    scene.ball_at(0.53);
    scene.frame();
    scene.expect_silence();
    scene.expect_touch(0.03);
}

fn change_methods(scene: &mut Scene) {
    let refined = store(&scene.app).touching_count();
    let exact = store(&scene.app).contact_count();
    for method in [ContactMethod::Polygon, ContactMethod::BoundingSphere, ContactMethod::Circumsphere] {
        insert(&mut scene.app, scene.sheet, method);
        insert(&mut scene.app, scene.ball, method);
        scene.frame();
        scene.expect_silence();
        match method {
            ContactMethod::Polygon => {
                scene.expect_touch(0.03);
                assert_eq!(store(&scene.app).contact_count(), exact);
                assert_eq!(store(&scene.app).touching_count(), refined);
            }
            _ => assert!(store(&scene.app).touching_count() > 0, "{method:?}"),
        }
    }
    // The more exact of two methods applies.
    insert(&mut scene.app, scene.sheet, ContactMethod::Exact);
    scene.frame();
    scene.expect_silence();
    scene.expect_touch(0.03);
    insert(&mut scene.app, scene.ball, ContactMethod::Exact);
    scene.frame();
    scene.expect_touch(0.03);
}

#[test]
fn a_life_is_seen_in_each_tick_in_update() {
    for family in [Family::Alone, Family::Carried, Family::Grandchild] {
        live(Clock::Update, family, false);
    }
    live(Clock::Update, Family::Carried, true);
}

#[test]
fn a_life_is_seen_in_each_tick_with_one_fixed_tick_a_frame() {
    for family in [Family::Alone, Family::Carried, Family::Grandchild] {
        live(Clock::Fixed(1), family, false);
    }
    live(Clock::Fixed(1), Family::Grandchild, true);
}

#[test]
fn a_life_is_seen_in_each_tick_with_three_fixed_ticks_a_frame() {
    for family in [Family::Alone, Family::Carried, Family::Grandchild] {
        live(Clock::Fixed(3), family, false);
    }
    live(Clock::Fixed(3), Family::Carried, true);
}

#[test]
fn what_comes_and_goes_between_two_detections_was_never_there() {
    let mut app = fixed_app(0);
    keep_journal(&mut app, FixedPostUpdate);
    spawn(&mut app, &sheet(), (THIN, ContactEventsEnabled));
    let ball = spawn(&mut app, &ball(), (THIN, at(0.1, 0.53, 0.2)));
    app.update();
    app.world_mut().despawn(ball);
    set_ticks(&mut app, 1);
    app.update();
    assert_eq!((store(&app).tick(), announced(&mut app)), (1, vec![]));
    assert_eq!(all(&mut app), []);
}

#[test]
fn self_contacts_come_and_go_with_the_component_and_the_positions() {
    let mut app = app();
    keep_journal(&mut app, Update);
    let stack = sheet_stack(2, 0.06, 4);
    let layers = spawn(&mut app, &stack, (THIN, ContactEventsEnabled));
    observe(&mut app, layers);
    app.update();
    assert_eq!(all(&mut app), []);

    insert(&mut app, layers, SelfCollision);
    app.update();
    let contacts = between(&mut app, layers, layers);
    assert!(!contacts.is_empty());
    // Every triangle of the lower layer lies directly below one of the upper layer.
    let touching: Vec<[u32; 2]> = store(&app).touching().map(|pair| [pair.triangle_a, pair.triangle_b]).collect();
    assert!((0..32).all(|triangle| touching.contains(&[triangle, triangle + 32])), "{touching:?}");
    for contact in &contacts {
        assert_consistent(app.world(), contact, 1.0);
        assert_near(contact.distance, 0.06, rounding(1.0), contact);
        assert_near(contact.normal.y.abs(), 1.0, rounding(1.0), contact);
    }
    assert_eq!(of(&mut app, layers), contacts);
    assert_eq!(all(&mut app), contacts);
    let heard = announced(&mut app);
    for by in [By::Message, By::Observer, By::OwnObserver] {
        let heard: Vec<_> = heard.iter().filter(|(_, listener, _)| *listener == by).collect();
        assert_eq!(heard, [&(2, by, Started(layers, layers))]);
    }

    let apart: Vec<Vec3> = points(&stack).iter().map(|point| *point * Vec3::new(1.0, 3.0, 1.0)).collect();
    write_positions(&mut app, layers, &apart);
    app.update();
    assert_eq!(all(&mut app), []);
    assert_eq!(messages(&mut app), [Ended(layers, layers)]);

    write_positions(&mut app, layers, &points(&stack));
    app.update();
    assert_eq!(messages(&mut app), [Started(layers, layers)]);
    app.world_mut().entity_mut(layers).remove::<SelfCollision>();
    app.update();
    assert_eq!(all(&mut app), []);
    assert_eq!(messages(&mut app), [Ended(layers, layers)]);
}

#[test]
fn only_who_asked_hears_of_a_contact() {
    for (sheet_asks, ball_asks) in [(false, false), (true, false), (false, true)] {
        let mut app = app();
        keep_journal(&mut app, Update);
        let sheet = spawn(&mut app, &sheet(), THIN);
        let ball = spawn(&mut app, &ball(), (THIN, at(0.1, 0.53, 0.2)));
        for (entity, asks) in [(sheet, sheet_asks), (ball, ball_asks)] {
            observe(&mut app, entity);
            if asks {
                insert(&mut app, entity, ContactEventsEnabled);
            }
        }
        let expected = |message: Announcement, to_sheet: Announcement, to_ball: Announcement| {
            let mut heard = vec![];
            if sheet_asks || ball_asks {
                heard.push((By::Message, message));
            }
            for (asks, announcement) in [(sheet_asks, to_sheet), (ball_asks, to_ball)] {
                if asks {
                    heard.push((By::Observer, announcement.clone()));
                    heard.push((By::OwnObserver, announcement));
                }
            }
            heard
        };
        let heard = |app: &mut App| {
            let mut heard: Vec<_> =
                announced(app).into_iter().map(|(_, by, announcement)| (by, announcement)).collect();
            heard.sort_by_key(|(by, _)| *by as u8);
            heard
        };
        app.update();
        assert_eq!(heard(&mut app), expected(Started(sheet, ball), Started(sheet, ball), Started(ball, sheet)));
        place(&mut app, ball, Vec3::Y * 3.0);
        app.update();
        assert_eq!(heard(&mut app), expected(Ended(sheet, ball), Ended(sheet, ball), Ended(ball, sheet)));
        app.update();
        assert_eq!(heard(&mut app), []);
    }
}

/// A sheet and, above it, a row of balls that request events. The first ball is the last in order.
fn row_of_balls(app: &mut App) -> (Entity, [Entity; 4]) {
    let sheet = spawn(app, &sheet(), (THIN, SurfaceOrder(0)));
    let mut x = -1.4;
    let balls = [4, 3, 2, 1].map(|order| {
        x += 0.6;
        spawn(app, &icosphere(2, 0.25), (THIN, at(x, 3.0, 0.2), SurfaceOrder(order), ContactEventsEnabled))
    });
    (sheet, balls)
}

fn drop_ball(app: &mut App, ball: Entity, height: f32) {
    app.world_mut().get_mut::<Transform>(ball).expect("the entity has a transform").translation.y = height;
}

#[test]
fn messages_of_a_tick_come_in_the_order_of_the_surfaces() {
    let mut app = app();
    keep_journal(&mut app, Update);
    let (sheet, [d, c, b, a]) = row_of_balls(&mut app);
    for ball in [d, c, b, a] {
        drop_ball(&mut app, ball, 0.28);
    }
    app.update();
    assert_eq!(messages(&mut app), [a, b, c, d].map(|ball| Started(sheet, ball)));
    for ball in [d, c, b, a] {
        drop_ball(&mut app, ball, 3.0);
    }
    app.update();
    assert_eq!(messages(&mut app), [a, b, c, d].map(|ball| Ended(sheet, ball)));

    // Contacts that started one after another also end in the order of the surfaces.
    for ball in [d, c, b, a] {
        drop_ball(&mut app, ball, 0.28);
        app.update();
        assert_eq!(messages(&mut app), [Started(sheet, ball)]);
    }
    for ball in [d, c, b, a] {
        drop_ball(&mut app, ball, 3.0);
    }
    app.update();
    assert_eq!(messages(&mut app), [a, b, c, d].map(|ball| Ended(sheet, ball)));
}

#[test]
fn a_new_place_in_the_order_neither_ends_nor_starts_a_contact() {
    let mut app = app();
    keep_journal(&mut app, Update);
    let sheet = spawn(&mut app, &sheet(), (THIN, SurfaceOrder(1), ContactEventsEnabled));
    let ball = spawn(&mut app, &ball(), (THIN, SurfaceOrder(2), at(0.1, 0.53, 0.2)));
    app.update();
    assert_eq!(messages(&mut app), [Started(sheet, ball)]);
    insert(&mut app, sheet, SurfaceOrder(3));
    app.update();
    assert_eq!(store(&app).pairs()[0].a, ContactSide::Surface(ball), "the order has changed");
    assert_eq!(announced(&mut app), []);
    place(&mut app, ball, Vec3::Y * 3.0);
    app.update();
    let ended = messages(&mut app);
    assert!(ended == [Ended(sheet, ball)] || ended == [Ended(ball, sheet)], "{ended:?}");
}

#[test]
fn an_observer_that_despawns_the_other_side_stops_nothing() {
    let mut app = app();
    keep_journal(&mut app, Update);
    let (sheet, balls) = row_of_balls(&mut app);
    app.add_observer(|on: On<SurfaceContactStart>, mut commands: Commands, journal: Res<Journal>| {
        let _ = journal;
        commands.entity(on.entity).try_despawn();
    });
    for ball in balls {
        drop_ball(&mut app, ball, 0.28);
    }
    app.update();
    assert_eq!(messages(&mut app).len(), 4);
    app.update();
    let mut ended = balls.map(|ball| Ended(sheet, ball)).to_vec();
    ended.reverse();
    assert_eq!(announced(&mut app).into_iter().map(|(.., announcement)| announcement).collect::<Vec<_>>(), ended);
    assert_eq!(all(&mut app), []);
}

#[test]
fn what_is_despawned_after_detection_ends_its_contacts_in_the_same_tick() {
    #[derive(Resource, Default)]
    struct Doomed(Vec<Entity>);
    let doom = |mut commands: Commands, mut doomed: ResMut<Doomed>| {
        doomed.0.drain(..).for_each(|entity| commands.entity(entity).despawn());
    };
    for held in [0, 3] {
        let mut app = app();
        keep_journal(&mut app, Update);
        app.init_resource::<Doomed>();
        app.add_systems(Update, doom.after(DeformableSystems::Detect).before(DeformableSystems::Events));
        let (sheet, [first, second, ..]) = row_of_balls(&mut app);
        insert(&mut app, sheet, ContactEventHold(held));
        drop_ball(&mut app, first, 0.28);
        app.update();
        assert_eq!(messages(&mut app), [Started(sheet, first)]);
        // One that touches, and one that comes into contact in the tick in which it goes.
        drop_ball(&mut app, second, 0.28);
        app.world_mut().resource_mut::<Doomed>().0 = vec![first, second];
        app.update();
        assert_eq!(messages(&mut app), [Ended(sheet, first)], "hold {held}");
        app.update();
        assert_eq!(messages(&mut app), []);
    }
}

#[test]
fn a_response_in_the_same_tick_reads_the_contacts_of_that_tick() {
    #[derive(Resource, Default)]
    struct Read(Vec<(u64, Option<f32>)>);
    let mut app = app();
    app.init_resource::<Read>();
    let respond = |contacts: SurfaceContacts, mut read: ResMut<Read>| {
        read.0.push((contacts.tick(), contacts.iter().map(|contact| contact.distance()).reduce(f32::min)));
    };
    app.add_systems(Update, respond.in_set(DeformableSystems::Respond));
    spawn(&mut app, &sheet(), THIN);
    let ball = spawn(&mut app, &ball(), THIN);
    for height in [0.53, 3.0, 0.56] {
        place(&mut app, ball, OVER_A_FACE + Vec3::Y * height);
        app.update();
    }
    let read = &app.world().resource::<Read>().0;
    assert_eq!(read.iter().map(|(tick, _)| *tick).collect::<Vec<_>>(), [1, 2, 3]);
    assert_near(read[0].1.expect("the bodies touch"), 0.03, rounding(1.0), read);
    assert_eq!(read[1].1, None);
    assert_near(read[2].1.expect("the bodies touch"), 0.06, rounding(1.0), read);
}
