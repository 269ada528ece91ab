//! Whole steps of rapier3d's soft bodies: a square cloth falls onto a ball or a mesh that does not move.
//!
//! The cloth has the springs of `SoftBodyBuilder::cloth`: along its edges, across both diagonals of a cell, and against
//! bending from each vertex to the next but one. rapier's other constructor from triangles, `SoftBodyBuilder::trimesh`,
//! adds shape matching, which holds a body in its shape. All settings are rapier's defaults, except those that make
//! both libraries do the same: the masses, the contact distance unless the default is asked for, self-contacts, and
//! that nothing falls asleep.

use std::{
    error::Error,
    io::{self, Write},
    path::{Path, PathBuf},
};

use circumsphere_support::recording::{Recording, read_recording, write_recording};
use rapier3d::prelude::*;

use super::{timed, vector};

/// Plays the scene that the arguments describe, and prints every step; see `benches/reports/compare/steps/rapier.rs`.
pub fn run(arguments: &[String]) -> Result<(), Box<dyn Error>> {
    let [cloth, obstacle, thickness, area_density, threads, steps, end] = arguments else {
        return Err(
            "expected a cloth, an obstacle, the thickness, the mass per area, the number of threads, the number \
                    of steps, and a file for the end"
                .into(),
        );
    };
    let cloth = read_recording(&[PathBuf::from(cloth)])?;
    let thickness = if thickness == "default" { None } else { Some(thickness.parse()?) };
    let mut world = PhysicsWorld::new();
    world.configure_thread_pool(threads.parse()?)?;
    world.insert(RigidBodyBuilder::fixed(), fixed(obstacle, thickness)?);
    let body = world.insert_soft_body(soft_body(&cloth, thickness, area_density.parse()?)?);
    let mut output = io::stdout().lock();
    for _ in 0..steps.parse::<usize>()? {
        // The last step has decided how many substeps this one has in addition.
        let root = world.soft_bodies.get(body).ok_or("rapier refuses the soft body")?.root_body();
        let additional = world.bodies.get(root).ok_or("the soft body has no root")?.additional_solver_iterations();
        let substeps = world.integration_parameters.num_solver_iterations + additional;
        let (duration, ()) = timed(|| world.step());
        if !world.soft_bodies.get(body).is_some_and(SoftBody::is_enabled) {
            return Err("rapier has disabled the soft body, because a position is not finite".into());
        }
        writeln!(output, "step\t{}\t{substeps}", duration.as_nanos())?;
        output.flush()?;
    }
    let body = world.soft_bodies.get(body).ok_or("the soft body is gone")?;
    let positions = body.particle_positions().map(|position| [position.x, position.y, position.z]).collect();
    write_recording(Path::new(end), &Recording { triangles: cloth.triangles, frames: vec![positions] })?;
    Ok(())
}

/// The obstacle: `ball:RADIUS`, or a recording of a mesh. A mesh has a thickness, as ours has.
fn fixed(obstacle: &str, thickness: Option<f32>) -> Result<ColliderBuilder, Box<dyn Error>> {
    if let Some(radius) = obstacle.strip_prefix("ball:") {
        return Ok(ColliderBuilder::ball(radius.parse()?));
    }
    let mesh = read_recording(&[PathBuf::from(obstacle)])?;
    let vertices = mesh.frames[0].iter().copied().map(vector).collect();
    Ok(ColliderBuilder::trimesh(vertices, mesh.triangles)?.contact_skin(thickness.unwrap_or_default()))
}

/// A cloth of as many rows as columns, with the vertices and triangles of the recording.
fn soft_body(cloth: &Recording, thickness: Option<f32>, area_density: f32) -> Result<SoftBodyBuilder, String> {
    let vertices: Vec<Vector> = cloth.frames[0].iter().copied().map(vector).collect();
    let side = vertices.len().isqrt();
    if side < 2 || side * side != vertices.len() {
        return Err(format!("{} vertices are no square cloth", vertices.len()));
    }
    let (along_column, along_row) = (vertices[side] - vertices[0], vertices[1] - vertices[0]);
    let builder = SoftBodyBuilder::cloth(vertices[0], along_column, along_row, side, side)
        .masses(masses(&vertices, &cloth.triangles, area_density))
        .positions(vertices)
        .surface(cloth.triangles.clone())
        .self_contacts(true)
        .can_sleep(false);
    Ok(match thickness {
        Some(thickness) => builder.particle_radius(thickness),
        // Half an edge.
        None => builder,
    })
}

/// The mass of each vertex: a third of the mass of the triangles around it, as ours.
fn masses(vertices: &[Vector], triangles: &[[u32; 3]], area_density: f32) -> Vec<f32> {
    let mut masses = vec![0.0; vertices.len()];
    for &triangle in triangles {
        let [a, b, c] = triangle.map(|vertex| vertices[vertex as usize]);
        let share = area_density * (b - a).cross(c - a).length() / 6.0;
        for vertex in triangle {
            masses[vertex as usize] += share;
        }
    }
    masses
}
