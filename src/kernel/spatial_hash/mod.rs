//! Pairs of boxes by a spatial hash: boxes that share a cell of a grid, which is stored by the hash of the cell
//! (M. Teschner, B. Heidelberger, M. Müller, D. Pomeranets, M. Gross: Optimized Spatial Hashing for Collision Detection
//! of Deformable Objects, VMV 2003).
//!
//! The uniform hash has one grid. The hierarchical hash has a grid for every second power of two, and each box is in the
//! cells of the grid of its own size: a pair is found from the grid of the larger box. Each pair is found once, in the
//! cell of the larger of both minima on each axis. The table is filled anew for each call, in parts that may run on any
//! thread: neither the pairs nor their order depend on the threads.
//!
//! Three things keep time and memory in bounds. A box that is much larger than the cells is on a separate list. The
//! boxes of that list, and of a cell that has many, are sorted and swept along an axis. There are as many slots as
//! boxes in cells, so memory follows the number of boxes and not the space between them.

mod block;
mod boxes;
mod cells;
mod crowd;
mod entries;
mod occupied;
mod table;

pub use occupied::{OccupiedCell, occupied_cells};
pub use table::{HashCounts, HashKind, HashSettings, SpatialHash};
