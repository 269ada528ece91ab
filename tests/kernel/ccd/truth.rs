//! First times of impact against the times that the reference certifies.

use super::families::{FAMILIES, KINDS, Kind, Motion, motion};
use crate::common::{CATEGORIES, Random, hard_pair};
use bevy_circumsphere::kernel::ccd::{CommonVertices, ImpactCause, MovingTriangle, triangle_pair_impact};
use circumsphere_truth::{ImpactTruth, edge_edge_impact, triangle_impact, vertex_face_impact};
use glam::DVec3;

/// How far above the separation features may be at a reported time of impact, relative to their size: the kernel's
/// resolution of 1.4e-14, plus the error of normals at corners and on flat features (1e-13 in a million). Only searches
/// that were cut short may end farther away.
const CLOSE: f64 = 1.0e-12;

/// The number of motions of each family, kind and separation.
const COUNT: usize = 1_600;

/// The environment variable that overrides [`COUNT`].
const COUNT_VARIABLE: &str = "CIRCUMSPHERE_IMPACTS";

/// The outcome of a number of questions.
#[derive(Default)]
struct Score {
    questions: usize,
    impacts: usize,
    never: usize,
    undecided: usize,
    missed: usize,
    late: usize,
    false_impacts: usize,
    cut_short: usize,
    /// The largest relative distance above the separation at a time of impact.
    farthest: f64,
    /// How long before the end of the reference's interval each impact was reported, where that interval is narrow.
    before_last: Vec<f64>,
    /// How long before the start of the reference's interval each impact was reported, at least 0.
    before_first: Vec<f64>,
}

/// A reference interval of at most this length counts as a single time. The reference bisects to 1e-11. Where features
/// touch within rounding before they certainly meet, the interval lasts until they do.
const NARROW: f64 = 1.0e-9;

impl Score {
    /// Compares one answer and returns whether it is wrong in the way that lets things pass through each other.
    fn add(&mut self, truth: ImpactTruth, time: Option<f64>) -> bool {
        self.questions += 1;
        match (truth, time) {
            (ImpactTruth::First { earliest, latest }, Some(time)) => {
                self.impacts += 1;
                self.late += usize::from(time > latest);
                self.before_first.push((earliest - time).max(0.0));
                if latest - earliest < NARROW {
                    self.before_last.push(latest - time);
                }
                time > latest
            }
            (ImpactTruth::First { .. }, None) => {
                self.missed += 1;
                true
            }
            (ImpactTruth::Never, time) => {
                self.never += 1;
                self.false_impacts += usize::from(time.is_some());
                false
            }
            (ImpactTruth::Undecided { .. }, _) => {
                self.undecided += 1;
                false
            }
        }
    }

    fn append(&mut self, other: Self) {
        self.questions += other.questions;
        self.impacts += other.impacts;
        self.never += other.never;
        self.undecided += other.undecided;
        self.missed += other.missed;
        self.late += other.late;
        self.false_impacts += other.false_impacts;
        self.cut_short += other.cut_short;
        self.farthest = self.farthest.max(other.farthest);
        self.before_last.extend(other.before_last);
        self.before_first.extend(other.before_first);
    }

    fn print(&mut self, name: &str) {
        let percentiles = |values: &mut Vec<f64>| {
            values.sort_unstable_by(f64::total_cmp);
            let last = values.len().saturating_sub(1);
            [500, 990, 999, 1000]
                .map(|share| format!("{:.0e}", values.get(last * share / 1000).unwrap_or(&0.0)))
                .join(" ")
        };
        println!(
            "{name}: {} questions, {} impacts ({} missed, {} late), {} never ({} false), {} left open by \
             the truth, {} cut short, at most {:.0e} apart; before its last time, median, 99 %, 99.9 %, most: {}; before its first {}",
            self.questions,
            self.impacts,
            self.missed,
            self.late,
            self.never,
            self.false_impacts,
            self.undecided,
            self.cut_short,
            self.farthest,
            percentiles(&mut self.before_last),
            percentiles(&mut self.before_first),
        );
    }
}

fn truth(motion: &Motion, separation: f64) -> ImpactTruth {
    match motion.kind {
        Kind::VertexFace => vertex_face_impact(&motion.start, &motion.end, separation),
        Kind::EdgeEdge => edge_edge_impact(&motion.start, &motion.end, separation),
    }
}

#[test]
fn features_meet_no_later_than_the_reference_certifies_and_are_close_when_they_do() {
    let count = std::env::var(COUNT_VARIABLE).map_or(COUNT, |count| count.parse().expect("a number of motions"));
    let mut random = Random::new(41);
    let mut all = Score::default();
    for (family, name) in FAMILIES.into_iter().enumerate() {
        let mut score = Score::default();
        for kind in KINDS {
            for relative in [0.0, 1.0e-3, 0.05] {
                for _ in 0..count {
                    let motion = motion(&mut random, family, kind);
                    let separation = relative * motion.size();
                    let (truth, impact) = (truth(&motion, separation), motion.impact(separation));
                    let wrong = score.add(truth, impact.map(|impact| impact.time));
                    assert!(!wrong, "{name}: {impact:?} where {truth:?} is certified: {motion:?}, {separation}");
                    let Some(impact) = impact else { continue };
                    if impact.cause == ImpactCause::Undecided {
                        score.cut_short += 1;
                    } else {
                        let above = motion.distance_at(impact.time) - separation;
                        score.farthest = score.farthest.max(above / motion.size().max(f64::MIN_POSITIVE));
                    }
                }
            }
        }
        score.print(name);
        all.append(score);
    }
    all.print("all");
    assert!(all.questions >= 100_000 && all.impacts * 3 > all.questions && all.never * 3 > all.questions);
    assert_eq!((all.missed, all.late), (0, 0));
    assert!(all.farthest < CLOSE, "{}", all.farthest);
    // Families that are as flat as the resolution have false impacts. Searches of those that graze are cut short.
    assert!(all.false_impacts * 1_000 < all.never, "{}", all.false_impacts);
    assert!(all.cut_short * 10_000 < all.impacts, "{}", all.cut_short);
}

#[test]
fn triangles_meet_no_later_than_the_reference_certifies() {
    let mut random = Random::new(42);
    let mut score = Score::default();
    for category in 0..CATEGORIES.len() {
        for _ in 0..250 {
            let (a, b) = hard_pair(&mut random, category);
            let extent = a.iter().chain(&b).fold(0.0_f64, |extent, corner| extent.max(corner.distance(a[0])));
            let mut end = |corners: [DVec3; 3]| {
                let shift = random.vector() * extent;
                corners.map(|corner| corner + shift + random.vector() * 0.3 * extent)
            };
            let (a, b) = (MovingTriangle { start: a, end: end(a) }, MovingTriangle { start: b, end: end(b) });
            let separation = [0.0, 0.02][random.below(2)] * extent;
            for [from, to] in [[0, 1], [1, 0]] {
                let ends = |triangle: &MovingTriangle| [triangle.start, triangle.end];
                let played =
                    |triangle: &MovingTriangle| MovingTriangle { start: ends(triangle)[from], end: ends(triangle)[to] };
                let (a, b) = (played(&a), played(&b));
                let truth = triangle_impact(&a.start, &a.end, &b.start, &b.end, separation);
                let found = triangle_pair_impact(&a, &b, &CommonVertices::NONE, separation);
                let wrong = score.add(truth, found.map(|found| found.time));
                assert!(!wrong, "{found:?} where {truth:?} is certified: {a:?} {b:?} {separation}");
            }
        }
    }
    score.print("triangles");
    assert!(score.impacts > 2_000 && score.never > 2_000);
    assert!(score.false_impacts * 1_000 <= score.never);
}
