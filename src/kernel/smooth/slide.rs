//! Where two smooth surfaces are closest, near two given points of them.
//!
//! Along a direction `n`, both surfaces are heights over one plane, `h_a` below `h_b`, with slopes `g` and curvatures
//! `K` (2×2). Let `r` be the part in the plane of the vector from the first point to the second, `d` its part along
//! `n`, and `t` the displacements of both points in the plane. The points are closest if the vector between them is
//! normal to both surfaces:
//!
//! `r + t_b − t_a = −d (g_a + K_a t_a) = −d (g_b + K_b t_b)`
//!
//! which gives `[K_b (I − d K_a) − K_a] t_a = g_a − g_b + K_b (r + d g_a)`. A step solves this and begins again at the
//! new points. It holds for any sign of `d`, and has a solution where surfaces touch. A Newton step for the squared
//! distance has none there.

use glam::{DMat2, DVec2, DVec3};

use super::patch::{Local, Patch};
use crate::kernel::{
    mesh::{barycentric::barycentric_of, curved_edges::CurvedEdges, ids::EdgeId, topology::share_corner},
    pair::SurfaceSide,
};

/// Steps from the closest points of the flat triangles.
const STEPS: usize = 8;

/// A surface is a height over the plane if its normal is within this cosine of the direction.
const LEAST_COSINE: f64 = 0.3;

/// In directions in which surfaces part more slowly than this, times the inverse of the size, points move only as if
/// they parted that fast. So points of surfaces that fit together stay where they are.
const LEAST_PARTING: f64 = 0.1;

/// A step moves a point at most by this share of the size of its triangle.
const LONGEST_STEP: f64 = 0.5;

/// Steps shorter than this share of the size end the search.
const SHORTEST_STEP: f64 = 1.0e-9;

/// Points that are off by more than this share of the size, across the direction from one to the other, are given up.
const LARGEST_ERROR: f64 = 1.0e-2;

/// A smooth or flat surface in the frame of a pair.
#[derive(Clone, Copy)]
pub struct SmoothSide<'a> {
    /// The surface.
    pub surface: &'a SurfaceSide<'a>,
    /// Its curved edges. `None` if it is flat.
    pub edges: Option<&'a CurvedEdges>,
}

/// A point of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spot {
    /// The triangle.
    pub triangle: u32,
    /// The weights of its corners, which sum to 1.
    pub weights: [f64; 3],
}

/// Two points of two surfaces that are closest to each other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Meeting {
    /// The points.
    pub spots: [Spot; 2],
    /// The points in the frame of the pair.
    pub points: [DVec3; 2],
    /// Unit vector from the first surface to the second.
    pub normal: DVec3,
    /// Their distance in the unit of the frame, negative if the surfaces have passed each other.
    pub distance: f64,
}

/// Which points are allowed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Domain {
    /// Those of the two triangles.
    Triangles,
    /// Also those of the triangles beside them, as far as the surfaces are smooth.
    Surfaces,
}

impl SmoothSide<'_> {
    /// The patch of a triangle.
    #[must_use]
    pub fn patch(&self, triangle: u32) -> Patch {
        let corners = self.surface.corners(triangle);
        let Some(edges) = self.edges else { return Patch { corners, offsets: [DVec3::ZERO; 3] } };
        let offsets = edges.of_triangle(self.surface.topology, triangle).map(|offset| {
            let offset = offset.as_dvec3();
            self.surface
                .moved
                .map_or(offset, |moved| moved.pose.transform_direction(offset) * moved.pose.scale())
        });
        Patch { corners, offsets }
    }

    /// The triangle on the other side of an edge of a triangle, if the surface is smooth there, and the local index of
    /// the edge in that triangle.
    fn beyond(&self, triangle: u32, edge: usize) -> Option<(u32, usize)> {
        let topology = self.surface.topology;
        let number = topology.triangle_edges()[triangle as usize][edge];
        if !self.edges.is_some_and(|edges| edges.is_soft(number)) {
            return None;
        }
        let other = match *topology.triangles_of_edge(EdgeId(number)) {
            [first, second] if first == triangle => second,
            [first, second] if second == triangle => first,
            _ => return None,
        };
        let place = topology.triangle_edges()[other as usize].iter().position(|own| *own == number)?;
        Some((other, place))
    }
}

/// A surface near one of its points, as a height over a plane.
struct Height {
    slope: DVec2,
    curvature: DMat2,
    /// From displacements in the plane to changes of the weights of the second and third corner.
    to_weights: DMat2,
}

/// An orthonormal basis of the plane of a direction.
fn plane_of(direction: DVec3) -> [DVec3; 2] {
    let (first, second) = direction.any_orthonormal_pair();
    [first, second]
}

impl Height {
    /// `None` if the surface is too steep.
    fn new(local: &Local, direction: DVec3, plane: &[DVec3; 2]) -> Option<Self> {
        let flat = |vector: DVec3| DVec2::new(vector.dot(plane[0]), vector.dot(plane[1]));
        let [u, v] = local.tangents;
        let normal = u.cross(v);
        if normal.dot(direction).abs() < LEAST_COSINE * normal.length() || normal == DVec3::ZERO {
            return None;
        }
        let to_weights = DMat2::from_cols(flat(u), flat(v)).inverse();
        if !to_weights.is_finite() {
            return None;
        }
        let transposed = to_weights.transpose();
        let slope = transposed * DVec2::new(u.dot(direction), v.dot(direction));
        // How each second derivative rises beyond the plane that touches the surface.
        let rise = |second: DVec3| second.dot(direction) - slope.dot(flat(second));
        let [uu, uv, vv] = local.seconds.map(rise);
        let curvature = transposed * DMat2::from_cols(DVec2::new(uu, uv), DVec2::new(uv, vv)) * to_weights;
        Some(Self { slope, curvature, to_weights })
    }

    /// The displacement to the point that is closest to a point of the other surface, given the vector to it: `r` and
    /// `d` from this surface. The sign of `d` is that of the height.
    fn foot(&self, apart: DVec2, distance: f64) -> DVec2 {
        let matrix = DMat2::IDENTITY - self.curvature * distance;
        let wanted = apart + self.slope * distance;
        // Beyond the center of curvature there is no closest point nearby.
        let determinant = matrix.determinant();
        if determinant > 0.1 && matrix.x_axis.x > 0.0 { matrix.inverse() * wanted } else { wanted }
    }
}

/// Displacements of both points, see the page.
fn displacements(a: &Height, b: &Height, apart: DVec2, distance: f64, least: f64) -> DVec2 {
    let own = DMat2::IDENTITY - a.curvature * distance;
    let matrix = b.curvature * own - a.curvature;
    let wanted = a.slope - b.slope + b.curvature * (apart + a.slope * distance);
    solve(&matrix, wanted, least)
}

/// Solves a system whose matrix is nearly symmetric, with eigenvalues of at least `least`. Negative ones lead to a
/// point where the surfaces are farthest apart: the solution leads away from it.
fn solve(matrix: &DMat2, wanted: DVec2, least: f64) -> DVec2 {
    let (xx, yy) = (matrix.x_axis.x, matrix.y_axis.y);
    let xy = 0.5 * (matrix.x_axis.y + matrix.y_axis.x);
    let (mean, half) = (0.5 * (xx + yy), 0.5 * (xx - yy));
    let radius = half.hypot(xy);
    if mean - radius >= least {
        return matrix.inverse() * wanted;
    }
    // The eigenvector of the larger eigenvalue.
    let axis = if half >= 0.0 { DVec2::new(half + radius, xy) } else { DVec2::new(xy, radius - half) };
    let axis = axis.try_normalize().unwrap_or(DVec2::X);
    let across = axis.perp();
    axis * (axis.dot(wanted) / (mean + radius).abs().max(least))
        + across * (across.dot(wanted) / (mean - radius).abs().max(least))
}

/// One side of a search.
struct Walker<'a> {
    side: SmoothSide<'a>,
    spot: Spot,
    patch: Patch,
    size: f64,
    /// Whether its last step ended at a crease, at a boundary, or where the domain ends.
    is_held: bool,
}

impl<'a> Walker<'a> {
    fn new(side: SmoothSide<'a>, spot: Spot) -> Self {
        let patch = side.patch(spot.triangle);
        Self { side, spot, patch, size: patch.size(), is_held: false }
    }

    /// The unit normal on the side to which a direction points, unless the surface is too steep for it, or the point is
    /// held where the surface has more than one.
    fn normal_towards(&self, local: &Local, direction: DVec3) -> Option<DVec3> {
        let [u, v] = local.tangents;
        let normal = u.cross(v).normalize_or_zero();
        let along = normal.dot(direction);
        (!self.is_held && along.abs() >= LEAST_COSINE).then(|| normal * along.signum())
    }

    /// Moves the point by a displacement in the plane, at most as far as allowed. Returns how far it moved.
    fn step(&mut self, height: &Height, step: DVec2, domain: Domain, other: &Self) -> DVec2 {
        self.is_held = false;
        let longest = LONGEST_STEP * self.size;
        let step = step.clamp_length_max(longest);
        let change = height.to_weights * step;
        let [a, b, c] = self.spot.weights;
        let next = [a - change.x - change.y, b + change.x, c + change.y];
        if next.iter().all(|weight| *weight >= 0.0) {
            self.spot.weights = next;
            return step;
        }
        if domain == Domain::Surfaces && self.walk_over(&next, other) {
            return step;
        }
        // The closest point of the triangle.
        self.is_held = true;
        let before = self.spot.weights;
        let corners = &self.patch.corners;
        let target = corners[0] * next[0] + corners[1] * next[1] + corners[2] * next[2];
        self.spot.weights = closest_weights(corners, target, &next);
        let moved = DVec2::new(self.spot.weights[1] - before[1], self.spot.weights[2] - before[2]);
        height.to_weights.inverse() * moved
    }

    /// Moves the point over the edge that lies on its way to `next`, which is outside of its triangle.
    fn walk_over(&mut self, next: &[f64; 3], other: &Self) -> bool {
        let now = self.spot.weights;
        let mut first = (f64::INFINITY, 0);
        for corner in 0..3 {
            if next[corner] < 0.0 {
                let along = now[corner].max(0.0) / (now[corner].max(0.0) - next[corner]);
                if along < first.0 {
                    first = (along, corner);
                }
            }
        }
        let (along, corner) = first;
        let edge = (corner + 1) % 3;
        let Some((triangle, other_edge)) = self.side.beyond(self.spot.triangle, edge) else { return false };
        let topologies = [self.side.surface.topology, other.side.surface.topology];
        if std::ptr::eq(topologies[0], topologies[1])
            && share_corner(
                topologies[0].welded_triangles()[triangle as usize],
                topologies[1].welded_triangles()[other.spot.triangle as usize],
            )
        {
            return false;
        }
        let at: [f64; 3] = std::array::from_fn(|k| (now[k] + (next[k] - now[k]) * along).max(0.0));
        let (start, end) = (at[edge], at[(edge + 1) % 3]);
        let sum = start + end;
        let topology = topologies[0];
        let starts = topology.welded_triangles()[self.spot.triangle as usize][edge];
        let mut weights = [0.0; 3];
        let is_same = topology.welded_triangles()[triangle as usize][other_edge] == starts;
        let (from, to) = if is_same { (start, end) } else { (end, start) };
        weights[other_edge] = from / sum;
        weights[(other_edge + 1) % 3] = to / sum;
        if !weights.iter().all(|weight| weight.is_finite()) {
            return false;
        }
        self.spot = Spot { triangle, weights };
        self.patch = self.side.patch(triangle);
        self.size = self.patch.size();
        true
    }
}

/// The weights of the point of a triangle that is closest to a point of its plane, which has the weights `outside`.
fn closest_weights(corners: &[DVec3; 3], target: DVec3, outside: &[f64; 3]) -> [f64; 3] {
    let mut best = ([0.0; 3], f64::INFINITY);
    for edge in 0..3 {
        if outside[(edge + 2) % 3] >= 0.0 {
            continue;
        }
        let (from, to) = (corners[edge], corners[(edge + 1) % 3]);
        let along = ((target - from).dot(to - from) / (to - from).length_squared()).clamp(0.0, 1.0);
        let distance = target.distance_squared(from.lerp(to, along));
        if distance < best.1 {
            let mut weights = [0.0; 3];
            weights[edge] = 1.0 - along;
            weights[(edge + 1) % 3] = along;
            best = (weights, distance);
        }
    }
    if best.1.is_finite() { best.0 } else { barycentric_of(corners, target) }
}

/// The closest points of two surfaces near two given ones. `normal` is a unit vector from the first surface to the
/// second there.
#[must_use]
pub fn closest_on_patches(sides: [SmoothSide<'_>; 2], spots: [Spot; 2], normal: DVec3, domain: Domain) -> Meeting {
    let [mut a, mut b] = [Walker::new(sides[0], spots[0]), Walker::new(sides[1], spots[1])];
    let mut direction = normal;
    let mut first_meeting = None;
    let mut meeting = None;
    for step in 0..=STEPS {
        let locals = [a.patch.local(&a.spot.weights), b.patch.local(&b.spot.weights)];
        let between = locals[1].point - locals[0].point;
        let normals = [a.normal_towards(&locals[0], direction), b.normal_towards(&locals[1], direction)];
        let along = between * between.dot(direction).signum();
        direction = match normals {
            [Some(first), Some(second)] => (first + second).try_normalize(),
            [Some(only), None] | [None, Some(only)] => Some(only),
            [None, None] => along.try_normalize(),
        }
        .unwrap_or(direction);
        let now = finish(&a, &b, &locals, between, direction);
        if step == 0 {
            first_meeting = Some(now);
        }
        meeting = (between.reject_from_normalized(direction).length() <= LARGEST_ERROR * a.size.min(b.size)).then_some(now);
        if step == STEPS {
            break;
        }
        let plane = plane_of(direction);
        let apart = DVec2::new(between.dot(plane[0]), between.dot(plane[1]));
        let distance = between.dot(direction);
        let heights = [Height::new(&locals[0], direction, &plane), Height::new(&locals[1], direction, &plane)];
        let least = LEAST_PARTING / a.size.min(b.size);
        let mut moved = [DVec2::ZERO; 2];
        let before = [a.spot, b.spot];
        match &heights {
            [Some(first), Some(second)] => {
                let wanted = displacements(first, second, apart, distance, least);
                moved[0] = a.step(first, wanted, domain, &b);
                if a.spot.triangle == before[0].triangle {
                    moved[1] = b.step(second, second.foot(moved[0] - apart, -distance), domain, &a);
                }
                if b.spot.triangle == before[1].triangle && a.spot.triangle == before[0].triangle {
                    let back = first.foot(apart + moved[1], distance);
                    a.spot.weights = before[0].weights;
                    moved[0] = a.step(first, back, domain, &b);
                }
            }
            [Some(first), None] => moved[0] = a.step(first, first.foot(apart, distance), domain, &b),
            [None, Some(second)] => moved[1] = b.step(second, second.foot(-apart, -distance), domain, &a),
            [None, None] => break,
        }
        let has_walked = before[0].triangle != a.spot.triangle || before[1].triangle != b.spot.triangle;
        if !has_walked && moved[0].length() <= SHORTEST_STEP * a.size && moved[1].length() <= SHORTEST_STEP * b.size {
            break;
        }
    }
    meeting.or(first_meeting).unwrap_or(Meeting { spots, points: [DVec3::ZERO; 2], normal, distance: f64::INFINITY })
}

fn finish(
    a: &Walker<'_>,
    b: &Walker<'_>,
    locals: &[Local; 2],
    between: DVec3,
    direction: DVec3,
) -> Meeting {
    let along = between.dot(direction);
    let sign = if along < 0.0 { -1.0 } else { 1.0 };
    let length = between.length();
    // Where the points have been found, both are the same. The vector between them has no direction where they nearly
    // coincide.
    let normal = (between * sign + direction * a.size.min(b.size)).try_normalize().unwrap_or(direction);
    Meeting {
        spots: [a.spot, b.spot],
        points: [locals[0].point, locals[1].point],
        normal,
        distance: length * sign,
    }
}
