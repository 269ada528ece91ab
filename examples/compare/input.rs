//! What everyone is given: one mesh, and positions of it tick by tick.

use bevy_circumsphere::kernel::mesh::topology::{SurfaceTopology, TopologyError};
use circumsphere_support::{random::Random, recording::Recording};
use glam::Vec3;

/// Ticks after the cold one, in each of which every vertex moves by [`DRIFT`]: enough for what is remembered to be renewed
/// twice.
const DRIFT_TICKS: usize = 12;

/// How far a vertex moves in such a tick, in contact distances: less than a tenth.
const DRIFT: f32 = 0.09;

/// A mesh and how far apart its triangles touch.
pub struct Input {
    pub name: String,
    pub vertices: usize,
    pub triangles: Vec<[u32; 3]>,
    /// The same with one vertex for all at exactly equal positions of the first frame: who shares one is a neighbor.
    pub welded: Vec<[u32; 3]>,
    pub mean_edge: f64,
    pub contact_distance: f64,
    pub ticks: Vec<Tick>,
}

/// One measured tick.
pub struct Tick {
    /// The number of its frame.
    pub frame: usize,
    /// Another state of the mesh, in which it is before the measured tick.
    pub before: Vec<Vec3>,
    /// Its state at the measured tick.
    pub now: Vec<Vec3>,
    /// The ticks that follow, in small steps, every vertex in a direction of its own.
    pub drift: Vec<Vec<Vec3>>,
}

fn positions(frame: &[[f32; 3]]) -> Vec<Vec3> {
    frame.iter().copied().map(Vec3::from_array).collect()
}

/// One direction a vertex, all over the sphere.
fn directions(count: usize) -> Vec<Vec3> {
    let mut random = Random::new(1);
    (0..count)
        .map(|_| {
            loop {
                let point = Vec3::from_array(std::array::from_fn(|_| random.signed_unit()));
                // Within the ball every direction is as likely as any other.
                if (0.01..1.0).contains(&point.length_squared()) {
                    break point.normalize();
                }
            }
        })
        .collect()
}

impl Input {
    /// The frames of a recording in `frames`; `distance_edges` is the contact distance in mean edges of its first frame.
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
                // The frame before, after the first one the next, and of a mesh that never moves one in which every
                // vertex is a contact distance away.
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
