//! Writes the rows of one tick, within its byte budget.
//!
//! A row carries its own time. The clock of the stream belongs to the caller that provided the stream, and is separate
//! for each thread.

use std::collections::{BTreeMap, HashSet};

use rerun::{
    AsComponents, EntityPath, EntityPathPart, RecordingStream, SerializedComponentBatch, TimePoint, archetypes::Clear,
    external::arrow::array::Array, log::PendingRow,
};

/// Upper bound of the overhead of a row with this many components if it is sent alone: the names of entity, timelines,
/// and components. Measured on files with two timelines and names of up to forty letters. Rows of consecutive ticks
/// within a fifth of a second share the overhead.
pub(super) const fn row_bytes(components: usize) -> usize {
    1800 + 640 * components
}

/// Size of the removal of an entity.
const CLEAR_BYTES: usize = row_bytes(1);

/// A layer of the recording. They are recorded in this order, the most important first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(super) enum Layer {
    Meshes,
    Shapes,
    Contacts,
    Penetrations,
    Patches,
    Tetrahedra,
    Pairs,
    Spheres,
    Cones,
    Curvature,
    RecipeAge,
    Tree,
    Cells,
}

impl Layer {
    /// The name of the layer's entity.
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Meshes => "meshes",
            Self::Shapes => "shapes",
            Self::Contacts => "contacts",
            Self::Penetrations => "penetrations",
            Self::Patches => "patches",
            Self::Tetrahedra => "tetrahedra",
            Self::Pairs => "pairs",
            Self::Spheres => "spheres",
            Self::Cones => "cones",
            Self::Curvature => "curvature",
            Self::RecipeAge => "recipe_age",
            Self::Tree => "tree",
            Self::Cells => "cells",
        }
    }
}

/// The path of an entity, from unescaped parts.
pub(super) fn path<'a>(parts: impl IntoIterator<Item = &'a str>) -> EntityPath {
    EntityPath::new(parts.into_iter().map(EntityPathPart::new).collect())
}

/// What the viewer still shows from previous ticks, if the next tick has to undo it.
#[derive(Default)]
pub(super) struct Shown {
    /// Entities whose last row is valid for one tick only.
    passing: HashSet<EntityPath>,
    /// The layers that were thinned in the last recorded tick.
    pub(super) thinned: BTreeMap<Layer, Thinned>,
}

/// How much of a layer was recorded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Thinned {
    pub(super) recorded: usize,
    pub(super) all: usize,
}

/// Writes the rows of one tick.
pub(super) struct TickWriter<'a> {
    stream: &'a RecordingStream,
    time: TimePoint,
    left: usize,
    shown: &'a mut Shown,
    passing: HashSet<EntityPath>,
    thinned: BTreeMap<Layer, Thinned>,
}

/// An even share of all lists of a layer.
#[derive(Clone, Debug)]
pub(super) struct Share {
    recorded: usize,
    all: usize,
    /// Number of instances in the lists so far.
    passed: usize,
}

impl Share {
    /// The indices to record in the layer's next list, which has `count` instances.
    pub(super) fn places(&mut self, count: usize) -> Vec<usize> {
        let Self { recorded, all, passed } = *self;
        self.passed += count;
        // Record each instance at which the running share reaches the next integer.
        let before = |instance: usize| instance as u128 * recorded as u128 / all.max(1) as u128;
        (0..count).filter(|place| before(passed + place + 1) > before(passed + place)).collect()
    }
}

impl<'a> TickWriter<'a> {
    pub(super) fn new(stream: &'a RecordingStream, time: TimePoint, budget: usize, shown: &'a mut Shown) -> Self {
        // Everything that is shown and not written again has to be cleared in any case.
        let left = budget.saturating_sub(shown.passing.len() * CLEAR_BYTES);
        Self { stream, time, left, shown, passing: HashSet::new(), thinned: BTreeMap::new() }
    }

    /// Writes a row that is valid until the next row of its entity.
    pub(super) fn row(&mut self, path: EntityPath, archetypes: &[&dyn AsComponents]) {
        let batches: Vec<SerializedComponentBatch> =
            archetypes.iter().flat_map(|archetype| archetype.as_serialized_batches()).collect();
        self.left = self.left.saturating_sub(row_bytes(batches.len()) + batches.iter().map(bytes).sum::<usize>());
        self.stream.record_row(path, PendingRow::from_iter(self.time.clone(), batches), false);
    }

    /// Writes a row that is valid for all ticks.
    pub(super) fn timeless_row(&mut self, path: EntityPath, archetype: &dyn AsComponents) {
        self.stream.record_row(
            path,
            PendingRow::from_iter(TimePoint::default(), archetype.as_serialized_batches()),
            false,
        );
    }

    /// Writes a row that is valid for this tick only.
    pub(super) fn passing_row(&mut self, path: EntityPath, archetypes: &[&dyn AsComponents]) {
        if self.shown.passing.contains(&path) {
            self.left += CLEAR_BYTES;
        }
        self.passing.insert(path.clone());
        self.row(path, archetypes);
    }

    /// Removes an entity and everything below it.
    pub(super) fn remove(&mut self, path: EntityPath) {
        self.row(path, &[&Clear::recursive()]);
    }

    /// Whether a row that cannot be thinned fits into the budget. If not, it counts as left out.
    pub(super) fn fits(&mut self, layer: Layer, bytes: usize, components: usize) -> bool {
        let fits = bytes + row_bytes(components) <= self.left;
        let thinned = self.thinned.entry(layer).or_default();
        thinned.all += 1;
        thinned.recorded += usize::from(fits);
        fits
    }

    /// How many of `count` instances, each of `bytes_each` bytes and in `lists` lists, fit into the budget. A list with
    /// at least one recorded instance costs `row_bytes` more.
    pub(super) fn share(
        &mut self,
        layer: Layer,
        count: usize,
        bytes_each: usize,
        lists: usize,
        row_bytes: usize,
    ) -> Share {
        let fits_whole = lists * row_bytes + count * bytes_each <= self.left;
        // A layer that has to be thinned leaves budget for later layers: a quarter for contacts and penetrations,
        // otherwise half.
        let available = match layer {
            _ if fits_whole => self.left,
            Layer::Contacts | Layer::Penetrations => self.left / 4 * 3,
            _ => self.left / 2,
        };
        let in_all_lists = available.saturating_sub(lists * row_bytes) / bytes_each;
        // If there are fewer instances than lists, each is in a list of its own.
        let recorded = count.min(in_all_lists.max(lists.min(available / (bytes_each + row_bytes))));
        let thinned = self.thinned.entry(layer).or_default();
        thinned.all += count;
        thinned.recorded += recorded;
        Share { recorded, all: count, passed: 0 }
    }

    /// Removes entities that were shown in the last tick and not in this one. Returns the layers that are thinned in
    /// this tick and were not in the last one.
    pub(super) fn finish(mut self) -> Vec<(Layer, Thinned)> {
        let passing = std::mem::take(&mut self.passing);
        let mut gone: Vec<EntityPath> = self.shown.passing.difference(&passing).cloned().collect();
        gone.sort_unstable();
        for path in gone {
            self.row(path, &[&Clear::flat()]);
        }
        self.shown.passing = passing;
        self.thinned.retain(|_, thinned| thinned.recorded < thinned.all);
        let new = |(layer, _): &(&Layer, &Thinned)| !self.shown.thinned.contains_key(layer);
        let newly = self.thinned.iter().filter(new).map(|(&layer, &thinned)| (layer, thinned)).collect();
        self.shown.thinned = self.thinned;
        newly
    }
}

fn bytes(batch: &SerializedComponentBatch) -> usize {
    batch.array.to_data().get_slice_memory_size().unwrap_or_else(|_| batch.array.get_array_memory_size())
}
