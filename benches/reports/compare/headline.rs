//! A scene of the size in the source paper's headline: 3,000 deforming vertices against 100,000 static triangles, with
//! times as a share of a frame.
//!
//! A sheet ripples along hilly ground and touches it with about a quarter of its area. Each measurement is a whole
//! update of the app, as a game would run it.

use std::fmt::{self, Display, Formatter};

use bevy_app::prelude::*;
use bevy_circumsphere::{CircumsphereSettings, ContactStore, prelude::*};
use bevy_math::ops::sin;
use circumsphere_examples::headless::{detect, headless_app, move_surface, recording::Recorder};
use circumsphere_support::scenes::{Diagonals, Mesh, grid};
use glam::Vec3;
use serde::Serialize;

use super::measure::timed;

/// Cells along a side of the ground: 100,352 triangles.
const GROUND_CELLS: usize = 224;

/// Cells along a side of the sheet: 3,025 vertices.
const SHEET_CELLS: usize = 54;

/// Half the contact distance, in cells.
const THICKNESS: f32 = 0.05;

/// Phase that the ripples advance per tick, in radians.
const STEP: f32 = 0.05;

const TICKS: usize = 60;

/// A frame at 60 frames per second.
const FRAME_MILLISECONDS: f64 = 1000.0 / 60.0;

#[derive(Serialize)]
pub struct Headline {
    pub vertices: usize,
    pub triangles: usize,
    pub rows: Vec<HeadlineRow>,
}

#[derive(Serialize)]
pub struct HeadlineRow {
    pub method: String,
    pub median_ms: f64,
    pub least_ms: f64,
    pub share_of_frame: f64,
    pub touching: usize,
    pub contacts: usize,
}

fn ground_height(x: f32, z: f32) -> f32 {
    2.0 * sin(0.15 * x) * sin(0.13 * z)
}

fn positions(mesh: &Mesh, height: impl Fn(f32, f32) -> f32) -> Vec<Vec3> {
    mesh.positions.iter().map(|&[x, _, z]| Vec3::new(x, height(x, z), z)).collect()
}

fn sheet_positions(mesh: &Mesh, phase: f32) -> Vec<Vec3> {
    let ripple = |x: f32, z: f32| 0.2 * sin(0.7 * x + 0.4 * z + phase);
    positions(mesh, |x, z| ground_height(x, z) + 0.25 + ripple(x, z))
}

fn measure_method(method: ContactMethod) -> HeadlineRow {
    let flat = |cells: usize| grid(cells, cells, cells as f32, cells as f32, Diagonals::Alternating);
    let (ground, sheet) = (flat(GROUND_CELLS), flat(SHEET_CELLS));
    let settings = CircumsphereSettings { threads: 1, ..CircumsphereSettings::default() };
    let mut app = headless_app(DeformableCollisionPlugins::new(Update).build(), settings, Recorder::default());
    let mut spawn = |mesh: &Mesh, positions: &[Vec3]| {
        let surface = DeformableSurface::from_mesh(positions, &mesh.triangles).expect("a grid is a valid mesh");
        app.world_mut().spawn((surface, SurfaceThickness::World(THICKNESS), method)).id()
    };
    spawn(&ground, &positions(&ground, ground_height));
    let moving = spawn(&sheet, &sheet_positions(&sheet, 0.0));
    app.world_mut().entity_mut(moving).insert(SelfCollision);
    detect(&mut app);
    let mut times: Vec<f64> = (1..=TICKS)
        .map(|tick| {
            move_surface(&mut app, moving, sheet_positions(&sheet, STEP * tick as f32));
            timed(|| app.update()).0.as_secs_f64() * 1.0e3
        })
        .collect();
    times.sort_by(f64::total_cmp);
    let store = app.world().resource::<ContactStore>();
    let median_ms = 0.5 * (times[(TICKS - 1) / 2] + times[TICKS / 2]);
    HeadlineRow {
        method: format!("{method:?}"),
        median_ms,
        least_ms: times[0],
        share_of_frame: median_ms / FRAME_MILLISECONDS,
        touching: store.touching_count(),
        contacts: store.contact_count(),
    }
}

impl Headline {
    pub fn measure() -> Self {
        Self {
            vertices: (SHEET_CELLS + 1) * (SHEET_CELLS + 1),
            triangles: 2 * GROUND_CELLS * GROUND_CELLS,
            rows: ContactMethod::ALL.into_iter().map(measure_method).collect(),
        }
    }
}

impl Display for Headline {
    fn fmt(&self, out: &mut Formatter<'_>) -> fmt::Result {
        writeln!(
            out,
            "\n{} deforming vertices with self-collision against {} static triangles, one thread",
            self.vertices, self.triangles
        )?;
        writeln!(
            out,
            "{:16} {:>9} {:>9} {:>15} {:>9} {:>9}",
            "", "median", "min ms", "of 16.7 ms", "touching", "contacts"
        )?;
        for row in &self.rows {
            writeln!(
                out,
                "{:16} {:>9.2} {:>9.2} {:>13.1} % {:>9} {:>9}",
                row.method,
                row.median_ms,
                row.least_ms,
                100.0 * row.share_of_frame,
                row.touching,
                row.contacts
            )?;
        }
        Ok(())
    }
}
