//! What is recorded of a tick, and how much of it.

use bevy_ecs::prelude::*;

/// How much of a layer is recorded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum LevelOfDetail {
    /// Nothing.
    Off,
    /// Triangles that touch another, and those that share a vertex with them; of pairs, those of two such triangles that
    /// no slab parts.
    NearContacts,
    /// Everything.
    All,
}

/// What [`DeformableRerunPlugin`](super::DeformableRerunPlugin) records. Changes take effect in the next tick.
///
/// Every layer is an entity of its own at the root of the recording, named like its field here, with the surfaces or pairs
/// below it: the viewer can show and hide a layer with one click. Of more than 48 pairs there is one entity for all, and each
/// point or line says of which pair it is. What a method does not compute has nothing to show:
/// curvature, recipe ages, spheres and cones are there for pairs tested by `Circumsphere`.
#[derive(Resource, Clone, Debug, PartialEq, Eq)]
#[expect(clippy::struct_excessive_bools, reason = "each switches a layer of its own")]
pub struct RerunSettings {
    /// Every how many ticks the layers are recorded; 0 counts as 1. Default 1. The text log has every tick.
    pub every: u32,
    /// About how many bytes a recorded tick may take, before compression. Layers are recorded in the order of the fields
    /// below. One that no longer fits is thinned evenly into half of what is left, contacts into three quarters, a mesh left out as a whole, and a warning
    /// says so, in the text log too. Default 4,000,000. The series, the log and the removal of what is gone are always
    /// recorded: some kilobytes, or some tens of them where ticks are more than a fifth of a second apart.
    pub bytes_per_tick: usize,
    /// Time, pairs and refreshes of every stage, steadiness and depth, as curves. Default true. Jitter is the mean second
    /// difference of the positions of a surface's touching vertices, in mean edges; while no more than 8 surfaces touch, each
    /// has a curve of its own. What moves by more than one contact distance in a tick may pass through something unseen.
    pub series: bool,
    /// Wall-clock times among the series: of each stage, and what recording the last tick took. Default true; without them
    /// two recordings of the same ticks are equal.
    pub times: bool,
    /// Surfaces, colored where they touch. Default all. A mesh's triangles are recorded once, its positions when they
    /// change.
    pub meshes: LevelOfDetail,
    /// Rigid shapes, as wires. Default true.
    pub shapes: bool,
    /// Contact points, normals, and the depths of the deepest. Default true.
    pub contacts: bool,
    /// Where sides have passed each other, and where edges pierce faces. Default true.
    pub penetrations: bool,
    /// Pairs of triangles whose boxes overlap, by the step that dropped them, those that came farthest first.
    /// Default near contacts.
    pub pairs: LevelOfDetail,
    /// Offset spheres, or enclosing balls. Default near contacts.
    pub spheres: LevelOfDetail,
    /// Safety cones. Default near contacts.
    pub cones: LevelOfDetail,
    /// Triangles colored by curvature. Default near contacts.
    pub curvature: LevelOfDetail,
    /// Triangles colored by how long ago their sphere's recipe was made. Default off.
    pub recipe_age: LevelOfDetail,
    /// How many levels of each surface's tree are recorded, from the root, where it is that of the tick. Default 4: up to 585
    /// boxes a surface.
    pub tree_levels: u32,
}

impl Default for RerunSettings {
    fn default() -> Self {
        Self {
            every: 1,
            bytes_per_tick: 4_000_000,
            series: true,
            times: true,
            meshes: LevelOfDetail::All,
            shapes: true,
            contacts: true,
            penetrations: true,
            pairs: LevelOfDetail::NearContacts,
            spheres: LevelOfDetail::NearContacts,
            cones: LevelOfDetail::NearContacts,
            curvature: LevelOfDetail::NearContacts,
            recipe_age: LevelOfDetail::Off,
            tree_levels: 4,
        }
    }
}

impl RerunSettings {
    /// Records everything of every layer, as far as the budget reaches.
    #[must_use]
    pub fn everything() -> Self {
        Self {
            pairs: LevelOfDetail::All,
            spheres: LevelOfDetail::All,
            cones: LevelOfDetail::All,
            curvature: LevelOfDetail::All,
            recipe_age: LevelOfDetail::All,
            tree_levels: u32::MAX,
            ..Self::default()
        }
    }
}
