//! Residual penetration of a scene, measured with the exact method, regardless of the method that played the scene.

use bevy_app::prelude::*;
use bevy_circumsphere::{CircumsphereSettings, prelude::*};
use bevy_ecs::system::SystemState;
use bevy_transform::components::Transform;
use circumsphere_examples::{
    headless::{detect, headless_app, recording::Recorder},
    scenes::{Stage, truth::vertices_inside},
};

/// Residual penetration.
#[derive(Clone, Copy, Debug, Default)]
pub struct Residual {
    /// Mean overlap of contacts that are closer than the contact distance, in contact distances. 0 without such
    /// contacts.
    pub depth: f64,
    /// Largest overlap, in contact distances.
    pub deepest: f64,
    /// Number of edges that pierce a face.
    pub crossings: usize,
    /// Number of body vertices inside another closed surface, by winding in f64.
    pub inside: usize,
}

impl Residual {
    /// Measures the scene in its current state.
    pub fn of(stage: &Stage) -> Self {
        let settings = CircumsphereSettings { threads: 1, ..CircumsphereSettings::default() };
        let mut app = headless_app(DeformableCollisionPlugins::new(Update).build(), settings, Recorder::default());
        let played = stage.app.world();
        for entity in stage.surfaces() {
            let surface = stage.surface(entity).clone();
            let positions = SurfacePositions(stage.positions(entity).to_vec());
            let copied = app.world_mut().spawn((surface, positions, ContactMethod::Exact)).id();
            let mut copied = app.world_mut().entity_mut(copied);
            copied.insert(played.get::<SurfaceThickness>(entity).copied().unwrap_or_default());
            copied.insert(played.get::<SurfaceLayers>(entity).copied().unwrap_or_default());
            copied.insert(played.get::<Transform>(entity).copied().unwrap_or_default());
            if played.get::<SelfCollision>(entity).is_some() {
                copied.insert(SelfCollision);
            }
        }
        detect(&mut app);
        let mut state: SystemState<SurfaceContacts> = SystemState::new(app.world_mut());
        let contacts = state.get(app.world()).expect("the plugins insert the contact store");
        let mut residual = Self { inside: vertices_inside(stage), ..Self::default() };
        let mut count = 0_usize;
        for contact in contacts.iter() {
            residual.crossings += usize::from(contact.is_crossing());
            let depth = -f64::from(contact.separation()) / f64::from(contact.contact_distance());
            if depth > 0.0 {
                residual.depth += depth;
                residual.deepest = residual.deepest.max(depth);
                count += 1;
            }
        }
        residual.depth /= count.max(1) as f64;
        residual
    }
}
