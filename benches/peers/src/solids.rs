//! Whole steps of rapier3d's volumetric soft bodies: the ten bodies of `tetrahedral_pile` fall into a pit.
//!
//! All settings are rapier's defaults, except those that make both libraries do the same: the material and its model,
//! the masses, the contact distance, self-contacts, and that nothing falls asleep.

use std::{
    error::Error,
    io::{self, Write},
};

use circumsphere_support::tetrahedra::{HALF_WIDTH_OF_PIT, TetrahedralMesh, WALLS_OF_PIT, tetrahedral_pile};
use rapier3d::prelude::*;

use super::{timed, vector};

/// Plays the scene that the arguments describe, and prints every step; see
/// `benches/reports/compare/steps/solids.rs`.
pub fn run(arguments: &[String]) -> Result<(), Box<dyn Error>> {
    let [model, young_modulus, poisson_ratio, density, thickness, threads, steps] = arguments else {
        return Err("expected a model, Young's modulus, Poisson's ratio, the density, the thickness, the number of threads, \
                    and the number of steps"
            .into());
    };
    let model = match model.as_str() {
        "corotational" => SoftBodyCellModel::Corotational,
        "neo-hookean" => SoftBodyCellModel::NeoHookean,
        other => return Err(format!("there is no model {other:?}").into()),
    };
    let material = SoftBodyMaterial {
        young_modulus: young_modulus.parse()?,
        poisson_ratio: poisson_ratio.parse()?,
        ..SoftBodyMaterial::default()
    };
    let (density, thickness) = (density.parse()?, thickness.parse()?);
    let mut world = PhysicsWorld::new();
    world.configure_thread_pool(threads.parse()?)?;
    world.insert(RigidBodyBuilder::fixed(), ground(Vector::Y));
    for normal in WALLS_OF_PIT.map(vector) {
        let wall = RigidBodyBuilder::fixed().translation(normal * -(HALF_WIDTH_OF_PIT as f32));
        world.insert(wall, ground(normal));
    }
    let meshes = tetrahedral_pile();
    let bodies: Vec<_> = meshes
        .iter()
        .map(|mesh| {
            let builder = SoftBodyBuilder::new(mesh.positions.iter().copied().map(vector).collect())
                .cells(mesh.tetrahedra.clone())
                .masses(masses(mesh, density))
                .material(material)
                .cell_model(model)
                .particle_radius(thickness)
                .self_contacts(true)
                .can_sleep(false);
            world.insert_soft_body(builder)
        })
        .collect();
    let mut output = io::stdout().lock();
    for _ in 0..steps.parse::<usize>()? {
        let (duration, ()) = timed(|| world.step());
        let mut inverted = 0;
        for (&body, mesh) in bodies.iter().zip(&meshes) {
            let body = world.soft_bodies.get(body).ok_or("a soft body is gone")?;
            if !body.is_enabled() {
                return Err("rapier has disabled a soft body, because a position is not finite".into());
            }
            let now: Vec<_> = body.particle_positions().map(|position| [position.x, position.y, position.z]).collect();
            inverted += mesh.inverted(&now);
        }
        writeln!(output, "step\t{}\t{inverted}", duration.as_nanos())?;
        output.flush()?;
    }
    Ok(())
}

/// A half-space. The constructor of the builder asks for a type of another crate.
fn ground(normal: Vector) -> ColliderBuilder {
    ColliderBuilder::new(SharedShape::halfspace(normal))
}

/// The mass of each vertex: a quarter of the mass of the tetrahedra around it, before ours evens it out.
fn masses(mesh: &TetrahedralMesh, density: f32) -> Vec<f32> {
    let mut masses = vec![0.0; mesh.positions.len()];
    for &tetrahedron in &mesh.tetrahedra {
        let [origin, a, b, c] = tetrahedron.map(|corner| vector(mesh.positions[corner as usize]));
        let share = density * (a - origin).dot((b - origin).cross(c - origin)).abs() / 24.0;
        for corner in tetrahedron {
            masses[corner as usize] += share;
        }
    }
    masses
}
