//! Headless worlds with detection, or with detection and response.

use std::time::Duration;

use bevy_app::prelude::*;
use bevy_circumsphere::{prelude::*, response::XpbdResponsePlugin};
use bevy_ecs::prelude::*;
use bevy_time::Time;
use circumsphere_support::scenes::Mesh;
use glam::Vec3;

pub fn surface(mesh: &Mesh) -> (DeformableSurface, SurfacePositions) {
    let positions: Vec<Vec3> = mesh.positions.iter().map(|&point| Vec3::from(point)).collect();
    DeformableSurface::from_mesh(&positions, &mesh.triangles).expect("the mesh is sound")
}

pub struct World {
    pub app: App,
}

impl World {
    pub fn detecting() -> Self {
        let mut app = App::new();
        app.add_plugins(DeformableCollisionPlugins::new(Update));
        Self { app }
    }

    pub fn responding() -> Self {
        let mut world = Self::detecting();
        world.app.add_plugins(XpbdResponsePlugin::new(Update)).init_resource::<Time>();
        world
    }

    pub fn spawn(&mut self, mesh: &Mesh, extra: impl Bundle) -> Entity {
        let surface = surface(mesh);
        self.app.world_mut().spawn((surface, extra)).id()
    }

    pub fn insert(&mut self, entity: Entity, extra: impl Bundle) {
        self.app.world_mut().entity_mut(entity).insert(extra);
    }

    /// A tick of a sixtieth of a second.
    pub fn tick(&mut self) {
        self.app.world_mut().resource_mut::<Time>().advance_by(Duration::from_micros(16_667));
        self.app.update();
    }
}
