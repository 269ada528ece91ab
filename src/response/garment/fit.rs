//! Tells of garments that begin inside what wears them.

use bevy_ecs::prelude::*;

use super::components::XpbdGarment;
use crate::{
    contacts::{Contact, SurfaceContacts},
    response::body::XpbdBody,
    surface::Named,
};

/// Warns of garments that cross their skins in the tick in which they become cloth. What is pinned there stays there, and
/// what is free trembles until it is out.
pub(super) fn warn_of_crossings(
    garments: Query<(Entity, Option<&Name>, &XpbdGarment), Added<XpbdBody>>,
    contacts: SurfaceContacts,
) {
    for (entity, name, garment) in &garments {
        let with_skins = garment.skins.iter().flat_map(|&skin| contacts.between(entity, skin));
        let mut crossings = with_skins.filter(Contact::is_crossing);
        let Some(first) = crossings.next() else { continue };
        log::warn!(
            "garment {} begins inside its skin: edges pierce faces in {} places, one of them at {}. It may tremble there. In the \
             pose in which it is put on, keep it off the skin by more than both thicknesses, or let that part not meet the skin, \
             by `TriangleLayers`",
            Named(entity, name),
            crossings.count() + 1,
            first.points().0,
        );
    }
}
