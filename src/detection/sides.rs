//! Fetches what the kernel needs to know of a pair of surfaces.

use std::{mem, sync::Arc};

use bevy_ecs::{change_detection::Tick, prelude::*};
use glam::Vec3;

use super::{
    bounds::TriangleBounds,
    broad_phase::{OtherSide, SurfacePair},
    refit::{Circumspheres, EnclosingBalls, TriangleCones},
    sphere_lists::{KeptSide, KeptSpheres},
};
use crate::{
    kernel::{
        pair::{MovedSide, PairSettings, SurfaceSide},
        pose::Pose,
        simd::share::Share,
        spheres::{
            pairs::{BallSide, CapSide},
            rows::{BallRows, CapRows},
        },
    },
    settings::CircumsphereSettings,
    surface::{ActiveSurface, ActiveSurfaces, ContactMethod, SurfacePositions},
};

/// The positions and spheres of every surface, and its boxes.
pub(crate) type SphereQuery<'w, 's> = Query<
    'w,
    's,
    (
        &'static SurfacePositions,
        Ref<'static, EnclosingBalls>,
        Ref<'static, Circumspheres>,
        Ref<'static, TriangleCones>,
        &'static TriangleBounds,
    ),
>;

/// The distances of a pair, for the kernel.
pub(crate) fn pair_settings(pair: &SurfacePair, settings: &CircumsphereSettings) -> PairSettings {
    PairSettings {
        contact_distance: f64::from(pair.contact_distance),
        reported_distance: f64::from(pair.reported_distance),
        range: f64::from(pair.range),
        scale: pair.frame_pose.scale(),
        cull: match pair.method {
            ContactMethod::Polygon => false,
            ContactMethod::Circumsphere => settings.plane_cull,
            ContactMethod::BoundingSphere | ContactMethod::Closest | ContactMethod::Refined => true,
        },
        same_surface: pair.is_self(),
    }
}

/// Both surfaces of a pair in its frame, given their own positions; `None` where the second side is a shape.
pub(crate) fn surface_sides<'a>(
    active: &'a ActiveSurfaces,
    pair: &'a SurfacePair,
    first_positions: &'a SurfacePositions,
    second_positions: &'a SurfacePositions,
) -> Option<[SurfaceSide<'a>; 2]> {
    let OtherSide::Surface(second) = pair.second else { return None };
    let [positions_a, positions_b] = pair.positions(&first_positions.0, &second_positions.0);
    let [pose_a, pose_b] = pair.poses();
    let side = |place: usize, own_positions: &'a SurfacePositions, positions: &'a [Vec3], pose: &'a Pose| {
        let surface = &active.surfaces[place];
        let one_sided = is_one_sided(surface, pair);
        let rounding = pair.moved_rounding;
        let moved = moving(pose).map(|pose| MovedSide { own_positions: &own_positions.0, pose, rounding });
        SurfaceSide {
            topology: &surface.topology,
            positions,
            moved,
            one_sided,
            mirrored: pose.is_mirrored(),
            rows: None,
        }
    };
    Some([side(pair.first, first_positions, positions_a, pose_a), side(second, second_positions, positions_b, pose_b)])
}

/// Both surfaces of a pair; `None` where the second side is a shape.
pub(super) fn surface_entities(active: &ActiveSurfaces, pair: &SurfacePair) -> Option<[Entity; 2]> {
    let OtherSide::Surface(second) = pair.second else { return None };
    Some([pair.first, second].map(|place| active.surfaces[place].entity))
}

/// Whether a surface has an inside, as far as a pair goes: behind its own face may be just the other side of a thin wall.
pub(crate) fn is_one_sided(surface: &ActiveSurface, pair: &SurfacePair) -> bool {
    surface.one_sided && !pair.is_self()
}

/// The pose of a side that has to be moved at all.
fn moving(pose: &Pose) -> Option<&Pose> {
    (*pose != Pose::IDENTITY).then_some(pose)
}

/// By balls, the rows of all triangles are made where at least one of so many is in a pair. Nearly all pairs by balls are in
/// contact, and with rows those contacts need not be written before somebody reads them: where every second triangle is in a pair,
/// overlap takes half of the time so, with one in four as much as without.
const TRIANGLES_OF_BALL_PAIR: usize = 3;

/// The same by caps, of whose pairs fewer are in contact: with rows the cone stage takes half of the time where every second
/// triangle is in a pair and most pairs meet, and overlap takes twice as long without much to gain where hardly any does.
const TRIANGLES_OF_CAP_PAIR: usize = 2;

/// The same where they are made once, because the surface rests: fewer, and they take more memory than they save time.
const TRIANGLES_OF_RESTING_PAIR: usize = 64;

/// The rows of the active surfaces whose triangles are in many candidate pairs, or whose spheres stay what they are, for each
/// method; others have none.
#[derive(Resource, Clone, Debug, Default)]
pub(crate) struct SphereRows {
    caps: Vec<SharedRows<CapRows>>,
    balls: Vec<SharedRows<BallRows>>,
    /// In how many pairs the triangles of each surface are, by balls and by caps.
    counts: Vec<[usize; 2]>,
}

/// Rows that others may hold as they are, and memory for those of another tick.
#[derive(Clone, Debug, Default)]
struct SharedRows<R> {
    rows: Arc<R>,
    spare: Arc<R>,
    /// What they were made of.
    source: Option<RowSource>,
}

/// The surface whose rows they are, how many times it had had other boxes, and when its spheres changed last.
#[derive(Clone, Copy, Debug, PartialEq)]
struct RowSource {
    surface: Entity,
    computed: u64,
    changed: [Tick; 2],
}

impl<R: Clone + Default> SharedRows<R> {
    fn renew(&mut self) -> &mut R {
        if Arc::get_mut(&mut self.rows).is_none() {
            mem::swap(&mut self.rows, &mut self.spare);
        }
        if Arc::get_mut(&mut self.rows).is_none() {
            self.rows = Arc::default();
        }
        Arc::make_mut(&mut self.rows)
    }

    fn get(&self) -> Option<&Arc<R>> {
        self.source.is_some().then_some(&self.rows)
    }

    /// Makes the rows of `source` where it `is_worth_it`, unless it has them already.
    fn update(&mut self, source: RowSource, is_worth_it: bool, make: impl FnOnce(&mut R)) {
        if self.source == Some(source) {
            return;
        }
        self.source = is_worth_it.then_some(source);
        if is_worth_it {
            make(self.renew());
        }
    }
}

impl SphereRows {
    /// Makes the rows of this tick, for some pairs.
    pub(super) fn update<'a>(
        &mut self,
        active: &ActiveSurfaces,
        surfaces: &SphereQuery,
        pairs: impl Iterator<Item = &'a SurfacePair>,
        share: &impl Share,
    ) {
        let Self { caps, balls, counts } = self;
        count_pairs(active.surfaces.len(), pairs, counts);
        caps.resize_with(counts.len(), SharedRows::default);
        balls.resize_with(counts.len(), SharedRows::default);
        let all_rows = balls.iter_mut().zip(caps);
        for ((active, &[by_balls, by_caps]), (ball_rows, cap_rows)) in
            active.surfaces.iter().zip(&*counts).zip(all_rows)
        {
            let Ok((positions, balls, spheres, cones, bounds)) = surfaces.get(active.entity) else { continue };
            let (topology, positions) = (&*active.topology, &*positions.0);
            let surface =
                SurfaceSide { topology, positions, moved: None, one_sided: false, mirrored: false, rows: None };
            let source = |changed| RowSource { surface: active.entity, computed: bounds.computed(), changed };
            let is_worth_it = |pairs: usize, of_pair: usize, rests: bool| {
                let of_pair = if rests { TRIANGLES_OF_RESTING_PAIR } else { of_pair };
                pairs > 0 && of_pair * pairs >= topology.triangles().len()
            };
            let rests = !spheres.is_changed() && !cones.is_changed();
            let cap_source = source([spheres.last_changed(), cones.last_changed()]);
            cap_rows.update(cap_source, is_worth_it(by_caps, TRIANGLES_OF_CAP_PAIR, rests), |rows| {
                let side = CapSide { surface, spheres: &spheres.0, cones: &cones.0, pose: None, rows: None };
                side.rows(share, rows);
            });
            let ball_source = source([balls.last_changed(); 2]);
            ball_rows.update(ball_source, is_worth_it(by_balls, TRIANGLES_OF_BALL_PAIR, !balls.is_changed()), |rows| {
                BallSide { surface, balls: &balls.0, pose: None, rows: None }.rows(share, rows);
            });
        }
    }

    /// Forgets all rows.
    pub(super) fn clear(&mut self) {
        self.caps.clear();
        self.balls.clear();
    }

    /// The spheres of a pair as they are, where both sides have rows.
    pub(super) fn kept(&self, active: &ActiveSurfaces, pair: &SurfacePair) -> Option<KeptSpheres> {
        let OtherSide::Surface(second) = pair.second else { return None };
        let [pose_a, pose_b] = pair.poses();
        let sides = [(pair.first, pose_a), (second, pose_b)];
        match pair.method {
            ContactMethod::BoundingSphere => {
                let [a, b] = sides.map(|side| kept_side(active, pair, side, &self.balls));
                Some(KeptSpheres::Balls([a?, b?]))
            }
            ContactMethod::Circumsphere => {
                let [a, b] = sides.map(|side| kept_side(active, pair, side, &self.caps));
                Some(KeptSpheres::Caps([a?, b?]))
            }
            _ => None,
        }
    }
}

fn kept_side<R: Clone + Default>(
    active: &ActiveSurfaces,
    pair: &SurfacePair,
    (place, pose): (usize, &Pose),
    rows: &[SharedRows<R>],
) -> Option<KeptSide<R>> {
    let (surface, rows) = (&active.surfaces[place], rows.get(place)?.get()?);
    let (one_sided, pose) = (is_one_sided(surface, pair), moving(pose).copied());
    let (topology, rows) = (Arc::clone(&surface.topology), Arc::clone(rows));
    Some(KeptSide { topology, one_sided, pose, rows })
}

fn count_pairs<'a>(surface_count: usize, pairs: impl Iterator<Item = &'a SurfacePair>, counts: &mut Vec<[usize; 2]>) {
    counts.clear();
    counts.resize(surface_count, [0; 2]);
    for pair in pairs {
        let OtherSide::Surface(second) = pair.second else { continue };
        let method = match pair.method {
            ContactMethod::BoundingSphere => 0,
            ContactMethod::Circumsphere => 1,
            _ => continue,
        };
        let places = if pair.is_self() { &[pair.first][..] } else { &[pair.first, second] };
        for &place in places {
            counts[place][method] += pair.triangles.len();
        }
    }
}

/// The rows of a surface.
fn rows_of<R: Clone + Default>(rows: &[SharedRows<R>], place: usize) -> Option<&R> {
    rows.get(place).and_then(SharedRows::get).map(|rows| &**rows)
}

/// Calls `test` with the enclosing balls of both sides of a pair.
pub(crate) fn with_balls<T>(
    active: &ActiveSurfaces,
    surfaces: &SphereQuery,
    pair: &SurfacePair,
    rows: &SphereRows,
    test: impl FnOnce(&BallSide<'_>, &BallSide<'_>) -> T,
) -> Option<T> {
    let OtherSide::Surface(second) = pair.second else { return None };
    let (own, balls_a, ..) = surfaces.get(active.surfaces[pair.first].entity).ok()?;
    let (other, balls_b, ..) = surfaces.get(active.surfaces[second].entity).ok()?;
    let [surface_a, surface_b] = surface_sides(active, pair, own, other)?;
    let [pose_a, pose_b] = pair.poses();
    let side = |place: usize, surface, balls, pose| {
        let rows = rows_of(&rows.balls, place);
        BallSide { surface, balls, pose: moving(pose), rows }
    };
    let (a, b) = (side(pair.first, surface_a, &balls_a.0, pose_a), side(second, surface_b, &balls_b.0, pose_b));
    Some(test(&a, &b))
}

/// Calls `test` with the offset spheres and cones of both sides of a pair.
pub(crate) fn with_caps<T>(
    active: &ActiveSurfaces,
    surfaces: &SphereQuery,
    pair: &SurfacePair,
    rows: &SphereRows,
    test: impl FnOnce(&CapSide<'_>, &CapSide<'_>) -> T,
) -> Option<T> {
    let OtherSide::Surface(second) = pair.second else { return None };
    let (own, _, spheres_a, cones_a, _) = surfaces.get(active.surfaces[pair.first].entity).ok()?;
    let (other, _, spheres_b, cones_b, _) = surfaces.get(active.surfaces[second].entity).ok()?;
    let [surface_a, surface_b] = surface_sides(active, pair, own, other)?;
    let [pose_a, pose_b] = pair.poses();
    let side = |place: usize, surface, spheres, cones, pose| {
        let rows = rows_of(&rows.caps, place);
        CapSide { surface, spheres, cones, pose: moving(pose), rows }
    };
    let a = side(pair.first, surface_a, &spheres_a.0, &cones_a.0, pose_a);
    let b = side(second, surface_b, &spheres_b.0, &cones_b.0, pose_b);
    Some(test(&a, &b))
}
