//! What a triangle is to its neighbors along the surface: of which vertices and edges it is the first triangle, and how far
//! from some landmarks those first triangles are.
//!
//! Found with the topology. The exact stage tells by it, without looking anything else up, which of several triangles reports
//! a shared feature.

use super::topology::Incidence;

/// From so many vertices of each component the distances along the surface are known.
const LANDMARKS: usize = 4;

/// What a triangle is to its neighbors, in one place.
#[derive(Clone, Copy, Debug)]
pub(super) struct Surroundings {
    /// How far the vertices of the first triangles around its own vertices and edges are from each landmark, in edges.
    lowest: [u16; LANDMARKS],
    highest: [u16; LANDMARKS],
    /// Which of those triangles it is itself, one bit each: 0 to 2 its corners, 3 to 5 its edges.
    pub(super) first_of: u8,
}

impl Surroundings {
    /// Those of all triangles, given as welded vertices and as edges, with the triangles around either.
    pub(super) fn of_all(
        triangles: &[[u32; 3]],
        triangle_edges: &[[u32; 3]],
        vertex_triangles: &Incidence,
        edge_triangles: &Incidence,
    ) -> Vec<Self> {
        let distances = landmark_distances(triangles, vertex_triangles);
        let of_one = |(triangle, (corners, edges)): (usize, (&[u32; 3], &[u32; 3]))| {
            let mut surroundings = Self { lowest: [u16::MAX; LANDMARKS], highest: [0; LANDMARKS], first_of: 0 };
            let [a, b, c] = corners.map(|vertex| vertex_triangles.around(vertex)[0]);
            let [d, e, f] = edges.map(|edge| edge_triangles.around(edge)[0]);
            for (part, first) in [a, b, c, d, e, f].into_iter().enumerate() {
                surroundings.first_of |= u8::from(first as usize == triangle) << part;
                for &vertex in &triangles[first as usize] {
                    for (landmark, &distance) in distances[vertex as usize].iter().enumerate() {
                        surroundings.lowest[landmark] = surroundings.lowest[landmark].min(distance);
                        surroundings.highest[landmark] = surroundings.highest[landmark].max(distance);
                    }
                }
            }
            surroundings
        };
        triangles.iter().zip(triangle_edges).enumerate().map(of_one).collect()
    }

    /// Whether the first triangles around the one may share a vertex with those around the other.
    #[inline]
    pub(super) fn may_meet(&self, other: &Self) -> bool {
        (0..LANDMARKS).fold(true, |may_meet, landmark| {
            may_meet
                & (self.lowest[landmark] <= other.highest[landmark])
                & (other.lowest[landmark] <= self.highest[landmark])
        })
    }
}

/// For each vertex how many edges away it is from each of some landmarks, which are chosen one after the other, each as
/// far from those before as there is. Every component has landmarks of its own, and higher numbers than the one before.
fn landmark_distances(triangles: &[[u32; 3]], around: &Incidence) -> Vec<[u16; LANDMARKS]> {
    const UNSEEN: u32 = u32::MAX;
    let count = around.len();
    let mut distances = vec![[u16::MAX; LANDMARKS]; count];
    let mut seeds: Vec<u32> = triangles.iter().map(|corners| corners[0]).collect();
    let mut nearest = vec![UNSEEN; count];
    let (mut levels, mut open) = (Vec::new(), Vec::with_capacity(count));
    for landmark in 0..LANDMARKS {
        levels.clear();
        levels.resize(count, UNSEEN);
        let (mut base, mut next_seeds) = (0, Vec::new());
        for &seed in &seeds {
            if levels[seed as usize] != UNSEEN {
                continue;
            }
            open.clear();
            open.push(seed);
            levels[seed as usize] = base;
            let (mut next, mut farthest) = (0, seed);
            while next < open.len() {
                let vertex = open[next];
                let level = levels[vertex as usize];
                distances[vertex as usize][landmark] = u16::try_from(level).unwrap_or(u16::MAX);
                nearest[vertex as usize] = nearest[vertex as usize].min(level - base);
                if nearest[vertex as usize] >= nearest[farthest as usize] {
                    farthest = vertex;
                }
                for &triangle in around.around(vertex) {
                    for neighbor in triangles[triangle as usize] {
                        if levels[neighbor as usize] == UNSEEN {
                            levels[neighbor as usize] = level + 1;
                            open.push(neighbor);
                        }
                    }
                }
                next += 1;
            }
            base = levels[open[open.len() - 1] as usize] + 1;
            next_seeds.push(farthest);
        }
        seeds = next_seeds;
    }
    distances
}
