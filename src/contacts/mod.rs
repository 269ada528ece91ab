//! Contacts: gathered from the stages, stored, read and announced; and impacts of fast motion, stored and read.

mod events;
mod gather;
mod impacts;
mod reading;
mod sides;
mod store;

pub(crate) use events::EVENT_HYSTERESIS;
pub use events::{ContactEventsPlugin, SurfaceContactEnded, SurfaceContactStarted, SurfaceQuarantined};
#[cfg(feature = "rerun")]
pub(crate) use events::{Touching, TouchingSides};
pub use gather::ContactsPlugin;
pub use impacts::{Impact, SurfaceImpacts, SweptImpact, SweptImpacts, SweptPair};
pub use reading::{Contact, SmoothNormals, StencilEntry, SurfaceContacts};
pub(crate) use store::PairOrder;
pub use store::{ContactSide, ContactStore, StoredPair};
