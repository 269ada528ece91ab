//! parry's methods: its `Bvh`, refitted or rebuilt and traversed against itself, and its exact queries on every pair.
//!
//! A box bounds the corners of a triangle, grown by half the contact distance in f32.

use std::time::Duration;

use glam::Vec3;
use parry3d::{
    bounding_volume::Aabb,
    math::Pose,
    partitioning::{Bvh, BvhBuildStrategy, BvhWorkspace},
    query,
    shape::Triangle,
};

use super::{
    input::{Input, Tick},
    measure::{Contestant, Counts, Level, Log, timed},
};

/// All contestants based on parry.
pub fn contestants(input: &Input) -> Vec<Box<dyn Contestant>> {
    let mut all: Vec<Box<dyn Contestant>> = Vec::new();
    for strategy in STRATEGIES {
        all.push(Box::new(Traversal::new(input, strategy)));
    }
    all.push(Box::new(Queries::new(input)));
    all
}

pub const STRATEGIES: [BvhBuildStrategy; 2] = [BvhBuildStrategy::Binned, BvhBuildStrategy::Ploc];

/// Name of the rows with the traversal only, for both strategies.
pub const TRAVERSAL: &str = "self-traversal, counting";

/// Name of the row that rebuilds the tree in every tick and computes the distance of every pair.
pub const REBUILT: &str = "rebuild + traversal + distance of every pair";

pub fn strategy_name(strategy: BvhBuildStrategy) -> &'static str {
    match strategy {
        BvhBuildStrategy::Binned => "parry Bvh, binned",
        BvhBuildStrategy::Ploc => "parry Bvh, ploc",
    }
}

struct Mesh {
    triangles: Vec<[u32; 3]>,
    welded: Vec<[u32; 3]>,
    growth: f32,
}

impl Mesh {
    fn new(input: &Input) -> Self {
        Self { triangles: input.triangles.clone(), welded: input.welded.clone(), growth: input.thickness() }
    }

    fn corners(&self, positions: &[Vec3], triangle: usize) -> [Vec3; 3] {
        self.triangles[triangle].map(|vertex| positions[vertex as usize])
    }

    fn bounds(&self, positions: &[Vec3], triangle: usize) -> Aabb {
        let [a, b, c] = self.corners(positions, triangle);
        Aabb::new(a.min(b).min(c) - Vec3::splat(self.growth), a.max(b).max(c) + Vec3::splat(self.growth))
    }

    fn build(&self, positions: &[Vec3], strategy: BvhBuildStrategy) -> Bvh {
        let bounds = (0..self.triangles.len()).map(|triangle| (triangle, self.bounds(positions, triangle)));
        Bvh::from_iter(strategy, bounds)
    }

    fn update(&self, positions: &[Vec3], tree: &mut Bvh) {
        for triangle in 0..self.triangles.len() {
            tree.insert_or_update_partially(self.bounds(positions, triangle), triangle as u32, 0.0);
        }
    }

    fn share_vertex(&self, a: u32, b: u32) -> bool {
        let (a, b) = (self.welded[a as usize], self.welded[b as usize]);
        a.iter().any(|vertex| b.contains(vertex))
    }
}

/// Updates the leaves of a tree that is built once, refits it, and traverses it against itself.
struct Traversal {
    mesh: Mesh,
    strategy: BvhBuildStrategy,
    tree: Bvh,
    workspace: BvhWorkspace,
    pairs: Vec<[u32; 2]>,
}

impl Traversal {
    fn new(input: &Input, strategy: BvhBuildStrategy) -> Self {
        let mesh = Mesh::new(input);
        let tree = mesh.build(&input.ticks[0].now, strategy);
        Self { mesh, strategy, tree, workspace: BvhWorkspace::default(), pairs: Vec::new() }
    }
}

impl Contestant for Traversal {
    fn name(&self) -> String {
        strategy_name(self.strategy).to_owned()
    }

    fn run(&mut self, _: usize, tick: &Tick, log: &mut Log) -> Result<(), String> {
        let Self { mesh, tree, workspace, pairs, strategy } = self;
        let who = strategy_name(*strategy);
        mesh.update(&tick.before, tree);
        tree.refit(workspace);

        let (update, ()) = timed(|| mesh.update(&tick.now, tree));
        let (refit, ()) = timed(|| tree.refit(workspace));
        let (counting, count) = timed(|| {
            let mut count = 0u64;
            tree.traverse_bvtt_single_tree::<false>(workspace, &mut |_, _| count += 1);
            count
        });
        let (storing, ()) = timed(|| {
            pairs.clear();
            tree.traverse_bvtt_single_tree::<false>(workspace, &mut |a, b| pairs.push([a, b]));
        });
        if pairs.len() as u64 != count {
            return Err(format!("it counted {count} pairs but stored {}", pairs.len()));
        }
        let apart = pairs.iter().filter(|&&[a, b]| !mesh.share_vertex(a, b)).count() as u64;
        let counts = Counts { box_pairs: Some(count), ..Counts::default() };
        let stored = Counts { apart: Some(apart), ..counts };
        log.add(who, "update of leaves", 1, Level::Part, update, Counts::default());
        log.add(who, "refit", 1, Level::Part, refit, Counts::default());
        log.add(who, TRAVERSAL, 1, Level::Whole, counting, counts);
        log.add(who, "self-traversal, storing", 1, Level::Whole, storing, stored);
        log.add(who, "update + refit + self-traversal, storing", 1, Level::Whole, update + refit + storing, stored);
        Ok(())
    }
}

/// Exact queries on every pair that shares no vertex.
struct Queries {
    mesh: Mesh,
    contact_distance: f32,
    workspace: BvhWorkspace,
    pairs: Vec<[u32; 2]>,
}

impl Queries {
    fn new(input: &Input) -> Self {
        Self {
            mesh: Mesh::new(input),
            contact_distance: input.contact_distance as f32,
            workspace: BvhWorkspace::default(),
            pairs: Vec::new(),
        }
    }

    /// Counts the pairs for which `holds` is true.
    fn count(&self, positions: &[Vec3], holds: impl Fn(&Triangle, &Triangle) -> bool) -> (Duration, u64) {
        let triangle = |triangle: u32| {
            let [a, b, c] = self.mesh.corners(positions, triangle as usize);
            Triangle::new(a, b, c)
        };
        timed(|| self.pairs.iter().filter(|&&[a, b]| holds(&triangle(a), &triangle(b))).count() as u64)
    }
}

impl Contestant for Queries {
    fn name(&self) -> String {
        "parry's exact queries".to_owned()
    }

    fn run(&mut self, _: usize, tick: &Tick, log: &mut Log) -> Result<(), String> {
        let at = Pose::IDENTITY;
        let (building, tree) = timed(|| self.mesh.build(&tick.now, BvhBuildStrategy::Binned));
        let Self { mesh, workspace, pairs, .. } = &mut *self;
        let (traversal, ()) = timed(|| {
            pairs.clear();
            tree.traverse_bvtt_single_tree::<false>(workspace, &mut |a, b| {
                if !mesh.share_vertex(a, b) {
                    pairs.push([a, b]);
                }
            });
        });
        let reach = self.contact_distance;
        let (distance, touching) = self
            .count(&tick.now, |a, b| query::distance(&at, a, &at, b).is_ok_and(|measured| measured.distance <= reach));
        let (contact, contacts) =
            self.count(&tick.now, |a, b| query::contact(&at, a, &at, b, reach).is_ok_and(|contact| contact.is_some()));
        let (intersection, crossing) = self
            .count(&tick.now, |a, b| query::intersection_test(&at, a, &at, b).is_ok_and(|tested| tested.intersecting));
        let apart = Some(self.pairs.len() as u64);
        let counts = Counts { apart, tested: apart, ..Counts::default() };
        let touching = Counts { touching: Some(touching), ..counts };
        log.add("parry", "Bvh build, binned", 1, Level::Part, building, Counts::default());
        log.add("parry", "query::distance of every pair", 1, Level::Part, distance, touching);
        let found = Counts { touching: Some(contacts), contacts: Some(contacts), ..counts };
        log.add("parry", "query::contact of every pair", 1, Level::Part, contact, found);
        let crossing = Counts { touching: Some(crossing), ..counts };
        log.add("parry", "query::intersection_test of every pair", 1, Level::Part, intersection, crossing);
        log.add("parry", REBUILT, 1, Level::Whole, building + traversal + distance, touching);
        Ok(())
    }
}
