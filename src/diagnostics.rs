//! What each stage of the last tick cost, and what was reused. Every stage adds its entry when it ends.

use core::time::Duration;

use bevy_ecs::prelude::*;
use bevy_platform::time::Instant;
#[cfg(feature = "reflect")]
use bevy_reflect::prelude::*;

use crate::kernel::spatial_hash::HashCounts;

/// Measures how long a stage takes. With the feature `trace`, there is a span for as long as it exists.
pub(crate) struct StageWatch {
    name: &'static str,
    start: Instant,
    #[cfg(feature = "trace")]
    _span: tracing::span::EnteredSpan,
}

impl StageWatch {
    pub(crate) fn start(name: &'static str) -> Self {
        Self {
            name,
            start: Instant::now(),
            #[cfg(feature = "trace")]
            _span: tracing::info_span!("collision stage", name).entered(),
        }
    }

    pub(crate) fn elapsed(&self) -> Duration {
        self.start.elapsed()
    }

    /// Ends the stage, and returns how long it took.
    pub(crate) fn stop(self) -> Duration {
        self.elapsed()
    }

    /// The same watch as if it had been started later.
    pub(crate) fn without(self, duration: Duration) -> Self {
        Self { start: self.start + duration, ..self }
    }
}

/// One stage of the last tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Clone, Debug, PartialEq))]
pub struct StageDiagnostics {
    /// The stage's name.
    pub name: &'static str,
    /// How long it took.
    pub duration: Duration,
    /// The number of pairs that went in. For the broad phase: pairs of triangles whose boxes overlap, without neighbors
    /// in a self-collision. If it follows a list of an earlier tick: the pairs on that list.
    pub pairs_in: usize,
    /// The number of pairs that came out. For the broad phase: candidate pairs. For the swept stage: impacts. For the
    /// last stage: contacts.
    pub pairs_out: usize,
}

/// The last tick, stage by stage in the order they ran. A stage that no surface needed is not listed.
#[derive(Resource, Clone, Debug, Default)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Resource, Clone, Debug, Default))]
pub struct DetectionDiagnostics {
    /// The stages.
    pub stages: Vec<StageDiagnostics>,
    /// Surfaces whose triangles have not moved in their own frame since the last detection. Their boxes and trees, if
    /// any, were kept.
    pub surfaces_unmoved: usize,
    /// Pairs of surfaces that have not changed since the last detection. Their results were reused, and the stages do
    /// not count them.
    pub pairs_kept: usize,
    /// Pairs of surfaces that have moved so little that their candidates came from a list of an earlier tick.
    pub lists_reused: usize,
    /// Pairs of surfaces for which such a list was made in this tick.
    pub lists_made: usize,
    /// Pairs of triangles on the lists of earlier ticks that were skipped. Their remembered distance, less the motion
    /// of the surfaces since, still exceeds the range, or else a slab still separates them by more than the range.
    pub pairs_passed_over: usize,
    /// Triangles whose recipe was made anew.
    pub recipes_refreshed: usize,
    /// Pairs that reached the exact test: candidate pairs of the exact methods.
    pub pairs_examined: usize,
    /// Time of the first builds of surface trees. Later ticks do not need it.
    pub first_tree_builds: Duration,
    /// Trees that were rebuilt because they had decayed.
    pub trees_rebuilt: usize,
    /// Trees over swept triangles that were built or rebuilt in this tick. Fast surfaces, and surfaces that a fast one
    /// comes near, have such trees. Not counted in `first_tree_builds` and `trees_rebuilt`.
    pub swept_trees_built: usize,
    /// Trees over swept triangles that were refitted. Those of surfaces at rest are kept as they are.
    pub swept_trees_refitted: usize,
    /// Cells of spatial hashes that have triangles.
    pub occupied_cells: usize,
    /// Cells of spatial hashes with so many triangles that they were swept along an axis. Where there are many of them,
    /// the cells are too large.
    pub crowded_cells: usize,
    /// Triangles that are in no cell because they are much larger than the cells of a spatial hash.
    pub large_triangles: usize,
    tick_start: Option<Instant>,
    total: Duration,
}

impl DetectionDiagnostics {
    /// Time from the start of the first stage to the end of the last one, without first builds of trees.
    #[must_use]
    pub fn total(&self) -> Duration {
        self.total
    }

    /// Begins a tick, unless `Prepare` has begun it. Detection may be run by hand, without `Prepare`.
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

    pub(crate) fn count_cells(&mut self, counts: &HashCounts) {
        self.occupied_cells += counts.occupied_cells;
        self.crowded_cells += counts.crowded_cells;
        self.large_triangles += counts.large_boxes;
    }

    pub(crate) fn finish(&mut self, watch: StageWatch, pairs_in: usize, pairs_out: usize) {
        self.stages.push(StageDiagnostics { name: watch.name, duration: watch.stop(), pairs_in, pairs_out });
        self.total =
            self.tick_start.map_or(Duration::ZERO, |begin| begin.elapsed()).saturating_sub(self.first_tree_builds);
    }
}
