//! Bodies of rapier meet cloth and soft bodies, headless.
//!
//! `cargo run --release --manifest-path examples/interop/Cargo.toml --example with_rapier`

use circumsphere_interop::scenes::{Rapier, play};

fn main() {
    play::<Rapier>();
}
