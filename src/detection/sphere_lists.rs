//! Contacts of spheres, written when somebody first reads them, or expected to be.
//!
//! A tick finds which triangles are in contact by their spheres, and how far apart they are. All else about such a contact
//! follows from the two spheres: where it is, its normal, what its points weigh. Whoever asks for that gets all contacts of the
//! pair, sorted, from a copy of the spheres that they were found with; whoever does not has nothing to pay. Where somebody has
//! read those of the last few ticks, these will be read, too: they are written in the tick then, where threads can share the
//! work. A reader cannot: it may be a task of the same threads, which would wait for itself.

use std::{
    collections::HashMap,
    fmt::{self, Debug, Formatter},
    mem,
    sync::{
        Arc, Mutex, OnceLock, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
};

use bevy_ecs::prelude::*;

use super::{
    pair_contacts::{Deferred, PairContacts, SharedList},
    parallel::{Buffers, Threads, append_chunks},
};
use crate::kernel::{
    capacity,
    contact::{CompactContact, TouchingPair},
    exact::pair_order::PairSorter,
    mesh::topology::SurfaceTopology,
    pair::{FoundPairs, PairSettings, SurfaceSide},
    pose::Pose,
    simd::share::{OneByOne, Share},
    spheres::{
        circumsphere::OffsetSpheres,
        cone::SafetyCones,
        contacts::{FoundSpheres, SphereContact, ball_contacts, cap_contacts},
        pairs::{BallSide, CapSide},
        rows::{BallRows, CapRows},
    },
};

/// The spheres of a side.
#[derive(Clone, Debug)]
pub(crate) struct KeptSide<R> {
    pub(super) topology: Arc<SurfaceTopology>,
    pub(super) one_sided: bool,
    /// From its own frame to that of the pair.
    pub(super) pose: Option<Pose>,
    pub(super) rows: Arc<R>,
}

impl<R> KeptSide<R> {
    fn surface(&self) -> SurfaceSide<'_> {
        // Rows have the corners.
        let Self { topology, one_sided, .. } = self;
        SurfaceSide { topology, positions: &[], moved: None, one_sided: *one_sided, mirrored: false, rows: None }
    }
}

/// The spheres of both sides.
#[derive(Clone, Debug)]
pub(crate) enum KeptSpheres {
    Balls([KeptSide<BallRows>; 2]),
    Caps([KeptSide<CapRows>; 2]),
}

impl KeptSpheres {
    fn write(&self, pairs: &[[u32; 2]], settings: &PairSettings, found: &mut FoundPairs) {
        match self {
            Self::Balls(sides) => {
                let [a, b] = sides.each_ref().map(|side| BallSide {
                    surface: side.surface(),
                    balls: &[],
                    pose: side.pose.as_ref(),
                    rows: Some(&side.rows),
                });
                ball_contacts(&a, &b, pairs, settings, found);
            }
            Self::Caps(sides) => {
                let (spheres, cones) = (OffsetSpheres::default(), SafetyCones::default());
                let [a, b] = sides.each_ref().map(|side| CapSide {
                    surface: side.surface(),
                    spheres: &spheres,
                    cones: &cones,
                    pose: side.pose.as_ref(),
                    rows: Some(&side.rows),
                });
                cap_contacts(&a, &b, pairs, settings, found);
            }
        }
    }
}

/// What was found of a pair of surfaces, part by part: pairs that passed, and what was found of those.
pub(super) type PassedAndFound = (Vec<[u32; 2]>, FoundSpheres);

/// Appends what was found in a later part.
fn join((passed, found): &mut PassedAndFound, (later, later_found): &mut PassedAndFound) {
    passed.append(later);
    found.append(later_found);
}

/// What a stage that finds contacts keeps for the memory of its threads.
#[derive(Default)]
pub(super) struct SphereBuffers {
    found: Buffers<PassedAndFound>,
    written: Buffers<FoundPairs>,
}

impl SphereBuffers {
    /// Gives back all memory: no pair is tested by spheres.
    pub(super) fn clear(&self) {
        self.found.clear();
        self.written.clear();
    }
}

/// For so many ticks others are expected to be read after it has been noticed that one was, which is a tick or two later: a game
/// may read every second tick, or detect several times before it reads.
const EXPECTED_FOR: u8 = 3;

/// The pairs of surfaces whose contacts somebody reads, and for how many ticks more that is expected.
#[derive(Resource, Debug, Default)]
pub(super) struct SphereReaders(HashMap<[Entity; 2], u8>);

impl SphereReaders {
    /// Begins a tick, given what was found in the last one.
    pub(super) fn update<'a>(&mut self, last: impl Iterator<Item = &'a PairContacts>) {
        self.0.retain(|_, ticks| {
            *ticks -= 1;
            *ticks > 0
        });
        if self.0.is_empty() {
            self.0 = HashMap::new();
        }
        let read = last.flat_map(PairContacts::sphere_lists).filter(|lists| lists.is_read());
        self.0.extend(read.filter_map(|lists| lists.sides).map(|sides| (sides, EXPECTED_FOR)));
    }

    /// Whether the contacts of two surfaces are expected to be read.
    pub(super) fn expect(&self, sides: [Entity; 2]) -> bool {
        self.0.contains_key(&sides)
    }
}

/// What was found of a pair of surfaces, and all that it takes to write it out.
#[derive(Default)]
pub(crate) struct SphereLists {
    /// The surfaces.
    sides: Option<[Entity; 2]>,
    /// Pairs that meet, as their stage has left them.
    pairs: SharedList<[u32; 2]>,
    /// What was found of those.
    found: FoundSpheres,
    known: Option<(KeptSpheres, PairSettings)>,
    written: OnceLock<FoundPairs>,
    /// Whether anybody has read what is written.
    is_read: AtomicBool,
    room: Mutex<WriteRoom>,
}

/// As much as fits into a line.
impl Debug for SphereLists {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> fmt::Result {
        let mut lists = formatter.debug_struct("SphereLists");
        lists.field("contacts", &self.found.reported).field("touching", &self.found.touching);
        lists.field("written", &self.written.get().is_some()).field("read", &self.is_read()).finish_non_exhaustive()
    }
}

/// Memory for what is written, and to bring pairs into its order.
#[derive(Default)]
struct WriteRoom {
    sorter: PairSorter,
    pairs: Vec<[u32; 2]>,
    written: FoundPairs,
}

impl WriteRoom {
    /// The triangles of contacts in the order that contacts are written in.
    fn order(
        &mut self,
        contacts: impl Iterator<Item = SphereContact>,
        same_surface: bool,
        share: &impl Share,
    ) -> &[[u32; 2]] {
        self.pairs.clear();
        self.pairs.extend(contacts.map(|contact| [contact.triangle_a, contact.triangle_b]));
        self.sorter.sort(&mut self.pairs, same_surface, share);
        &self.pairs
    }
}

impl SphereLists {
    /// Empties it, keeps the memory that it needed this time, and lets the spheres go.
    pub(super) fn clear(&mut self) {
        self.found.clear_room();
        self.known = None;
        *self.is_read.get_mut() = false;
        let pairs = self.pairs.take();
        self.pairs.put(pairs);
        let write_room = self.room.get_mut().unwrap_or_else(PoisonError::into_inner);
        match self.written.take() {
            Some(mut written) => {
                written.clear_room();
                capacity::clear(&mut write_room.pairs);
                write_room.written = written;
            }
            // Nobody reads any more.
            None => *write_room = WriteRoom::default(),
        }
    }

    /// Finds those of some pairs that pass by `find`. The contacts are written by `spheres` when somebody reads them, given that
    /// every pair is there once; without those, in this tick by `write`.
    pub(super) fn find(
        &mut self,
        sides: [Entity; 2],
        pairs: &[[u32; 2]],
        (spheres, settings): (Option<KeptSpheres>, PairSettings),
        (threads, buffers): (usize, &SphereBuffers),
        find: impl Fn(&[[u32; 2]], &mut PassedAndFound) + Sync,
        write: impl Fn(&[[u32; 2]], &mut FoundPairs) + Sync,
    ) {
        let mut found = (self.pairs.take(), mem::take(&mut self.found));
        append_chunks(pairs, threads, &buffers.found, &mut found, find, join);
        self.pairs.put(found.0);
        self.found = found.1;
        self.sides = Some(sides);
        self.known = spheres.map(|spheres| (spheres, settings));
        if self.known.is_some() {
            return;
        }
        let room = self.room.get_mut().unwrap_or_else(PoisonError::into_inner);
        let mut written = mem::take(&mut room.written);
        let pairs = room.order(self.found.contacts(&self.pairs), settings.same_surface, &Threads(threads));
        append_chunks(pairs, threads, &buffers.written, &mut written, write, FoundPairs::append_sorted);
        written.sort_touching();
        self.written = OnceLock::from(written);
    }

    /// Whether anybody has read the contacts, or which pairs touch.
    pub(super) fn is_read(&self) -> bool {
        self.is_read.load(Ordering::Relaxed)
    }

    /// The pairs that passed.
    pub(super) fn pairs(&self) -> &SharedList<[u32; 2]> {
        &self.pairs
    }

    /// Distance of the nearest pair, see [`FoundSpheres::nearest`].
    pub(super) fn nearest(&self) -> f64 {
        self.found.nearest
    }

    /// The contacts as they were found, in the order of the candidates.
    pub(crate) fn contacts(&self) -> impl Iterator<Item = SphereContact> {
        self.found.contacts(&self.pairs)
    }

    fn read(&self) -> &FoundPairs {
        if !self.is_read() {
            self.is_read.store(true, Ordering::Relaxed);
        }
        self.written.get_or_init(|| {
            let mut room = self.room.lock().unwrap_or_else(PoisonError::into_inner);
            let mut written = mem::take(&mut room.written);
            if let Some((spheres, settings)) = &self.known {
                let pairs = room.order(self.contacts(), settings.same_surface, &OneByOne);
                spheres.write(pairs, settings, &mut written);
                written.sort_touching();
            }
            written
        })
    }
}

impl Deferred<CompactContact> for SphereLists {
    fn len(&self) -> usize {
        self.written.get().map_or(self.found.reported, |written| written.contacts.len())
    }

    fn list(&self) -> &Vec<CompactContact> {
        &self.read().contacts
    }

    fn written(&self) -> Option<&Vec<CompactContact>> {
        self.written.get().map(|written| &written.contacts)
    }
}

impl Deferred<TouchingPair> for SphereLists {
    fn len(&self) -> usize {
        self.written.get().map_or(self.found.touching, |written| written.touching.len())
    }

    fn list(&self) -> &Vec<TouchingPair> {
        &self.read().touching
    }

    fn written(&self) -> Option<&Vec<TouchingPair>> {
        self.written.get().map(|written| &written.touching)
    }
}
