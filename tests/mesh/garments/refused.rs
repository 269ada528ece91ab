//! Garments that cannot be worn are reported by name, once, and nothing else stops.

use bevy_app::prelude::*;
use bevy_asset::Assets;
use bevy_circumsphere::{prelude::*, response::*};
use bevy_ecs::prelude::*;
use bevy_mesh::{Mesh, Mesh3d, VertexAttributeValues, VertexFormat};
use circumsphere_support::warnings;
use glam::Vec3;

use super::character::{RINGS, SEGMENTS, Walker, app, is_worn, skirt, spawn_garment, tick};
use crate::world::{add, indexed};

/// All hang at one place.
const ALONE: SurfaceLayers = SurfaceLayers { memberships: 0, filters: 0 };

/// What was logged about an entity with this name. Other tests of the process log too.
fn warnings_about(name: &str) -> Vec<String> {
    let name = format!("({name})");
    warnings::kept().into_iter().filter(|line| line.contains(&name)).collect()
}

#[derive(Resource, Default)]
struct Heard(Vec<(Entity, XpbdGarmentError)>);

fn listening() -> App {
    warnings::kept();
    let mut app = app();
    app.init_resource::<Heard>().add_observer(|on: On<XpbdGarmentNotWorn>, mut heard: ResMut<Heard>| {
        heard.0.push((on.entity, on.reason.clone()));
    });
    app
}

fn painted(values: impl Into<VertexAttributeValues>) -> Mesh {
    indexed(&skirt()).with_inserted_attribute(XpbdGarment::ATTRIBUTE_FREEDOM, values)
}

/// The name of a garment, its mesh and its settings, and whether an error is the expected one.
type Case = (&'static str, Mesh, XpbdGarment, Box<dyn Fn(&XpbdGarmentError) -> bool>);

fn cases(app: &mut App, skin: Entity) -> Vec<Case> {
    use XpbdGarmentError as Error;
    let count = skirt().positions.len();
    let with = |value: f32| {
        let mut values = vec![0.5; count];
        values[7] = value;
        painted(values)
    };
    let whole = || indexed(&skirt());
    let setting = |what| move |error: &Error| matches!(error, Error::Setting { what: found, .. } if *found == what);
    let good = XpbdGarment::worn_by([skin]);
    let bare = app.world_mut().spawn_empty().id();
    let gone = app.world_mut().spawn_empty().id();
    app.world_mut().despawn(gone);
    let red = XpbdGarment { paint: GarmentPaint::Red, ..good.clone() };
    let no_mass = XpbdMaterial { area_density: 0.0, ..XpbdMaterial::CLOTH };
    vec![
        ("no skin", whole(), XpbdGarment::default(), Box::new(|error| *error == Error::NoSkin)),
        ("gone skin", whole(), XpbdGarment::worn_by([gone]), Box::new(move |error| *error == Error::MissingSkin(gone))),
        (
            "bare skin",
            whole(),
            XpbdGarment::worn_by([bare]),
            Box::new(move |error| *error == Error::SkinIsNoSurface(bare)),
        ),
        ("no paint", whole(), red, Box::new(|error| *error == Error::NotPainted(GarmentPaint::Red))),
        (
            "short paint",
            painted(vec![0.5; count - 1]),
            good.clone(),
            Box::new(
                move |error| matches!(error, Error::PaintCount { expected, found, .. } if (*expected, *found) == (count, count - 1)),
            ),
        ),
        (
            "nan paint",
            with(f32::NAN),
            good.clone(),
            Box::new(|error| matches!(error, Error::PaintValue { vertex: VertexId(7), value } if value.is_nan())),
        ),
        (
            "infinite paint",
            with(f32::INFINITY),
            good.clone(),
            Box::new(|error| matches!(error, Error::PaintValue { .. })),
        ),
        ("negative paint", with(-0.1), good.clone(), Box::new(|error| matches!(error, Error::PaintValue { .. }))),
        (
            "nan longest",
            whole(),
            XpbdGarment { longest: f32::NAN, ..good.clone() },
            Box::new(setting("the longest distance")),
        ),
        (
            "high pins",
            whole(),
            XpbdGarment { pinned_height: 1.5, ..good.clone() },
            Box::new(setting("the pinned height")),
        ),
        (
            "nan clearance",
            whole(),
            XpbdGarment { clearance: f32::NAN, ..good.clone() },
            Box::new(setting("the clearance")),
        ),
        (
            "no mass",
            whole(),
            XpbdGarment { material: no_mass, ..good.clone() },
            Box::new(|error| matches!(error, Error::Body(_))),
        ),
    ]
}

#[test]
fn bad_input_is_reported_once_and_others_are_dressed() {
    let mut app = listening();
    let walker = Walker::new(&mut app, 0.0);
    let skin = walker.spawn_skin(&mut app);
    let good = XpbdGarment::worn_by([skin]);
    let bad: Vec<_> = cases(&mut app, skin)
        .into_iter()
        .map(|(name, mesh, garment, expected)| {
            let mesh = add(&mut app, mesh);
            (name, spawn_garment(&mut app, (mesh, Name::new(name), ALONE), garment), expected)
        })
        .collect();
    let mesh = add(&mut app, indexed(&skirt()));
    let worn = spawn_garment(&mut app, (mesh, Name::new("good garment"), ALONE), good.clone());
    for _ in 0..2 {
        tick(&mut app);
    }
    assert!(is_worn(&app, worn), "the others do not stop it");
    assert!(warnings_about("good garment").is_empty());
    let heard = std::mem::take(&mut app.world_mut().resource_mut::<Heard>().0);
    for (name, entity, expected) in &bad {
        assert!(!app.world().entity(*entity).contains::<XpbdBody>(), "{name}");
        assert!(app.world().entity(*entity).contains::<DeformableSurface>(), "{name}: it stays a surface");
        let of_it: Vec<_> = heard.iter().filter(|(other, _)| other == entity).collect();
        let [(_, reason)] = of_it[..] else { panic!("{name}: {of_it:?}") };
        assert!(expected(reason), "{name}: {reason:?}");
        let logged = warnings_about(name);
        assert_eq!(logged.len(), 1, "{logged:?}");
        assert!(logged[0].contains(&entity.to_string()) && logged[0].contains(&reason.to_string()), "{logged:?}");
    }
    // Once repaired, they are worn.
    for (_, entity, _) in &bad {
        let mesh = add(&mut app, indexed(&skirt()));
        app.world_mut().entity_mut(*entity).insert((mesh, good.clone()));
    }
    tick(&mut app);
    for (name, entity, _) in &bad {
        assert!(is_worn(&app, *entity), "{name}");
    }
    assert!(app.world().resource::<Heard>().0.is_empty());
}

#[test]
fn colors_in_a_format_that_holds_no_paint_are_refused() {
    let mut app = listening();
    let walker = Walker::new(&mut app, 0.0);
    let skin = walker.spawn_skin(&mut app);
    let mut mesh = indexed(&skirt());
    mesh.insert_attribute(
        bevy_mesh::MeshVertexAttribute { format: VertexFormat::Float32x3, ..Mesh::ATTRIBUTE_COLOR },
        vec![[0.0_f32; 3]; skirt().positions.len()],
    );
    let mesh = add(&mut app, mesh);
    let garment = XpbdGarment { paint: GarmentPaint::Green, ..XpbdGarment::worn_by([skin]) };
    let garment = spawn_garment(&mut app, mesh, garment);
    tick(&mut app);
    let expected = XpbdGarmentError::PaintFormat { paint: GarmentPaint::Green, format: VertexFormat::Float32x3 };
    assert_eq!(app.world().resource::<Heard>().0, [(garment, expected)]);
}

/// The renderer may take the data before the skin is there.
#[test]
fn a_mesh_that_only_the_renderer_has_is_refused() {
    let mut app = listening();
    let walker = Walker::new(&mut app, 0.0);
    let mesh = add(&mut app, indexed(&skirt()));
    let skin = app.world_mut().spawn(SurfaceFromMesh::default()).id();
    let garment = spawn_garment(&mut app, mesh.clone(), XpbdGarment::worn_by([skin]));
    tick(&mut app);
    let mut meshes = app.world_mut().resource_mut::<Assets<Mesh>>();
    meshes.get_mut_untracked(&mesh.0).expect("it is there").take_gpu_data().expect("data");
    let body = walker.skin(&mut app);
    app.world_mut().entity_mut(skin).insert(body);
    tick(&mut app);
    let expected = XpbdGarmentError::Mesh(SurfaceMeshError::OnlyInRenderWorld);
    assert_eq!(app.world().resource::<Heard>().0, [(garment, expected)]);
    assert!(app.world().get::<Mesh3d>(garment).is_some_and(|drawn| *drawn == mesh));
}

#[test]
fn positions_that_are_no_numbers_are_refused() {
    let mut app = listening();
    let walker = Walker::new(&mut app, 0.0);
    let skin = app.world_mut().spawn(SurfaceFromMesh::default()).id();
    let mesh = add(&mut app, indexed(&skirt()));
    let garment = spawn_garment(&mut app, mesh, XpbdGarment::worn_by([skin]));
    tick(&mut app);
    app.world_mut().get_mut::<SurfacePositions>(garment).expect("it is a surface").0[3] = Vec3::NAN;
    let body = walker.skin(&mut app);
    app.world_mut().entity_mut(skin).insert(body);
    tick(&mut app);
    let expected = XpbdGarmentError::Body(XpbdBodyError::NonFinitePosition(VertexId(3)));
    assert_eq!(app.world().resource::<Heard>().0, [(garment, expected)]);
}

#[test]
fn a_garment_that_begins_in_its_skin_is_told_once() {
    let mut app = listening();
    let walker = Walker::new(&mut app, 0.0);
    let skin = walker.spawn_skin(&mut app);
    let mut stuck = skirt();
    // The lower half of the skirt, at a third of its width: within the legs.
    for position in stuck.positions.iter_mut().skip(SEGMENTS * RINGS / 2) {
        position[0] /= 3.0;
        position[2] /= 3.0;
    }
    for (name, mesh) in [("stuck garment", stuck), ("free garment", skirt())] {
        let mesh = add(&mut app, indexed(&mesh));
        // They meet the skin only.
        let layers = SurfaceLayers { memberships: 0b10, filters: 0b01 };
        let garment = spawn_garment(&mut app, (mesh, Name::new(name), layers), XpbdGarment::worn_by([skin]));
        for _ in 0..3 {
            tick(&mut app);
        }
        assert!(is_worn(&app, garment), "{name}");
    }
    let told = warnings_about("stuck garment");
    assert!(matches!(&told[..], [warning] if warning.contains("begins inside its skin")), "{told:?}");
    assert!(warnings_about("free garment").is_empty());
}
