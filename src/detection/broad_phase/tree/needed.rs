//! What traversals need of the triangles in the leaves of trees. Only that is brought up to date.

use crate::{
    detection::{
        pairs::{CandidateTrianglePairs, Frame, OtherSide, SurfacePair},
        parallel::Threads,
        reuse::{
            DetectionMemory,
            near_lists::{KeptPairs, ListUse},
        },
        sides::pair_settings,
        state::{SurfaceState, bounds::TriangleBounds, tree::SurfaceTree},
    },
    kernel::{
        bvh::{leaf_triangles::Region, tree::BoxTree},
        capacity,
        mesh::topology::SurfaceTopology,
    },
    settings::CircumsphereSettings,
    surface::{ActiveSurface, ActiveSurfaces, ContactMethod},
};

/// What a traversal needs of a surface's triangles in the tree's own leaves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(in crate::detection) enum Needed {
    /// Only their boxes.
    #[default]
    Boxes,
    /// Which of them are neighbors.
    Neighbors,
    /// By how much slabs separate them.
    Slabs,
}

/// What traversals need of a surface's triangles in the tree's own leaves, and where.
#[derive(Default)]
pub(super) struct NeededTriangles {
    needed: Needed,
    /// Where they need slabs.
    regions: Vec<Region>,
}

/// Marks for each active surface what traversals need of the triangles in its leaves. For a moved surface they need the
/// transformed triangles instead. Pairs that are not traversed need nothing.
pub(super) fn mark_needed_triangles(
    active: &ActiveSurfaces,
    candidates: &CandidateTrianglePairs,
    settings: &CircumsphereSettings,
    memory: &DetectionMemory,
    kept: &KeptPairs,
    states: &[SurfaceState],
    surfaces: &mut Vec<NeededTriangles>,
) {
    surfaces.resize_with(active.surfaces.len(), NeededTriangles::default);
    for surface in &mut *surfaces {
        surface.needed = Needed::Boxes;
        capacity::clear(&mut surface.regions);
    }
    for (number, pair) in candidates.pairs.iter().enumerate() {
        let OtherSide::Surface(second) = pair.second else { continue };
        let list_use = kept.list_use(number);
        if memory.keeps(number) || list_use == ListUse::Reused {
            continue;
        }
        let of_pair = pair.needs_of_triangles(settings);
        let regions = pair.needed_regions([pair.first, second].map(|place| states[place].tree()));
        for (place, region) in [pair.first, second].into_iter().zip(regions) {
            let Some(region) = region else { continue };
            let surface = &mut surfaces[place];
            surface.needed = surface.needed.max(of_pair);
            if of_pair == Needed::Slabs {
                // A list also contains pairs whose boxes do not overlap.
                let is_listed = list_use == ListUse::Made;
                surface.regions.push(if is_listed { Region::Everywhere } else { region });
            }
        }
    }
}

impl SurfacePair {
    /// What a traversal needs of the triangles of both sides.
    pub(in crate::detection) fn needs_of_triangles(&self, settings: &CircumsphereSettings) -> Needed {
        if self.has_slabs(settings) {
            Needed::Slabs
        } else if self.is_self() {
            Needed::Neighbors
        } else {
            Needed::Boxes
        }
    }

    /// Where a traversal needs the triangles of each side in the tree's own leaves, given both trees: in the leaves
    /// that overlap something of the other side. `None` for a side that is moved or that nothing reaches.
    pub(in crate::detection) fn needed_regions(&self, trees: [&BoxTree; 2]) -> [Option<Region>; 2] {
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

    /// Whether the method uses slabs.
    pub(super) fn has_slabs(&self, settings: &CircumsphereSettings) -> bool {
        self.method != ContactMethod::BoundingSphere && pair_settings(self, settings).cull
    }
}

impl SurfaceTree {
    /// Updates what traversals need of the triangles in the leaves.
    pub(super) fn update_triangles(
        &mut self,
        &NeededTriangles { needed, ref regions }: &NeededTriangles,
        surface: &ActiveSurface,
        bounds: &TriangleBounds,
        threads: usize,
    ) {
        if needed > Needed::Boxes && self.named_arrangement != self.tree.arrangement() {
            self.triangles.name_vertices(&self.tree, &surface.topology);
            self.named_arrangement = self.tree.arrangement();
        }
        if !regions.is_empty() {
            if self.triangles_version != self.version {
                self.triangles.begin_update(&self.tree);
                self.triangles_version = self.version;
            }
            self.triangles.update_within(&Threads(threads), &self.tree, regions, &bounds.leaf_mesh(&surface.topology));
        }
    }

    /// Whether the tree is over as many triangles as the surface has, and up to date as far as a traversal needs.
    /// `version` is that of the surface's boxes.
    pub(in crate::detection) fn is_current(
        &self,
        topology: &SurfaceTopology,
        version: u64,
        needed: Needed,
        region: Option<Region>,
    ) -> bool {
        let has_names = needed == Needed::Boxes || self.named_arrangement == self.tree.arrangement();
        let are_current = || {
            self.triangles_version == self.version
                && region.is_none_or(|region| self.triangles.are_current(&self.tree, region))
        };
        self.tree.len() == topology.triangles().len()
            && self.version == version
            && has_names
            && (needed < Needed::Slabs || are_current())
    }
}
