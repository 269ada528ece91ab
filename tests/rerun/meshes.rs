//! Surfaces in the recording are bit-identical to those of the world, for as long as they exist.

use bevy_circumsphere::{debug::LevelOfDetail, prelude::*};
use bevy_ecs::prelude::*;
use bevy_transform::components::Transform;
use circumsphere_support::scenes::{Mesh, duplicate_vertices, icosphere};
use glam::{DAffine3, Quat, Vec3};

use crate::{
    recording::{Components, Path, Viewer, bits, path},
    world::{
        Made, Recorded, Scene, THIN, everything, near, near_contacts, nothing, place, points, positions, sheet, spawn,
        spawn_unnamed, touching, world_affine,
    },
};

/// The names of the meshes that the viewer shows.
fn shown(viewer: &Viewer) -> Vec<String> {
    viewer.below(&["meshes"]).into_keys().map(|rest| rest.join("|")).collect()
}

/// Matrix and translation of a row, as an affine transform is stored.
fn logged_transform(components: &Components) -> ([f32; 9], [f32; 3]) {
    (components.vectors("Transform3D:mat3x3")[0], components.vectors("Transform3D:translation")[0])
}

fn rounded(affine: DAffine3) -> ([f32; 9], [f32; 3]) {
    (affine.matrix3.to_cols_array().map(|number| number as f32), affine.translation.as_vec3().to_array())
}

/// Asserts that the mesh that is shown is that of the world, whenever its parts were recorded.
#[track_caller]
fn assert_shown_is(recorded: &Recorded, name: &str, entity: Entity) {
    let world = recorded.app.world();
    let components = recorded.viewer.of(&["meshes", name]).unwrap_or_else(|| panic!("{name:?} is not shown"));
    let mesh = &world.get::<Made>(entity).expect("the entity has its mesh").0;
    assert_eq!(components.triples("Mesh3D:triangle_indices"), mesh.triangles, "{name}");
    let expected = bits(positions(world, entity).iter().map(Vec3::to_array));
    assert_eq!(bits(components.vectors::<3>("Mesh3D:vertex_positions")), expected, "{name}");
    assert_eq!(components.vectors::<3>("Mesh3D:vertex_normals").len(), expected.len());
    assert_eq!(components.wholes("Mesh3D:vertex_colors").len(), expected.len());
    assert_eq!(logged_transform(components), rounded(world_affine(world, entity)), "{name}");
}

#[test]
fn a_mesh_is_its_surface_in_every_tick_and_only_what_changed_is_recorded() {
    let mut recorded = Recorded::new(everything());
    let scene = Scene::spawn(&mut recorded.app, ContactMethod::Exact);
    let mut last: Vec<(Vec<Vec3>, DAffine3)> = Vec::new();
    let (mut moved, mut at_rest, mut posed) = (0, 0, 0);
    for tick in 0..12 {
        if tick % 3 != 2 {
            scene.advance(&mut recorded.app, tick);
        }
        recorded.tick();
        let now: Vec<(Vec<Vec3>, DAffine3)> = scene
            .surfaces()
            .map(|(_, entity)| {
                let world = recorded.app.world();
                (positions(world, entity).to_vec(), world_affine(world, entity))
            })
            .to_vec();
        for (place, (name, entity)) in scene.surfaces().into_iter().enumerate() {
            assert_shown_is(&recorded, name, entity);
            let row = recorded.last.row(&["meshes", name]);
            let has = |component: &str| row.is_some_and(|row| row.components.has(component));
            let changed = last.get(place).is_none_or(|(positions, _)| positions != &now[place].0);
            let pose_changed = last.get(place).is_none_or(|(_, pose)| pose != &now[place].1);
            assert_eq!(has("Mesh3D:triangle_indices"), last.is_empty(), "{name} at {tick}");
            assert_eq!(has("Mesh3D:vertex_positions"), changed, "{name} at {tick}");
            assert_eq!(has("Mesh3D:vertex_normals"), changed, "{name} at {tick}");
            assert_eq!(has("Transform3D:mat3x3"), pose_changed, "{name} at {tick}");
            moved += usize::from(changed);
            posed += usize::from(pose_changed);
            at_rest += usize::from(row.is_none());
        }
        last = now;
    }
    assert!(moved > 12 && posed > 6 && at_rest > 6, "{moved} moved, {posed} posed, {at_rest} without a row");
}

#[test]
fn vertices_have_the_color_of_what_their_triangles_do() {
    let mut recorded = Recorded::new(everything());
    let scene = Scene::spawn(&mut recorded.app, ContactMethod::Exact);
    let mut seen = [0; 3];
    for tick in 0..4 {
        scene.advance(&mut recorded.app, tick);
        recorded.tick();
        let mut colors_of_class: [Vec<u32>; 3] = Default::default();
        for (name, entity) in scene.surfaces() {
            let (touching, passed) = touching(&mut recorded.app, entity);
            let mesh = recorded.app.world().get::<Made>(entity).expect("the entity has its mesh").0.clone();
            let mut classes = vec![0; mesh.positions.len()];
            for (set, class) in [(&touching, 1), (&passed, 2)] {
                for &triangle in set {
                    for vertex in mesh.triangles[triangle as usize] {
                        classes[vertex as usize] = class;
                    }
                }
            }
            let colors = recorded.viewer.of(&["meshes", name]).expect("it is shown").wholes("Mesh3D:vertex_colors");
            let mut of_rest = Vec::new();
            for (class, color) in classes.into_iter().zip(colors) {
                seen[class] += 1;
                if class == 0 { of_rest.push(color) } else { colors_of_class[class].push(color) }
            }
            of_rest.dedup();
            assert!(of_rest.len() <= 1, "{name}: vertices that touch nothing have the colors {of_rest:x?}");
            colors_of_class[0].extend(of_rest);
        }
        let [rest, mut touching, mut passed] = colors_of_class;
        touching.dedup();
        passed.dedup();
        assert_eq!((touching.len(), passed.len()), (1, 1));
        assert!(touching != passed && !rest.contains(&touching[0]) && !rest.contains(&passed[0]));
    }
    assert!(seen.iter().all(|&count| count > 50), "{seen:?}");
}

#[test]
fn near_contacts_only_their_triangles_are_shown_at_all_vertices() {
    let mut recorded = Recorded::new(near());
    let scene = Scene::spawn(&mut recorded.app, ContactMethod::Exact);
    // Two vertices at one position count as one vertex when neighbors are found.
    let seamed = duplicate_vertices(&icosphere(2, 0.3));
    assert!(seamed.positions.len() > icosphere(2, 0.3).positions.len());
    let seamed = spawn(&mut recorded.app, "seamed", &seamed, (THIN, Transform::from_xyz(-0.6, 0.2, 0.4)));
    let (mut kept, mut left_out) = (0, 0);
    for tick in 0..6 {
        scene.advance(&mut recorded.app, tick);
        recorded.tick();
        for (name, entity) in scene.surfaces().into_iter().chain([("seamed", seamed)]) {
            let near = near_contacts(&mut recorded.app, entity);
            let mesh = recorded.app.world().get::<Made>(entity).expect("the entity has its mesh").0.clone();
            let components = recorded.viewer.of(&["meshes", name]).expect("the viewer shows it");
            let expected: Vec<[u32; 3]> = near.iter().map(|&triangle| mesh.triangles[triangle as usize]).collect();
            assert_eq!(components.triples("Mesh3D:triangle_indices"), expected, "{name} at {tick}");
            let expected = bits(positions(recorded.app.world(), entity).iter().map(Vec3::to_array));
            assert_eq!(bits(components.vectors::<3>("Mesh3D:vertex_positions")), expected);
            kept += near.len();
            left_out += mesh.triangles.len() - near.len();
            assert!(near.len() > 3, "{name} touches nothing");
        }
    }
    assert!(kept > 300 && left_out > 300, "{kept} triangles kept, {left_out} left out");
}

#[test]
fn a_mesh_of_which_nothing_is_near_a_contact_is_not_shown_at_all() {
    // The viewer rejects a mesh without triangles and reports it.
    let mut recorded = Recorded::new(near());
    let app = &mut recorded.app;
    spawn(app, "below", &sheet(3), THIN);
    let above = spawn(app, "above", &sheet(3), (THIN, Transform::from_xyz(0.1, 0.03, 0.1)));
    spawn(app, "alone", &sheet(3), (THIN, Transform::from_xyz(0.0, 7.0, 0.0)));
    recorded.tick();
    assert_eq!(shown(&recorded.viewer), ["above", "below"]);
    place(&mut recorded.app, above, |transform| transform.translation.y = 3.0);
    recorded.tick();
    assert_eq!(shown(&recorded.viewer), Vec::<String>::new());
    place(&mut recorded.app, above, |transform| transform.translation.y = 0.03);
    recorded.tick();
    assert_eq!(shown(&recorded.viewer), ["above", "below"]);
    let mesh = recorded.viewer.of(&["meshes", "below"]).expect("the viewer shows it");
    assert!(!mesh.triples("Mesh3D:triangle_indices").is_empty() && mesh.has("Mesh3D:vertex_positions"));
}

#[test]
fn poses_come_from_the_entity_and_all_its_parents() {
    let mut recorded = Recorded::new(everything());
    let app = &mut recorded.app;
    let turned =
        Transform::from_xyz(1.0e4, -3.0, 2.0).with_rotation(Quat::from_rotation_y(0.7)).with_scale(Vec3::splat(3.0));
    let mirrored = Transform::from_xyz(0.2, 0.3, 0.4).with_scale(Vec3::new(0.01, 0.01, -0.01));
    let top = app.world_mut().spawn(turned).id();
    let middle = app.world_mut().spawn((mirrored, ChildOf(top))).id();
    let own = Transform::from_xyz(-5.0, 0.1, 7.0).with_rotation(Quat::from_rotation_z(-1.1));
    let child = spawn(app, "child", &sheet(2), (own, ChildOf(middle)));
    let in_world = spawn(app, "in world", &sheet(2), (own, SurfaceFrame::World));
    recorded.tick();
    assert_shown_is(&recorded, "child", child);
    let components = recorded.viewer.of(&["meshes", "in world"]).expect("the viewer shows it");
    assert_eq!(logged_transform(components), rounded(DAffine3::IDENTITY));
    assert!(recorded.app.world().get::<SurfaceFrame>(in_world).is_some());

    place(&mut recorded.app, top, |transform| transform.translation.x += 1.0);
    recorded.tick();
    assert_shown_is(&recorded, "child", child);
    assert!(recorded.last.row(&["meshes", "in world"]).is_none(), "it has not changed");
    let row = recorded.last.row(&["meshes", "child"]).expect("its parent has moved");
    assert!(!row.components.has("Mesh3D:vertex_positions"));
}

#[test]
fn another_mesh_for_the_same_surface_brings_its_triangles() {
    let mut recorded = Recorded::new(everything());
    let entity = spawn(&mut recorded.app, "changing", &sheet(3), ());
    recorded.tick();
    let ball = icosphere(1, 1.0);
    let (surface, own) = DeformableSurface::from_mesh(&points(&ball), &ball.triangles).expect("the mesh is valid");
    recorded.app.world_mut().entity_mut(entity).insert((surface, own, Made(ball)));
    recorded.tick();
    assert_shown_is(&recorded, "changing", entity);

    // The same number of vertices at the same positions, but different triangles.
    let mut turned = icosphere(1, 1.0);
    turned.triangles.reverse();
    let (surface, own) = DeformableSurface::from_mesh(&points(&turned), &turned.triangles).expect("the mesh is valid");
    recorded.app.world_mut().entity_mut(entity).insert((surface, own, Made(turned)));
    recorded.tick();
    assert_shown_is(&recorded, "changing", entity);
    assert!(
        recorded.last.row(&["meshes", "changing"]).is_some_and(|row| row.components.has("Mesh3D:triangle_indices"))
    );
    recorded.tick();
    assert!(recorded.last.below(&["meshes"]).is_empty());
}

#[test]
fn every_name_is_a_path_of_its_own_whatever_it_is_made_of() {
    let mut recorded = Recorded::new(everything());
    let names =
        ["a/b", "a b", "ärmel 袖", "a\\/b", "[a]", "a:b", "%20", "..", "__properties", "a\nb", "\u{0}", " ", "**", "/"];
    let app = &mut recorded.app;
    let mesh = sheet(1);
    let apart = |place: usize| Transform::from_xyz(0.0, place as f32, 0.0);
    let named: Vec<(String, Entity)> = names
        .iter()
        .enumerate()
        .map(|(place, &name)| (name.to_owned(), spawn(app, name, &mesh, apart(place))))
        .collect();
    let empty = spawn(app, "", &mesh, apart(20));
    let unnamed = spawn_unnamed(app, &mesh, apart(21));
    // These could be read as names of pairs, so they are numbered.
    let of_two = ["a with b", "itself"].map(|name| (name, spawn(app, name, &mesh, apart(30 + name.len()))));
    recorded.tick();
    for (name, entity) in &named {
        assert_shown_is(&recorded, name, *entity);
    }
    assert_shown_is(&recorded, &format!("surface {empty}"), empty);
    assert_shown_is(&recorded, &format!("surface {unnamed}"), unnamed);
    for (name, entity) in of_two {
        assert_shown_is(&recorded, &format!("{name} {entity}"), entity);
    }
    assert_eq!(recorded.viewer.below(&["meshes"]).len(), names.len() + 4);
}

#[test]
fn no_two_surfaces_have_the_same_path() {
    let mut recorded = Recorded::new(everything());
    let app = &mut recorded.app;
    let mesh = sheet(1);
    let apart = |place: usize| Transform::from_xyz(0.0, place as f32, 0.0);
    // Names that later entities would get to tell them apart.
    let next = app.world_mut().spawn_empty().id();
    app.world_mut().despawn(next);
    let mut made = Vec::new();
    for place in 0..12 {
        made.push(spawn(app, "same", &mesh, apart(place)));
    }
    for (place, entity) in made.clone().into_iter().enumerate() {
        made.push(spawn(app, &format!("same {entity}"), &mesh, apart(20 + place)));
    }
    let unnamed: Vec<Entity> = (0..6).map(|place| spawn_unnamed(app, &mesh, apart(40 + place))).collect();
    for (place, entity) in unnamed.iter().enumerate() {
        made.push(spawn(app, &format!("surface {entity}"), &mesh, (apart(60 + place), SurfaceOrder(0))));
    }
    // The order of registration is reversed, so entities with long names come first.
    for (place, &entity) in made.iter().rev().enumerate() {
        app.world_mut().entity_mut(entity).insert(SurfaceOrder(place as u32));
    }
    for &entity in &unnamed {
        app.world_mut().entity_mut(entity).insert(SurfaceOrder(1000));
    }
    made.extend(unnamed);
    recorded.tick();
    let meshes = recorded.viewer.below(&["meshes"]);
    assert_eq!(recorded.last.below(&["meshes"]).len(), made.len());
    assert_eq!(meshes.len(), made.len(), "surfaces share a path: {:?}", meshes.keys());
}

#[test]
fn what_is_gone_is_no_longer_shown_and_comes_back_whole() {
    let mut recorded = Recorded::new(everything());
    let app = &mut recorded.app;
    let mesh = icosphere(1, 0.4);
    let stays = spawn(app, "stays", &sheet(4), THIN);
    let gone = ["despawned", "disabled", "without positions", "not finite", "without a surface"]
        .map(|name| spawn(app, name, &mesh, (THIN, Transform::from_xyz(0.0, 0.3, 0.0))));
    recorded.tick();
    let all = vec!["despawned", "disabled", "not finite", "stays", "without a surface", "without positions"];
    assert_eq!(shown(&recorded.viewer), all);
    assert!(recorded.viewer.below(&["contacts", "points"]).len() >= 5, "they touch the sheet");

    let world = recorded.app.world_mut();
    world.despawn(gone[0]);
    world.entity_mut(gone[1]).insert(SurfaceDisabled);
    world.get_mut::<SurfacePositions>(gone[2]).expect("the entity is a surface").0.clear();
    world.get_mut::<SurfacePositions>(gone[3]).expect("the entity is a surface").0[3].y = f32::NAN;
    world.entity_mut(gone[4]).remove::<DeformableSurface>();
    recorded.tick();
    assert_eq!(shown(&recorded.viewer), ["stays"]);
    let left: Vec<Path> =
        recorded.viewer.0.keys().filter(|path| path[0] != "series" && path[0] != "log").cloned().collect();
    assert!(left.iter().all(|path| path.join(" ").contains("stays") && !path.join(" ").contains("with ")), "{left:?}");
    recorded.tick();
    assert!(recorded.last.clears().is_empty(), "nothing is cleared twice");

    let world = recorded.app.world_mut();
    world.entity_mut(gone[1]).remove::<SurfaceDisabled>();
    world.get_mut::<SurfacePositions>(gone[2]).expect("the entity is a surface").0 = points(&mesh);
    world.get_mut::<SurfacePositions>(gone[3]).expect("the entity is a surface").0 = points(&mesh);
    let (surface, _) = DeformableSurface::from_mesh(&points(&mesh), &mesh.triangles).expect("the mesh is valid");
    world.entity_mut(gone[4]).insert(surface);
    recorded.tick();
    for (name, entity) in
        [("disabled", gone[1]), ("without positions", gone[2]), ("not finite", gone[3]), ("without a surface", gone[4])]
    {
        assert_shown_is(&recorded, name, entity);
    }
    assert_shown_is(&recorded, "stays", stays);
    assert_eq!(shown(&recorded.viewer).len(), 5);
}

#[test]
fn a_new_surface_takes_the_place_of_a_despawned_one_of_its_name() {
    let mut recorded = Recorded::new(everything());
    let mesh = sheet(2);
    let old = spawn(&mut recorded.app, "sleeve", &mesh, ());
    recorded.tick();
    recorded.app.world_mut().despawn(old);
    let higher = spawn(&mut recorded.app, "sleeve", &mesh, Transform::from_xyz(0.0, 2.0, 0.0));
    recorded.tick();
    let meshes = recorded.viewer.below(&["meshes"]);
    assert_eq!(meshes.len(), 1, "{:?}", meshes.keys());
    let name = meshes.keys().next().expect("there is one mesh")[0].clone();
    assert!(name.starts_with("sleeve"), "{name}");
    assert_shown_is(&recorded, &name, higher);

    // Once a name is free, the next surface gets it unchanged.
    recorded.app.world_mut().despawn(higher);
    recorded.tick();
    let next = spawn(&mut recorded.app, "sleeve", &mesh, Transform::from_xyz(0.0, 4.0, 0.0));
    recorded.tick();
    assert_eq!(shown(&recorded.viewer), ["sleeve"]);
    assert_shown_is(&recorded, "sleeve", next);
}

#[test]
fn shapes_are_outlined_where_they_are_and_leave_with_their_entity() {
    let mut recorded = Recorded::new(everything());
    let scene = Scene::spawn(&mut recorded.app, ContactMethod::Exact);
    let turned =
        Transform::from_xyz(0.3, 0.2, 0.1).with_rotation(Quat::from_rotation_x(0.4)).with_scale(Vec3::splat(0.5));
    let shape = SharedShape::cuboid(0.2, 0.3, 0.4);
    let cuboid = recorded.app.world_mut().spawn((RigidShape(shape), Name::new("box"), turned)).id();
    recorded.tick();
    let components = recorded.viewer.of(&["shapes", "box"]).expect("the viewer shows it");
    let corners: Vec<[f32; 3]> = components.strips().into_iter().flatten().collect();
    assert_eq!(components.strips().len(), 12, "a box has twelve edges");
    for corner in &corners {
        assert_eq!(corner.map(f32::abs), [0.2, 0.3, 0.4]);
    }
    assert_eq!(logged_transform(components), rounded(world_affine(recorded.app.world(), cuboid)));
    assert!(recorded.viewer.of(&["shapes", "floor"]).is_some_and(|floor| !floor.strips().is_empty()));

    place(&mut recorded.app, cuboid, |transform| transform.translation.x = 9.0);
    recorded.tick();
    let row = recorded.last.row(&["shapes", "box"]).expect("the box has moved");
    assert!(!row.components.has("LineStrips3D:strips"), "its outline is known already");
    let components = recorded.viewer.of(&["shapes", "box"]).expect("the viewer shows it");
    assert_eq!(logged_transform(components), rounded(world_affine(recorded.app.world(), cuboid)));
    assert!(recorded.last.row(&["shapes", "floor"]).is_none(), "it has not changed");

    recorded.app.world_mut().entity_mut(cuboid).insert(RigidShape(SharedShape::ball(0.7)));
    recorded.tick();
    let strips = recorded.viewer.of(&["shapes", "box"]).expect("the viewer shows it").strips();
    assert!(strips.len() > 12);
    for point in strips.into_iter().flatten() {
        // Sine and cosine in f32: a few units in the last place of a radius.
        assert!((Vec3::from_array(point).length() - 0.7).abs() < 1.0e-6, "{point:?}");
    }
    recorded.app.world_mut().despawn(cuboid);
    recorded.app.world_mut().entity_mut(scene.floor).insert(SurfaceDisabled);
    recorded.tick();
    assert_eq!(recorded.viewer.below(&["shapes"]).into_keys().collect::<Vec<_>>(), [path(&["rod"])]);
}

#[test]
fn meshes_follow_their_level_of_detail_while_the_app_runs() {
    let mut recorded = Recorded::new(everything());
    let scene = Scene::spawn(&mut recorded.app, ContactMethod::Exact);
    let count = |mesh: &Mesh| mesh.triangles.len();
    let mut found = Vec::new();
    let levels = [
        LevelOfDetail::All,
        LevelOfDetail::NearContacts,
        LevelOfDetail::Off,
        LevelOfDetail::Off,
        LevelOfDetail::All,
        LevelOfDetail::Off,
        LevelOfDetail::NearContacts,
        LevelOfDetail::All,
    ];
    for (tick, level) in levels.into_iter().enumerate() {
        recorded.settings().meshes = level;
        scene.advance(&mut recorded.app, tick as u32);
        recorded.tick();
        for (name, entity) in scene.surfaces() {
            let shown =
                recorded.viewer.of(&["meshes", name]).map(|shown| shown.triples("Mesh3D:triangle_indices").len());
            let all = count(&recorded.app.world().get::<Made>(entity).expect("the entity has its mesh").0);
            let expected = match level {
                LevelOfDetail::Off => None,
                LevelOfDetail::NearContacts => Some(near_contacts(&mut recorded.app, entity).len()),
                LevelOfDetail::All => Some(all),
            };
            assert_eq!(shown, expected, "{name} at {tick}, {level:?}");
            if level == LevelOfDetail::All {
                assert_shown_is(&recorded, name, entity);
            }
            found.extend(shown);
        }
    }
    found.sort_unstable();
    found.dedup();
    assert!(found.len() > 4, "{found:?}");
}

#[test]
fn without_meshes_nothing_of_them_is_recorded() {
    let mut recorded = Recorded::new(nothing());
    let scene = Scene::spawn(&mut recorded.app, ContactMethod::Exact);
    for tick in 0..3 {
        scene.advance(&mut recorded.app, tick);
        let layers: Vec<String> = recorded.tick().layers().into_iter().map(str::to_owned).collect();
        assert!(layers.iter().all(|layer| layer == "log" || layer.is_empty()), "{layers:?}");
    }
}

/// A scene of any size shows the ground on which it stands, and not only the area around the ground's origin.
#[test]
fn a_half_space_is_a_grid_as_large_as_the_scene_and_under_it() {
    for size in [0.01, 1.0, 1000.0] {
        let mut recorded = Recorded::new(everything());
        let away = Vec3::new(70.0, 0.5, -30.0) * size;
        spawn(&mut recorded.app, "sheet", &sheet(2), Transform::from_translation(away).with_scale(Vec3::splat(size)));
        let floor = RigidShape(SharedShape::halfspace(Vec3::Y));
        let scaled = Transform::from_xyz(3.0 * size, 0.0, 0.0).with_scale(Vec3::splat(2.0));
        recorded.app.world_mut().spawn((floor, Name::new("floor"), scaled));
        recorded.tick();
        let strips = recorded.viewer.of(&["shapes", "floor"]).expect("the viewer shows it").strips();
        let points: Vec<Vec3> =
            strips.iter().flatten().map(|&point| scaled.transform_point(Vec3::from_array(point))).collect();
        let box_of = |pick: fn(Vec3, Vec3) -> Vec3| points.iter().copied().reduce(pick).expect("there are lines");
        let (low, high) = (box_of(Vec3::min), box_of(Vec3::max));
        // Points are in single precision, at seventy times the size of the scene.
        let rounding = 70.0 * size * 1.0e-6;
        assert!(low.y.abs().max(high.y.abs()) <= rounding, "{low} {high}");
        let center = (low + high) * 0.5;
        let sheet_diagonal = size * Vec3::new(2.0, 0.0, 2.0).length();
        for (middle, under) in [(center.x, away.x), (center.z, away.z)] {
            assert!((middle - under).abs() < sheet_diagonal, "{middle} is not under {under}");
        }
        let side = (high.x - low.x).max(high.z - low.z);
        assert!(side > sheet_diagonal && side < 10.0 * sheet_diagonal, "{side} at size {size}");
    }
}

#[test]
fn the_thickness_at_each_vertex_is_recorded_when_it_changes() {
    let mut recorded = Recorded::new(everything());
    let sheet = spawn(&mut recorded.app, "sheet", &sheet(3), Transform::IDENTITY);
    let count = positions(recorded.app.world(), sheet).len();
    let shown = |recorded: &mut Recorded| {
        recorded.tick();
        recorded.viewer.of(&["meshes", "sheet"]).expect("it is shown").floats("thickness")
    };
    let values: Vec<f32> = (0..count).map(|vertex| 0.01 + 0.001 * vertex as f32).collect();
    recorded.app.world_mut().entity_mut(sheet).insert(VertexThickness::new(values.clone()));
    assert_eq!(shown(&mut recorded), values);
    assert_eq!(shown(&mut recorded), values);
    recorded.app.world_mut().entity_mut(sheet).remove::<VertexThickness>();
    assert_eq!(shown(&mut recorded), Vec::<f32>::new());
}
