//! Makes surfaces from meshes, and moves them where Bevy draws the meshes.
//!
//! Before surfaces are gathered: assets, joints, and weights come in, positions go out.

use std::sync::Arc;

use bevy_asset::{AssetEvent, AssetId, Assets};
use bevy_ecs::{
    message::{MessageCursor, Messages},
    prelude::*,
    query::QueryData,
    system::SystemParam,
};
use bevy_math::Affine3A;
use bevy_mesh::{
    Mesh, Mesh3d,
    morph::{MeshMorphWeights, MorphWeights},
    skinning::{SkinnedMesh, SkinnedMeshInverseBindposes},
};
use glam::{DAffine3, Vec3};

use super::{
    SurfaceMeshError,
    components::{Failure, Made, MeshLink, SurfaceFromMesh},
    source::{MeshSource, MeshSources},
};
use crate::{
    kernel::mesh::skinning::{morph, skin},
    surface::{
        components::{DeformableSurface, SurfaceDisabled, SurfaceFrame, SurfacePositions, SurfaceStatus},
        named::Named,
        prepare::{PendingQuarantines, Transforms},
        quarantine::{QuarantineReason, SurfaceQuarantined},
    },
};

#[derive(QueryData)]
#[query_data(mutable)]
pub(super) struct MeshItem {
    entity: Entity,
    from_mesh: &'static SurfaceFromMesh,
    mesh: Option<&'static Mesh3d>,
    skin: Option<&'static SkinnedMesh>,
    weights: Option<&'static MeshMorphWeights>,
    surface: Option<&'static DeformableSurface>,
    positions: Option<&'static mut SurfacePositions>,
    link: &'static mut MeshLink,
    status: &'static mut SurfaceStatus,
    disabled: Has<SurfaceDisabled>,
}

/// What deforms meshes.
#[derive(SystemParam)]
pub(super) struct Deformers<'w, 's> {
    bind_poses: Option<Res<'w, Assets<SkinnedMeshInverseBindposes>>>,
    transforms: Transforms<'w, 's>,
    weights: Query<'w, 's, &'static MorphWeights>,
}

impl Deformers<'_, '_> {
    /// The matrices of the joints, from the mesh to the world. `None` while the bind poses are not loaded.
    fn joints(&self, skin: &SkinnedMesh) -> Result<Option<Vec<Affine3A>>, SurfaceMeshError> {
        let Some(bind_poses) = &self.bind_poses else {
            return Err(SurfaceMeshError::NoAssets("SkinnedMeshInverseBindposes"));
        };
        let Some(bind_poses) = bind_poses.get(&skin.inverse_bindposes) else { return Ok(None) };
        let joints = skin.joints.iter().zip(bind_poses.iter()).map(|(&joint, bind_pose)| {
            let joint = self.transforms.global_affine(joint).map_err(|_| SurfaceMeshError::MissingJoint(joint))?;
            Ok((joint * DAffine3::from_mat4(bind_pose.as_dmat4())).as_affine3a())
        });
        joints.collect::<Result<_, _>>().map(Some)
    }

    fn weights<'a>(&'a self, weights: Option<&'a MeshMorphWeights>) -> &'a [f32] {
        match weights {
            None => &[],
            Some(MeshMorphWeights::Value { weights }) => weights,
            Some(MeshMorphWeights::Reference(entity)) => self.weights.get(*entity).map_or(&[], MorphWeights::weights),
        }
    }
}

/// Positions of a mesh while it is deformed.
#[derive(Default)]
pub(super) struct Scratch {
    morphed: Vec<Vec3>,
    posed: Vec<Vec3>,
}

/// The changes of mesh assets that Bevy has announced.
#[derive(SystemParam)]
pub(super) struct MeshEvents<'w, 's> {
    events: Option<Res<'w, Messages<AssetEvent<Mesh>>>>,
    cursor: Local<'s, MessageCursor<AssetEvent<Mesh>>>,
}

impl MeshEvents<'_, '_> {
    /// The meshes that were modified since the last call.
    fn modified(&mut self) -> Vec<AssetId<Mesh>> {
        let Some(events) = &self.events else { return Vec::new() };
        let modified = self.cursor.read(events).filter_map(|event| match event {
            AssetEvent::Modified { id } => Some(*id),
            _ => None,
        });
        modified.collect()
    }
}

/// Makes and moves surfaces.
pub(super) fn read_meshes(
    mut commands: Commands,
    meshes: Option<Res<Assets<Mesh>>>,
    mut events: MeshEvents,
    mut scratch: Local<Scratch>,
    mut sources: ResMut<MeshSources>,
    mut surfaces: Query<MeshItem>,
    deformers: Deformers,
) {
    let modified = events.modified();
    if let Some(meshes) = &meshes
        && (meshes.is_changed() || !modified.is_empty())
    {
        sources.refresh(meshes, &modified);
    }
    for mut item in &mut surfaces {
        let next = match &meshes {
            Some(meshes) => item.update(meshes, &mut sources, &deformers, &mut scratch, &mut commands),
            None => Err(SurfaceMeshError::NoAssets("Mesh")),
        };
        match next {
            Ok(true) => item.fail(None, &mut commands),
            Ok(false) => {
                item.fail(None, &mut commands);
                item.end(SurfaceStatus::Waiting, &mut commands);
            }
            Err(reason) => item.fail(Some(reason), &mut commands),
        }
    }
    sources.drop_unused();
}

impl MeshItemItem<'_, '_> {
    /// Makes or moves the surface. Whether its assets are loaded.
    fn update(
        &mut self,
        meshes: &Assets<Mesh>,
        sources: &mut MeshSources,
        deformers: &Deformers,
        scratch: &mut Scratch,
        commands: &mut Commands,
    ) -> Result<bool, SurfaceMeshError> {
        let Some(mesh) = self.mesh else { return Ok(false) };
        let key = (mesh.id(), self.from_mesh.weld_distance.to_bits());
        let Some(source) = sources.get(key, meshes) else { return Ok(false) };
        let source = source?;
        let made = self.link.made.as_ref();
        let made = made.filter(|made| {
            let is_same = made.key == key && made.triangles == source.triangles;
            is_same && made.joints.is_some() == self.skin.is_some() && self.surface.is_some()
        });
        if self.disabled && made.is_some() {
            return Ok(true);
        }
        let joints = match self.skin.map(|skin| deformers.joints(skin)).transpose()? {
            Some(None) => return Ok(false),
            Some(joints) => joints,
            None => None,
        };
        let targets = source.displacements.len() / source.positions.len().max(1);
        let weights = deformers.weights(self.weights);
        let weights = &weights[..weights.len().min(targets)];
        let next = |source: &MeshSource| Made {
            key,
            triangles: source.triangles,
            version: source.version,
            joints: joints.clone(),
            weights: weights.to_vec(),
        };
        match made {
            None => {
                let posed = source.pose(joints.as_deref(), weights, scratch)?;
                let surface = source.surface.measured_on(posed);
                let frame = if joints.is_some() { SurfaceFrame::World } else { SurfaceFrame::Local };
                let mut entity = commands.entity(self.entity);
                entity.try_insert((surface, SurfacePositions(posed.to_vec()), frame));
                if self.link.made.is_none() {
                    self.from_mesh.settings.insert(&mut entity);
                }
                self.link.made = Some(next(source));
            }
            Some(made) if made.version != source.version || made.joints != joints || made.weights != weights => {
                let posed = source.pose(joints.as_deref(), weights, scratch)?;
                if let Some(positions) = &mut self.positions {
                    positions.0.clear();
                    positions.0.extend_from_slice(posed);
                }
                self.link.made = Some(next(source));
            }
            Some(_) => {}
        }
        Ok(true)
    }

    /// Quarantines the surface, or ends its quarantine.
    fn fail(&mut self, reason: Option<SurfaceMeshError>, commands: &mut Commands) {
        let Some(reason) = reason else {
            if self.link.failure.is_some() {
                self.link.failure = None;
                self.status.set_if_neq(SurfaceStatus::Waiting);
            }
            return;
        };
        self.end(SurfaceStatus::Quarantined(QuarantineReason::Mesh(reason.clone())), commands);
        match &mut self.link.bypass_change_detection().failure {
            // Another reason for the same quarantine is not reported.
            Some(failure) => failure.reason = reason,
            failure @ None => *failure = Some(Failure { reason, is_reported: false }),
        }
    }

    /// Ends the surface.
    fn end(&mut self, status: SurfaceStatus, commands: &mut Commands) {
        if self.link.made.is_some() {
            self.link.made = None;
            commands.entity(self.entity).try_remove::<DeformableSurface>();
        } else if self.surface.is_some() {
            // The game's own.
            return;
        }
        self.status.set_if_neq(status);
    }
}

impl DeformableSurface {
    /// The same surface, its lengths in the unit of these positions.
    pub(super) fn measured_on(&self, positions: &[Vec3]) -> Self {
        let mean_edge = self.topology.mean_edge_length(positions) as f32;
        Self { topology: Arc::clone(&self.topology), mean_edge }
    }
}

impl MeshSource {
    /// The positions where Bevy draws them.
    fn pose<'a>(
        &'a self,
        joints: Option<&[Affine3A]>,
        weights: &[f32],
        scratch: &'a mut Scratch,
    ) -> Result<&'a [Vec3], SurfaceMeshError> {
        let Scratch { morphed, posed } = scratch;
        let rest = if weights.iter().any(|&weight| weight != 0.0) {
            morph(&self.positions, &self.displacements, weights, morphed);
            morphed
        } else {
            &self.positions
        };
        let Some(joints) = joints else { return Ok(rest) };
        let influences = self.influences.as_ref().map_err(Clone::clone)?;
        for (vertex, influences) in influences.iter().enumerate() {
            if let Some((joint, _)) = influences.acting().find(|&(joint, _)| usize::from(joint) >= joints.len()) {
                return Err(SurfaceMeshError::JointOutOfRange { vertex, joint, joints: joints.len() });
            }
        }
        skin(rest, influences, joints, posed);
        Ok(posed)
    }
}

/// Queues messages about meshes that cannot be surfaces. After the surfaces were gathered, which empties the queue.
pub(super) fn report_failures(
    mut links: Query<(Entity, Option<&Name>, &mut MeshLink)>,
    mut quarantines: ResMut<PendingQuarantines>,
) {
    for (entity, name, mut link) in &mut links {
        let failure = link.bypass_change_detection().failure.as_mut();
        if let Some(failure) = failure.filter(|failure| !failure.is_reported) {
            failure.is_reported = true;
            log::warn!("surface {} is quarantined: {}", Named(entity, name), failure.reason);
            let reason = QuarantineReason::Mesh(failure.reason.clone());
            quarantines.0.push(SurfaceQuarantined { entity, reason });
        }
    }
}
