//! What spheres, and the curvature they follow, were made of, so that a surface at rest keeps them while others move.
//!
//! A part of a surface's spheres is as good as new where the surface has, in its own frame, the positions that it was made of,
//! and nobody but its stage has written to it since. Where somebody has, the stage makes it anew.

use bevy_ecs::{change_detection::Tick, entity::EntityHashMap, prelude::*};

use super::{
    broad_phase::{CandidateTrianglePairs, OtherSide, SurfacePair},
    curvature::TriangleCurvature,
    memory::{DetectionMemory, StageList},
    refit::{Circumspheres, EnclosingBalls, TriangleCones},
};
use crate::{
    settings::CircumsphereSettings,
    surface::{ActiveSurface, ActiveSurfaces, ContactMethod},
};

/// The components that the sphere stages write.
#[derive(Clone, Copy)]
pub(super) enum SpherePart {
    Curvature,
    Balls,
    Spheres,
    Cones,
}

/// What a part of a surface's spheres is made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SphereSource {
    /// The count of the surface's [`TriangleBounds`](super::TriangleBounds); `None` where its positions had been written
    /// to since: nobody can tell when that is so again.
    pub(super) computed: Option<u64>,
    /// The change tick of the curvature, where the part is made of that, too.
    pub(super) curvature: Option<Tick>,
}

/// What the parts of every surface's spheres were made of, and their change ticks as their stages left them.
#[derive(Default)]
pub(super) struct SphereMemory {
    settings: Option<CircumsphereSettings>,
    made: EntityHashMap<[Option<(SphereSource, Tick)>; 4]>,
}

/// What the sphere stages wrote to a surface.
type SphereComponents = (
    Ref<'static, TriangleCurvature>,
    Ref<'static, EnclosingBalls>,
    Ref<'static, Circumspheres>,
    Ref<'static, TriangleCones>,
);

impl SphereMemory {
    /// Nothing holds where other things are set, or nothing is to be kept.
    fn heed(&mut self, settings: &CircumsphereSettings) {
        if self.settings.replace(*settings) != Some(*settings) || !settings.memory {
            self.made.clear();
        }
    }

    /// Begins a detection: nothing holds of surfaces that are fresh. What is known of those that are gone is dropped before there is
    /// more of it than of others.
    pub(super) fn begin(&mut self, active: &ActiveSurfaces) {
        for surface in active.surfaces.iter().filter(|surface| surface.fresh) {
            self.made.remove(&surface.entity);
        }
        if self.made.len() > active.surfaces.len() {
            let mut made = std::mem::take(&mut self.made);
            let stay = |surface: &ActiveSurface| Some((surface.entity, made.remove(&surface.entity)?));
            self.made = active.surfaces.iter().filter_map(stay).collect();
        }
    }

    /// Whether a part that was changed last at `changed` is what its stage would make of `source`.
    pub(super) fn holds(&self, surface: Entity, part: SpherePart, source: SphereSource, changed: Tick) -> bool {
        source.computed.is_some() && self.of(surface, part) == Some((source, changed))
    }

    /// A stage has made a part.
    pub(super) fn seal(&mut self, surface: Entity, part: SpherePart, source: SphereSource, changed: Tick) {
        self.made.entry(surface).or_default()[part as usize] = Some((source, changed));
    }

    fn of(&self, surface: Entity, part: SpherePart) -> Option<(SphereSource, Tick)> {
        self.made.get(&surface).and_then(|parts| parts[part as usize])
    }

    /// Whether somebody else has written to what a method asks of a surface, or to what that was made of, given the change ticks
    /// of all parts.
    fn is_broken(&self, surface: Entity, method: ContactMethod, changed: [Tick; 4]) -> bool {
        let has_changed = |part: SpherePart, sealed: Tick| changed[part as usize] != sealed;
        let stays = |part| self.of(surface, part).is_some_and(|(_, sealed)| !has_changed(part, sealed));
        if method == ContactMethod::BoundingSphere {
            return !stays(SpherePart::Balls);
        }
        let of_curvature = self.of(surface, SpherePart::Spheres).and_then(|(source, _)| source.curvature);
        // Nobody has measured it where somebody else provides for curvature.
        let measured = self.of(surface, SpherePart::Curvature);
        let is_as_measured = measured.is_none_or(|(_, sealed)| !has_changed(SpherePart::Curvature, sealed));
        !(is_as_measured
            && of_curvature == Some(changed[SpherePart::Curvature as usize])
            && stays(SpherePart::Spheres)
            && stays(SpherePart::Cones))
    }
}

/// Forgets everything where somebody else has written to the spheres of a kept pair, or to what they are made from.
pub(super) fn check_spheres(
    active: Res<ActiveSurfaces>,
    candidates: Res<CandidateTrianglePairs>,
    settings: Res<CircumsphereSettings>,
    mut memory: ResMut<DetectionMemory>,
    components: Query<SphereComponents>,
) {
    memory.spheres.heed(&settings);
    memory.reads(StageList::Candidates, candidates.last_changed());
    let is_broken = |place: usize, method: ContactMethod| {
        let entity = active.surfaces[place].entity;
        components.get(entity).map_or(true, |(curvature, balls, spheres, cones)| {
            let changed =
                [curvature.last_changed(), balls.last_changed(), spheres.last_changed(), cones.last_changed()];
            memory.spheres.is_broken(entity, method, changed)
        })
    };
    let has_spheres = |pair: &SurfacePair| !pair.method.is_exact();
    let mut kept =
        candidates.pairs.iter().enumerate().filter(|(place, pair)| memory.keeps(*place) && has_spheres(pair));
    let broken = kept.any(|(_, pair)| match pair.second {
        OtherSide::Surface(second) => is_broken(pair.first, pair.method) || is_broken(second, pair.method),
        OtherSide::Shape(_) => false,
    });
    if broken {
        memory.forget();
    }
}
