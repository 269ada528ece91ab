//! How far around bodies contacts are looked for.

use core::mem;

use bevy_ecs::prelude::*;
use bevy_time::Time;
use glam::Vec3;

use super::{body::XpbdBody, gather::Watch, motion::Motions, respond::Response, settings::XpbdSettings, sleep::Sleep};
use crate::surface::{ActiveSurface, ActiveSurfaces, DeformableSurface, SurfaceShape, SweptCollision};

/// Smallest and largest margin of a body, in mean edges of the finest body: wider ones cost more than they save.
const LEAST_MARGIN: f32 = 1.0 / 32.0;
const MOST_MARGIN: f32 = 0.5;

/// Largest margin of a swept body. The guard finds what it has missed: with the wide one a garment on a walking character
/// takes 1.25 times as long.
const MOST_MARGIN_SWEPT: f32 = 0.25;

/// The margin of a body, in root mean squares of the ways of its vertices in a tick. Some are faster than the others, and
/// what they meet may be as fast.
const HASTE: f32 = 2.0;

/// The next wider margin relative to the last, and the number of ticks for which one may stay wider than needed. A change
/// discards the lists of near pairs, but pairs that are not near cost more: by steps of 2 and after 8 ticks, scenes in motion
/// took up to a fifth longer.
const STEP: f32 = 1.19;
const WIDE_TICKS: u32 = 3;

/// Gives each body margins for its expected motion in this tick, so that anything that may touch during the tick is
/// detected at its beginning. Whatever is no body gets the widest of these.
pub(super) fn choose_margins(
    time: Option<Res<Time>>,
    settings: Res<XpbdSettings>,
    mut active: ResMut<ActiveSurfaces>,
    (motions, sleep): (Res<Motions>, Res<Sleep>),
    bodies: Query<(&DeformableSurface, &XpbdBody, Has<SweptCollision>)>,
    mut response: ResMut<Response>,
) {
    let Some(time) = time else { return };
    let Response { margins, fall, .. } = &mut *response;
    let duration = time.delta_secs() / motions.parts() as f32;
    // Twice that, so at least as far, however few substeps there are.
    *fall = settings.in_range().gravity.length() * duration * duration;
    let awake = |entity| bodies.get(entity).ok().filter(|_| !sleep.is_asleep(entity));
    let edge = |mesh: &DeformableSurface, surface: &ActiveSurface| mesh.mean_edge() * surface.pose.scale() as f32;
    let edges = active.surfaces.iter().filter_map(|surface| Some(edge(awake(surface.entity)?.0, surface)));
    let finest = edges.fold(f32::INFINITY, f32::min);
    if !(finest.is_finite() && finest > 0.0) {
        return;
    }
    let mut widest = 0.0_f32;
    for surface in &mut active.surfaces {
        let Some((_, body, is_swept)) = awake(surface.entity) else { continue };
        let [own, speed] = speeds(body);
        let is_smooth = surface.shape == SurfaceShape::Smooth;
        let slack = Watch::slack(f64::from(*fall), f64::from(surface.thickness), is_smooth) as f32;
        // What it meets may move as fast.
        let other = HASTE * speed * duration + slack + motions.longest() as f32;
        let margin = margins.entry(surface.entity).or_default();
        margin.is_used = true;
        let most = if is_swept { MOST_MARGIN_SWEPT } else { MOST_MARGIN };
        surface.solver_margins =
            [margin.own.choose(HASTE * own * duration, finest, most), margin.other.choose(other, finest, most)];
        widest = widest.max(surface.solver_margins[1]);
    }
    margins.retain(|_, margin| mem::take(&mut margin.is_used));
    let others = active.surfaces.iter_mut().filter(|surface| !margins.contains_key(&surface.entity));
    others.for_each(|surface| surface.solver_margins = [0.0, widest]);
    active.shapes.iter_mut().for_each(|shape| shape.solver_margin = widest);
}

/// Root mean squares of the velocities of a body's vertices, relative to the mean velocity, and in the world.
fn speeds(body: &XpbdBody) -> [f32; 2] {
    let (mut count, mut sum, mut squares) = (0_usize, Vec3::ZERO, 0.0);
    for (velocity, _) in body.free_vertices() {
        count += 1;
        sum += velocity;
        squares += velocity.length_squared();
    }
    let share = 1.0 / count.max(1) as f32;
    let squared = squares * share;
    let relative = (squared - (sum * share).length_squared()).max(0.0);
    [relative.sqrt(), squared.sqrt()]
}

/// The margins of a body, against itself and against others.
#[derive(Clone, Default)]
pub(super) struct BodyMargins {
    own: Margin,
    other: Margin,
    /// Whether the body takes part in this tick.
    is_used: bool,
}

/// A margin, in steps.
#[derive(Clone, Default)]
struct Margin {
    /// In world units. 0 before the first tick.
    width: f32,
    /// Number of consecutive ticks in which it was wider than needed.
    too_wide: u32,
}

impl Margin {
    /// The margin of a tick in which the body moves by about `way`, at most `most` edges of the finest body. It stays too
    /// wide for a while: a change discards the lists of near pairs.
    fn choose(&mut self, way: f32, finest: f32, most: f32) -> f32 {
        let mut width = LEAST_MARGIN * finest;
        while width < way.min(most * finest) {
            width *= STEP;
        }
        self.too_wide = if width < self.width { self.too_wide + 1 } else { 0 };
        if !(1..=WIDE_TICKS).contains(&self.too_wide) {
            self.width = width;
        }
        self.width
    }
}
