//! What a query looks at.

use std::fmt::{self, Debug, Formatter};

use bevy_ecs::prelude::*;

use crate::surface::SurfaceLayers;

/// What a [`SurfaceQuery`](crate::SurfaceQuery) looks at. Default: everything, from both sides.
///
/// ```
/// # use bevy_circumsphere::prelude::*;
/// # let shooter = bevy_ecs::entity::Entity::PLACEHOLDER;
/// let enemies = SurfaceLayers { memberships: u32::MAX, filters: 0b10 };
/// let own = [shooter];
/// let filter = SurfaceQueryFilter::default().with_layers(enemies).excluding(&own).culling_back_faces();
/// # assert!(filter.culls_back_faces && filter.excluded == own);
/// ```
#[derive(Clone, Copy)]
pub struct SurfaceQueryFilter<'a> {
    /// The groups that the query belongs to, and those that it looks at, as for a surface: both must have a group that
    /// the other meets. Default: all groups in both.
    pub layers: SurfaceLayers,
    /// Entities that are not looked at. Default: none.
    pub excluded: &'a [Entity],
    /// Whether an entity is looked at. Asked once for each entity that is near. Default: `None`, all are.
    pub predicate: Option<&'a (dyn Fn(Entity) -> bool + Sync)>,
    /// Whether rays pass through triangles that they meet from behind, and out of solids. Other queries do not ask.
    /// Default: `false`, both sides are hit.
    pub culls_back_faces: bool,
}

impl Default for SurfaceQueryFilter<'_> {
    fn default() -> Self {
        Self {
            layers: SurfaceLayers { memberships: u32::MAX, filters: u32::MAX },
            excluded: &[],
            predicate: None,
            culls_back_faces: false,
        }
    }
}

/// Says whether there is a predicate.
impl Debug for SurfaceQueryFilter<'_> {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> fmt::Result {
        let mut filter = formatter.debug_struct("SurfaceQueryFilter");
        filter.field("layers", &self.layers).field("excluded", &self.excluded);
        filter.field("predicate", &self.predicate.map(|_| "…")).field("culls_back_faces", &self.culls_back_faces);
        filter.finish()
    }
}

impl<'a> SurfaceQueryFilter<'a> {
    /// Looks only at what meets these layers.
    #[must_use]
    pub const fn with_layers(mut self, layers: SurfaceLayers) -> Self {
        self.layers = layers;
        self
    }

    /// Does not look at these entities.
    #[must_use]
    pub const fn excluding(mut self, excluded: &'a [Entity]) -> Self {
        self.excluded = excluded;
        self
    }

    /// Looks only at entities for which `predicate` is true.
    #[must_use]
    pub const fn with_predicate(mut self, predicate: &'a (dyn Fn(Entity) -> bool + Sync)) -> Self {
        self.predicate = Some(predicate);
        self
    }

    /// Lets rays pass through triangles that they meet from behind, and out of solids.
    #[must_use]
    pub const fn culling_back_faces(mut self) -> Self {
        self.culls_back_faces = true;
        self
    }

    pub(super) fn looks_at(&self, entity: Entity, layers: SurfaceLayers) -> bool {
        self.layers.interacts_with(layers)
            && !self.excluded.contains(&entity)
            && self.predicate.is_none_or(|predicate| predicate(entity))
    }
}
