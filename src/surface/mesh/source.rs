//! Meshes as surfaces: each is converted once, for all entities that have it, and compared with its asset whenever mesh
//! assets have changed.

use std::collections::HashMap;

use bevy_asset::{AssetId, Assets};
use bevy_ecs::prelude::*;
use bevy_mesh::{Indices, Mesh, MeshAccessError, PrimitiveTopology, VertexAttributeValues};
use bytemuck::cast_slice;
use glam::Vec3;

use super::{SurfaceMeshError, components::SourceKey};
use crate::{kernel::mesh::skinning::Influences, surface::components::DeformableSurface};

/// A mesh as a surface.
pub(super) struct MeshSource {
    pub(super) surface: DeformableSurface,
    /// The positions in the asset.
    pub(super) positions: Vec<Vec3>,
    /// Empty if the mesh has none.
    pub(super) influences: Result<Vec<Influences>, SurfaceMeshError>,
    /// The displacements of the morph targets: one per vertex for each target in turn.
    pub(super) displacements: Vec<Vec3>,
    /// Two versions of the triangles are never equal.
    pub(super) triangles: u64,
    /// Two versions of everything else are never equal.
    pub(super) version: u64,
}

/// The meshes that surfaces are made from.
#[derive(Resource, Default)]
pub(super) struct MeshSources {
    sources: HashMap<SourceKey, Entry>,
    last_version: u64,
}

struct Entry {
    source: Result<MeshSource, SurfaceMeshError>,
    is_used: bool,
}

impl MeshSources {
    /// Compares all sources with their assets. Those of `modified` are read again in full.
    pub(super) fn refresh(&mut self, meshes: &Assets<Mesh>, modified: &[AssetId<Mesh>]) {
        let last_version = &mut self.last_version;
        self.sources.retain(|&(id, weld), entry| {
            let Some(mesh) = meshes.get(id) else { return false };
            let is_current = match &mut entry.source {
                Ok(source) => source.refresh(mesh, modified.contains(&id), last_version),
                Err(_) => false,
            };
            if !is_current {
                entry.source = MeshSource::new(mesh, f32::from_bits(weld), last_version);
            }
            true
        });
    }

    /// The source of a mesh. `None` if the asset is not loaded.
    pub(super) fn get(
        &mut self,
        key: SourceKey,
        meshes: &Assets<Mesh>,
    ) -> Option<Result<&MeshSource, SurfaceMeshError>> {
        if !self.sources.contains_key(&key) {
            let source = MeshSource::new(meshes.get(key.0)?, f32::from_bits(key.1), &mut self.last_version);
            self.sources.insert(key, Entry { source, is_used: true });
        }
        let entry = self.sources.get_mut(&key)?;
        entry.is_used = true;
        Some(entry.source.as_ref().map_err(Clone::clone))
    }

    /// A source that has been asked for.
    pub(super) fn known(&self, key: SourceKey) -> Option<&MeshSource> {
        self.sources.get(&key)?.source.as_ref().ok()
    }

    /// Takes over a mesh that is neither skinned nor morphed, and whose surface is known. Returns the versions of its
    /// triangles and of everything else.
    pub(super) fn insert(&mut self, key: SourceKey, surface: &DeformableSurface, positions: &[Vec3]) -> [u64; 2] {
        let version = &mut self.last_version;
        let source = MeshSource {
            surface: surface.clone(),
            positions: positions.to_vec(),
            influences: Err(SurfaceMeshError::NoInfluences),
            displacements: Vec::new(),
            triangles: next(version),
            version: next(version),
        };
        let versions = [source.triangles, source.version];
        self.sources.insert(key, Entry { source: Ok(source), is_used: true });
        versions
    }

    /// What moves the vertices of a skinned mesh.
    pub(super) fn influences(&self, key: SourceKey) -> Option<&[Influences]> {
        self.known(key)?.influences.as_deref().ok()
    }

    /// The positions that the asset is known to have.
    pub(super) fn positions_mut(&mut self, key: SourceKey) -> Option<&mut Vec<Vec3>> {
        self.sources.get_mut(&key)?.source.as_mut().ok().map(|source| &mut source.positions)
    }

    /// Forgets the sources that nobody asked for since the last call.
    pub(super) fn drop_unused(&mut self) {
        self.sources.retain(|_, entry| std::mem::take(&mut entry.is_used));
    }
}

fn next(version: &mut u64) -> u64 {
    *version += 1;
    *version
}

impl MeshSource {
    fn new(mesh: &Mesh, weld_distance: f32, version: &mut u64) -> Result<Self, SurfaceMeshError> {
        let positions = positions_of(mesh)?;
        let triangles = triangles_of(mesh)?;
        let builder = DeformableSurface::builder(positions, &triangles).weld_within(weld_distance);
        let (surface, positions) = builder.build()?;
        let (influences, displacements) = (influences_of(mesh)?, displacements_of(mesh, positions.0.len())?);
        Ok(Self {
            surface,
            positions: positions.0,
            influences,
            displacements,
            triangles: next(version),
            version: next(version),
        })
    }

    /// Takes changed positions and, if it was reported as modified, other attributes from the asset. Whether the
    /// triangles are still the same.
    fn refresh(&mut self, mesh: &Mesh, is_modified: bool, version: &mut u64) -> bool {
        let positions = match positions_of(mesh) {
            Ok(positions) => positions,
            // The renderer took the data. It has not changed since it was read.
            Err(SurfaceMeshError::OnlyInRenderWorld) => return true,
            Err(_) => return false,
        };
        let triangles = self.surface.topology().triangles();
        let (mut count, mut are_equal) = (0, positions.len() == self.positions.len());
        let visited = visit_triangles(mesh, positions.len(), |triangle| {
            are_equal &= triangles.get(count) == Some(&triangle);
            count += 1;
        });
        if visited.is_err() || !are_equal || count != triangles.len() {
            return false;
        }
        if cast_slice::<Vec3, u8>(positions) != cast_slice::<Vec3, u8>(&self.positions) {
            self.positions.copy_from_slice(positions);
            self.version = next(version);
        }
        if is_modified {
            let (Ok(influences), Ok(displacements)) = (influences_of(mesh), displacements_of(mesh, positions.len()))
            else {
                return false;
            };
            if influences != self.influences || displacements != self.displacements {
                (self.influences, self.displacements) = (influences, displacements);
                self.version = next(version);
            }
        }
        true
    }
}

/// An error of access to an attribute that is there.
pub(super) fn extracted(_: MeshAccessError) -> SurfaceMeshError {
    SurfaceMeshError::OnlyInRenderWorld
}

pub(super) fn positions_of(mesh: &Mesh) -> Result<&[Vec3], SurfaceMeshError> {
    match mesh.try_attribute_option(Mesh::ATTRIBUTE_POSITION).map_err(extracted)? {
        Some(VertexAttributeValues::Float32x3(positions)) => Ok(cast_slice(positions)),
        Some(other) => Err(SurfaceMeshError::PositionFormat(other.into())),
        None => Err(SurfaceMeshError::NoPositions),
    }
}

pub(super) fn triangles_of(mesh: &Mesh) -> Result<Vec<[u32; 3]>, SurfaceMeshError> {
    let mut triangles = Vec::new();
    visit_triangles(mesh, positions_of(mesh)?.len(), |triangle| triangles.push(triangle))?;
    Ok(triangles)
}

/// The joints and weights of all vertices. The inner error is one of skinning only.
fn influences_of(mesh: &Mesh) -> Result<Result<Vec<Influences>, SurfaceMeshError>, SurfaceMeshError> {
    let joints = mesh.try_attribute_option(Mesh::ATTRIBUTE_JOINT_INDEX).map_err(extracted)?;
    let weights = mesh.try_attribute_option(Mesh::ATTRIBUTE_JOINT_WEIGHT).map_err(extracted)?;
    let (Some(joints), Some(weights)) = (joints, weights) else { return Ok(Err(SurfaceMeshError::NoInfluences)) };
    let VertexAttributeValues::Uint16x4(joints) = joints else { return Ok(Err(SurfaceMeshError::InfluenceFormat)) };
    let influences = |weight: &dyn Fn(usize) -> [f32; 4]| {
        let all = joints.iter().enumerate();
        Ok(all.map(|(vertex, &joints)| Influences { joints, weights: weight(vertex) }).collect())
    };
    let count = mesh.count_vertices();
    Ok(match weights {
        _ if joints.len() != count || weights.len() != count => Err(SurfaceMeshError::InfluenceFormat),
        VertexAttributeValues::Float32x4(weights) => influences(&|vertex| weights[vertex]),
        VertexAttributeValues::Unorm16x4(weights) => {
            influences(&|vertex| weights[vertex].map(|weight| f32::from(weight) / f32::from(u16::MAX)))
        }
        VertexAttributeValues::Unorm8x4(weights) => {
            influences(&|vertex| weights[vertex].map(|weight| f32::from(weight) / f32::from(u8::MAX)))
        }
        _ => Err(SurfaceMeshError::InfluenceFormat),
    })
}

fn displacements_of(mesh: &Mesh, vertices: usize) -> Result<Vec<Vec3>, SurfaceMeshError> {
    let targets = match mesh.try_morph_targets() {
        Ok(targets) => targets,
        Err(MeshAccessError::NotFound) => return Ok(Vec::new()),
        Err(error) => return Err(extracted(error)),
    };
    if targets.len().checked_rem(vertices) != Some(0) {
        return Err(SurfaceMeshError::MorphTargets { vertices, displacements: targets.len() });
    }
    Ok(targets.iter().map(|target| target.position).collect())
}

/// Visits the triangles of a mesh in order.
fn visit_triangles(mesh: &Mesh, vertices: usize, visit: impl FnMut([u32; 3])) -> Result<(), SurfaceMeshError> {
    let is_strip = match mesh.primitive_topology() {
        PrimitiveTopology::TriangleList => false,
        PrimitiveTopology::TriangleStrip => true,
        other => return Err(SurfaceMeshError::Topology(other)),
    };
    match mesh.try_indices_option().map_err(extracted)? {
        None => visit_corners(0..vertices as u32, is_strip, visit),
        Some(Indices::U16(indices)) => {
            // Where a strip restarts.
            let widen = |&index: &u16| if is_strip && index == u16::MAX { u32::MAX } else { u32::from(index) };
            visit_corners(indices.iter().map(widen), is_strip, visit);
        }
        Some(Indices::U32(indices)) => visit_corners(indices.iter().copied(), is_strip, visit),
    }
    Ok(())
}

/// Visits the triangles of a list of corners, as a graphics card does: corners that are left over make no triangle,
/// and [`u32::MAX`] begins a new strip. Every second triangle of a strip has its first two corners swapped, so that all
/// face the same side. Triangles of a strip that name a vertex twice only lead on, and are left out.
fn visit_corners(corners: impl Iterator<Item = u32>, is_strip: bool, mut visit: impl FnMut([u32; 3])) {
    let mut triangle = [0; 3];
    let mut count = 0;
    for corner in corners {
        if is_strip && corner == u32::MAX {
            count = 0;
            continue;
        }
        triangle = [triangle[1], triangle[2], corner];
        count += 1;
        let [a, b, c] = triangle;
        if !is_strip {
            if count % 3 == 0 {
                visit(triangle);
            }
        } else if count >= 3 && a != b && b != c && c != a {
            visit(if count % 2 == 1 { [a, b, c] } else { [b, a, c] });
        }
    }
}
