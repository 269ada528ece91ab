//! Contacts and impacts: how they are stored, read, and announced.
//!
//! The last stage of detection gathers contacts into the [`ContactStore`]. Systems read them through
//! [`SurfaceContacts`], and impacts through [`SurfaceImpacts`]. Messages and events are sent at the end of the tick.

mod events;
mod gather;
mod impacts;
mod reading;
mod reductions;
mod sides;
mod store;

#[cfg(feature = "rerun")]
pub(crate) use events::Touching;
pub(crate) use events::TouchingSides;
pub use events::{ContactEventsPlugin, SurfaceContactEnd, SurfaceContactStart};
pub use gather::ContactsPlugin;
pub use impacts::{Impact, SurfaceImpacts};
pub use reading::{Contact, SmoothNormals, StencilEntry, SurfaceContacts};
pub use store::{ContactStore, StoredPair};
