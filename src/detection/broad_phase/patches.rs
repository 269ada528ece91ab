//! Computes the patches of smooth surfaces where something is near.
//!
//! The boxes of triangles contain every patch that they may have.

use bevy_ecs::prelude::*;
use glam::DVec3;

use crate::{
    detection::{
        pairs::{CandidateTrianglePairs, GROWTH_SLACK, OtherSide, SurfacePair, moved_box, shape_bounds},
        parallel::for_each_weighed,
        reuse::DetectionMemory,
        state::SurfaceStates,
    },
    diagnostics::{DetectionDiagnostics, StageWatch},
    kernel::{capacity, exact::rigid_shape::ShapeGeometry, mesh::bounds::Aabb, pose::Pose},
    settings::CircumsphereSettings,
    surface::{ActiveSurfaces, ContactMethod, SurfaceShape},
};

/// Half the number of triangles from which a surface is worth several threads.
const TRIANGLES_OF_ONE: usize = 8192;

/// Where the patches of a surface are wanted, in its own frame.
#[derive(Clone, Copy, Debug)]
pub(in crate::detection) enum Region {
    Everywhere,
    Within(Aabb),
    /// Where `normal` times a point is at most `height`.
    Below {
        normal: DVec3,
        height: f64,
    },
}

impl Region {
    fn meets(&self, bounds: &Aabb) -> bool {
        match self {
            Self::Everywhere => true,
            Self::Within(region) => region.overlaps(bounds),
            Self::Below { normal, height } => {
                let toward = normal.cmpgt(DVec3::ZERO);
                let lowest = DVec3::select(toward, bounds.min.as_dvec3(), bounds.max.as_dvec3());
                normal.dot(lowest) <= *height
            }
        }
    }

    /// The half-space below a plane through the origin, and what is within a distance of it, in the frame from which
    /// `pose` transforms to that of the half-space.
    fn below(normal: DVec3, distance: f64, pose: &Pose) -> Self {
        let affine = pose.to_affine();
        Self::Below { normal: affine.matrix3.transpose() * normal, height: distance - normal.dot(affine.translation) }
    }
}

pub(super) fn bend_surfaces(
    active: Res<ActiveSurfaces>,
    settings: Res<CircumsphereSettings>,
    memory: Res<DetectionMemory>,
    candidates: Res<CandidateTrianglePairs>,
    mut diagnostics: ResMut<DetectionDiagnostics>,
    mut regions: Local<Vec<Vec<Region>>>,
    mut states: ResMut<SurfaceStates>,
) {
    if active.surfaces.iter().all(|surface| surface.shape == SurfaceShape::Flat) {
        regions.clear();
        return;
    }
    let start = StageWatch::start("patches");
    regions.resize_with(active.surfaces.len(), Vec::new);
    regions.iter_mut().for_each(capacity::clear);
    for (_, pair) in candidates.pairs.iter().enumerate().filter(|&(place, _)| !memory.keeps(place)) {
        add_regions(&active, pair, &mut regions);
    }
    for_each_weighed(
        states.all_mut(),
        settings.threads,
        TRIANGLES_OF_ONE,
        |place, _| if regions[place].is_empty() { 0 } else { active.surfaces[place].topology.triangles().len() },
        |place, state, threads| {
            let regions = &regions[place];
            if !regions.is_empty() {
                state.bounds.bend(threads, |bounds| regions.iter().any(|region| region.meets(bounds)));
            }
        },
    );
    diagnostics.finish(start, 0, 0);
}
/// Adds where a pair wants the patches of its surfaces.
fn add_regions(active: &ActiveSurfaces, pair: &SurfacePair, regions: &mut [Vec<Region>]) {
    let surface = |place: usize| &active.surfaces[place];
    match pair.second {
        OtherSide::Surface(second) => {
            // Spheres are made for whole surfaces.
            let has_spheres = matches!(pair.method, ContactMethod::Circumsphere | ContactMethod::BoundingSphere);
            for (own, other) in [(pair.first, second), (second, pair.first)] {
                if surface(own).shape == SurfaceShape::Flat {
                    continue;
                }
                let region = if own == other || has_spheres {
                    Region::Everywhere
                } else {
                    Region::Within(moved_box(&surface(other).world_bounds, &surface(own).pose.inverse()))
                };
                regions[own].push(region);
            }
        }
        OtherSide::Shape(place) => {
            let (shape, own) = (&active.shapes[place], surface(pair.first));
            if own.shape == SurfaceShape::Flat {
                return;
            }
            let region = match (shape_bounds(pair, shape, own), &*shape.geometry) {
                (Some(bounds), _) => Region::Within(bounds),
                (None, ShapeGeometry::HalfSpace { normal }) => {
                    let distance = f64::from(pair.range) / pair.frame_pose.scale();
                    Region::below(*normal, distance * f64::from(GROWTH_SLACK), &pair.relative_pose)
                }
                (None, _) => Region::Everywhere,
            };
            regions[pair.first].push(region);
        }
    }
}
