//! Invariance under numbering, order, common motion, and the unit of length.

use crate::strategies::{Turn, offset, turn};
use crate::{
    agreement::{Case, case},
    harness::{BAND, Body, Count, Found, ROUNDING, Setup, SmallWorld, between, for_all, points},
};
use bevy_circumsphere::prelude::*;
use bevy_transform::components::Transform;
use circumsphere_support::scenes::Mesh;
use circumsphere_truth::triangle_distance;
use glam::{DVec3, Quat, Vec3};
use proptest::prelude::*;
use std::collections::BTreeMap;

const SIDES: [[usize; 2]; 3] = [[0, 0], [0, 1], [1, 1]];

fn detect(bodies: &[Body], distance: f32, setup: Setup) -> Vec<Found> {
    SmallWorld::new(bodies, distance, setup).tick()
}

/// Triangles of a pair and their distance. Within one surface, the lower triangle comes first.
type Pairs = BTreeMap<(u32, u32), f64>;

fn pairs(found: &[Found], sides: [usize; 2]) -> Pairs {
    between(found, sides).iter().map(|pair| ((pair.triangle_a, pair.triangle_b), pair.distance)).collect()
}

/// Panics if a pair touches in only one of the two worlds although its distance is not within `band` of the contact
/// distance. Returns the number of touching pairs.
#[track_caller]
fn assert_same(rest: &[Mesh; 2], sides: [usize; 2], distance: f64, band: f64, one: &Pairs, other: &Pairs) -> usize {
    let corners = |side: usize, triangle: u32| -> [DVec3; 3] {
        let mesh = &rest[sides[side]];
        mesh.triangles[triangle as usize].map(|vertex| Vec3::from_array(mesh.positions[vertex as usize]).as_dvec3())
    };
    for (&(a, b), found) in one.iter().chain(other) {
        let (first, second) = (corners(0, a), corners(1, b));
        let extent = first.iter().chain(&second).map(|corner| corner.distance(first[0])).fold(0.0, f64::max);
        let slack = band + ROUNDING * extent;
        if let (Some(own), Some(found)) = (one.get(&(a, b)), other.get(&(a, b))) {
            // Twice, because both may have this error.
            assert!((own - found).abs() <= 2.0 * slack, "{a} and {b} are {own} or {found} apart");
        } else {
            let truth = triangle_distance(&first, &second);
            assert!(
                (truth - distance).abs() <= slack,
                "{a} and {b} are {truth} apart and touch in one world only, at {found}, within {distance}"
            );
        }
    }
    one.len()
}

/// The numbers from 0 to `count`, in the order given by a list of priorities.
fn order(count: usize, priorities: &[u16]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by_key(|&place| (priorities[place % priorities.len()], place % 3));
    order
}

#[test]
fn touching_pairs_do_not_depend_on_the_numbers_of_triangles_vertices_and_corners() {
    let compared = Count::default();
    let priorities = || prop::collection::vec(any::<u16>(), 50..60);
    for_all(file!(), 400, (case(), priorities(), priorities(), 0usize..3), |(case, first, second, turned)| {
        let renumbered = |mesh: &Mesh| {
            let vertices = order(mesh.positions.len(), &first);
            let triangles = order(mesh.triangles.len(), &second);
            let mut numbers = vec![0; vertices.len()];
            for (number, &vertex) in vertices.iter().enumerate() {
                numbers[vertex] = number as u32;
            }
            let corners = |triangle: usize| {
                let [a, b, c] = mesh.triangles[triangle].map(|vertex| numbers[vertex as usize]);
                [[a, b, c], [b, c, a], [c, a, b]][(turned + triangle) % 3]
            };
            let mesh = Mesh {
                positions: vertices.iter().map(|&vertex| mesh.positions[vertex]).collect(),
                triangles: triangles.iter().map(|&triangle| corners(triangle)).collect(),
            };
            (mesh, triangles)
        };
        let [(mesh_a, triangles_a), (mesh_b, triangles_b)] = [renumbered(&case.rest[0]), renumbered(&case.rest[1])];
        let back = [triangles_a, triangles_b];
        let plain = detect(&case.bodies(), case.distance, Setup::REFINED);
        let found = detect(&[Body::new(&mesh_a), Body::new(&mesh_b)], case.distance, Setup::REFINED);
        for sides in SIDES {
            let named: Pairs = pairs(&found, sides)
                .into_iter()
                .map(|((a, b), distance)| {
                    let (a, b) = (back[sides[0]][a as usize] as u32, back[sides[1]][b as usize] as u32);
                    (if sides[0] == sides[1] { (a.min(b), a.max(b)) } else { (a, b) }, distance)
                })
                .collect();
            compared.add(assert_same(&case.rest, sides, f64::from(case.distance), 0.0, &pairs(&plain, sides), &named));
        }
    });
    compared.assert_at_least(100_000, "pairs");
}

#[test]
fn touching_pairs_do_not_depend_on_which_surface_comes_first() {
    let compared = Count::default();
    for_all(file!(), 400, case(), |case| {
        let plain = detect(&case.bodies(), case.distance, Setup::REFINED);
        let bodies: Vec<Body> = case.bodies().into_iter().rev().collect();
        let found = detect(&bodies, case.distance, Setup::REFINED);
        for sides in SIDES {
            let named: Pairs = if sides == [0, 1] {
                pairs(&found, sides).into_iter().map(|((a, b), distance)| ((b, a), distance)).collect()
            } else {
                pairs(&found, sides.map(|side| 1 - side))
            };
            let one = pairs(&plain, sides);
            compared.add(assert_same(&case.rest, sides, f64::from(case.distance), 0.0, &one, &named));
        }
    });
    compared.assert_at_least(100_000, "pairs");
}

/// A pose of rotation and translation as the transform of an entity.
fn pose(turn: Turn, offset: [f32; 3], scale: f32) -> Transform {
    let axis = Vec3::from_array(turn.axis).as_dvec3().normalize();
    let rotation = glam::DQuat::from_axis_angle(axis, f64::from(turn.angle)).as_quat();
    Transform { translation: Vec3::from_array(offset) * scale, rotation: Quat::normalize(rotation), scale: Vec3::ONE }
}

#[test]
fn a_common_pose_changes_no_pair() {
    let compared = Count::default();
    let case = (case(), turn(), offset(1000.0));
    for_all(file!(), 300, case, |(case, turn, offset)| {
        let size = case.rest[0].positions.iter().flatten().fold(f32::MIN_POSITIVE, |most, x| most.max(x.abs()));
        let mut bodies = case.bodies();
        let plain = detect(&bodies, case.distance, Setup::REFINED);
        for body in &mut bodies {
            body.transform = pose(turn, offset, size);
        }
        let found = detect(&bodies, case.distance, Setup::REFINED);
        // The scale of a rotation is 1, apart from the rounding of its f64 coefficients.
        for sides in SIDES {
            let (one, other) = (pairs(&plain, sides), pairs(&found, sides));
            let band = 1.0e-12 * f64::from(case.distance);
            compared.add(assert_same(&case.rest, sides, f64::from(case.distance), band, &one, &other));
        }
    });
    compared.assert_at_least(100_000, "pairs");
}

#[test]
fn a_rigid_motion_of_all_vertices_changes_pairs_within_the_band_only() {
    let compared = Count::default();
    let case = (case(), turn(), offset(2.0));
    for_all(file!(), 400, case, |(case, turn, offset)| {
        let size = |meshes: &[Mesh; 2]| {
            meshes.iter().flat_map(|mesh| &mesh.positions).flatten().fold(0.0f32, |most, x| most.max(x.abs()))
        };
        let largest = size(&case.rest);
        let moved = case.rest.clone().map(|mesh| turn.apply(mesh).translate(offset.map(|x| x * largest)));
        // Four roundings of a coordinate in the rotation and one in the translation, on either side. The rotation is
        // also only accurate to the rounding of its nine coefficients.
        let ulps = 16.0 * f64::from(f32::EPSILON) * f64::from(size(&moved).max(largest));
        let plain = detect(&case.bodies(), case.distance, Setup::REFINED);
        let bodies: Vec<Body> = case
            .bodies()
            .into_iter()
            .zip(&moved)
            .map(|(body, mesh)| Body { positions: points(mesh), ..body })
            .collect();
        // Welded at rest, because rounding may bring separate vertices together.
        let mut world = SmallWorld::new(&case.bodies(), case.distance, Setup::REFINED);
        for (place, body) in bodies.iter().enumerate() {
            world.write(place, &body.positions);
        }
        let found = world.tick();
        for sides in SIDES {
            let (one, other) = (pairs(&plain, sides), pairs(&found, sides));
            let band = BAND * f64::from(case.distance) + ulps;
            compared.add(assert_same(&case.rest, sides, f64::from(case.distance), band, &one, &other));
        }
    });
    compared.assert_at_least(100_000, "pairs");
}

/// Below this length, the squares of edges and of shorter lengths in their triangles leave the normal range of f32. The
/// sphere methods then use f64, with different rounding.
const SHORTEST_EXACT: f64 = 1.0e-14;

/// Among edges with a length.
fn shortest_edge(meshes: &[Mesh; 2]) -> f64 {
    let lengths = meshes.iter().flat_map(|mesh| {
        let corner = |vertex: u32| Vec3::from_array(mesh.positions[vertex as usize]).as_dvec3();
        mesh.triangles.iter().flat_map(move |&[a, b, c]| {
            [corner(a).distance(corner(b)), corner(b).distance(corner(c)), corner(c).distance(corner(a))]
        })
    });
    lengths.filter(|&length| length > 0.0).fold(f64::INFINITY, f64::min)
}

#[test]
fn scaling_by_a_power_of_two_scales_every_number_exactly() {
    let (compared, judged, differing) = (Count::default(), Count::default(), Count::default());
    for_all(file!(), 300, (case(), 111u32..144), |(case, exponent): (Case, u32)| {
        // From 2^-16 to 2^16.
        let factor = f32::from_bits(exponent << 23);
        let scaled = case.rest.clone().map(|mesh| mesh.scale(factor));
        let shortest = shortest_edge(&case.rest).min(shortest_edge(&scaled));
        for setup in Setup::methods() {
            if setup.method < ContactMethod::Exact && shortest < SHORTEST_EXACT {
                continue;
            }
            let plain = detect(&case.bodies(), case.distance, setup);
            let bodies: Vec<Body> = scaled.iter().map(Body::new).collect();
            let found = detect(&bodies, case.distance * factor, setup);
            let expected: Vec<Found> = plain
                .into_iter()
                .map(|mut found| {
                    for pair in &mut found.touching {
                        pair.distance *= f64::from(factor);
                    }
                    for contact in &mut found.contacts {
                        contact.point_b *= factor;
                        contact.distance *= factor;
                    }
                    found
                })
                .collect();
            compared.add(expected.iter().map(|found| found.contacts.len()).sum());
            if setup.method == ContactMethod::Circumsphere {
                // Not exact yet: the f32 normal of a triangle without area is noise, and along it the cull may separate
                // a pair that the f64 slabs do not. For a small mesh, the normal is too short for the cull to use.
                judged.add(1);
                differing.add(usize::from(found != expected));
                continue;
            }
            if setup.method == ContactMethod::Closest {
                // Where squares of areas leave single precision, it chooses differently among features that are equally
                // close.
                let named = |found: &[Found]| SIDES.map(|sides| pairs(found, sides).into_keys().collect::<Vec<_>>());
                assert_eq!(named(&found), named(&expected), "{setup:?} times {factor}");
                continue;
            }
            assert!(found == expected, "{setup:?} times {factor}: {}", first_difference(&found, &expected));
        }
    });
    compared.assert_at_least(500_000, "contacts");
    judged.assert_at_least(100, "worlds of caps");
    println!("{} of {} worlds of caps differ", differing.get(), judged.get());
    // One of 600 random cases differed. At most one in a hundred may.
    assert!(100 * differing.get() <= judged.get().max(100), "{} worlds of caps differ", differing.get());
}

fn first_difference(found: &[Found], expected: &[Found]) -> String {
    let lines = |found: &[Found]| -> Vec<String> {
        found
            .iter()
            .flat_map(|Found { sides, touching, contacts }| {
                let touching = touching.iter().map(move |pair| format!("{sides:?} {pair:?}"));
                touching.chain(contacts.iter().map(move |contact| format!("{sides:?} {contact:?}")))
            })
            .collect()
    };
    let (found, expected) = (lines(found), lines(expected));
    let place =
        found.iter().zip(&expected).position(|(one, other)| one != other).unwrap_or(found.len().min(expected.len()));
    format!("{:?} is not {:?}", found.get(place), expected.get(place))
}
