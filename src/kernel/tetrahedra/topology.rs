//! The tetrahedra of a body, and the surface around them. Found once, and shared by every instance.

use glam::Vec3;

use super::inside::signed_volume;
use crate::kernel::mesh::{
    ids::TetrahedronId,
    validation::{MAX_ELEMENTS, TopologyError},
};

/// Why positions and tetrahedra cannot be used as a body.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TetrahedraError {
    /// The list of tetrahedra is empty.
    #[error("the body has no tetrahedra: give at least one")]
    NoTetrahedra,
    /// A tetrahedron names a vertex that does not exist.
    #[error("tetrahedron {tetrahedron} names vertex {vertex}, but there are only {vertices} positions")]
    VertexOutOfRange {
        /// The index of the tetrahedron in the list.
        tetrahedron: usize,
        /// The vertex that it names.
        vertex: u32,
        /// The number of positions.
        vertices: usize,
    },
    /// A coordinate is NaN or infinite.
    #[error("the position of vertex {vertex} is not finite: {position}")]
    NonFinitePosition {
        /// The index of the vertex in the list.
        vertex: usize,
        /// Its position.
        position: Vec3,
    },
    /// There are more elements than a surface can number.
    #[error("the body has {count} {element}, more than the {MAX_ELEMENTS} that one body can have: split it")]
    TooLarge {
        /// `"vertices"` or `"tetrahedra"`.
        element: &'static str,
        /// The number of elements.
        count: usize,
    },
    /// Every face has two tetrahedra or more, or every tetrahedron names a vertex twice.
    #[error("the tetrahedra have no surface: remove those that occur twice or name a vertex twice")]
    NoSurface,
    /// The surface cannot be used.
    #[error(transparent)]
    Surface(#[from] TopologyError),
}

/// Irregularities of a body. None of them is an error, and all are handled.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TetrahedraReport {
    /// Tetrahedra without volume, ascending. They contain nothing.
    pub degenerate: Vec<TetrahedronId>,
    /// Tetrahedra that are turned inside out with respect to their neighbors, ascending. Windings that merely differ
    /// from tetrahedron to tetrahedron do not count.
    pub inverted: Vec<TetrahedronId>,
    /// Faces with three tetrahedra or more. They are not part of the surface.
    pub crowded_faces: usize,
    /// Vertices that are corners of no tetrahedron.
    pub unused_vertices: usize,
}

/// The tetrahedra of a body and its surface. Immutable: share it behind an [`Arc`](std::sync::Arc).
#[derive(Clone, Debug)]
pub struct TetrahedralTopology {
    vertex_count: usize,
    tetrahedra: Vec<[u32; 4]>,
    surface: Vec<[u32; 3]>,
    report: TetrahedraReport,
}

/// The faces of a tetrahedron with positive volume, counter-clockwise from outside. Face `k` is opposite corner `k`.
const FACES: [[usize; 3]; 4] = [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]];

/// A face with its vertices sorted.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Face {
    vertices: [u32; 3],
    tetrahedron: u32,
    opposite: u8,
    /// Whether sorting has turned the face over.
    is_turned: bool,
}

impl TetrahedralTopology {
    /// Finds the surface of `tetrahedra`: the faces that have one tetrahedron. Windings may differ from tetrahedron to
    /// tetrahedron. Faces belong together if they name the same vertices. Vertices at equal positions are not
    /// connected.
    ///
    /// # Errors
    /// If there is no tetrahedron or no surface, a vertex number is out of range, a coordinate is not finite, or there
    /// are more than [`MAX_ELEMENTS`] of anything.
    pub fn new(positions: &[Vec3], tetrahedra: &[[u32; 4]]) -> Result<Self, TetrahedraError> {
        validate(positions, tetrahedra)?;
        let volume = |corners: &[u32; 4]| signed_volume(&corners.map(|vertex| positions[vertex as usize].as_dvec3()));
        let volumes: Vec<f64> = tetrahedra.iter().map(volume).collect();
        let faces = sorted_faces(tetrahedra);
        let outward = outward_windings(&faces, &volumes);
        let mut report = TetrahedraReport::default();
        for (tetrahedron, (&volume, &is_outward)) in volumes.iter().zip(&outward).enumerate() {
            let id = TetrahedronId(tetrahedron as u32);
            if volume == 0.0 {
                report.degenerate.push(id);
            } else if (volume > 0.0) != is_outward {
                report.inverted.push(id);
            }
        }
        let mut boundary = Vec::new();
        for together in faces.chunk_by(|one, other| one.vertices == other.vertices) {
            match together {
                [face] => boundary.push((face.tetrahedron, face.opposite)),
                [_, _] => {}
                _ => report.crowded_faces += 1,
            }
        }
        if boundary.is_empty() {
            return Err(TetrahedraError::NoSurface);
        }
        boundary.sort_unstable();
        let surface = boundary.into_iter().map(|(tetrahedron, opposite)| {
            let corners = &tetrahedra[tetrahedron as usize];
            let [a, b, c] = FACES[opposite as usize].map(|corner| corners[corner]);
            if outward[tetrahedron as usize] { [a, b, c] } else { [a, c, b] }
        });
        let surface = surface.collect();
        let mut is_used = vec![false; positions.len()];
        for &vertex in tetrahedra.as_flattened() {
            is_used[vertex as usize] = true;
        }
        report.unused_vertices = is_used.iter().filter(|is_used| !**is_used).count();
        Ok(Self { vertex_count: positions.len(), tetrahedra: tetrahedra.to_vec(), surface, report })
    }

    /// The number of positions that the body needs.
    #[must_use]
    pub fn vertex_count(&self) -> usize {
        self.vertex_count
    }

    /// The tetrahedra, as they were given.
    #[must_use]
    pub fn tetrahedra(&self) -> &[[u32; 4]] {
        &self.tetrahedra
    }

    /// The triangles of the surface, counter-clockwise from outside, in the order of their tetrahedra. The vertex numbers
    /// are those of the tetrahedra.
    #[must_use]
    pub fn surface(&self) -> &[[u32; 3]] {
        &self.surface
    }

    /// The irregularities of the body at the positions that it was made from.
    #[must_use]
    pub fn report(&self) -> &TetrahedraReport {
        &self.report
    }
}

fn validate(positions: &[Vec3], tetrahedra: &[[u32; 4]]) -> Result<(), TetrahedraError> {
    if tetrahedra.is_empty() {
        return Err(TetrahedraError::NoTetrahedra);
    }
    for (element, count) in [("vertices", positions.len()), ("tetrahedra", tetrahedra.len())] {
        if count > MAX_ELEMENTS {
            return Err(TetrahedraError::TooLarge { element, count });
        }
    }
    if let Some(vertex) = positions.iter().position(|position| !position.is_finite()) {
        return Err(TetrahedraError::NonFinitePosition { vertex, position: positions[vertex] });
    }
    for (tetrahedron, corners) in tetrahedra.iter().enumerate() {
        if let Some(&vertex) = corners.iter().find(|&&vertex| vertex as usize >= positions.len()) {
            return Err(TetrahedraError::VertexOutOfRange { tetrahedron, vertex, vertices: positions.len() });
        }
    }
    Ok(())
}

/// All faces, sorted by their vertices. Tetrahedra that name a vertex twice have none.
fn sorted_faces(tetrahedra: &[[u32; 4]]) -> Vec<Face> {
    let is_whole = |[a, b, c, d]: &[u32; 4]| a != b && a != c && a != d && b != c && b != d && c != d;
    let mut faces: Vec<Face> = (0..)
        .zip(tetrahedra)
        .filter(|(_, corners)| is_whole(corners))
        .flat_map(|(tetrahedron, corners)| {
            [0, 1, 2, 3].map(|opposite: u8| {
                let mut vertices = FACES[opposite as usize].map(|corner| corners[corner]);
                let mut is_turned = false;
                for [first, second] in [[0, 1], [1, 2], [0, 1]] {
                    if vertices[first] > vertices[second] {
                        vertices.swap(first, second);
                        is_turned = !is_turned;
                    }
                }
                Face { vertices, tetrahedron, opposite, is_turned }
            })
        })
        .collect();
    faces.sort_unstable();
    faces
}

/// For each tetrahedron, whether its [`FACES`] are counter-clockwise from outside. Tetrahedra that are connected by
/// faces follow from one another, and the sign of their total volume decides for all of them. So a tetrahedron that is
/// turned inside out, or has no volume, does not turn over the surface.
fn outward_windings(faces: &[Face], volumes: &[f64]) -> Vec<bool> {
    // Up to four neighbors, each with whether it is wound the other way.
    let mut neighbors: Vec<[Option<(u32, bool)>; 4]> = vec![[None; 4]; volumes.len()];
    for together in faces.chunk_by(|one, other| one.vertices == other.vertices) {
        if let [one, other] = together {
            let differs = one.is_turned == other.is_turned;
            neighbors[one.tetrahedron as usize][one.opposite as usize] = Some((other.tetrahedron, differs));
            neighbors[other.tetrahedron as usize][other.opposite as usize] = Some((one.tetrahedron, differs));
        }
    }
    let mut outward: Vec<Option<bool>> = vec![None; volumes.len()];
    let mut connected = Vec::new();
    for seed in 0..volumes.len() {
        if outward[seed].is_some() {
            continue;
        }
        outward[seed] = Some(true);
        connected.clear();
        connected.push((seed as u32, true));
        let (mut next, mut total) = (0, 0.0);
        while let Some(&(tetrahedron, winding)) = connected.get(next) {
            next += 1;
            let volume = volumes[tetrahedron as usize];
            total += if winding { volume } else { -volume };
            for (neighbor, differs) in neighbors[tetrahedron as usize].into_iter().flatten() {
                let own = &mut outward[neighbor as usize];
                if own.is_none() {
                    *own = Some(winding != differs);
                    connected.push((neighbor, winding != differs));
                }
            }
        }
        if total < 0.0 {
            for &(tetrahedron, winding) in &connected {
                outward[tetrahedron as usize] = Some(!winding);
            }
        }
    }
    outward.into_iter().map(|winding| winding.unwrap_or(true)).collect()
}
