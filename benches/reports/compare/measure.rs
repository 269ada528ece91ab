//! Rounds of measurements. Each contestant runs once per round, so that disturbances of the machine affect all alike.

use std::{
    collections::BTreeMap,
    time::{Duration, Instant},
};

use serde::Serialize;

use super::input::{Input, Tick};

/// Contestants whose round takes longer than this run only in the first [`ROUNDS_OF_THE_SLOW`] rounds.
const SLOW: Duration = Duration::from_millis(2500);

const ROUNDS_OF_THE_SLOW: u32 = 7;

/// Counts of what was found in a tick. `None` if a row does not count it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Counts {
    /// Pairs of triangles with overlapping grown boxes, including neighbors.
    pub box_pairs: Option<u64>,
    /// Box pairs that share no vertex.
    pub apart: Option<u64>,
    /// Pairs that were tested exactly.
    pub tested: Option<u64>,
    /// Touching pairs.
    pub touching: Option<u64>,
    /// Contacts, one per feature pair.
    pub contacts: Option<u64>,
}

/// Level of a row.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Level {
    /// A whole operation, comparable with other wholes.
    Whole,
    /// A part of the whole above it.
    Part,
}

/// One line of the table.
#[derive(Clone, Debug)]
pub struct Row {
    pub who: String,
    pub what: String,
    pub threads: usize,
    pub level: Level,
    pub milliseconds: Vec<f64>,
    /// Counts by frame.
    pub counts: BTreeMap<usize, Counts>,
    /// Whether the counts of a frame differed between rounds.
    pub is_unsteady: bool,
}

/// All lines, in the order of their first entry.
#[derive(Default)]
pub struct Log {
    pub rows: Vec<Row>,
    frame: usize,
}

impl Log {
    pub fn add(&mut self, who: &str, what: &str, threads: usize, level: Level, duration: Duration, counts: Counts) {
        let is_it = |row: &Row| row.who == who && row.what == what && row.threads == threads;
        let place = self.rows.iter().position(is_it).unwrap_or_else(|| {
            self.rows.push(Row {
                who: who.to_owned(),
                what: what.to_owned(),
                threads,
                level,
                milliseconds: Vec::new(),
                counts: BTreeMap::new(),
                is_unsteady: false,
            });
            self.rows.len() - 1
        });
        let row = &mut self.rows[place];
        row.milliseconds.push(duration.as_secs_f64() * 1.0e3);
        row.is_unsteady |= *row.counts.entry(self.frame).or_insert(counts) != counts;
    }
}

/// A library or method that takes part in the comparison.
pub trait Contestant {
    /// Its name in messages.
    fn name(&self) -> String;

    /// Finds the pairs of a tick, starting from the state before it. `place` is the index of the tick in the input.
    fn run(&mut self, place: usize, tick: &Tick, log: &mut Log) -> Result<(), String>;
}

/// Runs `operation` and returns its duration and result.
pub fn timed<T>(operation: impl FnOnce() -> T) -> (Duration, T) {
    let start = Instant::now();
    let result = std::hint::black_box(operation());
    (start.elapsed(), result)
}

struct Entry {
    contestant: Box<dyn Contestant>,
    rounds: u32,
    longest: Duration,
    fault: Option<String>,
}

/// Plays all rounds. `report` receives progress messages. Also returns which contestants failed, and why.
pub fn play(
    input: &Input,
    contestants: Vec<Box<dyn Contestant>>,
    rounds: u32,
    mut report: impl FnMut(&str),
) -> (Log, Vec<String>) {
    let mut log = Log::default();
    let mut entries: Vec<Entry> = contestants
        .into_iter()
        .map(|contestant| Entry { contestant, rounds: 0, longest: Duration::ZERO, fault: None })
        .collect();
    let count = entries.len();
    for round in 0..rounds {
        for (place, tick) in input.ticks.iter().enumerate() {
            log.frame = tick.frame;
            for turn in 0..count {
                // Rotate the order, so that no contestant always runs after the same one.
                let entry = &mut entries[if round == 0 { turn } else { (turn + round as usize) % count }];
                if entry.fault.is_some() || (entry.longest > SLOW && entry.rounds >= ROUNDS_OF_THE_SLOW) {
                    continue;
                }
                let name = entry.contestant.name();
                report(&format!("round {} of {rounds}, frame {}: {name}", round + 1, tick.frame));
                let (duration, outcome) = timed(|| entry.contestant.run(place, tick, &mut log));
                entry.fault = outcome.err().map(|error| format!("{name}: {error}"));
                entry.longest = entry.longest.max(duration);
                if place + 1 == input.ticks.len() {
                    entry.rounds += 1;
                }
            }
        }
    }
    (log, entries.into_iter().filter_map(|entry| entry.fault).collect())
}
