//! Response: an optional stage that moves bodies and resolves contacts with extended position-based dynamics (XPBD).
//!
//! It reads the contacts of the tick and writes positions and velocities at its end. It is not a physics engine: it
//! does just enough for cloth and soft bodies to work out of the box. A game with its own solver leaves the plugin out
//! and reads the same contacts.
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
//! No vertex and no edge of an [`XpbdBody`] with [`SweptCollision`](crate::SweptCollision) passes through anything that
//! its [`SurfaceLayers`](crate::SurfaceLayers) let it collide with, at any speed, while a way is left for it:
//!
//! | the body against | |
//! |---|---|
//! | another body | guarded if at least one of the two has `SweptCollision` |
//! | itself | guarded with [`SelfCollision`](crate::SelfCollision); triangles that share a vertex are not tested |
//! | a surface without [`XpbdBody`]: static, animated, skinned, or moved by its transform | guarded |
//! | a [`RigidShape`](crate::RigidShape) of any kind, static or moved | guarded; a cylinder or cone as an inscribed solid of 256 sides, and the gap between that and its true surface is left to contacts |
//!
//! What it does not cover:
//!
//! - Anything that touches, crosses, or is inside when a tick begins. A body inside a solid is depenetrated in one
//!   direction: the shortest of 27 that lead to a place with room between all static and kinematic objects. Where two
//!   sheets cross, the smaller part that is cut off moves back. If no part is cut off, or if a body crosses itself, the
//!   intersection contour is shortened until it vanishes.
//! - If two kinematic objects squeeze a body so that no way is left, it may be inside one of them or cross itself. A
//!   body thrown at a wall at 20 m/s or more may also cross itself for some ticks.
//!   [`XpbdDiagnostics::impacts_remaining`], [`XpbdDiagnostics::jammed`], and [`XpbdDiagnostics::inside`] report these
//!   cases. The log warns once per episode when impacts remain or a body is jammed.
//! - Two bodies without `SweptCollision`, or one such body and a static or kinematic object: only contacts stop them.
//!   The log warns once if such a body moves farther than its thickness between two detections.
//! - Kinematic objects against each other: they pass through each other.
//! - A body that cannot be solved ([`XpbdDiagnostics::refused`]): it is not moved and counts as static.
//!
//! # What the game moves
//!
//! Animated surfaces, rigid shapes, and pinned vertices are kinematic: the game moves them and the solver does not.
//! While the solver steps, they move from where the last tick left them to where the game has written them now. If a
//! surface or shape near a body moves farther than the body's mean edge, relative to the body, the tick is split into
//! up to 8 parts ([`XpbdDiagnostics::parts`]), each with its own detection. Within a part, vertices move in straight
//! lines. So contacts that are read after the tick, and their messages, describe the beginning of its last part, for
//! both sides. Insert [`Teleported`](crate::Teleported) on anything that should jump instead. Motion written during a
//! tick of zero duration takes place in the next tick.
//!
//! A rigid shape with a [`RigidMass`] begins where the last tick left it and heads for where the game has written it, but
//! gives way to what is in its way. The game applies the [`RigidPush`] of the tick to it.
//!
//! If the `Transform` of a body or of one of its parents moves, the body keeps its place in the world, because it has
//! inertia. Its pinned vertices move with the transform. Insert [`Teleported`](crate::Teleported) to move the whole
//! body. Pins and targets of tethers that jump take the body along: see [`XpbdDiagnostics::carried`].
//!
//! # Another solver
//!
//! Another solver reads the contacts of the tick as they are. Each contact has a flat stencil: the gradient of its
//! separation with respect to every vertex that it acts on. The vertices of rigid shapes are not in it. One pass of the
//! simplest possible solver, which works on positions alone:
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

mod anchors;
mod body;
mod contact;
mod error;
mod forces;
#[cfg(feature = "mesh")]
mod garment;
mod gather;
mod guard;
mod history;
#[cfg(feature = "serde")]
mod infinite;
mod inside;
mod known;
mod margins;
mod material;
mod meeting;
mod motion;
mod particles;
mod reaction;
mod record;
mod respond;
mod rest;
mod rigid_body;
mod scene;
#[cfg(feature = "serde")]
mod serialized;
mod settings;
mod sleep;
mod solver;
mod tethers;
mod thick;
mod untangle;

use bevy_app::prelude::*;
use bevy_ecs::{
    prelude::*,
    schedule::{InternedScheduleLabel, ScheduleLabel},
};
use bevy_time::Time;

use crate::{
    detection::ImpactsRead,
    schedule::{DeformableSystems, HostSchedule, run_detection},
    surface::ActiveSurfaces,
};
pub use body::{SurfaceFriction, XpbdBody};
pub use error::XpbdBodyError;
pub use forces::{SurfaceForces, SurfaceWind};
#[cfg(feature = "mesh")]
pub use garment::{GarmentPaint, XpbdGarment, XpbdGarmentError, XpbdGarmentNotWorn, XpbdGarments};
#[cfg(test)]
pub(crate) use history::PARTS as HISTORY_PARTS;
pub(crate) use history::ResponseHistory;
pub use material::XpbdMaterial;
pub use reaction::SurfaceReaction;
pub use respond::XpbdDiagnostics;
pub use rigid_body::{RigidMass, RigidPart, RigidPush};
pub use settings::XpbdSettings;
pub use tethers::{Tether, TetherTarget, XpbdTethers};

/// Moves every [`XpbdBody`] and resolves its contacts. It needs
/// [`DeformableCollisionPlugins`](crate::DeformableCollisionPlugins) in the same schedule, and a `Time` resource that
/// says how long a tick is.
///
/// Contacts of bodies are reported before they touch, within a margin that follows the motion of each body, or within
/// [`CircumsphereSettings::margin`](field@crate::CircumsphereSettings::margin) if that is wider.
pub struct XpbdResponsePlugin {
    schedule: InternedScheduleLabel,
}

impl XpbdResponsePlugin {
    /// Responds in `schedule`, which must be the schedule in which contacts are detected.
    #[must_use]
    pub fn new(schedule: impl ScheduleLabel) -> Self {
        Self { schedule: schedule.intern() }
    }
}

impl Default for XpbdResponsePlugin {
    /// Runs in [`FixedPostUpdate`], the default schedule of detection.
    fn default() -> Self {
        Self::new(FixedPostUpdate)
    }
}

impl Plugin for XpbdResponsePlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<XpbdSettings>()
            .init_resource::<XpbdDiagnostics>()
            .init_resource::<respond::Response>()
            .init_resource::<motion::Motions>()
            .init_resource::<sleep::Sleep>();
        // The guard sweeps bodies by itself.
        app.init_resource::<ImpactsRead>();
        #[cfg(feature = "mesh")]
        garment::build(app, self.schedule);
        app.add_systems(
            self.schedule,
            (
                (
                    sleep::wake_changed,
                    motion::begin,
                    tethers::aim_tethers,
                    motion::carry,
                    motion::plan,
                    margins::choose_margins,
                    respond::aim,
                )
                    .chain()
                    .in_set(DeformableSystems::Predict),
                motion::rewind.in_set(DeformableSystems::Detect).before(run_detection),
                motion::restore.in_set(DeformableSystems::Detect).after(run_detection),
                respond::respond_in_parts.in_set(DeformableSystems::Respond),
                (respond::write_back, sleep::settle).chain().in_set(DeformableSystems::Writeback),
            )
                .distributive_run_if(resource_exists::<ActiveSurfaces>),
        );
    }

    fn finish(&self, app: &mut App) {
        match app.world().get_resource::<HostSchedule>() {
            None => log::warn!("bodies do not move without DeformableCollisionPlugins: add it to the same schedule"),
            Some(HostSchedule(detection)) if *detection != self.schedule => log::warn!(
                "bodies are moved in {:?}, but contacts are detected in {detection:?}: give XpbdResponsePlugin and \
                 DeformableCollisionPlugins the same schedule",
                self.schedule
            ),
            Some(_) => {}
        }
        if !app.world().contains_resource::<Time>() {
            log::warn!("bodies do not move without a clock: add TimePlugin, or a Time resource that you advance");
        }
    }
}
