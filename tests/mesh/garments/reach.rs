//! How far vertices may get from their places: by paint, and by the distance from the upper edge.

use bevy_app::prelude::*;
use bevy_asset::Assets;
use bevy_circumsphere::response::*;
use bevy_ecs::prelude::*;
use bevy_mesh::{Mesh, Mesh3d};
use circumsphere_support::scenes::CHARACTER_SKIRT_LENGTH;
use glam::{DVec3, Vec3};

use super::character::{
    RINGS, SEGMENTS, Walker, app, crossings, is_worn, skirt, spawn_garment, tethers, tick, world_points,
};
use crate::world::{add, indexed, points};

/// A wind that blows the skirt up.
const WIND: Vec3 = Vec3::new(9.0, 9.0, 0.0);

/// Farther than vertices are moved: tethers give by the error of the solver.
const TOLERANCE: f32 = 2.0e-3;

/// A skirt on a character that stands, in the tick in which it is put on.
fn dressed(mesh: Mesh, change: impl FnOnce(&mut XpbdGarment)) -> (App, Entity, Entity) {
    let mut app = app();
    let walker = Walker::new(&mut app, 0.0);
    let skin = walker.spawn_skin(&mut app);
    let mut garment = XpbdGarment::worn_by([skin]);
    change(&mut garment);
    let mesh = add(&mut app, mesh);
    let garment = spawn_garment(&mut app, mesh, garment);
    tick(&mut app);
    assert!(is_worn(&app, garment));
    (app, skin, garment)
}

/// The same in a wind, after half a second.
fn in_the_wind(mesh: Mesh, change: impl FnOnce(&mut XpbdGarment)) -> (App, Entity, Entity) {
    let (mut app, skin, garment) = dressed(mesh, change);
    app.world_mut().entity_mut(garment).insert(SurfaceWind { velocity: WIND, ..SurfaceWind::default() });
    for _ in 0..30 {
        tick(&mut app);
    }
    assert_eq!(crossings(&app, skin, garment)[0], 0);
    (app, skin, garment)
}

/// How far the vertices are from where the skirt fits.
fn ways(app: &App, garment: Entity) -> Vec<f32> {
    world_points(app, garment).iter().zip(points(&skirt())).map(|(at, fitted)| at.distance(fitted)).collect()
}

/// One half is pinned, and the other is freer towards the hem.
fn paint() -> Vec<f32> {
    points(&skirt()).iter().map(|at| if at.x < 0.0 { 0.0 } else { -at.y / CHARACTER_SKIRT_LENGTH as f32 }).collect()
}

fn colored(channel: usize) -> Mesh {
    let colors: Vec<[f32; 4]> = paint()
        .iter()
        .map(|&value| {
            let mut color = [0.7; 4];
            color[channel] = value;
            color
        })
        .collect();
    indexed(&skirt()).with_inserted_attribute(Mesh::ATTRIBUTE_COLOR, colors)
}

#[test]
fn painted_vertices_move_as_far_as_they_are_painted() {
    let painted = indexed(&skirt()).with_inserted_attribute(XpbdGarment::ATTRIBUTE_FREEDOM, paint());
    let longest = 0.05;
    let (app, _, garment) = in_the_wind(painted, |garment| garment.longest = longest);
    let painted = ways(&app, garment);
    let mut at_the_end = 0;
    for (way, share) in painted.iter().zip(paint()) {
        assert!(*way <= share * longest + TOLERANCE, "{way} with paint {share}");
        at_the_end += usize::from(*way > 0.8 * share * longest && share > 0.5);
    }
    // Where the cloth reaches that far from what is pinned.
    assert!(at_the_end > 5, "the wind moves them as far as they may: {at_the_end}");
    // Without paint, the wind lifts the half that was pinned.
    let (app, _, garment) = in_the_wind(indexed(&skirt()), |_| ());
    let free = ways(&app, garment);
    let lifted = free.iter().zip(paint()).filter(|&(way, share)| share == 0.0 && *way > 0.05).count();
    assert!(lifted > 30, "{lifted}");
}

#[test]
fn every_channel_of_the_colors_can_be_paint_and_is_not_drawn() {
    let paints = [GarmentPaint::Red, GarmentPaint::Green, GarmentPaint::Blue, GarmentPaint::Alpha];
    let by_attribute = indexed(&skirt()).with_inserted_attribute(XpbdGarment::ATTRIBUTE_FREEDOM, paint());
    let put_on = |mesh: Mesh, paint: GarmentPaint| {
        let (app, _, garment) = dressed(mesh, |garment| garment.paint = paint);
        let mesh = app.world().get::<Mesh3d>(garment).expect("it is drawn");
        let mesh = app.world().resource::<Assets<Mesh>>().get(&mesh.0).expect("it is there");
        (tethers(&app, garment), mesh.contains_attribute(Mesh::ATTRIBUTE_COLOR))
    };
    let longest = |tethers: &[Tether]| tethers.iter().map(|tether| tether.longest).collect::<Vec<_>>();
    let (expected, _) = put_on(by_attribute, GarmentPaint::Attribute);
    assert!(longest(&expected).contains(&0.0) && longest(&expected).contains(&0.5));
    for (channel, paint) in paints.into_iter().enumerate() {
        let (tethers, has_colors) = put_on(colored(channel), paint);
        assert_eq!((longest(&tethers), has_colors), (longest(&expected), false), "{paint:?}");
    }
    // Colors that are no paint are drawn, and mean nothing.
    let (tethers, has_colors) = put_on(colored(0), GarmentPaint::Attribute);
    assert!(has_colors);
    assert_ne!(longest(&tethers), longest(&expected));
}

/// The length of the shortest way to the first ring, in f64: edges are tried until nothing gets shorter.
fn ways_to_the_waist() -> Vec<f64> {
    let at: Vec<DVec3> = points(&skirt()).iter().map(|point| point.as_dvec3()).collect();
    let mut lengths: Vec<f64> =
        (0..at.len()).map(|vertex| if vertex < SEGMENTS { 0.0 } else { f64::INFINITY }).collect();
    loop {
        let before = lengths.clone();
        for corners in skirt().triangles {
            for (from, to) in [(0, 1), (1, 2), (2, 0), (1, 0), (2, 1), (0, 2)] {
                let [from, to] = [corners[from] as usize, corners[to] as usize];
                lengths[to] = lengths[to].min(lengths[from] + at[from].distance(at[to]));
            }
        }
        if lengths == before {
            return lengths;
        }
    }
}

#[test]
fn without_paint_vertices_may_move_by_their_distance_from_the_upper_edge() {
    let ways = ways_to_the_waist();
    let longest = 0.3;
    assert!(ways.iter().any(|way| *way > 0.4), "the skirt is longer than that");
    let (app, skin, garment) = dressed(indexed(&skirt()), |garment| garment.longest = longest);
    let tethers = tethers(&app, garment);
    assert_eq!(tethers.len(), ways.len());
    for tether in &tethers {
        let expected = (ways[tether.vertex.index()] as f32).min(longest);
        assert!((tether.longest - expected).abs() < 1.0e-6, "{:?}: {} not {expected}", tether.vertex, tether.longest);
        assert!(matches!(tether.target, TetherTarget::Surface { entity, .. } if entity == skin));
        assert_eq!(tether.backstop == f32::INFINITY, tether.vertex.index() < SEGMENTS, "pins are at their places");
    }
}

/// Two frills, one over the other: each hangs by its own upper edge.
#[test]
fn every_connected_part_has_an_upper_edge() {
    let mut mesh = skirt();
    let second: Vec<[f32; 3]> = mesh.positions.iter().map(|&[x, y, z]| [1.1 * x, y - 0.1, 1.1 * z]).collect();
    let count = mesh.positions.len() as u32;
    let triangles: Vec<[u32; 3]> = mesh.triangles.iter().map(|corners| corners.map(|corner| corner + count)).collect();
    mesh.positions.extend(second);
    mesh.triangles.extend(triangles);
    let (app, _, garment) = dressed(indexed(&mesh), |_| ());
    let pinned: Vec<usize> = tethers(&app, garment)
        .iter()
        .filter(|tether| tether.longest == 0.0)
        .map(|tether| tether.vertex.index())
        .collect();
    let expected: Vec<usize> = (0..SEGMENTS).chain((0..SEGMENTS).map(|vertex| vertex + count as usize)).collect();
    assert_eq!(pinned, expected);
}

/// The default pins one ring of the skirt.
#[test]
fn the_pinned_height_is_a_share_of_the_height() {
    assert_eq!(XpbdGarment::default().pinned_height, 0.02);
    for (share, rings) in [(0.02, 1), (0.0, 1), (0.26, 3), (1.0, RINGS + 1)] {
        let (app, _, garment) = dressed(indexed(&skirt()), |garment| garment.pinned_height = share);
        let pinned = tethers(&app, garment).iter().filter(|tether| tether.longest == 0.0).count();
        assert_eq!(pinned, rings * SEGMENTS, "{share}");
    }
}

#[cfg(feature = "serde")]
#[test]
fn garments_are_saved_and_loaded() {
    let skin = Entity::from_raw_u32(7).expect("a valid number");
    let garment = XpbdGarment { paint: GarmentPaint::Blue, longest: 0.25, ..XpbdGarment::worn_by([skin]) };
    let text = serde_json::to_string(&garment).expect("it can be written");
    assert_eq!(serde_json::from_str::<XpbdGarment>(&text).expect("it can be read"), garment);
    assert_eq!(serde_json::from_str::<XpbdGarment>("{}").expect("defaults"), XpbdGarment::default());
    assert!(serde_json::from_str::<XpbdGarment>("{ \"length\": 1 }").is_err(), "there is no such setting");
}
