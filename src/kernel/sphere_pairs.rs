//! The approximate stages over a list of candidate pairs: sphere overlap and cone test.
//!
//! Reads candidate pairs and the spheres of both sides, writes the pairs that pass. Spheres are kept in the frame of
//! their own surface; those of a moved side are brought over pair by pair.

use glam::Vec3;

use super::{
    circumsphere::{Ball, OffsetSpheres},
    cone::{Cap, CapContact, SafetyCones, cap_contact, spheres_overlap},
    exact::cull::cull_by_planes,
    ids::TriangleId,
    pose::Pose,
    topology::SurfaceTopology,
};

/// The enclosing balls of one side, and the way to the frame of the pair.
#[derive(Clone, Copy)]
pub struct BallSide<'a> {
    /// One ball a triangle, in the side's own frame.
    pub balls: &'a [Ball],
    /// From the side's own frame to the frame of the pair.
    pub pose: &'a Pose,
}

impl BallSide<'_> {
    /// One triangle's ball in the frame of the pair.
    #[must_use]
    pub fn ball(&self, triangle: u32) -> Ball {
        let ball = self.balls[triangle as usize];
        if *self.pose == Pose::IDENTITY {
            return ball;
        }
        Ball {
            center: self.pose.transform_point(ball.center.as_dvec3()).as_vec3(),
            radius: (f64::from(ball.radius) * self.pose.scale()) as f32,
        }
    }
}

/// The offset spheres and cones of one side, and the way to the frame of the pair.
#[derive(Clone, Copy)]
pub struct CapSide<'a> {
    /// Offset spheres, in the side's own frame.
    pub spheres: &'a OffsetSpheres,
    /// Safety cones, in the side's own frame.
    pub cones: &'a SafetyCones,
    /// The side's triangles.
    pub topology: &'a SurfaceTopology,
    /// The side's vertices in the frame of the pair.
    pub positions: &'a [Vec3],
    /// From the side's own frame to the frame of the pair.
    pub pose: &'a Pose,
    /// Whether the surface has an inside; a sheet has a cap on either side of each triangle.
    pub one_sided: bool,
}

impl CapSide<'_> {
    /// One triangle's sphere and cone in the frame of the pair.
    #[must_use]
    pub fn cap(&self, triangle: u32) -> Cap {
        let triangle = triangle as usize;
        let cap = Cap {
            center: self.spheres.centers[triangle],
            radius: self.spheres.radii[triangle],
            height: self.spheres.heights[triangle],
            axis: self.cones.axes[triangle],
            cosine: self.cones.cosines[triangle],
        };
        if *self.pose == Pose::IDENTITY {
            return cap;
        }
        let scale = self.pose.scale();
        Cap {
            center: self.pose.transform_point(cap.center.as_dvec3()).as_vec3(),
            radius: (f64::from(cap.radius) * scale) as f32,
            height: (f64::from(cap.height) * scale) as f32,
            axis: self.pose.transform_direction(cap.axis.as_dvec3()).as_vec3(),
            cosine: cap.cosine,
        }
    }
}

/// The caps of a pair of triangles, of sheets those that face the other triangle.
fn facing_caps(a: &CapSide<'_>, b: &CapSide<'_>, [triangle_a, triangle_b]: [u32; 2]) -> [Cap; 2] {
    let (cap_a, cap_b) = (a.cap(triangle_a), b.cap(triangle_b));
    let facing = |side: &CapSide<'_>, cap: &Cap, other: &Cap| {
        if side.one_sided { *cap } else { cap.facing(other.in_plane_center()) }
    };
    [facing(a, &cap_a, &cap_b), facing(b, &cap_b, &cap_a)]
}

/// A pair whose caps meet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CapPair {
    /// Triangle of the first side.
    pub triangle_a: u32,
    /// Triangle of the second side.
    pub triangle_b: u32,
    /// Where the line between the centers meets both triangles' planes, in the frame of the pair.
    pub contact: CapContact,
}

/// Appends the candidates whose enclosing balls come within `reach`. In a self-collision, `adjacency` names the
/// surface, and pairs that share a vertex are left out.
pub fn overlapping_balls(
    a: &BallSide<'_>,
    b: &BallSide<'_>,
    adjacency: Option<&SurfaceTopology>,
    reach: f32,
    candidates: &[[u32; 2]],
    overlapping: &mut Vec<[u32; 2]>,
) {
    overlapping.extend(candidates.iter().filter(|&&[triangle_a, triangle_b]| {
        let (ball_a, ball_b) = (a.ball(triangle_a), b.ball(triangle_b));
        spheres_overlap(ball_a.center, ball_a.radius, ball_b.center, ball_b.radius, reach)
            && !adjacency.is_some_and(|topology| topology.share_vertex(TriangleId(triangle_a), TriangleId(triangle_b)))
    }));
}

/// Appends the candidates whose offset spheres come within `reach` and whose planes do not separate them by more.
pub fn overlapping_caps(
    a: &CapSide<'_>,
    b: &CapSide<'_>,
    adjacency: Option<&SurfaceTopology>,
    reach: f32,
    candidates: &[[u32; 2]],
    overlapping: &mut Vec<[u32; 2]>,
) {
    let overlap = |&[triangle_a, triangle_b]: &[u32; 2]| {
        let [cap_a, cap_b] = facing_caps(a, b, [triangle_a, triangle_b]);
        spheres_overlap(cap_a.center, cap_a.radius, cap_b.center, cap_b.radius, reach)
            && !adjacency.is_some_and(|topology| topology.share_vertex(TriangleId(triangle_a), TriangleId(triangle_b)))
    };
    let spheres_meet: Vec<[u32; 2]> = candidates.iter().copied().filter(overlap).collect();
    let triangles = [a.topology.triangles(), b.topology.triangles()];
    cull_by_planes([a.positions, b.positions], triangles, &spheres_meet, reach, overlapping);
}

/// Appends the pairs that pass the cone test, with their contact.
pub fn meeting_caps(a: &CapSide<'_>, b: &CapSide<'_>, overlapping: &[[u32; 2]], meeting: &mut Vec<CapPair>) {
    meeting.extend(overlapping.iter().filter_map(|&[triangle_a, triangle_b]| {
        let [cap_a, cap_b] = facing_caps(a, b, [triangle_a, triangle_b]);
        let contact = cap_contact(&cap_a, &cap_b)?;
        Some(CapPair { triangle_a, triangle_b, contact })
    }));
}
