//! Tethers: they keep vertices of a body near places that something else moves.

use bevy_ecs::{
    entity::{EntityHashMap, MapEntities},
    prelude::*,
    system::SystemParam,
};
#[cfg(feature = "reflect")]
use bevy_reflect::prelude::*;
use bevy_time::Time;
use glam::{DVec3, Vec3};

use crate::{
    kernel::{
        bvh::tree::BoxTree,
        ccd::outward_box,
        mesh::{
            barycentric::barycentric_of,
            ids::{TriangleId, VertexId},
            side::{closest_feature, face_normal},
        },
        pose::Pose,
        xpbd::Tethered,
    },
    surface::{ActiveSurface, ActiveSurfaces, SurfacePositions, Transforms},
};

/// A place that a vertex is tethered to.
#[derive(Clone, Copy, Debug, MapEntities, PartialEq)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(opaque, Clone, Debug, PartialEq))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum TetherTarget {
    /// A place on a surface that the game moves, such as a skinned body. What is behind it is the inside of the surface.
    /// On a surface that the solver moves, it is where the place was when the tick began.
    Surface {
        /// The entity of the surface.
        #[entities]
        entity: Entity,
        /// The triangle.
        triangle: TriangleId,
        /// Weights of its corners. They should sum to 1.
        barycentric: [f32; 3],
        /// Height over the triangle, along its normal, in world units.
        height: f32,
    },
    /// A point in the frame of an entity with a `Transform`, such as a hand. Nothing is behind it.
    Entity {
        /// The entity.
        #[entities]
        entity: Entity,
        /// The point, in its frame.
        point: Vec3,
    },
    /// A point in the world, which the game moves by writing another one. Nothing is behind it.
    World(Vec3),
}

/// Keeps one vertex near its target.
#[derive(Clone, Copy, Debug, MapEntities, PartialEq)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(opaque, Clone, Debug, PartialEq))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Tether {
    /// The vertex.
    pub vertex: VertexId,
    /// Where it is held.
    #[entities]
    pub target: TetherTarget,
    /// The longest distance from the target, in world units; 0 or more, and infinite for no limit. 0 pins the vertex: it
    /// is at the target, whatever pushes it.
    #[cfg_attr(feature = "serde", serde(with = "super::infinite"))]
    pub longest: f32,
    /// The longest distance behind the target, in world units, against the normal of the surface that it is on;
    /// infinite for no limit, and negative if the vertex has to stay that far in front.
    #[cfg_attr(feature = "serde", serde(with = "super::infinite"))]
    pub backstop: f32,
}

impl Tether {
    /// A tether that pins a vertex to its target.
    #[must_use]
    pub const fn pin(vertex: VertexId, target: TetherTarget) -> Self {
        Self { vertex, target, longest: 0.0, backstop: f32::INFINITY }
    }
}

/// Tethers of a body's vertices: pins that follow other entities, and garments that stay near the body that wears them.
/// Each is optional, and a vertex may have several. What a vertex is tethered to pulls the vertex and is not pulled.
///
/// A tether whose target is gone, whose values are not numbers, or whose vertex does not exist has no effect.
/// A tethered vertex follows its target along a straight line within a tick, as pinned vertices do.
///
/// ```
/// # use bevy_circumsphere::{prelude::*, response::*};
/// # use bevy_transform::components::Transform;
/// # use glam::Vec3;
/// # let mut world = bevy_ecs::world::World::new();
/// # let corners = [Vec3::ZERO, Vec3::X, Vec3::Z, Vec3::X + Vec3::Z];
/// # let (surface, positions) = DeformableSurface::from_mesh(&corners, &[[0, 2, 1], [1, 2, 3]])?;
/// // A flag that is pinned to a pole by two corners, wherever the pole goes.
/// let flag = XpbdBody::new(&surface, &positions, XpbdMaterial::CLOTH)?;
/// let pole = world.spawn(Transform::default()).id();
/// let pin = |vertex: u32| {
///     let point = positions.0[vertex as usize];
///     Tether::pin(VertexId(vertex), TetherTarget::Entity { entity: pole, point })
/// };
/// let tethers = XpbdTethers::new([pin(0), pin(2)]);
/// world.spawn((surface, positions, flag, tethers));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Component, Clone, Debug, Default)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(opaque, Component, Clone, Debug, Default))]
pub struct XpbdTethers {
    /// The tethers.
    #[entities]
    pub tethers: Vec<Tether>,
    /// Where the target of each was at the end of the last tick, and is now.
    #[entities]
    ways: Vec<Option<[Place; 2]>>,
}

/// Where a target is, and the direction away from what is behind it; zero if nothing is.
#[derive(Clone, Copy, Debug, MapEntities)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(super) struct Place {
    #[entities]
    pub(super) tether: Tether,
    pub(super) at: DVec3,
    pub(super) normal: DVec3,
}

impl XpbdTethers {
    /// These tethers.
    #[must_use]
    pub fn new(tethers: impl IntoIterator<Item = Tether>) -> Self {
        Self { tethers: tethers.into_iter().collect(), ways: Vec::new() }
    }

    /// Tethers every vertex of a garment to the nearest place on a surface, at its present distance from it. `surface`
    /// has the positions and triangles of the surface that `entity` has, and `garment` the positions of the garment's
    /// vertices, all in world space and in the pose in which the garment fits. `longest` is that of every [`Tether`].
    /// `clearance` says how near to the surface vertices may come, in world units: their least height above the plane of
    /// the triangle that they are tethered to; negative if they may be that far behind it, and −infinity for no limit.
    /// It makes a [`backstop`](Tether::backstop) of the height at which the garment fits, less the clearance.
    ///
    /// A garment whose mesh is closed has to be [`TwoSided`](crate::Sidedness::TwoSided), or it is a solid with the body
    /// inside. Vertices have no tether if a position is not finite, or if there are no triangles.
    #[must_use]
    pub fn to_surface(
        entity: Entity,
        (positions, triangles): (&[Vec3], &[[u32; 3]]),
        garment: &[Vec3],
        longest: f32,
        clearance: f32,
    ) -> Self {
        let corners = |triangle: &[u32; 3]| -> Option<[DVec3; 3]> {
            let at = |vertex: u32| positions.get(vertex as usize).map(|at| at.as_dvec3());
            Some([at(triangle[0])?, at(triangle[1])?, at(triangle[2])?])
        };
        let places: Vec<(TriangleId, [DVec3; 3])> = (0..)
            .map(TriangleId)
            .zip(triangles)
            .filter_map(|(number, triangle)| Some((number, corners(triangle)?)))
            .filter(|(_, corners)| corners.iter().all(|corner| corner.is_finite()))
            .collect();
        let tree = BoxTree::new(&places.iter().map(|(_, corners)| outward_box(*corners)).collect::<Vec<_>>());
        let vertices = (0..).map(VertexId).zip(garment).filter(|(_, at)| at.is_finite());
        let tethers = vertices.filter_map(|(vertex, at)| {
            let at = at.as_dvec3();
            let closest = |corners: &[DVec3; 3]| closest_feature(corners, at).1;
            let place = tree.nearest_item(at, |place| closest(&places[place as usize].1).distance_squared(at))?;
            let (triangle, corners) = places[place as usize];
            let nearest = closest(&corners);
            let height = face_normal(&corners).dot(at - nearest) as f32;
            let barycentric = barycentric_of(&corners, nearest).map(|weight| weight as f32);
            let target = TetherTarget::Surface { entity, triangle, barycentric, height };
            Some(Tether { vertex, target, longest, backstop: height - clearance })
        });
        Self::new(tethers)
    }

    /// Tethers whose targets were at these places at the end of the last tick.
    #[cfg(feature = "serde")]
    pub(super) fn known(tethers: Vec<Tether>, last: Vec<Option<Place>>) -> Self {
        Self { tethers, ways: last.into_iter().map(|place| place.map(|place| [place; 2])).collect() }
    }

    /// Where the target of each tether was at the end of the last tick.
    #[cfg(feature = "serde")]
    pub(super) fn last_places(&self) -> impl Iterator<Item = Option<Place>> {
        let now = |way: &Option<[Place; 2]>| way.map(|[_, now]| now);
        (0..self.tethers.len()).map(move |number| self.ways.get(number).and_then(now))
    }

    /// The number of tethers that have an effect, or `None` if a target moves in this tick.
    pub(super) fn holding(&self) -> Option<usize> {
        let is_moving = |[from, to]: &[Place; 2]| from.at != to.at || from.normal != to.normal;
        let ways = || self.ways.iter().flatten();
        (!ways().any(is_moving)).then(|| ways().count())
    }

    /// The vertices that are pinned to targets, or only tethered, with where the target of each was at the end of the last
    /// tick, and is now.
    pub(super) fn ends(&self, are_pinned: bool) -> impl Iterator<Item = (usize, [DVec3; 2])> + Clone {
        let ways = self.ways.iter().flatten().filter(move |[_, now]| (now.tether.longest <= 0.0) == are_pinned);
        ways.map(|way| (way[1].tether.vertex.index(), way.map(|place| place.at)))
    }

    /// Lets all targets begin where a jump has brought them.
    pub(super) fn carry(&mut self, jump: &Pose) {
        for [before, _] in self.ways.iter_mut().flatten() {
            before.at = jump.transform_point(before.at);
            before.normal = jump.transform_direction(before.normal);
        }
    }

    /// The tethers in a part of a tick that begins and ends at these shares of it, of vertices that have a particle.
    pub(super) fn in_part(
        &self,
        shares: [f64; 2],
        particle_of: impl Fn(VertexId) -> Option<u32>,
    ) -> impl Iterator<Item = Tethered> {
        self.ways.iter().flatten().filter_map(move |[from, to]| {
            let Tether { vertex, longest, backstop, .. } = to.tether;
            Some(Tethered {
                particle: particle_of(vertex)?,
                places: shares.map(|share| from.at.lerp(to.at, share)),
                normals: shares.map(|share| from.normal.lerp(to.normal, share).normalize_or_zero()),
                longest: f64::from(longest.max(0.0)),
                backstop: f64::from(backstop),
            })
        })
    }
}

/// What the targets of tethers are on.
#[derive(SystemParam)]
pub(super) struct Targets<'w, 's> {
    positions: Query<'w, 's, &'static SurfacePositions>,
    transforms: Transforms<'w, 's>,
}

impl Targets<'_, '_> {
    fn place(&self, surfaces: &EntityHashMap<&ActiveSurface>, tether: Tether) -> Option<Place> {
        let place = match tether.target {
            TetherTarget::World(point) => Place { tether, at: point.as_dvec3(), normal: DVec3::ZERO },
            TetherTarget::Entity { entity, point } => {
                let frame = self.transforms.global_affine(entity).ok()?;
                Place { tether, at: frame.transform_point3(point.as_dvec3()), normal: DVec3::ZERO }
            }
            TetherTarget::Surface { entity, triangle, barycentric, height } => {
                let surface = surfaces.get(&entity)?;
                let positions = self.positions.get(entity).ok()?;
                let corners = *surface.topology.triangles().get(triangle.0 as usize)?;
                let at = |vertex: u32| Some(surface.pose.transform_point(positions.0.get(vertex as usize)?.as_dvec3()));
                let corners = [at(corners[0])?, at(corners[1])?, at(corners[2])?];
                let sign = if surface.pose.is_mirrored() { -1.0 } else { 1.0 };
                let normal = face_normal(&corners) * sign;
                let point: DVec3 =
                    corners.into_iter().zip(barycentric).map(|(at, weight)| at * f64::from(weight)).sum();
                Place { tether, at: point + normal * f64::from(height), normal }
            }
        };
        let is_number = !tether.longest.is_nan() && !tether.backstop.is_nan();
        (is_number && place.at.is_finite() && place.normal.is_finite()).then_some(place)
    }
}

/// Whether two tethers hold the same vertex to the same thing.
fn is_same(one: &Tether, other: &Tether) -> bool {
    use TetherTarget as Target;
    one.vertex == other.vertex
        && match (one.target, other.target) {
            (Target::Surface { entity, .. }, Target::Surface { entity: other, .. })
            | (Target::Entity { entity, .. }, Target::Entity { entity: other, .. }) => entity == other,
            (Target::World(_), Target::World(_)) => true,
            _ => false,
        }
}

/// Finds out where the targets of all tethers are now. A target that has no last place has not moved, and neither has
/// anything for a body that jumps. While the clock is stopped, motion is deferred to the next tick.
pub(super) fn aim_tethers(
    time: Option<Res<Time>>,
    active: Res<ActiveSurfaces>,
    targets: Targets,
    mut bodies: Query<&mut XpbdTethers>,
) {
    if bodies.is_empty() || time.is_none_or(|time| time.delta_secs_f64() <= 0.0) {
        return;
    }
    let by_entity = active.surfaces.iter().map(|surface| (surface.entity, surface)).collect();
    for surface in &active.surfaces {
        let Ok(mut body) = bodies.get_mut(surface.entity) else { continue };
        let XpbdTethers { tethers, ways } = body.bypass_change_detection();
        ways.resize(tethers.len(), None);
        for (&tether, way) in tethers.iter().zip(ways) {
            *way = targets.place(&by_entity, tether).map(|now| {
                let before = way.map(|[_, before]| before).filter(|before| is_same(&before.tether, &tether));
                [before.filter(|_| !surface.fresh).unwrap_or(now), now]
            });
        }
    }
}
