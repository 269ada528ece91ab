//! The results of a tick, collected for the layers that draw it.

use bevy_ecs::{
    entity::{EntityHashMap, EntityHashSet},
    prelude::*,
    query::QueryData,
    system::SystemParam,
};
use glam::Vec3;
use rerun::{Transform3D, components::TransformMat3x3};

use super::settings::LevelOfDetail;
use crate::{
    contacts::{Contact, ContactStore, StoredPair, SurfaceContacts},
    detection::{
        CandidateTrianglePairs, DetectionDiagnostics, OtherSide, PairFates, SurfacePair, SurfaceStates,
        surfaces_with_method,
    },
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
    pub(super) store: Res<'w, ContactStore>,
    pub(super) contacts: SurfaceContacts<'w>,
    pub(super) diagnostics: Res<'w, DetectionDiagnostics>,
    pub(super) settings: Res<'w, CircumsphereSettings>,
    pub(super) fates: PairFates<'w, 's>,
    pub(super) states: Res<'w, SurfaceStates>,
    surfaces: Query<'w, 's, Carried>,
    pub(super) shapes: Query<'w, 's, &'static RigidShape>,
    names: Query<'w, 's, &'static Name>,
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

    pub(super) fn sides(&self, pair: &SurfacePair) -> [Entity; 2] {
        let second = match pair.second {
            OtherSide::Surface(second) => self.active.surfaces[second].entity,
            OtherSide::Shape(place) => self.active.shapes[place].entity,
        };
        [self.active.surfaces[pair.first].entity, second]
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

/// The bounding box of all surfaces; empty if there are none.
pub(super) fn scene_bounds(active: &ActiveSurfaces) -> Aabb {
    active.surfaces.iter().fold(Aabb::EMPTY, |bounds, surface| bounds.union(&surface.world_bounds))
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

    /// Whether a triangle of an active surface is recorded at a level of detail.
    pub(super) fn wants(&self, level: LevelOfDetail, place: usize, triangle: u32) -> bool {
        match level {
            LevelOfDetail::Off => false,
            LevelOfDetail::NearContacts => self.near[place][triangle as usize],
            LevelOfDetail::All => true,
        }
    }

    /// The triangles of an active surface that are recorded at a level of detail.
    pub(super) fn triangles(&self, level: LevelOfDetail, place: usize) -> Vec<u32> {
        (0..self.near[place].len() as u32).filter(|&triangle| self.wants(level, place, triangle)).collect()
    }
}

/// If a layer has more pairs of surfaces than this, it uses a single entity for all of them. Otherwise the names of the
/// entities would take more bytes than their contents.
pub(super) const MANY_PAIRS: usize = 48;
pub(super) const ALL_PAIRS: &str = "all pairs";

/// A unique name for every surface and shape.
#[derive(Default)]
pub(super) struct Names(EntityHashMap<String>);

impl Names {
    /// Names new entities, and keeps existing names.
    pub(super) fn update(&mut self, detected: &Detected) {
        let surfaces = detected.active.surfaces.iter().map(|surface| (surface.entity, "surface"));
        let shapes = detected.active.shapes.iter().map(|shape| (shape.entity, "shape"));
        for (entity, kind) in surfaces.chain(shapes) {
            self.add(entity, kind, detected.names.get(entity).map(Name::as_str).ok());
        }
    }

    /// Names an entity unless it has a name: by its `Name`, or with its number if that would not be unique.
    pub(super) fn add(&mut self, entity: Entity, kind: &str, given: Option<&str>) {
        if self.0.contains_key(&entity) {
            return;
        }
        let given = given.filter(|name| !name.is_empty());
        let numbered = || {
            let numbered = format!("{} {entity}", given.unwrap_or(kind));
            std::iter::successors(Some(numbered), |name| Some(format!("{name} {entity}")))
        };
        // Such a name could be mistaken for the name of a pair.
        let alone = given.filter(|name| !name.contains(" with ") && *name != "itself");
        let is_free = |name: &String| !self.0.values().any(|taken| taken == name);
        if let Some(name) = alone.map(str::to_owned).into_iter().chain(numbered()).find(is_free) {
            self.0.insert(entity, name);
        }
    }

    /// Forgets entities that are no longer active.
    pub(super) fn retain(&mut self, detected: &ActiveSurfaces) {
        let surfaces = detected.surfaces.iter().map(|surface| surface.entity);
        let there: EntityHashSet = surfaces.chain(detected.shapes.iter().map(|shape| shape.entity)).collect();
        self.0.retain(|entity, _| there.contains(entity));
    }

    pub(super) fn of(&self, entity: Entity) -> String {
        self.0.get(&entity).cloned().unwrap_or_else(|| entity.to_string())
    }

    pub(super) fn of_pair(&self, [a, b]: [Entity; 2]) -> String {
        if a == b { format!("{} with itself", self.of(a)) } else { format!("{} with {}", self.of(a), self.of(b)) }
    }
}

/// Converts a pose for the viewer.
pub(super) fn transform(pose: &Pose) -> Transform3D {
    let affine = pose.to_affine();
    let columns = affine.matrix3.as_mat3().to_cols_array_2d();
    Transform3D::from_translation_mat3x3(affine.translation.as_vec3().to_array(), TransformMat3x3::from(columns))
}
