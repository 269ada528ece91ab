//! Garments of characters that are spawned as scenes.

use bevy_app::prelude::*;
use bevy_circumsphere::{prelude::*, response::*};
use bevy_ecs::prelude::*;
use bevy_mesh::Mesh3d;
use bevy_transform::components::Transform;
use circumsphere_support::{scenes, warnings};

use super::character::{THICKNESS, Walker, app, crossings, is_worn, skirt, tethers, tick};
use crate::world::{add, indexed};

fn root(app: &mut App, garments: XpbdGarments) -> Entity {
    let settings = SurfaceSettings { thickness: Some(THICKNESS), ..SurfaceSettings::default() };
    let surfaces = SurfaceFromMeshHierarchy::new(SurfaceFromMesh::default().with_settings(settings));
    app.world_mut().spawn((garments, surfaces, Transform::default())).id()
}

/// A node with a mesh below it, as in a glTF scene.
fn node(app: &mut App, root: Entity, name: &'static str, mesh: impl Bundle) -> Entity {
    let node = app.world_mut().spawn((Name::new(name), Transform::default(), ChildOf(root))).id();
    app.world_mut().spawn((mesh, Name::new(format!("{name}.material")), Transform::default(), ChildOf(node))).id()
}

fn garments() -> XpbdGarments {
    XpbdGarments::worn_by("Skin").with_name("Skirt", XpbdGarment { longest: 0.25, ..XpbdGarment::default() })
}

/// One half of a mesh's triangles, with all of its vertices.
fn half(mesh: &scenes::Mesh, second: bool) -> scenes::Mesh {
    let (first, last) = mesh.triangles.split_at(mesh.triangles.len() / 2);
    scenes::Mesh { positions: mesh.positions.clone(), triangles: if second { last } else { first }.to_vec() }
}

#[test]
fn two_characters_of_one_file_are_dressed_by_the_names_of_their_meshes() {
    let mut app = app();
    let mut walker = Walker::new(&mut app, 3.0);
    let (skin, mesh) = (walker.skin(&mut app), add(&mut app, indexed(&skirt())));
    // Both stand at one place, so each lets the other through.
    let spawn = |app: &mut App, bit: u32| {
        let own = SurfaceLayers { memberships: 1 << bit, filters: 1 << bit };
        let root = root(app, garments());
        let skirt = node(app, root, "Skirt", (mesh.clone(), own));
        (node(app, root, "Skin", (skin.clone(), own)), skirt)
    };
    let worn = [spawn(&mut app, 0), spawn(&mut app, 1)];
    tick(&mut app);
    for (skin, skirt) in worn {
        assert!(is_worn(&app, skirt));
        let garment = app.world().get::<XpbdGarment>(skirt).expect("it is one");
        assert_eq!((&garment.skins[..], garment.longest), (&[skin][..], 0.25));
        assert_eq!(app.world().get::<SurfaceThickness>(skirt), Some(&THICKNESS), "settings of the hierarchy");
        assert!(!app.world().entity(skin).contains::<XpbdBody>());
    }
    let meshes = worn.map(|(_, skirt)| app.world().get::<Mesh3d>(skirt).expect("it is drawn").clone());
    assert_ne!(meshes[0], meshes[1]);
    for _ in 0..10 {
        walker.walk(&mut app);
    }
    for (skin, skirt) in worn {
        assert_eq!(crossings(&app, skin, skirt)[0], 0);
    }
}

/// A body with two materials is two meshes, and each vertex is tethered to the nearer one.
#[test]
fn a_skin_may_have_several_parts_and_come_later() {
    let mut app = app();
    let walker = Walker::new(&mut app, 0.0);
    let root = root(&mut app, garments());
    let mesh = add(&mut app, indexed(&skirt()));
    let skirt = node(&mut app, root, "Skirt", mesh);
    tick(&mut app);
    assert!(!is_worn(&app, skirt), "there is no skin yet");
    let shares: Vec<f32> = walker.character.leg_shares().iter().map(|&share| share as f32).collect();
    let parts = [false, true].map(|second| {
        let mesh = indexed(&half(walker.character.rest(), second));
        let mesh = walker.skinned(&mut app, mesh, &shares);
        node(&mut app, root, "Skin", mesh)
    });
    tick(&mut app);
    assert!(is_worn(&app, skirt));
    let targets: Vec<Entity> = tethers(&app, skirt)
        .iter()
        .map(|tether| match tether.target {
            TetherTarget::Surface { entity, .. } => entity,
            other => panic!("{other:?}"),
        })
        .collect();
    for part in parts {
        assert!(targets.iter().filter(|target| **target == part).count() > 20, "{targets:?}");
    }
    // The same places as on one mesh.
    let whole = walker.spawn_skin(&mut app);
    let mesh = add(&mut app, indexed(&super::character::skirt()));
    let other =
        super::character::spawn_garment(&mut app, mesh, XpbdGarment { longest: 0.25, ..XpbdGarment::worn_by([whole]) });
    for entity in [whole, other] {
        app.world_mut().entity_mut(entity).insert(SurfaceLayers { memberships: 2, filters: 2 });
    }
    tick(&mut app);
    let heights = |entity: Entity| -> Vec<f32> {
        let height = |tether: &Tether| match tether.target {
            TetherTarget::Surface { height, .. } => height,
            _ => f32::NAN,
        };
        tethers(&app, entity).iter().map(height).collect()
    };
    for (one, other) in heights(skirt).into_iter().zip(heights(other)) {
        assert!((one - other).abs() < 1.0e-5, "{one} {other}");
    }
}

#[test]
fn what_the_game_has_removed_or_named_itself_stays() {
    let mut app = app();
    let walker = Walker::new(&mut app, 0.0);
    let own_skin = walker.spawn_skin(&mut app);
    let own = XpbdGarments { by_name: [("Skirt".to_owned(), XpbdGarment::worn_by([own_skin]))].into(), ..garments() };
    let root = root(&mut app, own);
    let (skin, mesh) = (walker.skin(&mut app), add(&mut app, indexed(&skirt())));
    node(&mut app, root, "Skin", skin);
    let skirt = node(&mut app, root, "Skirt", mesh.clone());
    tick(&mut app);
    assert_eq!(app.world().get::<XpbdGarment>(skirt).expect("it is one").skins, [own_skin]);
    app.world_mut().entity_mut(skirt).remove::<XpbdGarment>();
    let late = node(&mut app, root, "Skirt", mesh);
    tick(&mut app);
    assert!(!app.world().entity(skirt).contains::<XpbdGarment>() && is_worn(&app, skirt), "body and tethers stay");
    assert!(is_worn(&app, late));
}

#[test]
fn a_garment_whose_name_no_mesh_has_is_told_once_with_the_names_that_there_are() {
    warnings::kept();
    let mut app = app();
    let mut walker = Walker::new(&mut app, 0.0);
    let (skin, mesh) = (walker.skin(&mut app), add(&mut app, indexed(&skirt())));
    let misspelt = garments().with_name("Skrit", XpbdGarment::default());
    let root = root(&mut app, misspelt);
    app.world_mut().entity_mut(root).insert(Name::new("Misspelling"));
    // Nothing is below it yet.
    tick(&mut app);
    let told = || warnings::kept().into_iter().filter(|line| line.contains("Misspelling")).collect::<Vec<_>>();
    assert!(told().is_empty(), "{:?}", told());
    node(&mut app, root, "Skirt", mesh.clone());
    node(&mut app, root, "Skin", skin);
    walker.walk(&mut app);
    node(&mut app, root, "Hat", mesh);
    walker.walk(&mut app);
    let told = told();
    assert_eq!(told.len(), 1, "{told:?}");
    assert!(["\"Skrit\"", "\"Skirt\"", "\"Skin\""].iter().all(|name| told[0].contains(name)), "{told:?}");
}
