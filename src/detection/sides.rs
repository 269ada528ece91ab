//! Fetches what the kernel needs to know of a pair of surfaces.

use bevy_ecs::prelude::*;
use glam::Vec3;

use super::{
    broad_phase::{CandidateTrianglePairs, OtherSide, SurfacePair},
    refit::{Circumspheres, EnclosingBalls, TriangleCones},
};
use crate::{
    kernel::{
        pair::{MovedSide, PairSettings, SurfaceSide},
        pose::Pose,
        share::Share,
        sphere_pairs::{BallSide, CapSide},
        sphere_rows::{BallRows, CapRows},
    },
    settings::CircumsphereSettings,
    surface::{ActiveSurfaces, ContactMethod, SurfacePositions},
};

/// The positions and spheres of every surface.
pub(crate) type SphereQuery<'w, 's> =
    Query<'w, 's, (&'static SurfacePositions, &'static EnclosingBalls, &'static Circumspheres, &'static TriangleCones)>;

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
        // Behind a surface's own face may be just the other side of a thin wall.
        let one_sided = surface.one_sided && !pair.is_self();
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

/// The pose of a side that has to be moved at all.
fn moving(pose: &Pose) -> Option<&Pose> {
    (*pose != Pose::IDENTITY).then_some(pose)
}

/// The rows of the active surfaces whose triangles are in many candidate pairs, for each method; others have none.
#[derive(Resource, Clone, Debug, Default)]
pub(crate) struct SphereRows {
    caps: Vec<CapRows>,
    balls: Vec<BallRows>,
}

impl SphereRows {
    /// Makes the rows of this tick.
    pub(super) fn update(
        &mut self,
        active: &ActiveSurfaces,
        surfaces: &SphereQuery,
        candidates: &CandidateTrianglePairs,
        share: &impl Share,
    ) {
        let count = active.surfaces.len();
        self.caps.resize_with(count, CapRows::default);
        self.balls.resize_with(count, BallRows::default);
        for (place, active) in active.surfaces.iter().enumerate() {
            let Ok((positions, balls, spheres, cones)) = surfaces.get(active.entity) else { continue };
            let (topology, positions) = (&*active.topology, &*positions.0);
            let surface =
                SurfaceSide { topology, positions, moved: None, one_sided: false, mirrored: false, rows: None };
            let is_worth_it = |method| pairs_of(place, method, candidates) >= topology.triangles().len();
            if is_worth_it(ContactMethod::Circumsphere) {
                let side = CapSide { surface, spheres: &spheres.0, cones: &cones.0, pose: None, rows: None };
                side.rows(share, &mut self.caps[place]);
            } else {
                self.caps[place].clear();
            }
            if is_worth_it(ContactMethod::BoundingSphere) {
                BallSide { surface, balls: &balls.0, pose: None, rows: None }.rows(share, &mut self.balls[place]);
            } else {
                self.balls[place].clear();
            }
        }
    }
}

/// In how many pairs by a method the triangles of a surface are which has not to be moved for it.
fn pairs_of(place: usize, method: ContactMethod, candidates: &CandidateTrianglePairs) -> usize {
    let of_pair = |pair: &SurfacePair| {
        let [pose_a, pose_b] = pair.poses();
        let is_first = pair.first == place && moving(pose_a).is_none();
        let is_second = pair.second == OtherSide::Surface(place) && moving(pose_b).is_none();
        if is_first || is_second { pair.triangles.len() } else { 0 }
    };
    candidates.pairs.iter().filter(|pair| pair.method == method).map(of_pair).sum()
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
        let pose = moving(pose);
        BallSide { surface, balls, pose, rows: rows.balls.get(place).filter(|rows| pose.is_none() && !rows.is_empty()) }
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
    let (own, _, spheres_a, cones_a) = surfaces.get(active.surfaces[pair.first].entity).ok()?;
    let (other, _, spheres_b, cones_b) = surfaces.get(active.surfaces[second].entity).ok()?;
    let [surface_a, surface_b] = surface_sides(active, pair, own, other)?;
    let [pose_a, pose_b] = pair.poses();
    let side = |place: usize, surface, spheres, cones, pose| {
        let pose = moving(pose);
        CapSide {
            surface,
            spheres,
            cones,
            pose,
            rows: rows.caps.get(place).filter(|rows| pose.is_none() && !rows.is_empty()),
        }
    };
    let a = side(pair.first, surface_a, &spheres_a.0, &cones_a.0, pose_a);
    let b = side(second, surface_b, &spheres_b.0, &cones_b.0, pose_b);
    Some(test(&a, &b))
}
