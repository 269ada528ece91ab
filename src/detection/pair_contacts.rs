//! What a stage has found of a pair of surfaces, in lists that the store takes part in without a copy.

use std::{
    fmt::{self, Debug, Formatter},
    mem,
    ops::{Deref, DerefMut},
    sync::Arc,
};

use bevy_ecs::entity::Entity;

use super::sphere_lists::{KeptSpheres, PassedAndFound, SphereBuffers, SphereLists};
use crate::kernel::{
    capacity,
    contact::{CompactContact, SharedContact, TouchingPair},
    exact::unique::UniqueFeatures,
    pair::{FoundPairs, PairSettings},
};

/// A list that several hold. Whoever writes to it while others hold it, too, gets one of its own. Some lists are not written
/// until somebody reads them: how long such a list is, is known before, and asking for that is not reading.
#[derive(Clone)]
pub struct SharedList<T: 'static>(Shared<T>);

/// Where a list is.
#[derive(Clone)]
enum Shared<T: 'static> {
    /// Nowhere, as there is nothing on it.
    Nothing,
    Written(Arc<Vec<T>>),
    /// With whoever writes it when it is first read, if not before.
    Deferred(Arc<dyn Deferred<T>>),
}

/// Lists that are written when they are first read, if not before.
pub(super) trait Deferred<T>: Send + Sync {
    fn len(&self) -> usize;

    fn list(&self) -> &Vec<T>;

    /// The list, where it has been written.
    fn written(&self) -> Option<&Vec<T>>;
}

/// Nothing is written to be shown, nor does that count as reading.
impl<T: Debug> Debug for SharedList<T> {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> fmt::Result {
        let written = match &self.0 {
            Shared::Nothing => None,
            Shared::Written(list) => Some(&**list),
            Shared::Deferred(lists) => match lists.written() {
                None => return write!(formatter, "[{} unwritten]", lists.len()),
                written => written,
            },
        };
        formatter.debug_list().entries(written.into_iter().flatten()).finish()
    }
}

impl<T> Default for SharedList<T> {
    fn default() -> Self {
        Self(Shared::Nothing)
    }
}

impl<T> Deref for SharedList<T> {
    type Target = Vec<T>;

    fn deref(&self) -> &Vec<T> {
        match &self.0 {
            Shared::Nothing => const { &Vec::new() },
            Shared::Written(list) => list,
            Shared::Deferred(lists) => lists.list(),
        }
    }
}

impl<T: Clone> DerefMut for SharedList<T> {
    fn deref_mut(&mut self) -> &mut Vec<T> {
        if !matches!(self.0, Shared::Written(_)) {
            self.0 = Shared::Written(Arc::new(self.to_vec()));
        }
        let Shared::Written(list) = &mut self.0 else { unreachable!("it has just been written") };
        Arc::make_mut(list)
    }
}

impl<T> SharedList<T> {
    /// How many items there are, without writing the list.
    #[must_use]
    pub fn len(&self) -> usize {
        match &self.0 {
            Shared::Nothing => 0,
            Shared::Written(list) => list.len(),
            Shared::Deferred(lists) => lists.len(),
        }
    }

    /// Whether there are none, without writing the list.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The list, where nobody else holds it.
    fn own(&mut self) -> Option<&mut Vec<T>> {
        if let Shared::Written(list) = &mut self.0 { Arc::get_mut(list) } else { None }
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

    /// Takes the memory of one of two lists, the first if nobody else holds it. It becomes the first.
    fn take_memory(&mut self, other: &mut Self) -> Vec<T> {
        if self.own().is_none() {
            mem::swap(self, other);
        } else if let Some(other) = other.own() {
            // Nobody holds the last one: the other one is not needed.
            capacity::clear(other);
        }
        self.take()
    }

    /// Puts a list in the place of this one.
    pub(super) fn put(&mut self, list: Vec<T>) {
        match self.own() {
            Some(place) => *place = list,
            None if list.capacity() > 0 => self.0 = Shared::Written(Arc::new(list)),
            None => self.0 = Shared::Nothing,
        }
    }

    /// A list that others write.
    fn defer(lists: Arc<dyn Deferred<T>>) -> Self {
        Self(Shared::Deferred(lists))
    }

    /// Lets go of those who would write it.
    fn release(&mut self) {
        if let Shared::Deferred(_) = self.0 {
            self.0 = Shared::Nothing;
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
    /// Of a method by spheres, what was found, and what the lists above are written from.
    pub(crate) spheres: Option<Arc<SphereLists>>,
    /// Those of the contacts that other pairs of triangles may report in another tick, and that have sides.
    pub(crate) shared: SharedList<SharedContact>,
    /// What [`FoundPairs`] has besides.
    lower_bounds: Vec<f32>,
    /// Lists of the tick before the last one, which nobody holds any more: their memory serves this one.
    spare: (SharedList<TouchingPair>, SharedList<CompactContact>, SharedList<SharedContact>),
    /// The same as `spheres` of the tick before.
    last_spheres: Option<Arc<SphereLists>>,
    /// Empty ones that nobody else holds: their memory serves another tick.
    spare_spheres: Option<Arc<SphereLists>>,
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
            last_spheres: None,
            spare_spheres: None,
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

    /// Begins a tick of its own: lets go of the spheres of the tick before the last one.
    pub(super) fn release_spheres(&mut self) {
        self.touching.release();
        self.contacts.release();
        let older = mem::replace(&mut self.last_spheres, self.spheres.take());
        self.keep_memory(older);
    }

    /// Lets go of all spheres but those of the contacts: nothing is found in this tick. The memory of what is read stays for
    /// when it is written again: there is much of it.
    pub(super) fn rest_spheres(&mut self) {
        let last = self.last_spheres.take().filter(|lists| lists.is_read());
        self.keep_memory(last);
    }

    /// Lets go of everything that spheres have found: they are not asked any more.
    pub(super) fn forget_spheres(&mut self) {
        (self.spheres, self.last_spheres, self.spare_spheres) = (None, None, None);
    }

    /// What spheres have found, in the last tick and the one before.
    pub(super) fn sphere_lists(&self) -> impl Iterator<Item = &SphereLists> {
        [&self.spheres, &self.last_spheres].into_iter().flatten().map(|lists| &**lists)
    }

    /// Empties lists that nobody else holds, for another tick.
    fn keep_memory(&mut self, lists: Option<Arc<SphereLists>>) {
        if let Some(mut lists) = lists
            && let Some(own) = Arc::get_mut(&mut lists)
        {
            own.clear();
            self.spare_spheres = Some(lists);
        }
    }

    /// [Finds](SphereLists::find) what is in contact by spheres, and keeps it. Returns the pairs that passed.
    pub(super) fn find_spheres(
        &mut self,
        sides: [Entity; 2],
        pairs: &[[u32; 2]],
        written_by: (Option<KeptSpheres>, PairSettings),
        buffers: (usize, &SphereBuffers),
        find: impl Fn(&[[u32; 2]], &mut PassedAndFound) + Sync,
        write: impl Fn(&[[u32; 2]], &mut FoundPairs) + Sync,
    ) -> SharedList<[u32; 2]> {
        let mut place = self.spare_spheres.take().unwrap_or_default();
        let mut lists = Arc::get_mut(&mut place).map(mem::take).unwrap_or_default();
        lists.find(sides, pairs, written_by, buffers, find, write);
        (self.nearest, self.examined) = (lists.nearest(), 0);
        let passed = lists.pairs().clone();
        match Arc::get_mut(&mut place) {
            Some(own) => *own = lists,
            None => place = Arc::new(lists),
        }
        self.touching = SharedList::defer(Arc::clone(&place) as _);
        self.contacts = SharedList::defer(Arc::clone(&place) as _);
        self.spheres = Some(place);
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
