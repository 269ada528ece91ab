//! Garments that characters wear: where their vertices may go, and what happens to bad ones.

mod character;
mod hierarchy;
mod life_cycle;
mod reach;
mod refused;
mod walking;
