//! The response in headless worlds: motion against closed forms, contacts, friction, and what must not blow up.

mod harness;
mod stability;
