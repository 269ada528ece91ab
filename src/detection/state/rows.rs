//! The rows of a surface's triangles, for the exact test.

use super::bounds::TriangleBounds;
use crate::kernel::mesh::corner_rows::CornerRows;

/// The rows of a surface's triangles, from the last tick in which they were needed.
#[derive(Debug, Default)]
pub(in crate::detection) struct SurfaceRows {
    pub(in crate::detection) rows: CornerRows,
    /// The version of the positions that the rows were made from.
    pub(in crate::detection) version: u64,
}

impl SurfaceRows {
    /// The rows, if they were made from the same positions as the boxes.
    pub(in crate::detection) fn current(&self, bounds: &TriangleBounds) -> Option<&CornerRows> {
        (self.version == bounds.version()).then_some(&self.rows)
    }
}
