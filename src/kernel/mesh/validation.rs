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
    /// There are more elements than a contact key can number.
    #[error("the surface has {count} {element}, more than the {MAX_ELEMENTS} that one surface can have: split it")]
    TooLarge {
        /// `"vertices"`, `"triangles"` or `"edges"`.
        element: &'static str,
        /// The number of elements.
        count: usize,
    },
}

/// Checks what the adjacency takes for granted.
pub(super) fn validate(positions: &[Vec3], triangles: &[[u32; 3]]) -> Result<(), TopologyError> {
    if triangles.is_empty() {
        return Err(TopologyError::NoTriangles);
    }
    for (element, count) in [("vertices", positions.len()), ("triangles", triangles.len())] {
        if count > MAX_ELEMENTS {
            return Err(TopologyError::TooLarge { element, count });
        }
    }
    if let Some(vertex) = positions.iter().position(|position| !position.is_finite()) {
        return Err(TopologyError::NonFinitePosition { vertex, position: positions[vertex] });
    }
    for (triangle, corners) in triangles.iter().enumerate() {
        if let Some(&vertex) = corners.iter().find(|&&vertex| vertex as usize >= positions.len()) {
            return Err(TopologyError::VertexOutOfRange { triangle, vertex, vertices: positions.len() });
        }
    }
    Ok(())
}
