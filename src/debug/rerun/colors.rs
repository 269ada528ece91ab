//! Colors of what only a recording has, and sizes.

use rerun::{Radius, Rgba32};

pub(super) use crate::debug::colors::*;

impl From<Color> for Rgba32 {
    fn from(color: Color) -> Self {
        Self(u32::from_be_bytes(color.0))
    }
}

/// A dark background, from which every color above stands out.
pub(super) const BACKGROUND: Color = rgb(24, 26, 30);

/// Transparent meshes: most contacts lie behind or between the layers of a mesh.
pub(super) const MESH_FACTOR: Color = rgba(255, 255, 255, 110);

/// A line 1.5 points wide on the screen, at any scale of the scene.
pub(super) const THIN: Radius = Radius(rerun::datatypes::Float32(-0.75));

/// The color of a curve, the same in every recording. `None` for curves named after entities of the game. Stages that
/// take almost no time are grey.
pub(super) fn curve(name: &str) -> Option<Color> {
    let grey = |level| Some(rgb(level, level, level));
    match name.strip_prefix("after ").unwrap_or(name) {
        "prepare" => grey(85),
        "bounds" => grey(110),
        "pair surfaces" => grey(135),
        "patches" => grey(210),
        "tree update" => grey(160),
        "normal cones" => grey(185),
        "broad phase" | "contact churn" | "overlap found" => Some(SKY_BLUE),
        "curvature" | "overlap left" => Some(BLUE),
        "refit" | "refit balls" | "recipes refreshed" => Some(PURPLE),
        "overlap" => Some(YELLOW),
        "cone" => Some(GREEN),
        "swept" => grey(235),
        "exact" | "normal jump in turns" | "penetration found" => Some(ORANGE),
        "contacts" | "largest motion" | "penetration left" => Some(VERMILION),
        "recording" | "examined" | "largest jitter" => Some(WHITE),
        _ => None,
    }
}

/// Colors for the jitter of single surfaces, none of which the plot uses otherwise.
pub(super) const OTHER_CURVES: [Color; 8] =
    [GREEN, YELLOW, PURPLE, BLUE, GREY, rgb(170, 170, 0), rgb(153, 221, 255), rgb(100, 100, 100)];
