//! Candidate lists that outlive the tick they were found in, for meshes that move a little.
//!
//! A list holds the pairs of triangles that are within the range and a *skin* of it, see
//! [`bounded_pairs`](crate::kernel::bvh::near_pairs). As long as the surfaces have moved by less than the skin, no other pair
//! can have come within range: neither boxes nor trees are asked. Where the motion has used up what a pair's bound had beyond
//! the range, the broad phase looks for a gap between its triangles, and where that is wide enough the pair goes on with a
//! new bound. How thick the skin is follows from how fast the surfaces move; where they are too fast for a list to pay, there
//! is none. Only for exact methods, whose results do not depend on which other pairs were looked at, and only where both
//! surfaces are in one frame. Filled by the broad phase by trees, taught by the exact test.

use std::collections::HashMap;

use bevy_ecs::prelude::*;

use super::{
    broad_phase::{CandidateTrianglePairs, OtherSide, SurfacePair},
    memory::DetectionMemory,
    parallel::Threads,
    state::SurfaceState,
};
use crate::{
    diagnostics::DetectionDiagnostics,
    kernel::{
        bvh::near_pairs::{BoundedPairs, ListedTriangles},
        capacity,
    },
    settings::CircumsphereSettings,
    surface::{ActiveSurfaces, ContactMethod},
};

/// Lists are made where a tick moves the surfaces by no more than this share of the range: of faster ones so many pairs
/// have to be tested after a tick that too little is saved.
const SLOW: f64 = 0.4;

/// How many ticks of the same speed a list is to serve.
const LIFE: f64 = 16.0;

/// No skin is thicker than this share of the range: lists grow with it, and so does the time to make them.
const THICKEST: f64 = 1.0;

/// Bounds and their sums with a motion, which is less than the range, are f32: they are off by some units in the last place
/// of twice the range, 1.2e-7 each.
const ROUNDING: f64 = 1.0e-5;

/// The exact test takes what is this close, relative to the extent of both surfaces, for touching or crossing: 1e-13 of
/// what is apart by rounding, 1e-10 where an edge may pierce a face.
const ROUND_OFF: f64 = 1.0e-9;

/// What a followed list saves and costs, in nanoseconds on one thread of one machine: it decides about time, never about
/// results. Saved are a pair of overlapping boxes and a triangle of a tree that is refitted; a pair on the list costs, one of
/// which the bound no longer tells, and one that is tested beyond those that would be anyway.
const BOX_PAIR: usize = 10;
const TREE_TRIANGLE: usize = 25;
const LISTED_PAIR: usize = 1;
const GLANCED_PAIR: usize = 25;
const EXAMINED_PAIR: usize = 100;

/// After lists that served no tick, as many slow ticks as this power of two have to pass before the next one.
const MOST_PATIENCE: u32 = 6;

/// What a pair of surfaces does in this detection.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum ListUse {
    /// It is found without a list, or nothing about it has changed.
    #[default]
    None,
    /// Its list is made.
    Made,
    /// It goes by its list.
    Followed,
}

/// What is kept of a pair of surfaces. Lengths are in the unit of the pair's frame.
#[derive(Debug, Default)]
pub(super) struct KeptList {
    surfaces: Option<[Entity; 2]>,
    /// The versions of both when their motion was last looked at.
    versions: [u64; 2],
    range: f64,
    pub(super) list_use: ListUse,
    /// Whether there is a list.
    is_made: bool,
    /// Whether the candidates are what the list left of itself.
    is_followed: bool,
    skin: f32,
    /// How far the surfaces have moved since the list was made.
    motion: f64,
    /// Pairs with bounds up to this may be within the range.
    pub(super) limit: f32,
    /// The same in the last detection that the list was asked in.
    last_limit: f32,
    /// How many pairs of boxes were looked at when the list was made.
    pub(super) looked_at: usize,
    /// How many of its pairs were tested then.
    examined_at_first: usize,
    /// Whether the list cost more than it saved when it was followed last.
    is_too_long: bool,
    /// How many ticks the list has served.
    served: u32,
    /// How many lists were not worth it, one after the other.
    wasted: u32,
    /// How many slow ticks there have been, one after the other.
    slow_ticks: u32,
    pub(super) pairs: BoundedPairs,
    /// The candidates of this detection, on their way to the pair.
    pub(super) near: Vec<[u32; 2]>,
    /// Their places on the list.
    near_places: Vec<u32>,
}

/// The candidate lists of surfaces that move a little, see [`memory`](field@CircumsphereSettings::memory): of every pair of
/// triangles on them its numbers and a bound of its distance, 12 bytes, and of each that is tested its place, 4 bytes.
#[derive(Resource, Debug, Default)]
pub struct KeptPairs {
    /// One for each of [`CandidateTrianglePairs`]; empty where there is none.
    pub(super) lists: Vec<KeptList>,
    last: Vec<KeptList>,
    places: HashMap<[Entity; 2], usize>,
}

impl KeptList {
    /// The thickness of the skin that the list is made with.
    pub(super) fn skin(&self) -> f32 {
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

    /// Decides what to do in this detection, after `motion` since the last one; `slack` is what distances may be off by.
    fn decide(&mut self, range: f64, motion: f64, slack: f64) {
        let is_slow = motion <= SLOW * range;
        let moved = self.motion + motion;
        let is_valid = self.is_made && self.range == range && moved + slack <= f64::from(self.skin);
        self.list_use = if is_valid && !self.is_too_long {
            self.motion = moved;
            self.served += 1;
            ListUse::Followed
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
        self.is_followed = self.list_use == ListUse::Followed;
        self.limit = (self.motion + range + slack) as f32;
    }

    /// Looks at the triangles of pairs of which the bound no longer tells. Returns of how many.
    pub(super) fn look_closer(&mut self, triangles: &ListedTriangles<'_>, threads: usize) -> usize {
        self.pairs.look_closer(&Threads(threads), triangles, [self.last_limit, self.limit], self.motion as f32)
    }

    /// Finds the candidates on a list that is followed or new, and out whether it is worth it; `triangles` are those of both
    /// surfaces, and `glanced_at` are pairs that had to be [looked at](Self::look_closer).
    pub(super) fn find_near(&mut self, triangles: usize, glanced_at: usize) {
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

    /// Takes the lower bounds that were found of the candidates' distances.
    fn learn(&mut self, found: &[f32]) {
        if self.list_use != ListUse::None {
            self.pairs.learn(&self.near_places, self.motion as f32, found);
        }
    }
}

impl KeptPairs {
    /// How many pairs of triangles are listed.
    #[must_use]
    pub fn listed(&self) -> usize {
        self.lists.iter().map(|list| list.pairs.len()).sum()
    }

    /// What a pair of surfaces does with its list in this detection.
    pub(super) fn list_use(&self, place: usize) -> ListUse {
        self.lists.get(place).map_or(ListUse::None, |list| list.list_use)
    }

    /// The pairs on the list of a pair of surfaces, where its candidates are what the list left of itself.
    pub(super) fn followed(&self, place: usize) -> Option<impl Iterator<Item = [u32; 2]> + '_> {
        self.lists.get(place).filter(|list| list.is_followed).map(|list| list.pairs.pairs())
    }

    /// Teaches the list of a pair the lower bounds that were found of its candidates' distances.
    pub(super) fn learn(&mut self, place: usize, found: &[f32]) {
        if let Some(list) = self.lists.get_mut(place) {
            list.learn(found);
        }
    }

    /// How many pairs of surfaces go by their lists, how many pairs of triangles those pass over, and how many lists are
    /// made.
    pub(super) fn count(&self, diagnostics: &mut DetectionDiagnostics) {
        let used = |list_use: ListUse| self.lists.iter().filter(move |list| list.list_use == list_use);
        diagnostics.lists_followed = used(ListUse::Followed).count();
        diagnostics.lists_made = used(ListUse::Made).count();
        diagnostics.pairs_passed_over = used(ListUse::Followed).map(|list| list.pairs.len() - list.near.len()).sum();
    }

    /// Gives the pairs their candidates.
    pub(super) fn hand_over(&mut self, pairs: &mut [SurfacePair]) {
        for (list, pair) in self.lists.iter_mut().zip(pairs).filter(|(list, _)| list.list_use != ListUse::None) {
            std::mem::swap(&mut list.near, &mut pair.triangles);
        }
    }

    /// Begins a detection: finds the lists of its pairs, and decides what becomes of them.
    pub(super) fn begin(
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
            // Those of the last tick.
            places.clear();
            places.shrink_to(count);
        }
    }
}

/// Notes how the surfaces of a pair have moved, and decides what to do.
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
    // No list tells apart what is no normal number.
    if is_fresh || !motion.is_finite() || !(range as f32).is_normal() || !extent.is_finite() {
        list.give_up();
        list.slow_ticks = 0;
        return;
    }
    list.decide(range, motion, slack);
}

/// The surfaces of a pair that may have a list: one whose results do not depend on which pairs are looked at beyond those
/// within range. Where penetrations are settled they do.
fn sides_in_one_frame(active: &ActiveSurfaces, pair: &SurfacePair) -> Option<[Entity; 2]> {
    let OtherSide::Surface(second) = pair.second else { return None };
    let sides = [&active.surfaces[pair.first], &active.surfaces[second]];
    let is_exact = matches!(pair.method, ContactMethod::Exact | ContactMethod::Closest);
    let is_settled = !pair.is_self() && sides.iter().any(|side| side.one_sided);
    (is_exact && !pair.is_moved() && !is_settled).then(|| sides.map(|side| side.entity))
}
