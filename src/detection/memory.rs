//! What an unchanged pair of surfaces keeps from the last detection: its candidates, what the stages made of them, and
//! its contacts.
//!
//! A pair is kept where both sides are, bit by bit, what they were. Nothing but the stages can write what they hand on, so
//! versions of positions decide alone.

use std::sync::Arc;

use bevy_ecs::prelude::*;

use super::{
    broad_phase::{CandidateTrianglePairs, OtherSide, surfaces_with_method},
    state::SurfaceState,
};
use crate::{
    kernel::capacity,
    settings::CircumsphereSettings,
    surface::{ActiveShape, ActiveSurface, ActiveSurfaces, ContactMethod},
};

/// What is known of the last detection, and which pairs of this one are kept from it.
#[derive(Resource, Default)]
pub(crate) struct DetectionMemory {
    /// The surfaces of the last detection that began, and the version of each.
    surfaces: Vec<(ActiveSurface, u64)>,
    shapes: Vec<ActiveShape>,
    settings: Option<CircumsphereSettings>,
    /// For each surface and each shape of this detection its place in the last one, where nothing about it has changed.
    unchanged: [Vec<Option<u32>>; 2],
    /// The same wherever it was there, whatever has changed about it.
    former: [Vec<Option<u32>>; 2],
    /// For each pair of this detection its place in the last one, where it is kept.
    origins: Vec<Option<u32>>,
    /// The same of each pair that was there, kept or not: its lists are in that place, and serve it again.
    former_places: Vec<Option<u32>>,
    /// How many pairs the last detection had.
    last_count: usize,
    /// Whether every pair is kept, each at its place.
    all_kept: bool,
    /// Counts changes of the settings.
    settings_version: u64,
}

impl DetectionMemory {
    /// Begins a detection: finds out which surfaces and shapes have not changed since the last one, and remembers them all.
    pub(super) fn begin(&mut self, active: &ActiveSurfaces, settings: &CircumsphereSettings, states: &[SurfaceState]) {
        let are_settings_same = self.settings.replace(*settings) == Some(*settings);
        self.settings_version += u64::from(!are_settings_same);
        let keeps = settings.memory && are_settings_same;
        let Self {
            surfaces: last_surfaces,
            shapes: last_shapes,
            unchanged: [surfaces, shapes],
            former: [former_surfaces, former_shapes],
            ..
        } = &mut *self;
        former_surfaces.clear();
        former_surfaces.extend(active.surfaces.iter().map(|surface| {
            let place = last_surfaces.binary_search_by_key(&surface.order, |(last, _)| last.order).ok()?;
            (surface.entity == last_surfaces[place].0.entity).then_some(place as u32)
        }));
        surfaces.clear();
        let known = active.surfaces.iter().zip(states);
        surfaces.extend(known.clone().zip(&*former_surfaces).map(|((surface, state), &former)| {
            let (last, last_version) = &last_surfaces[former? as usize];
            let kept = keeps && !surface.fresh && is_same_surface(surface, last) && *last_version == state.version();
            former.filter(|_| kept)
        }));
        former_shapes.clear();
        former_shapes.extend(active.shapes.iter().map(|shape| {
            let place = last_shapes.binary_search_by_key(&shape.order, |last| last.order).ok()?;
            (shape.entity == last_shapes[place].entity).then_some(place as u32)
        }));
        shapes.clear();
        shapes.extend(active.shapes.iter().zip(&*former_shapes).map(|(shape, &former)| {
            former.filter(|&place| keeps && is_same_shape(shape, &last_shapes[place as usize]))
        }));
        last_surfaces.clear();
        last_surfaces.extend(known.map(|(surface, state)| (surface.clone(), state.version())));
        last_shapes.clone_from(&active.shapes);
        let count = last_surfaces.len();
        capacity::trim(last_surfaces, count);
        for places in [surfaces, former_surfaces] {
            capacity::trim(places, count);
        }
        self.last_count = self.origins.len();
        self.origins.clear();
        self.former_places.clear();
    }

    /// What a surface, and a shape or surface, of this detection were in the last one, where nothing about them has
    /// changed.
    pub(super) fn last_sides(&self, first: usize, second: OtherSide) -> Option<(usize, OtherSide)> {
        let [surfaces, shapes] = &self.unchanged;
        let last_second = match second {
            OtherSide::Surface(place) => OtherSide::Surface(surfaces[place]? as usize),
            OtherSide::Shape(place) => OtherSide::Shape(shapes[place]? as usize),
        };
        Some((surfaces[first]? as usize, last_second))
    }

    /// The same wherever both were there, whatever has changed about them.
    pub(super) fn former_sides(&self, first: usize, second: OtherSide) -> Option<(usize, OtherSide)> {
        let [surfaces, shapes] = &self.former;
        let former_second = match second {
            OtherSide::Surface(place) => OtherSide::Surface(surfaces[place]? as usize),
            OtherSide::Shape(place) => OtherSide::Shape(shapes[place]? as usize),
        };
        Some((surfaces[first]? as usize, former_second))
    }

    /// Adds a pair that has changed, given its place in the last detection, or that is new.
    pub(super) fn add_pair(&mut self, former: Option<u32>) {
        self.origins.push(None);
        self.former_places.push(former);
    }

    /// Adds a pair that is kept from its place in the last detection.
    pub(super) fn keep_pair(&mut self, origin: u32) {
        self.origins.push(Some(origin));
        self.former_places.push(Some(origin));
    }

    /// All pairs have been added.
    pub(super) fn end_pairs(&mut self) {
        let at_its_place = |(place, origin): (u32, &Option<u32>)| *origin == Some(place);
        self.all_kept = self.origins.len() == self.last_count && (0..).zip(&self.origins).all(at_its_place);
        let Self { origins, former_places, .. } = self;
        let count = origins.len();
        for places in [origins, former_places] {
            capacity::trim(places, count);
        }
    }

    /// Whether a pair of this detection is what it was in the last one.
    pub(crate) fn keeps(&self, place: usize) -> bool {
        self.origin(place).is_some()
    }

    /// A kept pair's place in the last detection.
    pub(crate) fn origin(&self, place: usize) -> Option<usize> {
        self.origins.get(place).copied().flatten().map(|origin| origin as usize)
    }

    /// Whether every pair is kept, and none has gone or moved to another place.
    pub(crate) fn keeps_all(&self) -> bool {
        self.all_kept
    }

    /// Those of a list with an item for each pair whose pairs are not kept.
    pub(super) fn changed<'a, T>(&'a self, items: &'a [T]) -> impl Iterator<Item = &'a T> {
        items.iter().enumerate().filter(|&(place, _)| !self.keeps(place)).map(|(_, item)| item)
    }

    /// Which settings these are, for what is computed with them.
    pub(super) fn settings_version(&self) -> u64 {
        self.settings_version
    }

    pub(crate) fn kept_count(&self) -> usize {
        self.origins.iter().flatten().count()
    }

    /// Nothing is kept in this detection from here on.
    pub(super) fn forget(&mut self) {
        self.origins.fill(None);
        self.all_kept = false;
    }

    /// Brings the lists of pairs from their places in the last detection to those in this one. Those of pairs that are not kept
    /// are to be written anew: a pair keeps its lists for their memory, and what pairs had that have gone is given back.
    pub(super) fn carry<T: Default>(&mut self, lists: &mut Vec<T>) {
        // A stage that was added since the last detection has no lists yet.
        if self.origins.iter().flatten().any(|&origin| origin as usize >= lists.len()) {
            self.forget();
        }
        let count = lists.len() as u32;
        let stays = (0..).zip(&self.former_places).all(|(place, &former)| former == Some(place) || place >= count);
        if stays {
            // Whoever has gone has gone from the end.
            lists.truncate(self.former_places.len());
            capacity::trim(lists, self.former_places.len());
            return;
        }
        let mut last: Vec<Option<T>> = std::mem::take(lists).into_iter().map(Some).collect();
        let mut take = |former: Option<u32>| last.get_mut(former? as usize)?.take();
        lists.extend(self.former_places.iter().map(|&former| take(former).unwrap_or_default()));
    }

    /// Writes for each active surface whether it is part of a pair that is tested by `method` and not kept.
    pub(super) fn surfaces_to_update(
        &self,
        active: &ActiveSurfaces,
        candidates: &CandidateTrianglePairs,
        method: ContactMethod,
        used: &mut Vec<bool>,
    ) {
        surfaces_with_method(active, self.changed(&candidates.pairs), method, used);
    }
}

/// Whether all that decides about a surface's contacts, but for its positions, is the same, and all that is stored of it.
fn is_same_surface(surface: &ActiveSurface, last: &ActiveSurface) -> bool {
    surface.entity == last.entity
        && Arc::ptr_eq(&surface.topology, &last.topology)
        && surface.pose.has_bits_of(&last.pose)
        && surface.thickness.to_bits() == last.thickness.to_bits()
        && surface.method == last.method
        && surface.one_sided == last.one_sided
        && surface.events == last.events
        && surface.rigid == last.rigid
}

/// The same of a shape.
fn is_same_shape(shape: &ActiveShape, last: &ActiveShape) -> bool {
    shape.entity == last.entity
        && Arc::ptr_eq(&shape.geometry, &last.geometry)
        && shape.pose.has_bits_of(&last.pose)
        && shape.events == last.events
}
