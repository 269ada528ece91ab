//! Warns of bodies that are too thick to lie flat beside themselves.

use bevy_ecs::prelude::*;

use super::body::XpbdBody;
use crate::surface::{ActiveSurface, Named};

/// Warns of a body that is tested against itself although most of its edges are shorter than its contact distance with itself.
/// Triangles that are two edges apart then push each other away at rest, all over the body.
pub(super) fn warn_of_thick(surface: &ActiveSurface, body: &XpbdBody, name: Option<&Name>) {
    if !surface.self_collision || surface.rest_pairs.is_some() {
        return;
    }
    let contact_distance = 2.0 * surface.least_thickness();
    let median_edge = median_edge(surface, body);
    if contact_distance <= median_edge {
        return;
    }
    log::warn!(
        "body {} touches itself at rest, crumples, and takes long: its contact distance with itself, which is twice its \
         thickness, is {contact_distance}, and its median edge is only {median_edge}. Give it a SurfaceThickness of at most a \
         quarter of its shortest edges, here about World({}), a coarser mesh, or no SelfCollision",
        Named(surface.entity, name),
        0.25 * median_edge,
    );
}

/// The median length of the edges at rest, in world units. 0 if no edge has two different ends.
fn median_edge(surface: &ActiveSurface, body: &XpbdBody) -> f32 {
    let at = |vertex: u32| body.rest.positions[vertex as usize];
    let edges = surface.topology.edges().iter().filter(|[first, second]| first != second);
    let mut lengths: Vec<f32> = edges.map(|&[first, second]| at(first).distance(at(second))).collect();
    if lengths.is_empty() {
        return 0.0;
    }
    let middle = lengths.len() / 2;
    let (_, median, _) = lengths.select_nth_unstable_by(middle, f32::total_cmp);
    *median * surface.pose.scale() as f32
}
