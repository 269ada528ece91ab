//! What traversals ask of the triangles in the leaves of trees: only that is brought up to date.

use glam::Vec3;

use super::{
    super::{CandidateTrianglePairs, Frame, OtherSide, SurfacePair},
    SurfaceTree,
};
use crate::{
    detection::{parallel::Threads, sides::pair_settings},
    settings::CircumsphereSettings,
    surface::{ActiveSurface, ActiveSurfaces, ContactMethod},
};

/// What a traversal asks of the triangles of a surface where they are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(in crate::detection) enum Asked {
    /// Nothing but their boxes.
    Boxes,
    /// Which share a vertex.
    Neighbors,
    /// How far apart slabs keep them.
    Slabs,
}

/// Marks for each active surface what a traversal asks about its triangles where they are: of one that is moved it asks about
/// those that were brought over.
pub(super) fn mark_asked_surfaces(
    active: &ActiveSurfaces,
    candidates: &CandidateTrianglePairs,
    settings: &CircumsphereSettings,
    asked: &mut Vec<Asked>,
) {
    asked.clear();
    asked.resize(active.surfaces.len(), Asked::Boxes);
    for pair in &candidates.pairs {
        if let OtherSide::Surface(second) = pair.second {
            let reached = !pair.moved_triangles.is_empty();
            let of_pair = pair.asks_of_triangles(settings);
            for (place, frame) in [(pair.first, Frame::First), (second, Frame::Second)] {
                if !pair.is_moved() || (reached && pair.frame == frame) {
                    asked[place] = asked[place].max(of_pair);
                }
            }
        }
    }
}

impl SurfacePair {
    /// What a traversal asks about the triangles of both sides.
    pub(in crate::detection) fn asks_of_triangles(&self, settings: &CircumsphereSettings) -> Asked {
        if self.has_slabs(settings) {
            Asked::Slabs
        } else if self.is_self() {
            Asked::Neighbors
        } else {
            Asked::Boxes
        }
    }

    /// Whether the method goes by what slabs say.
    pub(super) fn has_slabs(&self, settings: &CircumsphereSettings) -> bool {
        self.method != ContactMethod::BoundingSphere && pair_settings(self, settings).cull
    }
}

impl SurfaceTree {
    /// Brings up to date what a traversal asks of the triangles where they are.
    pub(super) fn follow_triangles(
        &mut self,
        asked: Asked,
        surface: &ActiveSurface,
        positions: &[Vec3],
        threads: usize,
    ) {
        if asked > Asked::Boxes && self.vertices_named != self.tree.arrangement() {
            self.triangles.name_vertices(&self.tree, &surface.topology);
            self.vertices_named = self.tree.arrangement();
        }
        if asked > Asked::Neighbors && self.triangles_followed != self.followed {
            self.triangles.follow_on(&Threads(threads), &self.tree, &surface.topology, positions);
            self.triangles_followed = self.followed;
        }
    }
}
