//! Lists of near pairs: candidates that are kept from tick to tick while meshes move a little.
//!
//! A list holds the pairs of triangles within the range plus a *skin*, see
//! [`bounded_pairs`](crate::kernel::bvh::near_pairs). Until the surfaces have moved by the skin, no other pair can come
//! within range, so neither boxes nor trees are needed. When the motion has used up a pair's bound, the broad phase
//! looks for a gap between its triangles. If the gap is wide enough, the pair gets a new bound. The thickness of the
//! skin follows from the speed of the surfaces. If they are too fast for a list to pay off, there is none.
//!
//! Only for exact methods, whose results do not depend on which other pairs were examined, and only for surfaces in one
//! frame. The tree broad phase fills the lists, and the exact test improves their bounds.

use std::collections::HashMap;

use bevy_ecs::prelude::*;

use crate::{
    detection::{
        pairs::{CandidateTrianglePairs, OtherSide, SurfacePair},
        parallel::Threads,
        reuse::DetectionMemory,
        state::SurfaceState,
    },
    diagnostics::DetectionDiagnostics,
    kernel::{
        bvh::near_pairs::{BoundedPairs, ListedTriangles},
        capacity,
    },
    settings::CircumsphereSettings,
    surface::{ActiveSurfaces, ContactMethod, SurfaceShape},
};

/// Lists are made if the surfaces move by at most this share of the range per tick. With faster ones, so many pairs
/// must be tested after a tick that little is saved.
const SLOW: f64 = 0.4;

/// The number of ticks that a list should last at constant speed.
const LIFE: f64 = 16.0;

/// Largest thickness of the skin, as a share of the range. Lists grow with it, and so does the time to make them.
const THICKEST: f64 = 1.0;

/// Bounds, and their sums with a motion (which is less than the range), are f32. Each is off by some units in the last
/// place of twice the range, 1.2e-7 each.
const ROUNDING: f64 = 1.0e-5;

/// Upper bound, relative to the extent of both surfaces, of the distance that the exact test still takes for touching
/// or crossing: 1e-13 due to rounding, 1e-10 where an edge may pierce a face.
const ROUND_OFF: f64 = 1.0e-9;

/// What a reused list saves and costs, in nanoseconds on one thread of one machine. Affects time, never results.
/// Saved: pairs of overlapping boxes, and triangles of trees that would be refitted. Costs: pairs on the list, pairs
/// whose bound is inconclusive, and pairs that are tested in addition to those that would be tested anyway.
const BOX_PAIR: usize = 10;
const TREE_TRIANGLE: usize = 25;
const LISTED_PAIR: usize = 1;
const GLANCED_PAIR: usize = 25;
const EXAMINED_PAIR: usize = 100;

/// After n lists in a row that were not worth it, 2^n slow ticks must pass before the next one. This is the largest n.
const MOST_PATIENCE: u32 = 6;

/// How a pair of surfaces uses its list in this detection.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(in crate::detection) enum ListUse {
    /// Not at all: candidates are found without a list, or the pair has not changed.
    #[default]
    None,
    /// The list is made.
    Made,
    /// The candidates are taken from the list.
    Reused,
}

/// The list of a pair of surfaces, and its history. Lengths are in the unit of the pair's frame.
#[derive(Debug, Default)]
pub(in crate::detection) struct KeptList {
    surfaces: Option<[Entity; 2]>,
    /// The versions of both surfaces when their motion was last read.
    versions: [u64; 2],
    range: f64,
    pub(in crate::detection) list_use: ListUse,
    /// Whether there is a list.
    is_made: bool,
    /// Whether the candidates were taken from the list.
    is_followed: bool,
    skin: f32,
    /// How far the surfaces have moved since the list was made.
    motion: f64,
    /// Pairs with bounds up to this may be within the range.
    pub(in crate::detection) limit: f32,
    /// The limit in the last detection that used the list.
    last_limit: f32,
    /// The number of overlapping pairs of boxes when the list was made.
    pub(in crate::detection) looked_at: usize,
    /// The number of its pairs that were tested then.
    examined_at_first: usize,
    /// Whether the list cost more than it saved when it was last used.
    is_too_long: bool,
    /// The number of ticks in which the list was reused.
    served: u32,
    /// The number of lists in a row that were not worth it.
    wasted: u32,
    /// The number of slow ticks in a row.
    slow_ticks: u32,
    pub(in crate::detection) pairs: BoundedPairs,
    /// The candidates of this detection, before the pair takes them.
    pub(in crate::detection) near: Vec<[u32; 2]>,
    /// Their indices in the list.
    near_places: Vec<u32>,
}

/// The lists of near pairs of all pairs of surfaces, see [`memory`](field@CircumsphereSettings::memory). A list takes
/// 12 bytes per pair of triangles for its numbers and a bound of its distance, and 4 bytes for the index of each pair
/// that is tested.
#[doc(hidden)]
#[derive(Resource, Debug, Default)]
pub struct KeptPairs {
    /// One for each of [`CandidateTrianglePairs`]. Empty if the pair has no list.
    pub(in crate::detection) lists: Vec<KeptList>,
    last: Vec<KeptList>,
    places: HashMap<[Entity; 2], usize>,
}

impl KeptList {
    /// The thickness of the skin that the list is made with.
    pub(in crate::detection) fn skin(&self) -> f32 {
        self.skin
    }

    fn give_up(&mut self) {
        if self.is_made {
            self.wasted = if self.served == 0 || self.is_too_long { self.wasted + 1 } else { 0 };
            self.slow_ticks = 0;
        }
        (self.is_made, self.is_followed, self.is_too_long) = (false, false, false);
        self.pairs.clear_room();
        capacity::clear(&mut self.near);
        capacity::clear(&mut self.near_places);
    }

    /// Decides how to use the list in this detection. `motion` is the motion since the last detection, and `slack`
    /// bounds the error of distances.
    fn decide(&mut self, range: f64, motion: f64, slack: f64) {
        let is_slow = motion <= SLOW * range;
        let moved = self.motion + motion;
        let is_valid = self.is_made && self.range == range && moved + slack <= f64::from(self.skin);
        self.list_use = if is_valid && !self.is_too_long {
            self.motion = moved;
            self.served += 1;
            ListUse::Reused
        } else {
            self.give_up();
            self.slow_ticks = if is_slow { self.slow_ticks.saturating_add(1) } else { 0 };
            if is_slow && motion > 0.0 && self.slow_ticks >> self.wasted.min(MOST_PATIENCE) > 0 {
                (self.range, self.skin) = (range, (LIFE * motion).min(THICKEST * range) as f32);
                (self.motion, self.served, self.is_made) = (0.0, 0, true);
                ListUse::Made
            } else {
                ListUse::None
            }
        };
        self.is_followed = self.list_use == ListUse::Reused;
        self.limit = (self.motion + range + slack) as f32;
    }

    /// Looks for gaps between the triangles of pairs whose bound is inconclusive. Returns the number of those pairs.
    pub(in crate::detection) fn look_closer(&mut self, triangles: &ListedTriangles<'_>, threads: usize) -> usize {
        self.pairs.look_closer(&Threads(threads), triangles, [self.last_limit, self.limit], self.motion as f32)
    }

    /// Finds the candidates in a list that is made or reused, and whether the list is worth it. `triangles` is the
    /// number of triangles of both surfaces. `glanced_at` is the number of pairs that
    /// [`look_closer`](Self::look_closer) returned.
    pub(in crate::detection) fn find_near(&mut self, triangles: usize, glanced_at: usize) {
        self.last_limit = self.limit;
        capacity::clear(&mut self.near);
        capacity::clear(&mut self.near_places);
        self.pairs.append_near(self.limit, &mut self.near, &mut self.near_places);
        if self.list_use == ListUse::Made {
            self.examined_at_first = self.near.len();
        }
        let saved = BOX_PAIR * self.looked_at + TREE_TRIANGLE * triangles;
        let more = self.near.len().saturating_sub(self.examined_at_first);
        let spent = LISTED_PAIR * self.pairs.len() + GLANCED_PAIR * glanced_at + EXAMINED_PAIR * more;
        self.is_too_long = spent > saved;
    }

    /// Stores lower bounds of the candidates' distances.
    fn learn(&mut self, found: &[f32]) {
        if self.list_use != ListUse::None {
            self.pairs.learn(&self.near_places, self.motion as f32, found);
        }
    }
}

impl KeptPairs {
    /// The number of pairs of triangles in all lists.
    #[must_use]
    pub fn listed(&self) -> usize {
        self.lists.iter().map(|list| list.pairs.len()).sum()
    }

    /// How a pair of surfaces uses its list in this detection.
    pub(in crate::detection) fn list_use(&self, place: usize) -> ListUse {
        self.lists.get(place).map_or(ListUse::None, |list| list.list_use)
    }

    /// All pairs on the list of a pair of surfaces, if its candidates were taken from the list.
    pub(in crate::detection) fn reused(&self, place: usize) -> Option<impl Iterator<Item = [u32; 2]> + '_> {
        self.lists.get(place).filter(|list| list.is_followed).map(|list| list.pairs.pairs())
    }

    /// Stores lower bounds of the distances of a pair's candidates in its list.
    pub(in crate::detection) fn learn(&mut self, place: usize, found: &[f32]) {
        if let Some(list) = self.lists.get_mut(place) {
            list.learn(found);
        }
    }

    /// Counts the lists that are reused or made, and the pairs of triangles that reused lists skip.
    pub(in crate::detection) fn count(&self, diagnostics: &mut DetectionDiagnostics) {
        let used = |list_use: ListUse| self.lists.iter().filter(move |list| list.list_use == list_use);
        diagnostics.lists_reused = used(ListUse::Reused).count();
        diagnostics.lists_made = used(ListUse::Made).count();
        diagnostics.pairs_passed_over = used(ListUse::Reused).map(|list| list.pairs.len() - list.near.len()).sum();
    }

    /// Moves the candidates into the pairs.
    pub(in crate::detection) fn hand_over(&mut self, pairs: &mut [SurfacePair]) {
        for (list, pair) in self.lists.iter_mut().zip(pairs).filter(|(list, _)| list.list_use != ListUse::None) {
            std::mem::swap(&mut list.near, &mut pair.triangles);
        }
    }

    /// Keeps the candidates of a pair that `stays` returns true for, wherever they come from.
    pub(in crate::detection) fn retain_near(
        &mut self,
        place: usize,
        triangles: &mut Vec<[u32; 2]>,
        stays: impl Fn([u32; 2]) -> bool,
    ) {
        let list = self.lists.get_mut(place).filter(|list| list.list_use != ListUse::None);
        let Some(KeptList { near_places, .. }) = list else {
            triangles.retain(|pair| stays(*pair));
            return;
        };
        // Both lists are in the same order, and stay so.
        let mut are_staying = triangles.iter().map(|pair| stays(*pair)).collect::<Vec<_>>().into_iter();
        near_places.retain(|_| are_staying.next().unwrap_or(false));
        triangles.retain(|pair| stays(*pair));
    }

    /// Begins a detection: finds the lists of its pairs, and decides how to use them.
    pub(in crate::detection) fn begin(
        &mut self,
        active: &ActiveSurfaces,
        candidates: &CandidateTrianglePairs,
        settings: &CircumsphereSettings,
        memory: &DetectionMemory,
        states: &[SurfaceState],
    ) {
        let Self { lists, last, places } = self;
        std::mem::swap(lists, last);
        lists.clear();
        places.clear();
        if !settings.memory {
            last.clear();
        }
        let named = last.iter().enumerate().filter_map(|(place, list)| Some((list.surfaces?, place)));
        places.extend(named);
        for (place, pair) in candidates.pairs.iter().enumerate() {
            let sides = if settings.memory { sides_in_one_frame(active, pair) } else { None };
            let kept = sides.and_then(|sides| places.get(&sides)).map(|&place| std::mem::take(&mut last[place]));
            let mut list = kept.unwrap_or_default();
            list.surfaces = sides;
            list.list_use = ListUse::None;
            if sides.is_some() && !memory.keeps(place) {
                update(&mut list, active, pair, states);
            }
            lists.push(list);
        }
        last.clear();
        let count = lists.len();
        capacity::trim(last, count);
        capacity::trim(lists, count);
        if places.len() > count {
            // Entries of the last tick.
            places.clear();
            places.shrink_to(count);
        }
    }
}

/// Adds the motion of a pair's surfaces, and decides how to use the list.
fn update(list: &mut KeptList, active: &ActiveSurfaces, pair: &SurfacePair, states: &[SurfaceState]) {
    let OtherSide::Surface(other) = pair.second else { return };
    let [first, second] = [pair.first, other].map(|place| &states[place].bounds);
    let [before_first, before_second] = list.versions;
    let motion = first.motion_since(before_first).relative(&second.motion_since(before_second));
    list.versions = [first.version(), second.version()];
    let range = f64::from(pair.range) / pair.frame_pose.scale();
    let whole = first.whole().union(second.whole());
    let extent = f64::from((whole.max - whole.min).element_sum());
    let slack = ROUNDING * range + ROUND_OFF * extent;
    let is_fresh = active.surfaces[pair.first].fresh || active.surfaces[other].fresh;
    // Bounds need a range that is a normal f32.
    if is_fresh || !motion.is_finite() || !(range as f32).is_normal() || !extent.is_finite() {
        list.give_up();
        list.slow_ticks = 0;
        return;
    }
    list.decide(range, motion, slack);
}

/// The surfaces of a pair that may have a list. Its results must not depend on which pairs beyond the range are
/// examined, but they do where penetrations are resolved.
fn sides_in_one_frame(active: &ActiveSurfaces, pair: &SurfacePair) -> Option<[Entity; 2]> {
    let OtherSide::Surface(second) = pair.second else { return None };
    let sides = [&active.surfaces[pair.first], &active.surfaces[second]];
    let is_exact = matches!(pair.method, ContactMethod::Exact | ContactMethod::Closest);
    let resolves_penetrations = !pair.is_self() && sides.iter().any(|side| side.one_sided);
    // Patches also move with the normals of their corners, which no bound of the motion covers.
    let is_flat = sides.iter().all(|side| side.shape == SurfaceShape::Flat);
    (is_exact && is_flat && !pair.is_moved() && !resolves_penetrations).then(|| sides.map(|side| side.entity))
}
