//! A headless world of tetrahedral bodies with a response, ticked by hand, and what is measured in it, in f64.

use std::time::Duration;

use bevy_app::prelude::*;
use bevy_circumsphere::{prelude::*, response::*};
use bevy_ecs::prelude::*;
use bevy_time::Time;
use circumsphere_support::tetrahedra::TetrahedralMesh;
use glam::{DMat3, DVec3, Vec3};

pub const TICK: f64 = 1.0 / 60.0;

/// A solid without losses.
pub const LOSSLESS: XpbdMaterial = XpbdMaterial { drag: 0.0, damping: 0.0, ..XpbdMaterial::SOLID };

pub struct World {
    pub app: App,
}

impl World {
    /// Without gravity and sleep.
    pub fn new() -> Self {
        let mut app = App::new();
        app.add_plugins((DeformableCollisionPlugins::new(Update), XpbdResponsePlugin::new(Update)));
        app.init_resource::<Time>();
        app.finish();
        app.cleanup();
        app.insert_resource(CircumsphereSettings { threads: 1, ..CircumsphereSettings::default() });
        app.insert_resource(XpbdSettings { gravity: Vec3::ZERO, sleep_speed: 0.0, ..XpbdSettings::default() });
        Self { app }
    }

    pub fn settings(&mut self) -> Mut<'_, XpbdSettings> {
        self.app.world_mut().resource_mut::<XpbdSettings>()
    }

    pub fn add(&mut self, mesh: &TetrahedralMesh, material: XpbdMaterial, extra: impl Bundle) -> Solid {
        let rest: Vec<Vec3> = mesh.positions.iter().copied().map(Vec3::from_array).collect();
        let (inside, surface, positions) = TetrahedralBody::from_mesh(&rest, &mesh.tetrahedra).unwrap();
        let body = XpbdBody::tetrahedral(&inside, &surface, &positions, material).unwrap();
        let entity = self.app.world_mut().spawn((inside, surface, positions, body, extra)).id();
        Solid { entity, rest: doubles(&rest), tetrahedra: mesh.tetrahedra.clone() }
    }

    pub fn tick(&mut self) {
        self.app.world_mut().resource_mut::<Time>().advance_by(Duration::from_secs_f64(TICK));
        self.app.update();
    }

    pub fn run(&mut self, ticks: usize) {
        (0..ticks).for_each(|_| self.tick());
    }

    pub fn positions(&self, solid: &Solid) -> Vec<DVec3> {
        doubles(&self.app.world().get::<SurfacePositions>(solid.entity).unwrap().0)
    }

    pub fn place(&mut self, solid: &Solid, at: impl Iterator<Item = DVec3>) {
        let mut positions = self.app.world_mut().get_mut::<SurfacePositions>(solid.entity).unwrap();
        positions.0 = at.map(DVec3::as_vec3).collect();
    }

    pub fn body(&self, solid: &Solid) -> &XpbdBody {
        self.app.world().get::<XpbdBody>(solid.entity).unwrap()
    }

    pub fn body_mut(&mut self, solid: &Solid) -> Mut<'_, XpbdBody> {
        self.app.world_mut().get_mut::<XpbdBody>(solid.entity).unwrap()
    }

    pub fn fastest(&self, solid: &Solid) -> f32 {
        self.body(solid).velocities.iter().map(|velocity| velocity.length()).fold(0.0, f32::max)
    }

    /// The volume of every tetrahedron relative to that at rest.
    pub fn volumes(&self, solid: &Solid) -> Vec<f64> {
        solid.deformations(&self.positions(solid)).iter().map(DMat3::determinant).collect()
    }

    /// The volume of a body at rest and now, in cubic meters.
    pub fn whole_volumes(&self, solid: &Solid) -> [f64; 2] {
        let rests = solid.tetrahedra.iter().map(|corners| edges(corners, &solid.rest).determinant().abs() / 6.0);
        self.volumes(solid)
            .into_iter()
            .zip(rests)
            .fold([0.0; 2], |[rest, now], (share, volume)| [rest + volume, now + share * volume])
    }

    pub fn inverted(&self, solid: &Solid) -> usize {
        self.volumes(solid).into_iter().filter(|&volume| volume.is_nan() || volume <= 0.0).count()
    }

    /// The energy of a stable Neo-Hookean solid (Smith et al. 2018), in joules.
    pub fn elastic_energy(&self, solid: &Solid) -> f64 {
        let [shear, lame] = lame_parameters(&self.body(solid).material);
        let deformations = solid.deformations(&self.positions(solid));
        let energies = deformations.iter().zip(&solid.tetrahedra).map(|(deformation, corners)| {
            let squares: f64 = deformation.to_cols_array().iter().map(|entry| entry * entry).sum();
            let change = deformation.determinant() - 1.0;
            let density = 0.5 * shear * (squares - 3.0) - shear * change + 0.5 * (lame + shear) * change * change;
            density * edges(corners, &solid.rest).determinant().abs() / 6.0
        });
        energies.sum()
    }

    /// Momentum and angular momentum around the origin.
    pub fn momenta(&self, solid: &Solid) -> [DVec3; 2] {
        let body = self.body(solid);
        let momenta = body.velocities.iter().zip(&body.inverse_masses);
        let momenta = momenta.map(|(velocity, inverse_mass)| velocity.as_dvec3() / f64::from(*inverse_mass));
        self.positions(solid).iter().zip(momenta).fold([DVec3::ZERO; 2], |[linear, angular], (at, momentum)| {
            [linear + momentum, angular + at.cross(momentum)]
        })
    }
}

/// A body in the world, with its rest shape.
pub struct Solid {
    pub entity: Entity,
    pub rest: Vec<DVec3>,
    pub tetrahedra: Vec<[u32; 4]>,
}

impl Solid {
    fn deformations(&self, positions: &[DVec3]) -> Vec<DMat3> {
        let of = |corners: &[u32; 4]| edges(corners, positions) * edges(corners, &self.rest).inverse();
        self.tetrahedra.iter().map(of).collect()
    }

    /// The area around each vertex of the surface, as a vector outward: a third of that of its triangles, at rest.
    pub fn areas(&self, world: &World) -> Vec<DVec3> {
        let mut areas = vec![DVec3::ZERO; self.rest.len()];
        let surface = world.app.world().get::<DeformableSurface>(self.entity).unwrap();
        for corners in surface.topology().triangles() {
            let [a, b, c] = corners.map(|corner| self.rest[corner as usize]);
            for &corner in corners {
                areas[corner as usize] += (b - a).cross(c - a) / 6.0;
            }
        }
        areas
    }
}

fn edges(corners: &[u32; 4], positions: &[DVec3]) -> DMat3 {
    let [origin, a, b, c] = corners.map(|corner| positions[corner as usize]);
    DMat3::from_cols(a - origin, b - origin, c - origin)
}

/// Lamé's `μ` and `λ`.
pub fn lame_parameters(material: &XpbdMaterial) -> [f64; 2] {
    let [young, poisson] = [material.young_modulus, material.poisson_ratio].map(f64::from);
    [young / (2.0 * (1.0 + poisson)), young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson))]
}

pub fn doubles(positions: &[Vec3]) -> Vec<DVec3> {
    positions.iter().map(|position| position.as_dvec3()).collect()
}

pub fn moved(mesh: &TetrahedralMesh, by: [f32; 3]) -> TetrahedralMesh {
    let positions = mesh.positions.iter().map(|at| std::array::from_fn(|axis| at[axis] + by[axis])).collect();
    TetrahedralMesh { positions, tetrahedra: mesh.tetrahedra.clone() }
}
