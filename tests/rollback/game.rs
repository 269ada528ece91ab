//! A game in which all that is remembered from tick to tick decides what happens.

use std::{fmt::Write, time::Duration};

use bevy_app::prelude::*;
use bevy_circumsphere::{
    CollisionHistory, ContactStore, RollbackPlugin, SurfaceOrder,
    prelude::*,
    response::{RigidMass, RigidPush, XpbdBody, XpbdDiagnostics, XpbdMaterial, XpbdResponsePlugin, XpbdSettings},
};
use bevy_ecs::prelude::*;
use bevy_math::ops::sin;
use bevy_time::Time;
use bevy_transform::components::Transform;
use circumsphere_support::scenes::{Diagonals, Mesh, grid, icosphere};
use glam::{Mat3, Quat, Vec3};

/// Ticks of the whole game.
pub const TICKS: usize = 150;

/// Something that the game moves: by its transform, or by its vertices.
#[derive(Component, Clone, Copy)]
enum Driven {
    /// Up and down, and around itself.
    Pose(Vec3),
    /// Waves that run over a sheet.
    Waves(f32),
    /// A sheet that goes down through another one, and back.
    Through,
    /// A shape that flies up and down, far in each tick.
    Flying(Vec3),
}

/// The messages and impacts of a tick.
#[derive(Resource, Default)]
struct Heard(String);

fn listen(
    mut heard: ResMut<Heard>,
    mut starts: MessageReader<SurfaceContactStart>,
    mut ends: MessageReader<SurfaceContactEnd>,
    mut quarantined: MessageReader<SurfaceQuarantined>,
    impacts: SurfaceImpacts,
) {
    heard.0.clear();
    for start in starts.read() {
        let _ = write!(heard.0, "{start:?} ");
    }
    for end in ends.read() {
        let _ = write!(heard.0, "{end:?} ");
    }
    for message in quarantined.read() {
        let _ = write!(heard.0, "{message:?} ");
    }
    for impact in impacts.iter() {
        let _ = write!(heard.0, "{impact:?} ");
    }
}

/// A game whose every input follows from the number of the tick.
pub struct Game {
    pub app: App,
    entities: Vec<Entity>,
    /// The number of the next tick.
    pub tick: usize,
}

/// What the game saves at the end of a tick, so before the one with this number.
#[derive(Clone)]
pub struct Saved {
    pub tick: usize,
    components: Vec<(Option<SurfacePositions>, Option<XpbdBody>, Transform, bool)>,
    pub history: CollisionHistory,
}

impl Game {
    pub fn new() -> Self {
        let mut app = App::new();
        app.add_plugins((
            DeformableCollisionPlugins::new(Update),
            XpbdResponsePlugin::new(Update),
            RollbackPlugin::new(Update),
        ));
        app.init_resource::<Time>().init_resource::<Heard>();
        app.add_systems(Update, listen.after(DeformableSystems::Events));
        app.insert_resource(CircumsphereSettings { threads: 1, ..Default::default() });
        app.world_mut().resource_mut::<XpbdSettings>().sleep_speed = 0.05;
        let mut game = Self { app, entities: Vec::new(), tick: 0 };
        let thin = SurfaceThickness::World(0.03);
        let events = (ContactEventsEnabled, ContactEventHold(2));
        let at = Transform::from_xyz;
        // A cloth that falls onto a ball that moves, and onto itself.
        let cloth = grid(5, 5, 1.0, 1.0, Diagonals::Alternating).translate([0.0, 0.7, 0.0]);
        let cloth =
            game.body(&cloth, XpbdMaterial::CLOTH, (thin, SelfCollision, SweptCollision, events, SurfaceOrder(1)));
        game.driven(&icosphere(1, 0.35), Driven::Pose(Vec3::ZERO), (thin, SurfaceOrder(2)));
        // A rag that comes to rest on the ground, and sleeps.
        let rag = grid(2, 2, 0.4, 0.4, Diagonals::Uniform).translate([3.0, -0.55, 0.0]);
        game.body(&rag, XpbdMaterial::CLOTH, (thin, SweptCollision, events, SurfaceOrder(3)));
        let ground = RigidShape(SharedShape::halfspace(Vec3::Y));
        game.entities.push(game.app.world_mut().spawn((ground, at(0.0, -0.6, 0.0))).id());
        let pusher = RigidShape(SharedShape::cuboid(0.2, 0.2, 0.2));
        let pusher = (pusher, Driven::Pose(Vec3::new(1.2, 0.1, 0.0)), at(1.2, 0.1, 0.0), SweptCollision);
        game.entities.push(game.app.world_mut().spawn(pusher).id());
        // Sheets far away, of which one passes through the other: their sides are only known from history.
        let sheet = grid(3, 3, 1.0, 1.0, Diagonals::Uniform);
        let far = sheet.clone().translate([0.0, 0.0, 10.0]);
        game.driven(&far, Driven::Waves(0.0), (SurfaceThickness::World(0.1), events, SurfaceOrder(4)));
        let above = sheet.translate([0.013, 0.02, 10.017]);
        let swept = (SurfaceThickness::World(0.1), SweptCollision, SurfaceOrder(5));
        game.driven(&above, Driven::Through, swept);
        // Lazily refitted spheres depend on the shapes of earlier ticks.
        let spheres = (SurfaceThickness::World(0.1), ContactMethod::Circumsphere);
        let waves = grid(4, 4, 1.0, 1.0, Diagonals::Uniform).translate([0.0, 0.0, 20.0]);
        game.driven(&waves, Driven::Waves(0.35), (spheres, events, SurfaceOrder(6)));
        let waves = waves.translate([0.02, 0.08, 0.03]);
        game.driven(&waves, Driven::Waves(-0.3), (spheres, SurfaceOrder(7)));
        // What flies through the sheets that are far away.
        let ball = RigidShape(SharedShape::ball(0.1));
        let place = Vec3::new(0.1, 0.0, 10.1);
        let ball = (ball, Driven::Flying(place), Transform::from_translation(place), SweptCollision);
        game.entities.push(game.app.world_mut().spawn(ball).id());
        // A soft ball in a block, which is led out.
        let block = (RigidShape(SharedShape::cuboid(1.0, 1.0, 1.0)), at(-10.0, 0.0, 0.0));
        game.entities.push(game.app.world_mut().spawn(block).id());
        let inside = icosphere(1, 0.25).translate([-9.4, 0.2, 0.1]);
        game.body(&inside, XpbdMaterial::SOFT, (thin, SweptCollision, SurfaceOrder(8)));
        // A rigid ball that the cloth pushes. The game brings it back, so its way begins where only history knows.
        let place = Vec3::new(0.15, 0.35, 0.1);
        let inverse_inertia = Mat3::from_diagonal(Vec3::splat(1.0e3));
        let mass = RigidMass { inverse_mass: Vec3::splat(10.0), inverse_inertia, center_of_mass: place };
        let pushed =
            (RigidShape(SharedShape::ball(0.15)), mass, Driven::Pose(place), Transform::from_translation(place));
        game.entities.push(game.app.world_mut().spawn(pushed).id());
        assert_eq!(game.entities[0], cloth);
        game
    }

    fn body(&mut self, mesh: &Mesh, material: XpbdMaterial, extra: impl Bundle) -> Entity {
        let (surface, positions) = surface(mesh);
        let body = XpbdBody::new(&surface, &positions, material).expect("the mesh can be a body");
        let entity = self.app.world_mut().spawn((surface, positions, body, extra)).id();
        self.entities.push(entity);
        entity
    }

    fn driven(&mut self, mesh: &Mesh, driven: Driven, extra: impl Bundle) {
        let rest = surface(mesh);
        self.entities.push(self.app.world_mut().spawn((rest, driven, Rest(points(mesh)), extra)).id());
    }

    /// Plays one tick, all of whose input follows from its number, and returns everything that it results in.
    pub fn play(&mut self) -> String {
        let tick = self.tick as f32;
        let world = self.app.world_mut();
        let mut driven = world.query::<(&Driven, &mut Transform, Option<(&Rest, &mut SurfacePositions)>)>();
        for (driven, mut transform, mesh) in driven.iter_mut(world) {
            match (*driven, mesh) {
                (Driven::Pose(place), _) => {
                    transform.translation = place + Vec3::Y * 0.2 * sin(tick * 0.21);
                    transform.rotation = Quat::from_rotation_y(0.05 * tick);
                }
                (Driven::Flying(place), _) => transform.translation = place + Vec3::Y * 0.6 * sin(tick * 0.9),
                (Driven::Waves(height), Some((rest, mut positions))) => {
                    let wave = |point: &Vec3| *point + Vec3::Y * height * sin(4.0 * point.x + 0.3 * tick);
                    let waves: Vec<Vec3> = rest.0.iter().map(wave).collect();
                    positions.set_if_neq(SurfacePositions(waves));
                }
                (Driven::Through, Some((rest, mut positions))) => {
                    // Fast once in a while, slow otherwise.
                    let down = 0.12 * sin(0.4 * tick) + if self.tick % 13 == 5 { 0.5 } else { 0.0 };
                    positions.0 = rest.0.iter().map(|point| *point - Vec3::Y * down).collect();
                }
                _ => {}
            }
        }
        // The game disables a sheet for some ticks, lets another jump, spoils a third, and pushes the cloth.
        let [cloth, sheet, waves, spoiled] = [0, 5, 7, 8].map(|place| self.entities[place]);
        if self.tick % 29 == 20 {
            world.entity_mut(sheet).insert(SurfaceDisabled);
        } else if self.tick % 29 == 23 {
            world.entity_mut(sheet).remove::<SurfaceDisabled>();
        }
        if self.tick % 31 == 11 {
            world.entity_mut(waves).insert(Teleported);
        }
        if self.tick % 23 == 12 {
            world.get_mut::<SurfacePositions>(spoiled).expect("it is a surface").0[3].x = f32::NAN;
        }
        if self.tick % 37 == 30 {
            world.get_mut::<XpbdBody>(cloth).expect("it is a body").velocities[7] += Vec3::Y * 3.0;
        }
        // The rag is pushed while it sleeps.
        if self.tick == 100 {
            world.get_mut::<XpbdBody>(self.entities[2]).expect("it is a body").velocities.fill(Vec3::Y);
        }
        world.resource_mut::<Time>().advance_by(Duration::from_micros(16_667));
        self.app.update();
        self.tick += 1;
        self.results()
    }

    fn results(&mut self) -> String {
        let world = self.app.world_mut();
        let mut text = std::mem::take(&mut world.resource_mut::<Heard>().0);
        let store = world.resource::<ContactStore>();
        let _ = write!(text, "{} ", store.tick());
        for pair in store.pairs() {
            let _ = write!(text, "{:?} {:?} {} ", pair.a, pair.b, pair.nearest);
            for contact in pair.contacts.iter() {
                let _ = write!(text, "{contact:?} ");
            }
            let _ = write!(text, "{:?} ", &*pair.touching);
        }
        let _ = write!(text, "asleep {} ", world.resource::<XpbdDiagnostics>().asleep);
        for &entity in &self.entities {
            let body = world.get::<XpbdBody>(entity).map(|body| &body.velocities);
            let _ = write!(text, "{:?} {body:?} ", world.get::<SurfacePositions>(entity));
            if let Some(push) = world.get::<RigidPush>(entity).filter(|push| **push != RigidPush::default()) {
                let _ = write!(text, "pushed {push:?} ");
            }
        }
        text
    }

    pub fn save(&self) -> Saved {
        let world = self.app.world();
        let components = self.entities.iter().map(|&entity| {
            (
                world.get::<SurfacePositions>(entity).cloned(),
                world.get::<XpbdBody>(entity).cloned(),
                *world.get::<Transform>(entity).expect("it has one"),
                world.entity(entity).contains::<SurfaceDisabled>(),
            )
        });
        let history = world.resource::<CollisionHistory>().clone();
        Saved { tick: self.tick, components: components.collect(), history }
    }

    /// Puts back what the game saves, except for the history.
    pub fn go_back(&mut self, saved: &Saved) {
        self.tick = saved.tick;
        let world = self.app.world_mut();
        for (&entity, (positions, body, transform, is_disabled)) in self.entities.iter().zip(&saved.components) {
            let mut entity = world.entity_mut(entity);
            // Vertices of rigid shapes belong to the plugin.
            if let (Some(positions), Some(mut own)) = (positions, entity.get_mut::<SurfacePositions>()) {
                own.clone_from(positions);
            }
            if let Some(body) = body {
                entity.insert(body.clone());
            }
            *entity.get_mut::<Transform>().expect("it has one") = *transform;
            entity.remove::<(Teleported, SurfaceDisabled)>();
            if *is_disabled {
                entity.insert(SurfaceDisabled);
            }
        }
    }
}

/// The vertices of a driven surface at rest.
#[derive(Component)]
struct Rest(Vec<Vec3>);

pub fn points(mesh: &Mesh) -> Vec<Vec3> {
    mesh.positions.iter().map(|&point| Vec3::from(point)).collect()
}

pub fn surface(mesh: &Mesh) -> (DeformableSurface, SurfacePositions) {
    DeformableSurface::from_mesh(&points(mesh), &mesh.triangles).expect("the mesh is sound")
}

/// Everything that happens in a game that never goes back.
pub fn straight() -> Vec<String> {
    let mut game = Game::new();
    (0..TICKS).map(|_| game.play()).collect()
}
