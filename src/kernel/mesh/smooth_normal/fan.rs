//! The triangles around a vertex in cyclic order, and the smooth normal that they define.

use glam::DVec3;

use super::{CreaseAngle, FLAT, SurfacePlace};
use crate::kernel::mesh::ids::{EdgeId, VertexId};

/// What is across an edge of a triangle.
pub(super) enum Across {
    Nothing,
    /// One triangle, in which the edge has the local index `edge`.
    Triangle {
        triangle: u32,
        edge: usize,
    },
    /// More than one triangle.
    Several,
}

impl SurfacePlace<'_> {
    pub(super) fn across(&self, triangle: u32, edge: usize) -> Across {
        let number = self.topology.triangle_edges()[triangle as usize][edge];
        let mut others =
            self.topology.triangles_of_edge(EdgeId(number)).iter().copied().filter(|other| *other != triangle);
        let (Some(other), None) = (others.next(), others.next()) else {
            return if self.topology.triangles_of_edge(EdgeId(number)).len() > 1 {
                Across::Several
            } else {
                Across::Nothing
            };
        };
        let Some(other_edge) =
            self.topology.triangle_edges()[other as usize].iter().position(|candidate| *candidate == number)
        else {
            return Across::Nothing;
        };
        // Vertices that were welded at equal positions may have moved apart since.
        let (own, theirs) = (self.corners(triangle), self.corners(other));
        let (start, end) = (own[edge], own[(edge + 1) % 3]);
        let (other_start, other_end) = (theirs[other_edge], theirs[(other_edge + 1) % 3]);
        if (start, end) == (other_end, other_start) || (start, end) == (other_start, other_end) {
            Across::Triangle { triangle: other, edge: other_edge }
        } else {
            Across::Nothing
        }
    }

    /// The unit vector in a triangle's plane that points away from it, perpendicular to one of its edges. Zero if it
    /// has no area.
    pub(super) fn beyond(&self, triangle: u32, edge: usize) -> DVec3 {
        let corners = self.corners(triangle);
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero();
        (corners[(edge + 1) % 3] - corners[edge]).normalize_or_zero().cross(normal).normalize_or_zero()
    }
}

pub(super) struct FanFace {
    triangle: u32,
    /// Unit normal on the side to which the first triangle's normal points.
    pub(super) normal: DVec3,
    /// Its weight at the fan's vertex.
    weight: f64,
    circumradius: f64,
}

/// The triangles around a vertex in cyclic order, joined by edges with two triangles.
pub(super) struct Fan {
    /// The triangles that have an area.
    pub(super) faces: Vec<FanFace>,
    /// How smooth the step from each face to the next is. In a closed fan, the last entry is the step from the last
    /// face to the first.
    links: Vec<f64>,
    closed: bool,
    /// Directions away from the surface at both ends of an open fan. `None` if the end is an edge with more than two
    /// triangles.
    pub(super) ends: [Option<DVec3>; 2],
}

/// The current position of a walk around a vertex.
#[derive(Clone, Copy)]
struct Step {
    triangle: u32,
    /// The corner of the triangle at the vertex.
    corner: usize,
    /// The edge to cross next.
    edge: usize,
    /// Whether the triangle has the same winding as the first one.
    alike: bool,
}

impl Fan {
    pub(super) fn around(place: &SurfacePlace<'_>, corner: usize, crease: CreaseAngle) -> Self {
        let own = place.triangle;
        let vertex = place.topology.welded_triangles()[own as usize][corner];
        let start = |edge: usize| Step { triangle: own, corner, edge, alike: true };
        let mut fan = Self { faces: Vec::with_capacity(8), links: Vec::new(), closed: false, ends: [None; 2] };
        // Backward first, so that the faces are in cyclic order.
        let end = walk(place, vertex, start(corner), |step| fan.push(place, step));
        fan.faces.reverse();
        fan.push(place, start(corner));
        if let End::Closed = end {
            fan.closed = true;
        } else {
            let other_end = walk(place, vertex, start((corner + 2) % 3), |step| fan.push(place, step));
            fan.ends = [end.away(), other_end.away()];
        }
        let pairs = fan.faces.windows(2).map(|pair| crease.softness(pair[0].normal, pair[1].normal));
        fan.links = pairs.collect();
        if let (true, [first, .., last]) = (fan.closed, &fan.faces[..]) {
            fan.links.push(crease.softness(last.normal, first.normal));
        }
        fan
    }

    fn push(&mut self, place: &SurfacePlace<'_>, step: Step) {
        let corners = place.corners(step.triangle);
        let [at, next, previous] = [0, 1, 2].map(|k| corners[(step.corner + k) % 3]);
        let (u, v) = (next - at, previous - at);
        let cross = u.cross(v);
        let doubled_area = cross.length();
        let Some(normal) = cross.try_normalize() else { return };
        // The sine of the angle over the lengths of its two sides.
        let weight = doubled_area / (u.length_squared() * v.length_squared());
        let circumradius = u.length() * v.length() * (u - v).length() / (2.0 * doubled_area);
        if weight.is_finite() && circumradius.is_finite() && circumradius > 0.0 {
            let normal = if step.alike { normal } else { -normal };
            self.faces.push(FanFace { triangle: step.triangle, normal, weight, circumradius });
        }
    }

    pub(super) fn manifold(&self) -> bool {
        !self.faces.is_empty() && (self.closed || self.ends.iter().all(Option::is_some))
    }

    pub(super) fn is_smooth(&self) -> bool {
        self.links.iter().all(|link| *link >= 1.0)
    }

    pub(super) fn place_of(&self, triangle: u32) -> Option<usize> {
        self.faces.iter().position(|face| face.triangle == triangle)
    }

    /// The smooth normal of one of the faces at the vertex, and the curvature there. Faces across a crease do not
    /// contribute.
    pub(super) fn corner_normal(&self, own: usize) -> Option<(DVec3, f64)> {
        if self.is_smooth() {
            return self.mean_normal(|_| 1.0);
        }
        let count = self.faces.len();
        let mut shares = vec![0.0; count];
        shares[own] = 1.0;
        for forward in [true, false] {
            let mut share = 1.0;
            let mut at = own;
            for _ in 1..count {
                let link = if forward { at } else { (at + count - 1) % count };
                let Some(softness) = self.links.get(link) else { break };
                share *= softness;
                at = if forward { (at + 1) % count } else { link };
                shares[at] = f64::max(shares[at], share);
            }
        }
        self.mean_normal(|face| shares[face])
    }

    /// The mean of the normals, each multiplied by its share, and how far the faces bend away from it.
    fn mean_normal(&self, share: impl Fn(usize) -> f64) -> Option<(DVec3, f64)> {
        let faces = || self.faces.iter().enumerate().map(|(place, face)| (face, share(place)));
        let normal = faces().map(|(face, share)| face.normal * (face.weight * share)).sum::<DVec3>().try_normalize()?;
        // On a sphere: the angle between the normals of vertex and face, over the distance from the vertex to the
        // circumcenter.
        let curvature = faces()
            .map(|(face, share)| share * (face.normal.distance(normal) - FLAT).max(0.0) / face.circumradius)
            .fold(0.0, f64::max);
        Some((normal, curvature))
    }
}

/// How a walk around a vertex ends.
enum End {
    /// At its start.
    Closed,
    /// At a border, with the direction away from the surface.
    Border(DVec3),
    /// At an edge with more than two triangles.
    Several,
}

impl End {
    fn away(self) -> Option<DVec3> {
        match self {
            Self::Border(direction) => Some(direction),
            Self::Closed | Self::Several => None,
        }
    }
}

/// Visits the triangles around a welded vertex after `start`, in walking order.
fn walk(place: &SurfacePlace<'_>, vertex: u32, start: Step, mut visit: impl FnMut(Step)) -> End {
    let topology = place.topology;
    let mut at = start;
    // Triangles that name a vertex twice may form a cycle that does not lead back to the start.
    for _ in 0..=topology.triangles_of_vertex(VertexId(vertex)).len() {
        let (triangle, edge) = match place.across(at.triangle, at.edge) {
            Across::Triangle { triangle, edge } => (triangle, edge),
            Across::Nothing => return End::Border(place.beyond(at.triangle, at.edge)),
            Across::Several => return End::Several,
        };
        if triangle == start.triangle {
            return End::Closed;
        }
        let starts_there = topology.welded_triangles()[triangle as usize][edge] == vertex;
        let corner = if starts_there { edge } else { (edge + 1) % 3 };
        let alike = at.alike != (starts_there == (at.edge == at.corner));
        at = Step { triangle, corner, edge: if starts_there { (corner + 2) % 3 } else { corner }, alike };
        visit(at);
    }
    End::Several
}
