//! A tick takes no more bytes than it may, and what no longer fits is thinned evenly.
//!
//! Measured are the bytes that a file would hold, uncompressed, with each row in a chunk of its own: ticks that are far
//! apart in time are written like that, faster ones share what chunks have beside their numbers.

use std::collections::BTreeMap;

use bevy_circumsphere::{
    debug::{LevelOfDetail, RerunSettings},
    prelude::*,
};
use bevy_ecs::prelude::*;
use rerun::{
    external::re_log_encoding::rrd::{Encoder, EncodingOptions},
    log::LogMsg,
};

use crate::{
    recording::Recording,
    world::{Recorded, Scene, everything},
};

/// What rows of a kind took.
#[derive(Clone, Copy, Debug, Default)]
struct Taken {
    rows: usize,
    /// As they are encoded.
    bytes: usize,
    /// The numbers alone.
    numbers: usize,
    /// Of one row the most beside its numbers.
    most_beside: usize,
}

/// The bytes of a tick's rows, by the first part of the path; `cleared` for what is removed, `timeless` for what is
/// recorded once.
fn taken(recording: &Recording) -> BTreeMap<String, Taken> {
    let mut encoder =
        Encoder::new_eager(rerun::build_info().version, EncodingOptions::PROTOBUF_UNCOMPRESSED, Vec::new())
            .expect("memory can be written to");
    let mut taken: BTreeMap<String, Taken> = BTreeMap::new();
    for message in recording.messages.iter().filter(|message| message.store_id().is_recording()) {
        let bytes = encoder.append(message).expect("it can be encoded") as usize;
        if !matches!(message, LogMsg::ArrowMsg(..)) {
            continue;
        }
        let single = Recording::of(vec![message.clone()]);
        let [row] = single.rows.as_slice() else { panic!("a chunk of a tick has {} rows", single.rows.len()) };
        let kind = if row.times.is_empty() {
            "timeless"
        } else if single.clears().len() == 1 {
            "cleared"
        } else {
            row.path[0].as_str()
        };
        let numbers = row.components.bytes();
        let of_kind = taken.entry(kind.to_owned()).or_default();
        of_kind.rows += 1;
        of_kind.bytes += bytes;
        of_kind.numbers += numbers;
        of_kind.most_beside = of_kind.most_beside.max(bytes - numbers);
    }
    taken
}

/// What is recorded whatever the budget, and the rest.
fn split(taken: &BTreeMap<String, Taken>) -> (usize, usize) {
    let is_always = |kind: &str| ["timeless", "cleared", "series", "log"].contains(&kind);
    let sum = |always: bool| {
        taken.iter().filter(|(kind, _)| is_always(kind) == always).map(|(_, taken)| taken.bytes).sum::<usize>()
    };
    (sum(true), sum(false))
}

#[test]
fn print_bytes() {
    for (label, settings) in [("default", RerunSettings::default()), ("everything", everything())] {
        for method in [ContactMethod::Circumsphere, ContactMethod::Refined] {
            let mut recorded = Recorded::new(settings.clone());
            let scene = Scene::spawn(&mut recorded.app, method);
            for tick in 0..4 {
                scene.advance(&mut recorded.app, tick);
                recorded.tick();
                let taken = taken(&recorded.last);
                println!("{label} {method:?} tick {tick}: {:?}", split(&taken));
                for (kind, taken) in taken {
                    println!("   {kind}: {taken:?} beside per row {}", (taken.bytes - taken.numbers) / taken.rows);
                }
            }
        }
    }
}
