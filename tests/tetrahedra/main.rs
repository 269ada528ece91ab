//! Tetrahedral bodies: the kernel against integer arithmetic, brute force, and closed forms, and the plugin in headless
//! worlds.

mod deep;
mod exact;
mod files;
mod inside;
mod masses;
mod motion;
mod penetration;
mod pile;
mod plugin;
mod search;
mod solids;
mod topology;
mod world;
