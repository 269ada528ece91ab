//! Rounds of measurements: everyone once a round, so that what disturbs the machine disturbs all alike.

use std::{
    collections::BTreeMap,
    time::{Duration, Instant},
};

use serde::Serialize;

use super::input::{Input, Tick};

/// Whoever takes longer than this for a round takes part only in the first [`ROUNDS_OF_THE_SLOW`] of them.
const SLOW: Duration = Duration::from_millis(2500);

const ROUNDS_OF_THE_SLOW: u32 = 7;

/// What was found in a tick. `None` where a row does not count it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Counts {
    /// Pairs of triangles whose grown boxes overlap, neighbors included.
    pub box_pairs: Option<u64>,
    /// Those of them that share no vertex.
    pub apart: Option<u64>,
    /// Pairs that were tested exactly.
    pub tested: Option<u64>,
    /// Pairs that touch.
    pub touching: Option<u64>,
    /// Contacts, feature pair by feature pair.
    pub contacts: Option<u64>,
}

/// What a row is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Level {
    /// A whole that can be compared with other wholes.
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
    /// By frame.
    pub counts: BTreeMap<usize, Counts>,
    /// Whether a frame once counted otherwise than another time.
    pub is_unsteady: bool,
}

/// All lines, in the order in which they were first heard of.
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

/// Someone who finds pairs.
pub trait Contestant {
    /// Its name in messages.
    fn name(&self) -> String;

    /// Finds the pairs of a tick, `place` its number among the input's, after having seen the state before it.
    fn run(&mut self, place: usize, tick: &Tick, log: &mut Log) -> Result<(), String>;
}

/// Runs `operation` and says how long it took.
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

/// All rounds. `report` hears what goes on. Also gives who failed, and why.
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
                // Nobody always comes after the same one.
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
