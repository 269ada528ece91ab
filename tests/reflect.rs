//! The promises of the feature `reflect`: every component, resource, and message is registered, and settings and simple
//! components can be edited by name, as in an inspector.

use std::{fs, path::Path};

use bevy_app::prelude::*;
use bevy_circumsphere::{ReflectPlugin, prelude::*, response::XpbdSettings};
use bevy_ecs::{
    prelude::*,
    reflect::{ReflectComponent, ReflectMessage, ReflectResource},
};
use bevy_reflect::{GetPath, TypeRegistry};
use glam::Vec3;

/// The kinds of data, as named in derives.
const KINDS: [&str; 3] = ["Component", "Resource", "Message"];

fn app() -> App {
    let mut app = App::new();
    app.add_plugins(DeformableCollisionPlugins::new(Update));
    app.finish();
    app.cleanup();
    app
}

/// The public types of a source file that derive one of the kinds, with the kind. Hidden types are skipped.
fn derived(text: &str) -> Vec<(&'static str, String)> {
    let lines: Vec<&str> = text.lines().map(str::trim).collect();
    let mut found = Vec::new();
    for (place, line) in lines.iter().enumerate() {
        let Some(kind) = KINDS.into_iter().find(|kind| {
            let names = line.strip_prefix("#[derive(").and_then(|rest| rest.strip_suffix(")]"));
            names.is_some_and(|names| names.split(", ").any(|name| name == *kind))
        }) else {
            continue;
        };
        let attributes =
            lines[place + 1..].iter().take_while(|line| !line.starts_with("pub") && !line.starts_with("struct"));
        let count = attributes.clone().count();
        let is_hidden = attributes.clone().any(|line| *line == "#[doc(hidden)]")
            || place.checked_sub(1).is_some_and(|above| lines[above] == "#[doc(hidden)]");
        let declaration = lines.get(place + 1 + count).unwrap_or(&"");
        let name = declaration.strip_prefix("pub struct ").or_else(|| declaration.strip_prefix("pub enum "));
        if let Some(name) = name.filter(|name| !is_hidden && !name.starts_with('$')) {
            let end = name.find(|letter: char| !letter.is_alphanumeric()).unwrap_or(name.len());
            found.push((kind, name[..end].to_owned()));
        }
    }
    found
}

fn sources(folder: &Path, found: &mut Vec<(&'static str, String)>) {
    for entry in fs::read_dir(folder).expect("the folder can be listed") {
        let path = entry.expect("its entries can be read").path();
        if path.is_dir() {
            let is_built = (cfg!(feature = "rerun") || !path.ends_with("debug"))
                && (cfg!(feature = "mesh") || !(path.ends_with("surface/mesh") || path.ends_with("response/garment")));
            if is_built {
                sources(&path, found);
            }
        } else {
            found.extend(derived(&fs::read_to_string(&path).expect("the sources are text")));
        }
    }
}

fn is_registered(types: &TypeRegistry, kind: &str, name: &str) -> bool {
    types.get_with_short_type_path(name).is_some_and(|registration| match kind {
        "Component" => registration.data::<ReflectComponent>().is_some(),
        "Resource" => registration.data::<ReflectResource>().is_some(),
        _ => registration.data::<ReflectMessage>().is_some(),
    })
}

#[test]
fn every_component_resource_and_message_is_registered() {
    let mut found = Vec::new();
    sources(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src"), &mut found);
    // Declared by a macro.
    found.extend(
        ["TriangleCurvature", "EnclosingBalls", "Circumspheres", "TriangleCones"]
            .map(|name| ("Component", name.to_owned())),
    );
    assert!(found.len() > 35, "{}", found.len());
    let app = app();
    let types = app.world().resource::<AppTypeRegistry>().read();
    let missing: Vec<_> = found.iter().filter(|(kind, name)| !is_registered(&types, kind, name)).collect();
    assert!(missing.is_empty(), "{missing:?}");
    // The check can fail.
    assert!(
        !is_registered(&types, "Component", "Transformation") && !is_registered(&types, "Message", "SelfCollision")
    );
    assert_eq!(
        derived(
            "#[derive(Component, Clone)]\n#[require(Transform)]\npub struct Body {\n#[derive(Resource)]\nstruct Own;"
        ),
        [("Component", "Body".to_owned())]
    );
}

#[test]
fn settings_and_components_are_edited_by_name() {
    let mut app = app();
    app.init_resource::<XpbdSettings>();
    let corners = [Vec3::ZERO, Vec3::X, Vec3::Z];
    let sheet = DeformableSurface::from_mesh(&corners, &[[0, 1, 2]]).expect("a triangle");
    let sheet = app.world_mut().spawn((sheet, SurfaceThickness::World(0.1))).id();
    let types = app.world().resource::<AppTypeRegistry>().clone();
    let types = types.read();

    let settings = types.get_with_short_type_path("CircumsphereSettings").and_then(|it| it.data::<ReflectComponent>());
    let resource = app.world().components().component_id::<CircumsphereSettings>().expect("it is inserted");
    let resource = app.world().resource_entities().get(resource).expect("it is inserted");
    let entity = app.world_mut().entity_mut(resource);
    let mut settings = settings.expect("it is registered").reflect_mut(entity).expect("it is inserted");
    *settings.path_mut::<f32>("margin").expect("a field") = 0.25;
    *settings.path_mut::<SphereContactDetail>("sphere_contacts").expect("a field") = SphereContactDetail::Distances;
    let settings = app.world().resource::<CircumsphereSettings>();
    assert_eq!((settings.margin, settings.sphere_contacts), (0.25, SphereContactDetail::Distances));

    let thickness = types.get_with_short_type_path("SurfaceThickness").and_then(|it| it.data::<ReflectComponent>());
    let thickness = thickness.expect("it is registered");
    let mut edited = thickness.reflect_mut(app.world_mut().entity_mut(sheet)).expect("it has one");
    *edited.path_mut::<f32>(".0").expect("the width") = 0.2;
    assert_eq!(app.world().get::<SurfaceThickness>(sheet), Some(&SurfaceThickness::World(0.2)));

    // As scene files and prefabs do: clone by reflection and insert into another entity.
    let surface = types.get_with_short_type_path("DeformableSurface").and_then(|it| it.data::<ReflectComponent>());
    let surface = surface.expect("it is registered");
    let clone =
        surface.reflect(app.world().entity(sheet)).expect("it has one").reflect_clone().expect("it can be cloned");
    let other = app.world_mut().spawn_empty().id();
    surface.insert(&mut app.world_mut().entity_mut(other), clone.as_partial_reflect(), &types);
    let [one, other] =
        [sheet, other].map(|entity| app.world().get::<DeformableSurface>(entity).expect("both are surfaces"));
    assert!(std::ptr::eq(one.topology().as_ref(), other.topology().as_ref()), "instances share their mesh");
}

#[test]
fn the_types_can_be_registered_without_the_plugins() {
    let mut app = App::new();
    app.add_plugins(ReflectPlugin);
    let types = app.world().resource::<AppTypeRegistry>().read();
    assert!(is_registered(&types, "Component", "XpbdBody"));
}
