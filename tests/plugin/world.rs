//! Headless worlds for the tests of this folder: apps, bodies, and records of contacts and events.

use std::fmt::Debug;

use bevy_app::prelude::*;
use bevy_circumsphere::{
    ContactStore, StencilEntry,
    geometry::{ContactKey, FeatureKind},
    prelude::*,
};
use bevy_ecs::{prelude::*, schedule::ScheduleLabel, system::RunSystemOnce};
use bevy_time::{TimePlugin, TimeUpdateStrategy};
use bevy_transform::components::Transform;
use circumsphere_support::scenes::{Diagonals, Mesh, grid, icosphere};
use glam::{DMat4, DVec3, Vec3};

/// A name that does not depend on spawn order, so that two worlds can be compared.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Called(pub &'static str);

/// The rounding error of a handful of f32 operations on lengths up to `size`: 4 units in the last place.
pub fn rounding(size: f32) -> f32 {
    4.0 * f32::EPSILON * size
}

#[track_caller]
pub fn assert_near(found: f32, expected: f32, tolerance: f32, what: impl Debug) {
    assert!((found - expected).abs() <= tolerance, "{what:?}: {found} is not {expected} (tolerance {tolerance})");
}

#[track_caller]
pub fn assert_near_vector(found: Vec3, expected: Vec3, tolerance: f32, what: impl Debug) {
    assert!(found.distance(expected) <= tolerance, "{what:?}: {found} is not {expected} (tolerance {tolerance})");
}

pub fn points(mesh: &Mesh) -> Vec<Vec3> {
    mesh.positions.iter().copied().map(Vec3::from_array).collect()
}

pub fn surface(mesh: &Mesh) -> (DeformableSurface, SurfacePositions) {
    DeformableSurface::from_mesh(&points(mesh), &mesh.triangles).expect("the mesh is valid")
}

/// A sheet of 4 by 4 in the plane y = 0 with edges of 0.5, facing up. It is flat: the distance of a vertex at height h
/// is h.
pub fn sheet() -> Mesh {
    grid(8, 8, 4.0, 4.0, Diagonals::Uniform)
}

/// A closed ball of radius 0.5 with a vertex at its very bottom and top. If its center is h above a sheet, its distance
/// is h − 0.5.
pub fn ball() -> Mesh {
    icosphere(2, 0.5)
}

/// A place above the inside of one of the sheet's triangles.
pub const OVER_A_FACE: Vec3 = Vec3::new(0.1, 0.0, 0.2);

pub const EXACT_METHODS: [ContactMethod; 3] = [ContactMethod::Closest, ContactMethod::Exact, ContactMethod::Polygon];

/// The thickness of most bodies in these tests. Two of them touch within 0.1.
pub const THIN: SurfaceThickness = SurfaceThickness::World(0.05);

pub fn at(x: f32, y: f32, z: f32) -> Transform {
    Transform::from_xyz(x, y, z)
}

/// The number of threads of the task pool. The first test of this process that needs the pool creates it for all.
pub const POOL_THREADS: usize = 4;

/// An app that detects in `schedule` and has neither clock nor transform propagation.
pub fn app_in(schedule: impl ScheduleLabel) -> App {
    let mut app = App::new();
    app.add_plugins(DeformableCollisionPlugins::new(schedule));
    app
}

pub fn app() -> App {
    app_in(Update)
}

/// An app that detects in `FixedPostUpdate`, `ticks` times per update, from the second update on.
pub fn fixed_app(ticks: u32) -> App {
    fixed_app_with(ticks, |_| {})
}

/// Like [`fixed_app`], with a function that adds more before the app is finished.
pub fn fixed_app_with(ticks: u32, add: impl FnOnce(&mut App)) -> App {
    let mut app = App::new();
    app.add_plugins((TimePlugin, DeformableCollisionPlugins::default()));
    add(&mut app);
    set_ticks(&mut app, ticks);
    app.finish();
    app.cleanup();
    app.update();
    app
}

pub fn set_ticks(app: &mut App, ticks: u32) {
    app.insert_resource(TimeUpdateStrategy::FixedTimesteps(ticks));
}

pub fn spawn(app: &mut App, mesh: &Mesh, extra: impl Bundle) -> Entity {
    app.world_mut().spawn((surface(mesh), extra)).id()
}

pub fn insert(app: &mut App, entity: Entity, extra: impl Bundle) {
    app.world_mut().entity_mut(entity).insert(extra);
}

pub fn place(app: &mut App, entity: Entity, translation: Vec3) {
    app.world_mut().get_mut::<Transform>(entity).expect("the entity has a transform").translation = translation;
}

pub fn write_positions(app: &mut App, entity: Entity, positions: &[Vec3]) {
    app.world_mut().get_mut::<SurfacePositions>(entity).expect("the entity is a surface").0 = positions.to_vec();
}

pub fn status(app: &App, entity: Entity) -> SurfaceStatus {
    app.world().get::<SurfaceStatus>(entity).expect("the entity is a surface or a shape").clone()
}

pub fn store(app: &App) -> &ContactStore {
    app.world().resource::<ContactStore>()
}

/// The values of a contact, as a reader sees them.
#[derive(Clone, Debug, PartialEq)]
pub struct Seen {
    pub a: ContactSide,
    pub b: ContactSide,
    pub key: ContactKey,
    pub kind: FeatureKind,
    pub distance: f32,
    pub separation: f32,
    pub contact_distance: f32,
    pub normal: Vec3,
    pub points: (Vec3, Vec3),
    pub triangles: (Option<TriangleId>, Option<TriangleId>),
    pub barycentrics: ([f32; 3], [f32; 3]),
    pub stencil: Vec<StencilEntry>,
    pub feature_vertices: (Vec<VertexId>, Vec<VertexId>),
}

impl From<Contact<'_>> for Seen {
    fn from(contact: Contact<'_>) -> Self {
        Self {
            a: contact.a(),
            b: contact.b(),
            key: contact.key(),
            kind: contact.kind(),
            distance: contact.distance(),
            separation: contact.separation(),
            contact_distance: contact.contact_distance(),
            normal: contact.normal(),
            points: contact.points(),
            triangles: contact.triangles(),
            barycentrics: contact.barycentrics(),
            stencil: contact.stencil().to_vec(),
            feature_vertices: {
                let (first, second) = contact.feature_vertices();
                (first.to_vec(), second.to_vec())
            },
        }
    }
}

fn read(app: &mut App, read: impl Fn(SurfaceContacts) -> Vec<Seen> + Send + Sync + 'static) -> Vec<Seen> {
    app.world_mut().run_system_once(move |contacts: SurfaceContacts| read(contacts)).expect("contacts can be read")
}

pub fn all(app: &mut App) -> Vec<Seen> {
    read(app, |contacts| contacts.iter().map(Seen::from).collect())
}

pub fn of(app: &mut App, entity: Entity) -> Vec<Seen> {
    read(app, move |contacts| contacts.contacts_with(entity).map(Seen::from).collect())
}

pub fn between(app: &mut App, a: Entity, b: Entity) -> Vec<Seen> {
    read(app, move |contacts| contacts.between(a, b).map(Seen::from).collect())
}

/// The contact with the smallest distance.
#[track_caller]
pub fn deepest(contacts: &[Seen]) -> &Seen {
    contacts.iter().min_by(|a, b| a.distance.total_cmp(&b.distance)).expect("there is a contact")
}

/// The transform from an entity's frame to the world, composed in f64 from its own transform and those of its parents.
pub fn world_matrix(world: &World, entity: Entity) -> DMat4 {
    let own = world.get::<Transform>(entity).map_or(DMat4::IDENTITY, |transform| {
        DMat4::from_scale_rotation_translation(
            transform.scale.as_dvec3(),
            transform.rotation.as_dquat(),
            transform.translation.as_dvec3(),
        )
    });
    world.get::<ChildOf>(entity).map_or(own, |parent| world_matrix(world, parent.parent()) * own)
}

fn world_vertex(world: &World, entity: Entity, vertex: VertexId) -> DVec3 {
    let position = world.get::<SurfacePositions>(entity).expect("the entity is a surface").0[vertex.index()];
    let matrix = match world.get::<SurfaceFrame>(entity) {
        Some(SurfaceFrame::World) => DMat4::IDENTITY,
        _ => world_matrix(world, entity),
    };
    matrix.transform_point3(position.as_dvec3())
}

/// Checks everything about an exact contact that follows from its own values and its vertices in the world. `size`
/// bounds the coordinates of the bodies in the world.
#[track_caller]
pub fn assert_consistent(world: &World, contact: &Seen, size: f32) {
    // Positions are rounded to f32 in the frame of the pair, weights to storage precision, and points when they are
    // read. Each is off by a few units in the last place of a coordinate.
    let tolerance = 4.0 * rounding(size);
    assert_near(contact.normal.length(), 1.0, 4.0 * f32::EPSILON, contact);
    assert_near(contact.separation, contact.distance - contact.contact_distance, rounding(size), contact);
    let along = (contact.points.1 - contact.points.0).dot(contact.normal);
    assert_near(along, contact.distance, tolerance, contact);
    assert_near((contact.points.0 - contact.points.1).length(), contact.distance.abs(), tolerance, contact);

    let sides = [
        (contact.a, contact.points.0, contact.triangles.0, contact.barycentrics.0, &contact.feature_vertices.0, -1.0),
        (contact.b, contact.points.1, contact.triangles.1, contact.barycentrics.1, &contact.feature_vertices.1, 1.0),
    ];
    for (side, point, triangle, weights, vertices, sign) in sides {
        let ContactSide::Surface(entity) = side else {
            let of_shape = |entry: &StencilEntry| entry.entity == side.entity();
            assert!(!contact.stencil.iter().any(of_shape), "a shape is not in a stencil: {contact:?}");
            continue;
        };
        let triangle = triangle.expect("a surface has triangles");
        assert_near(weights.iter().sum(), 1.0, 4.0 * f32::EPSILON, contact);
        assert!(weights.iter().all(|weight| (-1.0e-6..=1.000_001).contains(weight)), "{contact:?}");
        let corners = world.get::<DeformableSurface>(entity).expect("the entity is a surface").topology().triangles()
            [triangle.index()]
        .map(|vertex| world_vertex(world, entity, VertexId(vertex)));
        let by_weights: DVec3 = corners.iter().zip(weights).map(|(corner, weight)| *corner * f64::from(weight)).sum();
        assert_near_vector(by_weights.as_vec3(), point, tolerance, contact);

        // In a self-collision both sides are the same entity. The sign of the weight tells them apart.
        let entries: Vec<&StencilEntry> = contact
            .stencil
            .iter()
            .filter(|entry| entry.entity == entity && (contact.a != contact.b || entry.weight * sign > 0.0))
            .collect();
        assert!((1..=3).contains(&entries.len()), "{contact:?}");
        assert!(entries.iter().all(|entry| vertices.contains(&entry.vertex)), "not part of the feature: {contact:?}");
        assert!(entries.iter().all(|entry| entry.normal == contact.normal), "{contact:?}");
        assert_near(entries.iter().map(|entry| entry.weight).sum(), sign, 4.0 * f32::EPSILON, contact);
        let by_stencil: DVec3 =
            entries.iter().map(|entry| world_vertex(world, entity, entry.vertex) * f64::from(entry.weight)).sum();
        assert_near_vector(by_stencil.as_vec3() * sign, point, tolerance, contact);
    }
}

#[track_caller]
pub fn assert_all_consistent(world: &World, contacts: &[Seen], size: f32) {
    for contact in contacts {
        assert_consistent(world, contact, size);
    }
}

/// Checks that a contact is the same, with sides swapped, when read from its other side.
#[track_caller]
pub fn assert_swapped(one: &Seen, other: &Seen) {
    assert_eq!((one.a, one.b, one.key, one.kind), (other.b, other.a, other.key, other.kind));
    assert_eq!((one.distance, one.separation), (other.distance, other.separation));
    assert_eq!(one.normal, -other.normal);
    assert_eq!(one.points, (other.points.1, other.points.0));
    assert_eq!(one.triangles, (other.triangles.1, other.triangles.0));
    assert_eq!(one.barycentrics, (other.barycentrics.1, other.barycentrics.0));
    assert_eq!(one.feature_vertices.0, other.feature_vertices.1);
    assert_eq!(one.feature_vertices.1, other.feature_vertices.0);
    let negated = |entry: &StencilEntry| StencilEntry { weight: -entry.weight, normal: -entry.normal, ..*entry };
    assert_eq!(one.stencil, other.stencil.iter().map(negated).collect::<Vec<_>>());
}

/// Pairs by name, with their contacts and touching triangles, for a bitwise comparison: `Debug` writes the shortest
/// number that reads back as the same float.
pub fn fingerprint(app: &App) -> Vec<(&'static str, &'static str, Vec<String>)> {
    let name = |side: ContactSide| app.world().get::<Called>(side.entity()).expect("the entity has a name").0;
    let store = store(app);
    store
        .pairs()
        .iter()
        .map(|pair| {
            let contacts = pair.contacts.iter().map(|contact| format!("{contact:?}"));
            let touching = pair.touching.iter().map(|touching| format!("{touching:?}"));
            let whole = format!("{} {} {:?}", pair.contact_distance, pair.nearest, pair.frame_pose);
            (name(pair.a), name(pair.b), contacts.chain(touching).chain([whole]).collect())
        })
        .collect()
}

/// How an announcement was received.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum By {
    Message,
    /// By an observer of the whole world.
    Observer,
    /// By an observer of this entity.
    OwnObserver,
}

#[derive(Clone, Debug, PartialEq)]
pub enum Announcement {
    Started(Entity, Entity),
    Ended(Entity, Entity),
    Quarantined(Entity, QuarantineReason),
}

/// All announcements in order, with the tick of their detection.
#[derive(Resource, Clone, Debug, Default)]
pub struct Journal(pub Vec<(u64, By, Announcement)>);

fn observe_started(on: On<SurfaceContactStart>, contacts: SurfaceContacts, mut journal: ResMut<Journal>) {
    journal.0.push((contacts.tick(), By::Observer, Announcement::Started(on.entity, on.other)));
}

fn observe_ended(on: On<SurfaceContactEnd>, contacts: SurfaceContacts, mut journal: ResMut<Journal>) {
    journal.0.push((contacts.tick(), By::Observer, Announcement::Ended(on.entity, on.other)));
}

fn observe_quarantined(on: On<SurfaceQuarantined>, contacts: SurfaceContacts, mut journal: ResMut<Journal>) {
    journal.0.push((contacts.tick(), By::Observer, Announcement::Quarantined(on.entity, on.reason.clone())));
}

fn read_messages(
    contacts: SurfaceContacts,
    mut journal: ResMut<Journal>,
    mut ended: MessageReader<SurfaceContactEnd>,
    mut started: MessageReader<SurfaceContactStart>,
    mut quarantined: MessageReader<SurfaceQuarantined>,
) {
    let tick = contacts.tick();
    let messages = ended.read().map(|message| Announcement::Ended(message.entity, message.other));
    let messages = messages.chain(started.read().map(|message| Announcement::Started(message.entity, message.other)));
    let messages = messages
        .chain(quarantined.read().map(|message| Announcement::Quarantined(message.entity, message.reason.clone())));
    journal.0.extend(messages.map(|announcement| (tick, By::Message, announcement)));
}

/// Keeps a [`Journal`] of the messages and entity events of detection in `schedule`.
pub fn keep_journal(app: &mut App, schedule: impl ScheduleLabel) {
    app.init_resource::<Journal>()
        .add_observer(observe_started)
        .add_observer(observe_ended)
        .add_observer(observe_quarantined)
        .add_systems(schedule, read_messages.in_set(DeformableSystems::Log));
}

/// Also records what observers of this entity receive.
pub fn observe(app: &mut App, entity: Entity) {
    app.world_mut()
        .entity_mut(entity)
        .observe(|on: On<SurfaceContactStart>, contacts: SurfaceContacts, mut journal: ResMut<Journal>| {
            journal.0.push((contacts.tick(), By::OwnObserver, Announcement::Started(on.entity, on.other)));
        })
        .observe(|on: On<SurfaceContactEnd>, contacts: SurfaceContacts, mut journal: ResMut<Journal>| {
            journal.0.push((contacts.tick(), By::OwnObserver, Announcement::Ended(on.entity, on.other)));
        });
}

/// The announcements since the last call.
pub fn announced(app: &mut App) -> Vec<(u64, By, Announcement)> {
    std::mem::take(&mut app.world_mut().resource_mut::<Journal>().0)
}

/// The messages since the last call, without what observers received.
pub fn messages(app: &mut App) -> Vec<Announcement> {
    announced(app).into_iter().filter(|(_, by, _)| *by == By::Message).map(|(.., announcement)| announcement).collect()
}
