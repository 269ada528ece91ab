//! Colors that readers with color blindness can tell apart.
//!
//! Categories use the palette of Okabe and Ito ("Color Universal Design", 2008). Scales use perceptually uniform color
//! maps.

use colorous::{CIVIDIS, Gradient, PURPLE_ORANGE};

use super::tick::{Touch, has_passed};
use crate::{contacts::Contact, kernel::pair_fate::PairFate};

/// Red, green, blue, and opacity, as a screen takes them (sRGB).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Color(pub(super) [u8; 4]);

pub(super) const fn rgb(red: u8, green: u8, blue: u8) -> Color {
    rgba(red, green, blue, u8::MAX)
}

pub(super) const fn rgba(red: u8, green: u8, blue: u8, opacity: u8) -> Color {
    Color([red, green, blue, opacity])
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
const TOUCHING: Color = ORANGE;
pub(super) const PENETRATING: Color = VERMILION;
const NEAR: Color = SKY_BLUE;

/// Overlapping wireframes are nearly transparent.
pub(super) const SPHERES: Color = rgba(86, 180, 233, 60);
pub(super) const CONES: Color = rgba(0, 158, 115, 70);
pub(super) const SHAPES: Color = GREY;

/// Patches, and the outlines of the flat triangles below them.
pub(super) const PATCHES: Color = rgba(86, 180, 233, 150);
pub(super) const OUTLINES: Color = rgba(255, 255, 255, 110);

/// Normals of contacts, and points where an edge pierces a face.
pub(super) const NORMALS: Color = YELLOW;
pub(super) const CROSSINGS: Color = PURPLE;

/// Surfaces without contacts: shades of grey, so that the colors above stand out and neighbors differ.
const SURFACES: [Color; 4] = [rgb(150, 150, 150), rgb(120, 125, 135), rgb(165, 160, 150), rgb(135, 140, 140)];

/// The color of a part of a surface, by its contact state.
pub(super) fn touch(place: usize, touch: Touch) -> Color {
    match touch {
        Touch::None => SURFACES[place % SURFACES.len()],
        Touch::Touching => TOUCHING,
        Touch::Penetrating => PENETRATING,
    }
}

/// The color of the point of a contact.
pub(super) fn contact(contact: &Contact) -> Color {
    if has_passed(contact) {
        PENETRATING
    } else if contact.separation() <= 0.0 {
        TOUCHING
    } else {
        NEAR
    }
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
    rgb(color.r, color.g, color.b)
}
