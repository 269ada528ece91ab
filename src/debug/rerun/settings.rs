//! What is recorded of a tick, and how much of it.

use bevy_ecs::prelude::*;
#[cfg(feature = "reflect")]
use bevy_reflect::prelude::*;

use crate::debug::LevelOfDetail;

/// What [`DeformableRerunPlugin`](super::DeformableRerunPlugin) records. Changes take effect in the next tick.
///
/// Every layer is an entity at the root of the recording, named like its field here, with the surfaces or pairs below
/// it. So the viewer can show or hide a layer with one click. More than 48 pairs share one entity, and each point or
/// line names its pair. A layer is empty if the contact method does not compute its content: curvature, recipe ages,
/// offset spheres, and cones exist for pairs tested by `Circumsphere`.
#[derive(Resource, Clone, Debug, PartialEq, Eq)]
#[expect(clippy::struct_excessive_bools, reason = "each flag switches its own layer")]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Resource, Clone, Debug, Default, PartialEq))]
pub struct RerunSettings {
    /// Layers are recorded every this many ticks; 0 counts as 1. Default 1. The text log has every tick.
    pub every: u32,
    /// Approximate limit of the bytes of a recorded tick, before compression. Default 4,000,000. Layers are recorded in
    /// the order of the fields below. A layer that no longer fits is thinned evenly to half of the remaining bytes, or
    /// to three quarters for contacts and penetrations. A mesh or rigid shape that does not fit is left out. A warning
    /// reports each case, also in the text log. The series, the log, and the removal of entities are always recorded.
    /// They take some kilobytes, or some tens of kilobytes if ticks are more than a fifth of a second apart.
    pub bytes_per_tick: usize,
    /// Curves of the time, pairs, and recipe refreshes of the stages, of steadiness, and of depth. Default true. Jitter
    /// is the mean second difference of the positions of a surface's touching vertices, in mean edges. While at most 8
    /// surfaces touch, each has its own jitter curve. A vertex that moves by more than one contact distance in a tick
    /// may tunnel.
    pub series: bool,
    /// Whether the series include wall-clock times: of each stage, and of recording the last tick. Default true.
    /// Without them, two recordings of the same ticks are equal.
    pub times: bool,
    /// Surfaces, colored where they touch. Default `All`. The triangles of a mesh are recorded once, and its positions
    /// when they change. So is a thickness that varies, as `thickness` of each vertex.
    pub meshes: LevelOfDetail,
    /// Rigid shapes, as wireframes. Default true.
    pub shapes: bool,
    /// Contact points, normals, and the separation of the deepest contact. Default true.
    pub contacts: bool,
    /// Contacts whose sides have passed each other, edges that pierce faces, and the vertices in tetrahedral bodies with
    /// their ways out, if [`TetrahedralContainmentPlugin`](crate::TetrahedralContainmentPlugin) finds them. Default true.
    pub penetrations: bool,
    /// The curved patches of smooth surfaces, over the outlines of their flat triangles. Default `NearContacts`.
    pub patches: LevelOfDetail,
    /// Tetrahedra, colored by their volume relative to that at rest if they have an
    /// [`XpbdBody`](crate::response::XpbdBody). Default `NearContacts`: those that contain a vertex or are inverted.
    pub tetrahedra: LevelOfDetail,
    /// Pairs of triangles whose boxes overlap, by the step that dropped them. Pairs that passed the most steps are
    /// recorded first. Default `NearContacts`.
    pub pairs: LevelOfDetail,
    /// Offset spheres or enclosing balls. Default `NearContacts`.
    pub spheres: LevelOfDetail,
    /// Safety cones. Default `NearContacts`.
    pub cones: LevelOfDetail,
    /// Triangles colored by curvature. Default `NearContacts`.
    pub curvature: LevelOfDetail,
    /// Triangles colored by the age of their sphere's recipe. Default `Off`.
    pub recipe_age: LevelOfDetail,
    /// Number of levels of each surface's tree, from the root, if the tree is up to date in the tick. Default 4, which
    /// is up to 585 boxes per surface. Beside the levels, the boxes of the regions that
    /// [normal cones](crate::detection::NormalConeCullingPlugin) leave out.
    pub tree_levels: u32,
    /// Cells of a [spatial hash](crate::detection::SpatialHashBroadPhasePlugin) that have triangles, with the number of
    /// triangles, below the surface in whose frame they are. Default `NearContacts`: those with a triangle near a
    /// contact.
    pub cells: LevelOfDetail,
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
            patches: LevelOfDetail::NearContacts,
            tetrahedra: LevelOfDetail::NearContacts,
            pairs: LevelOfDetail::NearContacts,
            spheres: LevelOfDetail::NearContacts,
            cones: LevelOfDetail::NearContacts,
            curvature: LevelOfDetail::NearContacts,
            recipe_age: LevelOfDetail::Off,
            tree_levels: 4,
            cells: LevelOfDetail::NearContacts,
        }
    }
}

impl RerunSettings {
    /// Records everything of every layer, within the byte budget.
    #[must_use]
    pub fn everything() -> Self {
        Self {
            patches: LevelOfDetail::All,
            tetrahedra: LevelOfDetail::All,
            pairs: LevelOfDetail::All,
            spheres: LevelOfDetail::All,
            cones: LevelOfDetail::All,
            curvature: LevelOfDetail::All,
            recipe_age: LevelOfDetail::All,
            tree_levels: u32::MAX,
            cells: LevelOfDetail::All,
            ..Self::default()
        }
    }
}
