//! Every stage of the kernel by itself, on a crumpled sheet. Each stage reads the results of the previous stages, and
//! writes into buffers that keep their memory.
//!
//! No stage is inlined, so that instruction counters find it by name.

use bevy_circumsphere::kernel::{
    bvh::{
        leaf_triangles::{LeafMesh, LeafTriangles, PairCull},
        tree::BoxTree,
    },
    exact::stage::{closest_pairs, exact_pairs},
    mesh::{
        bounds::{Aabb, triangle_bounds},
        topology::SurfaceTopology,
    },
    pair::{FoundPairs, PairSettings, SurfaceSide},
    spheres::{
        circumsphere::{Ball, OffsetSpheres, RecipeSettings, enclosing_balls},
        cone::SafetyCones,
        contacts::{FoundSpheres, ball_contacts, meeting_caps, overlapping_ball_contacts},
        curvature::{CurvatureEstimator, Curvatures},
        pairs::{BallSide, CapSide, overlapping_caps},
    },
};
use circumsphere_support::scenes::crumpled_sheet;
use glam::Vec3;

/// Contact distance, in mean edges.
const DISTANCE_EDGES: f64 = 0.1;

/// The defaults of the plugin.
const RECIPE: RecipeSettings = RecipeSettings { sphere_offset: 0.5, curvature_threshold: 2.0, refit_threshold: 0.7 };

/// A mesh and the settings of its test.
pub struct Sheet {
    pub topology: SurfaceTopology,
    pub positions: Vec<Vec3>,
    settings: PairSettings,
}

/// The results of the stages.
#[derive(Clone, Default)]
pub struct Stages {
    pub bounds: Vec<Aabb>,
    pub tree: BoxTree,
    pub candidates: Vec<[u32; 2]>,
    pub leaf_triangles: LeafTriangles,
    pub past_slabs: Vec<[u32; 2]>,
    pub balls: Vec<Ball>,
    pub curvatures: Curvatures,
    pub spheres: OffsetSpheres,
    pub cones: SafetyCones,
    pub near_balls: Vec<[u32; 2]>,
    pub near_caps: Vec<[u32; 2]>,
    pub meeting: Vec<[u32; 2]>,
    pub found: FoundPairs,
    pub found_spheres: FoundSpheres,
}

impl Sheet {
    pub fn new(triangles: usize) -> Self {
        let mesh = crumpled_sheet(triangles, 0.0);
        let positions: Vec<Vec3> = mesh.positions.iter().copied().map(Vec3::from_array).collect();
        let topology = SurfaceTopology::new(&positions, &mesh.triangles).expect("the sheet is a mesh");
        let distance = DISTANCE_EDGES * topology.mean_edge_length(&positions);
        let settings = PairSettings {
            contact_distance: distance,
            reported_distance: distance,
            range: distance,
            scale: 1.0,
            bulge: 0.0,
            cull: true,
            same_surface: true,
            any_left_out: false,
        };
        Self { topology, positions, settings }
    }

    fn side(&self) -> SurfaceSide<'_> {
        let (topology, positions) = (&self.topology, &*self.positions);
        SurfaceSide::flat(topology, positions)
    }

    fn range(&self) -> f32 {
        self.settings.range as f32
    }
}

/// A stage: reads the sheet and the results of previous stages, and writes its own results.
pub type Stage = fn(&Sheet, &mut Stages);

/// All stages in the order of the plugin, preceded by the first build of the tree.
pub const STAGES: [(&str, Stage); 15] = [
    ("build", build),
    ("bounds", bounds),
    ("refit_tree", refit_tree),
    ("leaf_triangles", leaf_triangles),
    ("self_pairs", self_pairs),
    ("self_pairs_past_slabs", self_pairs_past_slabs),
    ("exact", refined),
    ("closest", closest),
    ("curvature", curvature),
    ("refit_spheres", refit_spheres),
    ("overlap_caps", overlap_caps),
    ("cone", cone),
    ("refit_balls", refit_balls),
    ("overlap_balls", overlap_balls),
    ("contacts_of_balls", contacts_of_balls),
];

#[inline(never)]
pub fn build(sheet: &Sheet, stages: &mut Stages) {
    bounds(sheet, stages);
    stages.tree.rebuild(&stages.bounds);
}

#[inline(never)]
pub fn bounds(sheet: &Sheet, stages: &mut Stages) {
    let growth = 0.5 * sheet.range();
    triangle_bounds(&sheet.positions, sheet.topology.triangles(), growth, &mut stages.bounds);
}

#[inline(never)]
pub fn refit_tree(_: &Sheet, stages: &mut Stages) {
    stages.tree.refit(&stages.bounds);
}

/// Pairs by boxes alone, without neighbors.
#[inline(never)]
pub fn self_pairs(_: &Sheet, stages: &mut Stages) {
    stages.candidates.clear();
    let cull = PairCull {
        triangles: [&stages.leaf_triangles; 2],
        neighbors: true,
        slabs: f32::INFINITY,
        search_from: &[],
        planes_only: false,
    };
    stages.tree.self_pairs_of(0..stages.tree.leaf_count(), Some(&cull), &mut stages.candidates);
}

#[inline(never)]
pub fn leaf_triangles(sheet: &Sheet, stages: &mut Stages) {
    stages.leaf_triangles.update(&stages.tree, &LeafMesh::flat(&sheet.topology, &sheet.positions));
}

/// Pairs by boxes and slabs, as in the exact methods.
#[inline(never)]
pub fn self_pairs_past_slabs(sheet: &Sheet, stages: &mut Stages) {
    stages.past_slabs.clear();
    let (triangles, slabs) = ([&stages.leaf_triangles; 2], sheet.range());
    let cull = PairCull { triangles, neighbors: true, slabs, search_from: &[], planes_only: false };
    stages.tree.self_pairs_of(0..stages.tree.leaf_count(), Some(&cull), &mut stages.past_slabs);
}

/// `Exact`, on the pairs that slabs have left.
#[inline(never)]
pub fn refined(sheet: &Sheet, stages: &mut Stages) {
    stages.found.clear();
    exact_pairs(&sheet.side(), &sheet.side(), &stages.past_slabs, &sheet.settings, &mut stages.found);
}

/// `Closest`, on the pairs that slabs have left.
#[inline(never)]
pub fn closest(sheet: &Sheet, stages: &mut Stages) {
    stages.found.clear();
    closest_pairs(&sheet.side(), &sheet.side(), &stages.past_slabs, &sheet.settings, &mut stages.found);
}

#[inline(never)]
pub fn curvature(sheet: &Sheet, stages: &mut Stages) {
    stages.curvatures.measure(&sheet.topology, &sheet.positions, CurvatureEstimator::SignedEdge);
}

/// With a new recipe for every triangle.
#[inline(never)]
pub fn refit_spheres(sheet: &Sheet, stages: &mut Stages) {
    let Stages { spheres, cones, curvatures, .. } = stages;
    spheres.forget();
    let triangles = sheet.topology.triangles();
    spheres.refit(&sheet.positions, triangles, &curvatures.curvatures, &curvatures.dihedrals, RECIPE, cones);
    cones.widen(&curvatures.spreads);
}

#[inline(never)]
pub fn overlap_caps(sheet: &Sheet, stages: &mut Stages) {
    let Stages { spheres, cones, candidates, near_caps, .. } = stages;
    near_caps.clear();
    let side = CapSide { surface: sheet.side(), spheres, cones, pose: None, rows: None };
    overlapping_caps(&side, &side, candidates, &sheet.settings, near_caps);
}

#[inline(never)]
pub fn cone(sheet: &Sheet, stages: &mut Stages) {
    let Stages { spheres, cones, near_caps, meeting, found_spheres, .. } = stages;
    meeting.clear();
    found_spheres.clear();
    let side = CapSide { surface: sheet.side(), spheres, cones, pose: None, rows: None };
    meeting_caps(&side, &side, near_caps, &sheet.settings, meeting, found_spheres);
}

#[inline(never)]
pub fn refit_balls(sheet: &Sheet, stages: &mut Stages) {
    enclosing_balls(&sheet.positions, sheet.topology.triangles(), &mut stages.balls);
}

#[inline(never)]
pub fn overlap_balls(sheet: &Sheet, stages: &mut Stages) {
    let Stages { balls, candidates, near_balls, found_spheres, .. } = stages;
    near_balls.clear();
    found_spheres.clear();
    let side = BallSide { surface: sheet.side(), balls, pose: None, rows: None };
    overlapping_ball_contacts(&side, &side, candidates, &sheet.settings, near_balls, found_spheres);
}

#[inline(never)]
pub fn contacts_of_balls(sheet: &Sheet, stages: &mut Stages) {
    let Stages { balls, near_balls, found, .. } = stages;
    found.clear();
    let side = BallSide { surface: sheet.side(), balls, pose: None, rows: None };
    ball_contacts(&side, &side, near_balls, &sheet.settings, found);
}
