//! Contacts by spheres, for the overlap and cone stages: which pairs of triangles are in contact and how far apart they
//! are and, if points are requested, the contacts themselves.

use crate::{
    detection::{
        pair_contacts::SharedList,
        parallel::{Buffers, Threads, append_chunks},
    },
    kernel::{
        exact::pair_order::PairSorter,
        pair::{FoundPairs, PairSettings},
        spheres::contacts::{FoundSpheres, SphereContact},
    },
};

/// Pairs that passed the test of a stage, and what was found about them.
pub(in crate::detection) type PassedAndFound = (Vec<[u32; 2]>, FoundSpheres);

/// The test of a sphere stage, and how it writes the contacts of pairs that pass.
pub(in crate::detection) trait SphereTests: Sync {
    /// Appends the pairs that pass, and their distances.
    fn find(&self, pairs: &[[u32; 2]], found: &mut PassedAndFound);

    /// Appends the contacts of pairs that passed.
    fn write(&self, pairs: &[[u32; 2]], found: &mut FoundPairs);
}

/// Appends the results of a later part.
fn join((passed, found): &mut PassedAndFound, (later, later_found): &mut PassedAndFound) {
    passed.append(later);
    found.append(later_found);
}

/// The results of a sphere method for a pair of surfaces.
#[derive(Clone, Debug, Default)]
pub(crate) struct FoundBySpheres {
    /// Pairs that passed, in the order of the candidates.
    pub(in crate::detection) pairs: SharedList<[u32; 2]>,
    /// Their distances. Infinite if a pair is too far apart to be reported.
    distances: SharedList<f32>,
    /// The number of reported pairs.
    pub(crate) reported: usize,
    /// The number of touching pairs.
    pub(crate) touching: usize,
}

impl FoundBySpheres {
    /// Takes the memory of these lists, or of the `other` ones if these are shared.
    pub(in crate::detection) fn reuse(&mut self, other: &mut Self) -> PassedAndFound {
        let pairs = self.pairs.take_memory(&mut other.pairs);
        let distances = self.distances.take_memory(&mut other.distances);
        (pairs, FoundSpheres { distances, ..FoundSpheres::default() })
    }

    pub(in crate::detection) fn put(
        &mut self,
        (pairs, FoundSpheres { distances, reported, touching, .. }): PassedAndFound,
    ) {
        self.pairs.put(pairs);
        self.distances.put(distances);
        (self.reported, self.touching) = (reported, touching);
    }

    /// The pairs that are in contact, in the order of the candidates.
    pub(crate) fn contacts(&self) -> impl Iterator<Item = SphereContact> {
        SphereContact::listed(&self.pairs, &self.distances)
    }
}

/// Memory of a stage that finds contacts by spheres.
#[derive(Default)]
pub(in crate::detection) struct SphereBuffers {
    found: Buffers<PassedAndFound>,
    written: Buffers<FoundPairs>,
}

/// Sorts contacts before they are written. Each pair of surfaces has its own, so the buffers fit the size of the pair.
#[derive(Clone, Debug, Default)]
pub(in crate::detection) struct Order {
    sorter: PairSorter,
    pairs: Vec<[u32; 2]>,
}

impl SphereBuffers {
    /// Frees all memory, when no pair is tested by spheres.
    pub(in crate::detection) fn clear(&self) {
        self.found.clear();
        self.written.clear();
    }

    /// Finds which pairs pass. Reuses the memory of `found`.
    pub(in crate::detection) fn find(
        &self,
        mut found: PassedAndFound,
        pairs: &[[u32; 2]],
        threads: usize,
        tests: &impl SphereTests,
    ) -> PassedAndFound {
        append_chunks(pairs, threads, &self.found, &mut found, |chunk, found| tests.find(chunk, found), join);
        found
    }

    /// Appends the contacts of what was found, sorted by their triangles.
    pub(in crate::detection) fn write(
        &self,
        (passed, found): &PassedAndFound,
        settings: &PairSettings,
        threads: usize,
        tests: &impl SphereTests,
        Order { sorter, pairs }: &mut Order,
        written: &mut FoundPairs,
    ) {
        pairs.clear();
        pairs.extend(found.contacts(passed).map(|contact| [contact.triangle_a, contact.triangle_b]));
        sorter.sort(pairs, settings.same_surface, &Threads(threads));
        let write = |chunk: &[[u32; 2]], found: &mut FoundPairs| tests.write(chunk, found);
        append_chunks(pairs, threads, &self.written, written, write, FoundPairs::append_sorted);
        written.sort_touching();
    }
}
