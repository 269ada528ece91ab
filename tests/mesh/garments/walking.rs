//! Garments follow characters that walk, and do not pass through them.

use bevy_app::prelude::*;
use bevy_circumsphere::{prelude::*, response::*};
use bevy_ecs::prelude::*;
use bevy_mesh::{Mesh, skinning::SkinnedMesh};
use bevy_transform::components::Transform;
use glam::Vec3;

use super::character::{RINGS, SEGMENTS, Walker, app, crossings, is_worn, skirt, spawn_garment, tick, world_points};
use crate::world::{add, indexed, points};

/// Walks, and checks the garment in every tick. The truth for pinned vertices is the formula of the torso, which they are
/// in front of.
fn walk(app: &mut App, walker: &mut Walker, skin: Entity, garment: Entity, fitted: &[Vec3], ticks: usize) {
    let start = world_points(app, garment)[0];
    let waist: Vec<[f32; 3]> = fitted[..SEGMENTS].iter().map(Vec3::to_array).collect();
    let all: Vec<[f32; 3]> = fitted.iter().map(Vec3::to_array).collect();
    let (mut nearest, mut farthest) = (0, 0.0_f32);
    for number in 0..ticks {
        walker.walk(app);
        let at = world_points(app, garment);
        for (expected, found) in walker.character.follow_torso(walker.time, &waist).iter().zip(&at) {
            let distance = Vec3::from(*expected).distance(*found);
            assert!(distance < 1.0e-3, "tick {number}: a pinned vertex is {distance} from its place");
        }
        let rigid = walker.character.follow_torso(walker.time, &all);
        let moved = rigid.iter().zip(&at).map(|(rigid, at)| Vec3::from(*rigid).distance(*at));
        farthest = moved.fold(farthest, f32::max);
        let [cross, near] = crossings(app, skin, garment);
        assert_eq!(cross, 0, "tick {number}");
        nearest = nearest.max(near);
    }
    assert!(nearest > 100, "the leg comes near the skirt: {nearest}");
    assert!(farthest > 0.03, "the skirt is no shell: {farthest}");
    assert!(world_points(app, garment)[0].distance(start) > 1.0, "the character walks");
}

#[test]
fn a_skirt_follows_a_walking_character_and_does_not_cross_it() {
    let mut app = app();
    let mut walker = Walker::new(&mut app, 3.0);
    let skin = walker.spawn_skin(&mut app);
    let mesh = add(&mut app, indexed(&skirt()));
    let garment = spawn_garment(&mut app, mesh, XpbdGarment::worn_by([skin]));
    tick(&mut app);
    assert!(is_worn(&app, garment), "in the tick in which both are surfaces");
    walk(&mut app, &mut walker, skin, garment, &points(&skirt()), 60);
}

/// Usual for files: the garment has the joints of the body, and its character is already walking.
#[test]
fn a_skinned_skirt_is_put_on_in_the_middle_of_a_step() {
    let mut app = app();
    let mut walker = Walker::new(&mut app, 3.0);
    walker.time = 1.2;
    walker.pose(&mut app);
    let skin = walker.spawn_skin(&mut app);
    let fitted = points(&skirt());
    let mesh = walker.skinned(&mut app, indexed(&skirt()), &vec![0.0; fitted.len()]);
    // The node of a skinned mesh does not move the mesh, but it does move the garment that it becomes.
    let garment = spawn_garment(&mut app, mesh, XpbdGarment::worn_by([skin]));
    tick(&mut app);
    assert!(is_worn(&app, garment) && !app.world().entity(garment).contains::<SkinnedMesh>());
    assert_eq!(app.world().get::<SurfaceFrame>(garment), Some(&SurfaceFrame::Local));
    walk(&mut app, &mut walker, skin, garment, &fitted, 30);
}

/// The node of a skinned mesh has a pose of its own, which Bevy does not use to draw it.
#[test]
fn a_skinned_skirt_is_drawn_where_its_joints_have_it_wherever_its_node_is() {
    let node = Transform { translation: Vec3::new(3.0, -1.0, 2.0), scale: Vec3::splat(0.5), ..Transform::default() };
    let mut app = app();
    let walker = Walker::new(&mut app, 0.0);
    let skin = walker.spawn_skin(&mut app);
    let fitted = points(&skirt());
    let mesh = walker.skinned(&mut app, indexed(&skirt()), &vec![0.0; fitted.len()]);
    let garment = spawn_garment(&mut app, mesh, XpbdGarment::worn_by([skin]));
    app.world_mut().entity_mut(garment).insert(node);
    // Without a time step, it is where it was put on.
    app.update();
    assert!(is_worn(&app, garment));
    let drawn = world_points(&app, garment);
    for (fitted, local) in fitted.iter().zip(&drawn) {
        let at = node.transform_point(*local);
        assert!(at.distance(*fitted) < 1.0e-5, "{at} instead of {fitted}");
    }
    for _ in 0..15 {
        tick(&mut app);
    }
    // Its size is that of the joints, not of the node: it neither shrinks nor grows.
    let hem = |at: &[Vec3]| {
        let ring = &at[RINGS * SEGMENTS..];
        (0..SEGMENTS).map(|k| ring[k].distance(ring[(k + 1) % SEGMENTS])).sum::<f32>()
    };
    let hanging: Vec<Vec3> = world_points(&app, garment).iter().map(|local| node.transform_point(*local)).collect();
    let ratio = hem(&hanging) / hem(&fitted);
    assert!((ratio - 1.0).abs() < 0.05, "{ratio}");
}

/// The leg lifts half of the skirt when it is put on. Its cloth is still cut as in the bind pose.
#[test]
fn cloth_that_joints_have_stretched_has_the_lengths_of_the_bind_pose() {
    let mut app = app();
    let mut walker = Walker::new(&mut app, 5.0);
    walker.time = 1.15;
    walker.pose(&mut app);
    let skin = walker.spawn_skin(&mut app);
    let fitted = points(&skirt());
    let shares: Vec<f32> =
        fitted.iter().map(|at| if at.z > 0.0 { (-at.y * 2.0).clamp(0.0, 1.0) } else { 0.0 }).collect();
    let mesh = walker.skinned(&mut app, indexed(&skirt()), &shares);
    let garment = spawn_garment(&mut app, mesh, XpbdGarment { longest: 2.0, ..XpbdGarment::worn_by([skin]) });
    let edges: Vec<[u32; 2]> = {
        let (surface, _) = DeformableSurface::from_mesh(&fitted, &skirt().triangles).expect("it is valid");
        surface.topology().edges().to_vec()
    };
    let stretch = |at: &[Vec3]| {
        let ratios = edges.iter().map(|edge| {
            let length = |of: &[Vec3]| of[edge[0] as usize].distance(of[edge[1] as usize]);
            (length(at) / length(&fitted) - 1.0).abs()
        });
        ratios.sum::<f32>() / edges.len() as f32
    };
    app.update();
    assert!(is_worn(&app, garment));
    let worn = stretch(&world_points(&app, garment));
    for _ in 0..45 {
        tick(&mut app);
    }
    let hanging = stretch(&world_points(&app, garment));
    assert!(worn > 0.03 && hanging < 0.3 * worn, "{worn} when it was put on, {hanging} when it hangs");
}

#[test]
fn the_mesh_that_is_drawn_is_written_and_the_asset_stays() {
    let mut app = app();
    let walker = Walker::new(&mut app, 0.0);
    let skin = walker.spawn_skin(&mut app);
    let mesh = walker.skinned(&mut app, indexed(&skirt()), &vec![0.0; points(&skirt()).len()]);
    let asset = mesh.0.clone();
    // Two characters of one file share its mesh.
    app.world_mut().entity_mut(skin).insert(SurfaceLayers { memberships: 4, filters: 3 });
    let garments = [1, 2].map(|own| {
        let layers = SurfaceLayers { memberships: own, filters: 4 };
        spawn_garment(&mut app, (mesh.clone(), layers), XpbdGarment::worn_by([skin]))
    });
    for _ in 0..10 {
        tick(&mut app);
    }
    let attribute = |app: &App, mesh: &bevy_mesh::Mesh3d, name: bevy_mesh::MeshVertexAttribute| {
        let meshes = app.world().resource::<bevy_asset::Assets<Mesh>>();
        meshes.get(&mesh.0).and_then(|mesh| mesh.attribute(name).cloned())
    };
    for garment in garments {
        let own = app.world().get::<bevy_mesh::Mesh3d>(garment).expect("it is drawn").clone();
        assert_ne!(own, asset);
        let drawn = attribute(&app, &own, Mesh::ATTRIBUTE_POSITION).expect("it has some");
        let drawn: Vec<Vec3> = drawn.as_float3().expect("three numbers").iter().copied().map(Vec3::from).collect();
        assert_eq!(drawn, world_points(&app, garment));
        assert!(drawn.iter().zip(points(&skirt())).any(|(at, fitted)| at.distance(fitted) > 1.0e-4), "it hangs");
        assert_eq!(attribute(&app, &own, Mesh::ATTRIBUTE_JOINT_WEIGHT), None);
        assert!(attribute(&app, &own, Mesh::ATTRIBUTE_NORMAL).is_some());
    }
    let kept = attribute(&app, &asset, Mesh::ATTRIBUTE_POSITION).expect("it has some");
    assert_eq!(kept.as_float3().expect("three numbers"), skirt().positions);
}
