//! Measures of a running scene.

use bevy_circumsphere::{ContactStore, prelude::*, response::*};
use bevy_ecs::prelude::*;
use glam::Vec3;

use super::Stage;

/// Follows the motion of some bodies.
#[derive(Default)]
pub struct Motion {
    last: Vec<Vec<Vec3>>,
}

/// How far vertices went in one tick, in mean edges of their surface.
#[derive(Clone, Copy, Debug, Default)]
pub struct Way {
    /// On average over all vertices.
    pub mean: f64,
    /// The farthest.
    pub most: f64,
}

impl Motion {
    /// How far the vertices of the bodies have gone since the last call; 0 at the first.
    pub fn step(&mut self, stage: &Stage) -> Way {
        let (mut sum, mut most, mut count) = (0.0, 0.0_f64, 0usize);
        self.last.resize_with(stage.bodies.len(), Vec::new);
        for (&entity, last) in stage.bodies.iter().zip(&mut self.last) {
            let edge = stage.app.world().get::<DeformableSurface>(entity).map_or(1.0, DeformableSurface::mean_edge);
            let positions = stage.positions(entity);
            for (position, last) in positions.iter().zip(last.iter()) {
                let way = f64::from(position.distance(*last) / edge);
                sum += way;
                most = most.max(way);
                count += 1;
            }
            last.clear();
            last.extend_from_slice(positions);
        }
        Way { mean: if count > 0 { sum / count as f64 } else { 0.0 }, most }
    }
}

/// Energy of motion and of height of all bodies, in joules.
pub fn energy(stage: &Stage) -> f64 {
    let world = stage.app.world();
    let gravity = world.resource::<XpbdSettings>().gravity;
    let of_body = |&entity: &Entity| {
        let Some(body) = world.get::<XpbdBody>(entity) else { return 0.0 };
        let height = |(position, &inverse): (&Vec3, &f32)| {
            if inverse > 0.0 { -f64::from(gravity.dot(*position)) / f64::from(inverse) } else { 0.0 }
        };
        body.kinetic_energy() + stage.positions(entity).iter().zip(&body.inverse_masses).map(height).sum::<f64>()
    };
    stage.bodies.iter().map(of_body).sum()
}

/// How many contacts are crossings, edges that pierce a face.
pub fn crossings(stage: &Stage) -> usize {
    let store = stage.app.world().resource::<ContactStore>();
    store.contacts.iter().filter(|contact| contact.features.kind() == FeatureKind::EdgeFace).count()
}
