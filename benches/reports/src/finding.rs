//! The conclusion of an experiment: a claim, the result, and whether the claim holds, all generated from the figures.

use std::fmt::{self, Display, Formatter};

use super::statistics::mean;

/// Whether a claim holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    Holds,
    /// Part of the claim holds.
    HoldsInPart,
    Fails,
    /// The difference is within chance.
    Undecided,
}

impl Outcome {
    /// Outcome of a claim with several parts.
    pub fn all(parts: &[Self]) -> Self {
        let count = |outcome| parts.iter().filter(|&&part| part == outcome).count();
        if count(Self::Holds) == parts.len() {
            Self::Holds
        } else if count(Self::Holds) > 0 {
            Self::HoldsInPart
        } else if count(Self::Fails) == 0 {
            Self::Undecided
        } else {
            Self::Fails
        }
    }
}

/// Whether an event is less frequent in one of two series of paired trials (a sign test). Only trials in which it
/// happened in exactly one series count. Chance splits those evenly, to within twice the square root of their number.
pub fn happens_less<'a>(own: impl IntoIterator<Item = &'a bool>, other: impl IntoIterator<Item = &'a bool>) -> Outcome {
    let (mut own_alone, mut other_alone) = (0_i32, 0_i32);
    for (&own, &other) in own.into_iter().zip(other) {
        own_alone += i32::from(own && !other);
        other_alone += i32::from(other && !own);
    }
    let chance = 2.0 * f64::from(own_alone + other_alone).sqrt();
    let difference = f64::from(other_alone - own_alone);
    if difference.abs() <= chance {
        Outcome::Undecided
    } else if difference > 0.0 {
        Outcome::Holds
    } else {
        Outcome::Fails
    }
}

impl Display for Outcome {
    fn fmt(&self, out: &mut Formatter<'_>) -> fmt::Result {
        out.write_str(match self {
            Self::Holds => "holds",
            Self::HoldsInPart => "holds in part",
            Self::Fails => "does not hold",
            Self::Undecided => "inconclusive: within chance",
        })
    }
}

/// The sentence that concludes an experiment.
#[derive(Clone, Debug, PartialEq)]
pub struct Finding {
    pub claim: String,
    pub found: String,
    pub outcome: Outcome,
}

impl Display for Finding {
    fn fmt(&self, out: &mut Formatter<'_>) -> fmt::Result {
        write!(out, "**Claim:** {}; **found:** {}; **{}**.", self.claim, self.found, self.outcome)
    }
}

/// A number rounded to three significant digits, keeping all integer digits. Very small and very large numbers are in
/// scientific notation.
pub fn figure(value: f64) -> String {
    let size = value.abs();
    if size == 0.0 {
        "0".to_owned()
    } else if (1.0e-3..1.0e5).contains(&size) {
        let digits = match size {
            100.0.. => 0,
            10.0.. => 1,
            1.0.. => 2,
            0.1.. => 3,
            0.01.. => 4,
            _ => 5,
        };
        let text = format!("{value:.digits$}");
        if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
    } else {
        format!("{value:.1e}")
    }
}

/// [`figure`], or a dash for `None`.
pub fn optional(value: Option<f64>) -> String {
    value.map_or_else(|| "–".to_owned(), figure)
}

/// A share in percent, formatted by [`figure`].
pub fn percent(share: f64) -> String {
    format!("{} %", figure(100.0 * share))
}

/// The geometric mean. Numbers below `least` count as `least`.
pub fn geometric_mean(values: impl IntoIterator<Item = f64>, least: f64) -> Option<f64> {
    mean(values.into_iter().map(|value| value.max(least).ln())).map(f64::exp)
}

/// A Markdown table.
pub fn table(header: &[String], rows: impl IntoIterator<Item = Vec<String>>) -> String {
    let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
    let rule: Vec<String> =
        (0..header.len()).map(|column| if column == 0 { "---" } else { "---:" }.to_owned()).collect();
    let rows: String = rows.into_iter().map(|row| line(&row)).collect();
    line(header) + &line(&rule) + &rows
}
