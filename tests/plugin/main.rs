//! The plugin in headless worlds: spawning, changing, and despawning, and the contacts and events that result.

mod broad_phases;
mod event_hold;
mod extremes;
mod features;
mod hysteresis;
mod instances;
mod kept;
mod life_cycle;
mod margin;
mod memory;
mod methods;
mod order;
mod pair_fates;
mod poses;
mod quarantine;
mod rebuild;
mod reductions;
mod rest;
mod rest_contacts;
mod rigid_shapes;
mod setup;
mod shape_kinds;
mod shape_life;
mod shapes_of_triangles;
mod sides;
mod slow;
mod smooth_normals;
mod sphere_lists;
mod swept;
mod swept_shapes;
#[cfg(feature = "parallel")]
mod threads;
mod unit_normals;
mod world;
