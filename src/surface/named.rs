//! What the log calls an entity.

use core::fmt;

use bevy_ecs::prelude::*;

/// An entity in a message: its number, and its name if it has one.
pub(crate) struct Named<'a>(pub(crate) Entity, pub(crate) Option<&'a Name>);

impl fmt::Display for Named<'_> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(entity, name) = self;
        match name {
            Some(name) => write!(formatter, "{entity} ({name})"),
            None => write!(formatter, "{entity}"),
        }
    }
}
