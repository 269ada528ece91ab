//! The response leaves out what filters leave out.

mod rest;
