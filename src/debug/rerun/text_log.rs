//! Says in words what has happened: quarantines, contacts that started or ended, thinned layers.
//!
//! Each kind of message is an entity of its own, and a tick's messages of a kind are lines of one text: a reader that keeps
//! one row an entity and tick loses none.

use rerun::{TextLog, TextLogLevel};

use super::{
    recorder::{Layer, Thinned, TickWriter, path},
    tick::Names,
};
use crate::contacts::{SurfaceQuarantined, TouchingSides};

/// The room of all messages in the recording.
pub(super) const LOG: &str = "log";

pub(super) fn contacts(writer: &mut TickWriter, touching: &TouchingSides, names: &Names) {
    let lines = |changes: &[crate::contacts::Touching], what: &str| {
        changes.iter().map(|change| format!("{}: {what}", names.of_pair(change.sides))).collect()
    };
    say(writer, "contacts started", TextLogLevel::INFO, lines(&touching.started, "contact started"));
    say(writer, "contacts ended", TextLogLevel::INFO, lines(&touching.ended, "contact ended"));
}

pub(super) fn quarantines(writer: &mut TickWriter, quarantines: &[&SurfaceQuarantined], names: &Names) {
    let line = |quarantine: &&SurfaceQuarantined| {
        format!("{} is set aside: {}", names.of(quarantine.entity), quarantine.reason)
    };
    say(writer, "quarantines", TextLogLevel::WARN, quarantines.iter().map(line).collect());
}

pub(super) fn thinned(writer: &mut TickWriter, layers: &[(Layer, Thinned)], budget: usize) {
    let line = |&(layer, Thinned { recorded, all }): &(Layer, Thinned)| {
        let layer = layer.name();
        format!("{layer}: {recorded} of {all} recorded, in a budget of {budget} bytes a tick (bytes_per_tick)")
    };
    let lines: Vec<String> = layers.iter().map(line).collect();
    for line in &lines {
        log::warn!("{line}");
    }
    say(writer, "warnings", TextLogLevel::WARN, lines);
}

fn say(writer: &mut TickWriter, kind: &str, level: &str, lines: Vec<String>) {
    if !lines.is_empty() {
        writer.row(path([LOG, kind]), &[&TextLog::new(lines.join("\n")).with_level(level)]);
    }
}
