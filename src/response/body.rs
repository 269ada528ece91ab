//! The components that make a surface a body: its masses, its material, and its rest shape.

use std::sync::{
    Arc,
    atomic::{AtomicBool, Ordering},
};

use bevy_ecs::prelude::*;
#[cfg(feature = "reflect")]
use bevy_reflect::prelude::*;
use glam::{DVec3, Vec3};

use super::{
    error::XpbdBodyError,
    material::{XpbdMaterial, check_material},
    rest::{RestShape, area},
};
use crate::{
    kernel::{
        bvh::tree::BoxTree,
        ccd::outward_box,
        mesh::{
            ids::{TetrahedronId, VertexId},
            topology::SurfaceTopology,
        },
        pose::Pose,
    },
    surface::{DeformableSurface, SurfacePositions, SweptTarget, TetrahedralBody},
};

/// Whether the warning about a volume on an open surface has been logged.
static HAS_WARNED_OF_OPEN_VOLUME: AtomicBool = AtomicBool::new(false);

/// Friction of a surface or rigid shape. Two sides in contact use the geometric mean of their coefficients, so a
/// frictionless side slides on everything.
#[derive(Component, Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Component, Clone, Debug, Default, PartialEq))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct SurfaceFriction {
    /// Static coefficient: a resting contact holds while the tangential force is at most this share of the normal
    /// force. 0 or more. Default 0.5.
    pub static_coefficient: f32,
    /// Dynamic coefficient: a sliding contact is slowed by this share of the normal force. 0 or more, and at most the
    /// static coefficient. Default 0.4.
    pub dynamic_coefficient: f32,
}

impl SurfaceFriction {
    /// No friction.
    pub const NONE: Self = Self { static_coefficient: 0.0, dynamic_coefficient: 0.0 };

    /// Static and dynamic friction between two sides in contact.
    pub(super) fn between(self, other: Self) -> [f64; 2] {
        let mean = |own: f32, other: f32| (f64::from(own.max(0.0)) * f64::from(other.max(0.0))).sqrt();
        let holding = mean(self.static_coefficient, other.static_coefficient);
        [holding, mean(self.dynamic_coefficient, other.dynamic_coefficient).min(holding)]
    }
}

impl Default for SurfaceFriction {
    fn default() -> Self {
        Self { static_coefficient: 0.5, dynamic_coefficient: 0.4 }
    }
}

/// Makes a surface a body that falls, stretches, bends, keeps its volume, and responds to contacts. Needs
/// [`XpbdResponsePlugin`](super::XpbdResponsePlugin). A surface without this component is static or moves as the game
/// writes it, and nothing pushes it.
///
/// ```
/// # use bevy_circumsphere::{prelude::*, response::*};
/// # use glam::Vec3;
/// # let mut world = bevy_ecs::world::World::new();
/// let corners = [Vec3::ZERO, Vec3::X, Vec3::Z, Vec3::X + Vec3::Z];
/// let (surface, positions) = DeformableSurface::from_mesh(&corners, &[[0, 2, 1], [1, 2, 3]])?;
/// let body = XpbdBody::new(&surface, &positions, XpbdMaterial::CLOTH)?.pinned([VertexId(0), VertexId(1)]);
/// world.spawn((surface, positions, body, SelfCollision));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Component, Clone, Debug)]
#[require(SweptTarget)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(opaque, Component, Clone, Debug))]
pub struct XpbdBody {
    /// The velocity of every vertex, in world units per second.
    pub velocities: Vec<Vec3>,
    /// One over the mass of every vertex, in 1/kg; finite and 0 or more. 0 pins a vertex: it stays in place, or moves
    /// to where the game writes its position. Welded vertices count as one, which is pinned if any of them is.
    pub inverse_masses: Vec<f32>,
    /// The material.
    pub material: XpbdMaterial,
    /// The mesh that the body was made for.
    pub(super) mesh: Arc<SurfaceTopology>,
    pub(super) rest: Arc<RestShape>,
    /// The positions that the response last wrote, in the surface's own frame.
    pub(super) written: Vec<Vec3>,
    /// The pose of that frame in the world at that time.
    pub(super) stood: Option<Pose>,
}

impl XpbdBody {
    /// A body at rest in its rest shape. The mass of a vertex is a third of the mass of the triangles around it. A
    /// vertex without a triangle of positive area gets the mean mass.
    ///
    /// # Errors
    /// If the number of positions does not match the surface, a position is not finite, or a material value is out of
    /// range.
    pub fn new(
        surface: &DeformableSurface,
        positions: &SurfacePositions,
        material: XpbdMaterial,
    ) -> Result<Self, XpbdBodyError> {
        let topology = surface.topology();
        check_positions(topology, positions)?;
        check_material(&material)?;
        let points: Vec<DVec3> = positions.0.iter().map(|position| position.as_dvec3()).collect();
        let mut areas = vec![0.0; points.len()];
        for &triangle in topology.welded_triangles() {
            let share = area(&triangle, &points) / 3.0;
            for vertex in triangle {
                areas[vertex as usize] += share;
            }
        }
        let rest = RestShape::new(topology, &positions.0, None)?;
        if material.volume_compliance.is_finite() && rest.volume.is_none() {
            warn_of_open_volume(topology);
        }
        Ok(Self::at_rest(topology, rest, material, &areas, material.area_density))
    }

    /// A tetrahedral body at rest in its rest shape, whose inside resists as
    /// [`young_modulus`](XpbdMaterial::young_modulus) and [`poisson_ratio`](XpbdMaterial::poisson_ratio) say. The mass of
    /// a vertex is a quarter of the mass of the tetrahedra around it, evened out among neighbors, so that no corner is much
    /// lighter than the vertices around it. The sum is kept. A vertex without mass gets the mean mass.
    ///
    /// Tetrahedra that are inverted or nearly flat at rest do not resist: see [`left_out`](Self::left_out).
    ///
    /// ```
    /// # use bevy_circumsphere::{prelude::*, response::*};
    /// # use glam::Vec3;
    /// # let mut world = bevy_ecs::world::World::new();
    /// let corners = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z];
    /// let (inside, surface, positions) = TetrahedralBody::from_mesh(&corners, &[[0, 1, 2, 3]])?;
    /// let rubber = XpbdMaterial { young_modulus: 5.0e5, ..XpbdMaterial::SOLID };
    /// let body = XpbdBody::tetrahedral(&inside, &surface, &positions, rubber)?;
    /// world.spawn((inside, surface, positions, body));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// As for [`new`](Self::new), and if the tetrahedra have another number of vertices than the surface.
    pub fn tetrahedral(
        body: &TetrahedralBody,
        surface: &DeformableSurface,
        positions: &SurfacePositions,
        material: XpbdMaterial,
    ) -> Result<Self, XpbdBodyError> {
        let topology = surface.topology();
        check_positions(topology, positions)?;
        check_material(&material)?;
        count("vertices of tetrahedra", topology.vertex_count(), body.topology().vertex_count())?;
        let rest = RestShape::new(topology, &positions.0, Some(body.topology().tetrahedra()))?;
        let volumes = rest.inside.as_ref().map_or_else(Vec::new, |inside| inside.volumes.clone());
        Ok(Self::at_rest(topology, rest, material, &volumes, material.density))
    }

    /// A body whose vertices have these amounts of a material, in square or cubic meters.
    fn at_rest(
        topology: &Arc<SurfaceTopology>,
        rest: RestShape,
        material: XpbdMaterial,
        amounts: &[f64],
        density: f32,
    ) -> Self {
        let (mut total, mut counted) = (0.0, 0usize);
        for &amount in amounts.iter().filter(|&&amount| amount > 0.0) {
            total += amount;
            counted += 1;
        }
        let mean = if counted > 0 { total / counted as f64 } else { 1.0 };
        let mass = |amount: f64| if amount > 0.0 { amount } else { mean } * f64::from(density);
        Self {
            velocities: vec![Vec3::ZERO; topology.vertex_count()],
            inverse_masses: topology.weld().iter().map(|&own| (1.0 / mass(amounts[own as usize])) as f32).collect(),
            material,
            mesh: Arc::clone(topology),
            rest: Arc::new(rest),
            written: Vec::new(),
            stood: None,
        }
    }

    /// The tetrahedra that do not resist deformation, ascending: at rest, they are inverted, or their volume is below
    /// 1/1,500 of the cube of their longest edge. Empty if the body is not [tetrahedral](Self::tetrahedral).
    #[must_use]
    pub fn left_out(&self) -> &[TetrahedronId] {
        self.rest.inside.as_ref().map_or(&[], |inside| &inside.left_out)
    }

    /// The volume of every tetrahedron at some positions relative to that at rest: 1 at rest, 0 or less if it is
    /// inverted, NaN if it is [left out](Self::left_out) because it is flat. Empty if the body is not tetrahedral.
    ///
    /// # Panics
    /// If there are fewer positions than the body has vertices.
    pub fn relative_volumes<'a>(&'a self, positions: &'a [Vec3]) -> impl Iterator<Item = f32> + 'a {
        self.rest.inside.iter().flat_map(|inside| inside.relative_volumes(positions))
    }

    /// Pins the given vertices. Vertices out of range are ignored, with a warning in the log.
    #[must_use]
    pub fn pinned(mut self, vertices: impl IntoIterator<Item = VertexId>) -> Self {
        let count = self.inverse_masses.len();
        for vertex in vertices {
            match self.inverse_masses.get_mut(vertex.index()) {
                Some(inverse_mass) => *inverse_mass = 0.0,
                None => log::warn!("vertex {} cannot be pinned: the body has {count} vertices", vertex.0),
            }
        }
        self
    }

    /// Gives all vertices the same velocity, in world units per second.
    #[must_use]
    pub fn moving(mut self, velocity: Vec3) -> Self {
        self.velocities.fill(velocity);
        self
    }

    /// Kinetic energy of all vertices that are not pinned, in joules.
    #[must_use]
    pub fn kinetic_energy(&self) -> f64 {
        self.free_vertices()
            .map(|(velocity, inverse)| 0.5 * velocity.as_dvec3().length_squared() / f64::from(inverse))
            .sum()
    }

    /// Velocities and inverse masses of the vertices that are not pinned.
    pub(super) fn free_vertices(&self) -> impl Iterator<Item = (Vec3, f32)> {
        let vertices = self.velocities.iter().copied().zip(self.inverse_masses.iter().copied());
        vertices.filter(|&(_, inverse_mass)| inverse_mass > 0.0)
    }

    /// The same body with another mesh, whose positions become its rest shape. Every vertex takes over the velocity of
    /// the nearest vertex of the old mesh, and is pinned if that one is.
    ///
    /// # Errors
    /// As for [`new`](Self::new).
    pub(super) fn with_mesh(
        &self,
        surface: &DeformableSurface,
        inside: Option<&TetrahedralBody>,
        positions: &SurfacePositions,
        pose: &Pose,
    ) -> Result<Self, XpbdBodyError> {
        let mut body = match inside {
            Some(inside) => Self::tetrahedral(inside, surface, positions, self.material)?,
            None => Self::new(surface, positions, self.material)?,
        };
        let Some(stood) = self.stood else { return Ok(body) };
        // The game may have changed the number of any of these.
        let count = self.written.len().min(self.velocities.len()).min(self.inverse_masses.len());
        let old = self.written[..count].iter().map(|at| stood.transform_point(at.as_dvec3()));
        let old: Vec<DVec3> = old.collect();
        let tree = BoxTree::new(&old.iter().map(|&at| outward_box([at])).collect::<Vec<_>>());
        for (vertex, at) in positions.0.iter().enumerate() {
            let at = pose.transform_point(at.as_dvec3());
            let nearest = tree.nearest_item(at, |place| old[place as usize].distance_squared(at));
            let Some(nearest) = nearest.map(|place| place as usize) else { break };
            body.velocities[vertex] = self.velocities[nearest];
            if self.inverse_masses[nearest] <= 0.0 {
                body.inverse_masses[vertex] = 0.0;
            }
        }
        Ok(body)
    }

    /// Whether the body was made for other triangles, or for vertices that coincided differently.
    pub(super) fn is_of_another(&self, mesh: &Arc<SurfaceTopology>) -> bool {
        let is_same = |own: &SurfaceTopology| own.triangles() == mesh.triangles() && own.weld() == mesh.weld();
        !Arc::ptr_eq(&self.mesh, mesh) && !is_same(&self.mesh)
    }

    /// Checks that the body has the tetrahedra that its entity has.
    pub(super) fn check_inside(&self, body: Option<&TetrahedralBody>) -> Result<(), XpbdBodyError> {
        let Some(body) = body else { return Ok(()) };
        let own = self.rest.inside.as_ref().map(|inside| &*inside.tetrahedra);
        if own == Some(body.topology().tetrahedra()) { Ok(()) } else { Err(XpbdBodyError::Tetrahedra) }
    }

    /// Checks that the body can be solved with a mesh and a number of positions. The game may have written to any of
    /// its fields.
    pub(super) fn check(&self, mesh: &Arc<SurfaceTopology>, positions: usize) -> Result<(), XpbdBodyError> {
        if self.is_of_another(mesh) {
            return Err(XpbdBodyError::Mesh);
        }
        let vertices = mesh.vertex_count();
        count("positions", vertices, positions)?;
        count("velocities", vertices, self.velocities.len())?;
        count("inverse masses", vertices, self.inverse_masses.len())?;
        if let Some(vertex) = crate::surface::first_non_finite(&self.velocities) {
            return Err(XpbdBodyError::NonFiniteVelocity(vertex));
        }
        let wrong = |&inverse_mass: &f32| !inverse_mass.is_finite() || inverse_mass < 0.0;
        if let Some(vertex) = self.inverse_masses.iter().position(wrong) {
            return Err(XpbdBodyError::InverseMass(VertexId(vertex as u32), self.inverse_masses[vertex]));
        }
        check_material(&self.material)
    }
}

/// Warns once that a body has no volume to keep.
fn warn_of_open_volume(topology: &SurfaceTopology) {
    if HAS_WARNED_OF_OPEN_VOLUME.swap(true, Ordering::Relaxed) {
        return;
    }
    if topology.is_closed() {
        log::warn!(
            "a body's volume_compliance has no effect, because its mesh is inside out: reverse its triangles. This \
             warning appears only once"
        );
        return;
    }
    let report = topology.report();
    log::warn!(
        "a body's volume_compliance has no effect, because its mesh is not closed ({} boundary edges, {} non-manifold, {} \
         inconsistent, {} collapsed triangles). If seams differ by rounding, make the surface with \
         DeformableSurface::builder(..).weld_within(..); for a sheet, set the volume_compliance to infinity. This warning \
         appears only once",
        report.boundary_edges,
        report.non_manifold_edges,
        report.inconsistent_edges,
        report.collapsed_triangles
    );
}

pub(super) fn count(what: &'static str, expected: usize, found: usize) -> Result<(), XpbdBodyError> {
    if expected == found { Ok(()) } else { Err(XpbdBodyError::Count { what, expected, found }) }
}

fn check_positions(topology: &SurfaceTopology, positions: &SurfacePositions) -> Result<(), XpbdBodyError> {
    count("positions", topology.vertex_count(), positions.0.len())?;
    check_finite(&positions.0)
}

pub(super) fn check_finite(positions: &[Vec3]) -> Result<(), XpbdBodyError> {
    crate::surface::first_non_finite(positions).map_or(Ok(()), |vertex| Err(XpbdBodyError::NonFinitePosition(vertex)))
}
