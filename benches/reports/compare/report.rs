//! The results as a table, as verdicts on the project's own limits, and as JSON.

use std::{
    collections::BTreeMap,
    fmt::{self, Display, Formatter},
};

use bevy_circumsphere::ContactMethod;
use serde::Serialize;

use super::{
    input::Input,
    measure::{Counts, Level, Log, Row},
    ours::{COLD, COLD_MOVED, MOVED, UNCHANGED, method_name},
    parry::{REBUILT, STRATEGIES, TRAVERSAL, strategy_name},
    peers::{EMBREE_COLLIDE, RAPIER_NARROW_PHASE},
};

#[derive(Serialize)]
pub struct Report {
    pub input: String,
    pub triangles: usize,
    pub vertices: usize,
    pub frames: Vec<usize>,
    pub mean_edge: f64,
    pub contact_distance: f64,
    /// The row to which all ratios refer: parry's traversal with the faster of its two build strategies.
    pub reference: String,
    pub rows: Vec<RowReport>,
    pub bars: Vec<Bar>,
    /// Speedup by several threads, for each stage.
    pub speedups: Vec<Speedup>,
    /// Contestants that are missing, failed, or disagree, with the reasons.
    pub faults: Vec<String>,
}

#[derive(Serialize)]
pub struct RowReport {
    pub who: String,
    pub what: String,
    pub threads: usize,
    pub level: Level,
    pub samples: usize,
    pub median_ms: f64,
    pub least_ms: f64,
    pub quartiles_ms: [f64; 2],
    /// Median relative to that of the reference.
    pub ratio: f64,
    /// Mean over the frames.
    pub counts: Counts,
    /// Whether the counts of a frame differed between rounds.
    pub is_unsteady: bool,
}

/// A performance limit that the project has set for itself.
#[derive(Serialize)]
pub struct Bar {
    pub what: String,
    pub limit: String,
    /// Ratio of medians; `None` if one of the two was not measured.
    pub ratio: Option<f64>,
    /// Ratio of minima, which other programs disturb less.
    pub least_ratio: Option<f64>,
    pub holds: Option<bool>,
}

/// Time on one thread, divided by the time on several.
#[derive(Serialize)]
pub struct Speedup {
    pub who: String,
    pub what: String,
    pub level: Level,
    pub threads: usize,
    /// Medians on one thread and on several.
    pub milliseconds: [f64; 2],
    pub ratio: f64,
    pub least_ratio: f64,
}

/// Quartile of a sorted list, with linear interpolation.
fn quartile(sorted: &[f64], quarters: usize) -> f64 {
    let place = quarters * (sorted.len() - 1);
    let (low, high) = (sorted[place / 4], sorted[place.div_ceil(4)]);
    low + (high - low) * (place % 4) as f64 / 4.0
}

fn mean_counts(row: &Row) -> Counts {
    let mean = |count: fn(&Counts) -> Option<u64>| {
        let all: Option<Vec<u64>> = row.counts.values().map(count).collect();
        all.filter(|all| !all.is_empty()).map(|all| all.iter().sum::<u64>() / all.len() as u64)
    };
    Counts {
        box_pairs: mean(|counts| counts.box_pairs),
        apart: mean(|counts| counts.apart),
        tested: mean(|counts| counts.tested),
        touching: mean(|counts| counts.touching),
        contacts: mean(|counts| counts.contacts),
    }
}

impl RowReport {
    fn new(row: &Row) -> Self {
        let mut times = row.milliseconds.clone();
        times.sort_by(f64::total_cmp);
        Self {
            who: row.who.clone(),
            what: row.what.clone(),
            threads: row.threads,
            level: row.level,
            samples: times.len(),
            median_ms: quartile(&times, 2),
            least_ms: times[0],
            quartiles_ms: [quartile(&times, 1), quartile(&times, 3)],
            ratio: 0.0,
            counts: mean_counts(row),
            is_unsteady: row.is_unsteady,
        }
    }
}

/// The direction and value of a limit.
#[derive(Clone, Copy)]
enum Limit {
    AtMost(f64),
    AtLeast(f64),
}

impl Report {
    pub fn new(input: &Input, log: &Log, faults: Vec<String>) -> Self {
        let mut rows: Vec<RowReport> = log.rows.iter().map(RowReport::new).collect();
        let reference = rows
            .iter()
            .filter(|row| row.what == TRAVERSAL)
            .min_by(|a, b| a.median_ms.total_cmp(&b.median_ms))
            .map(|row| (row.who.clone(), row.median_ms));
        let (reference, reference_ms) = reference.unwrap_or_default();
        for row in &mut rows {
            row.ratio = row.median_ms / reference_ms;
        }
        // Our methods come first, then parry and all others. Rows of one contestant stay together.
        let mut order: Vec<String> = ContactMethod::ALL.into_iter().map(method_name).collect();
        order.extend(STRATEGIES.map(|strategy| strategy_name(strategy).to_owned()));
        for row in &rows {
            if !order.contains(&row.who) {
                order.push(row.who.clone());
            }
        }
        rows.sort_by_key(|row| (order.iter().position(|who| *who == row.who), row.threads));
        let mut report = Self {
            input: input.name.clone(),
            triangles: input.triangles.len(),
            vertices: input.vertices,
            frames: input.ticks.iter().map(|tick| tick.frame).collect(),
            mean_edge: input.mean_edge,
            contact_distance: input.contact_distance,
            reference,
            rows,
            bars: Vec::new(),
            speedups: Vec::new(),
            faults,
        };
        report.bars = report.answer_bars();
        report.speedups = report.compare_threads();
        let disagreements = report.disagreements();
        report.faults.extend(disagreements);
        report
    }

    fn row(&self, (who, what, threads): (&str, &str, usize)) -> Option<&RowReport> {
        self.rows.iter().find(|row| row.who == who && row.what == what && row.threads == threads)
    }

    /// Contestants whose counts differ although they must agree: box pairs for all contestants, and touching pairs at
    /// the measured positions for our exact methods.
    fn disagreements(&self) -> Vec<String> {
        let exact: Vec<String> =
            ContactMethod::ALL.into_iter().filter(|method| method.is_exact()).map(method_name).collect();
        let boxes = self.rows.iter().map(|row| (row, row.counts.box_pairs, "pairs of boxes"));
        let touching = self
            .rows
            .iter()
            .filter(|row| row.what == COLD && exact.contains(&row.who))
            .map(|row| (row, row.counts.touching, "touching pairs"));
        let mut first: BTreeMap<&str, u64> = BTreeMap::new();
        boxes
            .chain(touching)
            .filter_map(|(row, count, what)| {
                let count = count?;
                let others = *first.entry(what).or_insert(count);
                let RowReport { who, what: row, threads, .. } = row;
                (count != others)
                    .then(|| format!("{who}, {row}, threads {threads}: {count} {what}, but others have {others}"))
            })
            .collect()
    }

    fn compare_threads(&self) -> Vec<Speedup> {
        let ours = ContactMethod::ALL.map(method_name);
        // Only the cold tick has rows for its stages.
        let is_told = |row: &&RowReport| row.level == Level::Part || row.what == COLD;
        let several = self.rows.iter().filter(|row| row.threads > 1 && ours.contains(&row.who)).filter(is_told);
        several
            .filter_map(|row| {
                let one = self.row((&row.who, &row.what, 1))?;
                Some(Speedup {
                    who: row.who.clone(),
                    what: row.what.clone(),
                    level: row.level,
                    threads: row.threads,
                    milliseconds: [one.median_ms, row.median_ms],
                    ratio: one.median_ms / row.median_ms,
                    least_ratio: one.least_ms / row.least_ms,
                })
            })
            .collect()
    }

    fn answer_bars(&self) -> Vec<Bar> {
        let most_threads = self.rows.iter().filter(|row| row.what == COLD).map(|row| row.threads).max().unwrap_or(1);
        let names = ContactMethod::ALL.map(method_name);
        let [balls, caps, _, refined, polygon] = names.each_ref().map(String::as_str);
        let reference = (self.reference.as_str(), TRAVERSAL, 1);
        let cold = (refined, COLD, 1);
        let mut bars = vec![
            ("Exact, cold / reference", cold, reference, Limit::AtMost(2.0), "≤ 2.0, goal 1.5"),
            ("Circumsphere, cold / reference", (caps, COLD, 1), reference, Limit::AtMost(1.3), "≤ 1.3"),
            ("BoundingSphere, cold / reference", (balls, COLD, 1), reference, Limit::AtMost(0.9), "≤ 0.9"),
            ("Polygon, cold / Exact, cold", (polygon, COLD, 1), cold, Limit::AtLeast(8.0), "≥ 8"),
            (
                "rapier's narrow phase / Exact, cold",
                (RAPIER_NARROW_PHASE.0, RAPIER_NARROW_PHASE.1, 1),
                cold,
                Limit::AtLeast(6.0),
                "≥ 6, goal 10",
            ),
            (
                "parry rebuilt + distances / Exact, cold",
                ("parry", REBUILT, 1),
                cold,
                Limit::AtLeast(6.0),
                "≥ 6, goal 10",
            ),
            (
                "Embree's collide / Exact, cold",
                (EMBREE_COLLIDE.0, EMBREE_COLLIDE.1, 1),
                cold,
                Limit::AtLeast(1.0),
                "> 1",
            ),
            ("Exact, moved / cold", (refined, MOVED, 1), (refined, COLD_MOVED, 1), Limit::AtMost(0.35), "≤ 0.35"),
            (
                "Exact, unchanged / cold",
                (refined, UNCHANGED, 1),
                (refined, COLD_MOVED, 1),
                Limit::AtMost(0.01),
                "≤ 0.01",
            ),
        ];
        if most_threads > 1 {
            let pooled = (refined, COLD, most_threads);
            bars.push(("Exact, cold, one thread / several", cold, pooled, Limit::AtLeast(1.7), "≥ 1.7 on two"));
        }
        bars.into_iter()
            .map(|(what, over, under, limit, text)| {
                let rows = self.row(over).zip(self.row(under));
                let ratio = rows.map(|(over, under)| over.median_ms / under.median_ms);
                let holds = ratio.map(|ratio| match limit {
                    Limit::AtMost(most) => ratio <= most,
                    Limit::AtLeast(least) => ratio >= least,
                });
                let least_ratio = rows.map(|(over, under)| over.least_ms / under.least_ms);
                Bar { what: what.to_owned(), limit: text.to_owned(), ratio, least_ratio, holds }
            })
            .collect()
    }
}

/// A number with its digits in groups of three.
pub fn grouped(count: u64) -> String {
    let digits = count.to_string();
    let mut text = String::new();
    for (place, digit) in digits.chars().enumerate() {
        if place > 0 && (digits.len() - place).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// A time or ratio with three significant digits.
pub fn short(value: f64) -> String {
    match value {
        value if !value.is_finite() => "-".to_owned(),
        value if value >= 99.95 => format!("{value:.0}"),
        value if value >= 9.995 => format!("{value:.1}"),
        value if value >= 0.1 => format!("{value:.2}"),
        value => format!("{value:.4}"),
    }
}

/// Writes a table of bars, with whether each holds.
pub fn write_bars(out: &mut Formatter<'_>, bars: &[Bar]) -> fmt::Result {
    let width = bars.iter().map(|bar| bar.what.chars().count()).max().unwrap_or_default();
    writeln!(out, "{:width$} {:>18} {:>10} {:>10}", "bar", "", "medians", "minima")?;
    for bar in bars {
        let ratio = |ratio: Option<f64>| ratio.map_or_else(|| "-".to_owned(), short);
        let verdict = match bar.holds {
            Some(true) => "holds",
            Some(false) => "does not hold",
            None => "not measured",
        };
        let (of_medians, of_minima) = (ratio(bar.ratio), ratio(bar.least_ratio));
        writeln!(out, "{:width$} {:>18} {of_medians:>10} {of_minima:>10}  {verdict}", bar.what, bar.limit)?;
    }
    Ok(())
}

impl Display for Report {
    fn fmt(&self, out: &mut Formatter<'_>) -> fmt::Result {
        let frames: Vec<String> = self.frames.iter().map(usize::to_string).collect();
        writeln!(
            out,
            "\n{}: {} triangles, {} vertices, frame {}, contact distance {:.6} ({:.3} mean edges)",
            self.input,
            grouped(self.triangles as u64),
            grouped(self.vertices as u64),
            frames.join(" "),
            self.contact_distance,
            self.contact_distance / self.mean_edge
        )?;
        // The instruction set accounts for about a third of the time.
        let level = format!("{:?}", fearless_simd::Level::new());
        let level = level.split('(').next().unwrap_or_default();
        writeln!(
            out,
            "instruction set of our methods: {level}, chosen at run time; peers use the one they were compiled for"
        )?;
        writeln!(out, "reference (×1): {}, {TRAVERSAL}\n", self.reference)?;
        writeln!(
            out,
            "{:72} {:>3} {:>8} {:>8} {:>8} {:>8} {:>7} {:>4}  {:>10} {:>10} {:>10} {:>10} {:>10}",
            "", "thr", "median", "min", "q1", "q3 ms", "×", "n", "box pairs", "apart", "tested", "touching", "contacts"
        )?;
        let count = |count: Option<u64>| count.map_or_else(|| "-".to_owned(), grouped);
        for row in &self.rows {
            let [low, high] = row.quartiles_ms;
            let name = match row.level {
                Level::Whole => format!("{}: {}", row.who, row.what),
                Level::Part => format!("    {}", row.what),
            };
            let counts = &row.counts;
            writeln!(
                out,
                "{name:72} {:>3} {:>8} {:>8} {:>8} {:>8} {:>7} {:>4}  {:>10} {:>10} {:>10} {:>10} {:>10}{}",
                row.threads,
                short(row.median_ms),
                short(row.least_ms),
                short(low),
                short(high),
                short(row.ratio),
                row.samples,
                count(counts.box_pairs),
                count(counts.apart),
                count(counts.tested),
                count(counts.touching),
                count(counts.contacts),
                if row.is_unsteady { "  counts vary!" } else { "" }
            )?;
        }
        writeln!(out)?;
        write_bars(out, &self.bars)?;
        if let Some(threads) = self.speedups.first().map(|speedup| speedup.threads) {
            writeln!(
                out,
                "\n{:48} {:>10} {:>10} {:>10} {:>10}",
                "one thread / several", "one ms", threads, "medians", "minima"
            )?;
        }
        for speedup in &self.speedups {
            let name = match speedup.level {
                Level::Whole => format!("{}: {}", speedup.who, speedup.what),
                Level::Part => format!("    {}", speedup.what),
            };
            let [one, several] = speedup.milliseconds.map(short);
            let (ratio, least_ratio) = (short(speedup.ratio), short(speedup.least_ratio));
            writeln!(out, "{name:48} {one:>10} {several:>10} {ratio:>10} {least_ratio:>10}")?;
        }
        for fault in &self.faults {
            writeln!(out, "{fault}")?;
        }
        Ok(())
    }
}
