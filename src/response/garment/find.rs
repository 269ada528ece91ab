//! Makes garments of the meshes below a root, as soon as they are there.

use bevy_ecs::{entity::EntityHashSet, entity_disabling::Disabled, prelude::*, query::Allow};
use bevy_mesh::Mesh3d;

use super::components::{XpbdGarment, XpbdGarments};
use crate::surface::Named;

type New = Or<(Added<Mesh3d>, Changed<ChildOf>, Changed<XpbdGarments>)>;

/// Also of what is disabled, as in a pool: nothing tells when it is enabled.
type Any = Allow<Disabled>;

/// Inserts [`XpbdGarment`] into meshes that are new below a root, and adds new skins to those that are there.
#[expect(clippy::too_many_arguments, reason = "a system that looks for meshes by name below characters")]
pub(super) fn find_garments(
    mut commands: Commands,
    changed: Query<Entity, (New, Any)>,
    roots: Query<&XpbdGarments, Any>,
    mut meshes: Query<Option<&mut XpbdGarment>, (With<Mesh3d>, Any)>,
    parents: Query<&ChildOf, Any>,
    children: Query<&Children, Any>,
    names: Query<&Name, Any>,
    mut told: Local<EntityHashSet>,
) {
    let mut fresh = EntityHashSet::default();
    let mut due = Vec::new();
    for top in &changed {
        fresh.insert(top);
        fresh.extend(children.iter_descendants(top));
        let above = std::iter::once(top).chain(parents.iter_ancestors(top));
        due.extend(above.chain(children.iter_descendants(top)).filter(|&entity| roots.contains(entity)));
    }
    due.sort_unstable();
    due.dedup();
    for root in due {
        let Ok(garments) = roots.get(root) else { continue };
        // Those of a root below this one are its own.
        let below = children.iter_descendants(root).filter(|&entity| {
            meshes.contains(entity) && parents.iter_ancestors(entity).find(|&above| roots.contains(above)) == Some(root)
        });
        let below: Vec<Entity> = below.collect();
        let listed = |name: &str| name == garments.skin || garments.by_name.contains_key(name);
        let names_of = |entity| {
            let above = std::iter::once(entity).chain(parents.iter_ancestors(entity));
            above.take_while(|&above| above != root).filter_map(|above| names.get(above).ok()).map(Name::as_str)
        };
        let named = below.iter().filter_map(|&entity| Some((entity, names_of(entity).find(|name| listed(name))?)));
        let named: Vec<(Entity, &str)> = named.collect();
        let mut missing: Vec<&str> = garments.by_name.keys().map(String::as_str).collect();
        missing.retain(|&wanted| named.iter().all(|&(_, name)| name != wanted));
        if !(missing.is_empty() || below.is_empty()) && told.insert(root) {
            missing.sort_unstable();
            let mut there: Vec<&str> = below.iter().flat_map(|&entity| names_of(entity)).collect();
            there.sort_unstable();
            there.dedup();
            log::warn!(
                "no mesh below {} is called {missing:?}, so there is no such garment yet: meshes, and what they are below, are \
                 called {there:?}",
                Named(root, names.get(root).ok())
            );
        }
        let mut skins: Vec<Entity> = named.iter().filter(|(_, name)| *name == garments.skin).map(|of| of.0).collect();
        skins.sort_unstable();
        for (entity, name) in named {
            let Some(wanted) = garments.by_name.get(name) else { continue };
            let skins = if wanted.skins.is_empty() { &skins } else { &wanted.skins };
            match meshes.get_mut(entity) {
                Ok(Some(mut garment)) if garment.skins != *skins => garment.skins.clone_from(skins),
                Ok(None) if fresh.contains(&entity) => {
                    commands.entity(entity).try_insert(XpbdGarment { skins: skins.clone(), ..wanted.clone() });
                }
                _ => {}
            }
        }
    }
}
