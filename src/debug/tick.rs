//! The results of a tick, collected for the layers that show it.

use bevy_ecs::{entity::EntityHashMap, prelude::*, query::QueryData, system::SystemParam};
use glam::Vec3;

use super::LevelOfDetail;
use crate::{
    contacts::{Contact, StoredPair, SurfaceContacts},
    detection::{CandidateTrianglePairs, PairFates, SurfaceStates, surfaces_with_method},
    kernel::{
        mesh::{bounds::Aabb, ids::VertexId},
        pose::Pose,
    },
    settings::CircumsphereSettings,
    surface::{
        ActiveSurface, ActiveSurfaces, Circumspheres, ContactMethod, ContactSide, EnclosingBalls, RigidShape,
        SurfacePositions, TriangleCones, TriangleCurvature, first_non_finite,
    },
};

/// What the stages store for each triangle of a surface.
#[derive(QueryData)]
pub(super) struct Carried {
    positions: &'static SurfacePositions,
    pub(super) curvature: &'static TriangleCurvature,
    pub(super) balls: &'static EnclosingBalls,
    pub(super) spheres: &'static Circumspheres,
    pub(super) cones: &'static TriangleCones,
}

/// The results of detection.
#[derive(SystemParam)]
pub(super) struct Detected<'w, 's> {
    pub(super) active: Res<'w, ActiveSurfaces>,
    pub(super) candidates: Res<'w, CandidateTrianglePairs>,
    pub(super) contacts: SurfaceContacts<'w>,
    pub(super) settings: Res<'w, CircumsphereSettings>,
    pub(super) fates: PairFates<'w, 's>,
    pub(super) states: Res<'w, SurfaceStates>,
    surfaces: Query<'w, 's, Carried>,
    pub(super) shapes: Query<'w, 's, &'static RigidShape>,
}

impl Detected<'_, '_> {
    /// The positions of a surface and the per-triangle data. `None` if the surface is gone, has another number of
    /// vertices by now, or has a position that is not finite.
    pub(super) fn surface(&self, surface: &ActiveSurface) -> Option<(&[Vec3], CarriedItem<'_, '_>)> {
        let carried = self.surfaces.get(surface.entity).ok()?;
        let positions = carried.positions.0.as_slice();
        let is_whole = positions.len() == surface.topology.vertex_count() && first_non_finite(positions).is_none();
        is_whole.then_some((positions, carried))
    }

    /// For each active surface, whether `method` tested a pair of it in this tick.
    pub(super) fn used_by(&self, method: ContactMethod) -> Vec<bool> {
        let mut used = Vec::new();
        surfaces_with_method(&self.active, self.candidates.pairs.iter(), method, &mut used);
        used
    }
}

/// Contact state of a triangle in this tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Touch {
    /// It touches nothing.
    #[default]
    None,
    /// It touches another triangle.
    Touching,
    /// It has passed another triangle, or crosses it.
    Penetrating,
}

/// Whether the two sides of a contact have passed each other, or cross.
pub(super) fn has_passed(contact: &Contact) -> bool {
    contact.distance() < 0.0 || contact.is_crossing()
}

/// A ball around the surfaces, to which infinite shapes are cut.
#[derive(Clone, Copy, PartialEq)]
pub(super) struct Scene {
    pub(super) center: Vec3,
    pub(super) reach: f32,
}

/// The scene that is used before there are surfaces.
const EMPTY_SCENE: Scene = Scene { center: Vec3::ZERO, reach: 10.0 };

impl Scene {
    /// `None` if there are no surfaces.
    pub(super) fn of(active: &ActiveSurfaces) -> Option<Self> {
        let bounds = active.surfaces.iter().fold(Aabb::EMPTY, |bounds, surface| bounds.union(&surface.world_bounds));
        let reach = (bounds.max - bounds.min).length();
        (reach.is_finite() && reach > 0.0).then(|| Self { center: (bounds.min + bounds.max) * 0.5, reach })
    }

    /// A scene, if there is one, in the own frame of a shape with this pose.
    pub(super) fn of_shape(scene: Option<Self>, pose: &Pose) -> Self {
        let Some(scene) = scene else { return EMPTY_SCENE };
        let center = pose.inverse().transform_point(scene.center.as_dvec3()).as_vec3();
        Self { center, reach: (f64::from(scene.reach) / pose.scale()) as f32 }
    }
}

/// For each active surface, the contact states of its triangles, and which of them are near a contact.
pub(super) struct Touches {
    pub(super) triangles: Vec<Vec<Touch>>,
    near: Vec<Vec<bool>>,
}

impl Touches {
    pub(super) fn new(detected: &Detected) -> Self {
        let surfaces = &detected.active.surfaces;
        let places: EntityHashMap<usize> =
            surfaces.iter().enumerate().map(|(place, surface)| (surface.entity, place)).collect();
        let mut triangles: Vec<Vec<Touch>> =
            surfaces.iter().map(|surface| vec![Touch::None; surface.topology.triangles().len()]).collect();
        let mut mark = |pair: &StoredPair, [a, b]: [u32; 2], touch: Touch| {
            for (side, triangle) in [(pair.a, a), (pair.b, b)] {
                if let ContactSide::Surface(entity) = side
                    && let Some(&place) = places.get(&entity)
                    && let Some(marked) = triangles[place].get_mut(triangle as usize)
                {
                    *marked = touch.max(*marked);
                }
            }
        };
        for (pair, contacts) in detected.contacts.by_pair() {
            for touching in pair.touching.iter() {
                mark(pair, [touching.triangle_a, touching.triangle_b], Touch::Touching);
            }
            for contact in contacts.filter(has_passed) {
                let (a, b) = contact.triangles();
                mark(pair, [a, b].map(|triangle| triangle.map_or(0, |triangle| triangle.0)), Touch::Penetrating);
            }
        }
        let near = surfaces
            .iter()
            .zip(&triangles)
            .map(|(surface, touches)| {
                let mut near = vec![false; touches.len()];
                for (triangle, _) in touches.iter().enumerate().filter(|&(_, &touch)| touch != Touch::None) {
                    for corner in surface.topology.welded_triangles()[triangle] {
                        for &neighbor in surface.topology.triangles_of_vertex(VertexId(corner)) {
                            near[neighbor as usize] = true;
                        }
                    }
                }
                near
            })
            .collect();
        Self { triangles, near }
    }

    /// Whether a triangle of an active surface is shown at a level of detail.
    pub(super) fn wants(&self, level: LevelOfDetail, place: usize, triangle: u32) -> bool {
        match level {
            LevelOfDetail::Off => false,
            LevelOfDetail::NearContacts => self.near[place][triangle as usize],
            LevelOfDetail::All => true,
        }
    }

    /// The triangles of an active surface that are shown at a level of detail.
    pub(super) fn triangles(&self, level: LevelOfDetail, place: usize) -> Vec<u32> {
        (0..self.near[place].len() as u32).filter(|&triangle| self.wants(level, place, triangle)).collect()
    }
}
