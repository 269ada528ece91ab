//! The common input of all contestants: one mesh, with positions for each tick.

use bevy_circumsphere::geometry::{SurfaceTopology, TopologyError};
use circumsphere_support::{random::Random, recording::Recording};
use glam::Vec3;

/// Number of ticks after the cold one. Every vertex moves by [`DRIFT`] per tick. The list of near pairs is made anew
/// twice in that time.
const DRIFT_TICKS: usize = 12;

/// Displacement of a vertex per drift tick, in contact distances: less than a tenth.
const DRIFT: f32 = 0.09;

/// A mesh and its contact distance.
pub struct Input {
    pub name: String,
    pub vertices: usize,
    pub triangles: Vec<[u32; 3]>,
    /// The triangles after welding of vertices at exactly equal positions in the first frame. Triangles that share a
    /// welded vertex are neighbors.
    pub welded: Vec<[u32; 3]>,
    pub mean_edge: f64,
    pub contact_distance: f64,
    pub ticks: Vec<Tick>,
}

/// One measured tick.
pub struct Tick {
    /// Frame number.
    pub frame: usize,
    /// Positions before the measured tick, in another shape.
    pub before: Vec<Vec3>,
    /// Positions in the measured tick.
    pub now: Vec<Vec3>,
    /// Positions in the ticks that follow, in small steps. Every vertex moves in its own direction.
    pub drift: Vec<Vec<Vec3>>,
}

fn positions(frame: &[[f32; 3]]) -> Vec<Vec3> {
    frame.iter().copied().map(Vec3::from_array).collect()
}

/// One random direction per vertex, uniform over the sphere.
fn directions(count: usize) -> Vec<Vec3> {
    let mut random = Random::new(1);
    (0..count)
        .map(|_| {
            loop {
                let point = Vec3::from_array(std::array::from_fn(|_| random.signed_unit()));
                // Within the ball, all directions are equally likely.
                if (0.01..1.0).contains(&point.length_squared()) {
                    break point.normalize();
                }
            }
        })
        .collect()
}

impl Input {
    /// Makes the input from the given frames of a recording. `distance_edges` is the contact distance in mean edges of
    /// the recording's first frame.
    pub fn new(
        name: String,
        recording: &Recording,
        frames: std::ops::Range<usize>,
        distance_edges: f64,
    ) -> Result<Self, TopologyError> {
        let first = positions(&recording.frames[0]);
        let topology = SurfaceTopology::new(&first, &recording.triangles)?;
        let mean_edge = topology.mean_edge_length(&first);
        let contact_distance = distance_edges * mean_edge;
        let directions = directions(first.len());
        let moved = |from: &[Vec3], distance: f32| -> Vec<Vec3> {
            from.iter().zip(&directions).map(|(&from, &direction)| from + distance * direction).collect()
        };
        let ticks = frames
            .map(|frame| {
                let now = positions(&recording.frames[frame]);
                // The previous frame, or the next one for the first frame. For a mesh that never moves, positions
                // displaced by the contact distance.
                let before = match frame.checked_sub(1).or((recording.frames.len() > 1).then_some(1)) {
                    Some(other) => positions(&recording.frames[other]),
                    None => moved(&now, contact_distance as f32),
                };
                let step = DRIFT * contact_distance as f32;
                let drift = (1..=DRIFT_TICKS).map(|tick| moved(&now, step * tick as f32)).collect();
                Tick { frame, before, now, drift }
            })
            .collect();
        let (triangles, welded) = (recording.triangles.clone(), topology.welded_triangles().to_vec());
        Ok(Self { name, vertices: first.len(), triangles, welded, mean_edge, contact_distance, ticks })
    }

    /// Half the contact distance, by which boxes are grown.
    pub fn thickness(&self) -> f32 {
        (0.5 * self.contact_distance) as f32
    }
}
