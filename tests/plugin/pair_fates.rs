//! Why two triangles do not touch: the reported fate is the step at which the stages dropped the pair.

use std::collections::{BTreeMap, BTreeSet};

use bevy_app::prelude::*;
use bevy_circumsphere::{
    ActiveSurfaces, Circumspheres, ContactStore, EnclosingBalls, TriangleCones,
    detection::{
        CandidateTrianglePairs, DetectionDiagnostics, MeetingCaps, OtherSide, OverlappingTrianglePairs, PairFates,
        SurfacePair,
    },
    geometry::PairFate,
    prelude::*,
};
use bevy_ecs::{prelude::*, system::RunSystemOnce};
use bevy_transform::components::Transform;
use circumsphere_support::scenes::{Diagonals, grid, icosphere};
use circumsphere_truth::triangle_distance;
use glam::{DVec3, Quat, Vec3};

use crate::{
    methods::{app_with_brute_force, mixed_scene},
    world::{Called, THIN, app, at, insert, place, sheet, spawn, world_matrix},
};

/// The band, relative to the contact distance, in which rounding may decide either way. Distances come from f32
/// positions and f32 poses of unit size. Tests of the exact methods use the same band.
const BAND: f64 = 1.0e-4;

/// The fates of every pair of bodies, by the names of the bodies and the numbers of the two triangles.
type Named = BTreeMap<(&'static str, &'static str, [u32; 2]), PairFate>;

/// Counts of the fates of a detection.
#[derive(Default)]
struct Tally {
    /// The number of pairs with each fate, by method.
    counts: BTreeMap<(ContactMethod, PairFate), usize>,
    /// Pairs that touch according to the reference, by the fate that they had instead.
    missed: BTreeMap<(ContactMethod, PairFate), usize>,
    /// The length of the longest list of candidates.
    longest: usize,
}

/// The fates of the triangle pairs of two bodies.
type Fates = Vec<([u32; 2], PairFate)>;

/// The fates of the triangles of every pair of bodies.
fn all_fates(app: &mut App) -> Vec<Fates> {
    let read = |fates: PairFates, candidates: Res<CandidateTrianglePairs>| -> Vec<Fates> {
        let of = |place: usize| {
            let mut found = vec![([7, 7], PairFate::Cone); 3];
            fates.of(place, &mut found);
            found
        };
        (0..candidates.pairs().len()).map(of).collect()
    };
    app.world_mut().run_system_once(read).expect("fates can be read")
}

/// The pairs that were not dropped before `step`.
fn from_step(fates: &[([u32; 2], PairFate)], step: PairFate) -> Vec<[u32; 2]> {
    fates.iter().filter(|&&(_, fate)| fate >= step).map(|&(triangles, _)| triangles).collect()
}

fn entities(active: &ActiveSurfaces, pair: &SurfacePair) -> [Entity; 2] {
    let second = match pair.second {
        OtherSide::Surface(second) => active.surfaces[second].entity,
        OtherSide::Shape(place) => active.shapes[place].entity,
    };
    [active.surfaces[pair.first].entity, second]
}

/// The corners of every triangle of a surface in the world, in f64.
fn world_corners(world: &World, entity: Entity) -> Vec<[DVec3; 3]> {
    let matrix = world_matrix(world, entity);
    let positions = &world.get::<SurfacePositions>(entity).expect("the entity is a surface").0;
    let triangles = world.get::<DeformableSurface>(entity).expect("the entity is a surface").topology().triangles();
    let corner = |vertex: u32| matrix.transform_point3(positions[vertex as usize].as_dvec3());
    triangles.iter().map(|triangle| triangle.map(corner)).collect()
}

/// The steps at which a pair can be dropped.
fn steps(pair: &SurfacePair, plane_cull: bool) -> &'static [PairFate] {
    use PairFate::{CenterLine, Cone, Distance, Planes, Spheres, Touching};
    match pair.method {
        _ if matches!(pair.second, OtherSide::Shape(_)) => &[Distance, Touching],
        ContactMethod::BoundingSphere => &[Spheres, Distance, Touching],
        ContactMethod::Circumsphere if plane_cull => &[Planes, Spheres, CenterLine, Cone, Distance, Touching],
        ContactMethod::Circumsphere => &[Spheres, Cone, Distance, Touching],
        ContactMethod::Closest | ContactMethod::Exact => &[Planes, Distance, Touching],
        ContactMethod::Polygon => &[Distance, Touching],
    }
}

/// The gap of two triangles along a direction. It is negative if they overlap or there is no direction.
fn gap_along(direction: DVec3, a: &[DVec3; 3], b: &[DVec3; 3]) -> f64 {
    let direction = direction.normalize_or_zero();
    let [a, b] = [a, b].map(|corners| corners.map(|corner| direction.dot(corner - a[0])));
    let (low_a, high_a) = (a[0].min(a[1]).min(a[2]), a[0].max(a[1]).max(a[2]));
    let (low_b, high_b) = (b[0].min(b[1]).min(b[2]), b[0].max(b[1]).max(b[2]));
    (low_b - high_a).max(low_a - high_b)
}

fn gap_along_normals(a: &[DVec3; 3], b: &[DVec3; 3]) -> f64 {
    let normal = |corners: &[DVec3; 3]| (corners[1] - corners[0]).cross(corners[2] - corners[0]);
    gap_along(normal(a), a, b).max(gap_along(normal(b), a, b))
}

/// The world centers of the spheres that test a triangle, and their radius. `Circumsphere` has one on either side. Of
/// these, a sheet uses the one that faces the other triangle.
fn spheres(world: &World, entity: Entity, method: ContactMethod, triangle: u32) -> ([DVec3; 2], f64) {
    let (matrix, triangle) = (world_matrix(world, entity), triangle as usize);
    let entity = world.entity(entity);
    let (centers, radius) = if method == ContactMethod::BoundingSphere {
        let ball = entity.get::<EnclosingBalls>().expect("the entity is a surface")[triangle];
        ([ball.center; 2], ball.radius)
    } else {
        let spheres = &entity.get::<Circumspheres>().expect("the entity is a surface");
        let axis = entity.get::<TriangleCones>().expect("the entity is a surface").axes[triangle];
        let (center, height) = (spheres.centers[triangle], spheres.heights[triangle]);
        ([center, center + 2.0 * height * axis], spheres.radii[triangle])
    };
    let scale = matrix.transform_vector3(DVec3::X).length();
    (centers.map(|center| matrix.transform_point3(center.as_dvec3())), f64::from(radius) * scale)
}

/// Asserts in f64 that the step that dropped a pair of triangles had a reason, and that the planes had none before it.
#[track_caller]
fn assert_reason(
    world: &World,
    pair: &SurfacePair,
    ends: [(Entity, u32); 2],
    corners: [&[DVec3; 3]; 2],
    fate: PairFate,
) {
    let range = f64::from(pair.range);
    // Rounding to f32, and the slack that the culls leave for it.
    let slack = BAND * range + 1.0e-5 * corners[0][0].distance(corners[1][0]).max(1.0);
    let [a, b] = corners;
    let planes = gap_along_normals(a, b);
    let what = (pair.method, ends, fate);
    match fate {
        PairFate::Planes => {
            // An exact method may use any direction, and the widest gap is the distance.
            let slabs = if pair.method.is_exact() { triangle_distance(a, b) } else { planes };
            assert!(slabs > range - slack, "{what:?}: the slabs leave {slabs}");
        }
        // This step follows the planes. Without them, their gap means nothing.
        PairFate::CenterLine => assert!(planes < range + slack, "{what:?}: the planes leave {planes}"),
        _ => {}
    }
    if !matches!(fate, PairFate::Spheres | PairFate::CenterLine) {
        return;
    }
    let [(centers_a, radius_a), (centers_b, radius_b)] =
        ends.map(|(entity, triangle)| spheres(world, entity, pair.method, triangle));
    let mut lines = centers_a.into_iter().flat_map(|from| centers_b.map(|to| to - from));
    let apart = |line: DVec3| line.length() - radius_a - radius_b;
    let has_reason = lines.any(|line| match fate {
        PairFate::Spheres => apart(line) > range - slack,
        _ => apart(line) < range + slack && gap_along(line, a, b) > range - slack,
    });
    assert!(has_reason, "{what:?}");
}

/// Compares the fates of the last detection with the output of every stage and with the distances in f64.
fn judge(app: &mut App, tally: &mut Tally) -> Named {
    let found = all_fates(app);
    let world = app.world();
    let (active, store) = (world.resource::<ActiveSurfaces>(), world.resource::<ContactStore>());
    let candidates = &world.resource::<CandidateTrianglePairs>().pairs();
    let overlapping = &world.resource::<OverlappingTrianglePairs>().pairs();
    let meeting = &world.resource::<MeetingCaps>().pairs();
    let plane_cull = world.resource::<CircumsphereSettings>().plane_cull;
    let name = |entity: Entity| world.get::<Called>(entity).expect("the entity has a name").0;
    let (mut named, mut examined) = (Named::new(), 0);
    for (place, (pair, fates)) in candidates.iter().zip(&found).enumerate() {
        let [first, second] = entities(active, pair);
        let what = (name(first), name(second), pair.method);
        let (of_candidates, of_others) = fates.split_at(pair.triangles.len());
        assert!(of_candidates.iter().map(|(triangles, _)| triangles).eq(&pair.triangles), "{what:?}");
        assert!(of_others.iter().all(|&(_, fate)| fate == PairFate::Planes), "{what:?}");
        tally.longest = tally.longest.max(of_candidates.len());
        let touching: BTreeSet<[u32; 2]> = from_step(fates, PairFate::Touching).into_iter().collect();
        let stored = store.pairs().iter().find(|stored| [stored.a.entity(), stored.b.entity()] == [first, second]);
        let stored = stored.map_or(&[][..], |stored| &stored.touching[..]);
        assert_eq!(touching, stored.iter().map(|pair| [pair.triangle_a, pair.triangle_b]).collect(), "{what:?}");
        match pair.method {
            ContactMethod::BoundingSphere => {
                assert_eq!(from_step(fates, PairFate::CenterLine), *overlapping[place], "{what:?}");
            }
            ContactMethod::Circumsphere => {
                assert_eq!(from_step(fates, PairFate::Cone), *overlapping[place], "{what:?}");
                assert_eq!(from_step(fates, PairFate::Distance), *meeting[place], "{what:?}");
            }
            ContactMethod::Closest | ContactMethod::Exact | ContactMethod::Polygon => {
                examined += from_step(fates, PairFate::Distance).len();
            }
        }
        let corners = match pair.second {
            OtherSide::Surface(_) => Some([world_corners(world, first), world_corners(world, second)]),
            OtherSide::Shape(_) => None,
        };
        let contact_distance = f64::from(pair.contact_distance);
        for &([a, b], fate) in fates {
            assert!(steps(pair, plane_cull).contains(&fate), "{what:?}: {fate:?} is not one of its steps");
            *tally.counts.entry((pair.method, fate)).or_default() += 1;
            let again = named.insert((what.0, what.1, [a, b]), fate);
            assert_eq!(again, None, "{what:?}: {a} and {b} have two fates");
            let Some([corners_a, corners_b]) = &corners else { continue };
            let corners = [&corners_a[a as usize], &corners_b[b as usize]];
            assert_reason(world, pair, [(first, a), (second, b)], corners, fate);
            let distance = triangle_distance(corners[0], corners[1]);
            if fate != PairFate::Touching && distance <= contact_distance * (1.0 - BAND) {
                *tally.missed.entry((pair.method, fate)).or_default() += 1;
            }
            if pair.method.is_exact() && fate == PairFate::Touching {
                assert!(distance <= contact_distance * (1.0 + BAND), "{what:?}: {a} and {b} are {distance} apart");
            }
        }
    }
    assert_eq!(examined, world.resource::<DetectionDiagnostics>().pairs_examined);
    named
}

/// Everything in [`mixed_scene`], and two sheets that cross it and each other. One of them is wavy.
fn scene(app: &mut App, method: ContactMethod) {
    mixed_scene(app, method);
    let mut wavy = grid(12, 12, 1.8, 1.8, Diagonals::Alternating);
    for [x, y, z] in &mut wavy.positions {
        *y = 0.3 * (*x * *x - 0.5 * *z);
    }
    spawn(app, &wavy, (THIN, method, SelfCollision, Called("wavy sheet"), at(0.1, 0.03, 0.0)));
    let tilted = at(0.0, 0.1, 0.1).with_rotation(Quat::from_rotation_z(0.5));
    spawn(app, &sheet(), (THIN, method, Called("tilted sheet"), tilted));
}

fn move_everything(app: &mut App, tick: u8) {
    let mut moved = app.world_mut().query::<(&mut SurfacePositions, &mut Transform)>();
    for (mut positions, mut transform) in moved.iter_mut(app.world_mut()) {
        transform.rotation *= Quat::from_rotation_y(0.3);
        for position in &mut positions.0 {
            position.x *= 1.0 + 0.4 * f32::from(tick) * position.y;
        }
    }
}

#[test]
fn fates_are_what_every_stage_passed_on_and_the_truth_is_nearer_only_past_a_cone() {
    let (mut tally, mut parted_early) = (Tally::default(), 0);
    let mut settings = vec![CircumsphereSettings::default()];
    for plane_cull in [true, false] {
        for widen_cones in [true, false] {
            let margin = if widen_cones { 0.0 } else { 0.04 };
            settings.push(CircumsphereSettings {
                plane_cull,
                widen_cones,
                margin,
                sphere_offset: 1.0,
                ..Default::default()
            });
        }
    }
    for settings in settings {
        for method in ContactMethod::ALL {
            let [mut tree, mut brute_force] = [app(), app_with_brute_force()];
            let found = [&mut tree, &mut brute_force].map(|app| {
                app.insert_resource(settings);
                scene(app, method);
                (0..3)
                    .map(|tick| {
                        move_everything(app, tick);
                        app.update();
                        judge(app, &mut tally)
                    })
                    .collect::<Vec<_>>()
            });
            let [by_tree, by_brute_force] = &found;
            assert!(by_tree.iter().all(|fates| fates.len() > 10_000), "{method:?}: too few candidates");
            // Both give the same fates to the same pairs, except for pairs that only the tree drops before they are
            // measured.
            for (by_tree, by_brute_force) in by_tree.iter().zip(by_brute_force) {
                assert!(by_tree.keys().eq(by_brute_force.keys()), "{method:?}, {settings:?}: the pairs differ");
                for (pair, (by_tree, by_brute_force)) in
                    by_tree.iter().zip(by_brute_force.values()).map(|((pair, fate), other)| (pair, (*fate, *other)))
                {
                    let is_parted_early =
                        method.is_exact() && (by_tree, by_brute_force) == (PairFate::Planes, PairFate::Distance);
                    assert!(
                        by_tree == by_brute_force || is_parted_early,
                        "{method:?}, {settings:?}, {pair:?}: {by_tree:?}, {by_brute_force:?}"
                    );
                    parted_early += usize::from(is_parted_early);
                }
            }
        }
    }
    println!("{:#?}\nmissed: {:#?}, parted early: {parted_early}", tally.counts, tally.missed);
    assert!(parted_early > 1000);
    // No check is vacuous: every step of every method has dropped pairs. Exceptions are neighbors, which are tested
    // below, and remembered pairs, which do not occur while everything rotates (see `slow`).
    let is_elsewhere = |fate: &PairFate| matches!(fate, PairFate::Neighbors | PairFate::Remembered);
    for fate in PairFate::ALL.into_iter().filter(|fate| !is_elsewhere(fate)) {
        let count: usize = tally.counts.iter().filter(|((_, other), _)| *other == fate).map(|(_, count)| count).sum();
        assert!(count > 100, "{}: {count}", fate.name());
    }
    // Every step except the cone proves that the pairs it drops are apart. The pairs that the cone misses show up here.
    let steps_that_miss: Vec<_> = tally.missed.keys().copied().collect();
    assert_eq!(steps_that_miss, [(ContactMethod::Circumsphere, PairFate::Cone)]);
    assert!(tally.missed[&steps_that_miss[0]] > 100, "{:?}", tally.missed);
}

#[test]
fn long_lists_of_candidates_keep_their_order_on_several_threads() {
    let mut tally = Tally::default();
    for method in ContactMethod::ALL {
        let found = [1, 4].map(|threads| {
            let mut app = app();
            bevy_tasks::ComputeTaskPool::get_or_init(|| {
                bevy_tasks::TaskPoolBuilder::new().num_threads(crate::world::POOL_THREADS).build()
            });
            app.insert_resource(CircumsphereSettings { threads, ..Default::default() });
            spawn(&mut app, &icosphere(3, 1.0), (THIN, method, Called("first")));
            spawn(&mut app, &icosphere(3, 1.0), (THIN, method, Called("second"), at(0.4, 0.3, 0.1)));
            app.update();
            judge(&mut app, &mut tally)
        });
        assert!(found[0] == found[1], "{method:?}");
    }
    // More than the stages hand out at a time.
    assert!(tally.longest > 2 * 4096, "{}", tally.longest);
}

fn between(app: &mut App, a: (Entity, u32), b: (Entity, u32)) -> Option<PairFate> {
    let read = move |fates: PairFates| fates.between((a.0, TriangleId(a.1)), (b.0, TriangleId(b.1)));
    app.world_mut().run_system_once(read).expect("fates can be read")
}

#[test]
fn two_triangles_tell_why_they_do_not_touch() {
    let mut app = app();
    let one = icosphere(0, 0.5);
    let other = spawn(&mut app, &one, (THIN, ContactMethod::Circumsphere, SelfCollision, at(0.9, 0.0, 0.0)));
    let ball = spawn(&mut app, &one, (THIN, ContactMethod::Circumsphere, Transform::default()));
    let floor = app.world_mut().spawn((RigidShape(SharedShape::halfspace(Vec3::Y)), at(0.0, -0.5, 0.0))).id();
    app.update();
    let count = one.triangles.len() as u32;
    let listed = all_fates(&mut app);
    let candidates = app.world().resource::<CandidateTrianglePairs>().pairs();
    let mut seen = BTreeSet::new();
    let mut expected = BTreeMap::new();
    for (pair, fates) in candidates.iter().zip(&listed) {
        let [first, second] = entities(app.world().resource::<ActiveSurfaces>(), pair);
        for &([a, b], fate) in fates {
            expected.insert(((first, a), (second, b)), fate);
            seen.insert(fate);
        }
    }
    for a in 0..count {
        for b in 0..count {
            for pair in [((ball, a), (other, b)), ((other, a), (other, b)), ((ball, a), (floor, b))] {
                let swapped = (pair.1, pair.0);
                let corners = [a, b].map(|triangle| one.triangles[triangle as usize]);
                let are_neighbors = a != b && corners[0].iter().any(|vertex| corners[1].contains(vertex));
                let fate = match expected.get(&pair).or_else(|| expected.get(&swapped)) {
                    None if pair.0.0 == pair.1.0 && are_neighbors => Some(PairFate::Neighbors),
                    fate => fate.copied(),
                };
                assert_eq!(between(&mut app, pair.0, pair.1), fate, "{pair:?}");
                assert_eq!(between(&mut app, pair.1, pair.0), fate, "{swapped:?}");
            }
        }
    }
    assert!(seen.len() >= 3 && seen.contains(&PairFate::Touching), "{seen:?}");
    assert!(expected.len() > 20 && expected.len() < 1000, "{}", expected.len());
    // Not paired at all: no such triangle, no such body, or out of reach.
    assert_eq!(between(&mut app, (ball, count), (other, 0)), None);
    assert_eq!(between(&mut app, (ball, 0), (Entity::PLACEHOLDER, 0)), None);
    place(&mut app, ball, Vec3::new(0.0, 9.0, 0.0));
    app.update();
    for (a, b) in expected.keys().filter(|(a, b)| a.0 != b.0 && [a.0, b.0].contains(&ball)) {
        assert_eq!(between(&mut app, *a, *b), None);
    }
}

#[test]
fn fates_are_those_of_the_last_detection_and_what_has_gone_has_none() {
    for method in ContactMethod::ALL {
        let [mut shrunken, mut gone, mut unplugged] = [(); 3].map(|()| {
            let mut app = app();
            let first = spawn(&mut app, &icosphere(1, 0.5), (THIN, method));
            let second = spawn(&mut app, &icosphere(1, 0.5), (THIN, method, at(0.9, 0.1, 0.0)));
            app.update();
            let fates = all_fates(&mut app);
            assert!(fates.len() == 1 && !from_step(&fates[0], PairFate::Touching).is_empty(), "{method:?}: {fates:?}");
            (app, first, second)
        });
        let detected = all_fates(&mut gone.0);
        let nothing = vec![Vec::new()];
        shrunken.0.world_mut().get_mut::<SurfacePositions>(shrunken.2).expect("the entity is a surface").0.pop();
        assert_eq!(all_fates(&mut shrunken.0), detected, "{method:?}");
        gone.0.world_mut().despawn(gone.1);
        assert_eq!(all_fates(&mut gone.0), nothing, "{method:?}");
        assert_eq!(between(&mut gone.0, (gone.1, 0), (gone.2, 0)), None, "{method:?}");
        // A new mesh that the next detection has not seen yet.
        let smaller = crate::world::surface(&icosphere(0, 0.5));
        insert(&mut unplugged.0, unplugged.2, smaller);
        assert_eq!(all_fates(&mut unplugged.0), detected, "{method:?}");
    }
}

#[test]
fn names_are_short_words_and_no_two_alike() {
    let names: BTreeSet<&str> = PairFate::ALL.iter().map(|fate| fate.name()).collect();
    assert_eq!(names.len(), PairFate::ALL.len());
    assert!(PairFate::ALL.is_sorted());
    assert!(names.iter().all(|name| name.chars().all(|letter| letter.is_ascii_lowercase() || letter == ' ')));
}
