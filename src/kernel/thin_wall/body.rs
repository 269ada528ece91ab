//! The mesh whose walls are looked for: welded, in `f64`, with normals, adjacency, and a tree to search.

use glam::{DVec3, Vec3};

use crate::kernel::{
    bvh::tree::{BoxTree, Sweep},
    mesh::{
        bounds::{Aabb, triangle_bounds},
        ids::EdgeId,
        side::{closest_feature, face_normal},
        topology::SurfaceTopology,
        validation::TopologyError,
    },
};

/// A triangle lower than this many roundings of the largest coordinate has a normal of rounding errors. It takes that
/// of its neighbor.
const SLIVER_ROUNDINGS: f64 = 16.0;

/// Distances below this share of the size of the mesh are 0: rounded positions differ by less.
const ROUNDING_SHARE: f64 = 1.0e-6;

/// Marks a triangle that duplicates none.
pub(super) const NO_TRIANGLE: u32 = u32::MAX;

/// Triangles and a tree over them.
pub(super) struct Facets {
    pub(super) corners: Vec<[DVec3; 3]>,
    tree: BoxTree,
}

impl Facets {
    pub(super) fn new(corners: Vec<[DVec3; 3]>) -> Self {
        // Rounded to f32 and grown by that rounding, a box still contains its triangle.
        let positions: Vec<Vec3> = corners.iter().flatten().map(|corner| corner.as_vec3()).collect();
        let triangles: Vec<[u32; 3]> =
            (0..corners.len() as u32).map(|first| [3 * first, 3 * first + 1, 3 * first + 2]).collect();
        let mut bounds: Vec<Aabb> = Vec::new();
        triangle_bounds(&positions, &triangles, 0.0, &mut bounds);
        Self { corners, tree: BoxTree::new(&bounds) }
    }

    /// The triangle with the closest point to `point` within `range`, and that point, among those for which `accept`
    /// holds. It is asked with the triangle and its closest point.
    pub(super) fn closest(
        &self,
        point: DVec3,
        range: f64,
        mut accept: impl FnMut(u32, DVec3) -> bool,
    ) -> Option<(u32, DVec3)> {
        let mut best = None;
        let mut nearest = range * range;
        self.tree.nearest(point, range, |triangle| {
            let (_, closest) = closest_feature(&self.corners[triangle as usize], point);
            let squared = closest.distance_squared(point);
            // Ties go to the lower number, so that the order of the tree does not matter.
            let is_better = squared < nearest || (squared == nearest && best.is_none_or(|(other, _)| triangle < other));
            if !(is_better && accept(triangle, closest)) {
                return None;
            }
            best = Some((triangle, closest));
            nearest = squared;
            Some(squared.sqrt())
        });
        best
    }

    /// Whether the open segment between two points, without a thousandth at either end, meets a triangle.
    pub(super) fn blocks(&self, from: DVec3, to: DVec3) -> bool {
        const END: f64 = 1.0e-3;
        let direction = to - from;
        if direction == DVec3::ZERO {
            return false;
        }
        let mut is_blocked = false;
        let sweep = Sweep { origin: from, direction, half_extents: DVec3::ZERO };
        self.tree.cast(&sweep, 1.0, |triangle| {
            let along = ray_meets(&self.corners[triangle as usize], from, direction)?;
            is_blocked |= along > END && along < 1.0 - END;
            is_blocked.then_some(0.0)
        });
        is_blocked
    }

    /// The distance from `from` to the first triangle in a unit direction, if it is within `range`.
    pub(super) fn first_hit(&self, from: DVec3, direction: DVec3, range: f64) -> Option<f64> {
        let mut first = None;
        let sweep = Sweep { origin: from, direction, half_extents: DVec3::ZERO };
        self.tree.cast(&sweep, range, |triangle| {
            let along = ray_meets(&self.corners[triangle as usize], from, direction)?;
            let is_first = (0.0..=first.unwrap_or(range)).contains(&along);
            first = if is_first { Some(along) } else { first };
            is_first.then_some(along)
        });
        first
    }
}

/// Where a line meets a triangle, in lengths of its direction (Möller and Trumbore 1997).
fn ray_meets(corners: &[DVec3; 3], origin: DVec3, direction: DVec3) -> Option<f64> {
    let (u, v) = (corners[1] - corners[0], corners[2] - corners[0]);
    let across = direction.cross(v);
    let determinant = u.dot(across);
    if determinant == 0.0 {
        return None;
    }
    let offset = origin - corners[0];
    let first = offset.dot(across) / determinant;
    let turned = offset.cross(u);
    let second = direction.dot(turned) / determinant;
    let is_inside = first >= 0.0 && second >= 0.0 && first + second <= 1.0;
    is_inside.then(|| v.dot(turned) / determinant)
}

/// A mesh to look for walls in.
pub(super) struct Body {
    pub(super) topology: SurfaceTopology,
    pub(super) points: Vec<DVec3>,
    pub(super) facets: Facets,
    /// Unit normals. Zero where a triangle and all around it have no area.
    pub(super) normals: Vec<DVec3>,
    pub(super) areas: Vec<f64>,
    /// The earlier triangle with the same three vertices, or [`NO_TRIANGLE`].
    pub(super) duplicate_of: Vec<u32>,
    /// Lengths below this are 0.
    pub(super) rounding: f64,
}

impl Body {
    pub(super) fn new(positions: &[Vec3], triangles: &[[u32; 3]]) -> Result<Self, TopologyError> {
        let topology = SurfaceTopology::new(positions, triangles)?;
        let points: Vec<DVec3> = positions.iter().map(|position| position.as_dvec3()).collect();
        let corners: Vec<[DVec3; 3]> =
            triangles.iter().map(|corners| corners.map(|corner| points[corner as usize])).collect();
        let areas = corners.iter().map(|[a, b, c]| 0.5 * (b - a).cross(c - a).length()).collect();
        let largest = points.iter().map(|point| point.abs().max_element()).fold(0.0, f64::max);
        let (min, max) = corners
            .iter()
            .flatten()
            .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(min, max), &corner| (min.min(corner), max.max(corner)));
        let rounding = (ROUNDING_SHARE * (max - min).length()).max(largest * f64::from(f32::EPSILON));
        let mut body = Self {
            duplicate_of: duplicates(topology.welded_triangles()),
            normals: corners.iter().map(face_normal).collect(),
            facets: Facets::new(corners),
            topology,
            points,
            areas,
            rounding,
        };
        body.repair_normals(SLIVER_ROUNDINGS * largest * f64::from(f32::EPSILON));
        Ok(body)
    }

    pub(super) fn triangle_count(&self) -> usize {
        self.areas.len()
    }

    /// The welded vertices of a triangle.
    pub(super) fn vertices(&self, triangle: usize) -> [usize; 3] {
        self.topology.welded_triangles()[triangle].map(|vertex| vertex as usize)
    }

    /// The one other triangle at edge `edge` of a triangle. `None` at borders and at edges of three triangles or more.
    /// Duplicates do not count.
    pub(super) fn neighbor(&self, triangle: usize, edge: usize) -> Option<usize> {
        let edge = EdgeId(self.topology.triangle_edges()[triangle][edge]);
        let is_first = |triangle: usize| self.duplicate_of[triangle] == NO_TRIANGLE;
        let around = self.topology.triangles_of_edge(edge).iter().map(|&triangle| triangle as usize);
        let mut others = around.filter(|&other| other != triangle && is_first(other));
        others.next().filter(|_| is_first(triangle) && others.next().is_none())
    }

    /// Whether an edge is of one triangle only.
    pub(super) fn is_border(&self, triangle: usize, edge: usize) -> bool {
        self.topology.triangles_of_edge(EdgeId(self.topology.triangle_edges()[triangle][edge])).len() == 1
    }

    pub(super) fn neighbors(&self, triangle: usize) -> impl Iterator<Item = usize> {
        (0..3).filter_map(move |edge| self.neighbor(triangle, edge))
    }

    /// Whether the edge between a triangle and its neighbor is convex or flat: the neighbor is not above the triangle.
    pub(super) fn is_convex(&self, triangle: usize, neighbor: usize) -> bool {
        let center = |triangle: usize| self.facets.corners[triangle].iter().sum::<DVec3>() / 3.0;
        self.normals[triangle].dot(center(neighbor) - center(triangle)) <= 0.0
    }

    /// Gives triangles lower than `height` the normal of the neighbor across their longest edge.
    fn repair_normals(&mut self, height: f64) {
        let longest = |corners: &[DVec3; 3]| {
            let lengths = [0, 1, 2].map(|k| corners[k].distance(corners[(k + 1) % 3]));
            let edge = (0..3).max_by(|&a, &b| lengths[a].total_cmp(&lengths[b])).unwrap_or(0);
            (edge, lengths[edge])
        };
        let mut open: Vec<usize> = (0..self.triangle_count())
            .filter(|&triangle| 2.0 * self.areas[triangle] <= height * longest(&self.facets.corners[triangle]).1)
            .collect();
        let mut is_open = vec![false; self.triangle_count()];
        for &triangle in &open {
            is_open[triangle] = true;
            self.normals[triangle] = DVec3::ZERO;
        }
        // Chains of slivers are repaired from their ends.
        loop {
            let before = open.len();
            let mut repaired = Vec::new();
            open.retain(|&triangle| {
                let (edge, _) = longest(&self.facets.corners[triangle]);
                let source = self.neighbor(triangle, edge).filter(|&other| !is_open[other]);
                repaired.extend(source.map(|source| (triangle, source)));
                source.is_none()
            });
            for (triangle, source) in repaired {
                self.normals[triangle] = self.normals[source];
                is_open[triangle] = false;
            }
            if open.len() == before {
                break;
            }
        }
    }
}

/// For each triangle, the earlier one with the same vertices, in whatever order.
fn duplicates(triangles: &[[u32; 3]]) -> Vec<u32> {
    let mut keys: Vec<([u32; 3], u32)> = triangles
        .iter()
        .zip(0..)
        .map(|(&corners, number)| {
            let mut sorted = corners;
            sorted.sort_unstable();
            (sorted, number)
        })
        .collect();
    keys.sort_unstable();
    let mut duplicate_of = vec![NO_TRIANGLE; triangles.len()];
    let mut first = 0;
    for place in 1..keys.len() {
        if keys[place].0 == keys[first].0 {
            duplicate_of[keys[place].1 as usize] = keys[first].1;
        } else {
            first = place;
        }
    }
    duplicate_of
}
