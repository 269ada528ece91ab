//! The tree that queries search where the broad phase has left its own tree behind, and the tree over all surfaces.
//!
//! Made when a query first needs it. Queries share the results of a detection, so it is brought up to date behind a
//! shared reference. It never becomes the tree of the broad phase: what was asked does not change what is detected.

use std::{
    mem,
    sync::{Arc, Mutex, OnceLock, PoisonError},
};

use super::{bounds::TriangleBounds, tree::SurfaceTree};
use crate::kernel::{bvh::tree::BoxTree, mesh::topology::SurfaceTopology};

/// A tree whose boxes have grown by this factor is rebuilt before it is searched. A rebuild takes several times as long
/// as a refit, so a moderately decayed tree is searched as it is.
const MOST_DECAY: f32 = 2.0;

/// For how many changes of the surface an unused tree is kept.
const KEPT_UNUSED: u32 = 60;

/// The tree for queries.
#[derive(Default)]
pub(in crate::detection) struct QueriedTree {
    /// The tree over the current boxes, if a query has needed it.
    current: OnceLock<KeptTree>,
    /// The tree over earlier boxes.
    last: Mutex<Option<KeptTree>>,
    /// How often the surface has changed since a query has needed a tree.
    unused: u32,
}

/// A tree, and the mesh that it is over.
struct KeptTree {
    tree: BoxTree,
    topology: Option<Arc<SurfaceTopology>>,
}

impl QueriedTree {
    /// Forgets that the tree is current, after the surface has changed.
    pub(in crate::detection) fn retire(&mut self) {
        let last = self.last.get_mut().unwrap_or_else(PoisonError::into_inner);
        if let Some(tree) = self.current.take() {
            (*last, self.unused) = (Some(tree), 0);
        } else if last.is_some() {
            self.unused += 1;
            if self.unused > KEPT_UNUSED {
                *last = None;
            }
        }
    }

    /// The tree over the current boxes: that of the broad phase if it is up to date.
    pub(in crate::detection) fn tree<'a>(&'a self, own: &'a SurfaceTree, bounds: &TriangleBounds) -> &'a BoxTree {
        if own.matches_boxes(bounds) {
            return own.tree();
        }
        // On this thread alone: a task that another thread waits for must not wait for this tree.
        &self.current.get_or_init(|| self.made(own, bounds)).tree
    }

    fn made(&self, own: &SurfaceTree, bounds: &TriangleBounds) -> KeptTree {
        let boxes = bounds.triangles();
        let last = mem::take(&mut *self.last.lock().unwrap_or_else(PoisonError::into_inner));
        let is_same =
            |topology: &Option<Arc<SurfaceTopology>>| topology.as_ref().is_some_and(|topology| bounds.is_of(topology));
        let last = last.filter(|kept| is_same(&kept.topology));
        let copied = || is_same(&own.topology).then(|| own.tree().clone());
        let mut tree = last.map(|kept| kept.tree).or_else(copied).unwrap_or_default();
        tree.break_off_rebuilding();
        if tree.len() == boxes.len() {
            tree.refit(boxes);
        }
        if tree.len() != boxes.len() || tree.decay() > MOST_DECAY {
            tree.rebuild(boxes);
        }
        KeptTree { tree, topology: bounds.topology().cloned() }
    }
}
