//! The game without a window: plugins, their order, and the clock.

use std::time::Duration;

use avian3d::prelude::*;
use bevy::{
    app::AnimationSystems,
    prelude::*,
    time::{TimeUpdateStrategy, Virtual},
};
use bevy_circumsphere::{
    prelude::*,
    response::{XpbdBody, XpbdResponsePlugin},
};
use circumsphere_interop::avian::AvianSurfacesPlugin;

use crate::{balls, character, flag, level};

/// Ticks per second of a game whose clock does not follow the real time.
pub const RATE: u32 = 60;

/// The longest tick, in seconds. On a machine that cannot keep up, the game is slower instead of coarser.
const LONGEST_TICK: f32 = 1.0 / 45.0;

/// The kind of a thing, by which the window draws it.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Look {
    Ground,
    Stone,
    Pole,
    Flag,
    Ball(usize),
}

/// How the clock goes once all that moves is there. Until then it stands still.
#[derive(Resource, Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pace {
    /// With the real time.
    #[cfg_attr(not(feature = "window"), expect(dead_code, reason = "only a window follows the clock"))]
    Real,
    /// A tick of the same length in every update.
    Even,
}

/// The game. It runs in `PostUpdate`, after Bevy's animations, where a game in which characters wear cloth would run it.
pub struct GamePlugin(pub Pace);

impl Plugin for GamePlugin {
    fn build(&self, app: &mut App) {
        app.add_plugins((PhysicsPlugins::new(PostUpdate), AvianSurfacesPlugin::new(PostUpdate)))
            .add_plugins((DeformableCollisionPlugins::new(PostUpdate), XpbdResponsePlugin::new(PostUpdate)))
            .configure_sets(PostUpdate, DeformableSystems::Prepare.after(AnimationSystems))
            .add_plugins((level::plugin, character::plugin, flag::plugin, balls::plugin))
            .insert_resource(TimeUpdateStrategy::ManualDuration(Duration::ZERO))
            .insert_resource(self.0)
            .init_resource::<Ready>()
            .add_systems(First, start_clock.run_if(|ready: Res<Ready>| !ready.0));
    }
}

/// Whether the cape and the flag are bodies.
#[derive(Resource, Default)]
pub struct Ready(pub bool);

fn start_clock(
    mut ready: ResMut<Ready>,
    mut strategy: ResMut<TimeUpdateStrategy>,
    mut time: ResMut<Time<Virtual>>,
    pace: Res<Pace>,
    bodies: Query<(), With<XpbdBody>>,
) {
    if bodies.iter().count() < 2 {
        return;
    }
    ready.0 = true;
    time.set_max_delta(Duration::from_secs_f32(LONGEST_TICK));
    *strategy = match *pace {
        Pace::Real => TimeUpdateStrategy::Automatic,
        Pace::Even => TimeUpdateStrategy::ManualDuration(Duration::from_secs(1) / RATE),
    };
}
