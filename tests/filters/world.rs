//! Headless worlds with detection, or with detection and response.

use std::time::Duration;

use bevy_app::prelude::*;
use bevy_circumsphere::{
    prelude::*,
    response::{XpbdBody, XpbdMaterial, XpbdResponsePlugin, XpbdSettings},
};
use bevy_ecs::prelude::*;
use bevy_time::Time;
use circumsphere_support::scenes::{Diagonals, Mesh, grid};
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

    /// A square of a meter, half a meter up, that falls at 60 m/s without gravity and drag, and is swept.
    pub fn shoot_down(&mut self, extra: impl Bundle) -> Entity {
        self.app.world_mut().resource_mut::<XpbdSettings>().gravity = Vec3::ZERO;
        let (surface, positions) = surface(&grid(1, 1, 1.0, 1.0, Diagonals::Uniform).translate([0.1, 0.5, 0.2]));
        let material = XpbdMaterial { drag: 0.0, ..XpbdMaterial::CLOTH };
        let mut body = XpbdBody::new(&surface, &positions, material).expect("the mesh can be a body");
        body.velocities.fill(Vec3::NEG_Y * 60.0);
        self.app.world_mut().spawn((surface, positions, body, SweptCollision, extra)).id()
    }

    /// The height of the first vertex of a surface.
    pub fn height(&self, entity: Entity) -> f32 {
        self.app.world().get::<SurfacePositions>(entity).expect("it is a surface").0[0].y
    }

    /// A tick of a sixtieth of a second.
    pub fn tick(&mut self) {
        self.app.world_mut().resource_mut::<Time>().advance_by(Duration::from_micros(16_667));
        self.app.update();
    }
}
