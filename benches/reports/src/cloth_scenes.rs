//! Cloths that fall onto something fixed: the scenes in which reports time whole ticks.

use circumsphere_examples::scenes::{
    Extent,
    cloth_drop::{self, BALL_RADIUS, ball_mesh, cloth_above_ball},
};
use circumsphere_support::scenes::{Diagonals, Mesh, grid};

/// Size of the source paper's scene: deforming vertices and static triangles.
pub const DEFORMING: f64 = 3_000.0;
pub const STATIC: f64 = 100_000.0;

/// Half the contact distance of cloths and hills, in meters.
pub const HILLS_THICKNESS: f32 = 0.002;

/// Number of ticks until cloths lie on the hills.
pub const HILLS_FALL: usize = 25;

/// Length of a cell of hills and cloths, in meters.
const CELL: f32 = 0.025;

/// What a cloth falls onto. It does not move.
pub enum Obstacle {
    /// A ball around the origin, tested by formula, with this radius in meters.
    Ball(f32),
    /// A closed mesh.
    Closed(Mesh),
    /// A mesh that faces up, without overhangs.
    Ground(Mesh),
}

impl Obstacle {
    /// The mesh. `None` for a ball.
    pub fn mesh(&self) -> Option<&Mesh> {
        match self {
            Self::Ball(_) => None,
            Self::Closed(mesh) | Self::Ground(mesh) => Some(mesh),
        }
    }
}

/// A cloth above an obstacle, and for how long it is played.
pub struct ClothScene {
    pub name: &'static str,
    /// A square of as many vertices along x as along z, turned about y.
    pub cloth: Mesh,
    pub obstacle: Obstacle,
    /// Thickness of the cloth, and of the obstacle if it is a mesh, in meters.
    pub thickness: f32,
    /// Number of ticks until the cloth lies on the obstacle.
    pub fall: usize,
    /// Number of measured ticks after that.
    pub measured: usize,
}

impl ClothScene {
    /// A square meter of cloth above a ball.
    pub fn on_ball(extent: Extent) -> Self {
        Self::above_ball("cloth on a ball", Obstacle::Ball(BALL_RADIUS), extent)
    }

    /// The same above a mesh of a ball.
    pub fn on_ball_mesh(extent: Extent) -> Self {
        Self::above_ball("cloth on a mesh of a ball", Obstacle::Closed(ball_mesh(extent)), extent)
    }

    fn above_ball(name: &'static str, obstacle: Obstacle, extent: Extent) -> Self {
        let (fall, measured) = extent.pick((15, 3), (30, 9));
        Self { name, cloth: cloth_above_ball(extent), obstacle, thickness: cloth_drop::THICKNESS, fall, measured }
    }

    /// A cloth of the source paper's size above hills.
    pub fn on_hills(extent: Extent) -> Self {
        let (ground, mut cloths) = cloths_above_hills(extent.pick(1.0 / 16.0, 1.0));
        let (fall, measured) = extent.pick((15, 3), (HILLS_FALL, 9));
        Self {
            name: "cloth of the paper's size",
            cloth: cloths.swap_remove(0),
            obstacle: Obstacle::Ground(ground),
            thickness: HILLS_THICKNESS,
            fall,
            measured,
        }
    }
}

/// Hilly ground and the cloths above it, `multiple` times the size of the source paper's scene. Up to a multiple of 1
/// there is one cloth, and beyond that there are as many of the paper's size.
#[expect(clippy::cast_sign_loss, reason = "roots and multiples are not negative")]
pub fn cloths_above_hills(multiple: f64) -> (Mesh, Vec<Mesh>) {
    let cells = (STATIC * multiple / 2.0).sqrt().round() as usize;
    let width = cells as f32 * CELL;
    let mut ground = grid(cells, cells, width, width, Diagonals::Alternating);
    for position in &mut ground.positions {
        let wave = |coordinate: f32, length: f32| bevy_math::ops::sin(std::f32::consts::TAU * coordinate / length);
        position[1] = 0.08 * wave(position[0], 1.1) * wave(position[2], 0.9);
    }
    let count = multiple.max(1.0).round() as usize;
    let side = (DEFORMING * multiple / count as f64).sqrt().round() as usize;
    let columns = (count as f64).sqrt().ceil() as usize;
    let cloths = (0..count).map(|number| {
        let place = |number: usize, of: usize| ((number as f32 + 0.5) / of as f32 - 0.5) * width;
        let cloth_width = (side - 1) as f32 * CELL;
        let cloth = grid(side - 1, side - 1, cloth_width, cloth_width, Diagonals::Alternating);
        // Rotate the cloths relative to the ground, so that no two cells are aligned in the same way.
        let (x, z) = (place(number % columns, columns), place(number / columns, count.div_ceil(columns)));
        cloth.rotate([0.0, 1.0, 0.0], 0.3 + number as f32).translate([x, 0.1, z])
    });
    (ground, cloths.collect())
}
