//! Tetrahedral bodies: the kernel against integer arithmetic, brute force, and closed forms, and the plugin in headless
//! worlds.

mod exact;
mod files;
mod inside;
mod penetration;
mod plugin;
mod search;
mod topology;
