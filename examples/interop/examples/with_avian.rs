//! Bodies of avian meet cloth and soft bodies, headless.
//!
//! `cargo run --release --manifest-path examples/interop/Cargo.toml --example with_avian`

use circumsphere_interop::scenes::{Avian, play};

fn main() {
    play::<Avian>();
}
