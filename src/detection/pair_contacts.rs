//! What a stage has found of a pair of surfaces, in lists that the store shares without a copy.

use std::{mem, ops::Deref, sync::Arc};

use super::sphere_lists::{FoundBySpheres, Order, SphereBuffers, SphereTests};
use crate::kernel::{
    capacity,
    contact::{CompactContact, SharedContact, TouchingPair},
    pair::{FoundPairs, PairSettings},
};

/// A copy-on-write list: cloning it shares the items.
#[derive(Clone, Debug)]
pub struct SharedList<T>(Option<Arc<Vec<T>>>);

impl<T> Default for SharedList<T> {
    fn default() -> Self {
        Self(None)
    }
}

impl<T> Deref for SharedList<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        self.0.as_ref().map_or(&[], |list| list)
    }
}

impl<T> SharedList<T> {
    /// How many items the list has room for.
    #[must_use]
    pub fn capacity(&self) -> usize {
        self.0.as_ref().map_or(0, |list| list.capacity())
    }

    /// The list, where it is not shared.
    fn own(&mut self) -> Option<&mut Vec<T>> {
        self.0.as_mut().and_then(Arc::get_mut)
    }

    /// Takes the memory of the list, trimmed to what it held, unless it is shared. Leaves an empty list.
    pub(super) fn take(&mut self) -> Vec<T> {
        let mut list = self.own().map(mem::take).unwrap_or_default();
        // An empty one has been emptied before: how much it held then is not known any more.
        if !list.is_empty() {
            capacity::clear(&mut list);
        }
        list
    }

    /// Takes the memory of one of two lists, the first if it is not shared. It becomes the first.
    pub(super) fn take_memory(&mut self, other: &mut Self) -> Vec<T> {
        let is_other_better = self.0.is_some() || other.own().is_some();
        if self.own().is_none() && is_other_better {
            mem::swap(self, other);
        } else if let Some(other) = other.own() {
            // The last one is not shared: the other one is not needed.
            capacity::clear(other);
        }
        self.take()
    }

    /// Puts a list in the place of this one.
    pub(super) fn put(&mut self, list: Vec<T>) {
        match self.own() {
            Some(place) => *place = list,
            None => self.0 = (list.capacity() > 0).then(|| Arc::new(list)),
        }
    }
}

impl<T: Clone> SharedList<T> {
    /// The items, to be changed: copied first where they are shared.
    pub(crate) fn make_mut(&mut self) -> &mut [T] {
        self.0.as_mut().map_or(&mut [], |list| Arc::make_mut(list).as_mut_slice())
    }
}

/// What a stage has found of a pair of surfaces.
#[derive(Clone, Debug)]
pub struct PairContacts {
    /// Pairs of triangles that touch, each once, in their order.
    pub touching: SharedList<TouchingPair>,
    /// Contacts, each pair of features once, in the order of their triangles, those of the same two triangles by key.
    pub contacts: SharedList<CompactContact>,
    /// Distance of the nearest pair in world units, at least 0; infinite where none is within range.
    pub nearest: f64,
    /// How many pairs reached the exact test.
    pub examined: usize,
    /// What a sphere method has found.
    pub(crate) spheres: Option<FoundBySpheres>,
    /// Those of the contacts that other pairs of triangles may report in another tick, and that have sides.
    pub(crate) shared: SharedList<SharedContact>,
    /// What [`FoundPairs`] has besides.
    lower_bounds: Vec<f32>,
    /// The lists of the tick before the last one: their memory serves this one.
    spare: (SharedList<TouchingPair>, SharedList<CompactContact>, SharedList<SharedContact>),
    spare_spheres: Option<FoundBySpheres>,
    order: Order,
}

impl Default for PairContacts {
    fn default() -> Self {
        Self {
            touching: SharedList::default(),
            contacts: SharedList::default(),
            nearest: f64::INFINITY,
            examined: 0,
            spheres: None,
            shared: SharedList::default(),
            lower_bounds: Vec::new(),
            spare: Default::default(),
            spare_spheres: None,
            order: Order::default(),
        }
    }
}

impl PairContacts {
    /// Empties it, and gives lists that what is found can be written to before it is [finished](Self::finish).
    pub(super) fn begin(&mut self) -> FoundPairs {
        let (touching, contacts, shared) = &mut self.spare;
        let mut found = FoundPairs {
            touching: self.touching.take_memory(touching),
            contacts: self.contacts.take_memory(contacts),
            shared: self.shared.take_memory(shared),
            lower_bounds: mem::take(&mut self.lower_bounds),
            ..FoundPairs::default()
        };
        capacity::clear(&mut found.lower_bounds);
        self.finish(FoundPairs::default());
        found
    }

    /// Empties it.
    pub(super) fn clear(&mut self) {
        let nothing = self.begin();
        self.finish(nothing);
    }

    /// Drops everything that spheres have found: the pair is not tested by them any more.
    pub(super) fn forget_spheres(&mut self) {
        (self.spheres, self.spare_spheres, self.order) = (None, None, Order::default());
    }

    /// Finds what is in contact by spheres. Returns the pairs that passed.
    pub(super) fn find_spheres(
        &mut self,
        pairs: &[[u32; 2]],
        settings: &PairSettings,
        (threads, buffers): (usize, &SphereBuffers),
        tests: &impl SphereTests,
        with_points: bool,
    ) -> SharedList<[u32; 2]> {
        let (mut last, mut spare) =
            (self.spheres.take().unwrap_or_default(), self.spare_spheres.take().unwrap_or_default());
        let found = last.reuse(&mut spare);
        self.spare_spheres = Some(spare);
        let found = buffers.find(found, pairs, threads, tests);
        let mut written = self.begin();
        if with_points {
            buffers.write(&found, settings, threads, tests, &mut self.order, &mut written);
        }
        written.nearest = found.1.nearest;
        self.finish(FoundPairs { shared: Vec::new(), ..written });
        last.put(found);
        let passed = last.pairs.clone();
        self.spheres = Some(last);
        passed
    }

    /// Writes what was found.
    pub(super) fn finish(&mut self, found: FoundPairs) {
        self.touching.put(found.touching);
        self.contacts.put(found.contacts);
        self.shared.put(found.shared);
        self.nearest = found.nearest;
        self.examined = found.examined;
        self.lower_bounds = found.lower_bounds;
    }

    /// Lower bounds of the distances of the candidates, where they were wanted.
    pub(super) fn lower_bounds(&self) -> &[f32] {
        &self.lower_bounds
    }
}
