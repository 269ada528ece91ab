//! Names of surfaces, shapes, and their pairs in a recording.

use bevy_ecs::{
    entity::{EntityHashMap, EntityHashSet},
    prelude::*,
};
use rerun::{Transform3D, components::TransformMat3x3};

use crate::{
    debug::tick::Detected,
    detection::{OtherSide, SurfacePair},
    kernel::pose::Pose,
    surface::ActiveSurfaces,
};

/// If a layer has more pairs of surfaces than this, it uses a single entity for all of them. Otherwise the names of the
/// entities would take more bytes than their contents.
pub(super) const MANY_PAIRS: usize = 48;
pub(super) const ALL_PAIRS: &str = "all pairs";

/// A unique name for every surface and shape.
#[derive(Default)]
pub(super) struct Names(EntityHashMap<String>);

impl Names {
    /// Names new entities, and keeps existing names.
    pub(super) fn update(&mut self, detected: &Detected, given: &Query<&Name>) {
        let surfaces = detected.active.surfaces.iter().map(|surface| (surface.entity, "surface"));
        let shapes = detected.active.shapes.iter().map(|shape| (shape.entity, "shape"));
        for (entity, kind) in surfaces.chain(shapes) {
            self.add(entity, kind, given.get(entity).map(Name::as_str).ok());
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

/// The sides of a pair.
pub(super) fn sides(active: &ActiveSurfaces, pair: &SurfacePair) -> [Entity; 2] {
    let second = match pair.second {
        OtherSide::Surface(second) => active.surfaces[second].entity,
        OtherSide::Shape(place) => active.shapes[place].entity,
    };
    [active.surfaces[pair.first].entity, second]
}

/// Converts a pose for the viewer.
pub(super) fn transform(pose: &Pose) -> Transform3D {
    let affine = pose.to_affine();
    let columns = affine.matrix3.as_mat3().to_cols_array_2d();
    Transform3D::from_translation_mat3x3(affine.translation.as_vec3().to_array(), TransformMat3x3::from(columns))
}
