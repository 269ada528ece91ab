//! Which bodies sleep, and what they were like when they fell asleep.

use std::{
    fmt::Debug,
    hash::{DefaultHasher, Hash, Hasher},
};

use bevy_ecs::{change_detection::Tick, entity::EntityHashMap, prelude::*, query::QueryData};
use bytemuck::cast_slice;
use glam::DVec3;

use crate::{
    kernel::pose::Pose,
    response::{
        body::{SurfaceFriction, XpbdBody},
        forces::{SurfaceForces, SurfaceWind},
        settings::XpbdSettings,
        tethers::XpbdTethers,
    },
    surface::{ActiveSurface, SurfaceLayers, SurfacePositions},
};

/// How long all bodies of an island have to stay where they are before it falls asleep, in seconds: longer than a
/// pendulum lingers where it turns back.
pub(super) const CALM_TIME: f64 = 0.5;

/// Everything whose change wakes a body.
#[derive(QueryData)]
pub(in crate::response) struct Watched {
    positions: Ref<'static, SurfacePositions>,
    body: Ref<'static, XpbdBody>,
    forces: Option<Ref<'static, SurfaceForces>>,
    wind: Option<Ref<'static, SurfaceWind>>,
    pub(super) tethers: Option<Ref<'static, XpbdTethers>>,
    friction: Option<Ref<'static, SurfaceFriction>>,
}

/// The state of a body when it fell asleep.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Seen {
    /// The last changes of what is [`Watched`].
    changes: [Option<Tick>; 6],
    pose: Pose,
    thickness: f32,
    layers: SurfaceLayers,
}

impl Seen {
    pub(super) fn new(surface: &ActiveSurface, item: &WatchedItem<'_, '_>) -> Self {
        let WatchedItem { positions, body, forces, wind, tethers, friction } = item;
        let changes = [
            Some(positions.last_changed()),
            Some(body.last_changed()),
            forces.as_ref().map(Ref::last_changed),
            wind.as_ref().map(Ref::last_changed),
            tethers.as_ref().map(Ref::last_changed),
            friction.as_ref().map(Ref::last_changed),
        ];
        Self { changes, pose: surface.pose, thickness: surface.thickness, layers: surface.layers }
    }
}

impl Asleep {
    /// Whether nothing about the body has changed since it fell asleep. Values that were written once more have not.
    pub(super) fn is_undisturbed(&mut self, surface: &ActiveSurface, item: &WatchedItem<'_, '_>) -> bool {
        let now = Seen::new(surface, item);
        let is_only_written =
            || Seen { changes: self.seen.changes, ..now } == self.seen && item.values() == self.values;
        if now != self.seen && !is_only_written() {
            return false;
        }
        self.seen = now;
        true
    }
}

impl WatchedItem<'_, '_> {
    /// A hash of all values.
    pub(super) fn values(&self) -> u64 {
        let Self { positions, body, forces, wind, tethers, friction } = self;
        let mut hasher = DefaultHasher::new();
        hasher.write(cast_slice(&positions.0));
        hasher.write(cast_slice(&body.velocities));
        hasher.write(cast_slice(&body.inverse_masses));
        hash_text(&body.material, &mut hasher);
        for values in forces.iter().map(|forces| &forces.0) {
            hasher.write(cast_slice(values));
        }
        hash_text(&wind.as_deref(), &mut hasher);
        hash_text(&tethers.as_ref().map(|tethers| &tethers.tethers), &mut hasher);
        hash_text(&friction.as_deref(), &mut hasher);
        hasher.finish()
    }
}

/// Hashes the debug text of a few values, which has each float to the last bit.
fn hash_text(values: &impl Debug, hasher: &mut DefaultHasher) {
    format!("{values:?}").hash(hasher);
}

/// A body that sleeps.
#[derive(Clone, Debug)]
pub(super) struct Asleep {
    /// The number of its island.
    pub(super) island: u32,
    pub(super) seen: Seen,
    /// A hash of the values of what is [`Watched`]. Where it was written, this tells whether it has changed.
    pub(super) values: u64,
    /// What it touched, which keeps it where it is.
    pub(super) holders: Vec<Entity>,
    /// The number of tethers that held it.
    pub(super) tethers: usize,
}

/// How long a body has stayed where it is.
#[derive(Clone, Debug, Default)]
pub(super) struct Calm {
    /// Where its vertices were when that time began.
    places: Vec<DVec3>,
    /// In seconds.
    pub(super) time: f64,
}

/// Which bodies sleep, and how long the others have been calm.
#[derive(Resource, Clone, Debug, Default)]
pub(in crate::response) struct Sleep {
    pub(super) asleep: EntityHashMap<Asleep>,
    pub(super) calm: EntityHashMap<Calm>,
    /// The settings of the last tick.
    pub(super) settings: XpbdSettings,
    pub(super) islands: u32,
}

impl Sleep {
    pub(in crate::response) fn is_asleep(&self, body: Entity) -> bool {
        !self.asleep.is_empty() && self.asleep.contains_key(&body)
    }

    pub(in crate::response) fn count(&self) -> usize {
        self.asleep.len()
    }

    /// Follows the vertices of a body through a tick that lasts `duration` seconds. Bodies that tremble stay where they
    /// are, bodies that creep do not.
    pub(in crate::response) fn follow(&mut self, body: Entity, vertices: &[DVec3], duration: f64) {
        let most = f64::from(self.settings.in_range().sleep_speed) * CALM_TIME;
        let calm = self.calm.entry(body).or_default();
        let is_near = |(before, now): (&DVec3, &DVec3)| before.distance_squared(*now) < most * most;
        if calm.places.len() == vertices.len() && calm.places.iter().zip(vertices).all(is_near) {
            calm.time += duration;
        } else {
            calm.places.clear();
            calm.places.extend_from_slice(vertices);
            calm.time = 0.0;
        }
    }

    pub(super) fn wake(&mut self, islands: &[u32]) {
        if !islands.is_empty() {
            self.asleep.retain(|_, asleep| !islands.contains(&asleep.island));
        }
    }
}
