//! A headless world with a response, ticked by hand.

use std::time::Duration;

use bevy_app::prelude::*;
use bevy_circumsphere::{prelude::*, response::*};
use bevy_ecs::prelude::*;
use bevy_time::Time;
use circumsphere_support::{random::Random, scenes::Mesh};
use glam::Vec3;

/// The length of a tick in seconds: a sixtieth of a second.
pub const TICK: f64 = 1.0 / 60.0;

/// The number of whole ticks in `seconds` at `rate` ticks per second.
pub fn ticks_in(seconds: f64, rate: f64) -> usize {
    (Duration::from_secs_f64(seconds).as_nanos() / Duration::from_secs_f64(1.0 / rate).as_nanos()) as usize
}

pub struct Scene {
    pub app: App,
}

impl Scene {
    pub fn new() -> Self {
        let mut app = App::new();
        app.add_plugins((DeformableCollisionPlugins::new(Update), XpbdResponsePlugin::new(Update)));
        app.init_resource::<Time>();
        app.finish();
        app.cleanup();
        app.world_mut().resource_mut::<CircumsphereSettings>().threads = 1;
        // Most tests measure how still the solver keeps bodies.
        app.world_mut().resource_mut::<XpbdSettings>().sleep_speed = 0.0;
        Self { app }
    }

    pub fn settings(&mut self) -> Mut<'_, XpbdSettings> {
        self.app.world_mut().resource_mut::<XpbdSettings>()
    }

    pub fn add(&mut self, mesh: &Mesh, material: XpbdMaterial, extra: impl Bundle) -> Entity {
        self.add_changed(mesh, material, |body| body, extra)
    }

    pub fn add_changed(
        &mut self,
        mesh: &Mesh,
        material: XpbdMaterial,
        change: impl FnOnce(XpbdBody) -> XpbdBody,
        extra: impl Bundle,
    ) -> Entity {
        let (surface, positions) = surface_of(mesh);
        let body = change(XpbdBody::new(&surface, &positions, material).unwrap());
        self.app.world_mut().spawn((surface, positions, body, extra)).id()
    }

    pub fn add_obstacle(&mut self, mesh: &Mesh, extra: impl Bundle) -> Entity {
        let (surface, positions) = surface_of(mesh);
        self.app.world_mut().spawn((surface, positions, extra)).id()
    }

    pub fn tick(&mut self, seconds: f64) {
        self.app.world_mut().resource_mut::<Time>().advance_by(Duration::from_secs_f64(seconds));
        self.app.update();
    }

    pub fn run(&mut self, ticks: usize) {
        (0..ticks).for_each(|_| self.tick(TICK));
    }

    pub fn positions(&self, entity: Entity) -> &[Vec3] {
        &self.app.world().get::<SurfacePositions>(entity).unwrap().0
    }

    pub fn body(&self, entity: Entity) -> &XpbdBody {
        self.app.world().get::<XpbdBody>(entity).unwrap()
    }

    /// The highest speed of a vertex in meters per second. It is NaN if the speed of any vertex is NaN.
    pub fn fastest(&self, entity: Entity) -> f32 {
        let speeds = self.body(entity).velocities.iter().map(|velocity| velocity.length());
        speeds.fold(0.0, |fastest, speed| if speed > fastest || speed.is_nan() { speed } else { fastest })
    }

    pub fn body_mut(&mut self, entity: Entity) -> Mut<'_, XpbdBody> {
        self.app.world_mut().get_mut::<XpbdBody>(entity).unwrap()
    }

    pub fn diagnostics(&self) -> &XpbdDiagnostics {
        self.app.world().resource::<XpbdDiagnostics>()
    }
}

pub fn surface_of(mesh: &Mesh) -> (DeformableSurface, SurfacePositions) {
    let positions: Vec<Vec3> = mesh.positions.iter().map(|&position| Vec3::from(position)).collect();
    DeformableSurface::from_mesh(&positions, &mesh.triangles).unwrap()
}

/// The mesh with separate vertices for every triangle, each displaced by up to `by`.
pub fn apart(mesh: &Mesh, by: f32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let mut random = Random::new(5);
    let mut corner = |vertex: u32| {
        let jitter = Vec3::from_array(std::array::from_fn(|_| random.signed_unit()));
        Vec3::from(mesh.positions[vertex as usize]) + by * jitter
    };
    let corners = mesh.triangles.iter().flat_map(|triangle| triangle.map(&mut corner)).collect();
    (corners, (0..mesh.triangles.len() as u32).map(|triangle| [0, 1, 2].map(|k| 3 * triangle + k)).collect())
}

/// A material without losses, for comparison with closed forms.
pub const LOSSLESS: XpbdMaterial = XpbdMaterial { drag: 0.0, damping: 0.0, ..XpbdMaterial::CLOTH };

pub fn mean(values: &[Vec3]) -> glam::DVec3 {
    values.iter().map(|value| value.as_dvec3()).sum::<glam::DVec3>() / values.len() as f64
}
