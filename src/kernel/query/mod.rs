//! Queries of single triangles and solids in f64: rays, closest points, overlaps, and what meets first when a ball or a
//! solid moves.

pub mod ball_cast;
pub mod box_overlap;
pub mod closest;
pub mod ray;
pub mod shape_cast;
pub mod solid;
