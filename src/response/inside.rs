//! Ways out: which vertices of bodies are inside a closed surface, and the shortest way out of it for each.
//!
//! What was spawned inside a solid, or squeezed into it, is near nothing that it touches: no contact leads it out. Looked
//! for only where there is reason to: when two surfaces come near each other, while they cross, and while anything of one
//! was inside the other.

use std::ops::Range;

use arrayvec::ArrayVec;
use bevy_ecs::{entity::EntityHashMap, prelude::*};
use bevy_platform::collections::HashSet;
use glam::DVec3;

use super::{
    contact::{ContactConstraint, Features},
    gather::Scene,
    particles::Particles,
};
use crate::{
    detection::moved_box,
    kernel::{
        bounds::Aabb,
        exact::{
            barycentric::barycentric_of,
            rigid_shape::ShapeGeometry,
            side::{closest_feature, face_normal},
            triangle_pair::PairProximity,
        },
        pose::Pose,
        topology::SurfaceTopology,
    },
    surface::{ActiveShape, ActiveSurface},
};

/// So many thicknesses deep, contacts lead out of what is tested by formula.
const SHALLOW: f64 = 4.0;

/// What is deep inside a solid is led out as if the contact distance was this share of its depth: by default six depths a
/// second.
const DEPTHS_OF_PACE: f64 = 0.06;

/// Vertices times triangles that are looked at for one pair of surfaces in a tick, at most: where there are more, what is
/// inside stays there.
const MOST_LOOKS: usize = 20_000_000;

/// What a body is inside of.
#[derive(Clone, Copy)]
pub(super) enum Solid<'a> {
    Surface(&'a ActiveSurface),
    /// With where it stands when the tick begins.
    Shape(&'a ActiveShape, Pose),
}

/// The vertices of a body that are inside a solid, and the way out of it that all of them take: in different directions they
/// would hold each other back, or tear the body apart.
pub(super) struct WayOut {
    pub(super) particles: Vec<u32>,
    /// Where it leads through the boundary: a point, and of a surface the triangle with its weights.
    pub(super) exit: DVec3,
    pub(super) triangle: Option<(u32, [f64; 3])>,
    /// Unit vector out of the solid.
    pub(super) outward: DVec3,
    /// How far the farthest of the vertices has to go.
    pub(super) depth: f64,
}

impl WayOut {
    /// Makes a constraint for every vertex: beyond the plane through the exit, at the pace of the deepest.
    pub(super) fn lead_out(
        &self,
        contacts: &mut Vec<ContactConstraint>,
        exit: &ArrayVec<(u32, f64), 6>,
        distance: f64,
    ) {
        let pace = distance.max(self.depth * DEPTHS_OF_PACE);
        for &particle in &self.particles {
            let mut entries: ArrayVec<(u32, f64), 6> = ArrayVec::from_iter([(particle, 1.0)]);
            entries.extend(exit.iter().copied());
            let features = Features::Plane { particles: entries, offset: -distance };
            contacts.push(ContactConstraint::new(features, self.outward, pace, [0.0; 2]));
        }
    }
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

/// The triangles of a closed surface in the world.
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

    /// Finds the way out of a solid for a body of `count` particles from `first` on. `points` are the vertices of a surface.
    pub(super) fn find(
        &mut self,
        scene: &Scene<'_, '_>,
        particles: &Particles,
        (body, first, count): (&ActiveSurface, usize, usize),
        solid: Solid<'_>,
        points: impl FnOnce() -> Option<Vec<DVec3>>,
    ) -> Option<WayOut> {
        let (entity, fresh) = match solid {
            Solid::Surface(solid) => {
                let is_near = || body.world_bounds.overlaps(&solid.world_bounds);
                if !(solid.one_sided && body.entity != solid.entity && body.meets(solid) && is_near()) {
                    return None;
                }
                (solid.entity, solid.fresh)
            }
            Solid::Shape(shape, pose) => {
                let is_near = |bounds: Aabb| moved_box(&bounds, &pose).overlaps(&body.world_bounds);
                if !body.layers.interacts_with(shape.layers) || !shape.geometry.bounds().is_none_or(is_near) {
                    return None;
                }
                (shape.entity, shape.fresh)
            }
        };
        let pair = (body.entity, entity);
        self.near.insert(pair);
        let is_new = !self.before.contains(&pair) || body.fresh || fresh;
        // Contacts lead out what is no deeper.
        let shallow = SHALLOW * f64::from(body.thickness);
        if !(is_new || self.holding.contains(&pair) || scene.is_deep_in(body.entity, entity, shallow)) {
            return None;
        }
        let way = match solid {
            Solid::Surface(solid) => {
                let closed = Closed::new(&solid.topology, points()?);
                way_out(particles, first..first + count, closed.topology.triangles().len(), &closed)
            }
            Solid::Shape(shape, pose) => {
                let solid = PlacedShape { geometry: &shape.geometry, pose, own: pose.inverse(), shallow };
                way_out(particles, first..first + count, 1, &solid)
            }
        };
        match &way {
            Some(way) => {
                self.holding.insert(pair);
                self.leaving.entry(entity).or_default().extend(way.particles.iter().copied());
            }
            None => {
                self.holding.remove(&pair);
            }
        }
        way
    }
}

/// The way out of a solid for those of some particles that are inside; `cost` is what one look takes.
fn way_out(particles: &Particles, own: Range<usize>, cost: usize, solid: &impl Inside) -> Option<WayOut> {
    let is_free = |&particle: &usize| particles.inverse_mass[particle] > 0.0;
    let near: Vec<usize> =
        own.filter(is_free).filter(|&particle| solid.may_contain(particles.start[particle])).collect();
    if near.len() * cost > MOST_LOOKS {
        return None;
    }
    let at = |particle: usize| particles.start[particle];
    let inside: Vec<usize> = near.into_iter().filter(|&particle| solid.contains(at(particle))).collect();
    let center = inside.iter().map(|&particle| at(particle)).sum::<DVec3>() / inside.len().max(1) as f64;
    // The middle of what is inside may be outside of a solid that is not convex.
    let nearest = inside
        .iter()
        .copied()
        .min_by(|&one, &other| at(one).distance_squared(center).total_cmp(&at(other).distance_squared(center)))?;
    let (exit, outward, triangle) = solid.exit(if solid.contains(center) { center } else { at(nearest) })?;
    let depth = inside.iter().map(|&particle| outward.dot(exit - at(particle))).fold(0.0, f64::max);
    let particles = inside.into_iter().map(|particle| particle as u32).collect();
    Some(WayOut { particles, exit, triangle, outward, depth })
}

/// What can be asked of a solid.
trait Inside {
    fn may_contain(&self, point: DVec3) -> bool;

    fn contains(&self, point: DVec3) -> bool;

    /// The point of the boundary that is nearest to a point inside, the direction to it, and its triangle.
    fn exit(&self, point: DVec3) -> Option<(DVec3, DVec3, Option<(u32, [f64; 3])>)>;
}

/// A rigid shape in the world.
struct PlacedShape<'a> {
    geometry: &'a ShapeGeometry,
    pose: Pose,
    own: Pose,
    /// What is no deeper does not count as inside, in world units.
    shallow: f64,
}

impl Inside for PlacedShape<'_> {
    fn may_contain(&self, point: DVec3) -> bool {
        self.contains(point)
    }

    fn contains(&self, point: DVec3) -> bool {
        self.geometry.signed_distance(self.own.transform_point(point)) * self.pose.scale() < -self.shallow
    }

    fn exit(&self, point: DVec3) -> Option<(DVec3, DVec3, Option<(u32, [f64; 3])>)> {
        let own = self.own.transform_point(point);
        let (mut scratch, mut found) = (PairProximity::default(), Vec::new());
        self.geometry.examine(&[own; 3], 0.0, &mut scratch, &mut found);
        let nearest = found.iter().min_by(|one, other| one.distance.total_cmp(&other.distance))?;
        let outward = self.pose.transform_direction(nearest.normal).try_normalize()?;
        Some((self.pose.transform_point(nearest.shape_point), outward, None))
    }
}

impl<'a> Closed<'a> {
    fn new(topology: &'a SurfaceTopology, points: Vec<DVec3>) -> Self {
        let empty = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (low, high) = points.iter().fold(empty, |(low, high), &point| (low.min(point), high.max(point)));
        Self { topology, points, low, high }
    }

    fn corners(&self, triangle: &[u32; 3]) -> [DVec3; 3] {
        triangle.map(|vertex| self.points[vertex as usize])
    }
}

impl Inside for Closed<'_> {
    fn may_contain(&self, point: DVec3) -> bool {
        point.cmpge(self.low).all() && point.cmple(self.high).all()
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

    fn exit(&self, point: DVec3) -> Option<(DVec3, DVec3, Option<(u32, [f64; 3])>)> {
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
        let (_, triangle, at) = nearest?;
        let corners = self.corners(&self.topology.triangles()[triangle as usize]);
        let outward = (at - point).try_normalize().or_else(|| face_normal(&corners).try_normalize())?;
        let weights = barycentric_of(&corners, at);
        let is_usable = weights.iter().all(|weight| weight.is_finite());
        is_usable.then_some((at, outward, Some((triangle, weights))))
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
                let (exit, outward, _) = closed.exit(point).unwrap();
                let depth = 1.0 - point.abs().max_element();
                assert!((exit.distance(point) - depth).abs() < 1e-12, "{point}: {exit} {depth}");
                assert!((point + outward * depth).distance(exit) < 1e-12, "{point}: {outward}");
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
