//! Writes rows of one tick, within its budget of bytes.
//!
//! A row carries its own time: the stream's clock belongs to whoever handed it in, and to each thread apart.

use std::collections::{BTreeMap, HashSet};

use rerun::{
    AsComponents, EntityPath, EntityPathPart, RecordingStream, SerializedComponentBatch, TimePoint, archetypes::Clear,
    external::arrow::array::Array, log::PendingRow,
};

/// What a row of so many components takes beside its numbers where it is sent alone, at most: the names of entity,
/// timelines and components. Measured on files with two timelines and names of up to forty letters. Rows of ticks that
/// follow one another within a fifth of a second share it.
pub(super) const fn row_bytes(components: usize) -> usize {
    1800 + 640 * components
}

/// What it takes to remove an entity.
const CLEAR_BYTES: usize = row_bytes(1);

/// A layer of the recording, in the order in which they are recorded: those that can least be done without first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(super) enum Layer {
    Meshes,
    Shapes,
    Contacts,
    Penetrations,
    Pairs,
    Spheres,
    Cones,
    Curvature,
    RecipeAge,
    Tree,
}

impl Layer {
    /// The entity of the layer.
    pub(super) const fn name(self) -> &'static str {
        match self {
            Self::Meshes => "meshes",
            Self::Shapes => "shapes",
            Self::Contacts => "contacts",
            Self::Penetrations => "penetrations",
            Self::Pairs => "pairs",
            Self::Spheres => "spheres",
            Self::Cones => "cones",
            Self::Curvature => "curvature",
            Self::RecipeAge => "recipe_age",
            Self::Tree => "tree",
        }
    }
}

/// The path of an entity from its unescaped parts.
pub(super) fn path<'a>(parts: impl IntoIterator<Item = &'a str>) -> EntityPath {
    EntityPath::new(parts.into_iter().map(EntityPathPart::new).collect())
}

/// What the viewer shows of ticks before, as far as the next tick has to undo it.
#[derive(Default)]
pub(super) struct Shown {
    /// Entities whose last row holds for one tick only.
    passing: HashSet<EntityPath>,
    /// What was left out of layers in the last recorded tick.
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

/// The same share of every list of a layer, evenly spread over all of them.
#[derive(Clone, Debug)]
pub(super) struct Share {
    recorded: usize,
    all: usize,
    /// How many instances the lists so far had.
    passed: usize,
}

impl Share {
    /// The places in the layer's next list, of `count`, that are recorded.
    pub(super) fn places(&mut self, count: usize) -> Vec<usize> {
        let Self { recorded, all, passed } = *self;
        self.passed += count;
        // Each instance that lifts the running share to another whole number.
        let before = |instance: usize| instance as u128 * recorded as u128 / all.max(1) as u128;
        (0..count).filter(|place| before(passed + place + 1) > before(passed + place)).collect()
    }
}

impl<'a> TickWriter<'a> {
    pub(super) fn new(stream: &'a RecordingStream, time: TimePoint, budget: usize, shown: &'a mut Shown) -> Self {
        // What is shown and not written again has to be cleared, whatever happens.
        let left = budget.saturating_sub(shown.passing.len() * CLEAR_BYTES);
        Self { stream, time, left, shown, passing: HashSet::new(), thinned: BTreeMap::new() }
    }

    /// Writes a row that holds until the next one of its entity.
    pub(super) fn row(&mut self, path: EntityPath, archetypes: &[&dyn AsComponents]) {
        let batches: Vec<SerializedComponentBatch> =
            archetypes.iter().flat_map(|archetype| archetype.as_serialized_batches()).collect();
        self.left = self.left.saturating_sub(row_bytes(batches.len()) + batches.iter().map(bytes).sum::<usize>());
        self.stream.record_row(path, PendingRow::from_iter(self.time.clone(), batches), false);
    }

    /// Writes a row that holds for all ticks.
    pub(super) fn timeless_row(&mut self, path: EntityPath, archetype: &dyn AsComponents) {
        self.stream.record_row(
            path,
            PendingRow::from_iter(TimePoint::default(), archetype.as_serialized_batches()),
            false,
        );
    }

    /// Writes a row that holds for this tick only.
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

    /// Whether a row that cannot be thinned fits into the budget; counted as left out where it does not.
    pub(super) fn fits(&mut self, layer: Layer, bytes: usize, components: usize) -> bool {
        let fits = bytes + row_bytes(components) <= self.left;
        let thinned = self.thinned.entry(layer).or_default();
        thinned.all += 1;
        thinned.recorded += usize::from(fits);
        fits
    }

    /// How much of `count` instances of so many bytes, in that many lists, fits into the budget. A list of which
    /// something is recorded takes [`row_bytes`] of its rows.
    pub(super) fn share(
        &mut self,
        layer: Layer,
        count: usize,
        bytes_each: usize,
        lists: usize,
        row_bytes: usize,
    ) -> Share {
        let fits_whole = lists * row_bytes + count * bytes_each <= self.left;
        // What has to be thinned leaves something to the layers after it: contacts a quarter, others as much as they take.
        let available = match layer {
            _ if fits_whole => self.left,
            Layer::Contacts | Layer::Penetrations => self.left / 4 * 3,
            _ => self.left / 2,
        };
        let in_all_lists = available.saturating_sub(lists * row_bytes) / bytes_each;
        // With fewer instances than lists each is in a list of its own.
        let recorded = count.min(in_all_lists.max(lists.min(available / (bytes_each + row_bytes))));
        let thinned = self.thinned.entry(layer).or_default();
        thinned.all += count;
        thinned.recorded += recorded;
        Share { recorded, all: count, passed: 0 }
    }

    /// Removes what was shown in the last tick and is not in this one. Gives the layers of which other shares are
    /// recorded than in the last tick.
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
