//! Which pairs of triangles are left out although their surfaces meet, for all that finds pairs: the broad phase, the
//! swept stage, and the response.

use std::sync::Arc;

use super::active::ActiveSurface;
use crate::kernel::exact::rest_pairs::RestPairs;

/// What one side knows about the pairs that are left out.
#[derive(Clone, Debug, Default)]
pub(crate) struct FilterSide {
    rest_pairs: Option<Arc<RestPairs>>,
}

impl FilterSide {
    pub(crate) fn of_surface(surface: &ActiveSurface) -> Self {
        Self { rest_pairs: surface.rest_pairs.clone() }
    }
}

/// Tells which pairs of triangles of two sides, or of a surface with itself, are left out.
pub(crate) struct PairFilter<'a> {
    rest_pairs: Option<&'a RestPairs>,
}

impl<'a> PairFilter<'a> {
    /// The filter of two sides, the same one twice for a surface with itself. `None` if no pair is left out.
    pub(crate) fn between(first: &'a FilterSide, _second: &'a FilterSide, is_self: bool) -> Option<Self> {
        let rest_pairs = first.rest_pairs.as_deref().filter(|pairs| is_self && !pairs.is_empty());
        rest_pairs.is_some().then_some(Self { rest_pairs })
    }

    /// Whether two triangles may touch.
    pub(crate) fn allows(&self, triangles: [u32; 2]) -> bool {
        self.rest_pairs.is_none_or(|pairs| !pairs.contains(triangles))
    }
}
