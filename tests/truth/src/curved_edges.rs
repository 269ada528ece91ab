//! The curved edges of a smooth surface, in f64 and straight from their definition.
//!
//! A patch over a triangle is `Σ w_k p_k + Σ w_i w_j c_ij`, where the *offset* `c_ij` belongs to the edge. Everything
//! is looked up in a table of directed edges for each corner and each edge on its own.

use std::collections::{BTreeMap, HashMap};

use glam::{DMat3, DVec3};

/// The largest distance of a patch from its triangle, relative to the least height of the triangle.
pub const PATCH_GUARD: f64 = 0.15;

/// If all offsets of a triangle are equal, the patch is at most a third of them away from it: the largest value of
/// `Σ w_i w_j`.
const SHARE_OF_OFFSET: f64 = 1.0 / 3.0;

/// The damping of the least squares problem at a crease.
const DAMPING: f64 = 1.0e-3;

/// A mesh whose vertices lie on a smooth body.
#[derive(Clone, Debug)]
pub struct CurvedMesh<'a> {
    positions: &'a [DVec3],
    triangles: &'a [[u32; 3]],
    welded: Vec<[u32; 3]>,
    /// The triangles that traverse an edge from its first to its second welded vertex.
    directed: HashMap<[u32; 2], Vec<usize>>,
    /// Unit normals. Zero for triangles without area.
    normals: Vec<DVec3>,
    /// Squared distances of two unit normals, at half the crease angle and at the crease angle.
    fade: [f64; 2],
}

impl<'a> CurvedMesh<'a> {
    /// A mesh at its current positions. `weld` names each vertex by the first one that it is welded to
    /// ([`exact_weld`](crate::exact_weld) of the positions at which the topology was built). `crease` is the angle in
    /// radians from which an edge is a crease.
    #[must_use]
    pub fn new(positions: &'a [DVec3], triangles: &'a [[u32; 3]], weld: &[u32], crease: f64) -> Self {
        let welded: Vec<[u32; 3]> = triangles.iter().map(|corners| corners.map(|own| weld[own as usize])).collect();
        let mut directed: HashMap<[u32; 2], Vec<usize>> = HashMap::new();
        for (triangle, corners) in welded.iter().enumerate() {
            for k in 0..3 {
                directed.entry([corners[k], corners[(k + 1) % 3]]).or_default().push(triangle);
            }
        }
        let normal = |corners: &[u32; 3]| {
            let [a, b, c] = corners.map(|vertex| positions[vertex as usize]);
            (b - a).cross(c - a).normalize_or_zero()
        };
        let fade = [0.5 * crease, crease].map(|angle| (2.0 * (0.5 * angle).sin()).powi(2));
        Self { positions, triangles, normals: triangles.iter().map(normal).collect(), welded, directed, fade }
    }

    /// The normals at the corners of each triangle: the sum of the normals of the faces around the vertex, each times
    /// the sine of its angle over the product of the two sides (Max 1999), of unit length. A face counts by the product
    /// of the softnesses of the edges on the softest way to it around the vertex, so not at all beyond a crease,
    /// beyond an edge that does not join exactly two triangles in opposite directions, or beyond one that joins
    /// triangles that name a vertex twice. All faces around the vertex count, however many. Zero if the sum is.
    #[must_use]
    pub fn corner_normals(&self) -> Vec<[DVec3; 3]> {
        (0..self.triangles.len()).map(|triangle| [0, 1, 2].map(|corner| self.corner_normal(triangle, corner))).collect()
    }

    /// The offset of each edge, by its two welded vertices, the lower one first.
    ///
    /// Each side of an edge has the offset `½ [((p_i − p_j)·n_i) n_i + ((p_j − p_i)·n_j) n_j]` by the normals of its own
    /// corners, and the edge has their mean. At a crease, it is the shortest vector that rises over both sides like
    /// their own offsets. In between, the two are blended. A boundary has one side. The offset fades where corner
    /// normals disagree with the face like those of two faces at a crease, and is shortened so that it moves no point
    /// by more than [`PATCH_GUARD`] times the least height of the triangles beside it.
    ///
    /// It is zero at any other number of triangles, beside triangles that do not fit together, name a vertex twice, or
    /// have no area, and where welded vertices at an end have moved apart.
    #[must_use]
    pub fn offsets(&self) -> BTreeMap<[u32; 2], DVec3> {
        let normals = self.corner_normals();
        self.directed.keys().map(|&[a, b]| ([a.min(b), a.max(b)], self.offset([a, b], &normals))).collect()
    }

    fn is_collapsed(&self, triangle: usize) -> bool {
        let [a, b, c] = self.welded[triangle];
        a == b || b == c || c == a
    }

    fn corner_of(&self, triangle: usize, vertex: u32) -> usize {
        self.welded[triangle].iter().position(|&own| own == vertex).expect("the triangle is at the vertex")
    }

    /// The points of a triangle, starting at a corner.
    fn points_from(&self, triangle: usize, corner: usize) -> [DVec3; 3] {
        [0, 1, 2].map(|k| self.positions[self.triangles[triangle][(corner + k) % 3] as usize])
    }

    /// The only two triangles of an edge: the one that traverses it in this direction, and the one that traverses it in
    /// the opposite direction.
    fn joined(&self, [from, to]: [u32; 2]) -> Option<[usize; 2]> {
        let only = |edge| match self.directed.get(&edge).map(Vec::as_slice) {
            Some(&[triangle]) if !self.is_collapsed(triangle) => Some(triangle),
            _ => None,
        };
        Some([only([from, to])?, only([to, from])?])
    }

    /// 1 for faces of one curved surface, 0 across a crease, and the cubic Hermite curve in between.
    fn softness(&self, one: DVec3, other: DVec3) -> f64 {
        let [from, to] = self.fade;
        let t = ((one.distance_squared(other) - from) / (to - from)).clamp(0.0, 1.0);
        1.0 - t * t * (3.0 - 2.0 * t)
    }

    fn corner_normal(&self, triangle: usize, corner: usize) -> DVec3 {
        let vertex = self.welded[triangle][corner];
        let mut shares = BTreeMap::from([(triangle, 1.0)]);
        for forward in [true, false] {
            let (mut at, mut share) = (triangle, 1.0);
            loop {
                let (corners, corner) = (self.welded[at], self.corner_of(at, vertex));
                let edge =
                    if forward { [corners[(corner + 2) % 3], vertex] } else { [vertex, corners[(corner + 1) % 3]] };
                let Some([_, next]) = self.joined(edge) else { break };
                if next == triangle {
                    break;
                }
                share *= self.softness(self.normals[at], self.normals[next]);
                let best = shares.entry(next).or_insert(0.0);
                *best = f64::max(*best, share);
                at = next;
            }
        }
        let weighted = |(&triangle, &share): (&usize, &f64)| {
            if self.normals[triangle] == DVec3::ZERO {
                return DVec3::ZERO;
            }
            // A triangle that names a vertex twice is alone at it.
            let corner = if shares.len() == 1 { corner } else { self.corner_of(triangle, vertex) };
            let [at, next, previous] = self.points_from(triangle, corner);
            let (u, v) = (next - at, previous - at);
            self.normals[triangle] * (share * u.cross(v).length() / (u.length_squared() * v.length_squared()))
        };
        shares.iter().map(weighted).sum::<DVec3>().normalize_or_zero()
    }

    fn offset(&self, edge: [u32; 2], normals: &[[DVec3; 3]]) -> DVec3 {
        let [a, b] = edge;
        let traversals: Vec<([u32; 2], usize)> = [[a, b], [b, a]]
            .into_iter()
            .flat_map(|way| self.directed.get(&way).into_iter().flatten().map(move |&triangle| (way, triangle)))
            .collect();
        let sides = match *traversals {
            [(_, only)] if !self.is_collapsed(only) => [only, only],
            [_, _] => {
                let Some(sides) = self.joined(edge) else { return DVec3::ZERO };
                sides
            }
            _ => return DVec3::ZERO,
        };
        let ends = sides
            .map(|side| edge.map(|vertex| self.positions[self.triangles[side][self.corner_of(side, vertex)] as usize]));
        if ends[0] != ends[1] || sides.iter().any(|&side| self.normals[side] == DVec3::ZERO) {
            return DVec3::ZERO;
        }
        let along = ends[0][1] - ends[0][0];
        let [one, other] = sides.map(|side| {
            let [start, end] = edge.map(|vertex| normals[side][self.corner_of(side, vertex)]);
            let face = self.normals[side];
            Side {
                offset: (start * (-along).dot(start) + end * along.dot(end)) * 0.5,
                normal: (start + end).normalize_or_zero(),
                fits: self.softness(start, face) * self.softness(end, face),
            }
        });
        let soft = self.softness(self.normals[sides[0]], self.normals[sides[1]]);
        let smooth = (one.offset + other.offset) * 0.5;
        let offset = (smooth * soft + crease_offset(&one, &other) * (1.0 - soft)) * one.fits.min(other.fits);
        let height = sides.map(|side| self.least_height(side)).into_iter().fold(f64::INFINITY, f64::min);
        offset.clamp_length_max(height * PATCH_GUARD / SHARE_OF_OFFSET)
    }

    fn least_height(&self, triangle: usize) -> f64 {
        let [a, b, c] = self.points_from(triangle, 0);
        let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
        (b - a).cross(c - a).length() / longest
    }
}

/// An edge by one of its triangles.
struct Side {
    offset: DVec3,
    /// The mean of the normals at both ends, of unit length.
    normal: DVec3,
    /// How well the corner normals agree with the face, from 1 to 0.
    fits: f64,
}

/// The vector `c` that minimizes `Σ (n_s·c − n_s·c_s)² + damping |c|²` over both sides `s`.
fn crease_offset(one: &Side, other: &Side) -> DVec3 {
    let mut matrix = DMat3::from_diagonal(DVec3::splat(DAMPING));
    let mut right = DVec3::ZERO;
    for Side { offset, normal, .. } in [one, other] {
        matrix += DMat3::from_cols(*normal * normal.x, *normal * normal.y, *normal * normal.z);
        right += *normal * normal.dot(*offset);
    }
    matrix.inverse() * right
}

#[cfg(test)]
mod tests {
    use circumsphere_support::scenes::{Mesh, cuboid, icosphere};

    use super::*;
    use crate::exact_weld;

    fn points(mesh: &Mesh) -> Vec<DVec3> {
        mesh.positions.iter().map(|position| DVec3::from(position.map(f64::from))).collect()
    }

    #[test]
    fn the_edges_of_a_sphere_bend_toward_the_radial_normals() {
        let mesh = icosphere(2, 1.0);
        let positions: Vec<DVec3> = points(&mesh).iter().map(|point| point.normalize() * 2.0).collect();
        let weld = exact_weld(&positions);
        let curved = CurvedMesh::new(&positions, &mesh.triangles, &weld, 1.0);
        for (corners, normals) in mesh.triangles.iter().zip(curved.corner_normals()) {
            for (vertex, normal) in corners.iter().zip(normals) {
                assert!(normal.distance(positions[*vertex as usize] * 0.5) < 1.0e-12);
            }
        }
        let offsets = curved.offsets();
        assert_eq!(offsets.len(), 480);
        for ([a, b], offset) in offsets {
            let (a, b) = (positions[a as usize], positions[b as usize]);
            // The rise of one end over the tangent plane at the other is |a − b|² / (2 R).
            let expected = (a + b) * (a.distance_squared(b) / 16.0);
            assert!(offset.distance(expected) < 1.0e-12, "{offset} {expected}");
        }
    }

    #[test]
    fn the_edges_of_a_box_are_straight() {
        let mesh = cuboid([1.0, 2.0, 0.5], 1);
        let positions = points(&mesh);
        let weld = exact_weld(&positions);
        let straight = |crease| {
            let offsets = CurvedMesh::new(&positions, &mesh.triangles, &weld, crease).offsets();
            offsets.values().all(|offset| *offset == DVec3::ZERO)
        };
        assert!(straight(1.0));
        // Without creases it is a round body.
        assert!(!straight(3.0));
    }

    #[test]
    fn a_right_angle_between_two_curved_surfaces_rises_over_both() {
        let side = |normal: DVec3, rise: f64| Side { offset: normal * rise, normal, fits: 1.0 };
        let offset = crease_offset(&side(DVec3::X, 0.2), &side(DVec3::Y, -0.1));
        assert!(offset.distance(DVec3::new(0.2, -0.1, 0.0)) < 2.0 * DAMPING * 0.2, "{offset}");
    }
}
