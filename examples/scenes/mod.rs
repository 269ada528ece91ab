//! The physics scenes that the examples play: each a headless app with bodies in it, moved tick by tick.

pub mod layers;
pub mod cloth_drop;
pub mod measure;

use std::time::Duration;

use bevy_app::prelude::*;
use bevy_circumsphere::{prelude::*, response::*};
use bevy_ecs::prelude::*;
use bevy_time::Time;
use circumsphere_support::scenes::Mesh;
use glam::Vec3;

use crate::headless::{headless_app, recording::Recorder};

/// How long a tick is.
pub const TICK: Duration = Duration::from_nanos(1_000_000_000 / 60);

/// What can be varied about a scene.
#[derive(Clone, Copy, Debug)]
pub struct Variation {
    /// How contacts are detected.
    pub method: ContactMethod,
    /// Settings of the detection, its threads among them.
    pub detection: CircumsphereSettings,
    /// Settings of the response.
    pub response: XpbdSettings,
}

impl Default for Variation {
    fn default() -> Self {
        let detection = CircumsphereSettings { threads: 1, ..CircumsphereSettings::default() };
        Self { method: ContactMethod::default(), detection, response: XpbdSettings::default() }
    }
}

/// A scene that is being played.
pub struct Stage {
    /// The world.
    pub app: App,
    /// Everything that moves by physics.
    pub bodies: Vec<Entity>,
    method: ContactMethod,
}

impl Stage {
    /// An empty scene, that `recorder` records.
    pub fn new(variation: &Variation, recorder: Recorder) -> Self {
        let plugins = DeformableCollisionPlugins::new(Update).build().add(XpbdResponsePlugin::new(Update));
        let mut app = headless_app(plugins, variation.detection, recorder);
        app.insert_resource(variation.response);
        Self { app, bodies: Vec::new(), method: variation.method }
    }

    /// Adds a surface that physics does not move.
    pub fn add_obstacle(&mut self, mesh: &Mesh, extra: impl Bundle) -> Entity {
        let (surface, positions) = surface_of(mesh);
        self.app.world_mut().spawn((surface, positions, self.method, extra)).id()
    }

    /// Adds a body.
    pub fn add_body(
        &mut self,
        mesh: &Mesh,
        material: XpbdMaterial,
        change: impl FnOnce(XpbdBody) -> XpbdBody,
        extra: impl Bundle,
    ) -> Entity {
        let (surface, positions) = surface_of(mesh);
        let body = XpbdBody::new(&surface, &positions, material).expect("the meshes of scenes are sound");
        let entity = self.app.world_mut().spawn((surface, positions, change(body), self.method, extra)).id();
        self.bodies.push(entity);
        entity
    }

    /// Plays one tick.
    pub fn tick(&mut self) {
        self.app.world_mut().resource_mut::<Time>().advance_by(TICK);
        self.app.update();
    }

    /// Where a surface is.
    pub fn positions(&self, entity: Entity) -> &[Vec3] {
        &self.app.world().get::<SurfacePositions>(entity).expect("the scene's surfaces stay").0
    }
}

fn surface_of(mesh: &Mesh) -> (DeformableSurface, SurfacePositions) {
    let positions: Vec<Vec3> = mesh.positions.iter().map(|&position| Vec3::from(position)).collect();
    DeformableSurface::from_mesh(&positions, &mesh.triangles).expect("the meshes of scenes are sound")
}
