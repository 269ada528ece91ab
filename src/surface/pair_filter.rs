//! Which pairs of triangles are left out although their surfaces meet, for all that finds pairs: the broad phase, the
//! swept stage, and the response.

use std::sync::Arc;

use super::{
    active::{ActiveShape, ActiveSurface, ContactSide, SideOrder},
    components::SurfaceLayers,
    contact_filter::{CandidatePair, ContactFilter},
};
use crate::kernel::{exact::rest_pairs::RestPairs, mesh::ids::TriangleId};

/// What one side knows about the pairs that are left out.
#[derive(Clone, Debug)]
pub(crate) struct FilterSide {
    side: ContactSide,
    order: SideOrder,
    /// Whether it is a rigid shape that is tested by formula.
    is_solid: bool,
    layers: SurfaceLayers,
    triangle_layers: Option<Arc<[SurfaceLayers]>>,
    rest_pairs: Option<Arc<RestPairs>>,
}

impl FilterSide {
    pub(crate) fn of_surface(surface: &ActiveSurface) -> Self {
        Self {
            side: surface.side(),
            order: surface.order,
            is_solid: false,
            layers: surface.layers,
            triangle_layers: surface.triangle_layers.clone(),
            rest_pairs: surface.rest_pairs.clone(),
        }
    }

    pub(crate) fn of_shape(shape: &ActiveShape) -> Self {
        Self {
            side: ContactSide::Shape(shape.entity),
            order: shape.order,
            is_solid: true,
            layers: shape.layers,
            triangle_layers: None,
            rest_pairs: None,
        }
    }

    fn layers_of(&self, triangle: u32) -> SurfaceLayers {
        self.triangle_layers.as_ref().map_or(self.layers, |layers| layers[triangle as usize])
    }
}

/// Tells which pairs of triangles of two sides, or of a surface with itself, are left out.
pub(crate) struct PairFilter<'a> {
    sides: [&'a FilterSide; 2],
    has_layers: bool,
    rest_pairs: Option<&'a RestPairs>,
    game: Option<&'a ContactFilter>,
}

impl<'a> PairFilter<'a> {
    /// The filter of two sides, the same one twice for a surface with itself. `None` if no pair is left out.
    pub(crate) fn between(
        first: &'a FilterSide,
        second: &'a FilterSide,
        is_self: bool,
        game: Option<&'a ContactFilter>,
    ) -> Option<Self> {
        let rest_pairs = first.rest_pairs.as_deref().filter(|pairs| is_self && !pairs.is_empty());
        let has_layers = first.triangle_layers.is_some() || second.triangle_layers.is_some();
        let filters = has_layers || rest_pairs.is_some() || game.is_some();
        filters.then_some(Self { sides: [first, second], has_layers, rest_pairs, game })
    }

    /// Whether two triangles may touch.
    pub(crate) fn allows(&self, [a, b]: [u32; 2]) -> bool {
        let [first, second] = self.sides;
        self.rest_pairs.is_none_or(|pairs| !pairs.contains([a, b]))
            && (!self.has_layers || first.layers_of(a).interacts_with(second.layers_of(b)))
            && self.game.is_none_or(|game| game.may_touch(&self.candidate([a, b])))
    }

    /// A pair of triangles, in the order of the sides of contacts.
    fn candidate(&self, triangles: [u32; 2]) -> CandidatePair {
        let [mut first, mut second] = [(self.sides[0], triangles[0]), (self.sides[1], triangles[1])];
        if second.0.order < first.0.order || self.is_self() && triangles[1] < triangles[0] {
            std::mem::swap(&mut first, &mut second);
        }
        CandidatePair {
            a: first.0.side,
            triangle_a: TriangleId(first.1),
            b: second.0.side,
            triangle_b: (!second.0.is_solid).then_some(TriangleId(second.1)),
        }
    }

    fn is_self(&self) -> bool {
        self.sides[0].side == self.sides[1].side
    }
}
