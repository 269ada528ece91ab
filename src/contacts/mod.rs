//! Contacts: gathered from the stages, stored, read and announced; and impacts of fast motion, stored and read.

mod events;
mod gather;
mod impacts;
mod reading;
mod sides;
mod store;

pub use events::{ContactEventsPlugin, SurfaceContactEnded, SurfaceContactStarted};
#[cfg(feature = "rerun")]
pub(crate) use events::{Touching, TouchingSides};
pub use gather::ContactsPlugin;
pub use impacts::{Impact, SurfaceImpacts};
pub use reading::{Contact, SmoothNormals, StencilEntry, SurfaceContacts};
pub(crate) use store::PairOrder;
pub use store::{ContactStore, StoredPair};
