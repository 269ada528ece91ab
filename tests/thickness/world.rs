//! Surfaces with random thickness in headless apps, and their triangles in the world in f64.

use bevy_app::prelude::*;
use bevy_circumsphere::{
    ContactStore,
    detection::{
        BruteForceBroadPhasePlugin, HierarchicalSpatialHashBroadPhasePlugin, SpatialHashBroadPhasePlugin,
        TreeBroadPhasePlugin,
    },
    prelude::*,
};
use bevy_ecs::prelude::*;
use bevy_transform::components::Transform;
use circumsphere_support::{random::Random, scenes::Mesh};
use glam::Vec3;

use super::truth::Thick;

pub const EXACT_METHODS: [ContactMethod; 3] = [ContactMethod::Closest, ContactMethod::Exact, ContactMethod::Polygon];

/// One app for each broad phase, with its name.
pub fn apps() -> [(&'static str, App); 4] {
    fn app_with(broad_phase: impl Plugin) -> App {
        let mut app = App::new();
        let others = DeformableCollisionPlugins::new(Update).build().disable::<TreeBroadPhasePlugin>();
        app.add_plugins((others, broad_phase));
        app
    }
    [
        ("tree", app_with(TreeBroadPhasePlugin)),
        ("hash", app_with(SpatialHashBroadPhasePlugin::default())),
        ("hierarchical hash", app_with(HierarchicalSpatialHashBroadPhasePlugin::default())),
        ("brute force", app_with(BruteForceBroadPhasePlugin)),
    ]
}

pub fn app() -> App {
    let mut app = App::new();
    app.add_plugins(DeformableCollisionPlugins::new(Update));
    app
}

/// A mesh, the thickness at its vertices, and where it is.
#[derive(Clone)]
pub struct Body {
    pub mesh: Mesh,
    pub thickness: Vec<f32>,
    pub transform: Transform,
}

impl Body {
    /// Its thickness is drawn between 0 and a largest one.
    pub fn random(mesh: Mesh, largest: f32, transform: Transform, random: &mut Random) -> Self {
        let thickness = mesh.positions.iter().map(|_| random.unit() as f32 * largest).collect();
        Self { mesh, thickness, transform }
    }

    pub fn points(&self) -> Vec<Vec3> {
        self.mesh.positions.iter().copied().map(Vec3::from_array).collect()
    }

    pub fn spawn(&self, app: &mut App, extra: impl Bundle) -> Entity {
        let surface = DeformableSurface::from_mesh(&self.points(), &self.mesh.triangles).expect("the mesh is valid");
        let thickness = VertexThickness::new(self.thickness.iter().copied());
        app.world_mut().spawn((surface, thickness, self.transform, extra)).id()
    }

    /// Its triangles in the world.
    pub fn thick(&self) -> Vec<Thick> {
        let Transform { translation, rotation, scale } = self.transform;
        let scale = f64::from(scale.x);
        let rotation = rotation.as_dquat().normalize();
        let place = |vertex: u32| {
            let point = Vec3::from_array(self.mesh.positions[vertex as usize]).as_dvec3();
            rotation * (point * scale) + translation.as_dvec3()
        };
        let thickness = |vertex: u32| f64::from(self.thickness[vertex as usize]) * scale;
        let of = |triangle: &[u32; 3]| Thick { corners: triangle.map(place), thickness: triangle.map(thickness) };
        self.mesh.triangles.iter().map(of).collect()
    }
}

pub fn store(app: &App) -> &ContactStore {
    app.world().resource::<ContactStore>()
}

/// A vector whose coordinates are no larger than a size.
pub fn vector(random: &mut Random, size: f32) -> Vec3 {
    Vec3::from_array([0; 3].map(|_| random.signed_unit() * size))
}
