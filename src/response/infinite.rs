//! Numbers in files and messages that may be infinite: an infinite one, which JSON cannot write, is none.

use serde::{Deserialize, Deserializer, Serialize, Serializer, de::Error as _, ser::Error as _};

const NAN: &str = "a number is NaN";

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes fields by reference")]
pub(super) fn serialize<S: Serializer>(number: &f32, serializer: S) -> Result<S::Ok, S::Error> {
    if number.is_nan() {
        return Err(S::Error::custom(NAN));
    }
    Some(*number).filter(|number| *number != f32::INFINITY).serialize(serializer)
}

pub(super) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f32, D::Error> {
    let number = Option::deserialize(deserializer)?.unwrap_or(f32::INFINITY);
    if number.is_nan() { Err(D::Error::custom(NAN)) } else { Ok(number) }
}
