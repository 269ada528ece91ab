//! Stages 3 to 6: curvature, spheres and cones, and the pairs whose spheres overlap or whose caps meet.

pub(super) mod cone;
pub(super) mod curvature;
pub(super) mod lists;
pub(super) mod overlap;
pub(super) mod refit;
