//! The world of a scene: a headless app with bodies and obstacles, advanced by hand.

use std::time::Duration;

use bevy_app::prelude::*;
use bevy_circumsphere::{
    prelude::*,
    response::{XpbdBody, XpbdMaterial, XpbdResponsePlugin},
};
use bevy_ecs::{prelude::*, system::SystemState};
use bevy_time::Time;
use bevy_transform::components::Transform;
use circumsphere_support::scenes::Mesh;
use glam::{DVec3, Vec3};

use super::{Variation, energy::RestEdges};
use crate::headless::{headless_app, recording::Recorder};

/// Duration of a tick.
pub const TICK: Duration = Duration::from_nanos(1_000_000_000 / 60);

/// Number of whole ticks in a duration in seconds.
pub(super) fn tick_at(seconds: f64) -> u32 {
    (Duration::from_secs_f64(seconds).as_nanos() / TICK.as_nanos()) as u32
}

/// The world of a scene.
pub struct Stage {
    pub app: App,
    /// The bodies, which the solver moves.
    pub bodies: Vec<Entity>,
    /// The surfaces that are static or kinematic.
    pub obstacles: Vec<Entity>,
    /// The rigid shapes, which are static or moved by their transforms.
    pub shapes: Vec<Entity>,
    /// Number of ticks played.
    pub ticks: u32,
    contacts: SystemState<SurfaceContacts<'static>>,
    method: ContactMethod,
    shape: SurfaceShape,
    continuous: bool,
}

/// The initial positions of a body's vertices in its own frame: its rest shape.
#[derive(Component, Clone, Debug)]
struct RestPositions(Vec<DVec3>);

impl Stage {
    /// An empty world, recorded by `recorder`.
    pub fn new(variation: &Variation, recorder: Recorder) -> Self {
        let plugins = DeformableCollisionPlugins::new(Update).build().add(XpbdResponsePlugin::new(Update));
        let mut app = headless_app(plugins, variation.detection, recorder);
        app.insert_resource(variation.response);
        let contacts = SystemState::new(app.world_mut());
        let &Variation { method, shape, continuous, .. } = variation;
        Self {
            app,
            bodies: Vec::new(),
            obstacles: Vec::new(),
            shapes: Vec::new(),
            ticks: 0,
            contacts,
            method,
            shape,
            continuous,
        }
    }

    /// Adds a static surface.
    pub fn add_obstacle(&mut self, name: &'static str, mesh: &Mesh, extra: impl Bundle) -> Entity {
        let (surface, positions) = surface_of(mesh);
        let entity =
            self.app.world_mut().spawn((surface, positions, self.method, self.shape, Name::new(name), extra)).id();
        self.obstacles.push(entity);
        entity
    }

    /// Adds a surface that the scene moves, by its positions or its transform.
    pub fn add_moving_obstacle(&mut self, name: &'static str, mesh: &Mesh, extra: impl Bundle) -> Entity {
        let entity = self.add_obstacle(name, mesh, extra);
        self.sweep(entity);
        entity
    }

    pub fn add_shape(&mut self, name: &'static str, shape: SharedShape, transform: Transform) -> Entity {
        let entity = self.app.world_mut().spawn((RigidShape(shape), transform, Name::new(name))).id();
        self.shapes.push(entity);
        entity
    }

    /// Sets the transform of a surface or rigid shape.
    pub fn place(&mut self, entity: Entity, transform: Transform) {
        *self.app.world_mut().get_mut::<Transform>(entity).expect("moved objects have a transform") = transform;
    }

    pub fn add_body(
        &mut self,
        name: &'static str,
        mesh: &Mesh,
        material: XpbdMaterial,
        change: impl FnOnce(XpbdBody) -> XpbdBody,
        extra: impl Bundle,
    ) -> Entity {
        let (surface, positions) = surface_of(mesh);
        let body = XpbdBody::new(&surface, &positions, material).expect("scene meshes are valid");
        let rest = RestPositions(positions.0.iter().map(|position| position.as_dvec3()).collect());
        let edges = RestEdges::new(surface.topology(), &rest.0);
        let bundle =
            (surface, positions, change(body), (rest, edges), (self.method, self.shape), Name::new(name), extra);
        let entity = self.app.world_mut().spawn(bundle).id();
        self.bodies.push(entity);
        self.sweep(entity);
        entity
    }

    fn sweep(&mut self, entity: Entity) {
        if self.continuous {
            self.app.world_mut().entity_mut(entity).insert(SweptCollision);
        }
    }

    /// End of the next tick, in seconds since the start.
    pub fn next_time(&self) -> f64 {
        f64::from(self.ticks + 1) * TICK.as_secs_f64()
    }

    /// Plays one tick.
    pub fn tick(&mut self) {
        self.ticks += 1;
        self.app.world_mut().resource_mut::<Time>().advance_by(TICK);
        self.app.update();
    }

    /// All surfaces, bodies first.
    pub fn surfaces(&self) -> impl Iterator<Item = Entity> {
        self.bodies.iter().chain(&self.obstacles).copied()
    }

    /// Vertex positions of a surface, in its own frame.
    pub fn positions(&self, entity: Entity) -> &[Vec3] {
        &self.app.world().get::<SurfacePositions>(entity).expect("surfaces are never removed").0
    }

    /// Vertex positions of a surface, in world space.
    pub fn world_positions(&self, entity: Entity) -> Vec<DVec3> {
        if self.app.world().get::<SurfaceFrame>(entity) == Some(&SurfaceFrame::World) {
            return self.positions(entity).iter().map(|position| position.as_dvec3()).collect();
        }
        let transform = self.app.world().get::<Transform>(entity).copied().unwrap_or_default();
        let (turn, offset) = (transform.rotation.as_dquat().normalize(), transform.translation.as_dvec3());
        self.positions(entity).iter().map(|position| turn * position.as_dvec3() + offset).collect()
    }

    /// Initial vertex positions of a body.
    pub fn rest(&self, body: Entity) -> &[DVec3] {
        &self.app.world().get::<RestPositions>(body).expect("bodies are never removed").0
    }

    /// The surface component of an entity.
    pub fn surface(&self, entity: Entity) -> &DeformableSurface {
        self.app.world().get::<DeformableSurface>(entity).expect("surfaces are never removed")
    }

    /// Number of triangles of all surfaces.
    pub fn triangle_count(&self) -> usize {
        self.surfaces().map(|entity| self.surface(entity).topology().triangles().len()).sum()
    }

    /// Reads the contacts of the last tick.
    pub fn with_contacts<T>(&mut self, read: impl FnOnce(&SurfaceContacts<'_>) -> T) -> T {
        let contacts = self.contacts.get(self.app.world()).expect("the plugins insert the contact store");
        read(&contacts)
    }

    /// Writes positions of a surface that the scene moves, or of pinned vertices of a body.
    pub fn move_vertices(&mut self, entity: Entity, positions: impl IntoIterator<Item = (usize, Vec3)>) {
        let mut current = self.app.world_mut().get_mut::<SurfacePositions>(entity).expect("surfaces are never removed");
        for (vertex, position) in positions {
            current.0[vertex] = position;
        }
    }

    /// Hash of the state of all bodies: FNV-1a over all positions and velocities.
    pub fn hash(&self) -> u64 {
        const OFFSET_BASIS: u64 = 0xcbf2_9ce4_8422_2325;
        const PRIME: u64 = 0x0100_0000_01b3;
        let mut hash = OFFSET_BASIS;
        for &entity in &self.bodies {
            let body = self.app.world().get::<XpbdBody>(entity).expect("bodies are never removed");
            for vector in self.positions(entity).iter().chain(&body.velocities) {
                for byte in vector.to_array().into_iter().flat_map(|coordinate| coordinate.to_bits().to_le_bytes()) {
                    hash = (hash ^ u64::from(byte)).wrapping_mul(PRIME);
                }
            }
        }
        hash
    }
}

fn surface_of(mesh: &Mesh) -> (DeformableSurface, SurfacePositions) {
    let positions: Vec<Vec3> = mesh.positions.iter().map(|&position| Vec3::from(position)).collect();
    DeformableSurface::from_mesh(&positions, &mesh.triangles).expect("scene meshes are valid")
}
