//! The table of a spatial hash: filled in parts, paired in blocks.

use std::ops::Range;

use super::{
    block::Block,
    boxes::{Boxes, Sizes},
    cells::{Grids, Place, cells_between, hash},
    crowd::{Crowd, Group},
    entries::{ALL_AXES, Entry, Part, Slots},
};
use crate::kernel::{mesh::bounds::Aabb, simd::parallel::Parallel};

/// Boxes per part, at least, and the most parts.
const LEAST_PART: usize = 1024;
const MOST_PARTS: usize = 64;

/// Boxes for which another thread pays off.
const BOXES_OF_A_THREAD: usize = 2048;

/// Groups of eight boxes of a crowd that one task sweeps.
const SWEPT_AT_ONCE: usize = 64;

/// The grids of a hash.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum HashKind {
    /// One grid for all boxes.
    #[default]
    Uniform,
    /// A grid for every second power of two.
    Hierarchical,
}

/// What a hash is made of.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct HashSettings {
    /// Its grids.
    pub kind: HashKind,
    /// The side of a cell, or of the finest cells of a hierarchy, which are rounded up to a power of two. `None`, and
    /// whatever is not positive and finite, means that the boxes are measured: cells then have twice their mean size,
    /// and those of a hierarchy from 1/4096 of their mean size to 262,144 times that size.
    pub cell_size: Option<f32>,
}

impl HashSettings {
    /// The grids for boxes of these sizes.
    pub(super) fn grids(&self, sizes: &Sizes) -> Grids {
        let cell_size = self.cell_size.filter(|size| *size > 0.0 && size.is_finite());
        match self.kind {
            HashKind::Uniform => Grids::uniform(cell_size, sizes.mean()),
            HashKind::Hierarchical => Grids::hierarchical(cell_size, sizes.mean_exponent()),
        }
    }
}

/// What a hash had to do for its last pairs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct HashCounts {
    /// Cells that have boxes.
    pub occupied_cells: usize,
    /// Boxes in cells: each counts once for every cell that it is in.
    pub entries: usize,
    /// Cells with so many boxes that they were swept along an axis.
    pub crowded_cells: usize,
    /// Boxes that are in no cell because they are much larger than the cells.
    pub large_boxes: usize,
}

/// A piece of work that follows when all cells are filled.
#[derive(Clone, Copy, Debug)]
enum Job {
    /// Sweeps some groups of a block's crowd, or of the large boxes.
    Sweep { block: Option<usize>, crowd: usize, start: usize },
    /// Visits the cells of coarser levels, and the large boxes, with the boxes of a part.
    Visit { part: usize },
}

/// Finds pairs of overlapping boxes. Holds buffers that calls reuse, and no state.
#[derive(Debug, Default)]
pub struct SpatialHash {
    parts: Vec<Part>,
    blocks: Vec<Block>,
    large: Vec<Entry>,
    large_crowd: Crowd,
    large_groups: Vec<Group>,
    jobs: Vec<Job>,
    /// The pairs that each job has found.
    found: Vec<Vec<[u32; 2]>>,
    /// The most entries since the last [`rest`](Self::rest).
    peak: usize,
}

impl SpatialHash {
    /// Appends every pair of overlapping boxes of one list once, lower index first. A box with NaN, or with a minimum
    /// above its maximum, overlaps nothing. The order of the pairs depends on the boxes and settings only.
    pub fn self_pairs(
        &mut self,
        parallel: &impl Parallel,
        settings: &HashSettings,
        boxes: &[Aabb],
        pairs: &mut Vec<[u32; 2]>,
    ) -> HashCounts {
        self.pair(parallel, settings, Boxes { first: boxes, second: None }, pairs)
    }

    /// Appends every pair of overlapping boxes of two lists once, like [`self_pairs`](Self::self_pairs).
    pub fn pairs_between(
        &mut self,
        parallel: &impl Parallel,
        settings: &HashSettings,
        [first, second]: [&[Aabb]; 2],
        pairs: &mut Vec<[u32; 2]>,
    ) -> HashCounts {
        self.pair(parallel, settings, Boxes { first, second: Some(second) }, pairs)
    }

    /// Frees the buffers if all calls since the last one have used only a small share of them.
    pub fn rest(&mut self) {
        /// Parts and blocks hold entries three times, and lists grow by doubling.
        const MOST_ROOM: usize = 12;
        /// Room for so few entries is not worth freeing.
        const LEAST_ROOM: usize = 4096;
        let room: usize =
            self.parts.iter().map(Part::room).sum::<usize>() + self.blocks.iter().map(Block::room).sum::<usize>();
        if room > MOST_ROOM * self.peak + LEAST_ROOM {
            *self = Self::default();
        }
        self.peak = 0;
    }

    fn pair(
        &mut self,
        parallel: &impl Parallel,
        settings: &HashSettings,
        boxes: Boxes<'_>,
        pairs: &mut Vec<[u32; 2]>,
    ) -> HashCounts {
        let threads = boxes.len() / BOXES_OF_A_THREAD;
        let part = boxes.len().div_ceil(MOST_PARTS).max(LEAST_PART);
        let part_count = boxes.len().div_ceil(part);
        let items = |number: usize| number * part..((number + 1) * part).min(boxes.len());
        grow(&mut self.parts, part_count);
        let parts = &mut self.parts[..part_count];
        parallel.run_tasks(parts.iter_mut().enumerate(), threads, |(number, part)| {
            part.measure(&boxes, items(number));
        });
        let mut sizes = Sizes::default();
        for part in &*parts {
            sizes.add(&part.sizes);
        }
        let grids = settings.grids(&sizes);
        parallel.run_tasks(parts.iter_mut(), threads, |part| part.make_entries(&boxes, &sizes, &grids));

        let entries = parts.iter().map(Part::entry_count).sum();
        self.peak = self.peak.max(entries);
        let slots = Slots::for_entries(entries);
        let levels: [u32; 2] = parts.iter().fold([0; 2], |[a, b], part| [a | part.levels[0], b | part.levels[1]]);
        let is_visited = (levels[0] | levels[1]).count_ones() > 1;
        parallel.run_tasks(parts.iter_mut(), threads, |part| part.sort_by_block(slots));
        grow(&mut self.blocks, slots.blocks());
        let blocks = &mut self.blocks[..slots.blocks()];
        let parts = &*parts;
        parallel.run_tasks(blocks.iter_mut().enumerate(), threads, |(number, block)| {
            block.fill(number, parts, slots);
            block.pair_cells(&boxes, is_visited);
        });
        let blocks = &*blocks;

        self.large.clear();
        self.large_groups.clear();
        self.large.extend(parts.iter().flat_map(|part| &part.large).map(|&item| Entry::large(item)));
        self.large_crowd = Crowd::new(&mut self.large, 0, &boxes, &mut self.large_groups);
        let table = Table {
            boxes,
            grids,
            slots,
            levels: if boxes.is_own() { [levels[0]; 2] } else { [levels[1], levels[0]] },
            parts,
            blocks,
            large_groups: &self.large_groups,
            large_crowd: &self.large_crowd,
        };
        table.list_jobs(&mut self.jobs);
        grow(&mut self.found, self.jobs.len());
        let jobs = self.jobs.iter().zip(&mut self.found);
        parallel.run_tasks(jobs, threads, |(job, found)| {
            found.clear();
            table.work(*job, found);
        });
        let found = &self.found[..self.jobs.len()];
        let lists = || blocks.iter().map(|block| &block.pairs).chain(found);
        pairs.reserve(lists().map(Vec::len).sum());
        lists().for_each(|list| pairs.extend_from_slice(list));
        HashCounts {
            occupied_cells: blocks.iter().map(|block| block.occupied_cells).sum(),
            entries,
            crowded_cells: blocks.iter().flat_map(|block| &block.crowds).filter(|crowd| crowd.is_sorted()).count(),
            large_boxes: self.large.len(),
        }
    }
}

fn grow<T: Default>(list: &mut Vec<T>, count: usize) {
    if list.len() < count {
        list.resize_with(count, T::default);
    }
}

/// The filled table.
struct Table<'a> {
    boxes: Boxes<'a>,
    grids: Grids,
    slots: Slots,
    /// The levels that a box of each list meets others in, one bit each.
    levels: [u32; 2],
    parts: &'a [Part],
    blocks: &'a [Block],
    large_groups: &'a [Group],
    large_crowd: &'a Crowd,
}

impl Table<'_> {
    fn list_jobs(&self, jobs: &mut Vec<Job>) {
        jobs.clear();
        let mut sweep = |block: Option<usize>, crowd: usize, groups: usize| {
            jobs.extend((0..groups).step_by(SWEPT_AT_ONCE).map(|start| Job::Sweep { block, crowd, start }));
        };
        for (block, Block { crowds, .. }) in self.blocks.iter().enumerate() {
            for (number, crowd) in crowds.iter().enumerate().filter(|(_, crowd)| crowd.is_sorted()) {
                sweep(Some(block), number, crowd.group_count());
            }
        }
        sweep(None, 0, self.large_crowd.group_count());
        let has_visits = |part: &Part| {
            let meets_coarser = |side: usize| {
                let finest = part.levels[side].trailing_zeros();
                finest < u32::BITS && (self.levels[side] >> finest) > 1
            };
            self.large_crowd.len() > 0 || meets_coarser(0) || meets_coarser(1)
        };
        let visiting = (0..self.parts.len()).filter(|&part| has_visits(&self.parts[part]));
        jobs.extend(visiting.map(|part| Job::Visit { part }));
    }

    fn work(&self, job: Job, pairs: &mut Vec<[u32; 2]>) {
        match job {
            Job::Sweep { block, crowd, start } => {
                let (crowd, groups) = match block.map(|block| &self.blocks[block]) {
                    Some(block) => (&block.crowds[crowd], &*block.groups),
                    None => (self.large_crowd, self.large_groups),
                };
                let range: Range<usize> = start..(start + SWEPT_AT_ONCE).min(crowd.group_count());
                crowd.sweep(range, groups, &self.boxes, pairs);
            }
            Job::Visit { part } => self.visit(&self.parts[part], pairs),
        }
    }

    /// Appends the pairs that the boxes of a part form with boxes of coarser levels, and with large boxes.
    fn visit(&self, part: &Part, pairs: &mut Vec<[u32; 2]>) {
        for (item, place) in part.items.clone().zip(&part.places) {
            let Place::Level(own) = *place else { continue };
            let item = item as u32;
            let bounds = self.boxes.get(item);
            let coarser = self.levels[self.boxes.side(item)] & !((2 << own) - 1);
            for level in (own + 1..u32::BITS as u8).filter(|level| coarser >> level & 1 == 1) {
                for (cell, lowest) in cells_between(self.grids.cells(level, bounds)) {
                    let (block, slot) = self.slots.place(self.slots.slot(hash(cell, level)));
                    let visitor = (item, bounds, lowest);
                    self.blocks[block].visit(slot, (level, cell), visitor, &self.boxes, pairs);
                }
            }
            self.large_crowd.visit((item, bounds, ALL_AXES), self.large_groups, &self.boxes, pairs);
        }
    }
}
