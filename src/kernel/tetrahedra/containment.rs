//! Finds the points that lie in the tetrahedra of a body.
//!
//! Points are stored in hashed cells about as large as a tetrahedron. Each tetrahedron then visits the cells that its box
//! overlaps. See [`barycentric_inside`] for the test itself.

use glam::{DVec3, Vec3};

use super::{cells::HashedCells, inside::barycentric_inside, topology::TetrahedralTopology};
use crate::kernel::mesh::ids::{TetrahedronId, VertexId};

/// A vertex in a tetrahedron.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Containment {
    /// The vertex, by its place in the list of points.
    pub vertex: VertexId,
    /// The tetrahedron that it lies in: the lowest, where several contain it.
    pub tetrahedron: TetrahedronId,
    /// Its barycentric weights there, 0 or more.
    pub barycentric: [f64; 4],
}

/// Finds containments. Keeps its memory from call to call.
#[derive(Clone, Debug, Default)]
pub struct ContainmentSearch {
    cells: HashedCells,
    /// The points in the box of the body, each with its number.
    near: Vec<(DVec3, u32)>,
    /// For each of them, whether its tetrahedron has been found.
    is_found: Vec<bool>,
    /// The tetrahedra that may contain one, with their boxes.
    candidates: Vec<(u32, [DVec3; 2])>,
}

impl ContainmentSearch {
    /// Writes the containments of `points` in a body, sorted by point. Points that are not finite are in nothing.
    ///
    /// For the body's own vertices, `own` is the [weld](crate::kernel::mesh::topology::SurfaceTopology::weld) of its
    /// surface: tetrahedra that have the vertex as a corner do not count.
    ///
    /// # Panics
    /// If there are fewer positions than the body has vertices.
    pub fn find(
        &mut self,
        body: &TetrahedralTopology,
        positions: &[Vec3],
        points: impl Iterator<Item = DVec3>,
        own: Option<&[u32]>,
        found: &mut Vec<Containment>,
    ) {
        found.clear();
        let (low, high) = bounds(positions.iter().map(|position| position.as_dvec3()));
        self.near.clear();
        let is_near = |point: DVec3| point.cmpge(low).all() && point.cmple(high).all();
        self.near.extend(points.zip(0..).filter(|&(point, _)| is_near(point)));
        self.find_candidates(body, positions);
        if self.near.is_empty() || self.candidates.is_empty() {
            return;
        }
        let sizes = self.candidates.iter().map(|(_, [low, high])| (*high - *low).max_element());
        let size = sizes.sum::<f64>() / self.candidates.len() as f64;
        // Points on a single point share a cell of any size.
        let size = if size > 0.0 { size } else { 1.0 };
        self.cells.fill(self.near.iter().map(|&(point, _)| point), size);
        self.is_found.clear();
        self.is_found.resize(self.near.len(), false);
        let Self { cells, near, is_found, candidates } = self;
        for &(tetrahedron, [low, high]) in &*candidates {
            let names = &body.tetrahedra()[tetrahedron as usize];
            cells.visit(low, high, |place| {
                let (point, vertex) = near[place as usize];
                let is_found = &mut is_found[place as usize];
                // Tetrahedra come in ascending order.
                if *is_found || !(point.cmpge(low).all() && point.cmple(high).all()) {
                    return;
                }
                if own.is_some_and(|weld| names.iter().any(|&name| weld[name as usize] == weld[vertex as usize])) {
                    return;
                }
                let corners = names.map(|vertex| positions[vertex as usize].as_dvec3());
                if let Some(barycentric) = barycentric_inside(&corners, point) {
                    *is_found = true;
                    let (vertex, tetrahedron) = (VertexId(vertex), TetrahedronId(tetrahedron));
                    found.push(Containment { vertex, tetrahedron, barycentric });
                }
            });
        }
        found.sort_unstable_by_key(|containment| containment.vertex);
    }

    /// Finds the tetrahedra whose boxes overlap the box of the points near the body.
    fn find_candidates(&mut self, body: &TetrahedralTopology, positions: &[Vec3]) {
        let (low, high) = bounds(self.near.iter().map(|&(point, _)| point));
        self.candidates.clear();
        for (tetrahedron, names) in (0..).zip(body.tetrahedra()) {
            let [a, b, c, d] = names.map(|vertex| positions[vertex as usize]);
            let (own_low, own_high) = (a.min(b).min(c.min(d)).as_dvec3(), a.max(b).max(c.max(d)).as_dvec3());
            if own_low.cmple(high).all() && own_high.cmpge(low).all() {
                self.candidates.push((tetrahedron, [own_low, own_high]));
            }
        }
    }
}

fn bounds(points: impl Iterator<Item = DVec3>) -> (DVec3, DVec3) {
    points.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), point| (low.min(point), high.max(point)))
}
