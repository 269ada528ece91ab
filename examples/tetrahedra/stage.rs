//! The app with the bodies, and the embedded scene.

use std::time::Duration;

use bevy_app::prelude::*;
use bevy_circumsphere::{
    CircumsphereSettings,
    detection::DetectionDiagnostics,
    prelude::*,
    response::{XpbdBody, XpbdMaterial, XpbdResponsePlugin},
};
use bevy_ecs::prelude::*;
use bevy_time::Time;
use circumsphere_examples::headless::{headless_app, recording::Recorder};
use circumsphere_support::tetrahedra::{TetrahedralMesh, tetrahedral_ball, tetrahedral_box};
use glam::Vec3;

use super::{
    TetrahedraExampleError,
    output::{Row, Tick},
};

/// A body with a name.
pub struct Part {
    pub name: String,
    pub mesh: TetrahedralMesh,
}

/// Duration of a tick.
const TICK: Duration = Duration::from_nanos(1_000_000_000 / 60);

/// An app with two bodies.
pub struct Stage {
    app: App,
    bodies: [(Entity, String); 2],
}

impl Stage {
    /// Bodies that stay where they are, or with `moves`, soft bodies above the ground.
    pub fn new(parts: [Part; 2], moves: bool, recorder: Recorder) -> Result<Self, TetrahedraExampleError> {
        let settings = CircumsphereSettings { threads: 1, ..CircumsphereSettings::default() };
        let plugins = DeformableCollisionPlugins::new(Update).build().add(TetrahedralContainmentPlugin);
        let plugins = if moves { plugins.add(XpbdResponsePlugin::new(Update)) } else { plugins };
        let mut app = headless_app(plugins, settings, recorder);
        if moves {
            app.world_mut().spawn((Name::new("ground"), RigidShape(SharedShape::halfspace(Vec3::Y))));
        }
        let mut spawn = |Part { name, mesh }: Part| {
            let positions: Vec<Vec3> = mesh.positions.iter().copied().map(Vec3::from_array).collect();
            let (body, surface, positions) = TetrahedralBody::from_mesh(&positions, &mesh.tetrahedra)
                .map_err(|source| TetrahedraExampleError::Body { file: name.clone().into(), source })?;
            let report = body.topology().report();
            let description = format!(
                "{name}: {} vertices, {} tetrahedra ({} without volume, {} inverted), {} triangles",
                positions.0.len(),
                mesh.tetrahedra.len(),
                report.degenerate.len(),
                report.inverted.len(),
                surface.topology().triangles().len()
            );
            let soft = XpbdBody::tetrahedral(&body, &surface, &positions, XpbdMaterial::SOLID);
            let mut entity = app.world_mut().spawn((Name::new(name), body, surface, positions));
            if moves {
                entity.insert((soft?, SelfCollision));
            }
            Ok::<_, TetrahedraExampleError>((entity.id(), description))
        };
        let [first, second] = parts;
        let bodies = [spawn(first)?, spawn(second)?];
        Ok(Self { app, bodies })
    }

    pub fn describe(&self) -> Vec<String> {
        self.bodies.iter().map(|(_, description)| description.clone()).collect()
    }

    pub fn tick(&mut self, number: usize) -> Result<Tick, TetrahedraExampleError> {
        self.app.world_mut().resource_mut::<Time>().advance_by(TICK);
        self.app.update();
        let world = self.app.world();
        for (entity, description) in &self.bodies {
            let status = world.get::<SurfaceStatus>(*entity).cloned().unwrap_or_default();
            if status != SurfaceStatus::Active {
                return Err(TetrahedraExampleError::Unused { name: description.clone(), status });
            }
        }
        let containments = world.resource::<Containments>();
        let stages = &world.resource::<DetectionDiagnostics>().stages;
        let volumes = self.bodies.iter().filter_map(|(entity, _)| {
            let (body, positions) = (world.get::<XpbdBody>(*entity)?, world.get::<SurfacePositions>(*entity)?);
            body.relative_volumes(&positions.0).reduce(f32::min)
        });
        let in_own = containments.iter().filter(|found| found.body == found.container).count();
        Ok(Tick {
            number,
            in_other: containments.len() - in_own,
            in_own,
            least_volume: volumes.reduce(f32::min),
            deepest: containments.iter().map(|found| found.depth).fold(0.0, f64::max),
            duration: stages.iter().filter(|stage| stage.name == "containments").map(|stage| stage.duration).sum(),
        })
    }

    /// The vertices of one body in the other.
    pub fn rows(&self) -> Vec<Row> {
        let containments = self.app.world().resource::<Containments>();
        let [(first, _), (second, _)] = self.bodies;
        [(0, first, second), (1, second, first)]
            .into_iter()
            .flat_map(|(vertex_body, body, container)| {
                containments.between(body, container).map(move |found| Row {
                    vertex_body,
                    vertex: found.vertex.0,
                    tetrahedron: found.tetrahedron.0,
                    barycentric: found.barycentric,
                    depth: found.depth,
                    direction: found.direction.to_array(),
                })
            })
            .collect()
    }
}

/// The number of ticks of the embedded scene: three seconds.
pub const TICKS: usize = 180;

/// Two soft bodies: a box falls on the ground, and a ball on the box.
pub fn embedded_scene() -> [Part; 2] {
    let bodies = [
        ("box", tetrahedral_box([12, 8, 12], [0.3, 0.2, 0.3]), [0.0, 0.35, 0.0]),
        ("ball", tetrahedral_ball(9, 0.2), [0.05, 1.1, 0.02]),
    ];
    bodies.map(|(name, mut mesh, place)| {
        for (coordinate, by) in mesh.positions.iter_mut().flat_map(|position| position.iter_mut().zip(place)) {
            *coordinate += by;
        }
        Part { name: name.to_owned(), mesh }
    })
}
