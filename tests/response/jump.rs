//! What a character wears comes along when it jumps and the game has not marked that. The truth is the same walk without
//! the jump: the laws of motion are the same elsewhere and in any direction on the level.

use bevy_circumsphere::{prelude::*, response::*};
use bevy_ecs::prelude::*;
use circumsphere_support::scenes::{
    CHARACTER_SPEEDS, Character, CharacterFineness, character_skirt, character_waist_vertices, cloth, cloth_corners,
};
use glam::{DAffine3, DMat3, DVec3, Quat, Vec3};

use crate::{
    harness::{Scene, TICK, mean},
    truth::{Closed, doubles},
    walking::{SKIRT, add_capsules, add_skirt, pose_capsules},
};

/// Mean distances, in meters. Positions of 100 m are rounded by 4e-6 m, so folds of a free hem differ in time.
const OFF_AT_ONCE: f64 = 0.001;
const OFF_LATER: f64 = 0.01;

#[derive(Clone, Copy, PartialEq)]
enum Holds {
    /// Tethers to a skin.
    Tethers,
    /// Pinned vertices that the game moves, beside a skin.
    Pins,
    /// The same, beside capsules that the game moves by their transforms.
    PinsAndCapsules,
}

struct Worn {
    scene: Scene,
    character: Character,
    body: Vec<Entity>,
    skirt: Entity,
    waist: Vec<[f32; 3]>,
    holds: Holds,
}

impl Worn {
    fn new(holds: Holds, speed: f64) -> Self {
        let character = Character::new(CharacterFineness::Coarse, speed);
        let mut scene = Scene::new();
        let body = if holds == Holds::PinsAndCapsules {
            add_capsules(&mut scene).to_vec()
        } else {
            vec![scene.add_obstacle(character.rest(), SurfaceFrame::World)]
        };
        let (skirt, waist) = if holds == Holds::Tethers {
            add_tethered_skirt(&mut scene, &character, body[0])
        } else {
            add_skirt(&mut scene)
        };
        Self { scene, character, body, skirt, waist, holds }
    }

    /// Plays a tick with the character as it is at a time, moved by `moved`.
    fn tick(&mut self, number: usize, moved: &DAffine3) {
        let time = number as f64 * TICK;
        let place = |points: Vec<[f32; 3]>| -> Vec<Vec3> {
            points.into_iter().map(|point| moved.transform_point3(Vec3::from(point).as_dvec3()).as_vec3()).collect()
        };
        let Self { scene, character, body, skirt, waist, holds } = self;
        if *holds != Holds::Tethers {
            let pins = place(character.follow_torso(time, waist));
            let mut positions = scene.app.world_mut().get_mut::<SurfacePositions>(*skirt).unwrap();
            positions.0[..pins.len()].copy_from_slice(&pins);
        }
        if *holds == Holds::PinsAndCapsules {
            let poses = [character.torso_pose(time), character.leg_pose(time)].map(|(translation, rotation)| {
                let rotation = Quat::from_mat3(&moved.matrix3.as_mat3()) * Quat::from_array(rotation).normalize();
                (place(vec![translation])[0].to_array(), rotation.to_array())
            });
            pose_capsules(scene, body, poses);
        } else {
            scene.app.world_mut().get_mut::<SurfacePositions>(body[0]).unwrap().0 = place(character.positions(time));
        }
        scene.tick(TICK);
    }
}

/// Adds a skirt whose waist is pinned to a skin, and the rest of which is tethered to it.
fn add_tethered_skirt(scene: &mut Scene, character: &Character, body: Entity) -> (Entity, Vec<[f32; 3]>) {
    let (rings, segments) = SKIRT;
    let mesh = character_skirt(rings, segments);
    let waist = character_waist_vertices(segments);
    let points = |positions: &[[f32; 3]]| positions.iter().copied().map(Vec3::from).collect::<Vec<_>>();
    let skin = (&*points(&character.rest().positions), &*character.rest().triangles);
    let mut tethers = XpbdTethers::to_surface(body, skin, &points(&mesh.positions), 0.4, 0.004);
    for tether in tethers.tethers.iter_mut().filter(|tether| waist.contains(&tether.vertex.index())) {
        (tether.longest, tether.backstop) = (0.0, f32::INFINITY);
    }
    let skirt = scene.add(&mesh, XpbdMaterial::CLOTH, (SelfCollision, SweptCollision, tethers));
    (skirt, mesh.positions[waist].to_vec())
}

const JUMPS: [(f64, DVec3); 5] = [
    (0.0, DVec3::new(100.0, 0.0, 0.0)),
    (0.0, DVec3::new(0.0, 3.0, -2.0)),
    (2.0, DVec3::new(0.0, 0.0, 20.0)),
    (core::f64::consts::PI, DVec3::new(1.0, 0.0, 1.0)),
    (0.0, DVec3::new(0.7, 0.0, 0.0)),
];

/// Before and after the jump, in ticks.
const BEFORE: usize = 40;
const AFTER: usize = 40;

fn jumps(holds: Holds) {
    for (angle, way) in JUMPS {
        let [mut stays, mut jumps] = [(); 2].map(|()| Worn::new(holds, CHARACTER_SPEEDS[1]));
        let jump = DAffine3 { matrix3: DMat3::from_rotation_y(angle), translation: way };
        for number in 0..BEFORE + AFTER {
            stays.tick(number, &DAffine3::IDENTITY);
            jumps.tick(number, if number < BEFORE { &DAffine3::IDENTITY } else { &jump });
            let name = format!("{angle} and {way}, tick {number}");
            let diagnostics = jumps.scene.diagnostics();
            let carried: &[Entity] = if number == BEFORE { &[jumps.skirt] } else { &[] };
            assert_eq!(diagnostics.carried, carried, "{name}");
            if number < BEFORE {
                continue;
            }
            assert!(diagnostics.parts <= stays.scene.diagnostics().parts.max(2), "{name}: {}", diagnostics.parts);
            let [expected, found] = [&stays, &jumps].map(|worn| doubles(worn.scene.positions(worn.skirt)));
            let off = expected.iter().zip(&found).map(|(at, found)| jump.transform_point3(*at).distance(*found));
            let off = off.sum::<f64>() / found.len() as f64;
            let most = if number == BEFORE { OFF_AT_ONCE } else { OFF_LATER };
            assert!(off < most, "{name}: off by {off}");
            if holds != Holds::PinsAndCapsules {
                let skin = doubles(jumps.scene.positions(jumps.body[0]));
                let closed = Closed::new(skin, jumps.character.rest().triangles.clone());
                assert!(!found.iter().any(|&at| closed.contains(at)), "{name}: inside");
            }
        }
    }
}

#[test]
fn a_tethered_skirt_comes_along_when_its_wearer_jumps() {
    jumps(Holds::Tethers);
}

#[test]
fn a_pinned_skirt_comes_along_when_its_wearer_jumps() {
    jumps(Holds::Pins);
}

#[test]
fn a_pinned_skirt_comes_along_when_capsules_jump_with_it() {
    jumps(Holds::PinsAndCapsules);
}

/// Who jumps through a curtain has not walked through it.
#[test]
fn what_hangs_between_is_not_touched() {
    let mut worn = Worn::new(Holds::Tethers, CHARACTER_SPEEDS[0]);
    let mut sheet = cloth(21, 0.05);
    for position in &mut sheet.positions {
        *position = [5.0, position[0] + 0.5, position[2]];
    }
    let top = sheet.positions.iter().map(|position| position[1]).fold(f32::MIN, f32::max);
    let pins = (0..)
        .zip(&sheet.positions)
        .filter(|(_, position)| position[1] > top - 0.01)
        .map(|(vertex, _)| VertexId(vertex));
    let pins: Vec<VertexId> = pins.collect();
    assert_eq!(pins.len(), 21);
    let curtain = worn.scene.add_changed(&sheet, XpbdMaterial::CLOTH, |body| body.pinned(pins), SweptCollision);
    let jump = DAffine3::from_translation(DVec3::X * 10.0);
    for number in 0..BEFORE {
        worn.tick(number, if number < 30 { &DAffine3::IDENTITY } else { &jump });
        let moved = worn.scene.positions(curtain).iter().zip(&sheet.positions);
        let moved = moved.map(|(at, start)| at.distance(Vec3::from(*start))).fold(0.0, f32::max);
        assert!(moved < 0.02, "tick {number}: {moved}");
    }
}

/// A start at ten meters a second and a pull at one corner are motions, and the cloth has to cope with them. So is a stop
/// from sixty, in which the cloth goes on.
#[test]
fn fast_starts_sudden_stops_and_torn_corners_are_no_jumps() {
    let sheet = cloth(21, 0.05);
    let [corner, other, ..] = cloth_corners(21);
    let both = [corner, other];
    let run = |pulls: &[usize], ways: &[Vec3]| {
        let mut scene = Scene::new();
        let pins = both.map(|vertex| VertexId(vertex as u32));
        let flag = scene.add_changed(&sheet, XpbdMaterial::CLOTH, |body| body.pinned(pins), SweptCollision);
        // Before its first tick, it has no place to come from.
        scene.tick(TICK);
        let mut before = Vec::new();
        for way in ways {
            before = scene.positions(flag).to_vec();
            let mut positions = scene.app.world_mut().get_mut::<SurfacePositions>(flag).unwrap();
            for &vertex in pulls {
                positions.0[vertex] += *way;
            }
            scene.tick(TICK);
            assert!(scene.diagnostics().carried.is_empty(), "{pulls:?} {way}");
        }
        let moved = scene.positions(flag).iter().zip(&before).map(|(at, before)| *at - *before);
        mean(&moved.collect::<Vec<_>>()).dot(DVec3::X)
    };
    let start = run(&both, &[Vec3::X * 10.0 * TICK as f32]);
    assert!(start < 7.5 * TICK, "{start}");
    let faster = (1..=10).map(|step| Vec3::X * 0.1 * step as f32);
    let stop = run(&both, &faster.chain([Vec3::X, Vec3::X, Vec3::ZERO]).collect::<Vec<_>>());
    assert!(stop > 0.1, "{stop}");
    run(&[corner], &[Vec3::NEG_X * 2.0]);
}

/// A single pin does not turn what hangs from it.
#[test]
fn what_hangs_from_one_pin_comes_along() {
    let sheet = cloth(11, 0.05);
    let mut scene = Scene::new();
    let flag = scene.add_changed(&sheet, XpbdMaterial::CLOTH, |body| body.pinned([VertexId(0)]), SweptCollision);
    scene.run(120);
    let before = scene.positions(flag).to_vec();
    let way = Vec3::new(50.0, 2.0, 0.0);
    scene.app.world_mut().get_mut::<SurfacePositions>(flag).unwrap().0[0] += way;
    scene.tick(TICK);
    assert_eq!(scene.diagnostics().carried, [flag]);
    let off = scene.positions(flag).iter().zip(&before).map(|(at, before)| at.distance(*before + way));
    let off = off.fold(0.0, f32::max);
    // At most what it swings in a tick.
    assert!(off < 0.05, "{off}");
}
