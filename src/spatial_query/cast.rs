//! What a moving ball or solid meets first.

use glam::{DAffine3, DVec3, Quat, Vec3};
use parry3d::shape::{SharedShape, TypedShape};

use super::{
    ShapeHit, SurfaceQuery, SurfaceQueryFilter,
    shape::{PosedSolid, lowest, overlap},
    target::{Target, is_motion, line_in},
};
use crate::kernel::{
    bvh::tree::Sweep,
    exact::rigid_shape::{ShapeError, ShapeGeometry},
    mesh::ids::TriangleId,
    query::{
        ball_cast::cast_ball,
        closest::closest_on_triangle,
        shape_cast::{SolidScratch, SolidTriangleHit},
        solid::closest_on_solid,
    },
    smooth::patch::Patch,
};

/// A hit, in the world.
#[derive(Clone, Copy)]
struct Found {
    target: Target,
    distance: f64,
    point: DVec3,
    /// From what is hit to the moving shape.
    normal: DVec3,
}

/// The first hit so far.
struct First {
    found: Option<Found>,
    range: f64,
}

impl First {
    fn offer(&mut self, next: Found) {
        let is_before = |found: &Found| (next.distance, next.target) < (found.distance, found.target);
        if next.distance <= self.range && self.found.as_ref().is_none_or(is_before) {
            (self.range, self.found) = (next.distance, Some(next));
        }
    }
}

impl SurfaceQuery<'_> {
    /// The first hit of a ball that moves from `center` along `direction`. `radius` is in world units and `max_distance` in
    /// lengths of the direction, both 0 or more; `max_distance` may be infinite.
    ///
    /// `None` if nothing is hit, and if the direction is zero, a number is negative or NaN, or any but `max_distance` is
    /// infinite.
    pub fn cast_ball(
        &self,
        center: Vec3,
        radius: f32,
        direction: Vec3,
        max_distance: f32,
        filter: &SurfaceQueryFilter<'_>,
    ) -> Option<ShapeHit> {
        if !(is_motion(center, direction, max_distance) && radius.is_finite() && radius >= 0.0) {
            return None;
        }
        let (center, way, radius) = (center.as_dvec3(), direction.as_dvec3(), f64::from(radius));
        let mut first = First { found: None, range: f64::from(max_distance) };
        let sweep = Sweep { origin: center, direction: way, half_extents: DVec3::splat(radius) };
        let ball = ShapeGeometry::Rounded { start: DVec3::ZERO, end: DVec3::ZERO, radius };
        let mut scratch = SolidScratch::default();
        self.visit_swept(&sweep, &DAffine3::from_translation(-center), filter, &mut first, |target, patch, first| {
            if !patch.is_flat() {
                if let Some(hit) = scratch.cast_patch(&ball, patch, -way, first.range) {
                    let normal = if hit.distance > 0.0 { -hit.normal } else { -way };
                    let normal = normal.try_normalize().unwrap_or_else(|| -way.normalize());
                    let point = center + hit.point + way * hit.distance;
                    first.offer(Found { target, distance: hit.distance, point, normal });
                }
                return;
            }
            let corners = patch.corners;
            if let Some(distance) = cast_ball(&corners, DVec3::ZERO, radius, way, first.range) {
                let at = way * distance;
                let closest = closest_on_triangle(&corners, at).point;
                let normal = if distance > 0.0 { at - closest } else { -way };
                let normal = normal.try_normalize().unwrap_or_else(|| -way.normalize());
                first.offer(Found { target, distance, point: center + closest, normal });
            }
        });
        for (place, shape) in self.solids(filter) {
            let line = line_in(shape, center, way, radius);
            let Some(span) = line.spans(&shape.geometry).into_iter().find(|span| span.leave >= 0.0) else { continue };
            let distance = span.enter.max(0.0);
            let (_, closest) = closest_on_solid(&shape.geometry, line.origin + line.direction * distance);
            let outward = shape.pose.transform_direction(line.outward(&shape.geometry, distance));
            let normal = if span.enter >= 0.0 { outward } else { -way }.try_normalize();
            first.offer(Found {
                target: Target::Solid(place),
                distance,
                point: shape.pose.transform_point(closest),
                normal: normal.unwrap_or_else(|| -way.normalize()),
            });
        }
        first.found.map(|found| self.shape_hit(&found))
    }

    /// The first hit of a solid that moves along `direction` without turning. `translation` and `rotation` place it in the
    /// world at the start. `max_distance` is in lengths of the direction, 0 or more, and may be infinite.
    ///
    /// `None` if nothing is hit, and if the direction is zero, or a number is NaN or, except for `max_distance`, infinite. The
    /// shape is prepared in every call. [`cast_ball`](Self::cast_ball) is faster for balls.
    ///
    /// # Errors
    /// Those of [`shape_intersections`](Self::shape_intersections).
    pub fn cast_shape(
        &self,
        shape: &SharedShape,
        translation: Vec3,
        rotation: Quat,
        direction: Vec3,
        max_distance: f32,
        filter: &SurfaceQueryFilter<'_>,
    ) -> Result<Option<ShapeHit>, ShapeError> {
        let Some(solid) = PosedSolid::new(shape, translation, rotation)? else { return Ok(None) };
        if let TypedShape::Ball(ball) = shape.as_typed_shape() {
            return Ok(self.cast_ball(translation, ball.radius, direction, max_distance, filter));
        }
        if !is_motion(translation, direction, max_distance) {
            return Ok(None);
        }
        let way = direction.as_dvec3();
        let mut first = First { found: None, range: f64::from(max_distance) };
        let (origin, half_extents) = solid.bounds_in(&DAffine3::IDENTITY);
        let mut scratch = SolidScratch::default();
        // The triangles move towards the solid.
        let approach = solid.into.matrix3 * -way;
        let found = |target: Target, hit: SolidTriangleHit| {
            let normal = if hit.distance > 0.0 { solid.pose.matrix3 * -hit.normal } else { -way };
            Found {
                target,
                distance: hit.distance,
                point: solid.pose.transform_point3(hit.point) + way * hit.distance,
                normal: normal.try_normalize().unwrap_or_else(|| -way.normalize()),
            }
        };
        let sweep = Sweep { origin, direction: way, half_extents };
        self.visit_swept(&sweep, &solid.into, filter, &mut first, |target, patch, first| {
            if let Some(hit) = scratch.cast_patch(&solid.geometry, patch, approach, first.range) {
                first.offer(found(target, hit));
            }
        });
        for (place, shape) in self.solids(filter) {
            let target = Target::Solid(place);
            if let ShapeGeometry::HalfSpace { normal } = &*shape.geometry {
                let outward = shape.pose.transform_direction(*normal);
                let (height, sinking) = (lowest(&solid, shape, *normal), -outward.dot(way));
                if height <= 0.0 || sinking > 0.0 {
                    let distance = (height / sinking).max(0.0);
                    let distance = if height <= 0.0 { 0.0 } else { distance };
                    let at = origin + way * distance;
                    let plane = shape.pose.to_affine().translation;
                    let point = at - outward * (at - plane).dot(outward);
                    first.offer(Found { target, distance, point, normal: outward });
                }
                continue;
            }
            if overlap(&solid, shape) {
                let hit = SolidTriangleHit { distance: 0.0, point: DVec3::ZERO, normal: DVec3::ZERO };
                first.offer(found(target, hit));
                continue;
            }
            let into = solid.into * shape.pose.to_affine();
            for part in shape.parts.iter() {
                let radius = part.radius * shape.pose.scale();
                for corners in part.topology.triangles() {
                    let corners =
                        corners.map(|vertex| into.transform_point3(part.positions[vertex as usize].as_dvec3()));
                    if let Some(hit) = scratch.cast(&solid.geometry, &corners, radius, approach, first.range) {
                        first.offer(found(target, hit));
                    }
                }
            }
        }
        Ok(first.found.map(|found| self.shape_hit(&found)))
    }

    /// Calls `visit` with the triangles or patches that a box may meet on its way, in the frame that `into` leads to from the world.
    fn visit_swept(
        &self,
        sweep: &Sweep,
        into: &DAffine3,
        filter: &SurfaceQueryFilter<'_>,
        first: &mut First,
        mut visit: impl FnMut(Target, &Patch, &mut First),
    ) {
        self.states.world_tree().cast(sweep, first.range, |surface| {
            let state = self.state(surface, filter)?;
            let (pose, side) = (state.pose()?, state.query_side()?);
            let inward = pose.inverse().to_affine();
            let [x, y, z] = [inward.matrix3.x_axis, inward.matrix3.y_axis, inward.matrix3.z_axis].map(DVec3::abs);
            let half = sweep.half_extents;
            let local = Sweep {
                origin: inward.transform_point3(sweep.origin),
                direction: inward.transform_vector3(sweep.direction),
                half_extents: x * half.x + y * half.y + z * half.z,
            };
            let all = *into * pose.to_affine();
            state.query_tree().cast(&local, first.range, |triangle| {
                visit(Target::Triangle { surface, triangle }, &Patch::of(&side, triangle).moved(&all), first);
                Some(first.range)
            });
            Some(first.range)
        });
    }

    fn shape_hit(&self, found: &Found) -> ShapeHit {
        let (entity, triangle) = match found.target {
            Target::Triangle { surface, triangle } => (self.states.active(surface).0, Some(TriangleId(triangle))),
            Target::Solid(place) => (self.active.shapes[place].entity, None),
        };
        ShapeHit {
            entity,
            triangle,
            distance: found.distance as f32,
            point: found.point.as_vec3(),
            normal: found.normal.as_vec3(),
        }
    }
}
