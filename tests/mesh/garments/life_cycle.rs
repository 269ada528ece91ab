//! Garments and skins that are paused, replaced, and despawned.

use bevy_app::prelude::*;
use bevy_circumsphere::{prelude::*, response::*};
use bevy_ecs::{entity_disabling::Disabled, prelude::*};
use bevy_mesh::Mesh3d;
use bevy_transform::components::Transform;
use circumsphere_support::scenes::{Character, CharacterFineness, character_skirt};
use glam::Vec3;

use super::character::{SEGMENTS, Walker, app, crossings, is_worn, skirt, spawn_garment, tethers, tick, world_points};
use crate::world::{add, indexed, points};

/// A character in a skirt, dressed.
fn dressed(speed: f64) -> (App, Walker, Entity, Entity) {
    let mut app = app();
    let walker = Walker::new(&mut app, speed);
    let skin = walker.spawn_skin(&mut app);
    let mesh = add(&mut app, indexed(&skirt()));
    let garment = spawn_garment(&mut app, mesh, XpbdGarment::worn_by([skin]));
    tick(&mut app);
    assert!(is_worn(&app, garment));
    (app, walker, skin, garment)
}

/// The farthest pinned vertex from where the torso has it.
fn off_the_waist(app: &App, walker: &Walker, garment: Entity, segments: usize) -> f32 {
    let waist = character_skirt(1, segments).positions;
    let expected = walker.character.follow_torso(walker.time, &waist[..segments]);
    let at = world_points(app, garment);
    expected.iter().zip(&at).map(|(expected, at)| Vec3::from(*expected).distance(*at)).fold(0.0, f32::max)
}

#[test]
fn nothing_is_made_again_while_nothing_changes() {
    let (mut app, mut walker, _, garment) = dressed(3.0);
    let mesh = app.world().get::<Mesh3d>(garment).expect("it is drawn").clone();
    let tethers = tethers(&app, garment);
    for _ in 0..10 {
        walker.walk(&mut app);
    }
    assert_eq!(app.world().get::<Mesh3d>(garment), Some(&mesh));
    assert_eq!(super::character::tethers(&app, garment), tethers);
    let body = app.world().get::<XpbdBody>(garment).expect("it is worn");
    assert!(body.velocities.iter().any(|velocity| velocity.length() > 0.1), "it moves");
}

#[test]
fn paused_garments_and_skins_are_dressed_when_they_are_back() {
    type Pause = fn(&mut EntityWorldMut);
    let pauses: [(Pause, Pause); 2] = [
        (|entity| _ = entity.insert(Disabled), |entity| _ = entity.remove::<Disabled>()),
        (|entity| _ = entity.insert(SurfaceDisabled), |entity| _ = entity.remove::<SurfaceDisabled>()),
    ];
    for (pause, resume) in pauses {
        for of_skin in [false, true] {
            let mut app = app();
            let mut walker = Walker::new(&mut app, 3.0);
            let skin = walker.spawn_skin(&mut app);
            let mesh = walker.skinned(&mut app, indexed(&skirt()), &vec![0.0; skirt().positions.len()]);
            let garment = spawn_garment(&mut app, mesh, XpbdGarment::worn_by([skin]));
            let paused = if of_skin { skin } else { garment };
            pause(&mut app.world_mut().entity_mut(paused));
            for _ in 0..5 {
                walker.walk(&mut app);
            }
            assert!(!is_worn(&app, garment));
            resume(&mut app.world_mut().entity_mut(paused));
            for _ in 0..5 {
                walker.walk(&mut app);
            }
            assert!(is_worn(&app, garment));
            assert_eq!(crossings(&app, skin, garment)[0], 0);
            assert!(off_the_waist(&app, &walker, garment, SEGMENTS) < 1.0e-3);
        }
    }
}

/// A character that comes out of a pool elsewhere: the garment is a child of what moves, as in a file.
#[test]
fn a_worn_garment_comes_out_of_a_pool_with_its_character() {
    let mut app = app();
    let walker = Walker::new(&mut app, 0.0);
    let root = app.world_mut().spawn(Transform::default()).id();
    let skin = walker.spawn_skin(&mut app);
    let mesh = add(&mut app, indexed(&skirt()));
    let garment = spawn_garment(&mut app, mesh, XpbdGarment::worn_by([skin]));
    app.world_mut().entity_mut(root).add_children(&walker.joints.all()).add_child(garment);
    for _ in 0..10 {
        tick(&mut app);
    }
    let before = world_points(&app, garment);
    for entity in [skin, garment] {
        app.world_mut().entity_mut(entity).insert(Disabled);
    }
    tick(&mut app);
    *app.world_mut().get_mut::<Transform>(root).expect("it has one") = Transform::from_xyz(20.0, 3.0, 0.0);
    for entity in [skin, garment] {
        app.world_mut().entity_mut(entity).remove::<Disabled>();
    }
    for _ in 0..5 {
        tick(&mut app);
    }
    // In the frame of the root, as before.
    for (before, after) in before.iter().zip(world_points(&app, garment)) {
        assert!(before.distance(after) < 0.05, "{before} {after}");
    }
}

#[test]
fn another_mesh_is_dressed_anew() {
    let (mut app, mut walker, skin, garment) = dressed(3.0);
    for _ in 0..8 {
        walker.walk(&mut app);
    }
    // Where the joints have it.
    let finer = character_skirt(6, 32);
    let mesh = walker.skinned(&mut app, indexed(&finer), &vec![0.0; finer.positions.len()]);
    app.world_mut().entity_mut(garment).insert(mesh);
    for _ in 0..12 {
        walker.walk(&mut app);
        assert_eq!(crossings(&app, skin, garment)[0], 0);
    }
    assert_eq!(tethers(&app, garment).len(), finer.positions.len());
    let pinned = tethers(&app, garment).iter().filter(|tether| tether.longest == 0.0).count();
    assert_eq!(pinned, 32);
    assert!(off_the_waist(&app, &walker, garment, 32) < 1.0e-3);
    // One that cannot be worn leaves no body of the one before.
    let finer = indexed(&finer).with_inserted_attribute(XpbdGarment::ATTRIBUTE_FREEDOM, vec![f32::NAN; 7 * 32]);
    let mesh = add(&mut app, finer);
    app.world_mut().entity_mut(garment).insert(mesh);
    walker.walk(&mut app);
    assert!(!is_worn(&app, garment));
}

#[test]
fn another_mesh_of_the_skin_is_worn_on() {
    let (mut app, mut walker, skin, garment) = dressed(0.0);
    for _ in 0..8 {
        walker.walk(&mut app);
    }
    let velocities = app.world().get::<XpbdBody>(garment).expect("it is worn").velocities.clone();
    let hanging = world_points(&app, garment);
    // A finer level of detail: its triangles have other numbers.
    walker.character = Character::new(CharacterFineness::Fine, 3.0);
    let fine = walker.skin(&mut app);
    app.world_mut().entity_mut(skin).insert(fine);
    walker.time = 0.0;
    tick(&mut app);
    assert_eq!(app.world().get::<XpbdBody>(garment).expect("it is worn").velocities.len(), velocities.len());
    for (before, after) in hanging.iter().zip(world_points(&app, garment)) {
        assert!(before.distance(after) < 0.01, "it hangs as before");
    }
    for _ in 0..15 {
        walker.walk(&mut app);
        assert_eq!(crossings(&app, skin, garment)[0], 0);
    }
    assert!(off_the_waist(&app, &walker, garment, SEGMENTS) < 2.0e-3);
}

#[test]
fn settings_can_be_changed_while_it_is_worn() {
    let (mut app, _, skin, garment) = dressed(0.0);
    let mesh = app.world().get::<Mesh3d>(garment).expect("it is drawn").clone();
    app.world_mut().get_mut::<XpbdGarment>(garment).expect("it is one").longest = 0.05;
    tick(&mut app);
    let longest = tethers(&app, garment).iter().map(|tether| tether.longest).fold(0.0, f32::max);
    assert_eq!(longest, 0.05);
    assert_eq!(app.world().get::<Mesh3d>(garment), Some(&mesh), "body and mesh stay");
    assert!(app.world().get_entity(skin).is_ok());
}

#[test]
fn without_its_skin_a_garment_falls_and_with_its_character_it_goes() {
    let (mut app, _, skin, garment) = dressed(0.0);
    for _ in 0..10 {
        tick(&mut app);
    }
    let before = world_points(&app, garment)[0].y;
    app.world_mut().despawn(skin);
    for _ in 0..30 {
        tick(&mut app);
    }
    let fallen = before - world_points(&app, garment)[0].y;
    assert!(fallen > 0.3, "{fallen}");
    assert!(world_points(&app, garment).iter().all(|at| at.is_finite()));
    app.world_mut().despawn(garment);
    tick(&mut app);
    // A new one is worn by others.
    let walker = Walker::new(&mut app, 0.0);
    let skin = walker.spawn_skin(&mut app);
    let mesh = add(&mut app, indexed(&skirt()));
    let garment = spawn_garment(&mut app, mesh, XpbdGarment::worn_by([skin]));
    tick(&mut app);
    assert!(is_worn(&app, garment) && world_points(&app, garment)[0].distance(points(&skirt())[0]) < 0.01);
}
