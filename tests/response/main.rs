//! The response in headless worlds: motion against closed forms, contacts and friction, fast bodies, and stability.

mod contact;
mod forces;
mod harness;
mod holds;
mod inside;
mod jump;
mod motion;
mod rest;
mod rigid_mass;
mod shots;
mod sleep;
mod stability;
mod swept;
#[cfg(feature = "parallel")]
mod threads;
mod truth;
mod tumbling;
mod untangle;
mod walking;
