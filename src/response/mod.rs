//! Response: an optional stage that moves bodies and answers contacts, by extended position-based dynamics.
//!
//! Reads the contacts of the tick, writes positions and velocities at its end. It is no physics engine: enough that cloth and
//! soft bodies run out of the box. A game with a solver of its own leaves the plugin out and reads the same contacts.
//!
//! ```
//! use bevy_app::prelude::*;
//! use bevy_circumsphere::{prelude::*, response::*};
//! use bevy_time::{Time, prelude::*};
//! use glam::Vec3;
//! use std::time::Duration;
//!
//! let mut app = App::new();
//! app.add_plugins((DeformableCollisionPlugins::new(Update), XpbdResponsePlugin::new(Update))).init_resource::<Time>();
//! let corners = [Vec3::Y, Vec3::Y + Vec3::X, Vec3::Y + Vec3::Z];
//! let (surface, positions) = DeformableSurface::from_mesh(&corners, &[[0, 2, 1]])?;
//! let body = XpbdBody::new(&surface, &positions, XpbdMaterial::CLOTH)?;
//! let falling = app.world_mut().spawn((surface, positions, body)).id();
//! app.world_mut().spawn(RigidShape(SharedShape::halfspace(Vec3::Y)));
//! for _ in 0..120 {
//!     app.world_mut().resource_mut::<Time>().advance_by(Duration::from_millis(16));
//!     app.update();
//! }
//! let height = app.world().get::<SurfacePositions>(falling).unwrap().0[0].y;
//! assert!((0.0..0.1).contains(&height), "it lies on the ground");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # What is guaranteed
//!
//! No vertex and no edge of an [`XpbdBody`] with [`SweptCollision`](crate::SweptCollision) passes through what it meets by
//! [`SurfaceLayers`](crate::SurfaceLayers), at any speed, while a way is left for it:
//!
//! | the body against | |
//! |---|---|
//! | another body | guarded where at least one of the two has `SweptCollision` |
//! | itself | guarded with [`SelfCollision`](crate::SelfCollision); triangles that share a vertex are not tested |
//! | a surface without [`XpbdBody`], at rest, animated, skinned or moved by its transform | guarded |
//! | a [`RigidShape`](crate::RigidShape) of any kind, at rest or moved | guarded; a cylinder or cone as a solid of 256 sides in it, and what is between those and its surface is left to contacts |
//!
//! What it does not cover:
//!
//! - What touches, crosses or is inside when a tick begins. What is inside a solid is led out, all of it one way: the shortest of 27
//!   directions in which there is room between everything that no solver moves. Of sheets that cross, the smaller part that is cut
//!   off goes back; where none is, and where a body crosses itself, the curve of crossing is made shorter until it is gone.
//! - Where two driven things squeeze a body so that no way is left, it may be inside of one of them or cross itself. What is thrown
//!   at a wall at 20 m/s and more may cross itself, too, for some ticks.
//!   [`XpbdDiagnostics::impacts_remaining`], [`XpbdDiagnostics::jammed`] and [`XpbdDiagnostics::inside`] tell, and the log once an episode.
//! - What two bodies without `SweptCollision`, or one and something that stands, do to each other: contacts alone stop them. The
//!   log warns once where such a body moves farther than its thickness between two detections.
//! - What the game moves passes through other things that the game moves.
//! - A body that cannot be solved ([`XpbdDiagnostics::refused`]) is not moved, and counts as something that stands.
//!
//! # What the game moves
//!
//! Animated surfaces, rigid shapes and pinned vertices go from where the last tick left them to where the game has written them
//! now, while the solver steps. Surfaces and shapes that go farther near a body than half of its mean edge, as seen from the body,
//! cut the tick into up to 8 parts ([`XpbdDiagnostics::parts`]), with a detection each; within a part, vertices go straight. So
//! contacts that are read after the tick, and their messages, are those of the beginning of its last part, for both sides. Insert
//! [`Teleported`](crate::Teleported) where something is to jump. What moves in a tick of no duration goes its way in the next one.
//!
//! A body whose `Transform`, or that of a parent, moves keeps its place in the world, as it has inertia; pinned vertices go along.
//! Insert [`Teleported`](crate::Teleported) to move it as a whole.
//!
//! # Another solver
//!
//! Another solver reads the contacts of the tick as they are. Each has a flat stencil: how its separation grows with every
//! vertex that it acts on. Vertices of rigid shapes are not among them. One pass of the simplest solver there is, that of positions
//! alone:
//!
//! ```
//! use std::collections::HashMap;
//! use bevy_app::prelude::*;
//! use bevy_circumsphere::prelude::*;
//! use bevy_ecs::prelude::*;
//! use glam::Vec3;
//!
//! /// Moves the vertices of contacts apart by what is missing, each by its share.
//! fn part(contacts: SurfaceContacts, mut surfaces: Query<&mut SurfacePositions>) {
//!     let mut pushes: HashMap<(Entity, u32), (Vec3, f32)> = HashMap::new();
//!     for contact in contacts.iter().filter(|contact| contact.separation() < 0.0 && !contact.is_crossing()) {
//!         let stencil = contact.stencil();
//!         let squares: f32 = stencil.iter().map(|entry| entry.weight * entry.weight).sum();
//!         for entry in stencil {
//!             let push = entry.normal * (entry.weight * -contact.separation() / squares);
//!             let (sum, count) = pushes.entry((entry.entity, entry.vertex.0)).or_default();
//!             *sum += push;
//!             *count += 1.0;
//!         }
//!     }
//!     for ((entity, vertex), (sum, count)) in pushes {
//!         if let Ok(mut positions) = surfaces.get_mut(entity) {
//!             positions.0[vertex as usize] += sum / count;
//!         }
//!     }
//! }
//!
//! let mut app = App::new();
//! app.add_plugins(DeformableCollisionPlugins::new(Update));
//! app.add_systems(Update, part.in_set(DeformableSystems::Respond));
//! let sheet = [Vec3::ZERO, Vec3::X, Vec3::Z];
//! let thickness = SurfaceThickness::World(0.05);
//! let sheets = [0.0, 0.04].map(|height| {
//!     let corners = sheet.map(|corner| corner + Vec3::new(0.1, 1.0, 0.2) * height);
//!     let surface = DeformableSurface::from_mesh(&corners, &[[0, 2, 1]]).unwrap();
//!     app.world_mut().spawn((surface, thickness)).id()
//! });
//! (0..30).for_each(|_| app.update());
//! let height = |sheet: Entity| app.world().get::<SurfacePositions>(sheet).unwrap().0[0].y;
//! assert!(height(sheets[1]) - height(sheets[0]) > 0.08, "they were 0.04 apart and have to be 0.1");
//! ```

mod body;
mod constraints;
mod contact;
mod features;
mod gather;
mod guard;
mod inside;
mod motion;
mod particles;
mod record;
mod respond;
mod settings;
mod solver;
mod untangle;

use bevy_app::prelude::*;
use bevy_ecs::{
    prelude::*,
    schedule::{InternedScheduleLabel, ScheduleLabel},
};
use bevy_time::Time;

pub use body::{SurfaceFriction, XpbdBody, XpbdBodyError, XpbdMaterial};
pub use respond::XpbdDiagnostics;
pub use settings::XpbdSettings;

use crate::{
    schedule::{DeformableSystems, run_detection},
    surface::SurfacePlugin,
};

/// Moves every [`XpbdBody`] and answers its contacts. Needs [`DeformableCollisionPlugins`](crate::DeformableCollisionPlugins)
/// in the same schedule, and a clock: the `Time` resource tells how long a tick is.
///
/// While the game leaves [`CircumsphereSettings::margin`](field@crate::CircumsphereSettings::margin) at 0, the margin follows what
/// the bodies move by in a tick.
pub struct XpbdResponsePlugin {
    schedule: InternedScheduleLabel,
}

impl XpbdResponsePlugin {
    /// Responds in `schedule`, the one that contacts are detected in.
    #[must_use]
    pub fn new(schedule: impl ScheduleLabel) -> Self {
        Self { schedule: schedule.intern() }
    }
}

impl Default for XpbdResponsePlugin {
    /// In [`FixedPostUpdate`], as detection is by default.
    fn default() -> Self {
        Self::new(FixedPostUpdate)
    }
}

impl Plugin for XpbdResponsePlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<XpbdSettings>()
            .init_resource::<XpbdDiagnostics>()
            .init_resource::<respond::Response>()
            .init_resource::<motion::Motions>();
        app.add_systems(
            self.schedule,
            (
                (motion::begin, respond::choose_margin, respond::aim).chain().in_set(DeformableSystems::Predict),
                motion::rewind.in_set(DeformableSystems::Detect).before(run_detection),
                motion::restore.in_set(DeformableSystems::Detect).after(run_detection),
                respond::respond_in_parts.in_set(DeformableSystems::Respond),
                respond::write_back.in_set(DeformableSystems::Writeback),
            ),
        );
    }

    fn finish(&self, app: &mut App) {
        if !app.is_plugin_added::<SurfacePlugin>() {
            log::warn!("bodies meet nothing without DeformableCollisionPlugins: add them to the same schedule");
        }
        if !app.world().contains_resource::<Time>() {
            log::warn!("bodies stand still without a clock: add TimePlugin, or a Time resource that you advance");
        }
    }
}
