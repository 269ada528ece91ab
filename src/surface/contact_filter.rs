//! The game's own say about which triangles may touch.

use std::{
    fmt::{self, Debug, Formatter},
    sync::Arc,
};

use bevy_ecs::prelude::*;
#[cfg(feature = "reflect")]
use bevy_reflect::prelude::*;

use super::active::ContactSide;
use crate::kernel::mesh::ids::TriangleId;

/// Two triangles that may touch, in the order of the sides of their contacts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CandidatePair {
    /// The first side. Always a deformable surface.
    pub a: ContactSide,
    /// Its triangle, in the game's numbering.
    pub triangle_a: TriangleId,
    /// The second side. In a self-collision, the same as the first.
    pub b: ContactSide,
    /// Its triangle, in the game's numbering. `None` for a rigid shape that is a solid.
    pub triangle_b: Option<TriangleId>,
}

/// A function of the game that decides which triangles may touch. Insert it as a resource. Without it, nothing is called,
/// and all triangles may touch that meet by [`SurfaceLayers`](super::SurfaceLayers) and
/// [`TriangleLayers`](super::TriangleLayers).
///
/// Pairs that it leaves out make no contact and no impact, with every [`ContactMethod`](super::ContactMethod), and the
/// response lets them pass. It is called only for pairs of triangles whose boxes overlap and that pass the layers, on one
/// thread, in an order that depends on nothing but the scene. Prefer layers where they suffice: they are faster.
///
/// - The answer must depend on the pair only, and on what the function has captured. Results of pairs of surfaces that do
///   not change are reused, and the function is not asked again about them.
/// - When captured state changes, insert the resource anew, or call `set_changed` on it: then all pairs are asked about.
///   For a world that rolls back or runs on several machines, the state must be the same in the same tick.
///
/// ```
/// # use bevy_app::prelude::*;
/// # use bevy_circumsphere::prelude::*;
/// # use bevy_ecs::prelude::*;
/// # let mut app = App::new();
/// # let [ghost, thrower] = [Entity::PLACEHOLDER; 2];
/// // The ghost does not touch the one who threw it, whichever comes first.
/// app.insert_resource(ContactFilter::new(move |pair| {
///     let sides = [pair.a.entity(), pair.b.entity()];
///     sides != [ghost, thrower] && sides != [thrower, ghost]
/// }));
/// ```
#[derive(Resource, Clone)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(opaque, Resource, Clone, Debug))]
pub struct ContactFilter(Arc<dyn Fn(&CandidatePair) -> bool + Send + Sync>);

impl ContactFilter {
    /// A filter that leaves out all pairs for which `may_touch` returns false.
    #[must_use]
    pub fn new(may_touch: impl Fn(&CandidatePair) -> bool + Send + Sync + 'static) -> Self {
        Self(Arc::new(may_touch))
    }

    pub(super) fn may_touch(&self, pair: &CandidatePair) -> bool {
        (self.0)(pair)
    }
}

/// Omits the function.
impl Debug for ContactFilter {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> fmt::Result {
        formatter.debug_struct("ContactFilter").finish_non_exhaustive()
    }
}
