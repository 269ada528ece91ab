//! Rigid shapes as the other side of a contact.
//!
//! A shape is prepared once, when it is inserted: convex solids for tests by formula, shapes made of triangles as surfaces
//! that nothing deforms. These go the way of every other surface through the stages.

use std::{
    panic::{AssertUnwindSafe, catch_unwind},
    sync::Arc,
};

use bevy_ecs::{lifecycle::HookContext, prelude::*, world::DeferredWorld};
use bevy_transform::components::Transform;
use glam::Vec3;
use parry3d::shape::{SharedShape, TypedShape};

use super::{
    active::ShapePart,
    components::{
        CheckedPositions, DeformableSurface, Registration, SurfaceLayers, SurfacePositions, SurfaceStatus, SweptTarget,
    },
    spheres::{Circumspheres, EnclosingBalls, TriangleCones, TriangleCurvature},
};
use crate::kernel::{
    exact::rigid_shape::{ShapeError, ShapeGeometry, SweepPart},
    mesh::topology::SurfaceTopology,
};

/// A rigid shape that surfaces touch, placed by the entity's transform (rotation, translation, uniform scale).
///
/// - Ball, capsule, cuboid, cylinder, cone, convex polyhedron and their rounded forms, rounded triangle, half-space, and
///   compounds of these are solids, tested by exact formulas in f64: a vertex inside has a negative distance, however deep. Parts
///   of a compound may also be triangles and segments, but no half-spaces.
/// - Triangle mesh, height field, voxels, polyline, triangle and segment are surfaces that nothing deforms, tested feature by
///   feature like any other surface. A closed mesh has an inside, any other is a sheet, and contacts remember on which side
///   something was; [`Sidedness`](crate::Sidedness) says otherwise.
///
/// The entity of a shape made of triangles has its vertices as [`SurfacePositions`], which are to be read only: replace the shape
/// to change them. Contacts name its triangles and vertices as the shape numbers them, those of a height field and of voxels as
/// parry's `to_trimesh` does; each segment of a polyline is a triangle of which two corners are one.
///
/// A shape is prepared when it is inserted; no tick asks parry anything. What cannot be tested is set aside with the reason:
/// [`SurfaceQuarantined`](crate::SurfaceQuarantined). Shapes have no thickness, and never touch each other: that is a rigid-body
/// engine's work.
///
/// With [`XpbdResponsePlugin`](crate::response::XpbdResponsePlugin) bodies with [`SweptCollision`](crate::SweptCollision) do not
/// pass through shapes of any kind, at rest or moved by the game: [what is guaranteed](crate::response#what-is-guaranteed). Of
/// detection alone, [`SurfaceImpacts`](crate::SurfaceImpacts) has impacts of such surfaces with shapes of any kind.
///
/// ```
/// # use bevy_circumsphere::prelude::*;
/// # let mut world = bevy_ecs::world::World::new();
/// world.spawn(RigidShape(SharedShape::ball(0.5)));
/// ```
#[derive(Component, Clone)]
#[component(immutable, on_insert = Self::on_insert, on_discard = Self::on_discard)]
#[require(SurfaceLayers, SurfaceStatus, Registration, Transform)]
pub struct RigidShape(pub SharedShape);

impl RigidShape {
    /// In a hook, so that a shape that is replaced is prepared anew whether or not any query sees its entity.
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

/// What a shape is tested by where that is a formula, or why it cannot be tested. Without a geometry it is a [`RigidMesh`].
#[derive(Component, Clone)]
pub(crate) struct PreparedShape(pub(crate) Result<Option<Solid>, ShapeError>);

/// A shape that is tested by formula.
#[derive(Clone)]
pub(crate) struct Solid {
    pub(crate) geometry: Arc<ShapeGeometry>,
    /// What stands for it where motions are swept.
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
    // parry asserts what it takes for granted of sizes and counts, and some of it only where a mesh is made.
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

/// A shape as triangles.
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

/// The triangles of a shape that is made of some; a segment is a triangle of which two corners are one.
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
