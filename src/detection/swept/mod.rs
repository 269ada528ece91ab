//! Stage 8: when surfaces that move fast first meet on their way.
//!
//! For surfaces with [`SweptCollision`] alone, beside the contacts of the tick, which it neither reads nor changes. Pairs
//! are looked for by what whole surfaces sweep, then swept triangle by triangle in a frame that flies along with the
//! larger surface; that one's tree is kept from tick to tick where it rests.

mod path;

use std::{sync::Arc, time::Instant};

use bevy_app::prelude::*;
use bevy_ecs::{entity::EntityHashMap, prelude::*, query::QueryData};
use glam::Vec3;

use self::path::{Frame, Path, SweptPositions};
use super::{
    bounds::TriangleBounds,
    diagnostics::DetectionDiagnostics,
    parallel::{Buffers, append_ranges},
};
use crate::{
    contacts::{SweptImpact, SweptImpacts, SweptPair},
    kernel::{
        bounds::Aabb,
        ccd::{PairImpact, SWEEP_PART, Sweep, SweepLeaves, TreeWork, sort_impacts},
        ids::TriangleId,
        pose::Pose,
        tree::BoxTree,
    },
    schedule::{SurfaceDetection, SurfaceDetectionSystems},
    settings::CircumsphereSettings,
    surface::{ActiveSurface, ActiveSurfaces, SurfacePositions, SweptCollision, SweptTarget, first_non_finite},
};

/// A triangle is fast where a vertex moves farther than this share of its surface's thickness. What passes through each
/// other without being fast comes no farther apart, before and after, than the same share of the contact distance.
const FAST: f64 = 0.5;

/// Where a surface with [`SweptCollision`] was in the last detection: where its motion begins in the next one.
#[derive(Component, Clone, Debug, Default)]
pub struct PreviousPositions {
    /// Its positions, in its own frame.
    pub positions: Vec<Vec3>,
    /// Where it stood in the world.
    pub pose: Pose,
    /// How many times its boxes had been computed by then: as often now, and the positions are the same bit by bit.
    computed: u64,
    /// The detection that this is of.
    detection: u64,
}

/// Sweeps fast surfaces.
pub struct SweptPlugin;

impl Plugin for SweptPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<SweptImpacts>();
        app.add_systems(SurfaceDetection, find_impacts.in_set(SurfaceDetectionSystems::Swept));
    }
}

#[derive(QueryData)]
#[query_data(mutable)]
struct SweptItem {
    positions: &'static SurfacePositions,
    bounds: &'static TriangleBounds,
    target: Option<&'static SweptTarget>,
    previous: Option<&'static mut PreviousPositions>,
    swept: Has<SweptCollision>,
}

/// A surface in whose frame others are swept, with its tree.
#[derive(Default)]
struct MainSide {
    positions: SweptPositions,
    frame: Frame,
    bounds: Aabb,
    rounding: f64,
    /// How many times the surface's boxes had been computed, where it was at rest: as long as it stays there, nothing of
    /// this changes.
    at_rest: Option<u64>,
    /// The detection in which it was last looked at.
    detection: u64,
    /// The last detection that its surface took part in.
    last_active: u64,
}

impl MainSide {
    /// Brings it up to date, once a detection.
    fn follow(&mut self, surface: &ActiveSurface, path: &Path<'_>, computed: u64, detection: u64) {
        if std::mem::replace(&mut self.detection, detection) == detection {
            return;
        }
        let at_rest = path.is_still().then_some(computed);
        if at_rest.is_some() && at_rest == self.at_rest && !surface.fresh {
            // A rest tells nothing about where in the world.
            self.frame.pose = surface.pose;
            return;
        }
        self.at_rest = at_rest;
        self.frame = Frame { pose: path.end_pose, ..Frame::default() };
        self.positions.fill(path, &self.frame);
        self.frame.drift = self.positions.drift();
        self.positions.take_away(self.frame.drift);
        (self.bounds, self.rounding) = path.bounds_in(&self.frame);
    }
}

/// What the stage keeps for its memory.
#[derive(Default)]
struct SweptBuffers {
    detection: u64,
    main_sides: EntityHashMap<MainSide>,
    /// The smaller side of a pair, in the frame of the other.
    moved: SweptPositions,
    world: Vec<Aabb>,
    tree: BoxTree,
    pairs: Vec<[u32; 2]>,
    leaves: SweepLeaves,
    impacts: Vec<PairImpact>,
    spare_impacts: Buffers<Vec<PairImpact>>,
    candidates: Buffers<Vec<[u32; 2]>>,
    /// Lists of pairs of earlier ticks.
    spare: Vec<Vec<SweptImpact>>,
}

/// What sweeping has cost.
#[derive(Default)]
struct Cost {
    pairs: usize,
    candidates: usize,
    trees_built: usize,
    trees_refitted: usize,
}

fn find_impacts(
    active: Res<ActiveSurfaces>,
    settings: Res<CircumsphereSettings>,
    mut found: ResMut<SweptImpacts>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
    mut buffers: Local<SweptBuffers>,
    asking: Query<(), With<SweptCollision>>,
    mut surfaces: Query<SweptItem>,
) {
    let start = Instant::now();
    let buffers = &mut *buffers;
    buffers.detection += 1;
    if !found.pairs.is_empty() {
        buffers.spare.extend(found.pairs.drain(..).map(|pair| pair.impacts));
    }
    if asking.is_empty() {
        buffers.main_sides.clear();
        return;
    }
    let mut cost = Cost::default();
    {
        let items = surfaces.as_readonly();
        let paths: Vec<Option<(Path<'_>, u64)>> = active
            .surfaces
            .iter()
            .map(|surface| {
                let item = items.get_inner(surface.entity).ok()?;
                Some((path_of(surface, &item, buffers.detection), item.bounds.computed()))
            })
            .collect();
        buffers.pair_surfaces(&active.surfaces, &paths);
        let pairs = std::mem::take(&mut buffers.pairs);
        for pair in &pairs {
            buffers.sweep_pair(&active.surfaces, &paths, *pair, settings.threads, &mut cost, &mut found.pairs);
        }
        buffers.pairs = pairs;
    }
    let (detection, world) = (buffers.detection, &active.surfaces);
    buffers.spare.truncate(found.pairs.len());
    for surface in world {
        if let Some(side) = buffers.main_sides.get_mut(&surface.entity) {
            side.last_active = detection;
        }
        let Ok(item) = surfaces.get_mut(surface.entity) else { continue };
        if item.swept
            && let Some(mut previous) = item.previous
        {
            previous.remember(item.positions, surface.pose, item.bounds.computed(), detection);
        }
    }
    buffers.main_sides.retain(|_, side| side.last_active == detection);
    if cost.pairs > 0 {
        diagnostics.swept_trees_built = cost.trees_built;
        diagnostics.swept_trees_refitted = cost.trees_refitted;
        diagnostics.finish("swept", start, cost.candidates, found.pairs.iter().map(|pair| pair.impacts.len()).sum());
    }
}

impl PreviousPositions {
    fn remember(&mut self, positions: &SurfacePositions, pose: Pose, computed: u64, detection: u64) {
        if self.computed != computed || self.detection + 1 != detection {
            self.positions.clone_from(&positions.0);
        }
        (self.pose, self.computed, self.detection) = (pose, computed, detection);
    }
}

/// The way of a surface in this tick. What does not ask to be swept, or has no past, stands where it is.
fn path_of<'a>(surface: &ActiveSurface, item: &SweptItemReadOnlyItem<'a, '_>, detection: u64) -> Path<'a> {
    let (now, pose) = (&item.positions.0, surface.pose);
    let still = Path::still(now, pose);
    let target = item.target.map(|target| &target.0);
    if let Some(target) = target.filter(|target| target.len() == now.len() && first_non_finite(target).is_none()) {
        return Path { end: target, ..still };
    }
    if !item.swept {
        return still;
    }
    match item.previous {
        Some(_) if surface.fresh => still,
        Some(previous) if previous.detection + 1 == detection && previous.positions.len() == now.len() => {
            if previous.computed != item.bounds.computed() {
                return Path { start: &previous.positions, start_pose: previous.pose, ..still };
            }
            Path { start_pose: previous.pose, ..still }
        }
        _ => still,
    }
}

impl SweptBuffers {
    /// Finds the pairs of surfaces whose ways come near each other, one of them at least moving: each once, sorted.
    fn pair_surfaces(&mut self, surfaces: &[ActiveSurface], paths: &[Option<(Path<'_>, u64)>]) {
        self.pairs.clear();
        let moves = |place: u32| paths[place as usize].is_some_and(|(path, _)| !path.is_still());
        if !(0..paths.len() as u32).any(moves) {
            return;
        }
        self.world.clear();
        self.world.extend(surfaces.iter().zip(paths).map(|(surface, path)| match path {
            Some((path, _)) if !path.is_still() => path.world_bounds(),
            Some(_) => surface.world_bounds,
            None => Aabb::EMPTY,
        }));
        self.tree.rebuild(&self.world);
        self.tree.self_pairs(&mut self.pairs);
        self.pairs.retain(|&[first, second]| {
            let [one, other] = [first, second].map(|place| &surfaces[place as usize]);
            (moves(first) || moves(second)) && one.meets(other)
        });
        let places = 0..surfaces.len() as u32;
        let selves = places.filter(|&place| surfaces[place as usize].self_collision && moves(place));
        self.pairs.extend(selves.map(|place| [place, place]));
        self.pairs.sort_unstable();
    }

    /// Sweeps two surfaces, or one against itself, and appends what they meet by.
    fn sweep_pair(
        &mut self,
        surfaces: &[ActiveSurface],
        paths: &[Option<(Path<'_>, u64)>],
        [first, second]: [u32; 2],
        threads: usize,
        cost: &mut Cost,
        found: &mut Vec<SweptPair>,
    ) {
        let side = |place: u32| Some((&surfaces[place as usize], paths[place as usize]?));
        let (Some(first), Some(second)) = (side(first), side(second)) else { return };
        let is_self = first.0.entity == second.0.entity;
        let size = |surface: &ActiveSurface| surface.topology.triangles().len();
        let is_first_main = size(first.0) >= size(second.0);
        let ((main, (main_path, computed)), (other, (other_path, _))) =
            if is_first_main { (first, second) } else { (second, first) };

        let own = self.main_sides.entry(main.entity).or_default();
        own.follow(main, &main_path, computed, self.detection);
        let scale = own.frame.pose.scale();
        let [reach, other_reach] = [main, other].map(|surface| FAST * f64::from(surface.thickness) / scale);
        let mut is_fast = own.positions.is_fast(reach);
        let mut separation = own.rounding;
        if !is_self {
            let (bounds, rounding) = other_path.bounds_in(&own.frame);
            if !bounds.overlaps(&own.bounds) {
                return;
            }
            separation += rounding;
            self.moved.fill(&other_path, &own.frame);
            is_fast |= self.moved.is_fast(other_reach);
        }
        if !is_fast {
            return;
        }
        cost.pairs += 1;
        own.positions.update_boxes(&main.topology, reach);
        match own.positions.tree.update_tree() {
            TreeWork::Kept => {}
            TreeWork::Refitted => cost.trees_refitted += 1,
            TreeWork::Built => cost.trees_built += 1,
        }
        let main_side = (own.positions.mesh(&main.topology, reach), &own.positions.tree);
        let other_side = if is_self {
            main_side
        } else {
            self.moved.update_boxes(&other.topology, other_reach);
            (self.moved.mesh(&other.topology, other_reach), &self.moved.tree)
        };
        let (a, b) = if is_first_main { (main_side, other_side) } else { (other_side, main_side) };
        let sweep = Sweep { a, b, same_surface: is_self, separation };
        sweep.collect(&mut self.leaves);
        self.impacts.clear();
        let (leaves, candidates) = (&self.leaves, &self.candidates);
        let count = leaves.len();
        let work = |part, impacts: &mut Vec<PairImpact>| {
            candidates.with(|candidates| sweep.append_part(leaves, part, candidates, impacts))
        };
        cost.candidates += append_ranges(count, SWEEP_PART, threads, &self.spare_impacts, &mut self.impacts, work);
        if self.impacts.is_empty() {
            return;
        }
        sort_impacts(&mut self.impacts);
        let mut impacts = self.spare.pop().unwrap_or_default();
        impacts.clear();
        impacts.extend(self.impacts.iter().map(|impact| world_impact(impact, &own.frame.pose)));
        let mut earliest = 0;
        for (place, impact) in impacts.iter().enumerate() {
            if impact.time < impacts[earliest].time {
                earliest = place;
            }
        }
        let topologies = [first.0, second.0].map(|surface| Arc::clone(&surface.topology));
        found.push(SweptPair { a: first.0.entity, b: second.0.entity, impacts, earliest, topologies });
    }
}

fn world_impact(found: &PairImpact, frame: &Pose) -> SweptImpact {
    let impact = &found.impact;
    SweptImpact {
        time: impact.time,
        cause: impact.cause,
        triangle_a: TriangleId(found.triangle_a),
        triangle_b: TriangleId(found.triangle_b),
        features: impact.features,
        barycentric_a: impact.barycentric_a.map(|weight| weight as f32),
        barycentric_b: impact.barycentric_b.map(|weight| weight as f32),
        normal: frame.transform_direction(impact.normal).normalize_or_zero().as_vec3(),
    }
}
