//! Apps that are recorded tick by tick, and scenes for them.

use std::collections::{BTreeMap, BTreeSet};

use bevy_app::prelude::*;
use bevy_circumsphere::{
    ContactStore,
    debug::{DeformableRerunPlugin, LevelOfDetail, RerunSettings},
    geometry::ContactKey,
    prelude::*,
};
use bevy_ecs::{prelude::*, system::RunSystemOnce};
use bevy_transform::components::Transform;
use circumsphere_support::scenes::{Diagonals, Mesh, grid, icosphere};
use glam::{DAffine3, DVec3, Quat, Vec3};
use rerun::{RecordingStream, RecordingStreamBuilder, log::ChunkBatcherConfig, sink::MemorySinkStorage};

use crate::recording::{Recording, Viewer};

pub const THICKNESS: f32 = 0.02;
pub const THIN: SurfaceThickness = SurfaceThickness::World(THICKNESS);

/// The mesh that a surface was made from. It tells which vertices were at the same position then.
#[derive(Component, Clone)]
pub struct Made(pub Mesh);

/// A stream to memory that never splits chunks by time or size.
pub fn stream() -> (RecordingStream, MemorySinkStorage) {
    RecordingStreamBuilder::new("rerun_test")
        .recording_id("recording")
        .send_properties(false)
        .batcher_config(ChunkBatcherConfig::NEVER)
        .memory()
        .expect("memory can be written to")
}

/// Everything except wall-clock times, without a limit.
pub fn everything() -> RerunSettings {
    RerunSettings { bytes_per_tick: usize::MAX >> 8, ..RerunSettings::everything() }
}

/// Every layer near contacts only, without a limit.
pub fn near() -> RerunSettings {
    RerunSettings {
        bytes_per_tick: usize::MAX >> 8,
        meshes: LevelOfDetail::NearContacts,
        recipe_age: LevelOfDetail::NearContacts,
        ..RerunSettings::default()
    }
}

pub fn nothing() -> RerunSettings {
    RerunSettings {
        series: false,
        meshes: LevelOfDetail::Off,
        shapes: false,
        contacts: false,
        penetrations: false,
        patches: LevelOfDetail::Off,
        tetrahedra: LevelOfDetail::Off,
        pairs: LevelOfDetail::Off,
        spheres: LevelOfDetail::Off,
        cones: LevelOfDetail::Off,
        curvature: LevelOfDetail::Off,
        recipe_age: LevelOfDetail::Off,
        tree_levels: 0,
        cells: LevelOfDetail::Off,
        ..everything()
    }
}

/// An app and its recording.
pub struct Recorded {
    pub app: App,
    pub storage: MemorySinkStorage,
    pub viewer: Viewer,
    /// The rows of the last tick.
    pub last: Recording,
}

impl Recorded {
    pub fn new(settings: RerunSettings) -> Self {
        Self::with(settings, DeformableCollisionPlugins::new(Update), |_| {})
    }

    pub fn with(settings: RerunSettings, plugins: impl PluginGroup, add: impl FnOnce(&mut App)) -> Self {
        let (stream, storage) = stream();
        let mut app = App::new();
        app.add_plugins(plugins).add_plugins(DeformableRerunPlugin::to_stream(stream)).insert_resource(settings);
        add(&mut app);
        app.finish();
        app.cleanup();
        Self { app, storage, viewer: Viewer::default(), last: Recording::default() }
    }

    /// Runs an update and takes in what it recorded.
    pub fn tick(&mut self) -> &Recording {
        self.app.update();
        self.take()
    }

    pub fn take(&mut self) -> &Recording {
        self.last = Recording::of(self.storage.take());
        self.viewer.show(&self.last);
        &self.last
    }

    pub fn settings(&mut self) -> Mut<'_, RerunSettings> {
        self.app.world_mut().resource_mut()
    }

    /// The tick of the store, in the type that rows use.
    pub fn number(&self) -> i64 {
        i64::try_from(self.app.world().resource::<ContactStore>().tick()).expect("the tick fits in an i64")
    }
}

pub fn points(mesh: &Mesh) -> Vec<Vec3> {
    mesh.positions.iter().copied().map(Vec3::from_array).collect()
}

pub fn spawn(app: &mut App, name: &str, mesh: &Mesh, extra: impl Bundle) -> Entity {
    let entity = spawn_unnamed(app, mesh, extra);
    app.world_mut().entity_mut(entity).insert(Name::new(name.to_owned()));
    entity
}

pub fn spawn_unnamed(app: &mut App, mesh: &Mesh, extra: impl Bundle) -> Entity {
    let surface = DeformableSurface::from_mesh(&points(mesh), &mesh.triangles).expect("the mesh is valid");
    app.world_mut().spawn((surface, Made(mesh.clone()), extra)).id()
}

pub fn spawn_shape(app: &mut App, name: &str, shape: SharedShape, extra: impl Bundle) -> Entity {
    app.world_mut().spawn((RigidShape(shape), Name::new(name.to_owned()), extra)).id()
}

pub fn sheet(cells: usize) -> Mesh {
    grid(cells, cells, 2.0, 2.0, Diagonals::Uniform)
}

pub fn positions(world: &World, entity: Entity) -> &[Vec3] {
    &world.get::<SurfacePositions>(entity).expect("the entity is a surface").0
}

pub fn move_positions(app: &mut App, entity: Entity, change: impl Fn(Vec3) -> Vec3) {
    let mut positions = app.world_mut().get_mut::<SurfacePositions>(entity).expect("the entity is a surface");
    for position in &mut positions.0 {
        *position = change(*position);
    }
}

pub fn place(app: &mut App, entity: Entity, change: impl FnOnce(&mut Transform)) {
    change(&mut app.world_mut().get_mut::<Transform>(entity).expect("the entity has a transform"));
}

/// The transform from an entity's frame to the world, composed in f64.
pub fn world_affine(world: &World, entity: Entity) -> DAffine3 {
    let transform = world.get::<Transform>(entity).expect("the entity has a transform");
    let own = DAffine3::from_scale_rotation_translation(
        transform.scale.as_dvec3(),
        transform.rotation.as_dquat().normalize(),
        transform.translation.as_dvec3(),
    );
    world.get::<ChildOf>(entity).map_or(own, |parent| world_affine(world, parent.parent()) * own)
}

pub fn world_corners(world: &World, entity: Entity, triangle: u32) -> [DVec3; 3] {
    let affine = world_affine(world, entity);
    let positions = positions(world, entity);
    world.get::<Made>(entity).expect("the entity has its mesh").0.triangles[triangle as usize]
        .map(|vertex| affine.transform_point3(positions[vertex as usize].as_dvec3()))
}

/// A crumpled sheet that touches itself, a ball in it, a floor below it, and a rod across it. This gives every kind of
/// pair, with names, translation, rotation, mirroring, and scale.
pub struct Scene {
    pub crumpled: Entity,
    pub ball: Entity,
    pub sheet: Entity,
    pub floor: Entity,
    pub rod: Entity,
}

pub fn crumpled() -> Mesh {
    let mut mesh = sheet(10);
    for position in &mut mesh.positions {
        let [x, y, z] = *position;
        *position = [(x * 3.3).fract() * 0.2 + x * 0.5, y + 0.05 * (5.0 * z).fract(), z];
    }
    mesh
}

/// A sheet beside the crumpled one. One corner is turned up as high as the crumpled one reaches down.
fn turned_up() -> Mesh {
    let mut mesh = sheet(8);
    for position in &mut mesh.positions {
        let [x, y, z] = *position;
        position[1] = if x.min(z) > 0.9 { y + 0.15 } else { y };
    }
    mesh
}

impl Scene {
    pub fn spawn(app: &mut App, method: ContactMethod) -> Self {
        let turned =
            Transform::from_xyz(0.1, 0.3, 0.2).with_rotation(Quat::from_xyzw(0.1, 0.05, 0.0, 0.99).normalize());
        let mirrored = Transform::from_xyz(0.1, 0.52, 0.2).with_scale(Vec3::new(-0.8, 0.8, 0.8));
        Self {
            crumpled: spawn(app, "crumpled", &crumpled(), (THIN, method, SelfCollision, turned)),
            ball: spawn(app, "ball", &icosphere(2, 0.3), (THIN, method, mirrored)),
            sheet: spawn(app, "sheet", &turned_up(), (THIN, method, Transform::from_xyz(0.0, 0.01, 0.0))),
            floor: spawn_shape(app, "floor", SharedShape::halfspace(Vec3::Y), ()),
            rod: spawn_shape(app, "rod", SharedShape::capsule_x(0.6, 0.1), Transform::from_xyz(0.1, 0.3, -0.4)),
        }
    }

    /// Deforms and moves everything that can, a little.
    pub fn advance(&self, app: &mut App, tick: u32) {
        let swing = 0.01 * ((tick % 5) as f32 - 2.0);
        move_positions(app, self.crumpled, |position| {
            position + Vec3::new(0.0, swing * position.x, swing * position.z)
        });
        move_positions(app, self.sheet, |position| {
            position + Vec3::new(0.0, 0.3 * swing * position.x * position.z, 0.0)
        });
        place(app, self.ball, |transform| transform.translation.y -= 0.01);
        place(app, self.rod, |transform| transform.translation.y += 0.3 * swing);
    }

    pub fn surfaces(&self) -> [(&'static str, Entity); 3] {
        [("crumpled", self.crumpled), ("ball", self.ball), ("sheet", self.sheet)]
    }

    pub fn name(&self, entity: Entity) -> &'static str {
        let shapes = [("floor", self.floor), ("rod", self.rod)];
        self.surfaces().into_iter().chain(shapes).find(|&(_, other)| other == entity).expect("it is in the scene").0
    }

    pub fn pair_name(&self, a: Entity, b: Entity) -> String {
        if a == b { format!("{} with itself", self.name(a)) } else { format!("{} with {}", self.name(a), self.name(b)) }
    }
}

/// The values of a contact, as a reader sees them.
#[derive(Clone, Debug, PartialEq)]
pub struct Seen {
    pub sides: [Entity; 2],
    pub key: ContactKey,
    pub points: [Vec3; 2],
    pub normal: Vec3,
    pub triangles: [Option<u32>; 2],
    pub distance: f32,
    pub separation: f32,
    pub is_crossing: bool,
}

impl Seen {
    pub fn has_passed(&self) -> bool {
        self.distance < 0.0 || self.is_crossing
    }
}

pub fn contacts(app: &mut App) -> Vec<Seen> {
    let read = |contacts: SurfaceContacts| -> Vec<Seen> {
        let seen = |contact: Contact| Seen {
            sides: [contact.a().entity(), contact.b().entity()],
            key: contact.key(),
            points: contact.points().into(),
            normal: contact.normal(),
            triangles: [contact.triangles().0, contact.triangles().1]
                .map(|triangle| triangle.map(|triangle| triangle.0)),
            distance: contact.distance(),
            separation: contact.separation(),
            is_crossing: contact.is_crossing(),
        };
        contacts.iter().map(seen).collect()
    };
    app.world_mut().run_system_once(read).expect("contacts can be read")
}

pub fn by_pair(contacts: &[Seen]) -> BTreeMap<[Entity; 2], Vec<&Seen>> {
    let mut by_pair: BTreeMap<[Entity; 2], Vec<&Seen>> = BTreeMap::new();
    for contact in contacts {
        by_pair.entry(contact.sides).or_default().push(contact);
    }
    by_pair
}

/// The triangles of a surface that touch or have passed something, and those among them that have passed it.
pub fn touching(app: &mut App, entity: Entity) -> (BTreeSet<u32>, BTreeSet<u32>) {
    let (mut touching, mut passed) = (BTreeSet::new(), BTreeSet::new());
    for contact in contacts(app).iter().filter(|contact| contact.has_passed()) {
        for (side, triangle) in contact.sides.iter().zip(contact.triangles) {
            if *side == entity {
                passed.extend(triangle);
            }
        }
    }
    let store = app.world().resource::<ContactStore>();
    for pair in store.pairs() {
        for pair_of_triangles in &pair.touching[..] {
            for (side, triangle) in [(pair.a, pair_of_triangles.triangle_a), (pair.b, pair_of_triangles.triangle_b)] {
                if side == ContactSide::Surface(entity) {
                    touching.insert(triangle);
                }
            }
        }
    }
    touching.extend(&passed);
    (touching, passed)
}

/// The triangles of a surface that touch something, and those that share a vertex with one of them. Vertices are
/// compared by their positions when the surface was made.
pub fn near_contacts(app: &mut App, entity: Entity) -> BTreeSet<u32> {
    let (touching, _) = touching(app, entity);
    let mesh = &app.world().get::<Made>(entity).expect("the entity has its mesh").0;
    let corners = |triangle: u32| {
        mesh.triangles[triangle as usize].map(|vertex| mesh.positions[vertex as usize].map(f32::to_bits))
    };
    let vertices: BTreeSet<[u32; 3]> = touching.iter().flat_map(|&triangle| corners(triangle)).collect();
    let is_near = |triangle: &u32| corners(*triangle).iter().any(|corner| vertices.contains(corner));
    (0..mesh.triangles.len() as u32).filter(is_near).collect()
}
