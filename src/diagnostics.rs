//! What each stage cost and kept in the last tick.

use std::time::{Duration, Instant};

use bevy_ecs::prelude::*;

/// One stage of the last tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StageDiagnostics {
    /// The stage's name.
    pub name: &'static str,
    /// How long it took.
    pub duration: Duration,
    /// Pairs it was given; of the broad phase: pairs of triangles whose boxes overlap, in a self-collision those that share a
    /// vertex left out, and where a list of an earlier tick is followed those on it.
    pub pairs_in: usize,
    /// Pairs it passed on; of the broad phase: candidates; of the swept stage: impacts; of the last stage: contacts.
    pub pairs_out: usize,
}

/// What the last tick did, stage by stage in the order they ran. A stage that no surface needed is not listed.
#[derive(Resource, Clone, Debug, Default)]
pub struct DetectionDiagnostics {
    /// The stages.
    pub stages: Vec<StageDiagnostics>,
    /// Surfaces whose triangles are where they were in the last detection, in their own frame: their boxes and trees, if
    /// they have any, were kept.
    pub surfaces_unmoved: usize,
    /// Pairs of surfaces that are as they were in the last detection: what was found of them was kept, and the stages
    /// count none of it.
    pub pairs_kept: usize,
    /// Pairs of surfaces that have moved so little that their candidates came from a list of an earlier tick.
    pub lists_followed: usize,
    /// Pairs of surfaces that such a list was made for in this tick.
    pub lists_made: usize,
    /// Pairs of triangles on the lists of earlier ticks that were passed over: what is remembered of their distances, less
    /// what the surfaces have moved since, still exceeds the range, or else a slab keeps them farther apart.
    pub pairs_passed_over: usize,
    /// Triangles whose sphere was made anew.
    pub recipes_refreshed: usize,
    /// Pairs that reached the exact test: candidates of the methods that are exact.
    pub pairs_examined: usize,
    /// First builds of a surface's tree, which its later ticks do without.
    pub first_tree_builds: Duration,
    /// Trees built anew because the mesh had outgrown them.
    pub trees_rebuilt: usize,
    /// Trees over what triangles sweep that were built in this tick, for the first time or anew: of surfaces that a fast
    /// one comes near, or that are fast. Not among the first builds and rebuilds above.
    pub swept_trees_built: usize,
    /// Such trees that have followed their boxes. Those of surfaces at rest are kept as they are.
    pub swept_trees_refitted: usize,
    tick_start: Option<Instant>,
    total: Duration,
}

impl DetectionDiagnostics {
    /// From the first stage's start to the last one's end, first builds of trees left out.
    #[must_use]
    pub fn total(&self) -> Duration {
        self.total
    }

    /// Begins a tick, unless it has begun in `Prepare`: detection may be run by hand.
    pub(crate) fn begin_detection(&mut self) {
        if self.stages.iter().any(|stage| stage.name == Self::FIRST_DETECTION_STAGE) {
            self.begin_tick();
        }
    }

    pub(crate) const FIRST_DETECTION_STAGE: &str = "bounds";

    pub(crate) fn begin_tick(&mut self) {
        *self = Self { stages: std::mem::take(&mut self.stages), tick_start: Some(Instant::now()), ..Self::default() };
        self.stages.clear();
    }

    pub(crate) fn finish(&mut self, name: &'static str, start: Instant, pairs_in: usize, pairs_out: usize) {
        self.stages.push(StageDiagnostics { name, duration: start.elapsed(), pairs_in, pairs_out });
        self.total =
            self.tick_start.map_or(Duration::ZERO, |begin| begin.elapsed()).saturating_sub(self.first_tree_builds);
    }
}
