//! Tetrahedral bodies in motion: a bar curls up until its ends overlap, and a ball falls into it.

use std::f64::consts::PI;

use super::{TetrahedralMesh, tetrahedral_ball, tetrahedral_box};

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

/// A bar and a ball, moved by formula.
pub struct CurlingBar {
    /// The bar, straight.
    pub bar: TetrahedralMesh,
    /// The ball, around the origin.
    pub ball: TetrahedralMesh,
}

impl CurlingBar {
    /// The number of ticks.
    pub const TICKS: usize = 60;
}

impl Default for CurlingBar {
    fn default() -> Self {
        Self {
            bar: tetrahedral_box(
                CUBES_OF_BAR,
                [LENGTH_OF_BAR, THICKNESS_OF_BAR, THICKNESS_OF_BAR].map(|size| 0.5 * size),
            ),
            ball: tetrahedral_ball(CUBES_OF_BALL, RADIUS_OF_BALL),
        }
    }
}

impl CurlingBar {
    /// The positions of the bar and of the ball in a tick, counted from 0.
    #[must_use]
    pub fn positions_at(&self, tick: usize) -> [Vec<[f32; 3]>; 2] {
        let share = (tick + 1) as f64 / Self::TICKS as f64;
        let curvature = share * TURNS * 2.0 * PI / LENGTH_OF_BAR;
        let curl = |[x, y, z]: [f64; 3]| {
            let (sine, cosine) = libm::sincos(curvature * x);
            let radius = curvature.recip() - y;
            [radius * sine, curvature.recip() - radius * cosine, z]
        };
        let height = FALL[0] + (FALL[1] - FALL[0]) * share;
        // The ball is squashed on its way.
        let fall =
            |[x, y, z]: [f64; 3]| [x * (1.0 + 0.1 * share), y * (1.0 - 0.2 * share) + height, z * (1.0 + 0.1 * share)];
        let moved = |mesh: &TetrahedralMesh, motion: &dyn Fn([f64; 3]) -> [f64; 3]| {
            let at = |position: &[f32; 3]| motion(position.map(f64::from)).map(|coordinate| coordinate as f32);
            mesh.positions.iter().map(at).collect()
        };
        [moved(&self.bar, &curl), moved(&self.ball, &fall)]
    }
}
