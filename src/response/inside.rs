//! Ways out: which vertices of bodies are inside a closed surface, and the shortest way out of it for each.
//!
//! What was spawned inside a solid, or squeezed into it, is near nothing that it touches: no contact leads it out. Looked
//! for only where there is reason to: when two surfaces come near each other, while they cross, and while anything of one
//! was inside the other. Solids that are tested by formula have no need of it, their contacts reach to their middles.

use bevy_ecs::{entity::EntityHashMap, prelude::*};
use bevy_platform::collections::HashSet;
use glam::DVec3;

use super::{gather::Scene, particles::Particles};
use crate::{
    kernel::{
        exact::{
            FeatureKind,
            barycentric::barycentric_of,
            side::{closest_feature, face_normal},
        },
        topology::SurfaceTopology,
    },
    surface::ActiveSurface,
};

/// Vertices times triangles that are looked at for one pair of surfaces in a tick, at most: where there are more, what is
/// inside stays there.
const MOST_LOOKS: usize = 20_000_000;

/// A vertex inside a closed surface, and its way out.
pub(super) struct WayOut {
    pub(super) particle: u32,
    /// The triangle that is nearest, with the weights of its corners at the nearest point.
    pub(super) triangle: u32,
    pub(super) weights: [f64; 3],
    /// Unit vector out of the solid.
    pub(super) outward: DVec3,
    pub(super) depth: f64,
}

/// Remembers which surfaces were near each other, and what was inside which.
#[derive(Default)]
pub(super) struct Insides {
    near: HashSet<(Entity, Entity)>,
    before: HashSet<(Entity, Entity)>,
    /// By surface the particles that are on their way out of it.
    leaving: EntityHashMap<HashSet<u32>>,
    holding: HashSet<(Entity, Entity)>,
}

/// The triangles of a closed surface in the world, with their boxes across the x axis.
struct Closed<'a> {
    topology: &'a SurfaceTopology,
    points: Vec<DVec3>,
    low: DVec3,
    high: DVec3,
}

impl Insides {
    /// Begins a tick.
    pub(super) fn begin(&mut self) {
        std::mem::swap(&mut self.near, &mut self.before);
        self.near.clear();
        self.leaving.clear();
    }

    /// Whether a particle is on its way out of a surface.
    pub(super) fn is_leaving(&self, surface: Entity, particle: u32) -> bool {
        self.leaving.get(&surface).is_some_and(|particles| particles.contains(&particle))
    }

    /// Finds the ways out of one closed surface for a body of `count` particles from `first` on.
    pub(super) fn find(
        &mut self,
        scene: &Scene<'_, '_>,
        particles: &Particles,
        (body, first, count): (&ActiveSurface, usize, usize),
        solid: &ActiveSurface,
        points: impl FnOnce() -> Option<Vec<DVec3>>,
    ) -> Vec<WayOut> {
        if !solid.one_sided
            || body.entity == solid.entity
            || !body.meets(solid)
            || !body.world_bounds.overlaps(&solid.world_bounds)
        {
            return Vec::new();
        }
        let pair = (body.entity, solid.entity);
        self.near.insert(pair);
        let is_new = !self.before.contains(&pair) || body.fresh || solid.fresh;
        let crosses = || {
            let contacts = scene.contacts_between(body.entity, solid.entity);
            contacts.into_iter().any(|kind| kind == FeatureKind::EdgeFace)
        };
        if !(is_new || self.holding.contains(&pair) || crosses()) {
            return Vec::new();
        }
        let Some(points) = points() else { return Vec::new() };
        let closed = Closed::new(&solid.topology, points);
        let own = first..first + count;
        let candidates: Vec<usize> = own
            .filter(|&particle| particles.inverse_mass[particle] > 0.0 && closed.may_contain(particles.start[particle]))
            .collect();
        let mut ways = Vec::new();
        if candidates.len() * closed.topology.triangles().len() <= MOST_LOOKS {
            for particle in candidates {
                let point = particles.start[particle];
                if closed.contains(point) {
                    ways.extend(closed.way_out(particle as u32, point));
                }
            }
        }
        if ways.is_empty() {
            self.holding.remove(&pair);
        } else {
            self.holding.insert(pair);
            self.leaving.entry(solid.entity).or_default().extend(ways.iter().map(|way| way.particle));
        }
        ways
    }
}

impl<'a> Closed<'a> {
    fn new(topology: &'a SurfaceTopology, points: Vec<DVec3>) -> Self {
        let empty = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (low, high) = points.iter().fold(empty, |(low, high), &point| (low.min(point), high.max(point)));
        Self { topology, points, low, high }
    }

    fn may_contain(&self, point: DVec3) -> bool {
        point.cmpge(self.low).all() && point.cmple(self.high).all()
    }

    fn corners(&self, triangle: &[u32; 3]) -> [DVec3; 3] {
        triangle.map(|vertex| self.points[vertex as usize])
    }

    /// Whether a ray along x leaves the surface more often than it enters it.
    fn contains(&self, point: DVec3) -> bool {
        let mut winding = 0;
        for triangle in self.topology.triangles() {
            let corners = self.corners(triangle).map(|corner| corner - point);
            // Half-open: what goes through an edge or a vertex is counted once.
            let above = corners.map(|corner| corner.y > 0.0);
            if above[0] == above[1] && above[1] == above[2] || corners.iter().all(|corner| corner.x < 0.0) {
                continue;
            }
            let mut crossings: [Option<(f64, bool)>; 2] = [None, None];
            for side in 0..3 {
                let (from, to) = (corners[side], corners[(side + 1) % 3]);
                if above[side] != above[(side + 1) % 3] {
                    let along = from.y / (from.y - to.y);
                    let place = usize::from(crossings[0].is_some());
                    crossings[place] = Some((from.z + (to.z - from.z) * along, above[side]));
                }
            }
            let [Some((first, _)), Some((second, _))] = crossings else { continue };
            if (first > 0.0) == (second > 0.0) {
                continue;
            }
            let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
            // Where the ray meets the plane.
            if normal.x != 0.0 && normal.dot(corners[0]) / normal.x > 0.0 {
                winding += if normal.x > 0.0 { 1 } else { -1 };
            }
        }
        winding > 0
    }

    /// The nearest point of the surface, and the direction to it.
    fn way_out(&self, particle: u32, point: DVec3) -> Option<WayOut> {
        let mut nearest: Option<(f64, u32, DVec3)> = None;
        for (number, triangle) in (0..).zip(self.topology.triangles()) {
            let corners = self.corners(triangle);
            let low = corners[0].min(corners[1]).min(corners[2]);
            let high = corners[0].max(corners[1]).max(corners[2]);
            let best = nearest.map_or(f64::INFINITY, |(squared, ..)| squared);
            if point.clamp(low, high).distance_squared(point) >= best {
                continue;
            }
            let (_, at) = closest_feature(&corners, point);
            let squared = at.distance_squared(point);
            if squared < best {
                nearest = Some((squared, number, at));
            }
        }
        let (squared, triangle, at) = nearest?;
        let corners = self.corners(&self.topology.triangles()[triangle as usize]);
        let outward = (at - point).try_normalize().or_else(|| face_normal(&corners).try_normalize())?;
        let weights = barycentric_of(&corners, at);
        let is_usable = weights.iter().all(|weight| weight.is_finite());
        is_usable.then_some(WayOut { particle, triangle, weights, outward, depth: squared.sqrt() })
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    /// A cube of side 2 about the origin.
    fn cube() -> (SurfaceTopology, Vec<DVec3>) {
        let corners: Vec<Vec3> = (0..8)
            .map(|bits| Vec3::new((bits & 1) as f32, (bits >> 1 & 1) as f32, (bits >> 2) as f32) * 2.0 - 1.0)
            .collect();
        let triangles = [
            [0, 2, 3],
            [0, 3, 1],
            [4, 5, 7],
            [4, 7, 6],
            [0, 1, 5],
            [0, 5, 4],
            [2, 6, 7],
            [2, 7, 3],
            [0, 4, 6],
            [0, 6, 2],
            [1, 3, 7],
            [1, 7, 5],
        ];
        let points = corners.iter().map(|corner| corner.as_dvec3()).collect();
        (SurfaceTopology::new(&corners, &triangles).unwrap(), points)
    }

    #[test]
    fn points_of_a_grid_are_inside_a_cube_where_their_coordinates_say_so() {
        let (topology, points) = cube();
        let closed = Closed::new(&topology, points);
        let mut inside = 0;
        for place in 0..9 * 9 * 9 {
            let [x, y, z] = [place % 9, place / 9 % 9, place / 81].map(|step| f64::from(step) * 0.31 - 1.24);
            let point = DVec3::new(x, y, z);
            let expected = point.abs().max_element() < 1.0;
            assert_eq!(closed.contains(point), expected, "{point}");
            if expected {
                inside += 1;
                let way = closed.way_out(0, point).unwrap();
                let depth = 1.0 - point.abs().max_element();
                assert!((way.depth - depth).abs() < 1e-12, "{point}: {} {depth}", way.depth);
                let at = point + way.outward * way.depth;
                assert!((at.abs().max_element() - 1.0).abs() < 1e-12, "{at}");
            }
        }
        assert!(inside > 100);
    }

    #[test]
    fn a_ray_along_edges_and_through_vertices_counts_them_once() {
        let (topology, points) = cube();
        let closed = Closed::new(&topology, points);
        // Diagonals of the faces, where two triangles meet.
        for at in [-0.5, 0.0, 0.25] {
            assert!(closed.contains(DVec3::new(0.0, at, at)));
            assert!(closed.contains(DVec3::new(0.0, at, -at)));
            assert!(!closed.contains(DVec3::new(-3.0, at, at)));
            assert!(!closed.contains(DVec3::new(3.0, at, at)));
        }
    }
}
