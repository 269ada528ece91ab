//! What the response remembers from tick to tick and its results depend on, for games that go back in time.

use bevy_ecs::{entity::EntityHashMap, prelude::*};

use super::{inside::Insides, margins::BodyMargins, motion::Motions, respond::Response, sleep::Sleep};

/// The history of the response, empty before its first tick.
#[derive(Clone, Default)]
pub(crate) struct ResponseHistory {
    motions: Motions,
    sleep: Sleep,
    margins: EntityHashMap<BodyMargins>,
    insides: Insides,
}

impl ResponseHistory {
    /// Empty if there is no response.
    pub(crate) fn of(world: &World) -> Self {
        let Some(response) = world.get_resource::<Response>() else { return Self::default() };
        Self {
            motions: world.get_resource().map(Motions::remembered).unwrap_or_default(),
            sleep: world.get_resource().cloned().unwrap_or_default(),
            margins: response.margins.clone(),
            insides: response.gatherer.insides.remembered(),
        }
    }

    /// Makes the response go on from here.
    pub(crate) fn hand_out(&self, world: &mut World) {
        let Some(mut response) = world.get_resource_mut::<Response>() else { return };
        response.margins.clone_from(&self.margins);
        response.gatherer.insides.clone_from(&self.insides);
        world.insert_resource(self.motions.clone());
        world.insert_resource(self.sleep.clone());
    }
}

/// The parts, each with how a history takes it over from another: for the test that each is needed.
#[cfg(test)]
pub(crate) const PARTS: [(&str, fn(&mut ResponseHistory, &ResponseHistory)); 4] = [
    ("motions", |own, other| own.motions = other.motions.clone()),
    ("sleep", |own, other| own.sleep = other.sleep.clone()),
    ("margins", |own, other| own.margins = other.margins.clone()),
    ("ways out of solids", |own, other| own.insides = other.insides.clone()),
];
