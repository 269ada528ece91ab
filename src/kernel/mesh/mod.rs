//! A mesh and its current state: ids, topology and adjacency, features and their normals, boxes, volume, motion, and rows
//! of corners.

pub mod barycentric;
pub mod bounds;
pub mod corner_rows;
pub mod curved_edges;
#[cfg(feature = "mesh")]
pub mod driven;
pub mod edge_distances;
pub(in crate::kernel) mod fans;
pub mod feature;
pub mod ids;
pub mod motion;
#[cfg(feature = "serde")]
mod serialized;
pub mod side;
#[cfg(feature = "mesh")]
pub mod skinning;
pub mod smooth_normal;
pub(in crate::kernel) mod surroundings;
pub mod thickness;
pub mod topology;
pub mod validation;
#[cfg(feature = "mesh")]
pub mod vertex_normals;
pub mod volume;
mod weld;
