//! Pairs of triangles in the recording have the fates that the stages' own functions give them.

use std::collections::{BTreeMap, BTreeSet};

use bevy_circumsphere::{
    ActiveSurfaces,
    debug::LevelOfDetail,
    detection::{CandidateTrianglePairs, OtherSide, PairFates},
    geometry::PairFate,
    prelude::*,
};
use bevy_ecs::{prelude::*, system::RunSystemOnce};
use glam::DVec3;

use crate::world::{Recorded, Scene, everything, near_contacts, nothing, world_corners};

/// Pairs of triangles by the path of their entity below `pairs`.
type Fates = BTreeMap<Vec<String>, Vec<[u32; 2]>>;

/// All pairs that have a fate: both sides, whether the second is a shape, and the triangles with their fates.
type Told = Vec<([Entity; 2], bool, Vec<([u32; 2], PairFate)>)>;

fn told(recorded: &mut Recorded) -> Told {
    let read = |fates: PairFates, candidates: Res<CandidateTrianglePairs>, active: Res<ActiveSurfaces>| -> Told {
        let of = |place: usize| {
            let pair = &candidates.pairs()[place];
            let mut found = Vec::new();
            fates.of(place, &mut found);
            assert!(found.len() >= pair.triangles.len());
            let (second, is_shape) = match pair.second {
                OtherSide::Surface(second) => (active.surfaces[second].entity, false),
                OtherSide::Shape(place) => (active.shapes[place].entity, true),
            };
            ([active.surfaces[pair.first].entity, second], is_shape, found)
        };
        (0..candidates.pairs().len()).map(of).collect()
    };
    recorded.app.world_mut().run_system_once(read).expect("fates can be read")
}

/// The pairs that are shown, sorted. Every line is compared with the triangles that it is drawn for.
fn shown(recorded: &Recorded, scene: &Scene) -> Fates {
    let world = recorded.app.world();
    let entity = |name: &str| {
        let all = [scene.crumpled, scene.ball, scene.sheet, scene.floor, scene.rod];
        all.into_iter().find(|&entity| scene.name(entity) == name).unwrap_or_else(|| panic!("nothing is named {name}"))
    };
    let mut fates = Fates::new();
    for (path, components) in recorded.viewer.below(&["pairs"]) {
        let firsts = components.wholes("triangle_a");
        let seconds = components.wholes("triangle_b");
        let lines = components.strips();
        assert_eq!((firsts.len(), lines.len()), (seconds.len(), seconds.len()));
        let (first, second) = path[1].split_once(" with ").expect("a pair is named after both sides");
        let (first, second) = (entity(first), if second == "itself" { entity(first) } else { entity(second) });
        let mut pairs = Vec::new();
        for ((a, b), line) in firsts.into_iter().zip(seconds).zip(lines) {
            let center = |corners: [DVec3; 3]| corners.iter().sum::<DVec3>() / 3.0;
            let expected = if world.get::<RigidShape>(second).is_some() {
                let corners = world_corners(world, first, a);
                vec![corners[0], corners[1], corners[2], corners[0]]
            } else {
                vec![center(world_corners(world, first, a)), center(world_corners(world, second, b))]
            };
            assert_eq!(line.len(), expected.len());
            for (found, expected) in line.into_iter().zip(expected) {
                // Rounded once to f32, with coordinates within 2.
                let apart = glam::Vec3::from_array(found).as_dvec3().distance(expected);
                assert!(apart < 4.0 * f64::from(f32::EPSILON), "{found:?} is not {expected}");
            }
            pairs.push([a, b]);
        }
        pairs.sort_unstable();
        fates.insert(path, pairs);
    }
    fates
}

fn sorted(mut fates: Fates) -> Fates {
    for pairs in fates.values_mut() {
        pairs.sort_unstable();
    }
    fates
}

#[test]
fn all_pairs_are_recorded_by_their_fate() {
    let mut found_fates = BTreeSet::new();
    for method in ContactMethod::ALL {
        let settings = bevy_circumsphere::debug::RerunSettings { pairs: LevelOfDetail::All, ..nothing() };
        let mut recorded = Recorded::new(settings);
        let scene = Scene::spawn(&mut recorded.app, method);
        let mut count = 0;
        for tick in 0..3 {
            scene.advance(&mut recorded.app, tick);
            recorded.tick();
            let mut expected = Fates::new();
            for (sides, _, triangles) in told(&mut recorded) {
                for (triangles, fate) in triangles {
                    let path = vec![fate.name().to_owned(), scene.pair_name(sides[0], sides[1])];
                    expected.entry(path).or_default().push(triangles);
                    found_fates.insert(fate);
                    count += 1;
                }
            }
            assert_eq!(shown(&recorded, &scene), sorted(expected), "{method:?} at {tick}");
        }
        assert!(count > 1000, "{method:?}: {count} pairs");
    }
    // The broad phase leaves neighbors out.
    let all: BTreeSet<PairFate> =
        PairFate::ALL.into_iter().filter(|fate| !matches!(fate, PairFate::Neighbors | PairFate::Remembered)).collect();
    assert_eq!(found_fates, all);
}

#[test]
fn near_contacts_pairs_of_two_such_triangles_are_recorded_that_no_plane_parts() {
    let mut far_of_all = 0;
    for method in ContactMethod::ALL {
        let mut recorded =
            Recorded::new(bevy_circumsphere::debug::RerunSettings { pairs: LevelOfDetail::NearContacts, ..nothing() });
        let scene = Scene::spawn(&mut recorded.app, method);
        let (mut kept, mut far, mut parted) = (0, 0, 0);
        for tick in 0..3 {
            scene.advance(&mut recorded.app, tick);
            recorded.tick();
            let near: BTreeMap<Entity, BTreeSet<u32>> = scene
                .surfaces()
                .map(|(_, entity)| (entity, near_contacts(&mut recorded.app, entity)))
                .into_iter()
                .collect();
            let mut expected = Fates::new();
            for (sides, is_shape, triangles) in told(&mut recorded) {
                for ([a, b], fate) in triangles {
                    if !near[&sides[0]].contains(&a) || !is_shape && !near[&sides[1]].contains(&b) {
                        far += 1;
                    } else if fate == PairFate::Planes {
                        parted += 1;
                    } else {
                        let path = vec![fate.name().to_owned(), scene.pair_name(sides[0], sides[1])];
                        expected.entry(path).or_default().push([a, b]);
                        kept += 1;
                    }
                }
            }
            assert_eq!(shown(&recorded, &scene), sorted(expected), "{method:?} at {tick}");
        }
        let has_planes = !matches!(method, ContactMethod::BoundingSphere | ContactMethod::Polygon);
        assert!(kept > 300, "{method:?}: {kept} kept");
        far_of_all += far;
        assert!(!has_planes || parted > 100, "{method:?}: {parted} parted");
    }
    assert!(far_of_all > 20, "{far_of_all} pairs are far from any contact");
}

#[test]
fn every_fate_has_a_color_of_its_own_among_those_of_its_method() {
    for method in ContactMethod::ALL {
        let mut recorded = Recorded::new(everything());
        let scene = Scene::spawn(&mut recorded.app, method);
        scene.advance(&mut recorded.app, 0);
        recorded.tick();
        let mut colors: BTreeMap<String, BTreeSet<u32>> = BTreeMap::new();
        for (path, components) in recorded.viewer.below(&["pairs"]) {
            colors.entry(path[0].clone()).or_default().extend(components.wholes("LineStrips3D:colors"));
        }
        assert!(colors.len() >= 2, "{method:?}: {colors:?}");
        assert!(colors.values().all(|colors| colors.len() == 1), "{method:?}: {colors:?}");
        assert_eq!(colors.values().flatten().collect::<BTreeSet<_>>().len(), colors.len(), "{method:?}: {colors:x?}");
    }
}
