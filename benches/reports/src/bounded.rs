//! Reading measured curves between and beyond their points: what one method needs for the error of another.
//!
//! Between two points, a curve is a straight line in logarithms. Beyond its ends, only a bound is known.

use std::fmt::{self, Display, Formatter};

use serde::Serialize;

use crate::finding::{figure, geometric_mean};

/// Which side of a value the truth is on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Bound {
    Exactly,
    MoreThan,
    LessThan,
}

/// A value that may be a bound.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Bounded {
    pub value: f64,
    pub bound: Bound,
}

impl Display for Bounded {
    fn fmt(&self, out: &mut Formatter<'_>) -> fmt::Result {
        let text = figure(self.value);
        match self.bound {
            Bound::Exactly => out.write_str(&text),
            Bound::MoreThan => write!(out, "more than {text}"),
            Bound::LessThan => write!(out, "less than {text}"),
        }
    }
}

impl Bounded {
    /// A value that is no bound.
    #[must_use]
    pub const fn exactly(value: f64) -> Self {
        Self { value, bound: Bound::Exactly }
    }

    /// Their ratio, unless both may be off in ways that leave it open.
    #[must_use]
    pub fn over(self, other: Self) -> Option<Self> {
        let bound = match (self.bound, other.bound) {
            (Bound::Exactly, Bound::Exactly) => Bound::Exactly,
            (Bound::Exactly | Bound::MoreThan, Bound::Exactly | Bound::LessThan) => Bound::MoreThan,
            (Bound::Exactly | Bound::LessThan, Bound::Exactly | Bound::MoreThan) => Bound::LessThan,
            (Bound::MoreThan, Bound::MoreThan) | (Bound::LessThan, Bound::LessThan) => return None,
        };
        Some(Self { value: self.value / other.value, bound })
    }

    /// The geometric mean. `None` for an empty list, and if some are bounds from above and others from below.
    pub fn geometric_mean(all: &[Self]) -> Option<Self> {
        let has = |bound| all.iter().any(|one| one.bound == bound);
        let bound = match (has(Bound::MoreThan), has(Bound::LessThan)) {
            (false, false) => Bound::Exactly,
            (true, false) => Bound::MoreThan,
            (false, true) => Bound::LessThan,
            (true, true) => return None,
        };
        Some(Self { value: geometric_mean(all.iter().map(|one| one.value), 0.0)?, bound })
    }
}

/// The value of a curve at an error. The curve has an error and a value for each resolution, coarse to fine.
/// Errors below `least` count as `least`.
pub fn at_error(curve: &[(f64, f64)], error: f64, least: f64) -> Option<Bounded> {
    let error = error.max(least);
    let curve: Vec<(f64, f64)> = curve.iter().map(|&(error, value)| (error.max(least), value)).collect();
    let (&(coarsest, value), &(_, finest_value)) = (curve.first()?, curve.last()?);
    if error > coarsest {
        return Some(Bounded { value, bound: Bound::LessThan });
    }
    for pair in curve.windows(2) {
        let [(error_before, before), (error_after, after)] = [pair[0], pair[1]];
        if error_before >= error && error >= error_after {
            let span = (error_before / error_after).ln();
            let share = if span > 0.0 { (error_before / error).ln() / span } else { 0.0 };
            return Some(Bounded::exactly(before * (after / before).powf(share)));
        }
    }
    Some(Bounded { value: finest_value, bound: Bound::MoreThan })
}
