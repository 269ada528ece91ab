//! The arithmetic of extended position-based dynamics: particles and their constraints, eight side by side.
//!
//! Everything is in f32, and exact enough at any distance from the origin: a particle is its displacement since the
//! beginning of the tick, and a constraint knows the vectors between its particles at that time, which are computed in
//! f64. A displacement of a centimeter is exact to a nanometer, so velocities, which are differences of displacements
//! over a substep, are exact to a micrometer per second.
//!
//! For a constraint `C` with compliance `α` in a substep `h`, `Δλ = (−C − α̃ λ) / (Σ w |∇C|² + α̃)` with `α̃ = α / h²`,
//! and every particle moves by `w ∇C Δλ` (Macklin, Müller and Chentanez 2016, "XPBD"). Constraints of one [color](coloring)
//! have no particle in common. They are solved color after color, so the result does not depend on how many of a color
//! are solved at a time.

mod acting;
mod attachments;
pub mod coloring;
mod contacts;
mod features;
mod hinges;
mod lists;
mod rigid_bodies;
mod rows;
mod slabs;
mod springs;
mod tethers;
mod tetrahedra;
mod volume;
mod wind;

pub use acting::{Evaluation, MOST_LEVER};
pub use attachments::Attachments;
pub use contacts::{At, Contact, FeatureParticles, Plane};
pub use features::FeatureKind;
pub use hinges::{HingeRests, Hinges, bend_at};
pub use lists::{Contacts, FoundContacts};
pub use rigid_bodies::{Deviation, OnBody, RigidBodies, RigidBody};
pub use rows::{MovingRows, ParticleRows, Placed, Starts};
pub use slabs::{Place, Slabs};
pub use springs::{SpringRests, Springs};
pub use tethers::{Tethered, Tethers};
pub use tetrahedra::{Elasticity, Tetrahedra, TetrahedronRest, TetrahedronRests};
pub use volume::{VolumeRest, Volumes};
pub use wind::{Air, SailRests, Sails};
