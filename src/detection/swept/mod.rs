//! Stage 8: finds when fast surfaces first meet during their motion.
//!
//! Only for what has [`SweptCollision`] and what it meets. It neither reads nor changes the contacts of the tick. Pairs
//! are found by the boxes that whole surfaces sweep. Their triangles are then swept in a frame that moves along with
//! the larger surface, whose tree is kept from tick to tick while it is at rest. Solids are swept as triangles with a
//! radius.

mod impacts;
mod mover;
mod path;
mod sweeping;

use std::sync::Arc;

use bevy_app::prelude::*;
use bevy_ecs::{entity::EntityHashMap, prelude::*, query::QueryData};
use bevy_platform::collections::HashMap;

pub(crate) use self::impacts::{ImpactReader, ImpactsRead};
pub use self::impacts::{SweptImpact, SweptImpacts, SweptPair};
pub(crate) use self::sweeping::Sweeping;
use self::{
    mover::{Mover, Plane},
    path::{Frame, Path, SweptPositions},
};
use super::{
    parallel::Threads,
    state::{SurfaceState, SurfaceStates},
};
use crate::{
    diagnostics::{DetectionDiagnostics, StageWatch},
    kernel::{
        bvh::tree::BoxTree,
        ccd::{ImpactList, PairImpact, Sweep, TreeWork},
        exact::rigid_shape::ShapeGeometry,
        mesh::{bounds::Aabb, ids::TriangleId},
        pose::Pose,
    },
    schedule::{SurfaceDetection, SurfaceDetectionSystems},
    settings::CircumsphereSettings,
    surface::{
        ActiveShape, ActiveSurface, ActiveSurfaces, ContactFilter, PairFilter, PreviousPositions, SweptCollision,
        SweptTarget, first_non_finite,
    },
};

/// A triangle is fast if a vertex moves farther than this share of its surface's thickness. Slower triangles that pass
/// through each other are within the same share of the contact distance before and after.
const FAST: f64 = 0.5;

/// Sweeps fast surfaces.
pub struct SweptPlugin;

impl Plugin for SweptPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<SweptImpacts>().init_resource::<SweptHistory>();
        app.add_systems(SurfaceDetection, find_impacts.in_set(SurfaceDetectionSystems::Swept));
    }
}

#[derive(QueryData)]
#[query_data(mutable)]
struct SweptItem {
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
    /// The version of the surface's positions, if it was at rest. While it stays the same, nothing here changes.
    at_rest: Option<u64>,
    /// The detection in which it was last updated.
    detection: u64,
    /// The last detection in which its surface took part.
    last_active: u64,
}

impl MainSide {
    /// Updates it, once per detection.
    fn follow(&mut self, mover: &Mover<'_>, detection: u64) {
        if std::mem::replace(&mut self.detection, detection) == detection {
            return;
        }
        let Mover { path, version, fresh, .. } = mover;
        let at_rest = path.is_still().then_some(*version);
        if at_rest.is_some() && at_rest == self.at_rest && !fresh {
            // A surface at rest in this tick may have another pose than in the last one.
            self.frame.pose = path.end_pose;
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

/// What later sweeps depend on.
#[derive(Resource, Clone, Default)]
pub(crate) struct SweptHistory {
    /// The number of the last detection.
    detection: u64,
    /// The pose of each rigid shape in the last detection, and the number of that detection.
    shapes: EntityHashMap<(Pose, u64)>,
}

/// State and buffers that are kept from tick to tick.
#[derive(Default)]
struct SweptBuffers {
    /// The number of the last detection that these are from.
    detection: u64,
    /// By entity, and by part of a shape.
    main_sides: HashMap<(Entity, Option<u32>), MainSide>,
    /// The smaller side of a pair, in the frame of the other one.
    moved: SweptPositions,
    world: Vec<Aabb>,
    tree: BoxTree,
    pairs: Vec<[u32; 2]>,
    sweeping: Sweeping,
    impacts: Vec<PairImpact>,
    /// Impact lists of earlier ticks, for reuse.
    spare: Vec<Vec<SweptImpact>>,
}

/// The cost of sweeping.
#[derive(Default)]
struct Cost {
    pairs: usize,
    candidates: usize,
    trees_built: usize,
    trees_refitted: usize,
}

#[expect(clippy::too_many_arguments, reason = "a stage reads what earlier stages wrote")]
fn find_impacts(
    active: Res<ActiveSurfaces>,
    (settings, game): (Res<CircumsphereSettings>, Option<Res<ContactFilter>>),
    mut found: ResMut<SweptImpacts>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
    (mut buffers, mut history): (Local<SweptBuffers>, ResMut<SweptHistory>),
    (asking, read): (Query<(), With<SweptCollision>>, Option<Res<ImpactsRead>>),
    states: Res<SurfaceStates>,
    mut surfaces: Query<SweptItem>,
) {
    let start = StageWatch::start("swept");
    let buffers = &mut *buffers;
    if buffers.detection != history.detection {
        // The game has gone back in time.
        buffers.main_sides.clear();
    }
    history.detection += 1;
    buffers.detection = history.detection;
    if !found.pairs.is_empty() {
        buffers.spare.extend(found.pairs.drain(..).map(|pair| pair.impacts));
    }
    if asking.is_empty() || read.is_some_and(|read| !read.0) {
        buffers.main_sides.clear();
        history.shapes.clear();
        return;
    }
    let mut cost = Cost::default();
    let (detection, world) = (buffers.detection, &*active);
    {
        let items = surfaces.as_readonly();
        let ways = world.shapes.iter().map(|shape| match shape.target {
            Some(target) => [shape.pose, target],
            None => [history.last_pose(shape.entity, &shape.pose, shape.fresh), shape.pose],
        });
        let ways: Vec<[Pose; 2]> = ways.collect();
        let mut movers: Vec<Mover<'_>> = Vec::with_capacity(world.surfaces.len());
        for (surface, state) in world.surfaces.iter().zip(states.all()) {
            let Ok(item) = items.get_inner(surface.entity) else { continue };
            let (path, asks) = history.path_of(surface, state, &item);
            movers.push(Mover::of_surface(surface, path, state.version(), asks));
        }
        let whole = movers.iter().fold(Aabb::EMPTY, |whole, mover| whole.union(&mover.world));
        let planes: Vec<Option<Plane>> =
            world.shapes.iter().zip(&ways).map(|(shape, poses)| plane(shape, poses, &whole)).collect();
        for ((shape, poses), plane) in world.shapes.iter().zip(&ways).zip(&planes) {
            movers.extend(Mover::of_shape(shape, *poses, plane.as_ref(), asking.contains(shape.entity)));
        }
        buffers.pair_movers(&movers);
        let pairs = std::mem::take(&mut buffers.pairs);
        for pair in &pairs {
            buffers.sweep_pair(&movers, *pair, game.as_deref(), settings.threads, &mut cost, &mut found.pairs);
        }
        buffers.pairs = pairs;
        for mover in &movers {
            if let Some(side) = buffers.main_sides.get_mut(&(mover.entity, mover.part)) {
                side.last_active = detection;
            }
        }
    }
    buffers.spare.truncate(found.pairs.len());
    for (surface, state) in world.surfaces.iter().zip(states.all()) {
        let Ok(item) = surfaces.get_mut(surface.entity) else { continue };
        if item.swept
            && let Some(mut previous) = item.previous
        {
            previous.remember(state.positions(), surface.pose, state.version(), detection);
        }
    }
    buffers.main_sides.retain(|_, side| side.last_active == detection);
    let rigid = world.surfaces.iter().filter(|surface| surface.rigid).map(|surface| (surface.entity, surface.pose));
    let shapes = world.shapes.iter().map(|shape| (shape.entity, shape.pose));
    history.shapes.extend(rigid.chain(shapes).map(|(entity, pose)| (entity, (pose, detection))));
    history.shapes.retain(|_, (_, seen)| *seen == detection);
    if cost.pairs > 0 {
        diagnostics.swept_trees_built = cost.trees_built;
        diagnostics.swept_trees_refitted = cost.trees_refitted;
        diagnostics.finish(start, cost.candidates, found.pairs.iter().map(|pair| pair.impacts.len()).sum());
    }
}

/// The triangle that stands for a half-space. It covers everything that may meet the half-space.
fn plane(shape: &ActiveShape, poses: &[Pose; 2], whole: &Aabb) -> Option<Plane> {
    let ShapeGeometry::HalfSpace { normal } = &*shape.geometry else { return None };
    Plane::under(whole, *normal, poses)
}

impl SweptHistory {
    /// The pose of a rigid shape in the last detection.
    fn last_pose(&self, shape: Entity, now: &Pose, fresh: bool) -> Pose {
        let last = self.shapes.get(&shape).filter(|(_, seen)| !fresh && seen + 1 == self.detection);
        last.map_or(*now, |(pose, _)| *pose)
    }

    /// The motion of a surface in this tick, and whether the surface is swept against everything that it meets. Without
    /// `SweptCollision`, or without known last positions, a surface stands still unless it has a target. Rigid shapes
    /// always move from their last pose.
    fn path_of<'a>(
        &self,
        surface: &ActiveSurface,
        state: &'a SurfaceState,
        item: &SweptItemReadOnlyItem<'a, '_>,
    ) -> (Path<'a>, bool) {
        let (now, pose) = (state.positions(), surface.pose);
        let still = Path::still(now, pose);
        let target = item.target.map(|target| &target.0);
        if let Some(target) = target.filter(|target| target.len() == now.len() && first_non_finite(target).is_none()) {
            return (Path { end: target, ..still }, true);
        }
        if surface.rigid {
            return (Path { start_pose: self.last_pose(surface.entity, &pose, surface.fresh), ..still }, item.swept);
        }
        let is_known = |previous: &&PreviousPositions| {
            !surface.fresh && previous.detection + 1 == self.detection && previous.positions.len() == now.len()
        };
        match item.previous.filter(|_| item.swept).filter(is_known) {
            Some(previous) if previous.version != state.version() && previous.positions != now => {
                (Path { start: &previous.positions, start_pose: previous.pose, ..still }, true)
            }
            Some(previous) => (Path { start_pose: previous.pose, ..still }, true),
            None => (still, item.swept),
        }
    }
}

impl SweptBuffers {
    /// Finds the pairs of movers whose motions come near each other and of which at least one moves. Each once, sorted.
    fn pair_movers(&mut self, movers: &[Mover<'_>]) {
        self.pairs.clear();
        if !movers.iter().any(Mover::moves) {
            return;
        }
        self.world.clear();
        self.world.extend(movers.iter().map(|mover| mover.world));
        self.tree.rebuild(&self.world);
        self.tree.self_pairs(&mut self.pairs);
        self.pairs.retain(|&[first, second]| movers[first as usize].meets(&movers[second as usize]));
        let selves = (0..).zip(movers).filter(|(_, mover)| mover.self_collision && mover.moves() && mover.asks);
        self.pairs.extend(selves.map(|(place, _)| [place, place]));
        self.pairs.sort_unstable();
    }

    /// Sweeps two movers, or one against itself, and appends their impacts.
    fn sweep_pair(
        &mut self,
        movers: &[Mover<'_>],
        [first, second]: [u32; 2],
        game: Option<&ContactFilter>,
        threads: usize,
        cost: &mut Cost,
        found: &mut Vec<SweptPair>,
    ) {
        let [first, second] = [first, second].map(|place| &movers[place as usize]);
        let is_self = std::ptr::eq(first, second);
        let size = |mover: &Mover<'_>| mover.topology.triangles().len();
        let is_first_main = size(first) >= size(second);
        let (main, other) = if is_first_main { (first, second) } else { (second, first) };

        let own = self.main_sides.entry((main.entity, main.part)).or_default();
        own.follow(main, self.detection);
        let scale = own.frame.pose.scale();
        let [reach, other_reach] = [main, other].map(|mover| FAST * mover.thickness / scale);
        let mut is_fast = own.positions.is_fast(reach);
        let mut separation = own.rounding + (first.radius + second.radius) / scale;
        if !is_self {
            let (bounds, rounding) = other.path.bounds_in(&own.frame);
            separation += rounding;
            if !bounds.grown((separation as f32).next_up()).overlaps(&own.bounds) {
                return;
            }
            self.moved.fill(&other.path, &own.frame);
            is_fast |= self.moved.is_fast(other_reach);
        }
        if !is_fast {
            return;
        }
        cost.pairs += 1;
        own.positions.update_boxes(main.topology, reach);
        match own.positions.tree.update_tree() {
            TreeWork::Kept => {}
            TreeWork::Refitted => cost.trees_refitted += 1,
            TreeWork::Built => cost.trees_built += 1,
        }
        let main_side = (own.positions.mesh(main.topology, reach), &own.positions.tree);
        let other_side = if is_self {
            main_side
        } else {
            self.moved.update_boxes(other.topology, other_reach);
            (self.moved.mesh(other.topology, other_reach), &self.moved.tree)
        };
        let (a, b) = if is_first_main { (main_side, other_side) } else { (other_side, main_side) };
        let sweep = Sweep { a, b, same_surface: is_self, list: ImpactList::Triangles, separation };
        let filter = PairFilter::between(&first.filter, &second.filter, is_self, game);
        cost.candidates += self.sweeping.run(&sweep, filter.as_ref(), &Threads(threads), &mut self.impacts);
        if self.impacts.is_empty() {
            return;
        }
        let part = second.part.unwrap_or_default();
        let impacts = self.impacts.iter().map(|impact| world_impact(impact, part, &own.frame.pose));
        let is_same = |pair: &&mut SweptPair| pair.a == first.entity && pair.b == second.entity;
        if let Some(pair) = found.last_mut().filter(is_same) {
            // Another part of the same shape.
            pair.impacts.extend(impacts);
            pair.find_earliest();
            return;
        }
        let mut list = self.spare.pop().unwrap_or_default();
        list.clear();
        list.extend(impacts);
        let of_b = second.part.is_none().then(|| Arc::clone(second.topology));
        found.push(SweptPair::new([first.entity, second.entity], list, (Arc::clone(first.topology), of_b)));
    }
}

fn world_impact(found: &PairImpact, part_b: u32, frame: &Pose) -> SweptImpact {
    let impact = &found.impact;
    SweptImpact {
        time: impact.time,
        cause: impact.cause,
        triangle_a: TriangleId(found.triangle_a),
        triangle_b: TriangleId(found.triangle_b),
        part_b,
        features: impact.features,
        barycentric_a: impact.barycentric_a.map(|weight| weight as f32),
        barycentric_b: impact.barycentric_b.map(|weight| weight as f32),
        normal: frame.transform_direction(impact.normal).normalize_or_zero().as_vec3(),
    }
}
