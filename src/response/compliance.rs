//! Compliances in files and messages: an infinite one, which JSON cannot write, is none.

use serde::{Deserialize, Deserializer, Serialize, Serializer};

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes fields by reference")]
pub(super) fn serialize<S: Serializer>(compliance: &f32, serializer: S) -> Result<S::Ok, S::Error> {
    Some(*compliance).filter(|compliance| *compliance != f32::INFINITY).serialize(serializer)
}

pub(super) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f32, D::Error> {
    Ok(Option::deserialize(deserializer)?.unwrap_or(f32::INFINITY))
}
