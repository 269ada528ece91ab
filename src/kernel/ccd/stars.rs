//! Finds the vertices around which a moving mesh certainly does not meet itself.
//!
//! Most pairs of triangles in a sweep of a mesh against itself share a vertex. Tests of such pairs would take nearly all
//! of the time. Instead, one test per vertex is made for all triangles around it, its *star*. Seen along a fixed
//! direction, the star is *plain* if its triangles keep their orientation during the whole step and lie around the vertex
//! without overlap, as the sectors of a circle do. Then no two of them meet, except in what they share.
//!
//! Corners relative to the vertex move in straight lines, so the area of a triangle as seen along the direction is a
//! polynomial of second degree in time, and at least the smallest of its three Bernstein coefficients. The sectors of a
//! closed star turn around the vertex a whole number of times. That number stays the same while all areas are positive,
//! so that it is counted only at the start. An open star may not overlap a ray that is chosen in its gap.
//!
//! The distance of a corner from another triangle of a plain star, seen along the direction, is at least the least
//! altitude of the triangles in between, or that of the ray.

use std::ops::Range;

use glam::{DVec2, DVec3};

use super::{
    advance::{HEIGHT_ERROR, LENGTH_SLACK},
    sweep::SweptMesh,
};
use crate::kernel::{
    mesh::{fans::Fans, ids::VertexId, topology::SurfaceTopology},
    simd::parallel::Parallel,
};

/// Smallest altitude of a triangle in a plain star, relative to the longest edge at the vertex: far above rounding.
const LEAST_ALTITUDE: f64 = 1.0e-9;

/// Fans per task.
const PART: usize = 128;

/// With fewer fans than this, waking another thread does not pay off.
const LEAST_FANS: usize = 512;

/// For each vertex, whether its star is plain during a step.
#[derive(Clone, Debug, Default)]
pub(super) struct PlainStars {
    /// By welded vertex.
    is_plain: Vec<bool>,
    /// By fan.
    are_plain: Vec<bool>,
    /// For each task.
    stars: Vec<Star>,
}

/// The star of one vertex.
#[derive(Clone, Debug, Default)]
struct Star {
    outer: Vec<Outer<DVec3>>,
    seen: Vec<Outer<DVec2>>,
}

/// An outer corner of a star, relative to its vertex, at both ends of a step.
#[derive(Clone, Copy, Debug)]
struct Outer<Vector> {
    start: Vector,
    end: Vector,
}

impl PlainStars {
    /// Tests the stars of all vertices around which at least one triangle is asked about, in tasks that `parallel` may
    /// distribute. Features in a plain star that share no vertex stay farther than `separation` apart.
    pub(super) fn find(
        &mut self,
        parallel: &impl Parallel,
        mesh: &SweptMesh<'_>,
        separation: f64,
        is_asked: impl Fn(u32) -> bool + Sync,
    ) {
        let Self { is_plain, are_plain, stars } = self;
        let topology = mesh.topology;
        let (fans, corners) = (topology.fans(), topology.welded_triangles());
        are_plain.clear();
        are_plain.resize(fans.len(), false);
        let count = fans.len().div_ceil(PART);
        stars.resize_with(stars.len().max(count), Star::default);
        let parts = are_plain.chunks_mut(PART).zip(&mut *stars).enumerate();
        parallel.run_tasks(parts, fans.len() / LEAST_FANS, |(part, (are_plain, star))| {
            for (fan, is_plain) in (part * PART..).zip(are_plain) {
                let (range, is_closed) = fans.fan(fan);
                if fans.slots()[range.clone()].iter().any(|slot| is_asked(slot.triangle)) {
                    *is_plain = star.gather(mesh, fans, range, is_closed) && star.is_plain(is_closed, separation);
                }
            }
        });
        is_plain.clear();
        is_plain.resize(topology.vertex_count(), false);
        let mut last = None;
        for (fan, &is_plain_fan) in are_plain.iter().enumerate() {
            let slot = fans.slots()[fans.fan(fan).0.start];
            let vertex = corners[slot.triangle as usize][slot.corner as usize];
            // The fans of a vertex follow one another. Those of several sheets are not seen from one direction.
            is_plain[vertex as usize] = is_plain_fan && last != Some(vertex);
            last = Some(vertex);
        }
    }

    /// Appends the pairs of triangles with a common vertex, at least one of them asked about, that no plain star covers. The
    /// lower one comes first.
    pub(super) fn append_pairs(
        &self,
        topology: &SurfaceTopology,
        is_asked: impl Fn(u32) -> bool,
        pairs: &mut Vec<[u32; 2]>,
    ) {
        let corners = topology.welded_triangles();
        let is_own = |vertex: u32| topology.weld()[vertex as usize] == vertex;
        for vertex in (0..topology.vertex_count() as u32).filter(|&vertex| is_own(vertex)) {
            if self.is_plain[vertex as usize] {
                continue;
            }
            let around = topology.triangles_of_vertex(VertexId(vertex));
            for &a in around.iter().filter(|&&a| is_asked(a)) {
                let others = around.iter().filter(|&&b| b < a || b > a && !is_asked(b));
                let left = others.filter(|&&b| !self.cover(corners[a as usize], corners[b as usize]));
                pairs.extend(left.map(|&b| [a.min(b), a.max(b)]));
            }
        }
        pairs.sort_unstable();
        pairs.dedup();
    }

    /// Whether two triangles share a vertex whose star is plain.
    fn cover(&self, a: [u32; 3], b: [u32; 3]) -> bool {
        a.iter().any(|&vertex| self.is_plain[vertex as usize] && b.contains(&vertex))
    }
}

impl Star {
    /// Collects the outer corners of a star in order, of a closed one the first also as the last. Returns `false` if
    /// welded vertices have moved apart, or if a coordinate is not finite.
    fn gather(&mut self, mesh: &SweptMesh<'_>, fans: &Fans, range: Range<usize>, is_closed: bool) -> bool {
        let (triangles, weld) = (mesh.topology.triangles(), mesh.topology.weld());
        let slots = &fans.slots()[range];
        let corner = |slot: usize, step: usize| {
            let slot = slots[slot];
            triangles[slot.triangle as usize][(slot.corner as usize + step) % 3] as usize
        };
        let vertex = corner(0, 0);
        let (start, end) = (mesh.start[vertex], mesh.end[vertex]);
        let outer = |corner: usize| Outer { start: mesh.start[corner] - start, end: mesh.end[corner] - end };
        self.outer.clear();
        self.outer.extend((0..slots.len()).map(|slot| outer(corner(slot, 1))));
        self.outer.push(if is_closed { self.outer[0] } else { outer(corner(slots.len() - 1, 2)) });
        let is_whole = |named: usize| {
            let welded = weld[named] as usize;
            named == welded || mesh.start[named] == mesh.start[welded] && mesh.end[named] == mesh.end[welded]
        };
        let is_welded = mesh.topology.is_welded();
        let is_one = !is_welded || (0..slots.len()).all(|slot| (0..3).all(|step| is_whole(corner(slot, step))));
        is_one && self.outer.iter().all(|outer| outer.start.is_finite() && outer.end.is_finite())
    }

    fn is_plain(&mut self, is_closed: bool, separation: f64) -> bool {
        let Self { outer, seen, .. } = self;
        let areas = |pair: &[Outer<DVec3>]| pair[0].start.cross(pair[1].start) + pair[0].end.cross(pair[1].end);
        let Some(direction) = outer.windows(2).map(areas).sum::<DVec3>().try_normalize() else { return false };
        let (right, up) = direction.any_orthonormal_pair();
        seen.clear();
        seen.extend(outer.iter().map(|&Outer { start, end }| Outer {
            start: DVec2::new(right.dot(start), up.dot(start)),
            end: DVec2::new(right.dot(end), up.dot(end)),
        }));
        let squared = seen.iter().map(|corner| corner.start.length_squared().max(corner.end.length_squared()));
        let longest = squared.fold(0.0, f64::max).sqrt();
        let away = separation * LENGTH_SLACK + (LEAST_ALTITUDE + HEIGHT_ERROR) * longest;
        // The edge opposite the vertex is at most twice as long as the longest edge at it.
        let least = 2.0 * longest * away;
        let is_upright = |pair: &[Outer<DVec2>]| {
            let [p, q] = [pair[0], pair[1]];
            let middle = 0.5 * (p.start.perp_dot(q.end) + p.end.perp_dot(q.start));
            p.start.perp_dot(q.start).min(p.end.perp_dot(q.end)).min(middle) > least
        };
        seen.windows(2).all(is_upright) && if is_closed { turns_once(seen) } else { has_gap(seen, away) }
    }
}

/// Whether the upright sectors of a closed star turn around its vertex once: one of them contains a ray.
fn turns_once(seen: &[Outer<DVec2>]) -> bool {
    let ray = seen[0].start + seen[1].start;
    let is_left = |corner: &Outer<DVec2>| ray.perp_dot(corner.start) > 0.0;
    seen.windows(2).filter(|pair| !is_left(&pair[0]) && is_left(&pair[1])).count() == 1
}

/// Whether the upright sectors of an open star stay off a ray in its gap, and its corners farther than `away` from it.
fn has_gap(seen: &[Outer<DVec2>], away: f64) -> bool {
    let (first, last) = (seen[0], seen[seen.len() - 1]);
    let ray = (last.start + last.end).perp().normalize_or_zero() - (first.start + first.end).perp().normalize_or_zero();
    let Some(ray) = ray.try_normalize() else { return false };
    // Left of the ray during the whole step, right of it, or neither.
    let side = |corner: &Outer<DVec2>| {
        let [start, end] = [corner.start, corner.end].map(|corner| ray.perp_dot(corner));
        if start.min(end) > away { 1 } else { -i8::from(start.max(end) < -away) }
    };
    let is_off = |corner: &Outer<DVec2>| side(corner) != 0 || ray.dot(corner.start).max(ray.dot(corner.end)) < -away;
    seen.iter().all(is_off) && seen.windows(2).all(|pair| side(&pair[0]) == 1 || side(&pair[1]) == -1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::{
        ccd::triangle_pair::{CommonVertices, triangle_pair_impact},
        simd::parallel::Sequential,
    };
    use circumsphere_support::random::Random;
    use glam::Vec3;

    fn pick(random: &mut Random, end: u64) -> usize {
        random.below(end) as usize
    }

    fn vector(random: &mut Random) -> DVec3 {
        DVec3::from([0; 3].map(|_| f64::from(random.signed_unit())))
    }

    /// A star around vertex 0 and how it moves.
    struct Star {
        topology: SurfaceTopology,
        start: Vec<DVec3>,
        end: Vec<DVec3>,
    }

    impl Star {
        /// Around the origin, `turns` times. An open star misses its last triangle.
        fn new(random: &mut Random, count: u32, turns: f64, is_closed: bool, roughness: f64) -> Self {
            let outer = (0..count).map(|k| {
                let angle = std::f64::consts::TAU * turns * f64::from(k) / f64::from(count);
                DVec3::new(angle.cos(), angle.sin(), 0.0) + vector(random) * roughness
            });
            let start: Vec<DVec3> = std::iter::once(DVec3::ZERO).chain(outer).collect();
            let triangles: Vec<[u32; 3]> =
                (0..count - u32::from(!is_closed)).map(|k| [0, 1 + k, 1 + (k + 1) % count]).collect();
            let narrow: Vec<Vec3> = start.iter().map(|position| position.as_vec3()).collect();
            let topology = SurfaceTopology::new(&narrow, &triangles).expect("the mesh is valid");
            Self { topology, end: start.clone(), start }
        }

        fn mesh(&self) -> SweptMesh<'_> {
            let (start, end) = (&self.start[..], &self.end[..]);
            SweptMesh { topology: &self.topology, start, end, drift: DVec3::ZERO, reach: 0.0 }
        }

        fn is_plain(&self, separation: f64) -> bool {
            let mut stars = PlainStars::default();
            stars.find(&Sequential, &self.mesh(), separation, |_| true);
            stars.is_plain[0]
        }

        /// Whether a pair of its triangles meets, each pair tested by its features.
        fn meets_itself(&self, separation: f64) -> bool {
            let mesh = self.mesh();
            let corners = self.topology.welded_triangles();
            let pairs = (0..corners.len()).flat_map(|b| (0..b).map(move |a| [a, b]));
            pairs.into_iter().any(|[a, b]| {
                let common = CommonVertices::of(corners[a], corners[b]);
                triangle_pair_impact(&mesh.triangle(a as u32), &mesh.triangle(b as u32), &common, separation).is_some()
            })
        }
    }

    #[test]
    fn no_plain_star_meets_itself() {
        let mut random = Random::new(29);
        // Plain, not plain but without impact, and those that meet themselves; closed, then open.
        let mut counts = [[0; 3]; 2];
        for _ in 0..20_000 {
            let count = 3 + pick(&mut random, 7) as u32;
            let is_closed = pick(&mut random, 2) == 0;
            let turns: f64 = [1.0, 0.5, 0.8, 2.0][pick(&mut random, 4)];
            let turns = if is_closed { turns.round().max(1.0) } else { turns };
            let roughness = 10.0_f64.powf(-2.0 * random.unit());
            let mut star = Star::new(&mut random, count, turns, is_closed, roughness);
            let way = 10.0_f64.powf(0.5 - 2.5 * random.unit());
            star.end.iter_mut().for_each(|position| *position += vector(&mut random) * way);
            let separation = [0.0, 0.01, 0.1][pick(&mut random, 3)];
            let (is_plain, meets) = (star.is_plain(separation), star.meets_itself(separation));
            assert!(!(is_plain && meets), "{:?} to {:?}, within {separation}", star.start, star.end);
            counts[usize::from(!is_closed)][if is_plain { 0 } else { 1 + usize::from(meets) }] += 1;
        }
        for [plain, others, meeting] in counts {
            assert!(plain > 1_500 && others < 5_000 && meeting > 3_000, "{counts:?}");
        }
    }

    #[test]
    fn flat_stars_are_plain_wherever_they_go_and_folded_ones_are_not() {
        let mut random = Random::new(31);
        for (count, turns, is_closed) in [(6, 1.0, true), (4, 0.5, false), (3, 0.25, false), (8, 0.75, false)] {
            let mut star = Star::new(&mut random, count, turns, is_closed, 0.0);
            assert!(star.is_plain(0.01), "{count}, {turns}");
            star.end.iter_mut().for_each(|position| {
                *position = DVec3::new(position.y, position.z, position.x) * 1.1 + DVec3::new(3.0, -2.0, 5.0);
            });
            assert!(!star.is_plain(0.01), "turned by a third of a full turn, it is not seen from one direction");
            let tilt = glam::DQuat::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 0.7);
            star.end = star.start.iter().map(|&position| tilt * position + DVec3::new(30.0, -20.0, 50.0)).collect();
            assert!(star.is_plain(0.01), "{count}, {turns}");
            // Folded over along the x axis.
            star.end = star.start.iter().map(|&DVec3 { x, y, .. }| DVec3::new(x, y.abs(), 0.1 * y)).collect();
            assert!(turns <= 0.5 || !star.is_plain(0.01), "{count}, {turns}");
        }
        // Twice around is flat and upright, but not plain.
        assert!(!Star::new(&mut random, 10, 2.0, true, 0.0).is_plain(0.0));
        // Beyond the shortest altitude, nothing is.
        assert!(!Star::new(&mut random, 6, 1.0, true, 0.0).is_plain(1.0));
    }

    #[test]
    fn sheets_that_meet_at_a_vertex_and_welds_that_open_are_not_plain() {
        let random = &mut Random::new(37);
        let one = Star::new(random, 6, 1.0, true, 0.0);
        let triangles: Vec<[u32; 3]> =
            one.topology.triangles().iter().flat_map(|&[a, b, c]| [[a, b, c], [a, b + 6, c + 6]]).collect();
        let above = one.start[1..].iter().map(|&position| position + DVec3::Z);
        let positions: Vec<DVec3> = one.start.iter().copied().chain(above).collect();
        let star = |positions: &[DVec3], triangles: &[[u32; 3]]| {
            let narrow: Vec<Vec3> = positions.iter().map(|position| position.as_vec3()).collect();
            let topology = SurfaceTopology::new(&narrow, triangles).expect("the mesh is valid");
            Star { topology, start: positions.to_vec(), end: positions.to_vec() }
        };
        assert!(one.is_plain(0.0) && !star(&positions, &triangles).is_plain(0.0));
        // A seam: the last corner has its own number, and moves away from the one that it is welded to.
        let mut seam = one.topology.triangles().to_vec();
        seam[5][2] = 7;
        let positions: Vec<DVec3> = one.start.iter().copied().chain([one.start[1]]).collect();
        let mut seam = star(&positions, &seam);
        assert!(seam.is_plain(0.0));
        seam.end[7].z += 0.01;
        assert!(!seam.is_plain(0.0));
    }
}
