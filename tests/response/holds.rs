//! Typical objects of games hold cloth: floors of every kind of shape, and driven bodies.
//!
//! Cloth falls on floors at several tick rates and resolutions, with default settings and thickness. The finest cloths
//! take minutes on a slow machine: `cargo test --test response -- holds --ignored` runs them.

use bevy_circumsphere::{SurfaceDetection, prelude::*, response::*};
use bevy_ecs::prelude::*;
use bevy_transform::components::Transform;
use circumsphere_support::scenes::{Diagonals, Mesh, cuboid, grid};
use glam::{DVec3, Quat, Vec3};
use parry3d::{math::Pose, utils::Array2};

use crate::{
    harness::{Scene, ticks_in},
    truth::{crosses_on_its_way, doubles, point_triangle},
};

/// Ticks per second.
pub const RATES: [f64; 3] = [30.0, 60.0, 120.0];

/// The lowest height allowed below a floor, in meters: less than the visible thickness of cloth.
const LOWEST: f32 = -0.005;

/// How high cloth falls, in meters, and how long it is watched, in seconds. A fall of 1.5 m takes 0.7 s.
const DROPS: [(f32, f64); 2] = [(0.05, 2.0), (1.5, 2.5)];

/// Half the width of floors, in meters. Cloth of 1 m stays above them.
const HALF: f32 = 1.5;

/// A floor whose upper side is at y = 0.
#[derive(Clone, Copy, Debug)]
enum Floor {
    TrimeshGrid,
    TrimeshGridFacingDown,
    Heightfield,
    BoxTrimesh,
    ThinCuboid,
    ThickCuboid,
    Hull,
    HalfSpace,
    Compound,
    RoundedCuboid,
    Cylinder,
    Surface,
}

fn vectors(mesh: &Mesh) -> Vec<Vec3> {
    mesh.positions.iter().map(|&position| Vec3::from(position)).collect()
}

fn trimesh(mesh: &Mesh) -> SharedShape {
    SharedShape::trimesh(vectors(mesh), mesh.triangles.clone()).expect("the mesh has triangles")
}

/// Floors are not rotated relative to the cloth's mesh, so edges lie above edges. This is the hardest case.
fn ground(cells: usize) -> Mesh {
    grid(cells, cells, 2.0 * HALF, 2.0 * HALF, Diagonals::Alternating)
}

impl Floor {
    fn spawn(self, scene: &mut Scene) {
        let (shape, height) = match self {
            Self::TrimeshGrid => (trimesh(&ground(12)), 0.0),
            Self::TrimeshGridFacingDown => {
                let mut mesh = ground(12);
                mesh.triangles.iter_mut().for_each(|corners| corners.swap(0, 1));
                (trimesh(&mesh), 0.0)
            }
            Self::Heightfield => {
                let heights = Array2::new(13, 13, vec![0.0; 169]);
                (SharedShape::heightfield(heights, Vec3::new(2.0 * HALF, 1.0, 2.0 * HALF)), 0.0)
            }
            Self::BoxTrimesh => (trimesh(&cuboid([HALF, 0.5, HALF], 4)), -0.5),
            Self::ThinCuboid => (SharedShape::cuboid(HALF, 0.02, HALF), -0.02),
            Self::ThickCuboid => (SharedShape::cuboid(HALF, 0.5, HALF), -0.5),
            Self::Hull => {
                let corners = [Vec3::X, Vec3::Z, Vec3::NEG_X, Vec3::NEG_Z];
                let upper = corners.map(|corner| corner * (1.5 * HALF));
                let lower = corners.map(|corner| corner * HALF - Vec3::Y);
                let points: Vec<Vec3> = upper.into_iter().chain(lower).collect();
                (SharedShape::convex_hull(&points).expect("a block is convex"), 0.0)
            }
            Self::HalfSpace => (SharedShape::halfspace(Vec3::Y), 0.0),
            Self::Compound => {
                let half = SharedShape::cuboid(0.5 * HALF, 0.25, HALF);
                let at = |x: f32| Pose::from_translation(Vec3::new(x, 0.0, 0.0));
                (SharedShape::compound(vec![(at(-0.5 * HALF), half.clone()), (at(0.5 * HALF), half)]), -0.25)
            }
            Self::RoundedCuboid => (SharedShape::round_cuboid(HALF, 0.1, HALF, 0.02), -0.12),
            Self::Cylinder => (SharedShape::cylinder(0.1, HALF), -0.1),
            Self::Surface => {
                scene.add_obstacle(&ground(12), ());
                return;
            }
        };
        scene.app.world_mut().spawn((RigidShape(shape), Transform::from_xyz(0.0, height, 0.0)));
    }
}

/// Drops cloth at every rate and from every height, and panics with all failures if one drop does not hold.
fn holds(floor: Floor, cells: usize) {
    let mut failures = Vec::new();
    for rate in RATES {
        for (drop, seconds) in DROPS {
            let mut scene = Scene::new();
            floor.spawn(&mut scene);
            let cloth = grid(cells, cells, 1.0, 1.0, Diagonals::Alternating).translate([0.0, drop, 0.0]);
            let cloth = scene.add(&cloth, XpbdMaterial::CLOTH, SweptCollision);
            let (mut lowest, mut first) = (f32::INFINITY, None);
            for tick in 1..=ticks_in(seconds, rate) {
                scene.tick(1.0 / rate);
                let positions = scene.positions(cloth);
                let wrong = positions.iter().find(|position| !position.is_finite() || position.length() > 10.0);
                let now = positions.iter().map(|position| position.y).fold(f32::INFINITY, f32::min);
                lowest = lowest.min(now);
                if wrong.is_some() || now < LOWEST {
                    first.get_or_insert(tick);
                }
                if wrong.is_some() || now < -0.5 {
                    break;
                }
            }
            let highest = scene.positions(cloth).iter().map(|position| position.y).fold(f32::MIN, f32::max);
            if let Some(tick) = first {
                let after = tick as f64 / rate;
                failures.push(format!("{rate} Hz from {drop} m: down to {lowest:.4} m, first after {after:.3} s"));
            } else if highest > 0.5 {
                failures.push(format!("{rate} Hz from {drop} m: it has not come down and is at {highest} m"));
            }
        }
    }
    assert!(failures.is_empty(), "{floor:?}, {cells} cells a side:\n  {}", failures.join("\n  "));
}

macro_rules! floors {
    ($($name:ident: $floor:ident,)*) => {$(
        mod $name {
            use super::{Floor, holds};

            #[test]
            fn cloth_of_8_a_side_stays_above_it() {
                holds(Floor::$floor, 8);
            }

            #[test]
            fn cloth_of_20_a_side_stays_above_it() {
                holds(Floor::$floor, 20);
            }

            #[test]
            #[ignore = "takes a minute"]
            fn cloth_of_40_a_side_stays_above_it() {
                holds(Floor::$floor, 40);
            }
        }
    )*};
}

floors! {
    trimesh_grid: TrimeshGrid,
    trimesh_grid_facing_down: TrimeshGridFacingDown,
    heightfield: Heightfield,
    box_as_trimesh: BoxTrimesh,
    slab_of_4_cm: ThinCuboid,
    cuboid_of_1_m: ThickCuboid,
    convex_hull: Hull,
    half_space: HalfSpace,
    two_abutting_cuboids: Compound,
    rounded_cuboid: RoundedCuboid,
    cylinder: Cylinder,
    static_surface: Surface,
}

/// How deep a triangle of the flag may be inside the ball, in meters: a twenty-fifth of the smallest contact distance.
/// Pressed contacts keep their distance except for rounding, tick after tick, while the ball flies on for 18 m and
/// takes the flag along.
const ROUNDING: f64 = 1e-4;

/// Whether the ball stops, and how far it has then pushed the flag out of its plane, in meters.
#[derive(Clone, Copy, Debug)]
enum Flight {
    StopsAt(f32),
    GoesOn,
}

#[derive(Clone, Copy, Debug)]
enum Pinned {
    UpperCorners,
    UpperEdge,
}

/// The positions of the only surface at every detection of a tick.
#[derive(Resource, Default)]
struct PartStarts(Vec<Vec<DVec3>>);

fn note_part_start(surface: Single<&SurfacePositions>, mut starts: ResMut<PartStarts>) {
    starts.0.push(doubles(&surface.0));
}

/// Drives a ball at 30 m/s into a flag. Returns what went wrong.
fn ball_against_flag(rate: f64, cells: usize, pinned: Pinned, flight: Flight, aim: Vec3) -> Result<(), String> {
    const RADIUS: f32 = 0.15;
    const SPEED: f64 = 30.0;
    let mut scene = Scene::new();
    let flag = grid(cells, cells, 1.0, 1.0, Diagonals::Alternating)
        .rotate([1.0, 0.0, 0.0], std::f32::consts::FRAC_PI_2)
        .translate([0.0, 0.5, 0.0]);
    let upper: Vec<u32> =
        (0..).zip(&flag.positions).filter(|(_, at)| at[1] > 0.999).map(|(vertex, _)| vertex).collect();
    let pins: Vec<VertexId> = match pinned {
        Pinned::UpperEdge => upper.iter().map(|&vertex| VertexId(vertex)).collect(),
        Pinned::UpperCorners => [upper[0], upper[upper.len() - 1]].map(VertexId).to_vec(),
    };
    let flag = scene.add_changed(&flag, XpbdMaterial::CLOTH, |body| body.pinned(pins), SweptCollision);
    let start = aim + Vec3::new(0.0, 0.5, -1.03);
    let shape = RigidShape(SharedShape::ball(RADIUS));
    let ball = scene.app.world_mut().spawn((shape, Transform::from_translation(start))).id();
    let triangles = scene.app.world().get::<DeformableSurface>(flag).unwrap().topology().triangles().to_vec();
    // Records where the flag is at the start of each part of a tick.
    scene.app.init_resource::<PartStarts>().add_systems(SurfaceDetection, note_part_start);
    let mut last = start.as_dvec3();
    for tick in 0..ticks_in(0.6, rate) {
        // The ball stands still in the first tick, so that it has a pose from the tick before.
        let way = (tick as f64 / rate * SPEED) as f32;
        let way = if let Flight::StopsAt(depth) = flight { way.min(1.03 + depth) } else { way };
        let center = start + Vec3::Z * way;
        scene.app.world_mut().entity_mut(ball).insert(Transform::from_translation(center));
        scene.tick(1.0 / rate);
        let now = (center.as_dvec3(), doubles(scene.positions(flag)));
        let failed =
            |what: String| Err(format!("{rate} Hz, {cells} cells, {pinned:?}, {flight:?}, tick {tick}: {what}"));
        if now.1.iter().any(|position| !position.is_finite()) {
            return failed("not finite".into());
        }
        let inside = |position: &&DVec3| position.distance(now.0) < f64::from(RADIUS) - ROUNDING;
        let count = now.1.iter().filter(inside).count();
        if count > 0 {
            return failed(format!("{count} vertices inside"));
        }
        let corners = |triangle: &[u32; 3]| triangle.map(|corner| now.1[corner as usize]);
        let near = triangles.iter().map(|triangle| point_triangle(now.0, corners(triangle)));
        let nearest = near.fold(f64::INFINITY, f64::min);
        if nearest < f64::from(RADIUS) - ROUNDING {
            return failed(format!("a triangle is {nearest:.6} m from the center"));
        }
        let mut places = std::mem::take(&mut scene.app.world_mut().resource_mut::<PartStarts>().0);
        places.push(now.1);
        let parts = places.len() - 1;
        let center = |part: usize| last.lerp(now.0, part as f64 / parts as f64);
        let passes = (0..parts).any(|part| {
            triangles.iter().any(|triangle| {
                let ways = triangle.map(|corner| [part, part + 1].map(|part| places[part][corner as usize]));
                crosses_on_its_way([center(part), center(part + 1)], ways)
            })
        });
        if passes {
            return failed("the center goes through the flag".into());
        }
        last = now.0;
    }
    Ok(())
}

fn flags(flight: Flight) {
    let mut failures = Vec::new();
    for rate in RATES {
        for cells in [8, 20] {
            for pinned in [Pinned::UpperCorners, Pinned::UpperEdge] {
                for aim in [Vec3::ZERO, Vec3::new(0.21, -0.13, 0.0)] {
                    failures.extend(ball_against_flag(rate, cells, pinned, flight, aim).err());
                }
            }
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

#[test]
fn a_fast_ball_that_stops_has_the_flag_in_front_of_it() {
    flags(Flight::StopsAt(0.3));
}

#[test]
fn a_fast_ball_that_goes_on_takes_the_flag_along_or_to_the_side() {
    flags(Flight::GoesOn);
}

/// A platform rises through the place where cloth lies, faster than cloth falls.
#[test]
fn a_platform_that_rises_and_sinks_carries_its_cloth() {
    let mut failures = Vec::new();
    for rate in RATES {
        for shape in [SharedShape::cuboid(1.0, 0.05, 1.0), trimesh(&cuboid([1.0, 0.05, 1.0], 4))] {
            for turned in [false, true] {
                let mut scene = Scene::new();
                let kind = format!("{:?}", shape.shape_type());
                let platform = scene.app.world_mut().spawn(RigidShape(shape.clone())).id();
                let cloth = grid(10, 10, 0.6, 0.6, Diagonals::Alternating).translate([0.0, 0.08, 0.0]);
                let cloth = scene.add(&cloth, XpbdMaterial::CLOTH, SweptCollision);
                let mut deepest = f32::MIN;
                for tick in 0..ticks_in(2.0, rate) {
                    let time = tick as f64 / rate;
                    // Up to 5 m/s.
                    let height = (0.8 * (1.0 - (std::f64::consts::TAU * time).cos())) as f32;
                    let turn = if turned { Quat::from_rotation_y(2.0 * time as f32) } else { Quat::IDENTITY };
                    let pose = Transform::from_xyz(0.0, height, 0.0).with_rotation(turn);
                    scene.app.world_mut().entity_mut(platform).insert(pose);
                    scene.tick(1.0 / rate);
                    for &position in scene.positions(cloth) {
                        let own = turn.inverse() * (position - Vec3::Y * height);
                        let below = 0.05 - own.y;
                        let is_over = own.x.abs().max(own.z.abs()) < 1.0;
                        if !position.is_finite() {
                            deepest = f32::INFINITY;
                        } else if is_over {
                            deepest = deepest.max(below);
                        }
                    }
                }
                if deepest > -LOWEST {
                    failures.push(format!("{rate} Hz, {kind}, turning {turned}: {deepest:.4} m below the upper side"));
                }
            }
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

/// The pose of a shape is that of its entity in the world, including parents.
#[test]
fn a_floor_that_is_a_child_holds_as_well() {
    let mut failures = Vec::new();
    for rate in RATES {
        let mut scene = Scene::new();
        let parent = scene.app.world_mut().spawn(Transform::from_xyz(0.0, -3.0, 0.0)).id();
        let floor = (RigidShape(trimesh(&ground(6))), Transform::from_xyz(0.0, 3.0, 0.0), ChildOf(parent));
        scene.app.world_mut().spawn(floor);
        let cloth = grid(10, 10, 1.0, 1.0, Diagonals::Alternating).translate([0.0, 0.3, 0.0]);
        let cloth = scene.add(&cloth, XpbdMaterial::CLOTH, SweptCollision);
        let mut lowest = f32::INFINITY;
        for _ in 0..ticks_in(1.5, rate) {
            scene.tick(1.0 / rate);
            lowest = scene.positions(cloth).iter().map(|position| position.y).fold(lowest, f32::min);
        }
        if lowest < LOWEST {
            failures.push(format!("{rate} Hz: {lowest} m"));
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}
