//! The components that make a surface a body: what it weighs, what it is made of, and its shape at rest.

use std::sync::{
    Arc,
    atomic::{AtomicBool, Ordering},
};

use bevy_ecs::prelude::*;
use glam::{DVec3, Vec3};

use super::constraints::{Hinge, Spring, enclosed_volume};
use crate::{
    kernel::{
        mesh::{
            ids::{EdgeId, VertexId},
            topology::SurfaceTopology,
        },
        pose::Pose,
    },
    surface::{DeformableSurface, SurfacePositions, SweptTarget},
};

/// What a body is made of. A compliance is one over a stiffness: 0 is as stiff as the solver can make it, infinite is no
/// such resistance at all.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct XpbdMaterial {
    /// Kilograms per square meter of surface; more than 0. Default 0.2, a light cloth.
    pub area_density: f32,
    /// Of every edge against stretching and compression, in meters per newton. Default 0: cloth hardly stretches.
    pub stretch_compliance: f32,
    /// Of every inner edge against bending, in radians per newton meter. Default 30,000, a soft cloth with edges of
    /// centimeters.
    pub bend_compliance: f32,
    /// Of a closed body against a change of its volume, in cubic meters per pascal. Default infinite: cloth has no
    /// volume. Without effect on surfaces that are not [closed](SurfaceTopology::is_closed): [`XpbdBody::new`] warns of the first.
    pub volume_compliance: f32,
    /// Share of the velocity that is lost to the air, per second. 0 or more. Default 2: a light cloth falls no faster than 5 meters
    /// per second.
    pub drag: f32,
    /// How fast oscillations along the edges die, per second. 0 or more. Default 100: without it, the little that a substep
    /// leaves of a stretch swings on.
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

    /// A ball of rubber: a skin that stretches a little around a volume that stays.
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

/// The largest coordinate, in world units, and the largest component of a velocity, in world units per second, that a body is given.
/// Squares and triple products of such numbers are finite in f64, and those of what is a millionth as large in f32.
pub(super) const MOST_COORDINATE: f64 = 1.0e15;

/// Whether open surfaces with a volume have been warned of.
static HAS_WARNED_OF_OPEN_VOLUME: AtomicBool = AtomicBool::new(false);

/// Why a surface cannot be made a body.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum XpbdBodyError {
    /// The body was made for other triangles, or vertices that coincided otherwise, than those of its surface. Make it anew.
    #[error("it was made for another mesh than its surface has by now")]
    Mesh,
    /// The number of values is not that of the mesh's vertices.
    #[error("there are {found} {what}, but the mesh has {expected} vertices")]
    Count {
        /// Of what.
        what: &'static str,
        /// How many the mesh has.
        expected: usize,
        /// How many there are.
        found: usize,
    },
    /// A coordinate of the shape at rest is NaN or infinite.
    #[error("the position of vertex {} is not finite", .0.0)]
    NonFinitePosition(VertexId),
    /// A velocity is NaN or infinite.
    #[error("the velocity of vertex {} is not finite", .0.0)]
    NonFiniteVelocity(VertexId),
    /// A vertex would leave the range in which positions and velocities can be computed: the body was not moved and its
    /// velocities were set to zero. Look for a force, a velocity or a stiffness that is far too large.
    #[error("vertex {} would move beyond {MOST_COORDINATE:e} or to no number at all; the body was stopped where it stood", .0.0)]
    OutOfRange(VertexId),
    /// An inverse mass is negative, NaN or infinite.
    #[error("the inverse mass of vertex {} is {}; it must be finite and 0 or more, where 0 pins the vertex", .0.0, .1)]
    InverseMass(VertexId, f32),
    /// A value of the material is out of range.
    #[error("{what} is {value}; it must be {range}")]
    Material {
        /// Which.
        what: &'static str,
        /// What it is.
        value: f32,
        /// What it may be.
        range: &'static str,
    },
}

/// Friction of a surface or rigid shape. Of two that touch, the geometric mean counts: what is frictionless slips on
/// everything.
#[derive(Component, Clone, Copy, Debug, PartialEq)]
pub struct SurfaceFriction {
    /// Up to this share of the pressure, what rests stays. 0 or more. Default 0.5.
    pub static_coefficient: f32,
    /// This share of the pressure slows what slides. 0 or more, at most the static one. Default 0.4.
    pub dynamic_coefficient: f32,
}

impl SurfaceFriction {
    /// None at all.
    pub const NONE: Self = Self { static_coefficient: 0.0, dynamic_coefficient: 0.0 };

    /// That of two things that touch: static and dynamic.
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

/// What a body returns to: lengths, bends and volume, in the surface's own frame.
#[derive(Clone, Debug, Default)]
pub(super) struct RestShape {
    pub(super) springs: Vec<Spring>,
    pub(super) hinges: Vec<Hinge>,
    /// Positive, and only where the surface is closed.
    pub(super) volume: Option<f64>,
}

impl RestShape {
    fn new(topology: &SurfaceTopology, positions: &[Vec3]) -> Self {
        let points: Vec<DVec3> = positions.iter().map(|position| position.as_dvec3()).collect();
        let mut springs = Vec::with_capacity(topology.edges().len());
        let mut hinges = Vec::new();
        for (edge, &ends) in topology.edges().iter().enumerate() {
            if ends[0] == ends[1] {
                continue;
            }
            let length = points[ends[0] as usize].distance(points[ends[1] as usize]);
            springs.push(Spring { ends, length });
            if let &[first, second] = topology.triangles_of_edge(EdgeId(edge as u32)) {
                hinges.extend(hinge(topology, edge as u32, first, second, &points));
            }
        }
        let volume = enclosed_volume(&points, 0, topology.welded_triangles());
        let volume = (topology.is_closed() && volume > 0.0).then_some(volume);
        Self { springs, hinges, volume }
    }
}

fn hinge(topology: &SurfaceTopology, edge: u32, first: u32, second: u32, points: &[DVec3]) -> Option<Hinge> {
    let corner = |triangle: u32| {
        let side = topology.triangle_edges()[triangle as usize].iter().position(|&own| own == edge)?;
        let corners = topology.welded_triangles()[triangle as usize];
        Some((corners[side], corners[(side + 1) % 3], corners[(side + 2) % 3]))
    };
    let (start, end, left) = corner(first)?;
    let (other_start, _, right) = corner(second)?;
    // Two triangles that run the same way along their edge are turned over against each other.
    let corners = [start, end, left, right];
    if other_start == start || left == right {
        return None;
    }
    let bend = Hinge::bend_at(&corners.map(|vertex| points[vertex as usize]));
    Some(Hinge { corners, bend })
}

/// Makes a surface a body that falls, stretches, bends, keeps its volume and answers contacts, with
/// [`XpbdResponsePlugin`](super::XpbdResponsePlugin). A surface without it stands, or moves as the game writes it, and
/// nothing pushes it.
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
pub struct XpbdBody {
    /// The velocity of every vertex, in world units per second.
    pub velocities: Vec<Vec3>,
    /// One over the mass of every vertex, in 1/kg. 0 pins it: it stays, or goes where the game writes its position.
    /// Vertices that are welded because they coincide are one: pinned if one of them is.
    pub inverse_masses: Vec<f32>,
    /// What it is made of.
    pub material: XpbdMaterial,
    /// The mesh that it was made for.
    mesh: Arc<SurfaceTopology>,
    pub(super) rest: Arc<RestShape>,
    /// The positions that it last wrote, in the surface's own frame.
    pub(super) written: Vec<Vec3>,
    /// Where that frame stood in the world then.
    pub(super) stood: Option<Pose>,
}

impl XpbdBody {
    /// A body at rest in the shape that it returns to. A vertex weighs a third of the triangles around it; one without any
    /// triangle that has an area weighs as much as the mean.
    ///
    /// # Errors
    /// Where the number of positions is not that of the surface, one is not finite, or the material is out of range.
    pub fn new(
        surface: &DeformableSurface,
        positions: &SurfacePositions,
        material: XpbdMaterial,
    ) -> Result<Self, XpbdBodyError> {
        let topology = surface.topology();
        let expected = topology.vertex_count();
        count("positions", expected, positions.0.len())?;
        if let Some(vertex) = crate::surface::first_non_finite(&positions.0) {
            return Err(XpbdBodyError::NonFinitePosition(vertex));
        }
        check_material(&material)?;
        let mut areas = vec![0.0; expected];
        for &triangle in topology.welded_triangles() {
            let [a, b, c] = triangle.map(|vertex| positions.0[vertex as usize].as_dvec3());
            let share = (b - a).cross(c - a).length() / 6.0;
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

    /// The body with some vertices pinned. Vertices that it does not have are passed over.
    #[must_use]
    pub fn pinned(mut self, vertices: impl IntoIterator<Item = VertexId>) -> Self {
        for vertex in vertices {
            if let Some(inverse_mass) = self.inverse_masses.get_mut(vertex.index()) {
                *inverse_mass = 0.0;
            }
        }
        self
    }

    /// The body with all of it moving at a velocity, in world units per second.
    #[must_use]
    pub fn moving(mut self, velocity: Vec3) -> Self {
        self.velocities.fill(velocity);
        self
    }

    /// Energy of motion of everything that is not pinned, in joules.
    #[must_use]
    pub fn kinetic_energy(&self) -> f64 {
        let moved = self.velocities.iter().zip(&self.inverse_masses).filter(|&(_, &inverse_mass)| inverse_mass > 0.0);
        moved.map(|(velocity, &inverse)| 0.5 * velocity.as_dvec3().length_squared() / f64::from(inverse)).sum()
    }

    /// Whether it can be moved with a mesh and so many positions, now that the game may have written to all of them.
    pub(super) fn check(&self, mesh: &Arc<SurfaceTopology>, positions: usize) -> Result<(), XpbdBodyError> {
        let is_same = |own: &SurfaceTopology| own.triangles() == mesh.triangles() && own.weld() == mesh.weld();
        if !Arc::ptr_eq(&self.mesh, mesh) && !is_same(&self.mesh) {
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

/// Says once that a body has no volume to keep.
fn warn_of_open_volume(topology: &SurfaceTopology) {
    if HAS_WARNED_OF_OPEN_VOLUME.swap(true, Ordering::Relaxed) {
        return;
    }
    if topology.is_closed() {
        log::warn!(
            "a body's volume_compliance has no effect, because its mesh is inside out: reverse its triangles. This is \
             said once"
        );
        return;
    }
    let report = topology.report();
    log::warn!(
        "a body's volume_compliance has no effect, because its mesh is not closed ({} boundary edges, {} non-manifold, {} \
         inconsistent, {} collapsed triangles). If seams differ by rounding, make the surface with \
         DeformableSurface::builder(..).weld_within(..); for a sheet, set the volume_compliance to infinity. This is said once",
        report.boundary_edges,
        report.non_manifold_edges,
        report.inconsistent_edges,
        report.collapsed_triangles
    );
}

fn count(what: &'static str, expected: usize, found: usize) -> Result<(), XpbdBodyError> {
    if expected == found { Ok(()) } else { Err(XpbdBodyError::Count { what, expected, found }) }
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
