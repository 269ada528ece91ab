//! What a box or a solid overlaps.

use std::cell::OnceCell;

use glam::{DAffine3, DQuat, DVec3, Quat, Vec3};
use parry3d::shape::SharedShape;

use super::{SurfaceOverlap, SurfaceQuery, SurfaceQueryFilter};
use crate::{
    detection::{SurfaceState, moved_box},
    kernel::{
        exact::rigid_shape::{ShapeError, ShapeGeometry},
        mesh::bounds::Aabb,
        pose::Pose,
        query::{box_overlap::box_overlaps_triangle, shape_cast::SolidScratch, solid::closest_on_solid},
        smooth::patch::Patch,
    },
    surface::ActiveShape,
};

/// A solid that is asked about, in the world.
pub(super) struct PosedSolid {
    pub(super) geometry: ShapeGeometry,
    /// From its frame to the world.
    pub(super) pose: DAffine3,
    /// From the world to its frame.
    pub(super) into: DAffine3,
    /// Its box, in its own frame.
    pub(super) bounds: Aabb,
}

impl PosedSolid {
    /// `None` if the position is not finite.
    pub(super) fn new(shape: &SharedShape, translation: Vec3, rotation: Quat) -> Result<Option<Self>, ShapeError> {
        let geometry = ShapeGeometry::new(shape)?;
        let bounds = geometry.bounds().ok_or(ShapeError::Unsupported)?;
        let rotation = rotation.as_dquat();
        let is_valid = translation.is_finite() && rotation.is_finite() && rotation.length_squared() > 0.0;
        Ok(is_valid.then(|| {
            let pose = DAffine3::from_rotation_translation(DQuat::normalize(rotation), translation.as_dvec3());
            Self { geometry, pose, into: pose.inverse(), bounds }
        }))
    }

    /// Its box in another frame, by center and half sides.
    pub(super) fn bounds_in(&self, into: &DAffine3) -> (DVec3, DVec3) {
        let (min, max) = (self.bounds.min.as_dvec3(), self.bounds.max.as_dvec3());
        let all = *into * self.pose;
        let matrix = all.matrix3;
        let half = (max - min) * 0.5;
        let half = matrix.x_axis.abs() * half.x + matrix.y_axis.abs() * half.y + matrix.z_axis.abs() * half.z;
        (all.transform_point3((min + max) * 0.5), half)
    }

    /// The box in another frame, rounded up.
    fn box_in(&self, into: &DAffine3) -> Aabb {
        let (center, half) = self.bounds_in(into);
        Aabb { min: (center - half).as_vec3(), max: (center + half).as_vec3() }.grown(0.0)
    }
}

impl SurfaceQuery<'_> {
    /// All triangles that share a point with a closed box in the world, and solids that do: see [`SurfaceOverlap`]. In the
    /// order of surfaces and triangles, solids last. Nothing if the box is empty or not finite.
    pub fn aabb_intersections(&self, aabb: &Aabb, filter: &SurfaceQueryFilter<'_>) -> Vec<SurfaceOverlap> {
        let mut found = Vec::new();
        if !(aabb.min.is_finite() && aabb.max.is_finite() && aabb.min.cmple(aabb.max).all()) {
            return found;
        }
        let center = (aabb.min.as_dvec3() + aabb.max.as_dvec3()) * 0.5;
        let half = aabb.max.as_dvec3() - center;
        let mut triangles: Vec<(u32, u32)> = Vec::new();
        let (made, mut scratch) = (OnceCell::new(), SolidScratch::default());
        let solid = || made.get_or_init(|| cuboid(center, half)).as_ref();
        self.visit_overlapping(aabb, filter, |surface, state, pose| {
            let reach = moved_box(aabb, &pose.inverse()).grown(0.0);
            let mut into = pose.to_affine();
            into.translation -= center;
            visit_triangles(state, &reach, |triangle, patch| {
                let patch = patch.moved(&into);
                let overlaps = if patch.is_flat() {
                    box_overlaps_triangle(half, &patch.corners)
                } else {
                    solid().is_some_and(|solid| scratch.overlaps_patch(&solid.geometry, &patch))
                };
                if overlaps {
                    triangles.push((surface, triangle));
                }
            });
        });
        self.name_triangles(&mut triangles, &mut found);
        if !self.active.shapes.is_empty()
            && let Some(solid) = solid()
        {
            self.overlap_solids(solid, filter, &mut found);
        }
        found
    }

    /// All triangles that share a point with a solid, and solids that do: see [`SurfaceOverlap`]. In the order of surfaces
    /// and triangles, solids last. `translation` and `rotation` place the shape in the world.
    ///
    /// A shape that is inside a closed surface without reaching a triangle overlaps none of them. Nothing if a number is
    /// NaN or infinite. The shape is prepared in every call: for a convex hull of many points that takes longer than the
    /// query.
    ///
    /// # Errors
    /// If the shape is not a [solid](crate::RigidShape), a triangle, or a segment, or is a half-space, or has sizes that
    /// cannot be used. See [`ShapeError`](crate::geometry::ShapeError).
    pub fn shape_intersections(
        &self,
        shape: &SharedShape,
        translation: Vec3,
        rotation: Quat,
        filter: &SurfaceQueryFilter<'_>,
    ) -> Result<Vec<SurfaceOverlap>, ShapeError> {
        let mut found = Vec::new();
        let Some(solid) = PosedSolid::new(shape, translation, rotation)? else { return Ok(found) };
        let mut triangles: Vec<(u32, u32)> = Vec::new();
        let mut scratch = SolidScratch::default();
        self.visit_overlapping(&solid.box_in(&DAffine3::IDENTITY), filter, |surface, state, pose| {
            let reach = solid.box_in(&pose.inverse().to_affine());
            let into = solid.into * pose.to_affine();
            visit_triangles(state, &reach, |triangle, patch| {
                if scratch.overlaps_patch(&solid.geometry, &patch.moved(&into)) {
                    triangles.push((surface, triangle));
                }
            });
        });
        self.name_triangles(&mut triangles, &mut found);
        self.overlap_solids(&solid, filter, &mut found);
        Ok(found)
    }

    /// Calls `visit` with the surfaces whose boxes in the world overlap a box.
    fn visit_overlapping(
        &self,
        bounds: &Aabb,
        filter: &SurfaceQueryFilter<'_>,
        mut visit: impl FnMut(u32, &SurfaceState, &Pose),
    ) {
        self.states.world_tree().query(bounds, |surface| {
            if let Some(state) = self.state(surface, filter)
                && let Some(pose) = state.pose()
            {
                visit(surface, state, pose);
            }
        });
    }

    /// Appends the solids that overlap another one.
    fn overlap_solids(&self, solid: &PosedSolid, filter: &SurfaceQueryFilter<'_>, found: &mut Vec<SurfaceOverlap>) {
        let overlapping = self.solids(filter).filter(|(_, shape)| overlap(solid, shape));
        found.extend(overlapping.map(|(_, shape)| SurfaceOverlap { entity: shape.entity, triangle: None }));
    }
}

/// An axis-aligned box in the world.
fn cuboid(center: DVec3, half: DVec3) -> Option<PosedSolid> {
    let [x, y, z] = half.as_vec3().to_array();
    let solid = PosedSolid::new(&SharedShape::cuboid(x, y, z), Vec3::ZERO, Quat::IDENTITY).ok().flatten()?;
    let pose = DAffine3::from_translation(center);
    Some(PosedSolid { pose, into: pose.inverse(), ..solid })
}

/// Calls `visit` with the triangles or patches of a surface whose boxes overlap a box, in the surface's own frame.
fn visit_triangles(state: &SurfaceState, reach: &Aabb, mut visit: impl FnMut(u32, Patch)) {
    let Some(side) = state.query_side() else { return };
    state.query_tree().query(reach, |triangle| visit(triangle, Patch::of(&side, triangle)));
}

/// Whether two solids overlap. Cylinders and cones among the shapes count as inscribed ones with 256 flat sides.
pub(super) fn overlap(solid: &PosedSolid, shape: &ActiveShape) -> bool {
    let into = solid.into * shape.pose.to_affine();
    if let ShapeGeometry::HalfSpace { normal } = &*shape.geometry {
        return lowest(solid, shape, *normal) <= 0.0;
    }
    let mut scratch = SolidScratch::default();
    for part in shape.parts.iter() {
        let radius = part.radius * shape.pose.scale();
        for corners in part.topology.triangles() {
            let corners = corners.map(|vertex| into.transform_point3(part.positions[vertex as usize].as_dvec3()));
            if scratch.overlaps(&solid.geometry, &corners, radius) {
                return true;
            }
        }
    }
    // Otherwise one may contain the other.
    let (center, _) = solid.bounds_in(&DAffine3::IDENTITY);
    let (_, on_solid) = closest_on_solid(&solid.geometry, solid.into.transform_point3(center));
    let inward = shape.pose.inverse();
    let on_solid = solid.pose.transform_point3(on_solid);
    closest_on_solid(&shape.geometry, inward.transform_point(on_solid)).0 <= 0.0
}

/// How high the lowest point of a solid is above the plane of a half-space, in world units.
pub(super) fn lowest(solid: &PosedSolid, half_space: &ActiveShape, normal: DVec3) -> f64 {
    let outward = half_space.pose.transform_direction(normal);
    let plane = half_space.pose.to_affine().translation;
    let parts = solid.geometry.sweep_parts();
    let height = |point: &Vec3| (solid.pose.transform_point3(point.as_dvec3()) - plane).dot(outward);
    let lowest =
        parts.iter().flat_map(|part| part.points.iter().map(move |point| height(point) - f64::from(part.radius)));
    lowest.fold(f64::INFINITY, f64::min)
}
