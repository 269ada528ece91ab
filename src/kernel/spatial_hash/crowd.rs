//! Many boxes in one cell, and the list of large boxes: in groups of eight, sorted along an axis if there are many.

use std::ops::Range;

use glam::{Vec3, Vec4};

use super::{boxes::Boxes, entries::Entry};
use crate::kernel::{mesh::bounds::Aabb, simd::lanes::SetLanes};

/// Boxes that are compared at a time.
const WIDTH: usize = 8;

/// More boxes than this are sorted along an axis and swept. Fewer take longer to sort than to compare.
const CROWDED: usize = 128;

/// Boxes side by side. Unused lanes have NaN, and overlap nothing.
#[derive(Clone, Copy, Debug)]
pub(super) struct Group {
    min: [[f32; WIDTH]; 3],
    max: [[f32; WIDTH]; 3],
    items: [u32; WIDTH],
    /// For each axis, the boxes that have their lowest cell here.
    lowest: [u32; 3],
    /// The least minimum on the crowd's axis, and the largest maximum up to this group. Both ascend.
    begin: f32,
    reach: f32,
}

impl Group {
    fn new(entries: &[Entry], boxes: &Boxes<'_>) -> Self {
        let mut group = Self {
            min: [[f32::NAN; WIDTH]; 3],
            max: [[f32::NAN; WIDTH]; 3],
            items: [0; WIDTH],
            lowest: [0; 3],
            begin: f32::NEG_INFINITY,
            reach: f32::INFINITY,
        };
        for (lane, entry) in entries.iter().enumerate() {
            let bounds = boxes.get(entry.item);
            for axis in 0..3 {
                group.min[axis][lane] = bounds.min[axis];
                group.max[axis][lane] = bounds.max[axis];
                group.lowest[axis] |= u32::from(entry.lowest >> axis & 1) << lane;
            }
            group.items[lane] = entry.item;
        }
        group
    }

    /// The boxes that overlap a box, in lanes. If the box has its lowest cell on some axes here, only those with which
    /// it counts here.
    #[inline]
    fn meeting(&self, bounds: &Aabb, lowest: u8) -> u32 {
        let in_half = |half: usize| {
            let lanes = |values: &[f32; WIDTH]| Vec4::from_slice(&values[4 * half..]);
            let on_axis = |axis: usize| {
                lanes(&self.min[axis]).cmple(Vec4::splat(bounds.max[axis]))
                    & lanes(&self.max[axis]).cmpge(Vec4::splat(bounds.min[axis]))
            };
            (on_axis(0) & on_axis(1) & on_axis(2)).bitmask()
        };
        let overlapping = in_half(0) | in_half(1) << 4;
        (0..3)
            .fold(overlapping, |lanes, axis| lanes & (self.lowest[axis] | u32::from(lowest >> axis & 1).wrapping_neg()))
    }

    fn get(&self, lane: usize) -> (u32, Aabb, u8) {
        let corner = |values: &[[f32; WIDTH]; 3]| Vec3::new(values[0][lane], values[1][lane], values[2][lane]);
        let lowest = (0..3).fold(0, |bits, axis| bits | ((self.lowest[axis] >> lane & 1) as u8) << axis);
        (self.items[lane], Aabb { min: corner(&self.min), max: corner(&self.max) }, lowest)
    }
}

/// Boxes in groups, those of the first list before those of the second.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Crowd {
    /// Where its entries begin in their list.
    pub(super) entries: usize,
    /// How many boxes it has of each list.
    counts: [usize; 2],
    /// Where its groups begin.
    groups: usize,
    /// The axis along which it is sorted. `None` if it is not.
    axis: Option<usize>,
}

/// The axis on which the fewest boxes overlap: with the least sum of lengths relative to the length of the whole.
fn best_axis(entries: &[Entry], boxes: &Boxes<'_>) -> usize {
    let (mut low, mut high, mut lengths) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3], [0.0; 3]);
    for entry in entries {
        let bounds = boxes.get(entry.item);
        for axis in 0..3 {
            let [min, max] = [bounds.min, bounds.max].map(|corner| f64::from(corner[axis]));
            low[axis] = low[axis].min(min);
            high[axis] = high[axis].max(max);
            lengths[axis] += max - min;
        }
    }
    let is_better =
        |axis: usize, than: usize| lengths[axis] * (high[than] - low[than]) < lengths[than] * (high[axis] - low[axis]);
    [1, 2].into_iter().fold(0, |best, axis| if is_better(axis, best) { axis } else { best })
}

impl Crowd {
    /// Groups boxes, of which none is empty. `start` is where they are in their list.
    pub(super) fn new(entries: &mut [Entry], start: usize, boxes: &Boxes<'_>, groups: &mut Vec<Group>) -> Self {
        let side = |entry: &Entry| boxes.side(entry.item);
        let axis = (entries.len() > CROWDED).then(|| best_axis(entries, boxes));
        if let Some(axis) = axis {
            let min = |entry: &Entry| boxes.get(entry.item).min[axis];
            entries.sort_unstable_by(|a, b| {
                side(a).cmp(&side(b)).then_with(|| min(a).total_cmp(&min(b))).then(a.item.cmp(&b.item))
            });
        }
        let first = entries.partition_point(|entry| side(entry) == 0);
        let crowd = Self { entries: start, counts: [first, entries.len() - first], groups: groups.len(), axis };
        for entries in [&entries[..first], &entries[first..]] {
            let mut reach = f32::NEG_INFINITY;
            groups.extend(entries.chunks(WIDTH).map(|entries| {
                let mut group = Group::new(entries, boxes);
                if let Some(axis) = axis {
                    reach = group.max[axis][..entries.len()].iter().fold(reach, |reach, max| reach.max(*max));
                    (group.begin, group.reach) = (group.min[axis][0], reach);
                }
                group
            }));
        }
        crowd
    }

    /// The number of boxes.
    pub(super) fn len(&self) -> usize {
        self.counts[0] + self.counts[1]
    }

    pub(super) fn is_sorted(&self) -> bool {
        self.axis.is_some()
    }

    /// The groups of a list's boxes.
    fn groups(&self, side: usize) -> Range<usize> {
        let [first, second] = self.counts.map(|count| count.div_ceil(WIDTH));
        let start = self.groups + side * first;
        start..start + [first, second][side]
    }

    /// The number of groups.
    pub(super) fn group_count(&self) -> usize {
        self.groups(0).len() + self.groups(1).len()
    }

    /// Appends the pairs that the boxes of some groups form with those that begin after them on the axis.
    pub(super) fn sweep(&self, range: Range<usize>, groups: &[Group], boxes: &Boxes<'_>, pairs: &mut Vec<[u32; 2]>) {
        let sides = [0, 1].map(|side| self.groups(side));
        for place in range.start + self.groups..range.end + self.groups {
            let side = usize::from(place >= sides[1].start);
            if side == 1 && !self.is_sorted() {
                // Those of the first list have found all pairs.
                return;
            }
            let others = if boxes.is_own() { place..sides[0].end } else { sides[1 - side].clone() };
            for lane in 0..(self.counts[side] - WIDTH * (place - sides[side].start)).min(WIDTH) {
                let (item, bounds, lowest) = groups[place].get(lane);
                if boxes.is_own() {
                    let later = groups[place].meeting(&bounds, lowest) & (!0 << (lane + 1));
                    push(item, later, &groups[place], boxes, pairs);
                }
                let begin = self.axis.map(|axis| bounds.min[axis]);
                let end = self.axis.map_or(f32::INFINITY, |axis| bounds.max[axis]);
                let others = &groups[others.clone()];
                let from = match begin {
                    _ if boxes.is_own() => 1,
                    // The last group that begins before the box may have boxes that begin after it.
                    Some(begin) => others.partition_point(|group| group.begin < begin).saturating_sub(1),
                    None => 0,
                };
                for other in others[from.min(others.len())..].iter().take_while(|other| other.begin <= end) {
                    let mut met = other.meeting(&bounds, lowest);
                    if !boxes.is_own() && met != 0 {
                        met &= self.later_lanes(begin, side, other);
                    }
                    push(item, met, other, boxes, pairs);
                }
            }
        }
    }

    /// The boxes of a group that a box of the other list finds, if they are sorted: those that begin after it. Of two
    /// that begin at the same coordinate, that of the first list finds the other.
    fn later_lanes(&self, begin: Option<f32>, side: usize, other: &Group) -> u32 {
        let (Some(axis), Some(begin)) = (self.axis, begin) else { return !0 };
        let later = other.min[axis].map(|other| if side == 0 { other >= begin } else { other > begin });
        (0..WIDTH).fold(0, |lanes, lane| lanes | u32::from(later[lane]) << lane)
    }

    /// Appends the pairs that a box which is not in the crowd forms with its boxes. `lowest` is the box's, in this cell.
    pub(super) fn visit(
        &self,
        (item, bounds, lowest): (u32, &Aabb, u8),
        groups: &[Group],
        boxes: &Boxes<'_>,
        pairs: &mut Vec<[u32; 2]>,
    ) {
        let side = if boxes.is_own() { 0 } else { 1 - boxes.side(item) };
        let groups = &groups[self.groups(side)];
        let [begin, end] = match self.axis {
            Some(axis) => [bounds.min[axis], bounds.max[axis]],
            None => [f32::NEG_INFINITY, f32::INFINITY],
        };
        let from = groups.partition_point(|group| group.reach < begin);
        for group in groups[from..].iter().take_while(|group| group.begin <= end) {
            push(item, group.meeting(bounds, lowest), group, boxes, pairs);
        }
    }
}

#[inline]
fn push(item: u32, lanes: u32, group: &Group, boxes: &Boxes<'_>, pairs: &mut Vec<[u32; 2]>) {
    pairs.extend(SetLanes(lanes).map(|lane| boxes.pair(item, group.items[lane])));
}
