//! Text log: quarantines, contacts that started or ended, and thinned layers.
//!
//! Each kind of message has its own entity, and all messages of a kind and tick are lines of one text. So a reader that
//! keeps one row per entity and tick loses none. The log view is narrow, so the important part is at the start of a
//! line.

use std::collections::BTreeSet;

use rerun::{TextLog, TextLogLevel};

use super::{
    names::Names,
    recorder::{Layer, Thinned, TickWriter, path},
};
use crate::{contacts::TouchingSides, surface::SurfaceQuarantined};

/// The root entity of all messages.
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
        format!("{} is set aside:\n{}", names.of(quarantine.entity), quarantine.reason)
    };
    say(writer, "quarantines", TextLogLevel::WARN, quarantines.iter().map(line).collect());
}

/// `warned` are the layers that the game's own log has already been warned about.
pub(super) fn thinned(
    writer: &mut TickWriter,
    layers: &[(Layer, Thinned)],
    budget: usize,
    warned: &mut BTreeSet<Layer>,
) {
    let line = |&(layer, Thinned { recorded, all }): &(Layer, Thinned)| {
        format!("{}: {recorded} of {all} recorded", layer.name())
    };
    for thinned in layers.iter().filter(|&&(layer, _)| warned.insert(layer)) {
        log::warn!("{}, to stay within {budget} bytes per tick (RerunSettings::bytes_per_tick)", line(thinned));
    }
    let mut lines: Vec<String> = layers.iter().map(line).collect();
    if !lines.is_empty() {
        lines.push(format!("to stay within {budget} bytes per tick\n(RerunSettings::bytes_per_tick)"));
    }
    say(writer, "warnings", TextLogLevel::WARN, lines);
}

fn say(writer: &mut TickWriter, kind: &str, level: &str, lines: Vec<String>) {
    if !lines.is_empty() {
        writer.row(path([LOG, kind]), &[&TextLog::new(lines.join("\n")).with_level(level)]);
    }
}
