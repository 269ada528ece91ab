//! The results of a stage for a pair of surfaces, in lists that the contact store shares without a copy.

use std::{mem, ops::Deref, sync::Arc};

use crate::{
    detection::spheres::lists::{FoundBySpheres, Order, SphereBuffers, SphereTests},
    kernel::{
        capacity,
        contact::{CompactContact, SharedContact, TouchingPair},
        pair::{FoundPairs, PairSettings},
    },
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
    /// The capacity of the list.
    #[must_use]
    pub fn capacity(&self) -> usize {
        self.0.as_ref().map_or(0, |list| list.capacity())
    }

    /// The list, if it is not shared.
    fn own(&mut self) -> Option<&mut Vec<T>> {
        self.0.as_mut().and_then(Arc::get_mut)
    }

    /// Takes the memory of the list, trimmed to what it held, unless it is shared. Leaves an empty list.
    pub(super) fn take(&mut self) -> Vec<T> {
        let mut list = self.own().map(mem::take).unwrap_or_default();
        // An empty list was cleared earlier, so how much it held is unknown.
        if !list.is_empty() {
            capacity::clear(&mut list);
        }
        list
    }

    /// Takes the memory of one of two lists: of `self` if it is not shared, otherwise of `other`, which is swapped with
    /// it.
    pub(super) fn take_memory(&mut self, other: &mut Self) -> Vec<T> {
        let is_other_better = self.0.is_some() || other.own().is_some();
        if self.own().is_none() && is_other_better {
            mem::swap(self, other);
        } else if let Some(other) = other.own() {
            // `self` is not shared, so `other` is not needed.
            capacity::clear(other);
        }
        self.take()
    }

    /// Replaces the list.
    pub(super) fn put(&mut self, list: Vec<T>) {
        match self.own() {
            Some(place) => *place = list,
            None => self.0 = (list.capacity() > 0).then(|| Arc::new(list)),
        }
    }
}

impl<T: Clone> SharedList<T> {
    /// The items for writing. Copies them first if they are shared.
    pub(crate) fn make_mut(&mut self) -> &mut [T] {
        self.0.as_mut().map_or(&mut [], |list| Arc::make_mut(list).as_mut_slice())
    }
}

/// The results of a stage for a pair of surfaces.
#[derive(Clone, Debug)]
pub struct PairContacts {
    /// Touching pairs of triangles, each once, sorted.
    pub touching: SharedList<TouchingPair>,
    /// Contacts, one per pair of features, sorted by their triangles, then by key.
    pub contacts: SharedList<CompactContact>,
    /// Distance of the nearest pair in world units, at least 0. Infinite if none is within range.
    pub nearest: f64,
    /// The number of pairs that reached the exact test.
    pub examined: usize,
    /// The results of a sphere method.
    pub(crate) spheres: Option<FoundBySpheres>,
    /// The contacts that have sides and that other pairs of triangles may report in another tick.
    pub(crate) shared: SharedList<SharedContact>,
    /// The lower bounds of [`FoundPairs`].
    lower_bounds: Vec<f32>,
    /// The lists of the tick before the last one. Their memory is used for this one if the last ones are shared.
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
    /// Clears the results. Returns lists for new ones, which are stored by [`finish`](Self::finish).
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

    /// Clears the results.
    pub(super) fn clear(&mut self) {
        let nothing = self.begin();
        self.finish(nothing);
    }

    /// Frees everything that a sphere method found. The pair is no longer tested by spheres.
    pub(super) fn forget_spheres(&mut self) {
        (self.spheres, self.spare_spheres, self.order) = (None, None, Order::default());
    }

    /// Finds contacts by spheres. Returns the pairs that passed.
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

    /// Stores the results.
    pub(super) fn finish(&mut self, found: FoundPairs) {
        self.touching.put(found.touching);
        self.contacts.put(found.contacts);
        self.shared.put(found.shared);
        self.nearest = found.nearest;
        self.examined = found.examined;
        self.lower_bounds = found.lower_bounds;
    }

    /// Lower bounds of the candidates' distances, if they were requested.
    pub(super) fn lower_bounds(&self) -> &[f32] {
        &self.lower_bounds
    }
}
