//! Where rays meet surfaces and solids.

use std::cell::Cell;

use glam::{DVec3, Vec3};

use super::{
    RayHit, SurfaceQuery, SurfaceQueryFilter,
    target::{Target, is_motion, line_in},
};
use crate::{
    detection::SurfaceState,
    kernel::{
        bvh::tree::Sweep,
        mesh::ids::TriangleId,
        query::{
            ray::{RayTriangleHit, WatertightRay},
            solid::SolidLine,
        },
        smooth::patch::Patch,
    },
    surface::ActiveShape,
};

/// A ray in the world.
#[derive(Clone, Copy)]
struct WorldRay {
    origin: DVec3,
    direction: DVec3,
    range: f64,
}

impl WorldRay {
    /// `None` if there is nothing to find along it.
    fn new(origin: Vec3, direction: Vec3, max_distance: f32) -> Option<Self> {
        is_motion(origin, direction, max_distance).then(|| Self {
            origin: origin.as_dvec3(),
            direction: direction.as_dvec3(),
            range: f64::from(max_distance),
        })
    }

    fn sweep(&self) -> Sweep {
        Sweep { origin: self.origin, direction: self.direction, half_extents: DVec3::ZERO }
    }

    fn in_frame_of(&self, shape: &ActiveShape) -> SolidLine {
        line_in(shape, self.origin, self.direction, 0.0)
    }
}

/// A hit in the frame of what is hit. Distances along a ray are the same in every frame.
#[derive(Clone, Copy)]
struct Found {
    target: Target,
    hit: RayTriangleHit,
}

impl Found {
    /// Nearer hits come first, then lower surfaces, then lower triangles, and solids last.
    fn is_before(&self, other: &Self) -> bool {
        (self.hit.distance, self.target) < (other.hit.distance, other.target)
    }
}

impl SurfaceQuery<'_> {
    /// The nearest hit of a ray. `max_distance` is in lengths of `direction`, 0 or more, and may be infinite.
    ///
    /// Hits triangles from both sides, unless `filter` says otherwise, also where the ray begins on one. A ray through an
    /// edge or a vertex that triangles share never slips through between them. A ray within the plane of a triangle does
    /// not hit that triangle. A solid is hit where the ray enters it, and where it leaves it.
    ///
    /// `None` if nothing is hit, and if the direction is zero, or a number is NaN or, except for `max_distance`, infinite.
    pub fn cast_ray(
        &self,
        origin: Vec3,
        direction: Vec3,
        max_distance: f32,
        filter: &SurfaceQueryFilter<'_>,
    ) -> Option<RayHit> {
        let ray = WorldRay::new(origin, direction, max_distance)?;
        let mut nearest: Option<Found> = None;
        let range = Cell::new(ray.range);
        let mut offer = |found: Found| {
            if found.hit.distance <= range.get() && nearest.is_none_or(|nearest| found.is_before(&nearest)) {
                nearest = Some(found);
                range.set(found.hit.distance);
            }
        };
        self.states.world_tree().cast(&ray.sweep(), ray.range, |surface| {
            cast_at_surface(self.state(surface, filter)?, &ray, range.get(), filter, |triangle, hit| {
                offer(Found { target: Target::Triangle { surface, triangle }, hit });
                Some(range.get())
            });
            Some(range.get())
        });
        self.cast_at_solids(&ray, filter, offer);
        nearest.map(|found| self.ray_hit(&ray, &found))
    }

    /// All hits of a ray, nearest first: see [`cast_ray`](Self::cast_ray). A ray through an edge or a vertex may hit several
    /// of the triangles there.
    pub fn ray_hits(
        &self,
        origin: Vec3,
        direction: Vec3,
        max_distance: f32,
        filter: &SurfaceQueryFilter<'_>,
    ) -> Vec<RayHit> {
        let Some(ray) = WorldRay::new(origin, direction, max_distance) else { return Vec::new() };
        let mut hits: Vec<Found> = Vec::new();
        self.states.world_tree().cast(&ray.sweep(), ray.range, |surface| {
            if let Some(state) = self.state(surface, filter) {
                cast_at_surface(state, &ray, ray.range, filter, |triangle, hit| {
                    hits.push(Found { target: Target::Triangle { surface, triangle }, hit });
                    None
                });
            }
            None
        });
        self.cast_at_solids(&ray, filter, |found| hits.push(found));
        hits.retain(|found| found.hit.distance <= ray.range);
        hits.sort_unstable_by(|a, b| a.hit.distance.total_cmp(&b.hit.distance).then(a.target.cmp(&b.target)));
        hits.iter().map(|found| self.ray_hit(&ray, found)).collect()
    }

    /// Calls `visit` where the ray enters and leaves solids.
    fn cast_at_solids(&self, ray: &WorldRay, filter: &SurfaceQueryFilter<'_>, mut visit: impl FnMut(Found)) {
        for (place, shape) in self.solids(filter) {
            for span in ray.in_frame_of(shape).spans(&shape.geometry) {
                for (distance, is_back_face) in [(span.enter, false), (span.leave, true)] {
                    if distance >= 0.0 && distance.is_finite() && !(is_back_face && filter.culls_back_faces) {
                        let hit = RayTriangleHit { distance, barycentric: [0.0; 3], is_back_face };
                        visit(Found { target: Target::Solid(place), hit });
                    }
                }
            }
        }
    }

    fn ray_hit(&self, ray: &WorldRay, &Found { target, hit }: &Found) -> RayHit {
        let against_ray = || -ray.direction.normalize();
        let (entity, triangle, point, normal) = match target {
            Target::Triangle { surface, triangle } => {
                let (entity, state) = self.states.active(surface);
                let (point, normal) = in_world(state, triangle, &hit.barycentric);
                (entity, Some(TriangleId(triangle)), point, normal.unwrap_or_else(against_ray))
            }
            Target::Solid(place) => {
                let shape = &self.active.shapes[place];
                let outward = ray.in_frame_of(shape).outward(&shape.geometry, hit.distance);
                let normal = shape.pose.transform_direction(outward).try_normalize().unwrap_or_else(against_ray);
                (shape.entity, None, ray.origin + ray.direction * hit.distance, normal)
            }
        };
        RayHit {
            entity,
            triangle,
            barycentric: hit.barycentric.map(|weight| weight as f32),
            distance: hit.distance as f32,
            point: point.as_vec3(),
            normal: normal.as_vec3(),
            is_back_face: hit.is_back_face,
        }
    }
}

/// Calls `visit` with the triangles of a surface that the ray hits within `range` and perhaps beyond. `visit` may return a shorter
/// range.
fn cast_at_surface(
    state: &SurfaceState,
    ray: &WorldRay,
    range: f64,
    filter: &SurfaceQueryFilter<'_>,
    mut visit: impl FnMut(u32, RayTriangleHit) -> Option<f64>,
) {
    let (Some(pose), Some(side)) = (state.pose(), state.query_side()) else { return };
    let into = pose.inverse();
    let (origin, direction) = (into.transform_point(ray.origin), into.to_affine().matrix3 * ray.direction);
    let Some(watertight) = WatertightRay::new(origin, direction) else { return };
    let is_seen = |hit: &RayTriangleHit| !(hit.is_back_face && filter.culls_back_faces);
    state.query_tree().cast(&Sweep { origin, direction, half_extents: DVec3::ZERO }, range, |triangle| {
        if side.curved.is_none() {
            return watertight.hit(&side.corners(triangle)).filter(is_seen).and_then(|hit| visit(triangle, hit));
        }
        let hits = watertight.patch_hits(&Patch::of(&side, triangle)).into_iter().filter(is_seen);
        hits.fold(None, |shorter, hit| visit(triangle, hit).or(shorter))
    });
}

/// A point of a triangle or patch in the world, and the normal there, if it has one.
fn in_world(state: &SurfaceState, triangle: u32, barycentric: &[f64; 3]) -> (DVec3, Option<DVec3>) {
    let (Some(pose), Some(side)) = (state.pose(), state.query_side()) else { return (DVec3::NAN, None) };
    let patch = Patch::of(&side, triangle).moved(&pose.to_affine());
    let normal = patch.normal(barycentric).try_normalize();
    (patch.point(barycentric), normal.map(|normal| if pose.is_mirrored() { -normal } else { normal }))
}
