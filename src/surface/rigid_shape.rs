//! Rigid shapes as sides of contacts.
//!
//! A shape is prepared once, when it is inserted. Solids are prepared for tests by formula. Shapes made of triangles
//! become surfaces that do not deform, and pass through the stages like all others.

use std::{
    fmt,
    panic::{AssertUnwindSafe, catch_unwind},
    sync::Arc,
};

use bevy_ecs::{lifecycle::HookContext, prelude::*, world::DeferredWorld};
#[cfg(feature = "reflect")]
use bevy_reflect::prelude::*;
use bevy_transform::components::Transform;
use glam::Vec3;
use parry3d::shape::{SharedShape, TypedShape};

use super::{
    active::ShapePart,
    checked::{CheckedPositions, Registration},
    components::{DeformableSurface, SurfaceFrame, SurfaceLayers, SurfacePositions, SurfaceStatus},
    spheres::{Circumspheres, EnclosingBalls, TriangleCones, TriangleCurvature},
    swept::SweptTarget,
};
use crate::kernel::{
    exact::rigid_shape::{ShapeError, ShapeGeometry, SweepPart},
    mesh::topology::SurfaceTopology,
};

/// A rigid shape that surfaces touch. The entity's transform places it (rotation, translation, uniform scale), as
/// [`SurfaceFrame`] says.
///
/// - Ball, capsule, cuboid, cylinder, cone, convex polyhedron, their rounded forms, rounded triangle, half-space, and
///   compounds of these are solids. They are tested by exact formulas in f64. A vertex inside has a negative distance,
///   however deep it is. Parts of a compound may also be triangles and segments, but not half-spaces.
/// - Triangle mesh, height field, voxels, polyline, triangle, and segment are surfaces that do not deform. They are
///   tested feature by feature, like any other surface. A closed mesh has an inside. Any other is a sheet, and contacts
///   remember on which side something was. Use [`Sidedness`](crate::Sidedness) to override this.
///
/// The entity of a shape made of triangles has its vertices as [`SurfacePositions`]. They are read-only: replace the
/// shape to change them. Contacts use the triangle and vertex numbers of the shape. For a height field and for voxels,
/// these are the numbers of parry's `to_trimesh`. Each segment of a polyline is a triangle with two equal corners.
///
/// A shape is prepared when it is inserted, and no tick calls parry. A shape that cannot be tested is quarantined with
/// a reason: see [`SurfaceQuarantined`](crate::SurfaceQuarantined). Shapes have no thickness and never touch each
/// other. For that, use a rigid-body engine.
///
/// With [`XpbdResponsePlugin`](crate::response::XpbdResponsePlugin), bodies with
/// [`SweptCollision`](crate::SweptCollision) do not pass through shapes of any kind, whether these are at rest or moved
/// by the game: see [what is guaranteed](crate::response#what-is-guaranteed). Detection alone reports impacts of such
/// surfaces with shapes of any kind in [`SurfaceImpacts`](crate::SurfaceImpacts).
///
/// ```
/// # use bevy_circumsphere::prelude::*;
/// # let mut world = bevy_ecs::world::World::new();
/// world.spawn(RigidShape(SharedShape::ball(0.5)));
/// ```
#[derive(Component, Clone)]
#[component(immutable, on_insert = Self::on_insert, on_discard = Self::on_discard)]
#[require(SurfaceFrame, SurfaceLayers, SurfaceStatus, Registration, Transform)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(opaque, Component, Clone))]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct RigidShape(pub SharedShape);

/// Names the kind of shape.
impl fmt::Debug for RigidShape {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.debug_tuple("RigidShape").field(&self.0.shape_type()).finish()
    }
}

impl RigidShape {
    /// A hook prepares a replaced shape even if no query matches its entity.
    fn on_insert(mut world: DeferredWorld, context: HookContext) {
        let Some(Self(shape)) = world.get::<Self>(context.entity).cloned() else { return };
        world.commands().entity(context.entity).queue_silenced(move |mut entity: EntityWorldMut| {
            let Prepared { solid, mesh } = prepare(&shape);
            entity.insert(solid);
            match mesh.filter(|_| !entity.contains::<DeformableSurface>()) {
                Some(mesh) => {
                    entity.insert(mesh);
                }
                None => RigidMesh::remove_from(&mut entity),
            }
        });
    }

    fn on_discard(mut world: DeferredWorld, context: HookContext) {
        world.commands().entity(context.entity).queue_silenced(|mut entity: EntityWorldMut| {
            if !entity.contains::<Self>() {
                entity.remove::<PreparedShape>();
                RigidMesh::remove_from(&mut entity);
            }
        });
    }
}

/// A prepared shape: a solid if it is tested by formula, `None` if it is a [`RigidMesh`], or the reason why it cannot
/// be tested.
#[derive(Component, Clone)]
pub(crate) struct PreparedShape(pub(crate) Result<Option<Solid>, ShapeError>);

/// A shape that is tested by formula.
#[derive(Clone)]
pub(crate) struct Solid {
    pub(crate) geometry: Arc<ShapeGeometry>,
    /// The triangles that stand for it in sweeps.
    pub(crate) parts: Arc<[ShapePart]>,
}

impl Solid {
    fn new(shape: &SharedShape) -> Result<Self, ShapeError> {
        let geometry = Arc::new(ShapeGeometry::new(shape)?);
        let parts = geometry.sweep_parts().into_iter().map(|SweepPart { points, triangles, radius }| {
            let topology = SurfaceTopology::new(&points, &triangles).map_err(|_| ShapeError::Unsupported)?;
            Ok(ShapePart { topology: Arc::new(topology), positions: points, radius: f64::from(radius) })
        });
        let parts: Result<Vec<ShapePart>, ShapeError> = parts.collect();
        Ok(Self { geometry, parts: parts?.into() })
    }
}

/// The triangles of a shape that is made of triangles.
#[derive(Component, Clone)]
#[require(
    SurfacePositions,
    CheckedPositions,
    SweptTarget,
    TriangleCurvature,
    EnclosingBalls,
    Circumspheres,
    TriangleCones
)]
pub(crate) struct RigidMesh {
    pub(crate) topology: Arc<SurfaceTopology>,
}

impl RigidMesh {
    fn remove_from(entity: &mut EntityWorldMut) {
        if entity.contains::<Self>() {
            entity.remove::<(Self, SurfacePositions, CheckedPositions, SweptTarget)>();
            entity.remove::<(TriangleCurvature, EnclosingBalls, Circumspheres, TriangleCones)>();
        }
    }
}

struct Prepared {
    solid: PreparedShape,
    mesh: Option<(RigidMesh, SurfacePositions)>,
}

fn prepare(shape: &SharedShape) -> Prepared {
    // parry asserts its assumptions about sizes and counts, some of them only when it creates a mesh.
    let made = catch_unwind(AssertUnwindSafe(|| match triangles_of(shape) {
        Some(triangles) => triangles.mesh().map(Some),
        None => Ok(None),
    }));
    match made.unwrap_or(Err(ShapeError::Unsupported)) {
        Err(error) => Prepared { solid: PreparedShape(Err(error)), mesh: None },
        Ok(Some(mesh)) => Prepared { solid: PreparedShape(Ok(None)), mesh: Some(mesh) },
        Ok(None) => {
            let solid = catch_unwind(AssertUnwindSafe(|| Solid::new(shape)));
            let solid = solid.unwrap_or(Err(ShapeError::Unsupported));
            Prepared { solid: PreparedShape(solid.map(Some)), mesh: None }
        }
    }
}

/// Why a shape cannot be tested.
#[cfg(feature = "serde")]
pub(super) fn check(shape: &SharedShape) -> Result<(), ShapeError> {
    prepare(shape).solid.0.map(|_| ())
}

/// The mesh of a shape.
struct ShapeTriangles {
    positions: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
}

impl ShapeTriangles {
    fn mesh(self) -> Result<(RigidMesh, SurfacePositions), ShapeError> {
        let Self { positions, triangles } = self;
        if positions.iter().any(|position| !position.is_finite()) {
            return Err(ShapeError::NonFinite);
        }
        let topology = SurfaceTopology::new(&positions, &triangles).map_err(|_| ShapeError::Unsupported)?;
        Ok((RigidMesh { topology: Arc::new(topology) }, SurfacePositions(positions)))
    }
}

/// The mesh of a shape that is made of triangles. A segment is a triangle with two equal corners.
fn triangles_of(shape: &SharedShape) -> Option<ShapeTriangles> {
    let bare = |positions, triangles| Some(ShapeTriangles { positions, triangles });
    match shape.as_typed_shape() {
        TypedShape::TriMesh(mesh) => bare(mesh.vertices().to_vec(), mesh.indices().to_vec()),
        TypedShape::HeightField(field) => {
            let (positions, triangles) = field.to_trimesh();
            bare(positions, triangles)
        }
        TypedShape::Voxels(voxels) => {
            let (positions, triangles) = voxels.to_trimesh();
            bare(positions, triangles)
        }
        TypedShape::Polyline(line) => {
            bare(line.vertices().to_vec(), line.indices().iter().map(|&[a, b]| [a, b, b]).collect())
        }
        TypedShape::Triangle(triangle) => bare(vec![triangle.a, triangle.b, triangle.c], vec![[0, 1, 2]]),
        TypedShape::Segment(segment) => bare(vec![segment.a, segment.b], vec![[0, 1, 1]]),
        _ => None,
    }
}
