//! Fetches what the kernel needs to know of a pair of surfaces.

use bevy_ecs::prelude::*;
use glam::Vec3;

use super::{
    broad_phase::{OtherSide, SurfacePair},
    refit::{Circumspheres, EnclosingBalls, TriangleCones},
};
use crate::{
    kernel::{
        pair::{MovedSide, PairSettings, SurfaceSide},
        pose::Pose,
        sphere_pairs::{BallSide, CapSide},
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
        SurfaceSide { topology: &surface.topology, positions, moved, one_sided, mirrored: pose.is_mirrored() }
    };
    Some([side(pair.first, first_positions, positions_a, pose_a), side(second, second_positions, positions_b, pose_b)])
}

/// The pose of a side that has to be moved at all.
fn moving(pose: &Pose) -> Option<&Pose> {
    (*pose != Pose::IDENTITY).then_some(pose)
}

/// Calls `test` with the enclosing balls of both sides of a pair.
pub(crate) fn with_balls<T>(
    active: &ActiveSurfaces,
    surfaces: &SphereQuery,
    pair: &SurfacePair,
    test: impl FnOnce(&BallSide<'_>, &BallSide<'_>) -> T,
) -> Option<T> {
    let OtherSide::Surface(second) = pair.second else { return None };
    let (own, balls_a, ..) = surfaces.get(active.surfaces[pair.first].entity).ok()?;
    let (other, balls_b, ..) = surfaces.get(active.surfaces[second].entity).ok()?;
    let [surface_a, surface_b] = surface_sides(active, pair, own, other)?;
    let [pose_a, pose_b] = pair.poses();
    let a = BallSide { surface: surface_a, balls: &balls_a.0, pose: moving(pose_a) };
    let b = BallSide { surface: surface_b, balls: &balls_b.0, pose: moving(pose_b) };
    Some(test(&a, &b))
}

/// Calls `test` with the offset spheres and cones of both sides of a pair.
pub(crate) fn with_caps<T>(
    active: &ActiveSurfaces,
    surfaces: &SphereQuery,
    pair: &SurfacePair,
    test: impl FnOnce(&CapSide<'_>, &CapSide<'_>) -> T,
) -> Option<T> {
    let OtherSide::Surface(second) = pair.second else { return None };
    let (own, _, spheres_a, cones_a) = surfaces.get(active.surfaces[pair.first].entity).ok()?;
    let (other, _, spheres_b, cones_b) = surfaces.get(active.surfaces[second].entity).ok()?;
    let [surface_a, surface_b] = surface_sides(active, pair, own, other)?;
    let [pose_a, pose_b] = pair.poses();
    let a = CapSide { surface: surface_a, spheres: &spheres_a.0, cones: &cones_a.0, pose: moving(pose_a) };
    let b = CapSide { surface: surface_b, spheres: &spheres_b.0, cones: &cones_b.0, pose: moving(pose_b) };
    Some(test(&a, &b))
}
