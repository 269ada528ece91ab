//! Tunnelling: an object is shot at a target that should stop it, at a speed given in thicknesses per tick.

use bevy_circumsphere::{
    prelude::*,
    response::{XpbdBody, XpbdMaterial},
};
use bevy_ecs::prelude::*;
use circumsphere_support::scenes::{Diagonals, Mesh, closed_target, grid, icosphere, needle};
use clap::ValueEnum;
use glam::{DVec3, Vec3};

use super::{Scene, Stage, TICK, Variation, truth::Closed};
use crate::headless::recording::Recorder;

/// Half the contact distance, in meters.
const THICKNESS: f32 = 0.002;

/// Width of the target sheet, in meters.
const SHEET: f32 = 0.5;

/// Object and target.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Target {
    /// A ball at a sheet pinned along its border
    Sheet,
    /// A flat sheet at a larger sheet pinned along its border
    SheetBySheet,
    /// A needle at a static closed surface
    Closed,
}

/// Object, target, and speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shot {
    /// Object and target.
    pub target: Target,
    /// Speed in thicknesses of 2 mm per tick.
    pub speed: f32,
}

impl Default for Shot {
    /// A ball at 36 m/s.
    fn default() -> Self {
        Self { target: Target::Sheet, speed: 300.0 }
    }
}

/// Steel, so that the needle keeps its shape.
const STEEL: XpbdMaterial = XpbdMaterial {
    area_density: 8.0,
    stretch_compliance: 0.0,
    bend_compliance: 0.0,
    volume_compliance: f32::INFINITY,
    damping: 100.0,
    drag: 0.0,
    ..XpbdMaterial::CLOTH
};

/// The shot goes downwards and reaches the target in the second tick.
pub fn bullet_cloth(variation: &Variation, recorder: Recorder) -> Scene {
    let mut stage = Stage::new(variation, recorder);
    let Shot { target, speed } = variation.shot;
    let way = speed * THICKNESS;
    // The first tick must end before any collision, and the distance must not be a whole number of ticks.
    let gap = 3.0 * THICKNESS + 1.37 * way;
    let shot = |body: XpbdBody| body.moving(Vec3::NEG_Y * (way / TICK.as_secs_f32()));
    let thickness = SurfaceThickness::World(THICKNESS);
    let scene = |stage| Scene::new(stage, 60);
    match target {
        Target::Sheet => {
            let sheet = add_sheet(&mut stage, variation);
            let radius = 0.05;
            let ball = icosphere(variation.extent.pick(1, 2), radius).translate([0.013, radius + gap, 0.007]);
            let ball = stage.add_body("ball", &ball, XpbdMaterial::SOFT, shot, thickness);
            scene(stage).passed(move |stage| behind_sheet(stage, sheet, ball))
        }
        Target::SheetBySheet => {
            let sheet = add_sheet(&mut stage, variation);
            let cells = variation.extent.pick(6, 16);
            let other = grid(cells, cells, 0.3, 0.3, Diagonals::Alternating).rotate([0.0, 1.0, 0.0], 0.4);
            let other = other.translate([0.013, gap, 0.007]);
            let other = stage.add_body("shot sheet", &other, XpbdMaterial::CLOTH, shot, (thickness, SelfCollision));
            scene(stage).passed(move |stage| behind_sheet(stage, sheet, other))
        }
        Target::Closed => {
            let closed = closed_target();
            let highest = closed.positions.iter().map(|position| position[1]).fold(f32::MIN, f32::max);
            let closed = stage.add_obstacle("target", &closed, thickness);
            let needle = needle(0.1, 0.002).translate([0.013, highest + gap, 0.007]);
            let needle = stage.add_body("needle", &needle, STEEL, shot, thickness);
            scene(stage).passed(move |stage| below(stage, closed, needle))
        }
    }
}

/// A sheet in the plane y = 0, pinned along its border.
fn add_sheet(stage: &mut Stage, variation: &Variation) -> Entity {
    let cells = variation.extent.pick(10, 30);
    let sheet = grid(cells, cells, SHEET, SHEET, Diagonals::Alternating);
    let border = border(&sheet);
    let extra = (SurfaceThickness::World(THICKNESS), SelfCollision);
    stage.add_body("sheet", &sheet, XpbdMaterial::CLOTH, |body| body.pinned(border), extra)
}

fn border(sheet: &Mesh) -> Vec<VertexId> {
    let is_outer = |position: &[f32; 3]| position[0].abs().max(position[2].abs()) > 0.4999 * SHEET;
    (0..).zip(&sheet.positions).filter(|(_, position)| is_outer(position)).map(|(vertex, _)| VertexId(vertex)).collect()
}

/// Number of vertices of the object that are directly below the rest position of the sheet, and not in the pocket
/// between the sheet and its rest position. Vertices beside the sheet do not count: the object may have bounced off and
/// fallen past it.
fn behind_sheet(stage: &Stage, sheet: Entity, shot: Entity) -> usize {
    let current = stage.world_positions(sheet);
    let triangles = stage.surface(sheet).topology().triangles();
    let first = current.len() as u32;
    let turned = triangles.iter().map(|&[a, b, c]| [first + a, first + c, first + b]);
    let triangles: Vec<[u32; 3]> = triangles.iter().copied().chain(turned).collect();
    let positions: Vec<DVec3> = current.into_iter().chain(stage.rest(sheet).iter().copied()).collect();
    let pocket = Closed::new(&positions, &triangles);
    let half = 0.5 * f64::from(SHEET);
    let is_behind = |point: &&DVec3| {
        let beside = point.x.abs() > half || point.z.abs() > half;
        point.y < 0.0 && !beside && !pocket.contains(**point)
    };
    stage.world_positions(shot).iter().filter(is_behind).count()
}

/// Number of vertices directly below a surface that they approached from above.
fn below(stage: &Stage, surface: Entity, shot: Entity) -> usize {
    let surface = stage.world_positions(surface);
    let (low, high) =
        surface.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), &p| (low.min(p), high.max(p)));
    let is_below = |point: &&DVec3| {
        let beside = point.x < low.x || point.x > high.x || point.z < low.z || point.z > high.z;
        point.y < low.y && !beside
    };
    stage.world_positions(shot).iter().filter(is_below).count()
}
