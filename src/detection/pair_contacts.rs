//! What a stage has found of a pair of surfaces, in lists that the store takes part in without a copy.

use std::{
    mem,
    ops::{Deref, DerefMut},
    sync::Arc,
};

use crate::kernel::{
    contact::{CompactContact, SharedContact, TouchingPair},
    pair::FoundPairs,
    unique::UniqueFeatures,
};

/// A list that several hold. Whoever writes to it while others hold it, too, gets one of its own.
#[derive(Clone, Debug)]
pub struct SharedList<T>(Arc<Vec<T>>);

impl<T> Default for SharedList<T> {
    fn default() -> Self {
        Self(Arc::default())
    }
}

impl<T> Deref for SharedList<T> {
    type Target = Vec<T>;

    fn deref(&self) -> &Vec<T> {
        &self.0
    }
}

impl<T: Clone> DerefMut for SharedList<T> {
    fn deref_mut(&mut self) -> &mut Vec<T> {
        Arc::make_mut(&mut self.0)
    }
}

impl<T> SharedList<T> {
    /// Takes the memory of one of two lists, the first if nobody else holds it, and leaves an empty one in its place. It becomes
    /// the first.
    fn take_memory(&mut self, other: &mut Self) -> Vec<T> {
        if Arc::get_mut(&mut self.0).is_none() {
            mem::swap(self, other);
        }
        let mut list = Arc::get_mut(&mut self.0).map(mem::take).unwrap_or_default();
        list.clear();
        list
    }

    /// Puts a list in the place of this one.
    fn put(&mut self, list: Vec<T>) {
        match Arc::get_mut(&mut self.0) {
            Some(place) => *place = list,
            None => self.0 = Arc::new(list),
        }
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
    /// Those of the contacts that other pairs of triangles may report in another tick, and that have sides.
    pub(crate) shared: SharedList<SharedContact>,
    /// What [`FoundPairs`] has besides.
    lower_bounds: Vec<f32>,
    /// Lists of the tick before the last one, which nobody holds any more: their memory serves this one.
    spare: (SharedList<TouchingPair>, SharedList<CompactContact>, SharedList<SharedContact>),
}

impl Default for PairContacts {
    fn default() -> Self {
        Self {
            touching: SharedList::default(),
            contacts: SharedList::default(),
            nearest: f64::INFINITY,
            examined: 0,
            shared: SharedList::default(),
            lower_bounds: Vec::new(),
            spare: Default::default(),
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
        found.lower_bounds.clear();
        self.finish(FoundPairs::default());
        found
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

    /// Brings the lists into their order again, and drops repeats, whoever may have written to them.
    pub(crate) fn restore_order(&mut self) {
        let mut found = FoundPairs {
            touching: mem::take(&mut *self.touching),
            contacts: mem::take(&mut *self.contacts),
            ..FoundPairs::default()
        };
        found.touching.sort_by_key(|pair| (pair.triangle_a, pair.triangle_b));
        found.contacts.sort_by_key(CompactContact::triangles);
        found.finish_contacts(0);
        UniqueFeatures::default().drop_repeats(&mut found, 0);
        self.touching.put(found.touching);
        self.contacts.put(found.contacts);
        self.shared.put(found.shared);
    }

    /// Lower bounds of the distances of the candidates, where they were wanted.
    pub(super) fn lower_bounds(&self) -> &[f32] {
        &self.lower_bounds
    }
}
