//! Surfaces whose thickness differs from vertex to vertex, against brute force in f64.

mod components;
mod detection;
mod response;
mod shapes;
mod truth;
mod world;
