//! Results kept for unchanged pairs of surfaces are bit-identical to results computed anew. Checked over long runs with
//! every kind of change to a world, and on recordings.

use bevy_app::prelude::*;
use bevy_circumsphere::{
    CircumsphereSettings, StoredPair,
    detection::{CandidateTrianglePairs, DetectionDiagnostics},
    geometry::CompactContact,
    prelude::*,
};
use bevy_ecs::prelude::*;
use bevy_transform::components::Transform;
use circumsphere_support::{
    random::Random,
    recording::{read_recording, recordings_folder},
    scenes::{Diagonals, Mesh, grid, icosphere},
};
use glam::Vec3;

use crate::world::{Called, THIN, app, at, fingerprint, insert, points, store, surface, write_positions};

/// The surfaces of a run: two sheets that cross, a cloth folded onto itself, and two closed balls.
const SURFACES: [&str; 5] = ["low sheet", "high sheet", "cloth", "ball", "small ball"];

fn mesh(name: &str) -> Mesh {
    match name {
        "low sheet" => grid(5, 5, 2.0, 2.0, Diagonals::Alternating),
        "high sheet" => grid(4, 4, 1.5, 1.5, Diagonals::Uniform).translate([0.03, 0.04, 0.02]),
        "cloth" => {
            let mut cloth = grid(6, 3, 2.0, 1.0, Diagonals::Alternating).translate([0.0, 0.08, 0.0]);
            for [x, y, _] in &mut cloth.positions {
                if *x > 0.0 {
                    (*x, *y) = (-*x, *y + 0.03 + 0.05 * *x);
                }
            }
            cloth
        }
        "ball" => icosphere(2, 0.4),
        _ => icosphere(1, 0.2),
    }
}

/// A world that can be changed in the same way as another one.
struct Twin {
    app: App,
    surfaces: Vec<Entity>,
    shapes: [Entity; 2],
    /// The surface that has a NaN in this tick.
    spoiled: Option<usize>,
}

impl Twin {
    fn new(memory: bool) -> Self {
        let mut app = app();
        app.insert_resource(CircumsphereSettings { memory, threads: 1, ..Default::default() });
        let surfaces = SURFACES.map(|name| {
            let transform = match name {
                "ball" => at(0.1, 0.53, 0.2),
                "small ball" => at(-0.5, 0.25, -0.4),
                _ => Transform::IDENTITY,
            };
            let entity = app.world_mut().spawn((Called(name), surface(&mesh(name)), THIN, transform)).id();
            if name == "cloth" {
                insert(&mut app, entity, SelfCollision);
            }
            entity
        });
        let mut shape = |name, shape, transform: Transform| {
            app.world_mut().spawn((Called(name), RigidShape(shape), transform)).id()
        };
        let floor = shape("floor", SharedShape::halfspace(parry3d::math::Vec3::Y), at(0.0, -0.04, 0.0));
        let stone = shape("stone", SharedShape::ball(0.3), at(0.6, 0.33, 0.5));
        Self { app, surfaces: surfaces.to_vec(), shapes: [floor, stone], spoiled: None }
    }

    /// Makes one change to the world. Equal random numbers make equal changes.
    fn happen(&mut self, random: &mut Random) {
        let place = random.below(SURFACES.len() as u64) as usize;
        let entity = self.surfaces[place];
        let app = &mut self.app;
        let mut positions = points(&mesh(SURFACES[place]));
        let small = |random: &mut Random| 0.06 * random.signed_unit();
        match random.below(18) {
            0 | 1 => {
                let vertex = random.below(positions.len() as u64) as usize;
                positions[vertex].y += small(random);
                write_positions(app, entity, &positions);
            }
            2 | 3 => {
                let offset = Vec3::new(small(random), small(random), small(random));
                for position in &mut positions {
                    *position += offset;
                }
                write_positions(app, entity, &positions);
            }
            4 => {
                let moved = [entity, self.shapes[1]][random.below(2) as usize];
                let offset = small(random);
                app.world_mut().get_mut::<Transform>(moved).expect("it has one").translation.y += 0.3 * offset;
            }
            5 => insert(app, [entity, self.shapes[0]][random.below(2) as usize], Teleported),
            6 => {
                let body = [entity, self.shapes[1]][random.below(2) as usize];
                let mut body = app.world_mut().entity_mut(body);
                if body.contains::<SurfaceDisabled>() {
                    body.remove::<SurfaceDisabled>()
                } else {
                    body.insert(SurfaceDisabled)
                };
            }
            7 | 8 => insert(app, entity, ContactMethod::ALL[random.below(5) as usize]),
            9 => insert(app, entity, SurfaceThickness::World([0.05, 0.02, 0.08][random.below(3) as usize])),
            10 => {
                let mut body = app.world_mut().entity_mut(entity);
                if body.contains::<ContactEventsEnabled>() {
                    body.remove::<ContactEventsEnabled>()
                } else {
                    body.insert(ContactEventsEnabled)
                };
            }
            11 => insert(app, entity, SurfaceOrder(random.below(3) as u32)),
            12 => {
                let sides = [Sidedness::Auto, Sidedness::OneSided, Sidedness::TwoSided];
                insert(app, entity, sides[random.below(3) as usize]);
            }
            13 => {
                let mut settings = app.world_mut().resource_mut::<CircumsphereSettings>();
                match random.below(3) {
                    0 => settings.margin = [0.0, 0.03][random.below(2) as usize],
                    1 => settings.sphere_offset = [0.5, 0.3][random.below(2) as usize],
                    _ => settings.refit_threshold = [0.7, 0.0][random.below(2) as usize],
                }
            }
            14 => {
                app.world_mut().despawn(entity);
                let bundle = (Called(SURFACES[place]), surface(&mesh(SURFACES[place])), THIN, at(0.1, 0.1, 0.0));
                self.surfaces[place] = app.world_mut().spawn(bundle).id();
            }
            15 => insert(app, entity, surface(&mesh(SURFACES[place])).0),
            16 => {
                let radius = [0.3, 0.32][random.below(2) as usize];
                insert(app, self.shapes[1], RigidShape(SharedShape::ball(radius)));
            }
            _ => {
                positions[0].x = f32::NAN;
                write_positions(app, entity, &positions);
                self.spoiled = Some(place);
            }
        }
    }

    fn tick(&mut self) {
        self.app.update();
        if let Some(place) = self.spoiled.take() {
            let positions = points(&mesh(SURFACES[place]));
            write_positions(&mut self.app, self.surfaces[place], &positions);
        }
    }

    /// The messages of this tick.
    fn announced(&self) -> String {
        let started = self.app.world().resource::<Messages<SurfaceContactStart>>();
        let ended = self.app.world().resource::<Messages<SurfaceContactEnd>>();
        let started: Vec<_> = started.iter_current_update_messages().collect();
        let ended: Vec<_> = ended.iter_current_update_messages().collect();
        format!("{started:?} {ended:?}")
    }

    fn kept(&self) -> usize {
        self.app.world().resource::<DetectionDiagnostics>().pairs_kept
    }
}

/// Counts of what happened in a run.
#[derive(Debug, Default)]
struct Tally {
    kept: usize,
    /// Ticks in which there were pairs and all of them were kept.
    rests: usize,
    /// Ticks in which some pairs were kept and others were not.
    halves: usize,
    touching: usize,
    /// Contacts of two sheets that have passed each other, in ticks in which both were kept.
    passed: usize,
}

/// Makes the same changes to a world with memory and to one without, and compares them in every tick.
fn run(seed: u64, ticks: usize) -> Tally {
    let (mut warm, mut cold) = (Twin::new(true), Twin::new(false));
    let mut script = Random::new(seed);
    let mut tally = Tally::default();
    // Clones of stored pairs keep their contents, although the stages overwrite the lists in later ticks.
    let mut held: Option<(Vec<StoredPair>, Vec<CompactContact>)> = None;
    for tick in 0..ticks {
        if script.below(2) == 0 {
            for _ in 0..=script.below(2) {
                let mut same = script.clone();
                warm.happen(&mut script);
                cold.happen(&mut same);
            }
        }
        warm.tick();
        cold.tick();
        assert_eq!(cold.kept(), 0);
        assert_eq!(store(&warm.app).tick(), store(&cold.app).tick());
        assert_eq!(fingerprint(&warm.app), fingerprint(&cold.app), "tick {tick}");
        assert_eq!(warm.announced(), cold.announced(), "tick {tick}");
        let pairs = warm.app.world().resource::<CandidateTrianglePairs>().pairs().len();
        tally.kept += warm.kept();
        tally.rests += usize::from(warm.kept() > 0 && warm.kept() == pairs);
        tally.halves += usize::from(warm.kept() > 0 && warm.kept() < pairs);
        tally.touching += store(&warm.app).touching_count();
        if tick % 5 == 0 {
            let now = store(&warm.app).pairs().to_vec();
            let contacts = now.iter().flat_map(|pair| pair.contacts.iter()).copied().collect();
            let (last, contacts) = held.replace((now, contacts)).unwrap_or_default();
            assert!(last.iter().flat_map(|pair| pair.contacts.iter()).eq(&contacts), "tick {tick}");
        }
        if warm.kept() == pairs {
            let sheets = [warm.surfaces[0], warm.surfaces[1]];
            let found = store(&warm.app);
            let pair = found.pairs().iter().find(|pair| sheets == [pair.a.entity(), pair.b.entity()]);
            let contacts = pair.map_or(&[][..], |pair| &pair.contacts[..]);
            tally.passed += contacts.iter().filter(|contact| contact.distance < 0.0).count();
        }
    }
    tally
}

#[test]
fn a_world_that_keeps_what_has_not_changed_finds_what_one_that_keeps_nothing_finds() {
    let tally = run(3, 1000);
    eprintln!("{tally:?}");
    assert!(tally.kept > 3000 && tally.rests > 300 && tally.halves > 150, "{tally:?}");
    assert!(tally.touching > 100_000 && tally.passed > 1000, "{tally:?}");
}

#[test]
fn recordings_that_pause_find_what_they_find_without_memory() {
    let Some(folder) = recordings_folder() else { return };
    let mut kept = 0;
    for name in ["armadillo_rollers_326", "two_cubes_close_to_intersecting", "mat100x100", "fandisk"] {
        let recording = read_recording(&[folder.join(format!("{name}.bin"))]).expect("the file is a recording");
        for method in [ContactMethod::Exact, ContactMethod::Closest, ContactMethod::Circumsphere] {
            let mut worlds = [true, false].map(|memory| {
                let mut app = app();
                app.insert_resource(CircumsphereSettings { memory, threads: 1, ..Default::default() });
                let rest: Vec<Vec3> = recording.frames[0].iter().copied().map(Vec3::from).collect();
                let body = DeformableSurface::from_mesh(&rest, &recording.triangles).expect("the mesh is valid");
                let parts = (Called("mesh"), body, SelfCollision, Sidedness::TwoSided, method);
                let entity = app.world_mut().spawn(parts).id();
                (app, entity)
            });
            for (tick, frame) in recording.frames.iter().take(4).flat_map(|frame| [frame; 3]).enumerate() {
                let positions: Vec<Vec3> = frame.iter().copied().map(Vec3::from).collect();
                for (app, entity) in &mut worlds {
                    write_positions(app, *entity, &positions);
                    app.update();
                }
                let [(warm, _), (cold, _)] = &worlds;
                assert_eq!(fingerprint(warm), fingerprint(cold), "{name} {method:?} tick {tick}");
                kept += warm.world().resource::<DetectionDiagnostics>().pairs_kept;
            }
        }
    }
    assert!(kept >= 4 * 3 * 2, "only {kept} pairs were kept");
}
