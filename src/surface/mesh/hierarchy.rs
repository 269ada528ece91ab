//! Makes surfaces of the meshes below a root, as soon as they are there.

use bevy_ecs::{entity_disabling::Disabled, prelude::*, query::Allow};
use bevy_mesh::Mesh3d;

use super::components::{SurfaceFromMesh, SurfaceFromMeshHierarchy};

type New = Or<(Added<Mesh3d>, Changed<ChildOf>, Changed<SurfaceFromMeshHierarchy>)>;

/// Also of what is disabled, as in a pool: nothing tells when it is enabled.
type Any = Allow<Disabled>;

/// Inserts [`SurfaceFromMesh`] into meshes that are new below a root.
pub(super) fn find_meshes(
    mut commands: Commands,
    changed: Query<Entity, (New, Any)>,
    roots: Query<&SurfaceFromMeshHierarchy, Any>,
    meshes: Query<(), (With<Mesh3d>, Without<SurfaceFromMesh>, Any)>,
    parents: Query<&ChildOf, Any>,
    children: Query<&Children, Any>,
    names: Query<&Name, Any>,
) {
    for top in &changed {
        let below = children.iter_descendants(top);
        for entity in std::iter::once(top).chain(below).filter(|&entity| meshes.contains(entity)) {
            let Some(root) = parents.iter_ancestors(entity).find(|&ancestor| roots.contains(ancestor)) else {
                continue;
            };
            let Ok(hierarchy) = roots.get(root) else { continue };
            let named = std::iter::once(entity)
                .chain(parents.iter_ancestors(entity))
                .take_while(|&ancestor| ancestor != root)
                .find_map(|ancestor| hierarchy.by_name.get(names.get(ancestor).ok()?.as_str()));
            if let Some(from_mesh) = named.unwrap_or(&hierarchy.default) {
                commands.entity(entity).try_insert_if_new(from_mesh.clone());
            }
        }
    }
}
