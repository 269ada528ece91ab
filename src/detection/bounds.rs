//! Stage 1: boxes of whole surfaces in the world; those of their triangles follow where something is near.

use std::{
    mem,
    sync::{
        Arc, Mutex, OnceLock, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    time::Instant,
};

use bevy_app::prelude::*;
use bevy_ecs::{change_detection::Tick, prelude::*};
use bevy_platform::sync::atomic::AtomicU64;
use bytemuck::cast_slice;
use glam::Vec3;

use super::{
    diagnostics::DetectionDiagnostics,
    parallel::{Threads, for_each_weighed},
};
use crate::{
    contacts::EVENT_HYSTERESIS,
    kernel::{
        capacity,
        mesh::{
            bounds::{Aabb, bounds_of_moved, point_bounds, triangle_bounds_on},
            motion::Motion,
            topology::SurfaceTopology,
        },
        pose::{Pose, SIMILARITY_TOLERANCE},
        simd::share::{OneByOne, Share},
    },
    schedule::{SurfaceDetection, SurfaceDetectionSystems},
    settings::CircumsphereSettings,
    surface::{ActiveSurfaces, SurfacePositions, first_non_finite},
};

/// Lengths that are rounded to f32 on the way to a box are lengthened by this factor.
const GROWTH_SLACK: f32 = 1.0 + 4.0 * f32::EPSILON;

/// The boxes of a surface's triangles in its own frame, grown by its thickness and half the margin. Other ones only
/// where positions, triangles or growth are no longer, bit by bit, those of the last detection.
#[derive(Component, Debug, Default)]
pub struct TriangleBounds {
    /// One box a triangle, once somebody has asked for them.
    triangles: OnceLock<Vec<Aabb>>,
    /// Memory for those.
    spare: Mutex<Vec<Aabb>>,
    /// Whether somebody has asked.
    are_asked_for: AtomicBool,
    /// The box of the whole surface.
    whole: Aabb,
    /// The same in the world, where the surface was last.
    in_world: Option<(Pose, Aabb)>,
    /// A count that grows by 1 whenever there are other ones, and begins [far from those](first_count) of other
    /// components: what was made from them is as old as the count it was made at.
    computed: u64,
    /// From the positions of the count before to those of the last one.
    motion: Motion,
    positions: Vec<Vec3>,
    /// The change tick of the surface's positions when they were these, and all of them were finite.
    seen: Option<Tick>,
    topology: Option<Arc<SurfaceTopology>>,
    /// Whether all vertices are corners, so that the box of those is that of the triangles.
    names_every_vertex: bool,
    growth: f32,
}

/// Where the count of a component begins: so far from those of all others that it never gets there.
fn first_count() -> u64 {
    static COMPONENTS: AtomicU64 = AtomicU64::new(0);
    1 + (COMPONENTS.fetch_add(1, Ordering::Relaxed) << u32::BITS)
}

impl TriangleBounds {
    /// One box a triangle. Where nothing is near a surface nobody asks for them, and they are not computed: unless they were
    /// asked for before the surface changed, they are when they are first asked for, once for all who ask.
    #[must_use]
    pub fn triangles(&self) -> &[Aabb] {
        self.triangles_on(&OneByOne)
    }

    /// The same, computed in tasks that may be shared.
    pub(super) fn triangles_on(&self, share: &impl Share) -> &[Aabb] {
        self.are_asked_for.store(true, Ordering::Relaxed);
        if let Some(triangles) = self.triangles.get() {
            return triangles;
        }
        // Nobody is kept waiting meanwhile: whoever shares our tasks might ask for the same.
        let mut triangles = mem::take(&mut *self.spare.lock().unwrap_or_else(PoisonError::into_inner));
        if let Some(topology) = &self.topology {
            triangle_bounds_on(share, &self.positions, topology.triangles(), self.growth, &mut triangles);
        }
        self.triangles.get_or_init(|| triangles)
    }

    /// How many triangles there are.
    pub(super) fn triangle_count(&self) -> usize {
        self.topology.as_ref().map_or(0, |topology| topology.triangles().len())
    }

    /// A count that grows by 1 whenever there are other boxes; while it stays the same, so do they, even where another
    /// component has taken the place of this one.
    pub(super) fn computed(&self) -> u64 {
        self.computed
    }

    /// Whether these positions are those that the boxes follow, all of them finite: nobody has written to them since.
    pub(crate) fn have_seen(&self, positions: &Ref<SurfacePositions>) -> bool {
        self.seen == Some(positions.last_changed())
    }

    /// The [count](Self::computed) of the boxes, where they are those of `positions`.
    pub(super) fn computed_of(&self, positions: &Ref<SurfacePositions>) -> Option<u64> {
        self.have_seen(positions).then_some(self.computed)
    }

    /// The box of the whole surface.
    pub(crate) fn whole(&self) -> &Aabb {
        &self.whole
    }

    /// How the surface has moved in its own frame from when there had been other boxes as many times.
    pub(super) fn motion_since(&self, computed: u64) -> Motion {
        match self.computed.checked_sub(computed) {
            Some(0) => Motion::REST,
            Some(1) => self.motion,
            _ => Motion::UNKNOWN,
        }
    }

    /// Takes the surface as it is now, with positions that are finite. Whether anything about it has changed.
    fn update(
        &mut self,
        positions: &Ref<SurfacePositions>,
        topology: &Arc<SurfaceTopology>,
        growth: f32,
        threads: usize,
    ) -> bool {
        let changed = positions.last_changed();
        let positions = &*positions.0;
        let same_mesh = self.topology.as_ref().is_some_and(|other| Arc::ptr_eq(other, topology));
        let same_positions = self.seen == Some(changed) || has_bits_of(&self.positions, positions);
        self.seen = Some(changed);
        if same_mesh && self.growth == growth && same_positions {
            return false;
        }
        self.motion = if same_mesh { Motion::between(&self.positions, positions) } else { Motion::UNKNOWN };
        let spare = self.spare.get_mut().unwrap_or_else(PoisonError::into_inner);
        if let Some(triangles) = self.triangles.take() {
            *spare = triangles;
        }
        self.computed = if self.topology.is_none() { first_count() } else { self.computed + 1 };
        if !same_mesh {
            self.names_every_vertex = topology.names_every_vertex();
            self.topology = Some(Arc::clone(topology));
        }
        let are_expected = mem::take(self.are_asked_for.get_mut());
        if self.names_every_vertex && !are_expected {
            self.whole = point_bounds(positions, growth);
        } else {
            // Of many surfaces that share their vertices each has its own few. Else its triangles have been asked for.
            self.whole = triangle_bounds_on(&Threads(threads), positions, topology.triangles(), growth, spare);
            self.triangles = OnceLock::from(mem::take(spare));
        }
        self.in_world = None;
        self.positions.clear();
        self.positions.extend_from_slice(positions);
        self.growth = growth;
        true
    }

    /// The box of the whole surface in the world, after [`update`](Self::update): around the turned box, and where there are few
    /// vertices no farther than those reach.
    fn update_in_world(&mut self, pose: &Pose) {
        if self.in_world.is_some_and(|(other, _)| other == *pose) {
            return;
        }
        let mut bounds = moved_box(&self.whole, pose);
        if *pose != Pose::IDENTITY && self.positions.len() <= MOST_TURNED_VERTICES {
            // A pose that is not quite a similarity stretches more along one axis than along another.
            let scale = pose.scale() * (1.0 + SIMILARITY_TOLERANCE);
            let growth = (f64::from(self.growth) * scale) as f32 * GROWTH_SLACK;
            let vertices = bounds_of_moved(pose, &self.positions).grown(growth);
            bounds = Aabb { min: bounds.min.max(vertices.min), max: bounds.max.min(vertices.max) };
        }
        self.in_world = Some((*pose, bounds));
    }
}

/// Surfaces of up to so many vertices get boxes in the world that are as small as they can be: those of a ball that is turned are
/// up to five times as large else, and meet that many more. To turn all vertices takes a tenth of what boxes of the triangles
/// take; of a surface with more of them it would be missed where the surface moves as a whole, and its triangles' boxes stay.
const MOST_TURNED_VERTICES: usize = 16_384;

/// Triangles of a surface that are worth more than one thread, by half.
const TRIANGLES_OF_ONE: usize = 65_536;

/// The boxes of an active surface, away from it while threads share them out.
struct TakenBounds {
    place: usize,
    bounds: TriangleBounds,
    has_moved: bool,
}

/// Whether two lists of positions are the same bit by bit, down to the sign of a zero: contacts have it too.
fn has_bits_of(positions: &[Vec3], others: &[Vec3]) -> bool {
    cast_slice::<Vec3, u8>(positions) == cast_slice::<Vec3, u8>(others)
}

/// Computes the boxes.
pub struct BoundsPlugin;

impl Plugin for BoundsPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<CircumsphereSettings>();
        app.add_systems(SurfaceDetection, compute_bounds.in_set(SurfaceDetectionSystems::Bounds));
    }
}

/// How far the boxes of a surface reach beyond it in world units: two boxes overlap wherever the surfaces are within
/// the distance at which their pair matters.
pub(super) fn world_growth(thickness: f32, margin: f32) -> f32 {
    (thickness * (1.0 + EVENT_HYSTERESIS) + 0.5 * margin) * GROWTH_SLACK
}

/// The same in a frame whose unit is `scale` world units.
pub(super) fn frame_growth(thickness: f32, margin: f32, scale: f64) -> f32 {
    (f64::from(world_growth(thickness, margin)) / scale) as f32 * GROWTH_SLACK
}

/// The box of a moved box.
pub(crate) fn moved_box(bounds: &Aabb, pose: &Pose) -> Aabb {
    if *pose == Pose::IDENTITY {
        return *bounds;
    }
    let corner = |bits: u32| {
        let pick = |axis: usize| if bits & (1 << axis) == 0 { bounds.min[axis] } else { bounds.max[axis] };
        pose.transform_point(Vec3::new(pick(0), pick(1), pick(2)).as_dvec3()).as_vec3()
    };
    Aabb::from_points((0..8).map(corner)).grown(0.0)
}

fn compute_bounds(
    mut active: ResMut<ActiveSurfaces>,
    settings: Res<CircumsphereSettings>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
    mut taken: Local<Vec<TakenBounds>>,
    mut surfaces: Query<(Ref<SurfacePositions>, &mut TriangleBounds)>,
) {
    diagnostics.begin_detection();
    let start = Instant::now();
    // What was gathered may have been spoiled or despawned since, by a prediction or before a run by hand: it sits this
    // detection out, and the next `Prepare` names the reason if there still is one.
    active.surfaces.retain(|surface| {
        surfaces.get(surface.entity).is_ok_and(|(positions, bounds)| {
            let are_known = bounds.have_seen(&positions);
            positions.0.len() == surface.topology.vertex_count()
                && (are_known || first_non_finite(&positions.0).is_none())
        })
    });
    for (place, surface) in active.surfaces.iter().enumerate() {
        let Ok((_, mut bounds)) = surfaces.get_mut(surface.entity) else { continue };
        taken.push(TakenBounds { place, bounds: mem::take(&mut *bounds), has_moved: false });
    }
    let all_positions = surfaces.as_readonly();
    for_each_weighed(
        &mut taken,
        settings.threads,
        TRIANGLES_OF_ONE,
        |_, taken| active.surfaces[taken.place].topology.triangles().len(),
        |_, taken, threads| {
            let surface = &active.surfaces[taken.place];
            let Ok((positions, _)) = all_positions.get(surface.entity) else { return };
            let growth = frame_growth(surface.thickness, settings.margin(), surface.pose.scale());
            taken.has_moved = taken.bounds.update(&positions, &surface.topology, growth, threads);
            taken.bounds.update_in_world(&surface.pose);
        },
    );
    for TakenBounds { place, bounds: updated, has_moved } in taken.drain(..) {
        let surface = &mut active.surfaces[place];
        let Ok((_, mut bounds)) = surfaces.get_mut(surface.entity) else { continue };
        *bounds = updated;
        diagnostics.surfaces_unmoved += usize::from(!has_moved);
        surface.world_bounds = bounds.in_world.map_or(Aabb::EMPTY, |(_, in_world)| in_world);
    }
    let count = active.surfaces.len();
    capacity::trim(&mut active.surfaces, count);
    capacity::trim(&mut taken, count);
    diagnostics.finish(DetectionDiagnostics::FIRST_DETECTION_STAGE, start, 0, 0);
}
