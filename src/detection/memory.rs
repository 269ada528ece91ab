//! What an unchanged pair of surfaces keeps from the last detection: its candidates, what the stages made of them, and
//! its contacts.
//!
//! A pair is kept where both sides are, bit by bit, what they were. That holds for lists and spheres only as long as
//! nobody but the stages writes to them: each stage seals what it wrote by its change tick, and where a seal is broken
//! everything is computed anew, in that detection and the next.

use std::sync::Arc;

use bevy_ecs::{change_detection::Tick, prelude::*};
use glam::Vec3;

use super::{
    bounds::TriangleBounds,
    broad_phase::{CandidateTrianglePairs, OtherSide, SurfacePair, surfaces_with_method},
    sphere_memory::SphereMemory,
};
use crate::{
    kernel::{capacity, mesh::bounds::Aabb},
    settings::CircumsphereSettings,
    surface::{ActiveShape, ActiveSurface, ActiveSurfaces, ContactMethod},
};

/// The lists that stages write.
#[derive(Clone, Copy)]
pub(crate) enum StageList {
    Candidates,
    Overlapping,
    Meeting,
    Refined,
    SphereContacts,
    /// The [`ContactStore`](crate::contacts::ContactStore).
    Store,
}

/// What is known of the last detection, and which pairs of this one are kept from it.
#[derive(Resource, Default)]
pub(crate) struct DetectionMemory {
    /// The surfaces of the last detection that began, and how often the boxes of each had been computed.
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
    /// The candidates of those that are kept, until they are handed back.
    candidates: Vec<Vec<[u32; 2]>>,
    /// What was moved of those, until then.
    moved: Vec<Moved>,
    /// How many pairs the last detection had.
    last_count: usize,
    /// Whether every pair is kept, each at its place.
    all_kept: bool,
    /// Whether a detection has come to its end with every seal whole.
    is_whole: bool,
    /// Whether nobody but the stages has written to the candidates, since the last detection began.
    is_undisturbed: bool,
    seals: [Option<Tick>; 6],
    pub(super) spheres: SphereMemory,
}

/// What was brought into the frame of a pair, as the pair has it.
#[derive(Default)]
struct Moved {
    triangles: Vec<(u32, Aabb)>,
    positions: Vec<Vec3>,
    rounding: f32,
}

impl DetectionMemory {
    /// Begins a detection: finds out which surfaces and shapes have not changed since the last one, and remembers them all.
    pub(super) fn begin(
        &mut self,
        active: &ActiveSurfaces,
        settings: &CircumsphereSettings,
        candidates_changed: Tick,
        store_changed: Option<Tick>,
        bounds: &Query<&TriangleBounds>,
    ) {
        self.is_undisturbed = self.is_sealed(StageList::Candidates, candidates_changed);
        let is_whole = std::mem::take(&mut self.is_whole)
            && self.is_undisturbed
            && store_changed.is_none_or(|changed| self.is_sealed(StageList::Store, changed));
        self.spheres.begin(active);
        let keeps = is_whole && settings.memory && self.settings == Some(*settings);
        self.settings = Some(*settings);
        let Self {
            surfaces: last_surfaces,
            shapes: last_shapes,
            unchanged: [surfaces, shapes],
            former: [former_surfaces, former_shapes],
            ..
        } = &mut *self;
        let computed = |surface: &ActiveSurface| bounds.get(surface.entity).map_or(0, TriangleBounds::computed);
        former_surfaces.clear();
        former_surfaces.extend(active.surfaces.iter().map(|surface| {
            let place = last_surfaces.binary_search_by_key(&surface.order, |(last, _)| last.order).ok()?;
            (surface.entity == last_surfaces[place].0.entity).then_some(place as u32)
        }));
        surfaces.clear();
        surfaces.extend(active.surfaces.iter().zip(&*former_surfaces).map(|(surface, &former)| {
            let (last, last_computed) = &last_surfaces[former? as usize];
            let kept = keeps && !surface.fresh && is_same_surface(surface, last) && *last_computed == computed(surface);
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
        last_surfaces.extend(active.surfaces.iter().map(|surface| (surface.clone(), computed(surface))));
        last_shapes.clone_from(&active.shapes);
        let count = last_surfaces.len();
        capacity::trim(last_surfaces, count);
        for places in [surfaces, former_surfaces] {
            capacity::trim(places, count);
        }
        self.last_count = self.origins.len();
        self.origins.clear();
        self.former_places.clear();
        self.candidates.clear();
        self.moved.clear();
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
        self.candidates.push(Vec::new());
        self.moved.push(Moved::default());
    }

    /// Adds a pair that is kept from its place in the last detection. Its lists are taken into custody until the steps that
    /// else would fill them: somebody else's would fill them again.
    pub(super) fn keep_pair(&mut self, origin: u32, pair: &mut SurfacePair) {
        self.origins.push(Some(origin));
        self.former_places.push(Some(origin));
        self.candidates.push(std::mem::take(&mut pair.triangles));
        self.moved.push(Moved {
            triangles: std::mem::take(&mut pair.moved_triangles),
            positions: std::mem::take(&mut pair.moved_positions),
            rounding: std::mem::take(&mut pair.moved_rounding),
        });
    }

    /// Hands back what was moved of kept pairs.
    pub(super) fn hand_back_moved(&mut self, pairs: &mut [SurfacePair]) {
        for (place, pair) in pairs.iter_mut().enumerate() {
            if self.keeps(place) {
                let moved = std::mem::take(&mut self.moved[place]);
                pair.moved_triangles = moved.triangles;
                pair.moved_positions = moved.positions;
                pair.moved_rounding = moved.rounding;
            }
        }
    }

    /// Hands back the candidates of kept pairs.
    pub(super) fn hand_back_candidates(&mut self, pairs: &mut [SurfacePair]) {
        for (place, pair) in pairs.iter_mut().enumerate() {
            if self.keeps(place) {
                pair.triangles = std::mem::take(&mut self.candidates[place]);
            }
        }
    }

    /// All pairs have been added.
    pub(super) fn end_pairs(&mut self) {
        let at_its_place = |(place, origin): (u32, &Option<u32>)| *origin == Some(place);
        self.all_kept = self.origins.len() == self.last_count && (0..).zip(&self.origins).all(at_its_place);
        self.is_whole = true;
        let Self { origins, former_places, candidates, moved, .. } = self;
        let count = origins.len();
        for places in [origins, former_places] {
            capacity::trim(places, count);
        }
        capacity::trim(candidates, count);
        capacity::trim(moved, count);
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

    /// Whether nobody but the stages has written to the candidates, since the last detection began.
    pub(super) fn is_undisturbed(&self) -> bool {
        self.is_undisturbed
    }

    /// Those of a list with an item for each pair whose pairs are not kept.
    pub(super) fn changed<'a, T>(&'a self, items: &'a [T]) -> impl Iterator<Item = &'a T> {
        items.iter().enumerate().filter(|&(place, _)| !self.keeps(place)).map(|(_, item)| item)
    }

    pub(crate) fn kept_count(&self) -> usize {
        self.origins.iter().flatten().count()
    }

    fn is_sealed(&self, list: StageList, changed: Tick) -> bool {
        self.seals[list as usize] == Some(changed)
    }

    /// Nothing is kept in this detection from here on.
    pub(super) fn forget(&mut self) {
        self.origins.fill(None);
        self.all_kept = false;
    }

    /// A stage is about to read a list. Where somebody else has written to it, nothing is kept from here on, nor in the
    /// next detection: what stages make of it now is not what they made of their own. Whether nobody has.
    pub(super) fn reads(&mut self, list: StageList, changed: Tick) -> bool {
        let is_sealed = self.is_sealed(list, changed);
        if !is_sealed {
            self.forget();
            self.is_whole = false;
        }
        is_sealed
    }

    /// Whether nobody but the stages has written to any list that they have read in this detection.
    pub(super) fn is_whole(&self) -> bool {
        self.is_whole
    }

    /// The last stage is about to read a list. Whether somebody else has written to it: then nothing is kept in the next
    /// detection.
    pub(crate) fn is_spoiled(&mut self, list: StageList, changed: Tick) -> bool {
        let is_spoiled = !self.is_sealed(list, changed);
        self.is_whole &= !is_spoiled;
        is_spoiled
    }

    /// A stage is about to write its list. Where somebody else has written to it since the last detection, nothing is kept
    /// from here on.
    pub(super) fn writes(&mut self, list: StageList, changed: Tick) {
        if !self.is_sealed(list, changed) {
            self.forget();
        }
    }

    /// Seals a list as its stage leaves it.
    pub(crate) fn seal(&mut self, list: StageList, changed: Tick) {
        self.seals[list as usize] = Some(changed);
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
