//! The components that make a surface a body: its masses, its material, and its rest shape.

use std::sync::{
    Arc,
    atomic::{AtomicBool, Ordering},
};

use bevy_ecs::prelude::*;
#[cfg(feature = "reflect")]
use bevy_reflect::prelude::*;
use glam::{DVec3, Vec3};

use crate::{
    kernel::{
        bvh::tree::BoxTree,
        ccd::outward_box,
        mesh::{
            ids::{EdgeId, VertexId},
            topology::SurfaceTopology,
        },
        pose::Pose,
        xpbd::{HingeRests, Slabs, SpringRests, VolumeRest, bend_at},
    },
    surface::{DeformableSurface, SurfacePositions, SweptTarget},
};

/// The material of a body. A compliance is one over a stiffness: 0 is as stiff as the solver can make it, infinite is
/// no resistance.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Clone, Debug, PartialEq))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct XpbdMaterial {
    /// Mass per area of the surface, in kilograms per square meter; more than 0. Default 0.2, a light cloth.
    pub area_density: f32,
    /// Compliance of every edge against stretching and compression, in meters per newton; 0 or more. Default 0: cloth
    /// hardly stretches, and no vertex gets farther from the pins than the way along the edges is long at rest (Kim,
    /// Chentanez and Müller-Fischer 2012, "Long Range Attachments").
    #[cfg_attr(feature = "serde", serde(with = "super::infinite"))]
    pub stretch_compliance: f32,
    /// Compliance of every inner edge against bending, in radians per newton meter; 0 or more. Default 30,000, a soft
    /// cloth with edges of a few centimeters.
    #[cfg_attr(feature = "serde", serde(with = "super::infinite"))]
    pub bend_compliance: f32,
    /// Compliance of a closed body against a change of its volume, in cubic meters per pascal; 0 or more. Default
    /// infinite: cloth has no volume. It has no effect on surfaces that are not [closed](SurfaceTopology::is_closed):
    /// [`XpbdBody::new`] warns about the first one.
    #[cfg_attr(feature = "serde", serde(with = "super::infinite"))]
    pub volume_compliance: f32,
    /// Share of the velocity lost to air drag, per second; 0 or more. Default 2: a light cloth falls at 5 meters per
    /// second at most.
    pub drag: f32,
    /// Decay rate of oscillations along the edges, per second; 0 or more. Default 100: without damping, the residual
    /// stretch that a substep leaves keeps oscillating.
    pub damping: f32,
}

impl XpbdMaterial {
    /// A light cloth.
    pub const CLOTH: Self = Self {
        area_density: 0.2,
        stretch_compliance: 0.0,
        bend_compliance: 3.0e4,
        volume_compliance: f32::INFINITY,
        drag: 2.0,
        damping: 100.0,
    };

    /// A rubber ball: a skin that stretches a little around an incompressible volume.
    pub const SOFT: Self = Self {
        area_density: 2.0,
        stretch_compliance: 1.0e-4,
        bend_compliance: 1.0e1,
        volume_compliance: 0.0,
        drag: 2.0,
        damping: 100.0,
    };
}

impl Default for XpbdMaterial {
    fn default() -> Self {
        Self::CLOTH
    }
}

/// Largest coordinate of a body, in world units, and largest component of its velocity, in world units per second.
/// Squares and triple products of such numbers are finite in f64. The solver works in f32: what overflows there is no
/// number at the end, and counts as out of range as well.
pub(super) const MOST_COORDINATE: f64 = 1.0e15;

/// Whether the warning about a volume on an open surface has been logged.
static HAS_WARNED_OF_OPEN_VOLUME: AtomicBool = AtomicBool::new(false);

/// Why a surface cannot be a body.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(opaque, Clone, Debug, PartialEq))]
pub enum XpbdBodyError {
    /// The body was made for other triangles, or for vertices that coincided differently, than its surface has now, and
    /// the surface has not taken part in a tick since.
    #[error("the body was made for a different mesh than its surface has now: make it again with XpbdBody::new")]
    Mesh,
    /// The number of values does not match the number of vertices of the mesh.
    #[error("there are {found} {what}, but the mesh has {expected} vertices")]
    Count {
        /// What was counted.
        what: &'static str,
        /// Number of vertices of the mesh.
        expected: usize,
        /// Number of values found.
        found: usize,
    },
    /// A coordinate of the rest shape is NaN or infinite.
    #[error("the position of vertex {} is not finite", .0.0)]
    NonFinitePosition(VertexId),
    /// A velocity is NaN or infinite.
    #[error("the velocity of vertex {} is not finite", .0.0)]
    NonFiniteVelocity(VertexId),
    /// A vertex would leave the range in which positions and velocities can be computed. The body was not moved and its
    /// velocities were set to zero. Look for a force, velocity, or stiffness that is far too large.
    #[error("vertex {} would move beyond {MOST_COORDINATE:e} or to NaN; the body was stopped where it was", .0.0)]
    OutOfRange(VertexId),
    /// An inverse mass is negative, NaN or infinite.
    #[error("the inverse mass of vertex {} is {}; it must be finite and 0 or more, where 0 pins the vertex", .0.0, .1)]
    InverseMass(VertexId, f32),
    /// A value of the material is out of range.
    #[error("{what} is {value}; it must be {range}")]
    Material {
        /// Name of the value.
        what: &'static str,
        /// The value.
        value: f32,
        /// Its valid range.
        range: &'static str,
    },
}

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

/// The rest shape of a body: lengths, bends, volume, and areas, in the surface's own frame.
#[derive(Clone, Debug, Default)]
pub(super) struct RestShape {
    pub(super) springs: SpringRests,
    pub(super) hinges: HingeRests,
    /// Only if the surface is closed and encloses a volume.
    pub(super) volume: Option<VolumeRest>,
    /// Of each triangle.
    pub(super) areas: Vec<f32>,
    /// What it was made from.
    pub(super) positions: Vec<Vec3>,
}

impl RestShape {
    pub(super) fn new(topology: &SurfaceTopology, positions: &[Vec3]) -> Self {
        let points: Vec<DVec3> = positions.iter().map(|position| position.as_dvec3()).collect();
        let mut springs = Vec::with_capacity(topology.edges().len());
        let mut hinges = Vec::new();
        for (edge, &ends) in topology.edges().iter().enumerate() {
            if ends[0] == ends[1] {
                continue;
            }
            let length = points[ends[0] as usize].distance(points[ends[1] as usize]);
            springs.push((ends, length));
            if let &[first, second] = topology.triangles_of_edge(EdgeId(edge as u32)) {
                hinges.extend(hinge(topology, edge as u32, first, second, &points));
            }
        }
        let mut slabs = Slabs::default();
        slabs.split(&points);
        let volume = topology.is_closed().then(|| VolumeRest::new(&points, topology.welded_triangles()));
        let areas = topology.welded_triangles().iter().map(|corners| area(corners, &points) as f32).collect();
        Self {
            areas,
            springs: SpringRests::new(points.len(), &slabs, springs.into_iter()),
            hinges: HingeRests::new(points.len(), &slabs, hinges.into_iter()),
            volume: volume.flatten(),
            positions: positions.to_vec(),
        }
    }
}

fn area(corners: &[u32; 3], points: &[DVec3]) -> f64 {
    let [a, b, c] = corners.map(|vertex| points[vertex as usize]);
    0.5 * (b - a).cross(c - a).length()
}

/// The corners of the hinge at an edge between two triangles, and its bend.
fn hinge(topology: &SurfaceTopology, edge: u32, first: u32, second: u32, points: &[DVec3]) -> Option<([u32; 4], f64)> {
    let corner = |triangle: u32| {
        let side = topology.triangle_edges()[triangle as usize].iter().position(|&own| own == edge)?;
        let corners = topology.welded_triangles()[triangle as usize];
        Some((corners[side], corners[(side + 1) % 3], corners[(side + 2) % 3]))
    };
    let (start, end, left) = corner(first)?;
    let (other_start, _, right) = corner(second)?;
    // If both triangles run the same way along the edge, one of them is wound the other way round: there is no dihedral
    // angle.
    let corners = [start, end, left, right];
    if other_start == start || left == right {
        return None;
    }
    Some((corners, bend_at(&corners.map(|vertex| points[vertex as usize]))))
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
        let expected = topology.vertex_count();
        count("positions", expected, positions.0.len())?;
        check_finite(&positions.0)?;
        check_material(&material)?;
        let points: Vec<DVec3> = positions.0.iter().map(|position| position.as_dvec3()).collect();
        let mut areas = vec![0.0; expected];
        for &triangle in topology.welded_triangles() {
            let share = area(&triangle, &points) / 3.0;
            for vertex in triangle {
                areas[vertex as usize] += share;
            }
        }
        let (mut total, mut counted) = (0.0, 0usize);
        for &area in areas.iter().filter(|&&area| area > 0.0) {
            total += area;
            counted += 1;
        }
        let mean = if counted > 0 { total / counted as f64 } else { 1.0 };
        let mass = |area: f64| if area > 0.0 { area } else { mean } * f64::from(material.area_density);
        let rest = RestShape::new(topology, &positions.0);
        if material.volume_compliance.is_finite() && rest.volume.is_none() {
            warn_of_open_volume(topology);
        }
        let inverse_masses = topology.weld().iter().map(|&own| (1.0 / mass(areas[own as usize])) as f32).collect();
        Ok(Self {
            velocities: vec![Vec3::ZERO; expected],
            inverse_masses,
            material,
            mesh: Arc::clone(topology),
            rest: Arc::new(rest),
            written: Vec::new(),
            stood: None,
        })
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
        positions: &SurfacePositions,
        pose: &Pose,
    ) -> Result<Self, XpbdBodyError> {
        let mut body = Self::new(surface, positions, self.material)?;
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

pub(super) fn check_finite(positions: &[Vec3]) -> Result<(), XpbdBodyError> {
    crate::surface::first_non_finite(positions).map_or(Ok(()), |vertex| Err(XpbdBodyError::NonFinitePosition(vertex)))
}

fn check_material(material: &XpbdMaterial) -> Result<(), XpbdBodyError> {
    let wrong = |what, value, range| Err(XpbdBodyError::Material { what, value, range });
    if !(material.area_density.is_finite() && material.area_density > 0.0) {
        return wrong("the area density", material.area_density, "finite and more than 0");
    }
    let rates = [("the drag", material.drag), ("the damping", material.damping)];
    if let Some((what, value)) = rates.into_iter().find(|&(_, value)| !(value.is_finite() && value >= 0.0)) {
        return wrong(what, value, "finite and 0 or more");
    }
    let compliances = [
        ("the stretch compliance", material.stretch_compliance),
        ("the bend compliance", material.bend_compliance),
        ("the volume compliance", material.volume_compliance),
    ];
    match compliances.into_iter().find(|&(_, value)| value.is_nan() || value < 0.0) {
        Some((what, value)) => wrong(what, value, "0 or more, where infinite is no resistance"),
        None => Ok(()),
    }
}
