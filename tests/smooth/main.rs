//! Smooth surfaces against the bodies that they stand for, and against patches that are subdivided finely.

mod bodies;
mod distances;
mod fitness;
mod on_shapes;
mod one_normal;
mod plugin;
mod properties;
mod queries;
mod spheres;
mod surfaces;
mod touching;
