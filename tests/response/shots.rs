//! Random shots: bullets, balls, and sheets against rigid shapes of every kind and static surfaces, in random poses,
//! with random spins, at up to a thousand thicknesses per tick. No shot passes its target, and none ends up inside.
//!
//! `CIRCUMSPHERE_SHOTS` sets the number of shots (300 by default). `CIRCUMSPHERE_SHOT` plays a single one.

use std::panic::{AssertUnwindSafe, catch_unwind};

use bevy_circumsphere::{prelude::*, response::*};
use bevy_math::ops;
use bevy_transform::components::Transform;
use circumsphere_support::{
    random::Random,
    scenes::{Diagonals, Mesh, cuboid, grid, icosphere, needle},
};
use glam::{DVec3, Quat, Vec3};
use parry3d::{math::Pose, utils::Array2};

use crate::{
    harness::{Scene, TICK},
    truth::{Closed, Place, Solid, crosses_on_its_way, doubles},
};

const SHOTS_VARIABLE: &str = "CIRCUMSPHERE_SHOTS";
const SHOT_VARIABLE: &str = "CIRCUMSPHERE_SHOT";
const SHOTS: u64 = 300;

/// Half the contact distance of shots and surfaces, in meters.
const THICKNESS: f32 = 0.002;

/// The number of ticks of a shot. It meets its target in the second or third.
const TICKS: usize = 8;

/// A shot that is behind its target for this many ticks in a row has passed it.
const TICKS_BEHIND: usize = 3;

/// A point counts as inside if it is deeper than the rounding of coordinates of some meters and of a pose.
const ROUNDING: f64 = 1e-5;

/// Half the width of targets that are sheets, in meters.
const SHEET: f32 = 0.5;

/// The targets, in turn.
const TARGETS: [&str; 16] = [
    "ball",
    "cuboid",
    "thin cuboid",
    "rounded cuboid",
    "capsule",
    "cylinder",
    "cone",
    "convex hull",
    "half-space",
    "compound",
    "closed trimesh",
    "open trimesh",
    "heightfield",
    "triangle",
    "closed surface",
    "open surface",
];

/// The reference geometry of a target, in its own frame.
enum Truth {
    Solids(Vec<(DVec3, Solid)>),
    Mesh { positions: Vec<DVec3>, triangles: Vec<[u32; 3]>, closed: Option<Closed> },
}

impl Truth {
    fn solid(solid: Solid) -> Self {
        Self::Solids(vec![(DVec3::ZERO, solid)])
    }

    fn mesh(mesh: &Mesh, is_closed: bool) -> Self {
        let positions: Vec<DVec3> = mesh.positions.iter().map(|&position| Vec3::from(position).as_dvec3()).collect();
        let closed = is_closed.then(|| Closed::new(positions.clone(), mesh.triangles.clone()));
        Self::Mesh { positions, triangles: mesh.triangles.clone(), closed }
    }

    fn is_inside(&self, point: DVec3) -> bool {
        match self {
            Self::Solids(solids) => solids.iter().any(|&(offset, solid)| solid.depth(point - offset) > ROUNDING),
            Self::Mesh { closed, .. } => closed.as_ref().is_some_and(|closed| closed.contains(point)),
        }
    }

    /// Whether a straight path goes through the target.
    fn is_between(&self, from: DVec3, to: DVec3) -> bool {
        match self {
            Self::Solids(_) => {
                const SAMPLES: u32 = 1000;
                (0..=SAMPLES).any(|sample| self.is_inside(from.lerp(to, f64::from(sample) / f64::from(SAMPLES))))
            }
            Self::Mesh { positions, triangles, .. } => triangles
                .iter()
                .any(|triangle| crosses_on_its_way([from, to], triangle.map(|corner| [positions[corner as usize]; 2]))),
        }
    }
}

fn vectors(mesh: &Mesh) -> Vec<Vec3> {
    mesh.positions.iter().map(|&position| Vec3::from(position)).collect()
}

enum Body {
    Rigid(SharedShape),
    Surface(Mesh),
}

/// A target by its name. Sheets and half-spaces face along y.
fn target(name: &str) -> (Body, Truth) {
    let half = DVec3::new(0.3, 0.2, 0.25);
    let sheet = || grid(7, 7, 2.0 * SHEET, 2.0 * SHEET, Diagonals::Alternating);
    let block = || cuboid(half.as_vec3().to_array(), 3);
    let trimesh = |mesh: &Mesh| Body::Rigid(SharedShape::trimesh(vectors(mesh), mesh.triangles.clone()).unwrap());
    let rigid = |shape: SharedShape, solid: Solid| (Body::Rigid(shape), Truth::solid(solid));
    match name {
        "ball" => rigid(SharedShape::ball(0.3), Solid::Ball(f64::from(0.3_f32))),
        "cuboid" => rigid(SharedShape::cuboid(0.3, 0.2, 0.25), Solid::Cuboid(half)),
        "thin cuboid" => rigid(
            SharedShape::cuboid(SHEET, 0.005, SHEET),
            Solid::Cuboid(DVec3::new(SHEET.into(), 0.005, SHEET.into())),
        ),
        // The core, grown by the rounding in one direction at a time, is inside.
        "rounded cuboid" => {
            let grown = |axis: DVec3| (DVec3::ZERO, Solid::Cuboid(half + axis * 0.05));
            let truth = Truth::Solids(DVec3::AXES.map(grown).to_vec());
            (Body::Rigid(SharedShape::round_cuboid(0.3, 0.2, 0.25, 0.05)), truth)
        }
        "capsule" => rigid(SharedShape::capsule_y(0.3, 0.2), Solid::Capsule(0.3, 0.2)),
        "cylinder" => rigid(SharedShape::cylinder(0.3, 0.25), Solid::Cylinder(0.3, 0.25)),
        "cone" => rigid(SharedShape::cone(0.3, 0.3), Solid::Cone(0.3, 0.3)),
        "convex hull" => {
            let mesh = icosphere(1, 0.3);
            let shape = SharedShape::convex_hull(&vectors(&mesh)).expect("a ball is convex");
            (Body::Rigid(shape), Truth::mesh(&mesh, true))
        }
        "half-space" => rigid(SharedShape::halfspace(Vec3::Y), Solid::HalfSpace),
        "compound" => {
            let part = SharedShape::cuboid(0.15, 0.2, 0.25);
            let at = |x: f32| Pose::from_translation(Vec3::new(x, 0.0, 0.0));
            let shape = SharedShape::compound(vec![(at(-0.15), part.clone()), (at(0.15), part)]);
            (Body::Rigid(shape), Truth::solid(Solid::Cuboid(half)))
        }
        "closed trimesh" => (trimesh(&block()), Truth::mesh(&block(), true)),
        "open trimesh" => (trimesh(&sheet()), Truth::mesh(&sheet(), false)),
        "heightfield" => {
            let shape = SharedShape::heightfield(Array2::new(8, 8, vec![0.0; 64]), Vec3::new(1.0, 1.0, 1.0));
            (Body::Rigid(shape), Truth::mesh(&sheet(), false))
        }
        "triangle" => {
            let corners = [[-0.6, 0.0, -0.5], [0.0, 0.0, 0.7], [0.6, 0.0, -0.5]];
            let [a, b, c] = corners.map(Vec3::from);
            let mesh = Mesh { positions: corners.to_vec(), triangles: vec![[0, 1, 2]] };
            (Body::Rigid(SharedShape::triangle(a, b, c)), Truth::mesh(&mesh, false))
        }
        "closed surface" => (Body::Surface(block()), Truth::mesh(&block(), true)),
        "open surface" => (Body::Surface(sheet()), Truth::mesh(&sheet(), false)),
        _ => unreachable!("{name} is not a target"),
    }
}

fn direction(random: &mut Random) -> Vec3 {
    loop {
        let point = Vec3::from_array(std::array::from_fn(|_| random.signed_unit()));
        if (0.01..1.0).contains(&point.length_squared()) {
            return point.normalize();
        }
    }
}

fn rotation(random: &mut Random) -> Quat {
    Quat::from_axis_angle(direction(random), 3.2 * random.signed_unit())
}

/// What went wrong with a shot.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Wrong {
    has_passed: bool,
    inside: usize,
    not_finite: usize,
}

/// Plays a shot. Returns its description and what went wrong.
fn shoot(number: u64) -> (String, Wrong) {
    let mut random = Random::new(0x5407_0000 + number);
    let name = TARGETS[(number % TARGETS.len() as u64) as usize];
    let (body, truth) = target(name);
    let speed = ops::powf(1000.0, random.unit() as f32);
    let way = speed * THICKNESS;
    let mut scene = Scene::new();
    scene.settings().gravity = Vec3::ZERO;
    // In the frame of the target, sheets are shot from above or below, and solids from everywhere. No shot aims near a
    // rim.
    let is_flat =
        ["thin cuboid", "half-space", "open trimesh", "heightfield", "triangle", "open surface"].contains(&name);
    let from_above_only = name == "half-space";
    let mut from = direction(&mut random);
    if is_flat {
        // No flatter than 24°.
        from.y = from.y.signum() * from.y.abs().max(0.4);
        from = from.normalize();
    }
    if from_above_only {
        from.y = from.y.abs();
    }
    let aim = 0.12 * Vec3::new(random.signed_unit(), 0.0, random.signed_unit());
    let (mesh, material, kind): (Mesh, XpbdMaterial, &str) = match random.below(4) {
        0 => (icosphere(1, 0.04), XpbdMaterial::SOFT, "ball"),
        1 => (
            needle(0.08, 0.006).translate([0.0, -0.04, 0.0]),
            XpbdMaterial { volume_compliance: f32::INFINITY, ..XpbdMaterial::SOFT },
            "needle",
        ),
        2 => (cuboid([0.02, 0.03, 0.04], 2), XpbdMaterial::SOFT, "box"),
        _ => (grid(5, 5, 0.16, 0.16, Diagonals::Alternating), XpbdMaterial::CLOTH, "sheet"),
    };
    let reach = mesh.positions.iter().map(|&position| Vec3::from(position).length()).fold(0.0, f32::max);
    // The start is outside of all targets and some way off. Flat targets end at their plane.
    let size = if is_flat { (reach + 0.02) / from.y.abs() } else { 0.65 + reach };
    let start = aim + from * (size + (0.3 + random.unit() as f32) * way);
    let turn = rotation(&mut random);
    let spin = direction(&mut random) * (random.unit() as f32 * 30.0);
    let place =
        Place { turn: rotation(&mut random).as_dquat().normalize(), offset: (2.0 * direction(&mut random)).as_dvec3() };
    let to_world = |point: Vec3| (place.turn * point.as_dvec3() + place.offset).as_vec3();
    let velocity = (place.turn.as_quat() * -from) * (way / TICK as f32);
    let is_driven = matches!(body, Body::Rigid(_)) && random.below(3) == 0;
    let positions: Vec<[f32; 3]> =
        mesh.positions.iter().map(|&position| to_world(start + turn * Vec3::from(position)).to_array()).collect();
    let shot = Mesh { positions, triangles: mesh.triangles };
    let extra = (SurfaceThickness::World(THICKNESS), SweptCollision);
    let shot = scene.add(&shot, material, extra);
    let center = to_world(start);
    let positions = scene.positions(shot).to_vec();
    for (velocity_of, position) in scene.body_mut(shot).velocities.iter_mut().zip(positions) {
        let own = if is_driven { Vec3::ZERO } else { velocity };
        *velocity_of = own + (place.turn.as_quat() * spin).cross(position - center);
    }
    let pose = |tick: usize| {
        // A driven target stops when it is past where the shot has been.
        let moved = if is_driven { velocity * (TICK as f32 * tick.min(4) as f32) } else { Vec3::ZERO };
        Transform::from_translation(place.offset.as_vec3() - moved).with_rotation(place.turn.as_quat())
    };
    let target = match body {
        Body::Rigid(shape) => scene.app.world_mut().spawn((RigidShape(shape), pose(0))).id(),
        Body::Surface(mesh) => scene.add_obstacle(&mesh, (SurfaceThickness::World(THICKNESS), pose(0))),
    };
    let (mut wrong, mut behind) = (Wrong::default(), 0);
    for tick in 0..TICKS {
        let transform = pose(tick);
        if is_driven {
            scene.app.world_mut().entity_mut(target).insert(transform);
        }
        scene.tick(TICK);
        let now = Place { offset: transform.translation.as_dvec3(), ..place };
        let own: Vec<DVec3> = doubles(scene.positions(shot)).into_iter().map(|position| now.to_own(position)).collect();
        let not_finite = own.iter().filter(|position| !position.is_finite()).count();
        wrong.not_finite = wrong.not_finite.max(not_finite);
        if not_finite > 0 {
            break;
        }
        wrong.inside = wrong.inside.max(own.iter().filter(|&&position| truth.is_inside(position)).count());
        let start = start.as_dvec3();
        let mean = own.iter().sum::<DVec3>() / own.len() as f64;
        let is_behind = if kind == "sheet" {
            // Its corners may go around the target, but not more than half of it.
            2 * own.iter().filter(|&&position| truth.is_between(start, position)).count() > own.len()
        } else {
            truth.is_between(start, mean)
        };
        // A soft body that is dented by an edge has its middle inside for a tick or two, and comes back.
        behind = if is_behind { behind + 1 } else { 0 };
        wrong.has_passed |= behind >= TICKS_BEHIND;
    }
    let driven = if is_driven { "driven " } else { "" };
    (format!("shot {number}: {kind} at {driven}{name}, {speed:.1} thicknesses a tick"), wrong)
}

#[test]
fn no_shot_passes() {
    let alone = std::env::var(SHOT_VARIABLE).ok().map(|number| number.parse().expect("the number of a shot"));
    let count = std::env::var(SHOTS_VARIABLE).map_or(SHOTS, |count| count.parse().expect("a number of shots"));
    let numbers = alone.map_or(0..count, |number| number..number + 1);
    let (mut passed, mut inside, mut not_finite, mut panicked) = (0, 0, 0, 0);
    let mut wrong_of = [0; TARGETS.len()];
    let mut lines = Vec::new();
    for number in numbers.clone() {
        let Ok((what, wrong)) = catch_unwind(AssertUnwindSafe(|| shoot(number))) else {
            panicked += 1;
            lines.push(format!("shot {number} panicked"));
            continue;
        };
        passed += usize::from(wrong.has_passed);
        inside += usize::from(wrong.inside > 0);
        not_finite += usize::from(wrong.not_finite > 0);
        if wrong != Wrong::default() {
            wrong_of[(number % TARGETS.len() as u64) as usize] += 1;
            lines.push(format!("{what}: {wrong:?}"));
        }
    }
    let shots = numbers.end - numbers.start;
    println!(
        "{shots} shots: {passed} passed, {inside} have vertices inside, {not_finite} not finite, {panicked} panics"
    );
    for (name, wrong) in TARGETS.iter().zip(wrong_of) {
        println!("{name:<16}{wrong} wrong");
    }
    lines.truncate(40);
    assert!(lines.is_empty(), "{}", lines.join("\n"));
}

/// The reference detects a passing shot: without a target's layers, everything that hits goes through.
#[test]
fn shots_that_nothing_stops_are_seen_to_pass() {
    for name in TARGETS {
        let (_, truth) = target(name);
        let [above, below] = [DVec3::new(0.05, 1.0, 0.03), DVec3::new(0.05, -1.0, 0.03)];
        assert!(truth.is_between(above, below), "{name}");
        assert!(!truth.is_between(above, above + DVec3::X), "{name}");
    }
}
