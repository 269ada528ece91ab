//! What traversals ask of the triangles in the leaves of trees: only that is brought up to date.

use glam::Vec3;

use super::SurfaceTree;
use crate::{
    detection::{
        DetectionMemory,
        broad_phase::{CandidateTrianglePairs, Frame, OtherSide, SurfacePair},
        kept_pairs::{KeptPairs, ListUse},
        parallel::Threads,
        sides::pair_settings,
        state::SurfaceState,
    },
    kernel::{
        bvh::{leaf_triangles::Region, tree::BoxTree},
        capacity,
        mesh::topology::SurfaceTopology,
    },
    settings::CircumsphereSettings,
    surface::{ActiveSurface, ActiveSurfaces, ContactMethod},
};

/// What a traversal asks of the triangles of a surface where they are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(in crate::detection) enum Asked {
    /// Nothing but their boxes.
    #[default]
    Boxes,
    /// Which share a vertex.
    Neighbors,
    /// How far apart slabs keep them.
    Slabs,
}

/// What traversals ask of the triangles of a surface where they are, and where.
#[derive(Default)]
pub(super) struct AskedTriangles {
    asked: Asked,
    /// Where they ask about slabs.
    regions: Vec<Region>,
}

/// Marks for each active surface what traversals ask about its triangles where they are: of one that is moved they ask about
/// those that were brought over. What is not traversed asks for nothing.
pub(super) fn mark_asked_surfaces(
    active: &ActiveSurfaces,
    candidates: &CandidateTrianglePairs,
    settings: &CircumsphereSettings,
    memory: &DetectionMemory,
    kept: &KeptPairs,
    states: &[SurfaceState],
    surfaces: &mut Vec<AskedTriangles>,
) {
    surfaces.resize_with(active.surfaces.len(), AskedTriangles::default);
    for surface in &mut *surfaces {
        surface.asked = Asked::Boxes;
        capacity::clear(&mut surface.regions);
    }
    for (number, pair) in candidates.pairs.iter().enumerate() {
        let OtherSide::Surface(second) = pair.second else { continue };
        let list_use = kept.list_use(number);
        if memory.keeps(number) || list_use == ListUse::Followed {
            continue;
        }
        let of_pair = pair.asks_of_triangles(settings);
        let regions = pair.asked_regions([pair.first, second].map(|place| states[place].tree()));
        for (place, region) in [pair.first, second].into_iter().zip(regions) {
            let Some(region) = region else { continue };
            let surface = &mut surfaces[place];
            surface.asked = surface.asked.max(of_pair);
            if of_pair == Asked::Slabs {
                // A list is of what is near beyond the boxes.
                let is_listed = list_use == ListUse::Made;
                surface.regions.push(if is_listed { Region::Everywhere } else { region });
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

    /// Where a traversal asks about the triangles of either side where they are, given both trees: in the leaves that overlap
    /// any of the other's. `None` of a side that is moved, or that nothing reaches.
    pub(in crate::detection) fn asked_regions(&self, trees: [&BoxTree; 2]) -> [Option<Region>; 2] {
        if self.is_self() {
            return [Some(Region::Everywhere); 2];
        }
        if !self.is_moved() {
            let [first, second] = trees.map(|tree| Some(Region::Within(tree.bounds())));
            return [second, first];
        }
        let reaching = self.moved_triangles.iter().map(|(_, bounds)| *bounds).reduce(|all, bounds| all.union(&bounds));
        let region = reaching.map(Region::Within);
        match self.frame {
            Frame::First => [region, None],
            Frame::Second => [None, region],
        }
    }

    /// Whether the method goes by what slabs say.
    pub(super) fn has_slabs(&self, settings: &CircumsphereSettings) -> bool {
        self.method != ContactMethod::BoundingSphere && pair_settings(self, settings).cull
    }
}

impl SurfaceTree {
    /// Brings up to date what traversals ask of the triangles where they are.
    pub(super) fn follow_triangles(
        &mut self,
        &AskedTriangles { asked, ref regions }: &AskedTriangles,
        surface: &ActiveSurface,
        positions: &[Vec3],
        threads: usize,
    ) {
        if asked > Asked::Boxes && self.vertices_named != self.tree.arrangement() {
            self.triangles.name_vertices(&self.tree, &surface.topology);
            self.vertices_named = self.tree.arrangement();
        }
        if !regions.is_empty() {
            if self.triangles_followed != self.followed {
                self.triangles.begin_following(&self.tree);
                self.triangles_followed = self.followed;
            }
            self.triangles.follow_on(&Threads(threads), &self.tree, regions, &surface.topology, positions);
        }
    }

    /// Whether it is over as many triangles as a surface has, and they have followed it as far as a traversal asks about them.
    /// `version` is that of the surface's boxes.
    pub(in crate::detection) fn is_current(
        &self,
        topology: &SurfaceTopology,
        version: u64,
        asked: Asked,
        region: Option<Region>,
    ) -> bool {
        let has_names = asked == Asked::Boxes || self.vertices_named == self.tree.arrangement();
        let have_followed = || {
            self.triangles_followed == self.followed
                && region.is_none_or(|region| self.triangles.have_followed(&self.tree, region))
        };
        self.tree.len() == topology.triangles().len()
            && self.followed == version
            && has_names
            && (asked < Asked::Slabs || have_followed())
    }
}
