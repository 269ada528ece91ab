//! Makes bodies and tethers of garments.

use std::sync::Arc;

use bevy_ecs::{
    entity_disabling::Disabled,
    prelude::*,
    query::{Allow, QueryData},
    system::SystemParam,
};
use glam::{DAffine3, Vec3};

use super::{
    components::{GarmentLink, Made, XpbdGarment},
    error::{XpbdGarmentError, XpbdGarmentNotWorn},
    freedom::Freedom,
};
use crate::{
    geometry::SurfaceTopology,
    kernel::mesh::barycentric::{barycentric_in_plane, point_at},
    response::{
        body::{XpbdBody, check_finite},
        tethers::{Tether, TetherTarget, XpbdTethers},
    },
    surface::{
        DeformableSurface, Named, OwnMeshes, Sidedness, SurfaceDisabled, SurfaceFrame, SurfaceFromMesh,
        SurfacePositions, Transforms, WriteSurfaceToMesh,
    },
};

/// The largest weight of a triangle's corner. Beyond, as with slivers, what the triangle does would be magnified.
const MOST_WEIGHT: f64 = 4.0;

#[derive(QueryData)]
#[query_data(mutable)]
pub(super) struct GarmentItem {
    entity: Entity,
    name: Option<&'static Name>,
    garment: &'static XpbdGarment,
    link: &'static mut GarmentLink,
    surface: &'static DeformableSurface,
    positions: &'static SurfacePositions,
    frame: &'static SurfaceFrame,
    sidedness: &'static Sidedness,
}

/// The surfaces that wear garments.
#[derive(SystemParam)]
pub(super) struct Skins<'w, 's> {
    surfaces: Query<'w, 's, (&'static DeformableSurface, &'static SurfacePositions, &'static SurfaceFrame)>,
    pending: Query<'w, 's, (), Or<(With<DeformableSurface>, With<SurfaceFromMesh>)>>,
    disabled: Query<'w, 's, (), (Or<(With<Disabled>, With<SurfaceDisabled>)>, Allow<Disabled>)>,
    all: Query<'w, 's, (), Allow<Disabled>>,
    transforms: Transforms<'w, 's>,
}

/// A surface that wears a garment.
struct Skin<'a> {
    entity: Entity,
    topology: &'a Arc<SurfaceTopology>,
    positions: &'a [Vec3],
    frame: SurfaceFrame,
}

impl Skins<'_, '_> {
    /// The skins of a garment, or `None` while they are not there or paused.
    fn of(&self, entity: Entity, garment: &XpbdGarment) -> Result<Option<Vec<Skin<'_>>>, XpbdGarmentError> {
        if garment.skins.is_empty() {
            return Err(XpbdGarmentError::NoSkin);
        }
        let mut skins = Vec::with_capacity(garment.skins.len());
        let mut are_ready = true;
        for &skin in &garment.skins {
            if !self.all.contains(skin) {
                return Err(XpbdGarmentError::MissingSkin(skin));
            }
            if self.disabled.contains(skin) {
                are_ready = false;
                continue;
            }
            if skin == entity || !self.pending.contains(skin) {
                return Err(XpbdGarmentError::SkinIsNoSurface(skin));
            }
            match self.surfaces.get(skin) {
                Ok((surface, positions, &frame)) if positions.0.len() == surface.topology().vertex_count() => {
                    skins.push(Skin { entity: skin, topology: surface.topology(), positions: &positions.0, frame });
                }
                _ => are_ready = false,
            }
        }
        Ok(are_ready.then_some(skins))
    }

    /// The way from the frame of a surface to the world.
    fn affine(&self, entity: Entity, frame: SurfaceFrame) -> Result<DAffine3, XpbdGarmentError> {
        self.transforms.affine(entity, frame).map_err(XpbdGarmentError::Pose)
    }

    /// A tether of each vertex to where it is now, as seen from the nearest triangle of the skins. Vertices without one
    /// are left out.
    fn tethers(&self, skins: &[Skin], at: &[Vec3], clearance: f32) -> Result<Vec<Tether>, XpbdGarmentError> {
        let mut nearest: Vec<Option<(f64, Tether)>> = vec![None; at.len()];
        for skin in skins {
            let points = in_world(self.affine(skin.entity, skin.frame)?, skin.positions);
            let triangles = skin.topology.triangles();
            let own = XpbdTethers::to_surface(skin.entity, (&points, triangles), at, 0.0, clearance);
            for mut tether in own.tethers {
                let TetherTarget::Surface { triangle, barycentric, .. } = &mut tether.target else { continue };
                let corners = triangles[triangle.index()].map(|corner| points[corner as usize].as_dvec3());
                let at = at[tether.vertex.index()].as_dvec3();
                let distance = at.distance(point_at(&corners, &barycentric.map(f64::from)));
                // Where the nearest place is on an edge, the vertex is not above it, but beside the triangle.
                let weights = barycentric_in_plane(&corners, at);
                if weights.iter().all(|weight| weight.abs() <= MOST_WEIGHT) {
                    *barycentric = weights.map(|weight| weight as f32);
                }
                let best = &mut nearest[tether.vertex.index()];
                if best.is_none_or(|(least, _)| distance < least) {
                    *best = Some((distance, tether));
                }
            }
        }
        Ok(nearest.into_iter().flatten().map(|(_, tether)| tether).collect())
    }
}

fn in_world(way: DAffine3, positions: &[Vec3]) -> Vec<Vec3> {
    positions.iter().map(|at| way.transform_point3(at.as_dvec3()).as_vec3()).collect()
}

/// Dresses characters whose garments are new or have changed.
pub(super) fn dress(
    mut commands: Commands,
    mut garments: Query<GarmentItem, Without<SurfaceDisabled>>,
    skins: Skins,
    mut meshes: OwnMeshes,
    mut messages: MessageWriter<XpbdGarmentNotWorn>,
) {
    for mut item in &mut garments {
        let reason = item.dress(&skins, &mut meshes, &mut commands).err();
        // By their text, in which a value that is NaN equals itself.
        let text = reason.as_ref().map(XpbdGarmentError::to_string);
        if item.link.not_worn == text {
            continue;
        }
        if let Some(reason) = reason {
            let entity = item.entity;
            log::warn!("garment {} is not worn: {reason}", Named(entity, item.name));
            let message = XpbdGarmentNotWorn { entity, reason };
            commands.trigger(message.clone());
            messages.write(message);
        }
        item.link.not_worn = text;
    }
}

impl GarmentItemItem<'_, '_> {
    fn dress(
        &mut self,
        skins: &Skins,
        meshes: &mut OwnMeshes,
        commands: &mut Commands,
    ) -> Result<(), XpbdGarmentError> {
        let garment = self.garment;
        let mesh = self.surface.topology();
        let made = self.link.made.take_if(|made| !Arc::ptr_eq(&made.mesh, mesh));
        if made.is_some() {
            // It was made for another mesh.
            commands.entity(self.entity).try_remove::<(XpbdBody, XpbdTethers, WriteSurfaceToMesh)>();
        }
        let Some(worn_by) = skins.of(self.entity, garment)? else { return Ok(()) };
        if let Some(made) = &self.link.made {
            let are_same = worn_by.iter().zip(&made.skins).all(|(skin, known)| Arc::ptr_eq(skin.topology, known));
            if are_same && made.settings == *garment {
                return Ok(());
            }
        }
        check(garment)?;
        check_finite(&self.positions.0)?;
        let to_world = skins.affine(self.entity, *self.frame)?;
        let at = in_world(to_world, &self.positions.0);
        let freedom = if let Some(made) = &self.link.made {
            made.freedom.clone()
        } else {
            let Some(drawn) = meshes.get(self.entity) else { return Ok(()) };
            Freedom::painted(drawn, garment.paint, mesh.vertex_count())?
                .unwrap_or_else(|| Freedom::by_distance(mesh, &at, garment.pinned_height))
        };
        let mut tethers = skins.tethers(&worn_by, &at, garment.clearance)?;
        for tether in &mut tethers {
            tether.longest = freedom.longest(tether.vertex, garment);
            if tether.longest <= 0.0 {
                tether.backstop = f32::INFINITY;
            }
        }
        if self.link.made.is_none() {
            self.make(&at, skins, meshes, commands)?;
        }
        commands.entity(self.entity).try_insert(XpbdTethers::new(tethers));
        let skins = worn_by.iter().map(|skin| Arc::clone(skin.topology)).collect();
        self.link.made = Some(Made { mesh: Arc::clone(mesh), freedom, settings: garment.clone(), skins });
        Ok(())
    }

    /// Makes the body, which is at these places in the world.
    fn make(
        &self,
        at: &[Vec3],
        skins: &Skins,
        meshes: &mut OwnMeshes,
        commands: &mut Commands,
    ) -> Result<(), XpbdGarmentError> {
        let Self { entity, garment, surface, .. } = *self;
        let own = skins.affine(entity, SurfaceFrame::Local)?.inverse();
        let positions = if *self.frame == SurfaceFrame::Local { self.positions.0.clone() } else { in_world(own, at) };
        let rest = meshes.unskinned(entity).map(|mut rest| {
            let scale = own.matrix3.determinant().abs().cbrt() as f32;
            for position in &mut rest {
                *position *= scale;
            }
            rest
        });
        let rest = SurfacePositions(rest.unwrap_or_else(|| positions.clone()));
        let body = XpbdBody::new(surface, &rest, garment.material)?;
        meshes.give(commands, entity, surface, positions, garment.paint.attribute())?;
        let mut commands = commands.entity(entity);
        commands.try_insert((body, WriteSurfaceToMesh::default()));
        if *self.sidedness == Sidedness::Auto && surface.topology().is_closed() {
            commands.try_insert(Sidedness::TwoSided);
        }
        Ok(())
    }
}

fn check(garment: &XpbdGarment) -> Result<(), XpbdGarmentError> {
    let wrong = |what, value, range| Err(XpbdGarmentError::Setting { what, value, range });
    if !(garment.longest.is_finite() && garment.longest >= 0.0) {
        return wrong("the longest distance", garment.longest, "finite and 0 or more");
    }
    if !(0.0..=1.0).contains(&garment.pinned_height) {
        return wrong("the pinned height", garment.pinned_height, "from 0 to 1");
    }
    if garment.clearance.is_finite() { Ok(()) } else { wrong("the clearance", garment.clearance, "finite") }
}
