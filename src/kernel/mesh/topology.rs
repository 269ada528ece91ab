//! The adjacency of a triangle mesh, found once and shared by every instance.
//!
//! Vertices at exactly equal positions, or within a distance that the caller gives, are welded, for adjacency only:
//! triangles keep the caller's vertex numbers. Each welded edge and vertex knows its triangles. A later stage can thus
//! decide locally which of several triangles reports a shared feature. First in the flow: positions and triangles come
//! in, adjacency goes out.

use std::sync::OnceLock;

use glam::Vec3;

use super::{
    fans::Fans,
    feature::Feature,
    ids::{EdgeId, TriangleId, VertexId},
    surroundings::Surroundings,
    validation::{MAX_ELEMENTS, TopologyError, validate, validate_positions},
    weld::{exact_weld, weld_within},
};

/// Irregularities of a mesh. None of them is an error, and all are handled.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TopologyReport {
    /// Edges with a single triangle.
    pub boundary_edges: usize,
    /// Edges with three triangles or more.
    pub non_manifold_edges: usize,
    /// Edges whose two triangles traverse them in the same direction: one of the triangles is inverted.
    pub inconsistent_edges: usize,
    /// Triangles that name the same welded vertex twice.
    pub collapsed_triangles: usize,
    /// Vertices that are welded to an earlier one, because they share its position or lie within the welding distance.
    pub welded_vertices: usize,
}

/// The triangles of a surface and their adjacency. Immutable: share it behind an [`Arc`](std::sync::Arc).
#[derive(Clone, Debug)]
pub struct SurfaceTopology {
    vertex_count: usize,
    triangles: Vec<[u32; 3]>,
    welded_triangles: Vec<[u32; 3]>,
    weld: Vec<u32>,
    edges: Vec<[u32; 2]>,
    triangle_edges: Vec<[u32; 3]>,
    edge_triangles: Incidence,
    vertex_triangles: Incidence,
    surroundings: Vec<Surroundings>,
    report: TopologyReport,
    hinges: OnceLock<Box<[Hinge]>>,
    /// Computed for smooth surfaces.
    fans: OnceLock<Box<Fans>>,
    /// Computed when an exact test first needs it.
    firsts: OnceLock<FirstTriangles>,
    /// The component of each triangle, and the number of components. Computed when it is first asked for.
    components: OnceLock<(Box<[u32]>, usize)>,
}

/// The first triangle around each vertex and each edge.
#[derive(Clone, Debug)]
struct FirstTriangles {
    /// For each welded vertex that has triangles, the corners of the first one.
    around_vertices: Box<[[u32; 3]]>,
    /// For each edge, the corner of its first triangle that is opposite the edge.
    opposite: Box<[u32]>,
}

/// Whether two triangles, given by their vertices, share a vertex.
#[inline]
pub(in crate::kernel) fn share_corner([a0, a1, a2]: [u32; 3], other: [u32; 3]) -> bool {
    // Without short-circuiting: nine comparisons cost less than one branch that is hard to predict.
    other.iter().fold(false, |shared, &vertex| shared | (vertex == a0) | (vertex == a1) | (vertex == a2))
}

/// How the triangles around an edge meet.
#[derive(Clone, Copy, Debug)]
pub(in crate::kernel) enum Hinge {
    /// The edge is a boundary.
    Rim,
    /// Two triangles.
    Fold {
        /// The lower one first.
        triangles: [u32; 2],
        /// The ends of the edge in the direction of the first triangle, in the caller's numbering.
        ends: [u32; 2],
        /// Whether the second triangle traverses the edge in the same direction, and is therefore inverted.
        turned: bool,
    },
    /// Three triangles or more.
    Branch,
}

/// For each element of one kind, the triangles around it, ascending, as one flat list with offsets.
#[derive(Clone, Debug, Default)]
pub(in crate::kernel) struct Incidence {
    offsets: Vec<u32>,
    triangles: Vec<u32>,
}

impl Incidence {
    /// The number of elements.
    pub(in crate::kernel) fn len(&self) -> usize {
        self.offsets.len() - 1
    }

    /// `corners[t]` are the three elements of triangle `t`.
    fn new(element_count: usize, corners: &[[u32; 3]]) -> Self {
        let mut offsets = vec![0u32; element_count + 1];
        let distinct = |elements: &[u32; 3], corner: usize| !elements[..corner].contains(&elements[corner]);
        for elements in corners {
            for corner in 0..3 {
                if distinct(elements, corner) {
                    offsets[elements[corner] as usize + 1] += 1;
                }
            }
        }
        for element in 0..element_count {
            offsets[element + 1] += offsets[element];
        }
        let mut next = offsets.clone();
        let mut triangles = vec![0u32; offsets[element_count] as usize];
        for (triangle, elements) in corners.iter().enumerate() {
            for corner in 0..3 {
                if distinct(elements, corner) {
                    let slot = &mut next[elements[corner] as usize];
                    triangles[*slot as usize] = triangle as u32;
                    *slot += 1;
                }
            }
        }
        Self { offsets, triangles }
    }

    #[inline]
    pub(in crate::kernel) fn around(&self, element: u32) -> &[u32] {
        let element = element as usize;
        &self.triangles[self.offsets[element] as usize..self.offsets[element + 1] as usize]
    }
}

impl SurfaceTopology {
    /// Builds the adjacency of `triangles`, and welds vertices whose `positions` are exactly equal. Triangles are
    /// vertex numbers, counter-clockwise from outside if the mesh has an outside.
    ///
    /// # Errors
    /// If the triangle list is empty, a vertex number is out of range, a coordinate is not finite, or there are more
    /// than [`MAX_ELEMENTS`] of anything.
    pub fn new(positions: &[Vec3], triangles: &[[u32; 3]]) -> Result<Self, TopologyError> {
        Self::welded_within(positions, triangles, 0.0)
    }

    /// Like [`new`](Self::new), but welds all vertices whose positions are no farther apart than `distance`, in the
    /// unit of the positions. Welding is transitive: a chain of vertices becomes one vertex, named by the lowest. 0
    /// welds equal positions only.
    ///
    /// The distance must stay below the length of the shortest edge. Triangles with a shorter edge collapse, and then
    /// the surface is not [closed](Self::is_closed). Under that condition the time is proportional to the number of
    /// vertices.
    ///
    /// # Errors
    /// If the distance is negative or not finite, and in the cases of [`new`](Self::new).
    pub fn welded_within(positions: &[Vec3], triangles: &[[u32; 3]], distance: f32) -> Result<Self, TopologyError> {
        validate_positions(positions)?;
        if !(distance.is_finite() && distance >= 0.0) {
            return Err(TopologyError::WeldDistance(distance));
        }
        let mut weld = exact_weld(positions);
        if distance > 0.0 {
            weld_within(positions, f64::from(distance), &mut weld);
        }
        Self::from_weld(weld, triangles)
    }

    /// Builds the adjacency of `triangles`, whose vertices are one where they have the same entry of `weld`: the first of
    /// those vertices.
    ///
    /// # Errors
    /// If an entry is not such a vertex, and in the cases of [`new`](Self::new).
    pub(super) fn from_weld(weld: Vec<u32>, triangles: &[[u32; 3]]) -> Result<Self, TopologyError> {
        validate(&weld, triangles)?;
        let welded_triangles: Vec<[u32; 3]> =
            triangles.iter().map(|corners| corners.map(|vertex| weld[vertex as usize])).collect();
        let (edges, triangle_edges) = unique_edges(&welded_triangles);
        // Beyond the edges, three numbers per triangle are reserved for edges whose welded ends move apart.
        let edge_numbers = edges.len() + 3 * triangles.len();
        if edge_numbers > MAX_ELEMENTS {
            return Err(TopologyError::TooLarge { element: "edges", count: edge_numbers });
        }
        let edge_triangles = Incidence::new(edges.len(), &triangle_edges);
        let vertex_triangles = Incidence::new(weld.len(), &welded_triangles);
        let surroundings = Surroundings::of_all(&welded_triangles, &triangle_edges, &vertex_triangles, &edge_triangles);
        let mut topology = Self {
            vertex_count: weld.len(),
            triangles: triangles.to_vec(),
            welded_triangles,
            weld,
            edges,
            triangle_edges,
            edge_triangles,
            vertex_triangles,
            surroundings,
            report: TopologyReport::default(),
            hinges: OnceLock::new(),
            fans: OnceLock::new(),
            firsts: OnceLock::new(),
            components: OnceLock::new(),
        };
        topology.report = topology.inspect();
        Ok(topology)
    }

    fn inspect(&self) -> TopologyReport {
        let mut report = TopologyReport {
            collapsed_triangles: self.welded_triangles.iter().filter(|&&[a, b, c]| a == b || b == c || c == a).count(),
            welded_vertices: self.weld.iter().enumerate().filter(|&(vertex, &to)| vertex as u32 != to).count(),
            ..TopologyReport::default()
        };
        for (edge, &[first, second]) in self.edges.iter().enumerate() {
            if first == second {
                continue;
            }
            match self.edge_triangles.around(edge as u32) {
                [_] => report.boundary_edges += 1,
                &[a, b] => {
                    let forward = |triangle: u32| self.runs_forward(triangle, edge as u32);
                    report.inconsistent_edges += usize::from(forward(a) == forward(b));
                }
                _ => report.non_manifold_edges += 1,
            }
        }
        report
    }

    /// Whether `triangle` traverses `edge` from its lower to its higher welded vertex.
    pub(crate) fn runs_forward(&self, triangle: u32, edge: u32) -> bool {
        let corners = self.welded_triangles[triangle as usize];
        let [first, second] = self.edges[edge as usize];
        (0..3).any(|k| corners[k] == first && corners[(k + 1) % 3] == second)
    }

    /// The hinge at each edge, computed on first use.
    pub(in crate::kernel) fn hinges(&self) -> &[Hinge] {
        self.hinges.get_or_init(|| (0..self.edges.len() as u32).map(|edge| self.hinge(edge)).collect())
    }

    /// The triangles around each vertex in cyclic order, computed on first use.
    pub(in crate::kernel) fn fans(&self) -> &Fans {
        self.fans.get_or_init(|| Box::new(Fans::of(self)))
    }

    fn hinge(&self, edge: u32) -> Hinge {
        match *self.edge_triangles.around(edge) {
            [] | [_] => Hinge::Rim,
            [first, second] => {
                let edges = self.triangle_edges[first as usize];
                let side = (0..3).find(|&k| edges[k] == edge).unwrap_or_default();
                let corners = self.triangles[first as usize];
                Hinge::Fold {
                    triangles: [first, second],
                    ends: [corners[side], corners[(side + 1) % 3]],
                    turned: self.runs_forward(first, edge) == self.runs_forward(second, edge),
                }
            }
            _ => Hinge::Branch,
        }
    }

    /// The number of positions that the surface needs.
    #[must_use]
    pub fn vertex_count(&self) -> usize {
        self.vertex_count
    }

    /// Whether every vertex is a corner of a triangle.
    #[must_use]
    pub(crate) fn names_every_vertex(&self) -> bool {
        let mut named = vec![false; self.vertex_count];
        for &vertex in self.triangles.as_flattened() {
            named[vertex as usize] = true;
        }
        !named.contains(&false)
    }

    /// The triangles, in the caller's vertex numbers.
    #[must_use]
    #[inline]
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// The triangles, in welded vertices. Each vertex is named by the first one that it is welded to.
    #[must_use]
    #[inline]
    pub fn welded_triangles(&self) -> &[[u32; 3]] {
        &self.welded_triangles
    }

    /// For each of the caller's vertices, the first vertex that it is welded to: one at exactly the same position, or,
    /// if the surface was [welded within](Self::welded_within) a distance, one in the same chain of vertices.
    #[must_use]
    #[inline]
    pub fn weld(&self) -> &[u32] {
        &self.weld
    }

    /// The unique edges as pairs of welded vertices, lower first, sorted. A triangle that names a welded vertex twice
    /// has an edge from that vertex to itself.
    #[must_use]
    pub fn edges(&self) -> &[[u32; 2]] {
        &self.edges
    }

    /// The edges of each triangle. Edge `k` joins its corners `k` and `k + 1`.
    #[must_use]
    #[inline]
    pub fn triangle_edges(&self) -> &[[u32; 3]] {
        &self.triangle_edges
    }

    /// The welded corners of the first triangle around a welded vertex. Only meaningful if the vertex has triangles.
    #[inline]
    pub(in crate::kernel) fn first_around_vertex(&self, vertex: u32) -> [u32; 3] {
        self.firsts().around_vertices[vertex as usize]
    }

    /// The welded corner of an edge's first triangle that is opposite the edge.
    #[inline]
    pub(in crate::kernel) fn first_opposite(&self, edge: EdgeId) -> u32 {
        self.firsts().opposite[edge.index()]
    }

    #[inline]
    fn firsts(&self) -> &FirstTriangles {
        self.firsts.get().unwrap_or_else(|| self.find_firsts())
    }

    #[cold]
    #[inline(never)]
    fn find_firsts(&self) -> &FirstTriangles {
        let around_vertex = |vertex: u32| {
            let first = self.vertex_triangles.around(vertex).first();
            first.map_or([vertex; 3], |&first| self.welded_triangles[first as usize])
        };
        let opposite = |edge: u32| {
            let first = self.edge_triangles.around(edge)[0] as usize;
            let place = self.triangle_edges[first].iter().position(|&own| own == edge).unwrap_or_default();
            self.welded_triangles[first][(place + 2) % 3]
        };
        self.firsts.get_or_init(|| FirstTriangles {
            around_vertices: (0..self.vertex_count as u32).map(around_vertex).collect(),
            opposite: (0..self.edges.len() as u32).map(opposite).collect(),
        })
    }

    /// What a triangle knows about its neighborhood.
    #[inline]
    pub(in crate::kernel) fn surroundings(&self, triangle: TriangleId) -> Surroundings {
        self.surroundings[triangle.index()]
    }

    /// Whether any two vertices are welded.
    #[inline]
    pub(crate) fn is_welded(&self) -> bool {
        self.report.welded_vertices > 0
    }

    /// The triangles around an edge, ascending.
    #[must_use]
    #[inline]
    pub fn triangles_of_edge(&self, edge: EdgeId) -> &[u32] {
        self.edge_triangles.around(edge.0)
    }

    /// A triangle and all triangles that share an edge with it, some of them more than once.
    pub(crate) fn triangles_beside(&self, triangle: u32) -> impl Iterator<Item = u32> {
        let edges = self.triangle_edges[triangle as usize].into_iter();
        edges.flat_map(|edge| self.edge_triangles.around(edge).iter().copied())
    }

    /// The triangles around a vertex and all vertices welded to it, ascending.
    ///
    /// # Panics
    /// If the vertex does not exist.
    #[must_use]
    #[inline]
    pub fn triangles_of_vertex(&self, vertex: VertexId) -> &[u32] {
        self.vertex_triangles.around(self.weld[vertex.index()])
    }

    /// The triangles around a feature of a triangle: all that have it.
    pub(crate) fn triangles_around<'a>(&'a self, triangle: &'a u32, feature: Feature) -> &'a [u32] {
        let own = *triangle as usize;
        match feature {
            Feature::Vertex(corner) => self.vertex_triangles.around(self.welded_triangles[own][corner as usize]),
            Feature::Edge(edge) => self.edge_triangles.around(self.triangle_edges[own][edge as usize]),
            Feature::Face => std::slice::from_ref(triangle),
        }
    }

    /// Whether two triangles are neighbors: they share a welded vertex. Such a pair is never reported as touching.
    #[must_use]
    #[inline]
    pub fn share_vertex(&self, a: TriangleId, b: TriangleId) -> bool {
        share_corner(self.welded_triangles[a.index()], self.welded_triangles[b.index()])
    }

    /// Whether the surface has an inside: every edge has two triangles that traverse it in opposite directions, and no
    /// triangle is collapsed.
    #[must_use]
    pub fn is_closed(&self) -> bool {
        self.report.boundary_edges == 0
            && self.report.non_manifold_edges == 0
            && self.report.inconsistent_edges == 0
            && self.report.collapsed_triangles == 0
    }

    /// The irregularities of the mesh.
    #[must_use]
    pub fn report(&self) -> TopologyReport {
        self.report
    }

    /// Mean length of the unique welded edges at the given positions. 0 if no edge has two different ends.
    ///
    /// # Panics
    /// If there are fewer positions than [`vertex_count`](Self::vertex_count).
    #[must_use]
    pub fn mean_edge_length(&self, positions: &[Vec3]) -> f64 {
        let lengths = self.edges.iter().filter(|[first, second]| first != second).map(|&[first, second]| {
            (positions[first as usize].as_dvec3() - positions[second as usize].as_dvec3()).length()
        });
        let (sum, count) = lengths.fold((0.0, 0usize), |(sum, count), length| (sum + length, count + 1));
        sum / count.max(1) as f64
    }

    /// Numbers the connected components, which are triangles joined by shared welded vertices, in the order of their
    /// first triangle. Returns the component of each triangle, and the number of components.
    #[must_use]
    pub fn components(&self) -> (&[u32], usize) {
        let (components, count) = self.components.get_or_init(|| self.find_components());
        (components, *count)
    }

    fn find_components(&self) -> (Box<[u32]>, usize) {
        const UNSEEN: u32 = u32::MAX;
        let mut component = vec![UNSEEN; self.triangles.len()];
        let mut count = 0;
        let mut open = Vec::new();
        for seed in 0..self.triangles.len() {
            if component[seed] != UNSEEN {
                continue;
            }
            component[seed] = count;
            open.push(seed as u32);
            while let Some(triangle) = open.pop() {
                for vertex in self.welded_triangles[triangle as usize] {
                    for &neighbor in self.vertex_triangles.around(vertex) {
                        if component[neighbor as usize] == UNSEEN {
                            component[neighbor as usize] = count;
                            open.push(neighbor);
                        }
                    }
                }
            }
            count += 1;
        }
        (component.into(), count as usize)
    }
}

fn unique_edges(welded_triangles: &[[u32; 3]]) -> (Vec<[u32; 2]>, Vec<[u32; 3]>) {
    let side = |corners: &[u32; 3], k: usize| {
        let (from, to) = (corners[k], corners[(k + 1) % 3]);
        [from.min(to), from.max(to)]
    };
    let mut edges = Vec::with_capacity(3 * welded_triangles.len());
    edges.extend(welded_triangles.iter().flat_map(|corners| [0, 1, 2].map(|k| side(corners, k))));
    edges.sort_unstable();
    edges.dedup();
    // Most edges were collected twice.
    edges.shrink_to_fit();
    let number = |edge: [u32; 2]| edges.binary_search(&edge).expect("every triangle's edges were collected") as u32;
    let triangle_edges = welded_triangles.iter().map(|corners| [0, 1, 2].map(|k| number(side(corners, k)))).collect();
    (edges, triangle_edges)
}
