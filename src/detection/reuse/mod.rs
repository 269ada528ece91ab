//! What a pair of surfaces that has not changed keeps from the last detection: its candidates, the results of the
//! stages, and its contacts.
//!
//! A pair is kept if both sides are the same, bit by bit. Only the stages can write their results, so comparing
//! versions and components is sufficient.

use std::sync::Arc;

use bevy_ecs::{change_detection::Tick, prelude::*};

use crate::{
    detection::{
        pairs::{CandidateTrianglePairs, OtherSide, surfaces_with_method},
        state::SurfaceState,
    },
    kernel::capacity,
    settings::CircumsphereSettings,
    surface::{ActiveShape, ActiveSurface, ActiveSurfaces, ContactMethod},
};

pub(super) mod near_lists;

/// The sides of the last detection, and which pairs of this one are kept from it.
#[derive(Resource, Default)]
pub(crate) struct DetectionMemory {
    /// The surfaces of the last detection that began, each with its version.
    surfaces: Vec<(ActiveSurface, u64)>,
    shapes: Vec<ActiveShape>,
    settings: Option<CircumsphereSettings>,
    /// The last change of the [`ContactFilter`](crate::ContactFilter), if there is one.
    filter: Option<Tick>,
    /// For each surface and each shape of this detection, its index in the last one, if nothing about it has changed.
    unchanged: [Vec<Option<u32>>; 2],
    /// For each surface and each shape of this detection, its index in the last one, whether or not it has changed.
    former: [Vec<Option<u32>>; 2],
    /// For each pair of this detection, its index in the last one, if it is kept.
    origins: Vec<Option<u32>>,
    /// For each pair of this detection, its index in the last one, kept or not. Its lists are at that index, and are
    /// used again.
    former_places: Vec<Option<u32>>,
    /// Whether this detection keeps nothing.
    is_void: bool,
    /// The number of pairs of the last detection.
    last_count: usize,
    /// Whether every pair is kept at the same index.
    all_kept: bool,
    /// Increases when the settings change.
    settings_version: u64,
}

impl DetectionMemory {
    /// Begins a detection: determines which surfaces and shapes have not changed since the last one, and remembers all
    /// of them.
    pub(super) fn begin(
        &mut self,
        active: &ActiveSurfaces,
        settings: &CircumsphereSettings,
        filter: Option<Tick>,
        states: &[SurfaceState],
    ) {
        let are_settings_same = self.settings.replace(*settings) == Some(*settings);
        self.settings_version += u64::from(!are_settings_same);
        let is_filter_same = std::mem::replace(&mut self.filter, filter) == filter;
        let keeps = settings.memory && are_settings_same && is_filter_same;
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

    /// The indices that two sides had in the last detection, if nothing about them has changed.
    pub(super) fn last_sides(&self, first: usize, second: OtherSide) -> Option<(usize, OtherSide)> {
        looked_up(&self.unchanged, first, second)
    }

    /// The indices that two sides had in the last detection, whether or not they have changed.
    pub(super) fn former_sides(&self, first: usize, second: OtherSide) -> Option<(usize, OtherSide)> {
        looked_up(&self.former, first, second)
    }

    /// Adds a pair that has changed, with its index in the last detection, or a new one.
    pub(super) fn add_pair(&mut self, former: Option<u32>) {
        self.origins.push(None);
        self.former_places.push(former);
    }

    /// Adds a pair that is kept from its index in the last detection.
    pub(super) fn keep_pair(&mut self, origin: u32) {
        self.origins.push(Some(origin));
        self.former_places.push(Some(origin));
    }

    /// Ends the list of pairs.
    pub(super) fn end_pairs(&mut self) {
        let at_its_place = |(place, origin): (u32, &Option<u32>)| *origin == Some(place);
        let is_void = std::mem::take(&mut self.is_void);
        self.all_kept = !is_void && self.origins.len() == self.last_count && (0..).zip(&self.origins).all(at_its_place);
        let Self { origins, former_places, .. } = self;
        let count = origins.len();
        for places in [origins, former_places] {
            capacity::trim(places, count);
        }
    }

    /// Whether a pair of this detection is kept from the last one.
    pub(crate) fn keeps(&self, place: usize) -> bool {
        self.origin(place).is_some()
    }

    /// The index of a kept pair in the last detection.
    pub(crate) fn origin(&self, place: usize) -> Option<usize> {
        self.origins.get(place).copied().flatten().map(|origin| origin as usize)
    }

    /// Whether every pair is kept, and none has disappeared or changed its index.
    pub(crate) fn keeps_all(&self) -> bool {
        self.all_kept
    }

    /// The items of pairs that are not kept. `items` has one for each pair.
    pub(super) fn changed<'a, T>(&'a self, items: &'a [T]) -> impl Iterator<Item = &'a T> {
        items.iter().enumerate().filter(|&(place, _)| !self.keeps(place)).map(|(_, item)| item)
    }

    /// The version of the settings.
    pub(super) fn settings_version(&self) -> u64 {
        self.settings_version
    }

    pub(crate) fn kept_count(&self) -> usize {
        self.origins.iter().flatten().count()
    }

    /// Keeps nothing in the next detection: what the last one found is not what the world has found.
    pub(crate) fn keep_nothing(&mut self) {
        self.settings = None;
        self.is_void = true;
    }

    /// Keeps nothing from here on in this detection.
    fn forget(&mut self) {
        self.origins.fill(None);
        self.all_kept = false;
    }

    /// Moves the lists of pairs from their indices in the last detection to those in this one. Pairs that are not kept
    /// must write their lists anew, and only use their memory. Lists of pairs that no longer exist are freed.
    pub(super) fn carry<T: Default>(&mut self, lists: &mut Vec<T>) {
        // The stage was added after the last detection and has no lists yet.
        if self.origins.iter().flatten().any(|&origin| origin as usize >= lists.len()) {
            self.forget();
        }
        let count = lists.len() as u32;
        let stays = (0..).zip(&self.former_places).all(|(place, &former)| former == Some(place) || place >= count);
        if stays {
            // Only lists at the end are no longer needed.
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

/// The entries of two sides in the tables of surfaces and shapes.
fn looked_up(
    [surfaces, shapes]: &[Vec<Option<u32>>; 2],
    first: usize,
    second: OtherSide,
) -> Option<(usize, OtherSide)> {
    let second = match second {
        OtherSide::Surface(place) => OtherSide::Surface(surfaces[place]? as usize),
        OtherSide::Shape(place) => OtherSide::Shape(shapes[place]? as usize),
    };
    Some((surfaces[first]? as usize, second))
}

/// Whether everything that determines a surface's contacts, except its positions, is the same, and everything that is
/// stored with them.
fn is_same_surface(surface: &ActiveSurface, last: &ActiveSurface) -> bool {
    surface.entity == last.entity
        && Arc::ptr_eq(&surface.topology, &last.topology)
        && surface.pose.has_bits_of(&last.pose)
        && surface.thickness.to_bits() == last.thickness.to_bits()
        && is_same_list(surface.vertex_thickness.as_ref(), last.vertex_thickness.as_ref())
        && surface.margin.to_bits() == last.margin.to_bits()
        && surface.own_margin.to_bits() == last.own_margin.to_bits()
        && surface.method == last.method
        && surface.one_sided == last.one_sided
        && surface.shape == last.shape
        && surface.events == last.events
        && surface.event_hold == last.event_hold
        && surface.rigid == last.rigid
        && surface.layers == last.layers
        && is_same_list(surface.triangle_layers.as_ref(), last.triangle_layers.as_ref())
        && is_same_list(surface.rest_pairs.as_ref(), last.rest_pairs.as_ref())
}

/// Whether two lists that may be shared are the same one.
pub(crate) fn is_same_list<T: ?Sized>(list: Option<&Arc<T>>, last: Option<&Arc<T>>) -> bool {
    match (list, last) {
        (Some(list), Some(last)) => Arc::ptr_eq(list, last),
        (None, None) => true,
        _ => false,
    }
}

/// Like [`is_same_surface`], for a shape.
fn is_same_shape(shape: &ActiveShape, last: &ActiveShape) -> bool {
    shape.entity == last.entity
        && Arc::ptr_eq(&shape.geometry, &last.geometry)
        && shape.pose.has_bits_of(&last.pose)
        && shape.margin.to_bits() == last.margin.to_bits()
        && shape.layers == last.layers
        && shape.events == last.events
        && shape.event_hold == last.event_hold
}
