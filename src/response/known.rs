//! The feature pairs that have a constraint in a tick.

use super::contact::Features;
use crate::kernel::xpbd::{FeatureKind, FeatureParticles, coloring::NONE};

/// The most chains. Their ends take 4 MiB.
const CHAINS: usize = 1 << 20;

/// Bits of the number of chains that those beginning with one particle are spread over. Their ends take 16 KiB.
const NEAR: u32 = 12;

/// Feature pairs, each once, in chains. Contacts come in the order of their triangles, and chains follow the numbers of
/// particles, so a chain is mostly still in the cache when it is needed. In a table with places at random, nearly all of the
/// time is spent waiting for memory.
#[derive(Default)]
pub(super) struct KnownFeatures {
    /// The last feature pair of each chain, or [`NONE`]. Those at the end that have none may be missing.
    last: Vec<u32>,
    links: Vec<Link>,
}

struct Link {
    kind: FeatureKind,
    particles: FeatureParticles,
    /// The one before in the chain, or [`NONE`].
    before: u32,
}

/// The chain of a feature pair: near four times the number of the first particle, anywhere among those that a first-level
/// cache can hold. All particles decide where, as many features may have one in common, such as the middle of a fan.
fn chain_of(particles: FeatureParticles) -> usize {
    /// 2⁶⁴ divided by the golden ratio (Knuth, "The Art of Computer Programming", volume 3, section 6.4).
    const SPREAD: u64 = 0x9e37_79b9_7f4a_7c15;
    let mix = |mixed: u64, particle| (mixed.rotate_left(29) ^ u64::from(particle)).wrapping_mul(SPREAD);
    let mixed = particles.into_iter().fold(0, mix);
    (4 * particles[0] as usize + (mixed >> (u64::BITS - NEAR)) as usize) % CHAINS
}

impl KnownFeatures {
    pub(super) fn clear(&mut self) {
        self.last.clear();
        self.links.clear();
    }

    /// Remembers a feature pair. Returns whether it is new. Planes always are.
    pub(super) fn is_new(&mut self, features: &Features) -> bool {
        let (kind, &particles) = match features {
            Features::VertexFace(particles) => (FeatureKind::VertexFace, particles),
            Features::EdgeEdge(particles) => (FeatureKind::EdgeEdge, particles),
            Features::Plane { .. } => return true,
        };
        let Self { last, links } = self;
        let chain = chain_of(particles);
        if last.len() <= chain {
            last.resize(chain + 1, NONE);
        }
        let before = last[chain];
        let mut at = before;
        while let Some(link) = links.get(at as usize) {
            if (link.kind, link.particles) == (kind, particles) {
                return false;
            }
            at = link.before;
        }
        last[chain] = links.len() as u32;
        links.push(Link { kind, particles, before });
        true
    }
}

#[cfg(test)]
mod tests {
    use std::{collections::HashSet, iter::successors};

    use circumsphere_support::random::Random;

    use super::*;

    #[test]
    fn every_feature_pair_is_new_once() {
        let mut random = Random::new(5);
        let mut known = KnownFeatures::default();
        for _ in 0..3 {
            let mut expected = HashSet::new();
            let mut again = 0;
            for _ in 0..4000 {
                let mut particle = || random.below(8) as u32;
                let particles = [particle(), particle(), particle(), particle()];
                let are_edges = particle() < 4;
                let features = if are_edges { Features::EdgeEdge(particles) } else { Features::VertexFace(particles) };
                let is_new = expected.insert((are_edges, particles));
                again += usize::from(!is_new);
                assert_eq!(known.is_new(&features), is_new, "{features:?}");
            }
            assert!(again > 500 && expected.len() > 500, "{again} of {}", expected.len());
            known.clear();
        }
    }

    /// The mean length of the chains that a feature pair is looked up in, where each is new.
    fn mean_chain(pairs: impl Iterator<Item = Features>) -> f64 {
        let (mut known, mut count, mut looks) = (KnownFeatures::default(), 0, 0);
        for features in pairs {
            let links = known.links.len();
            if known.is_new(&features) {
                assert_eq!(known.links.len(), links + 1);
                let before = |at: &u32| known.links.get(*at as usize).map(|link| link.before);
                looks += successors(Some(links as u32), before).count() - 1;
                count += 1;
            }
        }
        assert!(count > 9000, "{count}");
        f64::from(looks as u32) / f64::from(count)
    }

    /// All edges of a fan begin with its middle.
    #[test]
    fn edges_with_a_common_end_are_in_short_chains() {
        let edges = (1..10_000).map(|spoke| Features::EdgeEdge([0, spoke, 20_000 + spoke, 20_001 + spoke]));
        let mean = mean_chain(edges);
        assert!((0.5..4.0).contains(&mean), "{mean}");
    }

    /// A grid lies on an equal one or is folded, with its rows or columns in the same or in the opposite order. By the sum of
    /// numbers, where all count the same, the mean would be up to 800.
    #[test]
    fn chains_of_two_layers_are_short() {
        const SIDE: u32 = 60;
        for case in 0..8 {
            let (turn_row, turn_column, offset) =
                (case & 1 > 0, case & 2 > 0, if case & 4 > 0 { 0 } else { 5 * SIDE * SIDE });
            let turned = |at: u32, is_turned: bool| if is_turned { 2 * SIDE - at } else { at };
            let number = |row: u32, column: u32| row * 2 * SIDE + column;
            let other = |row: u32, column: u32| offset + number(turned(row, turn_row), turned(column, turn_column));
            let pairs = (2..SIDE - 2).flat_map(|row| (2..SIDE - 2).map(move |column| (row, column))).flat_map(
                |(row, column)| {
                    let [vertex, beside] = [number(row, column), number(row, column + 1)];
                    let near = (0..9).map(move |near| (row + near / 3 - 1, column + near % 3 - 1));
                    near.flat_map(move |(row, column)| {
                        let corners = [other(row, column), other(row, column + 1), other(row + 1, column)];
                        let [a, b, c] = corners;
                        [Features::VertexFace([vertex, a, b, c]), Features::EdgeEdge([vertex, beside, a, b])]
                    })
                },
            );
            let mean = mean_chain(pairs);
            assert!(mean < 4.0, "case {case}: {mean}");
        }
    }
}
