//! A plain binary tree of boxes: median split on the widest axis of the centers, up to four boxes in a leaf.

use glam::DVec3;

/// The most boxes in a leaf. Smaller leaves would save few tests and use more memory.
const LEAF_SIZE: usize = 4;

/// An axis-aligned box.
#[derive(Clone, Copy, Debug)]
pub(super) struct Box3 {
    pub(super) low: DVec3,
    pub(super) high: DVec3,
}

impl Box3 {
    pub(super) fn of<const N: usize>(points: &[DVec3; N]) -> Self {
        Self {
            low: points.iter().copied().fold(DVec3::INFINITY, DVec3::min),
            high: points.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max),
        }
    }

    pub(super) fn union(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    /// Whether the gap between the boxes is at most `reach` along every axis: whether they overlap when each is grown
    /// by half of it.
    ///
    /// Rounding is monotone, so the test never fails for a true gap of at most `reach`.
    pub(super) fn within(&self, other: &Self, reach: f64) -> bool {
        (self.low - other.high).max_element() <= reach && (other.low - self.high).max_element() <= reach
    }
}

enum Content {
    /// Range of `BoxTree::order`.
    Leaf { start: usize, end: usize },
    /// Indices into `BoxTree::nodes`.
    Branch { left: usize, right: usize },
}

struct Node {
    bounds: Box3,
    content: Content,
}

/// A tree of boxes. Boxes are identified by their index in the list that it was built from.
pub(super) struct BoxTree {
    boxes: Vec<Option<Box3>>,
    order: Vec<usize>,
    nodes: Vec<Node>,
    root: Option<usize>,
}

impl BoxTree {
    /// Builds the tree. An entry without a box is in no leaf and meets nothing.
    pub(super) fn new(boxes: Vec<Option<Box3>>) -> Self {
        let order = (0..boxes.len()).filter(|&index| boxes[index].is_some()).collect();
        let mut tree = Self { boxes, order, nodes: Vec::new(), root: None };
        tree.root = tree.build(0, tree.order.len());
        tree
    }

    fn build(&mut self, start: usize, end: usize) -> Option<usize> {
        let boxes = &self.boxes;
        let mut bounds = self.order[start..end].iter().filter_map(|&index| boxes[index]).reduce(Box3::union)?;
        let content = if end - start <= LEAF_SIZE {
            Content::Leaf { start, end }
        } else {
            let doubled_centre = |index: usize| boxes[index].map_or(DVec3::ZERO, |b| b.low + b.high);
            let (low, high) = self.order[start..end]
                .iter()
                .map(|&index| doubled_centre(index))
                .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), centre| {
                    (low.min(centre), high.max(centre))
                });
            let axis = (high - low).max_position();
            let middle = (end - start) / 2;
            self.order[start..end].select_nth_unstable_by(middle, |&i, &j| {
                doubled_centre(i)[axis].total_cmp(&doubled_centre(j)[axis]).then(i.cmp(&j))
            });
            let left = self.build(start, start + middle)?;
            let right = self.build(start + middle, end)?;
            bounds = self.nodes[left].bounds.union(self.nodes[right].bounds);
            Content::Branch { left, right }
        };
        self.nodes.push(Node { bounds, content });
        Some(self.nodes.len() - 1)
    }

    /// Calls `visit(i, j)`, i < j, once for every two boxes within `reach` of each other along every axis.
    pub(super) fn visit_self(&self, reach: f64, visit: &mut dyn FnMut(usize, usize)) {
        if let Some(root) = self.root {
            self.descend_self(root, reach, &mut |i, j| visit(i.min(j), i.max(j)));
        }
    }

    /// Calls `visit(i, j)`, i of this tree and j of the other, once for every two boxes within `reach`.
    pub(super) fn visit_between(&self, other: &Self, reach: f64, visit: &mut dyn FnMut(usize, usize)) {
        if let (Some(root), Some(other_root)) = (self.root, other.root) {
            self.descend_between(root, other, other_root, reach, visit);
        }
    }

    fn descend_self(&self, node: usize, reach: f64, visit: &mut dyn FnMut(usize, usize)) {
        match self.nodes[node].content {
            Content::Leaf { start, end } => {
                for (position, &i) in self.order[start..end].iter().enumerate() {
                    for &j in &self.order[start + position + 1..end] {
                        if self.boxes_within(i, self, j, reach) {
                            visit(i, j);
                        }
                    }
                }
            }
            Content::Branch { left, right } => {
                self.descend_self(left, reach, visit);
                self.descend_self(right, reach, visit);
                self.descend_between(left, self, right, reach, visit);
            }
        }
    }

    fn descend_between(
        &self,
        node: usize,
        other: &Self,
        other_node: usize,
        reach: f64,
        visit: &mut dyn FnMut(usize, usize),
    ) {
        let (mine, theirs) = (&self.nodes[node], &other.nodes[other_node]);
        if !mine.bounds.within(&theirs.bounds, reach) {
            return;
        }
        if let (&Content::Leaf { start, end }, &Content::Leaf { start: other_start, end: other_end }) =
            (&mine.content, &theirs.content)
        {
            for &i in &self.order[start..end] {
                for &j in &other.order[other_start..other_end] {
                    if self.boxes_within(i, other, j, reach) {
                        visit(i, j);
                    }
                }
            }
            return;
        }
        let parts = |content: &Content, whole: usize| match *content {
            Content::Leaf { .. } => [Some(whole), None],
            Content::Branch { left, right } => [Some(left), Some(right)],
        };
        for part in parts(&mine.content, node).into_iter().flatten() {
            for other_part in parts(&theirs.content, other_node).into_iter().flatten() {
                self.descend_between(part, other, other_part, reach, visit);
            }
        }
    }

    fn boxes_within(&self, i: usize, other: &Self, j: usize, reach: f64) -> bool {
        match (&self.boxes[i], &other.boxes[j]) {
            (Some(mine), Some(theirs)) => mine.within(theirs, reach),
            _ => false,
        }
    }
}
