//! The response in headless worlds: motion against closed forms, contacts and friction, fast bodies, and what must not
//! blow up.

mod contact;
mod harness;
mod motion;
mod rest;
mod stability;
mod swept;
mod untangle;
