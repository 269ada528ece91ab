//! All impacts of a moving mesh with itself, of its triangles or of its vertices, faces, and edges.
//!
//! Brute force is the definition. The tree over the swept boxes gives the same list faster, and tests compare the two.
//! Two meshes are tested as one, with the indices of the second shifted.

use super::box_tree::{Box3, BoxTree};
use super::impact::{ImpactTruth, edge_edge_impact, triangle_impact, vertex_face_impact};
use super::mesh_pairs::share_vertex;
use glam::DVec3;
use std::collections::BTreeSet;

/// Two triangles that meet during the motion, or may meet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TriangleImpact {
    /// The smaller index of the two triangles.
    pub triangle_a: u32,
    /// The larger index.
    pub triangle_b: u32,
    /// The time of the impact. Never [`ImpactTruth::Never`].
    pub truth: ImpactTruth,
}

/// Two features that meet during the motion, or may meet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FeatureImpact {
    /// The kinds of the features.
    pub kind: ImpactKind,
    /// Vertices of the mesh, in the order given by `kind`.
    pub vertices: [u32; 4],
    /// The time of the impact. Never [`ImpactTruth::Never`].
    pub truth: ImpactTruth,
}

/// Which features meet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum ImpactKind {
    /// A vertex and a face: the vertex, then the corners of the face in the order of the triangle list.
    VertexFace,
    /// Two edges: the ends of one, smaller index first, then those of the other. The edges are in ascending order.
    EdgeEdge,
}

/// A mesh at both ends of its motion.
#[derive(Clone, Copy, Debug)]
pub struct MovingMesh<'a> {
    /// Vertex positions at time 0.
    pub start: &'a [DVec3],
    /// Vertex positions at time 1.
    pub end: &'a [DVec3],
    /// Three vertices per triangle.
    pub triangles: &'a [[u32; 3]],
    /// The representative of each vertex ([`exact_weld`](super::exact_weld), or the identity for no welding).
    /// Triangles, edges, and vertices that share one are neighbors and are not tested.
    pub weld: &'a [u32],
}

/// All pairs of triangles that share no vertex and are not certified to stay farther apart than `minimum_separation`,
/// sorted by indices. Every pair is tested.
///
/// Triangles with a coordinate that is not finite meet nothing. Panics if an index is out of range.
#[must_use]
pub fn triangle_impacts_brute_force(mesh: &MovingMesh<'_>, minimum_separation: f64) -> Vec<TriangleImpact> {
    let mut impacts = Vec::new();
    for a in 0..mesh.triangles.len() {
        for b in a + 1..mesh.triangles.len() {
            impacts.extend(mesh.triangle_impact(a, b, minimum_separation));
        }
    }
    impacts
}

/// The same list as [`triangle_impacts_brute_force`], found with a tree of boxes.
#[must_use]
pub fn triangle_impacts_tree(mesh: &MovingMesh<'_>, minimum_separation: f64) -> Vec<TriangleImpact> {
    let mut impacts = Vec::new();
    swept_tree(mesh, mesh.triangles).visit_self(minimum_separation, &mut |a, b| {
        impacts.extend(mesh.triangle_impact(a, b, minimum_separation));
    });
    impacts.sort_unstable_by_key(|impact| (impact.triangle_a, impact.triangle_b));
    impacts
}

/// All vertex–face pairs and pairs of edges that share no vertex and are not certified to stay farther apart than
/// `minimum_separation`, sorted by kind and vertices. Every pair is tested.
///
/// Vertices without a triangle are ignored. Features with a coordinate that is not finite meet nothing. Panics if an
/// index is out of range.
#[must_use]
pub fn feature_impacts_brute_force(mesh: &MovingMesh<'_>, minimum_separation: f64) -> Vec<FeatureImpact> {
    let (vertices, edges) = (mesh.vertices(), mesh.edges());
    let mut impacts = Vec::new();
    for vertex in &vertices {
        for face in mesh.triangles {
            impacts.extend(mesh.feature_impact(ImpactKind::VertexFace, vertex, face, minimum_separation));
        }
    }
    for (position, edge_a) in edges.iter().enumerate() {
        for edge_b in &edges[position + 1..] {
            impacts.extend(mesh.feature_impact(ImpactKind::EdgeEdge, edge_a, edge_b, minimum_separation));
        }
    }
    sort(&mut impacts);
    impacts
}

/// The same list as [`feature_impacts_brute_force`], found with trees of boxes.
#[must_use]
pub fn feature_impacts_tree(mesh: &MovingMesh<'_>, minimum_separation: f64) -> Vec<FeatureImpact> {
    let (vertices, edges) = (mesh.vertices(), mesh.edges());
    let mut impacts = Vec::new();
    let faces = swept_tree(mesh, mesh.triangles);
    swept_tree(mesh, &vertices).visit_between(&faces, minimum_separation, &mut |vertex, face| {
        let (vertex, face) = (&vertices[vertex], &mesh.triangles[face]);
        impacts.extend(mesh.feature_impact(ImpactKind::VertexFace, vertex, face, minimum_separation));
    });
    swept_tree(mesh, &edges).visit_self(minimum_separation, &mut |edge_a, edge_b| {
        let (edge_a, edge_b) = (&edges[edge_a], &edges[edge_b]);
        impacts.extend(mesh.feature_impact(ImpactKind::EdgeEdge, edge_a, edge_b, minimum_separation));
    });
    sort(&mut impacts);
    impacts
}

impl MovingMesh<'_> {
    fn at_start<const N: usize>(&self, vertices: [u32; N]) -> [DVec3; N] {
        vertices.map(|vertex| self.start[vertex as usize])
    }

    fn at_end<const N: usize>(&self, vertices: [u32; N]) -> [DVec3; N] {
        vertices.map(|vertex| self.end[vertex as usize])
    }

    fn is_finite(&self, vertices: &[u32]) -> bool {
        vertices.iter().all(|&vertex| self.start[vertex as usize].is_finite() && self.end[vertex as usize].is_finite())
    }

    /// The vertices that belong to a triangle.
    fn vertices(&self) -> Vec<[u32; 1]> {
        let vertices: BTreeSet<u32> = self.triangles.iter().flatten().copied().collect();
        vertices.into_iter().map(|vertex| [vertex]).collect()
    }

    /// Each edge once, smaller end first. Edges from a vertex to itself are skipped.
    fn edges(&self) -> Vec<[u32; 2]> {
        let edges: BTreeSet<[u32; 2]> = self
            .triangles
            .iter()
            .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
            .filter(|[from, to]| from != to)
            .map(|[from, to]| [from.min(to), from.max(to)])
            .collect();
        edges.into_iter().collect()
    }

    fn triangle_impact(&self, a: usize, b: usize, minimum_separation: f64) -> Option<TriangleImpact> {
        let (corners_a, corners_b) = (self.triangles[a], self.triangles[b]);
        if share_vertex(&corners_a, &corners_b, self.weld) || !self.is_finite(&[corners_a, corners_b].concat()) {
            return None;
        }
        let truth = triangle_impact(
            &self.at_start(corners_a),
            &self.at_end(corners_a),
            &self.at_start(corners_b),
            &self.at_end(corners_b),
            minimum_separation,
        );
        (truth != ImpactTruth::Never).then_some(TriangleImpact { triangle_a: a as u32, triangle_b: b as u32, truth })
    }

    /// `first` and `second` are a vertex and a face, or two edges.
    fn feature_impact(
        &self,
        kind: ImpactKind,
        first: &[u32],
        second: &[u32],
        minimum_separation: f64,
    ) -> Option<FeatureImpact> {
        if share_vertex(first, second, self.weld) {
            return None;
        }
        let mut vertices = [0; 4];
        vertices[..first.len()].copy_from_slice(first);
        vertices[first.len()..].copy_from_slice(second);
        if !self.is_finite(&vertices) {
            return None;
        }
        let (start, end) = (self.at_start(vertices), self.at_end(vertices));
        let truth = match kind {
            ImpactKind::VertexFace => vertex_face_impact(&start, &end, minimum_separation),
            ImpactKind::EdgeEdge => edge_edge_impact(&start, &end, minimum_separation),
        };
        (truth != ImpactTruth::Never).then_some(FeatureImpact { kind, vertices, truth })
    }
}

/// A tree of the boxes that features sweep.
fn swept_tree<const N: usize>(mesh: &MovingMesh<'_>, features: &[[u32; N]]) -> BoxTree {
    let swept = |&feature: &[u32; N]| {
        mesh.is_finite(&feature).then(|| Box3::of(&mesh.at_start(feature)).union(Box3::of(&mesh.at_end(feature))))
    };
    BoxTree::new(features.iter().map(swept).collect())
}

fn sort(impacts: &mut [FeatureImpact]) {
    impacts.sort_unstable_by_key(|impact| (impact.kind, impact.vertices));
}
