//! The features that have a constraint in a tick.

use crate::{
    kernel::xpbd::{FeatureParticles, coloring::NONE},
    response::contact::Features,
};

/// The most chains: 4 MiB, if sums of particles reach that far.
const PLACES: usize = 1 << 20;

/// Feature pairs, each once, in chains of those whose particles have the same sum of numbers. Contacts come in the order
/// of their triangles, so their sums are near each other, and a chain is mostly still in the cache when it is needed. In a
/// table with places at random, nearly all of the time goes by waiting for memory.
#[derive(Default)]
pub(super) struct KnownFeatures {
    /// The last feature pair of each sum, or [`NONE`]. Those at the end that have none may be missing.
    last: Vec<u32>,
    links: Vec<Link>,
}

struct Link {
    particles: FeatureParticles,
    are_edges: bool,
    /// The one before in the chain, or [`NONE`].
    before: u32,
}

impl KnownFeatures {
    pub(super) fn clear(&mut self) {
        self.last.clear();
        self.links.clear();
    }

    /// Remembers a feature pair. Returns whether it is new. Planes always are.
    pub(super) fn is_new(&mut self, features: &Features) -> bool {
        let (&particles, are_edges) = match features {
            Features::VertexFace(particles) => (particles, false),
            Features::EdgeEdge(particles) => (particles, true),
            Features::Plane { .. } => return true,
        };
        let Self { last, links } = self;
        let place = particles.iter().map(|&particle| particle as usize).sum::<usize>() % PLACES;
        if last.len() <= place {
            last.resize(place + 1, NONE);
        }
        let before = last[place];
        let mut at = before;
        while let Some(link) = links.get(at as usize) {
            if (link.are_edges, link.particles) == (are_edges, particles) {
                return false;
            }
            at = link.before;
        }
        last[place] = links.len() as u32;
        links.push(Link { particles, are_edges, before });
        true
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

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

    /// All edges of a fan begin with its middle. In chains by the first particle, looking would take the square of their
    /// number.
    #[test]
    fn edges_with_a_common_end_are_in_short_chains() {
        let mut known = KnownFeatures::default();
        for spoke in 1..10_000 {
            assert!(known.is_new(&Features::EdgeEdge([0, spoke, 20_000 + spoke, 20_001 + spoke])));
        }
        let length = |&last: &u32| {
            std::iter::successors(known.links.get(last as usize), |link| known.links.get(link.before as usize)).count()
        };
        let longest = known.last.iter().map(length).max();
        assert!(longest < Some(8), "{longest:?}");
    }
}
