//! Continuous collision detection against closed forms, exactly constructed touches, and dense sampling of reference
//! distances.

mod designs;
mod families;
mod feature;
mod lists;
mod sweep;
mod triangle_pair;
mod truth;
