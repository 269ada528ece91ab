//! Contacts across internal edges: a vertex over one triangle is also near the borders of those around it.
//!
//! Such a border is not the nearest place of the surface, and the direction from it leans to the side. As a constraint it
//! would push the vertex along the surface, and friction between two of them would hold a vertex that lies too deep.
//! Rigid bodies on terrain know them as ghost collisions.

use glam::{DVec3, Vec3};
use parry3d::{query::PointQuery, shape::Triangle};

use super::{Between, Gatherer, Side};
use crate::{
    kernel::{
        contact::CompactContact,
        mesh::{
            feature::Feature,
            ids::{EdgeId, VertexId},
        },
        pose::Pose,
    },
    response::{particles::Particles, scene::Scene},
};

/// A vertex is over another triangle if it is farther beyond the border than it may come back in a tick: this multiple of
/// its way and of the triangle's.
const HASTE: f32 = 1.25;

/// And by this share of its distance from the border, even if nothing moves.
const BEYOND: f32 = 0.02;

/// Contact distances within which a vertex lies too deep. Farther out, borders do not hold it back, and a cloth that lands
/// comes to rest sooner with them.
const DEEP: f32 = 0.75;

/// The particles, the scene, and one side of a pair with its pose.
#[derive(Clone, Copy)]
struct Stand<'a> {
    particles: &'a Particles,
    scene: &'a Scene<'a, 'a>,
    side: Side<'a>,
    pose: &'a Pose,
}

impl Gatherer {
    /// The triangles that a contact is between. If a vertex is near the border of a triangle, but lies too deep over
    /// another one that shares the border, it is the other one.
    pub(super) fn triangles_below(
        &self,
        particles: &Particles,
        scene: &Scene<'_, '_>,
        &Between { pair, sides, .. }: &Between<'_>,
        record: &CompactContact,
    ) -> [u32; 2] {
        let [a, b] = [record.triangle_a, record.triangle_b];
        // Where something has passed through, the contact says on which side it belongs.
        if pair.is_smooth || record.distance <= 0.0 {
            return [a, b];
        }
        let [first, second] = [0, 1].map(|side| Stand { particles, scene, side: sides[side], pose: &pair.poses[side] });
        let below = |stand, triangle, border, vertex: Option<(DVec3, f32)>| {
            let depths = [record.distance, DEEP * pair.contact_distance_at(record)];
            self.triangle_below(stand, (triangle, border), vertex?, depths)
        };
        match (record.features.a, record.features.b) {
            (Feature::Face, _) | (_, Feature::Face) => [a, b],
            (Feature::Vertex(corner), border) => {
                [a, below(second, b, border, self.corner(first, a, corner)).unwrap_or(b)]
            }
            (border, Feature::Vertex(corner)) => {
                [below(first, a, border, self.corner(second, b, corner)).unwrap_or(a), b]
            }
            _ => [a, b],
        }
    }

    /// The nearest of the other triangles that share a border, if it is nearer to a point than the border and `deep`. The
    /// point and its way in the tick are given, and its distance from the border.
    fn triangle_below(
        &self,
        stand: Stand<'_>,
        (triangle, border): (u32, Feature),
        (point, mut way): (DVec3, f32),
        [distance, deep]: [f32; 2],
    ) -> Option<u32> {
        let topology = stand.side.topology()?;
        let place = triangle as usize;
        let around = match border {
            Feature::Edge(edge) => topology.triangles_of_edge(EdgeId(topology.triangle_edges()[place][edge as usize])),
            Feature::Vertex(corner) => {
                topology.triangles_of_vertex(VertexId(topology.welded_triangles()[place][corner as usize]))
            }
            Feature::Face => return None,
        };
        let (mut least, mut nearest) = (distance, None);
        for &other in around.iter().filter(|&&other| other != triangle) {
            let mut corners = [Vec3::ZERO; 3];
            for (number, corner) in (0..).zip(&mut corners) {
                let (at, own_way) = self.corner(stand, other, number)?;
                *corner = (at - point).as_vec3();
                way = way.max(own_way);
            }
            let [a, b, c] = corners;
            let found = Triangle::new(a, b, c).project_local_point(Vec3::ZERO, false).point.length();
            // A vertex has no contact with its own triangles, at distance 0.
            if found > 0.0 && found < least {
                (least, nearest) = (found, Some(other));
            }
        }
        let beyond = (distance * distance - least * least).sqrt();
        nearest.filter(|_| least < deep && beyond > 2.0 * HASTE * way + BEYOND * distance)
    }

    /// Where a corner of a triangle is at the beginning of the tick, and how far it would move in it.
    fn corner(&self, stand: Stand<'_>, triangle: u32, corner: u8) -> Option<(DVec3, f32)> {
        let vertex = stand.side.topology()?.welded_triangles()[triangle as usize][corner as usize] as usize;
        match stand.side {
            Side::Body { first, .. } => {
                Some((stand.particles.start[first + vertex], self.ahead[first + vertex].length()))
            }
            Side::Driven { entity, .. } => {
                let [start, end] = stand.scene.ends(entity, stand.pose, vertex)?;
                Some((start, (end - start).length() as f32))
            }
            Side::Shape { .. } => None,
        }
    }
}
