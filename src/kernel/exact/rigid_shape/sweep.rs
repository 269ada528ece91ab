//! Shapes as triangle meshes with a radius, for continuous collision detection.

use glam::{DVec3, Vec3};

use super::{ShapeGeometry, frustum::Frustum, polytope::ConvexPolytope};

/// Sides of the mesh that approximates a cylinder or a cone. Between its edges the mesh is 7.5e-5 of the radius inside
/// the surface.
const SEGMENTS: u32 = 256;
/// Cosine and sine of a full turn divided by [`SEGMENTS`].
const STEP: [f64; 2] = [0.999_698_818_696_204_2, 0.024_541_228_522_912_288];

/// All points within a radius of some triangles.
#[derive(Clone, Debug, PartialEq)]
pub struct SweepPart {
    /// Vertices, in the frame of the shape.
    pub points: Vec<Vec3>,
    /// Vertex indices, counter-clockwise from outside if the triangles enclose something. A segment is a triangle whose
    /// last two corners coincide, and the center of a ball one whose three corners coincide.
    pub triangles: Vec<[u32; 3]>,
    /// The radius, 0 or more.
    pub radius: f32,
}

impl ShapeGeometry {
    /// The shape as meshes with a radius: one for each part of a compound, none for a half-space. Cylinders and cones
    /// have 256 sides. Their edges are on the surface, and their middles at most 7.5e-5 of the radius inside. All other
    /// shapes are exact.
    #[must_use]
    pub fn sweep_parts(&self) -> Vec<SweepPart> {
        match self {
            Self::Rounded { start, end, radius } => vec![SweepPart {
                points: [start, end, end].map(|point| point.as_vec3()).to_vec(),
                triangles: vec![[0, 1, 2]],
                radius: *radius as f32,
            }],
            Self::HalfSpace { .. } => Vec::new(),
            Self::Polytope(polytope) => vec![of_polytope(polytope)],
            Self::Convex(frustum) => vec![of_frustum(frustum)],
            Self::Compound(compound) => compound
                .parts()
                .iter()
                .flat_map(|part| {
                    let mut sweeps = part.geometry.sweep_parts();
                    for point in sweeps.iter_mut().flat_map(|sweep| &mut sweep.points) {
                        *point = part.outward(point.as_dvec3()).as_vec3();
                    }
                    sweeps
                })
                .collect(),
        }
    }
}

fn of_polytope(polytope: &ConvexPolytope) -> SweepPart {
    let topology = polytope.topology();
    let mut points = vec![Vec3::ZERO; topology.vertex_count()];
    for (corners, numbers) in polytope.faces().iter().zip(topology.triangles()) {
        for (corner, number) in corners.iter().zip(numbers) {
            points[*number as usize] = corner.as_vec3();
        }
    }
    SweepPart { points, triangles: topology.triangles().to_vec(), radius: polytope.border() as f32 }
}

/// The centers of both caps, then the rims. The top of a cone is its apex alone.
fn of_frustum(frustum: &Frustum) -> SweepPart {
    const BOTTOM: u32 = 0;
    const TOP: u32 = 1;
    const RIM: u32 = 2;
    let mut turn = [1.0, 0.0];
    let mut rim = |radius: f64, height: f64| {
        let mut points = Vec::new();
        for _ in 0..SEGMENTS {
            points.push(DVec3::new(radius * turn[0], height, radius * turn[1]).as_vec3());
            turn = [turn[0] * STEP[0] - turn[1] * STEP[1], turn[0] * STEP[1] + turn[1] * STEP[0]];
        }
        turn = [1.0, 0.0];
        points
    };
    let half_height = frustum.half_height();
    let mut points: Vec<Vec3> = [-half_height, half_height].map(|height| (DVec3::Y * height).as_vec3()).to_vec();
    points.extend(rim(frustum.bottom_radius(), -half_height));
    let has_top = frustum.top_radius() > 0.0;
    if has_top {
        points.extend(rim(frustum.top_radius(), half_height));
    }
    let mut triangles = Vec::new();
    for side in 0..SEGMENTS {
        let (here, next) = (RIM + side, RIM + (side + 1) % SEGMENTS);
        triangles.push([BOTTOM, here, next]);
        if has_top {
            let (above, above_next) = (here + SEGMENTS, next + SEGMENTS);
            triangles.extend([[TOP, above_next, above], [here, above, next], [next, above, above_next]]);
        } else {
            triangles.push([TOP, next, here]);
        }
    }
    SweepPart { points, triangles, radius: frustum.border() as f32 }
}
