//! Pairs of triangles by comparing every box with every other: the measure of every other broad phase, and the
//! fastest one for a handful of triangles.

use bevy_app::prelude::*;
use bevy_ecs::prelude::*;

use super::{
    BroadPhaseSystems, CandidateTrianglePairs, Frame, OtherSide, SurfacePair, fill_pairs, reaches_half_space,
    shape_bounds,
};
use crate::{
    detection::{DetectionDiagnostics, DetectionMemory, TriangleBounds},
    kernel::{
        exact::rigid_shape::ShapeGeometry,
        mesh::{
            bounds::{Aabb, pairs_between_brute_force, self_pairs_brute_force},
            ids::TriangleId,
        },
    },
    schedule::SurfaceDetection,
    settings::CircumsphereSettings,
    surface::{ActiveShape, ActiveSurface, ActiveSurfaces, SurfacePositions},
};

/// Finds pairs by comparing all boxes. Disable [`TreeBroadPhasePlugin`](super::TreeBroadPhasePlugin) and add this:
///
/// ```
/// # use bevy_app::prelude::*;
/// # use bevy_circumsphere::prelude::*;
/// # use bevy_circumsphere::detection::{BruteForceBroadPhasePlugin, TreeBroadPhasePlugin};
/// # let mut app = App::new();
/// app.add_plugins((
///     DeformableCollisionPlugins::new(Update).build().disable::<TreeBroadPhasePlugin>(),
///     BruteForceBroadPhasePlugin,
/// ));
/// ```
pub struct BruteForceBroadPhasePlugin;

impl Plugin for BruteForceBroadPhasePlugin {
    fn build(&self, app: &mut App) {
        app.add_systems(SurfaceDetection, pair_triangles.in_set(BroadPhaseSystems::PairTriangles));
    }
}

fn pair_triangles(
    active: Res<ActiveSurfaces>,
    settings: Res<CircumsphereSettings>,
    candidates: ResMut<CandidateTrianglePairs>,
    mut memory: ResMut<DetectionMemory>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
    mut moved: Local<Vec<Aabb>>,
    surfaces: Query<(&SurfacePositions, &TriangleBounds)>,
) {
    fill_pairs(candidates, &mut memory, &mut diagnostics, |pair| {
        let first = &active.surfaces[pair.first];
        let Ok((positions, bounds)) = surfaces.get(first.entity) else { return };
        match pair.second {
            _ if pair.is_self() => {
                self_pairs_brute_force(bounds.triangles(), &mut pair.triangles);
                pair.triangles.retain(|&[a, b]| !first.topology.share_vertex(TriangleId(a), TriangleId(b)));
            }
            OtherSide::Surface(second) => {
                let Ok((other_positions, other)) = surfaces.get(active.surfaces[second].entity) else { return };
                let mut sides = [bounds.triangles(), other.triangles()];
                if let Some(surface) = pair.moved_surface(&active) {
                    let (side, own) = match pair.frame {
                        Frame::First => (1, other_positions),
                        Frame::Second => (0, positions),
                    };
                    let mut mover = pair.mover(surface, own, settings.margin());
                    moved.clear();
                    let mut boxes = Vec::new();
                    mover.move_all(&mut boxes);
                    moved.extend(boxes.into_iter().map(|(_, bounds)| bounds));
                    sides[side] = &moved;
                }
                pairs_between_brute_force(sides[0], sides[1], &mut pair.triangles);
            }
            OtherSide::Shape(place) => {
                let shape = &active.shapes[place];
                pair_with_shape_brute_force(pair, shape, first, settings.margin(), bounds.triangles());
            }
        }
    });
}

/// Appends the triangles of a surface whose boxes reach a shape.
pub(super) fn pair_with_shape_brute_force(
    pair: &mut SurfacePair,
    shape: &ActiveShape,
    surface: &ActiveSurface,
    margin: f32,
    bounds: &[Aabb],
) {
    let reach = shape_bounds(pair, shape, surface, margin);
    let mut triangles = std::mem::take(&mut pair.triangles);
    let reached = (0u32..).zip(bounds).filter(|(_, bounds)| match (&reach, &*shape.geometry) {
        (Some(reach), _) => reach.overlaps(bounds),
        (None, ShapeGeometry::HalfSpace { normal }) => reaches_half_space(pair, *normal, bounds),
        (None, _) => true,
    });
    triangles.extend(reached.map(|(triangle, _)| [triangle, 0]));
    pair.triangles = triangles;
}
