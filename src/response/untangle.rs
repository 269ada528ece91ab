//! How crossing surfaces separate if it is not known which side each was on.
//!
//! The intersection contour of two sheets cuts a part off one or both of them. The smaller part has passed through: it
//! moves back as a whole, against the faces that its edges pierce (parts by flood fill: Baraff, Witkin and Kass 2003,
//! "Untangling Cloth").
//!
//! If the contour ends in the middle of both sheets, it cuts nothing off and is shortened instead. It ends, or
//! continues into other triangles, at points where an edge pierces a face. If the edge moves by `D` against the face,
//! such a point moves by `D − E (D·N)/(E·N)`, with `E` along the edge and `N` the normal of the face. In each triangle
//! next to the edge the contour leaves the point along `R`, and shortens by the component of that motion along `R`. So
//! a motion `D` along the sum of `R − N (E·R)/(E·N)` shortens it fastest (idea: Volino and Magnenat-Thalmann 2006,
//! "Resolving Surface Collisions through Intersection Contour Minimization").

use bevy_platform::collections::HashSet;
use glam::DVec3;

use crate::kernel::mesh::topology::SurfaceTopology;

/// If the sine of the angle between an edge and a face is smaller, the edge runs along the face and does not count as
/// piercing it.
const GRAZING_SINE: f64 = 1.0e-3;

/// A cut-off part moves back only if the mean of the directions of its edges has at least this length, of 1.
const AGREEMENT: f64 = 0.2;

/// An edge of a surface that pierces a face of another surface.
#[derive(Clone, Copy, Debug)]
pub struct PiercingEdge {
    /// Edge index in the topology.
    pub edge: u32,
    /// Its two welded vertices.
    pub vertices: [u32; 2],
    /// From the first vertex to the second.
    pub along: DVec3,
    /// Unit normal of the face, with either sign.
    pub normal: DVec3,
}

impl PiercingEdge {
    /// Edge `side` of a triangle whose corners are at `points`.
    pub(super) fn new(
        topology: &SurfaceTopology,
        triangle: u32,
        side: u8,
        points: [DVec3; 3],
        normal: impl FnOnce(DVec3) -> DVec3,
    ) -> Self {
        let ends = [side as usize, (side as usize + 1) % 3];
        let along = points[ends[1]] - points[ends[0]];
        Self {
            edge: topology.triangle_edges()[triangle as usize][side as usize],
            vertices: ends.map(|end| topology.welded_triangles()[triangle as usize][end]),
            along,
            normal: normal(along),
        }
    }
}

/// A part of a surface that another surface cuts off.
#[derive(Clone, Debug)]
pub struct CutOff {
    /// Its welded vertices.
    pub vertices: Vec<u32>,
    /// Share of the surface's vertices that it has.
    pub share: f64,
    /// Unit vector along which it moves back.
    pub back: DVec3,
}

/// The smaller part of a surface that its piercing edges cut off. `edges` are the welded edges of the surface. `None`
/// if the piercing edges cut nothing off, or disagree about the direction.
#[must_use]
pub fn cut_off(vertex_count: usize, edges: &[[u32; 2]], piercing: &[PiercingEdge]) -> Option<CutOff> {
    let cut: HashSet<u32> = piercing.iter().map(|piercing| piercing.edge).collect();
    let mut parts = Parts::new(vertex_count);
    for (number, &[a, b]) in (0..).zip(edges) {
        if !cut.contains(&number) {
            parts.join(a, b);
        }
    }
    let mut smaller = HashSet::new();
    let mut back = DVec3::ZERO;
    for piercing in piercing {
        let [a, b] = piercing.vertices.map(|vertex| parts.of(vertex));
        if a == b {
            continue;
        }
        let is_first = parts.size[a as usize] < parts.size[b as usize];
        smaller.insert(if is_first { a } else { b });
        let along = if is_first { piercing.along } else { -piercing.along };
        back += piercing.normal * piercing.normal.dot(along).signum();
    }
    if back.length() < AGREEMENT * piercing.len() as f64 {
        return None;
    }
    let vertices: Vec<u32> = (0..vertex_count as u32).filter(|&vertex| smaller.contains(&parts.of(vertex))).collect();
    let share = vertices.len() as f64 / vertex_count as f64;
    (!vertices.is_empty()).then_some(CutOff { vertices, share, back: back.normalize() })
}

/// Union-find over vertices.
struct Parts {
    parent: Vec<u32>,
    size: Vec<u32>,
}

impl Parts {
    fn new(count: usize) -> Self {
        Self { parent: (0..count as u32).collect(), size: vec![1; count] }
    }

    /// The representative vertex of a part.
    fn of(&mut self, mut vertex: u32) -> u32 {
        while self.parent[vertex as usize] != vertex {
            let above = self.parent[self.parent[vertex as usize] as usize];
            self.parent[vertex as usize] = above;
            vertex = above;
        }
        vertex
    }

    fn join(&mut self, a: u32, b: u32) {
        let (mut large, mut small) = (self.of(a), self.of(b));
        if large == small {
            return;
        }
        if self.size[large as usize] < self.size[small as usize] {
            std::mem::swap(&mut large, &mut small);
        }
        self.parent[small as usize] = large;
        self.size[large as usize] += self.size[small as usize];
    }
}

/// The unit direction in which to move an edge against a face that it pierces. `beside` are the third corners of the
/// triangles along the edge. `None` if no motion shortens the contour or the edge grazes the face.
#[must_use]
pub fn untangling_direction(edge: [DVec3; 2], face: &[DVec3; 3], beside: impl Iterator<Item = DVec3>) -> Option<DVec3> {
    let along = (edge[1] - edge[0]).try_normalize()?;
    let normal = (face[1] - face[0]).cross(face[2] - face[0]).try_normalize()?;
    let steepness = along.dot(normal);
    if steepness.abs() < GRAZING_SINE {
        return None;
    }
    let gradient: DVec3 = beside
        .filter_map(|apex| {
            let inward = apex - edge[0];
            let inward = inward - along * inward.dot(along);
            let curve = normal.cross(along.cross(inward)).try_normalize()?;
            let curve = if curve.dot(inward) < 0.0 { -curve } else { curve };
            Some(curve - normal * (along.dot(curve) / steepness))
        })
        .sum();
    gradient.try_normalize()
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    /// Length of the intersection line of two triangles, computed from the points where edges of each pierce the other.
    fn curve_length(a: &[DVec3; 3], b: &[DVec3; 3]) -> f64 {
        let mut points = Vec::new();
        for (own, other) in [(a, b), (b, a)] {
            let normal = (other[1] - other[0]).cross(other[2] - other[0]);
            for edge in 0..3 {
                let (start, end) = (own[edge], own[(edge + 1) % 3]);
                let (from, to) = ((start - other[0]).dot(normal), (end - other[0]).dot(normal));
                if from * to >= 0.0 {
                    continue;
                }
                let point = start + (end - start) * (from / (from - to));
                let is_inside =
                    (0..3).all(|k| (other[(k + 1) % 3] - other[k]).cross(point - other[k]).dot(normal) > 0.0);
                if is_inside {
                    points.push(point);
                }
            }
        }
        if let [first, second] = points[..] { first.distance(second) } else { 0.0 }
    }

    #[test]
    fn the_direction_shortens_the_curve_fastest() {
        let face = [DVec3::new(-3.0, 0.0, -2.0), DVec3::new(-1.0, 0.1, 4.0), DVec3::new(4.0, -0.2, -1.0)];
        // Two edges pierce the face, from the same corner. The other two corners are on the same side.
        let triangle = [DVec3::new(0.1, -0.8, 0.2), DVec3::new(-0.3, 1.1, 0.4), DVec3::new(2.5, 1.3, 0.9)];
        let moved = |by: DVec3| curve_length(&triangle.map(|corner| corner + by), &face);
        let length = moved(DVec3::ZERO);
        assert!(length > 0.1);
        let nudge = 1e-6;
        let slope = |direction: DVec3| (moved(direction * nudge) - moved(direction * -nudge)) / (2.0 * nudge);
        let directions = [[0, 1, 2], [2, 0, 1]].map(|[from, to, apex]| {
            untangling_direction([triangle[from], triangle[to]], &face, std::iter::once(triangle[apex])).unwrap()
        });
        // Two edges pierce the face, so the slope of the length is the sum over both ends.
        let steepest = -DVec3::new(slope(DVec3::X), slope(DVec3::Y), slope(DVec3::Z));
        let of_ends = |weights: [f64; 2]| directions[0] * weights[0] + directions[1] * weights[1];
        assert!(slope(directions[0] + directions[1]) < -0.5);
        // The steepest descent is a positive combination of the directions of both ends. Least squares must leave no
        // residual.
        let [a, b] = directions;
        let (aa, ab, bb) = (a.dot(a), a.dot(b), b.dot(b));
        let (at, bt) = (a.dot(steepest), b.dot(steepest));
        let determinant = aa * bb - ab * ab;
        let weights = [(at * bb - bt * ab) / determinant, (bt * aa - at * ab) / determinant];
        assert!(weights.iter().all(|&weight| weight > 0.0), "{weights:?}");
        assert!((of_ends(weights) - steepest).length() < 1e-5, "{steepest} {directions:?}");
    }

    /// A row of four squares along x with two triangles each, and the edges that the plane at `x` cuts.
    fn row(x: f64) -> (SurfaceTopology, Vec<PiercingEdge>) {
        let corners: Vec<Vec3> = (0..10).map(|place| Vec3::new((place / 2) as f32, 0.0, (place % 2) as f32)).collect();
        let triangles: Vec<[u32; 3]> =
            (0..4).flat_map(|k| [[2 * k, 2 * k + 1, 2 * k + 2], [2 * k + 1, 2 * k + 3, 2 * k + 2]]).collect();
        let topology = SurfaceTopology::new(&corners, &triangles).unwrap();
        let at = |vertex: u32| corners[vertex as usize].as_dvec3();
        let piercing = (0..)
            .zip(topology.edges())
            .filter(|(_, [a, b])| (at(*a).x - x) * (at(*b).x - x) < 0.0)
            .map(|(edge, &[a, b])| PiercingEdge { edge, vertices: [a, b], along: at(b) - at(a), normal: DVec3::NEG_X })
            .collect();
        (topology, piercing)
    }

    #[test]
    fn the_shorter_end_of_a_row_is_cut_off_and_goes_back_to_the_longer() {
        for (x, expected, back) in [(0.5, vec![0, 1], DVec3::X), (2.7, vec![6, 7, 8, 9], DVec3::NEG_X)] {
            let (topology, piercing) = row(x);
            let part = cut_off(topology.vertex_count(), topology.edges(), &piercing).unwrap();
            assert_eq!(part.vertices, expected);
            assert_eq!(part.back, back);
            assert!((part.share - expected.len() as f64 / 10.0).abs() < 1e-12);
            // With one edge left uncut, nothing is cut off.
            assert!(cut_off(topology.vertex_count(), topology.edges(), &piercing[1..]).is_none());
        }
    }

    #[test]
    fn an_edge_along_the_face_has_no_direction() {
        let face = [DVec3::ZERO, DVec3::X, DVec3::Z];
        assert_eq!(untangling_direction([DVec3::ZERO, DVec3::X], &face, std::iter::once(DVec3::Y)), None);
    }
}
