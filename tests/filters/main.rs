//! Pairs of triangles that are left out: by their layers, at rest, and by the response.

mod layers;
mod rest;
mod world;
