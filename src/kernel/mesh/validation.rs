//! What a mesh must be to become a surface.

use glam::Vec3;

/// The largest number of vertices, edges, or triangles of one surface. Feature numbers are packed into 28 bits of a
/// contact key.
pub const MAX_ELEMENTS: usize = (1 << 28) - 1;

/// Why a list of positions and triangles cannot be used as a surface.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TopologyError {
    /// The triangle list is empty.
    #[error("the surface has no triangles: give at least one")]
    NoTriangles,
    /// A triangle names a vertex that does not exist.
    #[error("triangle {triangle} names vertex {vertex}, but there are only {vertices} positions")]
    VertexOutOfRange {
        /// The index of the triangle in the list.
        triangle: usize,
        /// The vertex that the triangle names.
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
    /// The welding distance is negative, NaN, or infinite.
    #[error(
        "the distance to weld within is {0}: give a finite one of 0 or more, below the length of the shortest edge"
    )]
    WeldDistance(f32),
    /// A vertex is not welded to the first one of those that are one with it. Only where a topology is deserialized.
    #[error("vertex {vertex} is welded to vertex {to}, which is not an earlier vertex that is welded to itself")]
    Weld {
        /// The index of the vertex in the list.
        vertex: usize,
        /// The vertex that the list names.
        to: u32,
    },
    /// There are more elements than a contact key can number.
    #[error("the surface has {count} {element}, more than the {MAX_ELEMENTS} that one surface can have: split it")]
    TooLarge {
        /// `"vertices"`, `"triangles"` or `"edges"`.
        element: &'static str,
        /// The number of elements.
        count: usize,
    },
}

/// Checks what the welding takes for granted.
pub(super) fn validate_positions(positions: &[Vec3]) -> Result<(), TopologyError> {
    let vertex = positions.iter().position(|position| !position.is_finite());
    vertex.map_or(Ok(()), |vertex| Err(TopologyError::NonFinitePosition { vertex, position: positions[vertex] }))
}

/// Checks what the adjacency takes for granted. `weld` has for each vertex the first one that is one with it.
pub(super) fn validate(weld: &[u32], triangles: &[[u32; 3]]) -> Result<(), TopologyError> {
    if triangles.is_empty() {
        return Err(TopologyError::NoTriangles);
    }
    for (element, count) in [("vertices", weld.len()), ("triangles", triangles.len())] {
        if count > MAX_ELEMENTS {
            return Err(TopologyError::TooLarge { element, count });
        }
    }
    let is_first = |vertex: usize, to: u32| to as usize <= vertex && weld[to as usize] == to;
    if let Some((vertex, &to)) = weld.iter().enumerate().find(|&(vertex, &to)| !is_first(vertex, to)) {
        return Err(TopologyError::Weld { vertex, to });
    }
    for (triangle, corners) in triangles.iter().enumerate() {
        if let Some(&vertex) = corners.iter().find(|&&vertex| vertex as usize >= weld.len()) {
            return Err(TopologyError::VertexOutOfRange { triangle, vertex, vertices: weld.len() });
        }
    }
    Ok(())
}
