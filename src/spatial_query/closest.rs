//! The closest point, and what is within a distance.

use glam::{DVec3, Vec3};

use super::{ClosestPoint, SurfaceOverlap, SurfaceQuery, SurfaceQueryFilter};
use crate::{
    detection::SurfaceState,
    kernel::{
        mesh::{feature::Feature, ids::TriangleId, side::rise},
        query::{
            closest::{ClosestOnTriangle, closest_on_patch, closest_on_triangle},
            solid::closest_on_solid,
        },
        smooth::{on_shape::PatchScratch, patch::Patch},
    },
};

/// A pose that is a similarity only within its tolerance shortens no length by more than this beyond its scale.
const LEAST_STRETCH: f64 = 0.995;

/// The closest point of one triangle, relative to the point that was asked for, in the world.
#[derive(Clone, Copy)]
struct Found {
    squared: f64,
    surface: u32,
    triangle: u32,
    closest: ClosestOnTriangle,
}

impl Found {
    fn is_before(&self, other: &Self) -> bool {
        (self.squared, self.surface, self.triangle) < (other.squared, other.surface, other.triangle)
    }
}

impl SurfaceQuery<'_> {
    /// The closest point of any surface or shape within `max_distance` of a point: in world units, 0 or more, and perhaps
    /// infinite. Inside a solid, that is the way out, and nothing is closer than the distance to its surface.
    ///
    /// `None` if there is none, and if a number is NaN or, except for `max_distance`, infinite.
    pub fn closest_point(
        &self,
        point: Vec3,
        max_distance: f32,
        filter: &SurfaceQueryFilter<'_>,
    ) -> Option<ClosestPoint> {
        if !(point.is_finite() && max_distance >= 0.0) {
            return None;
        }
        let (point, mut range) = (point.as_dvec3(), f64::from(max_distance));
        let mut nearest: Option<Found> = None;
        self.states.world_tree().nearest(point, range, |surface| {
            if let Some(state) = self.state(surface, filter) {
                visit_near(state, point, range, |triangle, closest| {
                    let squared = closest.point.length_squared();
                    let found = Found { squared, surface, triangle, closest };
                    if squared <= range * range && nearest.is_none_or(|nearest| found.is_before(&nearest)) {
                        nearest = Some(found);
                        range = range.min(squared.sqrt() * (1.0 + 4.0 * f64::EPSILON));
                    }
                    Some(range)
                });
            }
            Some(range)
        });
        let mut best = nearest.map(|found| self.on_surface(point, &found));
        let mut least = nearest.map_or(f64::from(max_distance), |found| found.squared.sqrt());
        for (_, shape) in self.solids(filter) {
            let (distance, closest) = closest_on_solid(&shape.geometry, shape.pose.inverse().transform_point(point));
            let distance = distance * shape.pose.scale();
            if distance.abs() < least || best.is_none() && distance.abs() <= least {
                least = distance.abs();
                best = Some(ClosestPoint {
                    entity: shape.entity,
                    triangle: None,
                    barycentric: [0.0; 3],
                    distance: distance as f32,
                    point: shape.pose.transform_point(closest).as_vec3(),
                });
            }
        }
        best
    }

    fn on_surface(&self, point: DVec3, found: &Found) -> ClosestPoint {
        let (entity, state) = self.states.active(found.surface);
        let ClosestOnTriangle { point: closest, barycentric, feature } = found.closest;
        let mut distance = found.squared.sqrt();
        if let (true, Some(pose), Some(side)) = (state.is_one_sided(), state.pose(), state.query_side()) {
            // From the closest point, in the surface's own frame.
            let direction = pose.to_affine().matrix3.inverse() * -closest;
            let rise = match feature {
                Feature::Face if side.curved.is_some() => {
                    Patch::of(&side, found.triangle).normal(&barycentric).dot(direction)
                }
                _ => rise(side.topology, side.positions, found.triangle as usize, feature, direction),
            };
            if rise < 0.0 {
                distance = -distance;
            }
        }
        ClosestPoint {
            entity,
            triangle: Some(TriangleId(found.triangle)),
            barycentric: barycentric.map(|weight| weight as f32),
            distance: distance as f32,
            point: (point + closest).as_vec3(),
        }
    }

    /// All triangles that come within `radius` of `center`, in world units, and solids that do: see
    /// [`SurfaceOverlap`]. In the order of surfaces and triangles, solids last.
    ///
    /// A ball that is inside a closed surface without reaching a triangle overlaps none of them:
    /// [`closest_point`](Self::closest_point) tells. Nothing if a number is negative, NaN, or infinite.
    pub fn ball_intersections(
        &self,
        center: Vec3,
        radius: f32,
        filter: &SurfaceQueryFilter<'_>,
    ) -> Vec<SurfaceOverlap> {
        let mut found = Vec::new();
        if !(center.is_finite() && radius.is_finite() && radius >= 0.0) {
            return found;
        }
        let (center, range) = (center.as_dvec3(), f64::from(radius));
        let mut triangles: Vec<(u32, u32)> = Vec::new();
        self.states.world_tree().nearest(center, range, |surface| {
            if let Some(state) = self.state(surface, filter) {
                visit_near(state, center, range, |triangle, closest| {
                    if closest.point.length_squared() <= range * range {
                        triangles.push((surface, triangle));
                    }
                    None
                });
            }
            None
        });
        self.name_triangles(&mut triangles, &mut found);
        for (_, shape) in self.solids(filter) {
            let (distance, _) = closest_on_solid(&shape.geometry, shape.pose.inverse().transform_point(center));
            if distance * shape.pose.scale() <= range {
                found.push(SurfaceOverlap { entity: shape.entity, triangle: None });
            }
        }
        found
    }

    /// Sorts triangles and appends them.
    pub(super) fn name_triangles(&self, triangles: &mut [(u32, u32)], found: &mut Vec<SurfaceOverlap>) {
        triangles.sort_unstable();
        found.extend(triangles.iter().map(|&(surface, triangle)| SurfaceOverlap {
            entity: self.states.active(surface).0,
            triangle: Some(TriangleId(triangle)),
        }));
    }
}

/// Calls `visit` with triangles of a surface that may be within `range` of a point in the world, and with the closest point
/// of each relative to that point. `visit` may return a shorter range.
fn visit_near(
    state: &SurfaceState,
    point: DVec3,
    range: f64,
    mut visit: impl FnMut(u32, ClosestOnTriangle) -> Option<f64>,
) {
    let (Some(pose), Some(side)) = (state.pose(), state.query_side()) else { return };
    let local = |range: f64| range / (pose.scale() * LEAST_STRETCH);
    let mut affine = pose.to_affine();
    affine.translation -= point;
    let mut scratch = PatchScratch::default();
    let mut range = range;
    state.query_tree().nearest(pose.inverse().transform_point(point), local(range), |triangle| {
        let patch = Patch::of(&side, triangle).moved(&affine);
        let closest = if side.curved.is_none() {
            closest_on_triangle(&patch.corners, DVec3::ZERO)
        } else {
            closest_on_patch(&patch, DVec3::ZERO, range, &mut scratch)?
        };
        let shorter = visit(triangle, closest);
        range = shorter.unwrap_or(range);
        shorter.map(local)
    });
}
