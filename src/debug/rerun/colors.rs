//! Colors that readers with color blindness can tell apart.
//!
//! Categories use the palette of Okabe and Ito ("Color Universal Design", 2008). Scales use perceptually uniform color
//! maps.

use colorous::{CIVIDIS, Gradient, PURPLE_ORANGE};
use rerun::{Color, Radius, Rgba32};

use crate::kernel::pair_fate::PairFate;

const fn rgb(red: u8, green: u8, blue: u8) -> Color {
    rgba(red, green, blue, u8::MAX)
}

const fn rgba(red: u8, green: u8, blue: u8, opacity: u8) -> Color {
    Color(Rgba32(u32::from_be_bytes([red, green, blue, opacity])))
}

pub(super) const ORANGE: Color = rgb(230, 159, 0);
pub(super) const SKY_BLUE: Color = rgb(86, 180, 233);
pub(super) const GREEN: Color = rgb(0, 158, 115);
pub(super) const YELLOW: Color = rgb(240, 228, 66);
pub(super) const BLUE: Color = rgb(0, 114, 178);
pub(super) const VERMILION: Color = rgb(213, 94, 0);
pub(super) const PURPLE: Color = rgb(204, 121, 167);
pub(super) const WHITE: Color = rgb(255, 255, 255);
pub(super) const GREY: Color = rgb(160, 160, 160);

/// Contacts on meshes and as points: touching, passed each other, only near.
pub(super) const TOUCHING: Color = ORANGE;
pub(super) const PENETRATING: Color = VERMILION;
pub(super) const NEAR: Color = SKY_BLUE;

/// Overlapping wireframes are nearly transparent.
pub(super) const SPHERES: Color = rgba(86, 180, 233, 60);
pub(super) const CONES: Color = rgba(0, 158, 115, 70);
pub(super) const SHAPES: Color = GREY;

/// Patches, and the outlines of the flat triangles below them.
pub(super) const PATCHES: Color = rgba(86, 180, 233, 150);
pub(super) const OUTLINES: Color = rgba(255, 255, 255, 110);

/// A dark background, from which every color above stands out.
pub(super) const BACKGROUND: Color = rgb(24, 26, 30);

/// Transparent meshes: most contacts lie behind or between the layers of a mesh.
pub(super) const MESH_FACTOR: Color = rgba(255, 255, 255, 110);

/// A line 1.5 points wide on the screen, at any scale of the scene.
pub(super) const THIN: Radius = Radius(rerun::datatypes::Float32(-0.75));

/// Surfaces without contacts: shades of grey, so that the colors above stand out and neighbors differ.
const SURFACES: [Color; 4] = [rgb(150, 150, 150), rgb(120, 125, 135), rgb(165, 160, 150), rgb(135, 140, 140)];

/// The color of a surface without contacts.
pub(super) fn surface(place: usize) -> Color {
    SURFACES[place % SURFACES.len()]
}

/// The color of a pair, by its fate.
pub(super) const fn fate(fate: PairFate) -> Color {
    match fate {
        PairFate::Neighbors | PairFate::Remembered | PairFate::Planes => GREY,
        PairFate::Spheres => SKY_BLUE,
        PairFate::CenterLine => BLUE,
        PairFate::Cone => PURPLE,
        PairFate::Distance => YELLOW,
        PairFate::Touching => TOUCHING,
    }
}

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
        "broad phase" | "contact churn" | "overlap found" => Some(SKY_BLUE),
        "curvature" | "overlap left" => Some(BLUE),
        "refit" | "refit balls" | "recipes refreshed" => Some(PURPLE),
        "overlap" => Some(YELLOW),
        "cone" => Some(GREEN),
        "swept" => grey(185),
        "exact" | "normal jump in turns" | "penetration found" => Some(ORANGE),
        "contacts" | "largest motion" | "penetration left" => Some(VERMILION),
        "recording" | "examined" | "largest jitter" => Some(WHITE),
        _ => None,
    }
}

/// Colors for the jitter of single surfaces, none of which the plot uses otherwise.
pub(super) const OTHER_CURVES: [Color; 8] =
    [GREEN, YELLOW, PURPLE, BLUE, GREY, rgb(170, 170, 0), rgb(153, 221, 255), rgb(100, 100, 100)];

/// The levels of a tree, in turn.
pub(super) const LEVELS: [Color; 9] = [SKY_BLUE, ORANGE, GREEN, YELLOW, VERMILION, PURPLE, WHITE, GREY, BLUE];

/// From concave (−1, purple) through flat (0, white) to convex (1, orange).
pub(super) fn curvature(value: f32) -> Color {
    at(PURPLE_ORANGE, 0.5 - 0.5 * f64::from(value.clamp(-1.0, 1.0)))
}

/// From new (bright) to old (dark), on a logarithmic scale that ends at 1000 ticks.
pub(super) fn age(ticks: u32) -> Color {
    at(CIVIDIS, 1.0 - (f64::from(ticks).ln_1p() / 1000.0_f64.ln_1p()).min(1.0))
}

fn at(gradient: Gradient, place: f64) -> Color {
    let color = gradient.eval_continuous(place);
    Color::from_rgb(color.r, color.g, color.b)
}
