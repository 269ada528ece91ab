//! Lists of near pairs for meshes that move a little give results that are bit-identical to those without lists: in
//! motion of any kind and speed, while everything else changes too, at any scale and place, on one and on several
//! threads.

use std::collections::HashSet;

use bevy_app::prelude::*;
use bevy_circumsphere::{
    ActiveSurfaces, CircumsphereSettings,
    detection::{CandidateTrianglePairs, DetectionDiagnostics, OtherSide, PairFates},
    geometry::{PairFate, SurfaceTopology},
    prelude::*,
};
use bevy_ecs::{prelude::*, system::RunSystemOnce};
use bevy_math::ops::{powf, sin};
use bevy_transform::components::Transform;
use circumsphere_support::{
    random::Random,
    recording::{read_recording, recordings_folder},
    scenes::{Diagonals, Mesh, crumpled_sheet, grid, icosphere},
};
use circumsphere_truth::triangle_distance;
use glam::Vec3;

use crate::world::{Called, app, fingerprint, insert, store, write_positions};

const SURFACES: [&str; 4] = ["cloth", "low sheet", "high sheet", "ball"];

/// Half the contact distance of most pairs. The cloth's edges are about 2.7 long.
const THICKNESS: f32 = 0.15;

fn mesh(name: &str) -> Mesh {
    match name {
        "cloth" => crumpled_sheet(200, 0.0),
        "low sheet" => grid(8, 8, 16.0, 16.0, Diagonals::Alternating).translate([5.0, 0.0, 5.0]),
        "high sheet" => grid(7, 7, 15.0, 15.0, Diagonals::Uniform).translate([5.0, 0.25, 5.2]),
        _ => icosphere(2, 2.0).translate([4.0, 2.1, 4.0]),
    }
}

/// How a surface moves in every tick. Lengths are in contact distances.
#[derive(Clone, Copy, Debug)]
enum Going {
    Nowhere,
    /// All vertices move alike.
    Straight(Vec3),
    /// Every vertex moves in its own direction.
    Apart(f32),
    /// Every vertex jumps in a new random direction.
    Trembling(f32),
    /// Grows and shrinks by turns.
    Breathing(f32),
    /// Moves faster and faster.
    Falling(f32),
}

impl Going {
    fn any(random: &mut Random) -> Self {
        // From a thousandth of the contact distance per tick to twice the contact distance.
        let speed = powf(10.0, 1.65 * random.signed_unit() - 1.35);
        let direction = Vec3::new(random.signed_unit(), random.signed_unit(), random.signed_unit());
        match random.below(8) {
            0 => Self::Nowhere,
            1 => Self::Straight(speed * direction),
            2 | 3 => Self::Apart(speed),
            4 | 5 => Self::Trembling(speed),
            6 => Self::Breathing(speed),
            _ => Self::Falling(0.1 * speed),
        }
    }
}

/// The current state of a surface.
#[derive(Clone)]
struct Body {
    positions: Vec<Vec3>,
    directions: Vec<Vec3>,
    going: Going,
    ticks: f32,
}

impl Body {
    fn new(name: &str, place: &Place, random: &mut Random) -> Self {
        let positions = place.points(&mesh(name));
        let mut direction = || Vec3::new(random.signed_unit(), random.signed_unit(), random.signed_unit());
        let directions = positions.iter().map(|_| direction()).collect();
        Self { positions, directions, going: Going::Nowhere, ticks: 0.0 }
    }

    fn go(&mut self, place: &Place, random: &mut Random) {
        let unit = 2.0 * THICKNESS * place.scale;
        self.ticks += 1.0;
        for (position, direction) in self.positions.iter_mut().zip(&self.directions) {
            *position += unit
                * match self.going {
                    Going::Nowhere => break,
                    Going::Straight(velocity) => velocity,
                    Going::Apart(speed) => speed * *direction,
                    Going::Trembling(speed) => {
                        speed * Vec3::new(random.signed_unit(), random.signed_unit(), random.signed_unit())
                    }
                    Going::Breathing(speed) => speed * sin(0.4 * self.ticks) * *direction,
                    Going::Falling(speed) => -speed * self.ticks * Vec3::Y,
                };
        }
    }
}

/// The scale of the world, and its offset from the origin.
#[derive(Clone, Copy)]
struct Place {
    scale: f32,
    origin: Vec3,
}

const HERE: Place = Place { scale: 1.0, origin: Vec3::ZERO };

impl Place {
    fn points(&self, mesh: &Mesh) -> Vec<Vec3> {
        mesh.positions.iter().map(|&point| self.scale * Vec3::from_array(point) + self.origin).collect()
    }

    fn surface(&self, name: &str, positions: &[Vec3]) -> impl Bundle + use<> {
        let body = DeformableSurface::from_mesh(positions, &mesh(name).triangles).expect("the mesh is valid");
        let name = SURFACES.into_iter().find(|other| *other == name).expect("the name is one of them");
        let thickness = SurfaceThickness::World(THICKNESS * self.scale);
        (Called(name), body, thickness, Transform::IDENTITY, Sidedness::TwoSided)
    }
}

/// A world that can be changed in the same way as another one.
struct Twin {
    app: App,
    place: Place,
    surfaces: Vec<Entity>,
    bodies: Vec<Body>,
    /// The surface that has invalid positions in this tick.
    spoiled: Option<usize>,
}

impl Twin {
    fn new(settings: CircumsphereSettings, place: Place) -> Self {
        let mut app = app();
        app.insert_resource(settings);
        let mut random = Random::new(1);
        let bodies: Vec<Body> = SURFACES.iter().map(|name| Body::new(name, &place, &mut random)).collect();
        let surfaces = SURFACES.iter().zip(&bodies).map(|(name, body)| {
            let entity = app.world_mut().spawn(place.surface(name, &body.positions)).id();
            if *name == "cloth" || *name == "low sheet" {
                insert(&mut app, entity, SelfCollision);
            }
            entity
        });
        let surfaces = surfaces.collect();
        Self { app, place, surfaces, bodies, spoiled: None }
    }

    /// Makes one change to the world. Equal random numbers make equal changes.
    fn happen(&mut self, random: &mut Random) {
        let number = random.below(SURFACES.len() as u64) as usize;
        let (entity, name) = (self.surfaces[number], SURFACES[number]);
        let (app, place) = (&mut self.app, self.place);
        match random.below(40) {
            0..=19 => self.bodies[number].going = Going::any(random),
            20..=23 => {
                // All surfaces move in the same way.
                let going = Going::any(random);
                self.bodies.iter_mut().for_each(|body| body.going = going);
            }
            24 => self.bodies.iter_mut().for_each(|body| body.going = Going::Nowhere),
            25 | 26 => self.bodies[number] = Body::new(name, &place, random),
            27 => {
                let thickness = THICKNESS * place.scale * [1.0, 0.4, 1.3][random.below(3) as usize];
                insert(app, entity, SurfaceThickness::World(thickness));
            }
            28 => insert(app, entity, ContactMethod::ALL[random.below(5) as usize]),
            29 | 30 => insert(app, entity, [ContactMethod::Exact, ContactMethod::Closest][random.below(2) as usize]),
            31 => {
                app.world_mut().despawn(entity);
                let body = Body::new(name, &place, random);
                self.surfaces[number] = app.world_mut().spawn(place.surface(name, &body.positions)).id();
                self.bodies[number] = body;
            }
            32 => self.spoiled = Some(number),
            33 => {
                let mut body = app.world_mut().entity_mut(entity);
                if body.contains::<SurfaceDisabled>() {
                    body.remove::<SurfaceDisabled>()
                } else {
                    body.insert(SurfaceDisabled)
                };
            }
            34 => {
                // Switches to a frame of its own, or back.
                let lifted = Transform::from_translation(0.1 * place.scale * Vec3::new(0.3, 1.0, 0.2));
                let mut transform = app.world_mut().get_mut::<Transform>(entity).expect("the entity has a transform");
                *transform = if *transform == lifted { Transform::IDENTITY } else { lifted };
            }
            35 => {
                // Moves all surfaces to another frame.
                let turned = Transform::from_rotation(glam::Quat::from_rotation_z(random.signed_unit()));
                for &entity in &self.surfaces {
                    *app.world_mut().get_mut::<Transform>(entity).expect("the entity has a transform") = turned;
                }
            }
            36 => {
                let mut settings = app.world_mut().resource_mut::<CircumsphereSettings>();
                settings.margin = [0.0, 0.1][random.below(2) as usize] * place.scale;
            }
            37 => insert(app, entity, Teleported),
            38 => {
                let sides = [Sidedness::OneSided, Sidedness::TwoSided, Sidedness::TwoSided];
                insert(app, entity, sides[random.below(3) as usize]);
            }
            _ => insert(app, entity, SurfaceOrder(random.below(3) as u32)),
        }
    }

    fn tick(&mut self, random: &mut Random) {
        for (body, &entity) in self.bodies.iter_mut().zip(&self.surfaces) {
            body.go(&self.place, random);
            write_positions(&mut self.app, entity, &body.positions);
        }
        if let Some(number) = self.spoiled.take() {
            let mut positions = self.bodies[number].positions.clone();
            positions[0].x = f32::NAN;
            write_positions(&mut self.app, self.surfaces[number], &positions);
        }
        self.app.update();
    }

    fn diagnostics(&self) -> &DetectionDiagnostics {
        self.app.world().resource::<DetectionDiagnostics>()
    }
}

/// Counts of what happened in a run.
#[derive(Debug, Default)]
struct Tally {
    /// Pairs of surfaces that used a list, summed over the ticks.
    followed: usize,
    passed_over: usize,
    examined: [usize; 2],
    touching: usize,
}

/// Makes the same changes to a world with memory and to one without, and compares them in every tick.
fn run(seed: u64, ticks: usize, threads: usize, place: Place) -> Tally {
    let mut twins =
        [true, false].map(|memory| Twin::new(CircumsphereSettings { memory, threads, ..Default::default() }, place));
    let mut script = Random::new(seed);
    let mut tally = Tally::default();
    for tick in 0..ticks {
        let happens = script.below(6) == 0;
        let scripts = [script.clone(), script.clone()];
        for (twin, mut random) in twins.iter_mut().zip(scripts) {
            if happens {
                twin.happen(&mut random);
            }
            twin.tick(&mut random);
            script = random;
        }
        let [warm, cold] = &twins;
        assert_eq!(cold.diagnostics().lists_reused, 0);
        assert_eq!(fingerprint(&warm.app), fingerprint(&cold.app), "tick {tick}");
        tally.followed += warm.diagnostics().lists_reused;
        tally.passed_over += warm.diagnostics().pairs_passed_over;
        tally.touching += store(&warm.app).touching_count();
        for (count, twin) in tally.examined.iter_mut().zip(&twins) {
            *count += twin.diagnostics().pairs_examined;
        }
    }
    tally
}

#[test]
fn meshes_that_move_a_little_find_what_they_find_without_memory() {
    let tally = run(5, 1000, 1, HERE);
    eprintln!("{tally:?}");
    assert!(tally.followed > 800 && tally.passed_over > 300_000 && tally.touching > 1_000_000, "{tally:?}");
}

#[test]
fn nor_does_it_matter_how_large_a_world_is_and_how_far_from_its_origin() {
    let far = Vec3::new(3.0e3, -1.0e3, 2.0e3);
    let places = [(1.0e-3, Vec3::ZERO), (1.0e4, Vec3::ZERO), (1.0, far), (1.0e-3, 1.0e-3 * far), (1.0e4, 1.0e4 * far)];
    for (seed, (scale, origin)) in (20..).zip(places) {
        let tally = run(seed, 150, 1, Place { scale, origin });
        eprintln!("{scale} {origin}: {tally:?}");
        assert!(tally.followed > 30 && tally.passed_over > 10_000 && tally.touching > 50_000, "{tally:?}");
    }
}

#[cfg(feature = "parallel")]
#[test]
fn nor_how_many_threads_there_are() {
    bevy_tasks::ComputeTaskPool::get_or_init(|| {
        bevy_tasks::TaskPoolBuilder::new().num_threads(crate::world::POOL_THREADS).build()
    });
    let tally = run(30, 150, 2, HERE);
    eprintln!("{tally:?}");
    assert!(tally.followed > 30 && tally.passed_over > 10_000 && tally.touching > 50_000, "{tally:?}");
}

#[test]
fn no_lists_are_made_of_a_fast_mesh_and_hardly_any_of_one_that_is_fast_every_other_tick() {
    for (slow_ticks, most) in [(0, 0), (1, 8)] {
        let mut twin = Twin::new(CircumsphereSettings::default(), HERE);
        let (mut random, mut lists) = (Random::new(3), 0);
        for tick in 0..60 {
            let going = Going::Trembling(if tick % 2 < slow_ticks { 0.02 } else { 2.0 });
            twin.bodies.iter_mut().for_each(|body| body.going = going);
            twin.tick(&mut random);
            lists += twin.diagnostics().lists_made;
        }
        // One list for each pair of surfaces, and no second one if the first was of no use.
        assert!(lists <= most && (slow_ticks == 0 || lists > 0), "{lists}");
    }
}

#[test]
fn fates_of_pairs_that_are_passed_over_are_told_and_true() {
    let mut twin = Twin::new(CircumsphereSettings::default(), HERE);
    let mut random = Random::new(9);
    let (mut remembered, mut touching) = (0, 0);
    for _ in 0..40 {
        twin.bodies.iter_mut().for_each(|body| body.going = Going::Trembling(0.03));
        twin.tick(&mut random);
        let read = |fates: PairFates, candidates: Res<CandidateTrianglePairs>| -> Vec<Vec<([u32; 2], PairFate)>> {
            let of = |place: usize| {
                let mut found = Vec::new();
                fates.of(place, &mut found);
                found
            };
            (0..candidates.pairs().len()).map(of).collect()
        };
        let found = twin.app.world_mut().run_system_once(read).expect("fates can be read");
        let world = twin.app.world();
        let (active, pairs) = (world.resource::<ActiveSurfaces>(), &world.resource::<CandidateTrianglePairs>().pairs());
        let corners = |surface: usize, triangle: u32| {
            let surface = &active.surfaces[surface];
            let positions = &world.get::<SurfacePositions>(surface.entity).expect("the entity is a surface").0;
            surface.topology.triangles()[triangle as usize].map(|vertex| positions[vertex as usize].as_dvec3())
        };
        let (mut of_lists, mut one) = (0, None);
        for (pair, fates) in pairs.iter().zip(&found) {
            let OtherSide::Surface(second) = pair.second else { continue };
            for &([a, b], fate) in fates {
                touching += usize::from(fate == PairFate::Touching);
                if fate == PairFate::Remembered {
                    of_lists += 1;
                    let distance = triangle_distance(&corners(pair.first, a), &corners(second, b));
                    assert!(distance > f64::from(pair.range), "{a} and {b} are {distance} apart");
                    one = Some(
                        [(pair.first, a), (second, b)]
                            .map(|(surface, triangle)| (active.surfaces[surface].entity, TriangleId(triangle))),
                    );
                }
            }
            let mut told: Vec<[u32; 2]> = fates.iter().map(|(triangles, _)| *triangles).collect();
            told.sort_unstable();
            told.dedup();
            assert_eq!(told.len(), fates.len(), "a pair is listed twice");
        }
        assert_eq!(of_lists, twin.diagnostics().pairs_passed_over);
        remembered += of_lists;
        if let Some([first, second]) = one {
            let ask = move |fates: PairFates| fates.between(second, first);
            let fate = twin.app.world_mut().run_system_once(ask).expect("fates can be read");
            assert_eq!(fate, Some(PairFate::Remembered));
        }
    }
    assert!(remembered > 10_000 && touching > 10_000, "{remembered} {touching}");
}

#[test]
fn recordings_that_move_slowly_find_what_they_find_without_memory() {
    let Some(folder) = recordings_folder() else { return };
    let (mut followed, mut touching, mut begun) = (0, 0, 0);
    for name in ["gear_chain", "truck_lowq", "soup", "plate_holes", "teapot", "thick_cloth"] {
        let recording = read_recording(&[folder.join(format!("{name}.bin"))]).expect("the file is a recording");
        let rest: Vec<Vec3> = recording.frames[0].iter().copied().map(Vec3::from).collect();
        let topology = SurfaceTopology::new(&rest, &recording.triangles).expect("the mesh is valid");
        let distance = 0.1 * topology.mean_edge_length(&rest) as f32;
        for method in [ContactMethod::Exact, ContactMethod::Closest] {
            let mut worlds = [true, false].map(|memory| {
                let mut app = app();
                app.insert_resource(CircumsphereSettings { memory, threads: 1, ..Default::default() });
                let body = DeformableSurface::from_mesh(&rest, &recording.triangles).expect("the mesh is valid");
                let thickness = SurfaceThickness::World(0.5 * distance);
                let parts = (Called("mesh"), body, SelfCollision, Sidedness::TwoSided, method, thickness);
                let entity = app.world_mut().spawn(parts).id();
                (app, entity)
            });
            let (mut random, mut positions, mut before) = (Random::new(4), rest.clone(), HashSet::new());
            for tick in 0..12 {
                for position in &mut positions {
                    let direction = Vec3::new(random.signed_unit(), random.signed_unit(), random.signed_unit());
                    *position += 0.02 * distance * direction;
                }
                for (app, entity) in &mut worlds {
                    write_positions(app, *entity, &positions);
                    app.update();
                }
                let [(warm, _), (cold, _)] = &worlds;
                assert!(store(warm).contacts().eq(store(cold).contacts()), "{name} {method:?} tick {tick}");
                assert!(store(warm).touching().eq(store(cold).touching()), "{name} {method:?} tick {tick}");
                touching += store(warm).touching_count();
                let pairs = store(warm).touching().map(|pair| [pair.triangle_a, pair.triangle_b]);
                let pairs: HashSet<[u32; 2]> = pairs.collect();
                if warm.world().resource::<DetectionDiagnostics>().lists_reused > 0 {
                    followed += 1;
                    begun += pairs.difference(&before).count();
                }
                before = pairs;
            }
        }
    }
    eprintln!("{followed} ticks by lists, {touching} touching, {begun} of them began to touch in such a tick");
    assert!(followed > 80 && touching > 300_000 && begun > 1000, "{followed} {touching} {begun}");
}
