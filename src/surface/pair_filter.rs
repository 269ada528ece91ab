//! Which pairs of triangles are left out although their surfaces meet, for all that finds pairs: the broad phase, the
//! swept stage, and the response.

use std::sync::Arc;

use super::{
    active::{ActiveShape, ActiveSurface},
    components::SurfaceLayers,
};
use crate::kernel::exact::rest_pairs::RestPairs;

/// What one side knows about the pairs that are left out.
#[derive(Clone, Debug)]
pub(crate) struct FilterSide {
    layers: SurfaceLayers,
    triangle_layers: Option<Arc<[SurfaceLayers]>>,
    rest_pairs: Option<Arc<RestPairs>>,
}

impl FilterSide {
    pub(crate) fn of_surface(surface: &ActiveSurface) -> Self {
        let ActiveSurface { layers, triangle_layers, rest_pairs, .. } = surface;
        Self { layers: *layers, triangle_layers: triangle_layers.clone(), rest_pairs: rest_pairs.clone() }
    }

    pub(crate) fn of_shape(shape: &ActiveShape) -> Self {
        Self { layers: shape.layers, triangle_layers: None, rest_pairs: None }
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
}

impl<'a> PairFilter<'a> {
    /// The filter of two sides, the same one twice for a surface with itself. `None` if no pair is left out.
    pub(crate) fn between(first: &'a FilterSide, second: &'a FilterSide, is_self: bool) -> Option<Self> {
        let rest_pairs = first.rest_pairs.as_deref().filter(|pairs| is_self && !pairs.is_empty());
        let has_layers = first.triangle_layers.is_some() || second.triangle_layers.is_some();
        (has_layers || rest_pairs.is_some()).then_some(Self { sides: [first, second], has_layers, rest_pairs })
    }

    /// Whether two triangles may touch.
    pub(crate) fn allows(&self, [a, b]: [u32; 2]) -> bool {
        let [first, second] = self.sides;
        self.rest_pairs.is_none_or(|pairs| !pairs.contains([a, b]))
            && (!self.has_layers || first.layers_of(a).interacts_with(second.layers_of(b)))
    }
}
