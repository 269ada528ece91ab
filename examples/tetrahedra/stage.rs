//! The app with the bodies, and the embedded scene.

use std::f64::consts::PI;

use bevy_app::prelude::*;
use bevy_circumsphere::{CircumsphereSettings, detection::DetectionDiagnostics, prelude::*};
use bevy_ecs::prelude::*;
use circumsphere_examples::headless::{detect, headless_app, move_surface, recording::Recorder};
use circumsphere_support::tetrahedra::{TetrahedralMesh, tetrahedral_ball, tetrahedral_box};
use glam::{DVec3, Vec3};

use super::{
    TetrahedraExampleError,
    output::{Row, Tick},
};

/// A body with a name.
pub struct Part {
    pub name: String,
    pub mesh: TetrahedralMesh,
}

/// An app with two bodies.
pub struct Stage {
    app: App,
    bodies: [(Entity, String); 2],
}

impl Stage {
    pub fn new(parts: [Part; 2], own_collision: bool, recorder: Recorder) -> Result<Self, TetrahedraExampleError> {
        let settings = CircumsphereSettings { threads: 1, ..CircumsphereSettings::default() };
        let mut app = headless_app(
            DeformableCollisionPlugins::new(Update).build().add(TetrahedralContainmentPlugin),
            settings,
            recorder,
        );
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
            let mut entity = app.world_mut().spawn((Name::new(name), body, surface, positions));
            if own_collision {
                entity.insert(SelfCollision);
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

    pub fn move_to(&mut self, positions: &[Vec<Vec3>; 2]) {
        for ((entity, _), positions) in self.bodies.iter().zip(positions) {
            move_surface(&mut self.app, *entity, positions.clone());
        }
    }

    pub fn tick(&mut self, number: usize) -> Result<Tick, TetrahedraExampleError> {
        detect(&mut self.app);
        let world = self.app.world();
        for (entity, description) in &self.bodies {
            let status = world.get::<SurfaceStatus>(*entity).cloned().unwrap_or_default();
            if status != SurfaceStatus::Active {
                return Err(TetrahedraExampleError::Unused { name: description.clone(), status });
            }
        }
        let containments = world.resource::<Containments>();
        let stages = &world.resource::<DetectionDiagnostics>().stages;
        let in_own = containments.iter().filter(|found| found.body == found.container).count();
        Ok(Tick {
            number,
            in_other: containments.len() - in_own,
            in_own,
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

pub const TICKS: usize = 60;

/// Cubes of the bar and of the ball. Together they have some 20,000 tetrahedra.
const CUBES_OF_BAR: [usize; 3] = [45, 6, 6];
const CUBES_OF_BALL: usize = 12;

const LENGTH_OF_BAR: f64 = 6.0;
const THICKNESS_OF_BAR: f64 = 0.6;
const RADIUS_OF_BALL: f64 = 0.6;

/// How far the bar curls in the last tick, in full circles. Its ends then overlap.
const TURNS: f64 = 1.08;

/// Heights of the ball's center in the first and the last tick. In the last one it is deep in the bar.
const FALL: [f64; 2] = [1.6, 0.3];

/// Two soft bodies: a bar that curls up, and a ball that falls into it.
pub struct EmbeddedScene {
    bar: TetrahedralMesh,
    ball: TetrahedralMesh,
}

pub fn embedded_scene() -> EmbeddedScene {
    EmbeddedScene {
        bar: tetrahedral_box(CUBES_OF_BAR, [LENGTH_OF_BAR, THICKNESS_OF_BAR, THICKNESS_OF_BAR].map(|size| 0.5 * size)),
        ball: tetrahedral_ball(CUBES_OF_BALL, RADIUS_OF_BALL),
    }
}

impl EmbeddedScene {
    pub fn parts(&self) -> [Part; 2] {
        [("bar", &self.bar), ("ball", &self.ball)]
            .map(|(name, mesh)| Part { name: name.to_owned(), mesh: mesh.clone() })
    }

    pub fn positions_at(&self, tick: usize) -> [Vec<Vec3>; 2] {
        let share = (tick + 1) as f64 / TICKS as f64;
        let curvature = share * TURNS * 2.0 * PI / LENGTH_OF_BAR;
        let curl = |[x, y, z]: [f64; 3]| {
            let (sine, cosine) = (curvature * x).sin_cos();
            let radius = curvature.recip() - y;
            DVec3::new(radius * sine, curvature.recip() - radius * cosine, z)
        };
        let height = FALL[0] + (FALL[1] - FALL[0]) * share;
        // The ball is squashed on its way.
        let fall = |[x, y, z]: [f64; 3]| {
            DVec3::new(x * (1.0 + 0.1 * share), y * (1.0 - 0.2 * share) + height, z * (1.0 + 0.1 * share))
        };
        let moved = |mesh: &TetrahedralMesh, motion: &dyn Fn([f64; 3]) -> DVec3| {
            mesh.positions.iter().map(|position| motion(position.map(f64::from)).as_vec3()).collect()
        };
        [moved(&self.bar, &curl), moved(&self.ball, &fall)]
    }
}
