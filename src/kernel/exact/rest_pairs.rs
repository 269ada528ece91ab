//! The pairs of triangles of a mesh that are near each other in one shape, as a set that answers by look-up.
//!
//! Found once, by the same test that finds contacts. A surface whose layers are sewn together leaves these pairs out.

use glam::Vec3;

use super::stage::exact_pairs;
use crate::kernel::{
    bvh::tree::BoxTree,
    mesh::{bounds::triangle_bounds, ids::TriangleId, topology::SurfaceTopology},
    pair::{FoundPairs, PairSettings, SurfaceSide},
};

/// Candidate pairs that are tested at a time. Bounds the memory for contacts, which nobody asks for.
const PAIRS_AT_ONCE: usize = 4096;

/// Pairs of triangles of one mesh.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RestPairs {
    /// For each triangle, where its list of higher triangles ends.
    ends: Vec<u32>,
    /// The higher triangles of all lists, each list ascending.
    others: Vec<u32>,
}

impl RestPairs {
    /// Finds the pairs of triangles that cross or are no farther apart than `distance`, in the unit of the positions, 0
    /// or more. Neighbors are not among them. The positions must be finite, one for each vertex.
    #[must_use]
    pub fn within(topology: &SurfaceTopology, positions: &[Vec3], distance: f32) -> Self {
        let mut boxes = Vec::new();
        triangle_bounds(positions, topology.triangles(), (0.5 * distance).next_up(), &mut boxes);
        let mut candidates = Vec::new();
        BoxTree::new(&boxes).self_pairs(&mut candidates);
        candidates.retain(|&[a, b]| !topology.share_vertex(TriangleId(a), TriangleId(b)));
        let distance = f64::from(distance);
        let settings = PairSettings {
            contact_distance: distance,
            reported_distance: distance,
            range: distance,
            bulge: 0.0,
            scale: 1.0,
            cull: true,
            same_surface: true,
            any_left_out: false,
        };
        let side = SurfaceSide::flat(topology, positions);
        let (mut found, mut pairs) = (FoundPairs::default(), Vec::new());
        for candidates in candidates.chunks(PAIRS_AT_ONCE) {
            found.clear();
            exact_pairs(&side, &side, candidates, &settings, &mut found);
            pairs.extend(found.touching.iter().map(|pair| {
                let (a, b) = (pair.triangle_a, pair.triangle_b);
                [a.min(b), a.max(b)]
            }));
        }
        pairs.sort_unstable();
        let mut ends = vec![0; topology.triangles().len()];
        for &[first, _] in &pairs {
            ends[first as usize] += 1;
        }
        let mut end = 0;
        for count in &mut ends {
            end += *count;
            *count = end;
        }
        Self { ends, others: pairs.into_iter().map(|[_, second]| second).collect() }
    }

    /// The number of pairs.
    #[must_use]
    pub fn len(&self) -> usize {
        self.others.len()
    }

    /// Whether there is no pair.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.others.is_empty()
    }

    /// Whether two triangles are such a pair, in either order.
    #[must_use]
    pub fn contains(&self, [a, b]: [u32; 2]) -> bool {
        let (lower, higher) = (a.min(b) as usize, a.max(b));
        let start = lower.checked_sub(1).map_or(0, |before| self.ends[before]);
        self.others[start as usize..self.ends[lower] as usize].binary_search(&higher).is_ok()
    }

    /// The pairs, sorted, the lower triangle of each first.
    pub fn iter(&self) -> impl Iterator<Item = [u32; 2]> + '_ {
        let mut start = 0;
        (0..).zip(&self.ends).flat_map(move |(lower, &end)| {
            let own = std::mem::replace(&mut start, end as usize)..end as usize;
            self.others[own].iter().map(move |&higher| [lower, higher])
        })
    }
}
