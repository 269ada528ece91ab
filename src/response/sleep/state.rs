//! Which bodies sleep, and what they were like when they fell asleep.

use bevy_ecs::{change_detection::Tick, entity::EntityHashMap, prelude::*, query::QueryData};
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

/// A body that sleeps.
#[derive(Debug)]
pub(super) struct Asleep {
    /// The number of its island.
    pub(super) island: u32,
    pub(super) seen: Seen,
    /// What it was near, which keeps it where it is.
    pub(super) near: Vec<Entity>,
    /// The number of tethers that held it.
    pub(super) tethers: usize,
}

/// How long a body has stayed where it is.
#[derive(Debug, Default)]
pub(super) struct Calm {
    /// Where its vertices were when that time began.
    places: Vec<DVec3>,
    /// In seconds.
    pub(super) time: f64,
}

/// Which bodies sleep, and how long the others have been calm.
#[derive(Resource, Debug, Default)]
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
