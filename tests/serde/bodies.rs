//! Bodies and tethers that are saved and loaded go on like clones.

use std::{f32::consts::TAU, time::Duration};

use bevy_app::prelude::*;
use bevy_circumsphere::{
    prelude::*,
    response::{Tether, TetherTarget, XpbdBody, XpbdMaterial, XpbdResponsePlugin, XpbdTethers},
};
use bevy_ecs::{entity::EntityHashMap, prelude::*};
use bevy_time::Time;
use bevy_transform::components::Transform;
use circumsphere_support::{
    random::Random,
    scenes::{Diagonals, Mesh, grid, icosphere},
    tetrahedra::tetrahedral_ball,
};
use glam::Vec3;
use serde::{Serialize, de::DeserializeOwned};
use serde_json::{Value, json};

/// Ticks before the game is saved, and after it was loaded.
const TICKS: usize = 25;

/// What is saved of an entity.
type Thing = (
    Option<DeformableSurface>,
    Option<SurfacePositions>,
    Option<XpbdBody>,
    Option<XpbdTethers>,
    Option<RigidShape>,
    SurfaceFrame,
);

fn surface(mesh: &Mesh) -> (DeformableSurface, SurfacePositions) {
    let points: Vec<Vec3> = mesh.positions.iter().copied().map(Vec3::from_array).collect();
    DeformableSurface::from_mesh(&points, &mesh.triangles).expect("the mesh is sound")
}

/// A cloth that hangs from a moving ball, a hand, and a pin, above a soft ball on the ground. Tethers name the first two
/// entities.
fn scene([skin, hand]: [Entity; 2]) -> Vec<Thing> {
    let frame = SurfaceFrame::Local;
    let ball = icosphere(1, 0.3);
    let (ball_surface, ball_positions) = surface(&ball);
    let (cloth, positions) = surface(&grid(6, 6, 1.0, 1.0, Diagonals::Alternating).translate([0.0, 0.35, 0.0]));
    let body = XpbdBody::new(&cloth, &positions, XpbdMaterial::CLOTH).expect("a body").pinned([VertexId(0)]);
    let triangles = ball_surface.topology().triangles();
    let on_skin = XpbdTethers::to_surface(skin, (&ball_positions.0, triangles), &positions.0, 0.4, 0.01);
    let near = on_skin.tethers.into_iter().filter(|tether| tether.vertex.0 % 5 == 1);
    let held = Tether::pin(VertexId(48), TetherTarget::Entity { entity: hand, point: Vec3::new(0.1, 0.3, 0.2) });
    let tethers = XpbdTethers::new(near.chain([held]));
    assert!(tethers.tethers.len() > 5);
    let (soft, soft_positions) = surface(&icosphere(1, 0.2).translate([0.3, -0.55, 0.2]));
    let soft_body = XpbdBody::new(&soft, &soft_positions, XpbdMaterial::SOFT).expect("a body");
    vec![
        (Some(ball_surface), Some(ball_positions), None, None, None, SurfaceFrame::World),
        (None, None, None, None, None, frame),
        (Some(cloth), Some(positions), Some(body), Some(tethers), None, frame),
        (Some(soft), Some(soft_positions), Some(soft_body), None, None, frame),
        (None, None, None, None, Some(RigidShape(SharedShape::cuboid(2.0, 0.2, 2.0))), frame),
    ]
}

struct Game {
    app: App,
    entities: Vec<Entity>,
    tick: usize,
}

impl Game {
    /// A new app with these things, which begins with this tick. Entities are others than in the last one.
    fn new(entities_before: usize, things: impl FnOnce([Entity; 2]) -> Vec<Thing>, tick: usize) -> Self {
        let mut app = App::new();
        app.add_plugins((DeformableCollisionPlugins::new(Update), XpbdResponsePlugin::new(Update)));
        app.init_resource::<Time>();
        (0..entities_before).for_each(|_| _ = app.world_mut().spawn_empty());
        let named = [0, 1].map(|_| app.world_mut().spawn_empty().id());
        let things = things(named);
        let rest = (2..things.len()).map(|_| app.world_mut().spawn_empty().id());
        let entities: Vec<Entity> = named.into_iter().chain(rest).collect();
        for (number, (&entity, thing)) in entities.iter().zip(things).enumerate() {
            let (surface, positions, body, tethers, shape, frame) = thing;
            let mut entity = app.world_mut().entity_mut(entity);
            entity.insert((Transform::default(), SurfaceOrder(number as u32), SurfaceThickness::World(0.02), frame));
            insert_if(&mut entity, surface);
            insert_if(&mut entity, positions);
            insert_if(&mut entity, tethers);
            insert_if(&mut entity, shape);
            if let Some(body) = body {
                entity.insert((body, SelfCollision, SweptCollision));
            }
        }
        Self { app, entities, tick }
    }

    fn play(&mut self) {
        let time = self.tick as f32 / 60.0;
        let world = self.app.world_mut();
        let wave = bevy_math::ops::sin(TAU * time);
        let mut skin = world.get_mut::<SurfacePositions>(self.entities[0]).expect("a surface");
        let (_, rest) = surface(&icosphere(1, 0.3));
        skin.0 = rest.0.iter().map(|at| *at + Vec3::new(0.3 * wave, 0.1 * at.x * wave, 0.0)).collect();
        let mut hand = world.get_mut::<Transform>(self.entities[1]).expect("it has one");
        hand.translation = Vec3::new(0.0, 0.2 * wave, 0.1 * time);
        world.get_mut::<Transform>(self.entities[2]).expect("it has one").translation.z = 0.1 * wave;
        world.get_mut::<Transform>(self.entities[4]).expect("it has one").translation.y = -1.0;
        world.resource_mut::<Time>().advance_by(Duration::from_micros(16_667));
        self.app.update();
        self.tick += 1;
    }

    fn things(&self) -> Vec<Thing> {
        let world = self.app.world();
        let thing = |&entity: &Entity| {
            (
                world.get::<DeformableSurface>(entity).cloned(),
                world.get::<SurfacePositions>(entity).cloned(),
                world.get::<XpbdBody>(entity).cloned(),
                world.get::<XpbdTethers>(entity).cloned(),
                world.get::<RigidShape>(entity).cloned(),
                *world.get::<SurfaceFrame>(entity).expect("it has one"),
            )
        };
        self.entities.iter().map(thing).collect()
    }

    /// Positions and velocities after each tick, in bits.
    fn go_on(mut self) -> Vec<Vec<u32>> {
        (0..TICKS)
            .map(|_| {
                self.play();
                let things = self.things();
                let vectors = things.iter().flat_map(|(_, positions, body, ..)| {
                    let velocities = body.iter().flat_map(|body| &body.velocities);
                    positions.iter().flat_map(|positions| &positions.0).chain(velocities)
                });
                vectors.flat_map(|vector| vector.to_array().map(f32::to_bits)).collect()
            })
            .collect()
    }
}

fn insert_if(entity: &mut EntityWorldMut, component: Option<impl Component>) {
    if let Some(component) = component {
        entity.insert(component);
    }
}

/// What is saved after some ticks, and the entities that it names.
fn saved() -> (Vec<Thing>, [Entity; 2]) {
    let mut game = Game::new(0, scene, 0);
    (0..TICKS).for_each(|_| game.play());
    (game.things(), [game.entities[0], game.entities[1]])
}

/// Loads things that name these entities, in an app that has others, and returns what happens.
fn go_on_with(mut things: Vec<Thing>, named: [Entity; 2], entities_before: usize) -> Vec<Vec<u32>> {
    let put = |now: [Entity; 2]| {
        let mut names: EntityHashMap<Entity> = named.into_iter().zip(now).collect();
        for (_, _, _, tethers, ..) in &mut things {
            if let Some(tethers) = tethers {
                XpbdTethers::map_entities(tethers, &mut names);
            }
        }
        things
    };
    Game::new(entities_before, put, TICKS).go_on()
}

fn through_ron<T: Serialize + DeserializeOwned>(value: &T) -> T {
    let text = ron::to_string(value).expect("it can be written");
    ron::from_str(&text).expect("it can be read")
}

/// Changes the cloth in a game that goes on, and returns what happens.
fn go_on_after(change: impl FnOnce(XpbdBody, XpbdTethers) -> (XpbdBody, XpbdTethers)) -> Vec<Vec<u32>> {
    let mut game = Game::new(0, scene, 0);
    (0..TICKS).for_each(|_| game.play());
    let (_, _, body, tethers, ..) = game.things().swap_remove(2);
    let changed = change(body.expect("a body"), tethers.expect("tethers"));
    let cloth = game.entities[2];
    game.app.world_mut().entity_mut(cloth).insert(changed);
    game.go_on()
}

#[test]
fn a_loaded_world_goes_on_like_a_cloned_one() {
    let (things, named) = saved();
    let expected = go_on_with(things.clone(), named, 0);
    assert!(expected.windows(2).all(|ticks| ticks[0] != ticks[1]), "something moves in every tick");
    assert!(go_on_with(through_ron(&things), named, 3) == expected);
    let text = serde_json::to_string(&things).expect("it can be written");
    assert!(go_on_with(serde_json::from_str(&text).expect("it can be read"), named, 3) == expected);
}

/// What is read if a field has another value.
fn without<T: Serialize + DeserializeOwned>(whole: &T, field: &str, value: Value) -> T {
    let mut data = serde_json::to_value(whole).expect("it can be written");
    assert_ne!(data[field], value);
    data[field] = value;
    serde_json::from_value(data).expect("it can be read")
}

#[test]
fn what_is_put_back_into_a_running_game_changes_nothing() {
    let expected = go_on_after(|body, tethers| (body, tethers));
    assert!(go_on_after(|body, tethers| (through_ron(&body), through_ron(&tethers))) == expected);
    // Less than all that is written would not do.
    assert!(go_on_after(|body, tethers| (body, without(&tethers, "last", json!([])))) != expected);
    assert!(go_on_after(|body, tethers| (without(&body, "stood", Value::Null), tethers)) != expected);
    assert!(go_on_after(|body, tethers| (without(&body, "written", json!([])), tethers)) != expected);
}

fn body() -> XpbdBody {
    saved().0.swap_remove(2).2.expect("a body")
}

#[test]
fn data_that_is_no_body_is_an_error() {
    let written = serde_json::to_value(body()).expect("it can be written");
    assert!(serde_json::from_value::<XpbdBody>(written.clone()).is_ok());
    for (path, value, reason) in [
        ("/velocities", json!([[0.0, 0.0, 0.0]]), "1 velocities, but the mesh has 49 vertices"),
        ("/velocities/3/1", json!(1.0e300), "velocity of vertex 3 is not finite"),
        ("/inverse_masses", json!([]), "0 inverse masses"),
        ("/inverse_masses/4", json!(-1.0), "inverse mass of vertex 4 is -1"),
        ("/rest_positions", json!([]), "0 rest positions"),
        ("/rest_positions/2/0", json!(-1.0e300), "position of vertex 2 is not finite"),
        ("/written", json!([[0.0, 0.0, 0.0]]), "1 written positions"),
        ("/written/1/2", json!(1.0e300), "position of vertex 1 is not finite"),
        ("/stood/0", json!(0.5), "scales its axes differently"),
        ("/material/area_density", json!(0.0), "the area density is 0"),
        ("/mesh/triangles/0/1", json!(49), "names vertex 49"),
        ("/mesh/weld/1", json!(7), "vertex 1 is welded to vertex 7"),
        ("/stood", json!("here"), "invalid type"),
    ] {
        let mut data = written.clone();
        *data.pointer_mut(path).unwrap_or_else(|| panic!("no {path}")) = value;
        let error = serde_json::from_value::<XpbdBody>(data).expect_err("it is no body");
        assert!(error.to_string().contains(reason), "{path}: {error}");
    }
    let mut lost = body();
    lost.velocities[5].z = f32::NAN;
    let error =
        ron::from_str::<XpbdBody>(&ron::to_string(&lost).expect("it can be written")).expect_err("not a number");
    assert!(error.to_string().contains("velocity of vertex 5 is not finite"), "{error}");
}

#[test]
fn a_tetrahedral_body_goes_on_like_its_clone() {
    let mesh = tetrahedral_ball(4, 0.2);
    let rest: Vec<Vec3> = mesh.positions.iter().copied().map(Vec3::from_array).collect();
    let (inside, surface, positions) = TetrahedralBody::from_mesh(&rest, &mesh.tetrahedra).expect("a body");
    let made = XpbdBody::tetrahedral(&inside, &surface, &positions, XpbdMaterial::SOLID).expect("a body");
    let json = serde_json::to_value(&made).expect("it can be written");
    let read: XpbdBody = serde_json::from_value(json.clone()).expect("it can be read");
    let pressed = [&made, &read, &through_ron(&made)].map(|body| {
        let mut app = App::new();
        app.add_plugins((DeformableCollisionPlugins::new(Update), XpbdResponsePlugin::new(Update)));
        app.init_resource::<Time>();
        let mut squeezed = positions.clone();
        squeezed.0.iter_mut().for_each(|at| at.y *= 0.7);
        let body = app.world_mut().spawn((inside.clone(), surface.instance(), squeezed, body.clone())).id();
        for _ in 0..10 {
            app.world_mut().resource_mut::<Time>().advance_by(Duration::from_micros(16_667));
            app.update();
        }
        app.world().get::<SurfacePositions>(body).expect("a surface").0.clone()
    });
    assert!(pressed[0].iter().zip(&rest).any(|(now, rest)| (*now - *rest).y < -0.1), "it falls");
    assert!(pressed[0] == pressed[1] && pressed[0] == pressed[2]);
    let mut data = json;
    data["tetrahedra"][3][1] = json!(5_000);
    let error = serde_json::from_value::<XpbdBody>(data).expect_err("it is no body");
    assert!(error.to_string().contains("tetrahedron 3 names vertex 5000"), "{error}");
}

#[test]
fn data_that_is_no_tether_is_an_error() {
    let at = |point: Vec3| XpbdTethers::new([Tether::pin(VertexId(0), TetherTarget::World(point))]);
    let read = through_ron(&at(Vec3::ONE));
    assert_eq!(read.tethers, at(Vec3::ONE).tethers);
    // Its backstop is infinite, which JSON cannot write.
    let value = serde_json::to_value(at(Vec3::ONE)).expect("it can be written");
    assert_eq!(serde_json::from_value::<XpbdTethers>(value.clone()).expect("it can be read").tethers, read.tethers);
    // Where targets were may be left out.
    let bare = json!({ "tethers": value["tethers"] });
    assert_eq!(serde_json::from_value::<XpbdTethers>(bare).expect("it can be read").tethers, read.tethers);

    let text = ron::to_string(&at(Vec3::new(0.0, f32::NAN, 0.0))).expect("it can be written");
    let error = ron::from_str::<XpbdTethers>(&text).expect_err("not a number");
    assert!(error.to_string().contains("not finite"), "{error}");
    let tether = Tether { longest: f32::NAN, ..read.tethers[0] };
    assert!(ron::to_string(&tether).is_err(), "what is NaN would be read as infinite");
    let two = json!({ "tethers": value["tethers"], "last": [Value::Null, Value::Null] });
    let error = serde_json::from_value::<XpbdTethers>(two).expect_err("too many");
    assert!(error.to_string().contains("1 tethers and 2 last places"), "{error}");
}

/// Changes a few numbers somewhere in a value.
pub(crate) fn spoil(value: &mut Value, random: &mut Random) {
    fn numbers<'a>(value: &'a mut Value, found: &mut Vec<&'a mut Value>) {
        match value {
            Value::Number(_) => found.push(value),
            Value::Array(list) => list.iter_mut().for_each(|value| numbers(value, found)),
            Value::Object(map) => map.values_mut().for_each(|value| numbers(value, found)),
            _ => {}
        }
    }
    let mut found = Vec::new();
    numbers(value, &mut found);
    let odd = [json!(0), json!(-1), json!(3), json!(200), json!(4_294_967_295_u32), json!(0.5), json!(1.0e30)];
    for _ in 0..=random.below(2) {
        let place = random.below(found.len() as u64) as usize;
        *found[place] = odd[random.below(odd.len() as u64) as usize].clone();
    }
}

#[test]
fn no_change_of_a_number_in_a_body_or_tether_panics() {
    let (things, _) = saved();
    let mut random = Random::new(29);
    let [mut accepted, mut refused] = [0, 0];
    for round in 0..100 {
        let mut things = things.clone();
        let (_, _, body, tethers, ..) = &mut things[2];
        let is_fine = if round % 2 == 0 {
            let mut value = serde_json::to_value(&*body).expect("it can be written");
            spoil(&mut value, &mut random);
            serde_json::from_value(value).map(|read| *body = read).is_ok()
        } else {
            let mut value = serde_json::to_value(&*tethers).expect("it can be written");
            spoil(&mut value, &mut random);
            serde_json::from_value(value).map(|read| *tethers = read).is_ok()
        };
        if is_fine {
            accepted += 1;
            let mut game = Game::new(0, |_| things, TICKS);
            game.play();
        } else {
            refused += 1;
        }
    }
    assert!(accepted > 20 && refused > 5, "{accepted} accepted, {refused} refused");
}
