//! The approximate stages over a list of candidate pairs: sphere overlap, cone test, and the contacts they amount to.
//!
//! Reads candidate pairs and the spheres of both sides, writes the pairs that pass and their contacts. Spheres are kept
//! in the frame of their own surface; those of a moved side are brought over pair by pair.

use glam::{DVec3, Vec3};

use super::{
    circumsphere::{Ball, OffsetSpheres},
    cone::{Cap, CapContact, SafetyCones, cap_contact, spheres_overlap},
    contact::{CompactContact, TouchingPair},
    exact::{
        Feature, FeaturePair,
        barycentric::barycentric_of,
        cull::{cull_by_directions, cull_by_planes, gap_along},
        side::face_normal,
    },
    pair::{FoundPairs, PairSettings, SurfaceSide, without_neighbors},
    pair_fate::{PairFate, StepObserver, Unobserved},
    pose::Pose,
};

/// The enclosing balls of one side, and the way to the frame of the pair.
#[derive(Clone, Copy)]
pub struct BallSide<'a> {
    /// The surface in the frame of the pair.
    pub surface: SurfaceSide<'a>,
    /// One ball a triangle, in the side's own frame.
    pub balls: &'a [Ball],
    /// From the side's own frame to the frame of the pair; `None` where they are the same.
    pub pose: Option<&'a Pose>,
}

impl BallSide<'_> {
    /// One triangle's ball in the frame of the pair.
    #[must_use]
    pub fn ball(&self, triangle: u32) -> Ball {
        let ball = self.balls[triangle as usize];
        let Some(pose) = self.pose else { return ball };
        Ball {
            center: pose.transform_point(ball.center.as_dvec3()).as_vec3(),
            radius: (f64::from(ball.radius) * pose.scale()) as f32,
        }
    }
}

/// The offset spheres and cones of one side, and the way to the frame of the pair.
#[derive(Clone, Copy)]
pub struct CapSide<'a> {
    /// The surface in the frame of the pair. A sheet, which has no inside, has a cap on either side of each triangle.
    pub surface: SurfaceSide<'a>,
    /// Offset spheres, in the side's own frame.
    pub spheres: &'a OffsetSpheres,
    /// Safety cones, in the side's own frame.
    pub cones: &'a SafetyCones,
    /// From the side's own frame to the frame of the pair; `None` where they are the same.
    pub pose: Option<&'a Pose>,
}

impl CapSide<'_> {
    /// One triangle's sphere and cone in the frame of the pair.
    #[must_use]
    pub fn cap(&self, triangle: u32) -> Cap {
        let cap = Cap::of(self.spheres, self.cones, triangle as usize);
        let Some(pose) = self.pose else { return cap };
        let scale = pose.scale();
        Cap {
            center: pose.transform_point(cap.center.as_dvec3()).as_vec3(),
            radius: (f64::from(cap.radius) * scale) as f32,
            height: (f64::from(cap.height) * scale) as f32,
            axis: pose.transform_direction(cap.axis.as_dvec3()).as_vec3(),
            cosine: cap.cosine,
        }
    }
}

/// The caps of a pair of triangles, of sheets those that face the other triangle.
fn facing_caps(a: &CapSide<'_>, b: &CapSide<'_>, [triangle_a, triangle_b]: [u32; 2]) -> [Cap; 2] {
    let (cap_a, cap_b) = (a.cap(triangle_a), b.cap(triangle_b));
    let facing = |side: &CapSide<'_>, cap: &Cap, other: &Cap| {
        if side.surface.one_sided { *cap } else { cap.facing(other.in_plane_center()) }
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
    /// How far apart the spheres, the triangles' boxes and, where asked, their planes keep the two, in the frame of the
    /// pair; at least 0. They touch where it is no more than the contact distance.
    pub distance: f64,
}

/// How far apart the axis-aligned boxes of two triangles are along the axis that parts them most; 0 where they overlap.
fn box_gap(a: &[DVec3; 3], b: &[DVec3; 3]) -> f64 {
    let (low_a, high_a) = (a[0].min(a[1]).min(a[2]), a[0].max(a[1]).max(a[2]));
    let (low_b, high_b) = (b[0].min(b[1]).min(b[2]), b[0].max(b[1]).max(b[2]));
    (low_a - high_b).max(low_b - high_a).max_element().max(0.0)
}

/// Appends the candidates whose enclosing balls come within range. In a self-collision, pairs that share a vertex are
/// left out.
pub fn overlapping_balls(
    a: &BallSide<'_>,
    b: &BallSide<'_>,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    overlapping: &mut Vec<[u32; 2]>,
) {
    overlapping_balls_in_steps(a, b, candidates, settings, overlapping, &mut Unobserved);
}

/// [`overlapping_balls`], telling after each step which pairs are left.
pub(super) fn overlapping_balls_in_steps(
    a: &BallSide<'_>,
    b: &BallSide<'_>,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    overlapping: &mut Vec<[u32; 2]>,
    observer: &mut impl StepObserver,
) {
    let reach = (settings.range / settings.scale) as f32;
    let before = overlapping.len();
    let apart = without_neighbors(&a.surface, candidates, settings);
    observer.passed(PairFate::Neighbors, apart.iter().copied());
    overlapping.extend(apart.iter().filter(|&&[triangle_a, triangle_b]| {
        let (ball_a, ball_b) = (a.ball(triangle_a), b.ball(triangle_b));
        spheres_overlap(ball_a.center, ball_a.radius, ball_b.center, ball_b.radius, reach)
    }));
    observer.passed(PairFate::Spheres, overlapping[before..].iter().copied());
}

/// Appends the candidates whose offset spheres come within range and, where asked, which neither their planes nor the
/// line between the sphere centers separate by more. In a self-collision, pairs that share a vertex are left out.
pub fn overlapping_caps(
    a: &CapSide<'_>,
    b: &CapSide<'_>,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    overlapping: &mut Vec<[u32; 2]>,
) {
    overlapping_caps_in_steps(a, b, candidates, settings, overlapping, &mut Unobserved);
}

/// [`overlapping_caps`], telling after each step which pairs are left.
pub(super) fn overlapping_caps_in_steps(
    a: &CapSide<'_>,
    b: &CapSide<'_>,
    candidates: &[[u32; 2]],
    settings: &PairSettings,
    overlapping: &mut Vec<[u32; 2]>,
    observer: &mut impl StepObserver,
) {
    let reach = (settings.range / settings.scale) as f32;
    let before = overlapping.len();
    let pairs = without_neighbors(&a.surface, candidates, settings);
    observer.passed(PairFate::Neighbors, pairs.iter().copied());
    let positions = [a.surface.positions, b.surface.positions];
    let triangles = [a.surface.topology.triangles(), b.surface.topology.triangles()];
    let spheres_meet = |pair: [u32; 2]| {
        let [cap_a, cap_b] = facing_caps(a, b, pair);
        let meet = spheres_overlap(cap_a.center, cap_a.radius, cap_b.center, cap_b.radius, reach);
        meet.then_some(cap_a.center - cap_b.center)
    };
    if !settings.cull {
        overlapping.extend(pairs.iter().copied().filter(|&pair| spheres_meet(pair).is_some()));
        observer.passed(PairFate::Spheres, overlapping[before..].iter().copied());
        return;
    }
    // Planes first: they are compared eight pairs at a time and leave the fewest.
    let mut past_planes = Vec::with_capacity(pairs.len());
    let rounded_reach = reach + a.surface.rounding() + b.surface.rounding();
    cull_by_planes(positions, triangles, &pairs, rounded_reach, &mut past_planes);
    observer.passed(PairFate::Planes, past_planes.iter().copied());
    let (past_spheres, lines): (Vec<_>, Vec<_>) =
        past_planes.into_iter().filter_map(|pair| spheres_meet(pair).map(|line| (pair, line))).unzip();
    observer.passed(PairFate::Spheres, past_spheres.iter().copied());
    cull_by_directions(positions, triangles, &past_spheres, &lines, rounded_reach, overlapping);
    observer.passed(PairFate::CenterLine, overlapping[before..].iter().copied());
}

/// Appends the pairs that pass the cone test, with their contact.
pub fn meeting_caps(
    a: &CapSide<'_>,
    b: &CapSide<'_>,
    overlapping: &[[u32; 2]],
    settings: &PairSettings,
    meeting: &mut Vec<CapPair>,
) {
    meeting.extend(overlapping.iter().filter_map(|&[triangle_a, triangle_b]| {
        let [cap_a, cap_b] = facing_caps(a, b, [triangle_a, triangle_b]);
        let contact = cap_contact(&cap_a, &cap_b)?;
        let between = cap_a.center.as_dvec3().distance(cap_b.center.as_dvec3());
        let spheres = between - f64::from(cap_a.radius) - f64::from(cap_b.radius);
        let (corners_a, corners_b) = (a.surface.corners(triangle_a), b.surface.corners(triangle_b));
        let planes = if settings.cull {
            [face_normal(&corners_a), face_normal(&corners_b), contact.direction.as_dvec3()]
                .into_iter()
                .map(|direction| gap_along(direction, &corners_a, &corners_b))
                .fold(0.0, f64::max)
        } else {
            0.0
        };
        // Boxes always: candidates reach as far as the margin, and the pairs must not depend on it.
        let distance = spheres.max(planes).max(box_gap(&corners_a, &corners_b));
        Some(CapPair { triangle_a, triangle_b, contact, distance })
    }));
}

/// Appends the contacts of pairs whose enclosing balls overlap.
pub fn ball_contacts(
    a: &BallSide<'_>,
    b: &BallSide<'_>,
    overlapping: &[[u32; 2]],
    settings: &PairSettings,
    found: &mut FoundPairs,
) {
    for &triangles in overlapping {
        let (own, other) = (a.ball(triangles[0]), b.ball(triangles[1]));
        let between = own.center.as_dvec3() - other.center.as_dvec3();
        let normal = between.normalize_or(DVec3::Y).as_vec3();
        let gap = between.length() - f64::from(own.radius) - f64::from(other.radius);
        let corners = [a.surface.corners(triangles[0]), b.surface.corners(triangles[1])];
        // Candidates reach as far as the margin: without it, only what their boxes let through would be here.
        let distance = gap.max(box_gap(&corners[0], &corners[1]));
        let points = [own.center - normal * own.radius, other.center + normal * other.radius];
        let contact = FaceContact::at(triangles, &corners, points, normal, distance, gap);
        contact.push([&a.surface, &b.surface], settings, found);
    }
}

/// Appends the contacts of pairs whose caps meet.
pub fn cap_contacts(
    a: &CapSide<'_>,
    b: &CapSide<'_>,
    meeting: &[CapPair],
    settings: &PairSettings,
    found: &mut FoundPairs,
) {
    for &CapPair { triangle_a, triangle_b, contact, distance } in meeting {
        let triangles = [triangle_a, triangle_b];
        let corners = [a.surface.corners(triangle_a), b.surface.corners(triangle_b)];
        let points = [contact.point_a, contact.point_b];
        let (normal, gap) = (-contact.direction, f64::from(contact.gap));
        let contact = FaceContact::at(triangles, &corners, points, normal, distance, gap);
        contact.push([&a.surface, &b.surface], settings, found);
    }
}

/// A contact of two whole triangles by their spheres, in the frame of the pair.
struct FaceContact {
    triangles: [u32; 2],
    /// Weights of the corners at the contact points.
    barycentrics: [[f64; 3]; 2],
    point_b: DVec3,
    /// From the second side to the first.
    normal: DVec3,
    /// What the distance of the two is at least, as far as the method knows; at least 0.
    distance: f64,
    /// From one point to the other, along the normal.
    gap: f64,
}

impl FaceContact {
    fn at(
        triangles: [u32; 2],
        corners: &[[DVec3; 3]; 2],
        points: [Vec3; 2],
        normal: Vec3,
        distance: f64,
        gap: f64,
    ) -> Self {
        let points = points.map(Vec3::as_dvec3);
        let barycentrics = [barycentric_of(&corners[0], points[0]), barycentric_of(&corners[1], points[1])];
        Self { triangles, barycentrics, point_b: points[1], normal: normal.as_dvec3(), distance, gap }
    }

    /// Counts the pair by its distance, and reports its contact.
    fn push(&self, surfaces: [&SurfaceSide<'_>; 2], settings: &PairSettings, found: &mut FoundPairs) {
        let distance = self.distance * settings.scale;
        // Along the normal the two may be farther apart than what counts as the pair's distance.
        let gap = (self.gap * settings.scale).min(distance);
        found.nearest = found.nearest.min(distance.max(0.0));
        if distance <= settings.contact_distance {
            let [triangle_a, triangle_b] = self.triangles;
            found.touching.push(TouchingPair { triangle_a, triangle_b, distance: gap.max(0.0) });
        }
        if distance <= settings.reported_distance {
            found.contacts.push(CompactContact::between_triangles(
                surfaces,
                self.triangles,
                settings.same_surface,
                FeaturePair { a: Feature::Face, b: Feature::Face },
                self.barycentrics[0],
                self.barycentrics[1],
                self.point_b,
                self.normal,
                gap,
            ));
        }
    }
}
