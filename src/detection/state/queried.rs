//! What queries of a surface need beyond what was detected: a tree, where the broad phase has left its own behind, and the
//! patches of a smooth surface that nothing was near.
//!
//! Made when a query first needs it. Queries share the results of a detection, so it is brought up to date behind a
//! shared reference. It never becomes that of a stage: what was asked does not change what is detected.

use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use super::{bounds::TriangleBounds, tree::SurfaceTree};
use crate::kernel::{
    bvh::tree::BoxTree,
    mesh::{curved_edges::CurvedEdges, topology::SurfaceTopology},
};

/// A tree whose boxes have grown by this factor is rebuilt before it is searched. A rebuild takes several times as long
/// as a refit, so a moderately decayed tree is searched as it is.
const MOST_DECAY: f32 = 2.0;

/// For how many changes of the surface what no query has needed is kept.
const KEPT_UNUSED: u32 = 60;

/// The tree and the patches for queries.
#[derive(Default)]
pub(in crate::detection) struct Queried {
    tree: OfVersion<KeptTree>,
    patches: OfVersion<CurvedEdges>,
}

/// What a query has computed from one version of a surface.
struct OfVersion<T> {
    /// Of the current version, if a query has needed it.
    current: OnceLock<T>,
    /// Of an earlier version.
    last: Mutex<Option<T>>,
    /// How often the surface has changed since a query has needed it.
    unused: u32,
}

impl<T> Default for OfVersion<T> {
    fn default() -> Self {
        Self { current: OnceLock::new(), last: Mutex::new(None), unused: 0 }
    }
}

impl<T> OfVersion<T> {
    /// Forgets that it is current, after the surface has changed.
    fn retire(&mut self) {
        let last = self.last.get_mut().unwrap_or_else(PoisonError::into_inner);
        if let Some(current) = self.current.take() {
            (*last, self.unused) = (Some(current), 0);
        } else if last.is_some() {
            self.unused += 1;
            if self.unused > KEPT_UNUSED {
                *last = None;
            }
        }
    }

    /// That of the current version, made from that of an earlier one. On this thread alone: a task that another thread waits
    /// for must not wait for it.
    fn current(&self, make: impl FnOnce(Option<T>) -> T) -> &T {
        self.current.get_or_init(|| make(self.last.lock().unwrap_or_else(PoisonError::into_inner).take()))
    }
}

/// A tree, and the mesh that it is over.
struct KeptTree {
    tree: BoxTree,
    topology: Option<Arc<SurfaceTopology>>,
}

impl Queried {
    /// Forgets everything, after the surface has changed.
    pub(in crate::detection) fn retire(&mut self) {
        self.tree.retire();
        self.patches.retire();
    }

    /// The tree over the current boxes: that of the broad phase if it is up to date.
    pub(in crate::detection) fn tree<'a>(&'a self, own: &'a SurfaceTree, bounds: &TriangleBounds) -> &'a BoxTree {
        if own.matches_boxes(bounds) {
            return own.tree();
        }
        &self.tree.current(|last| KeptTree::made(last, own, bounds)).tree
    }

    /// The curved edges of a smooth surface, with all patches. `None` if it is flat.
    pub(in crate::detection) fn patches(&self, bounds: &TriangleBounds) -> Option<&CurvedEdges> {
        bounds.curved().map(|_| self.patches.current(|last| bounds.with_all_patches(last.unwrap_or_default())))
    }
}

impl KeptTree {
    fn made(last: Option<Self>, own: &SurfaceTree, bounds: &TriangleBounds) -> Self {
        let boxes = bounds.triangles();
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
        Self { tree, topology: bounds.topology().cloned() }
    }
}
