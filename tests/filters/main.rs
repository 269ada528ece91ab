//! Pairs of triangles that are left out: by a filter of the game, by their layers, and at rest.

mod game;
mod layers;
mod rest;
mod world;
