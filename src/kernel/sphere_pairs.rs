//! The approximate stages over a list of candidate pairs: sphere overlap and cone test.
//!
//! Reads candidate pairs and the spheres of both sides, writes the pairs that pass. Spheres are kept in the frame of
//! their own surface; those of a moved side are brought over pair by pair.

use glam::{DVec3, Vec3};

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

    fn corners(&self, triangle: u32) -> [DVec3; 3] {
        self.topology.triangles()[triangle as usize].map(|vertex| self.positions[vertex as usize].as_dvec3())
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
    /// How far apart the spheres and the triangles' planes and boxes keep the two, in the frame of the pair; at least
    /// 0. They touch where it is no more than the contact distance.
    pub distance: f64,
}

/// How far apart the axis-aligned boxes of two triangles are along the axis that parts them most; 0 where they overlap.
#[must_use]
pub fn box_gap(a: &[DVec3; 3], b: &[DVec3; 3]) -> f64 {
    let (low_a, high_a) = (a[0].min(a[1]).min(a[2]), a[0].max(a[1]).max(a[2]));
    let (low_b, high_b) = (b[0].min(b[1]).min(b[2]), b[0].max(b[1]).max(b[2]));
    (low_a - high_b).max(low_b - high_a).max_element().max(0.0)
}

/// How far apart two triangles are along the first one's normal; 0 where they overlap or it has none.
fn slab_gap(own: &[DVec3; 3], other: &[DVec3; 3]) -> f64 {
    let normal = (own[1] - own[0]).cross(own[2] - own[0]).normalize_or_zero();
    let [a, b, c] = [0, 1, 2].map(|k| normal.dot(own[k] - own[0]));
    let [p, q, r] = [0, 1, 2].map(|k| normal.dot(other[k] - own[0]));
    (p.min(q).min(r) - a.max(b).max(c)).max(a.min(b).min(c) - p.max(q).max(r)).max(0.0)
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
        let spheres = f64::from(cap_a.center.distance(cap_b.center) - cap_a.radius - cap_b.radius);
        let (corners_a, corners_b) = (a.corners(triangle_a), b.corners(triangle_b));
        let planes = slab_gap(&corners_a, &corners_b).max(slab_gap(&corners_b, &corners_a));
        let distance = spheres.max(planes).max(box_gap(&corners_a, &corners_b));
        Some(CapPair { triangle_a, triangle_b, contact, distance })
    }));
}
