//! Sweeps of whole meshes against single pairs, the certified times of the reference, and closed forms.

use bevy_circumsphere::kernel::{
    ccd::{
        ImpactCause, ImpactList, MovingSide, PairImpact, Sweep, SweepBuffers, SweepLeaves, SweepTree, SweptMesh,
        TreeWork, drift, first_impacts, outward_box, sort_impacts, sweep,
    },
    mesh::topology::SurfaceTopology,
    simd::parallel::Sequential,
};
use circumsphere_truth::{ImpactTruth, MovingMesh, triangle_distance, triangle_impacts_tree};
use glam::{DQuat, DVec3, Vec3};

use crate::common::Random;

/// Half of the distance at which the meshes of these tests touch.
const THICKNESS: f64 = 0.01;

pub(super) struct Body {
    pub(super) topology: SurfaceTopology,
    pub(super) start: Vec<DVec3>,
    pub(super) end: Vec<DVec3>,
}

impl Body {
    pub(super) fn new(start: Vec<DVec3>, triangles: &[[u32; 3]]) -> Self {
        let narrow: Vec<Vec3> = start.iter().map(|position| position.as_vec3()).collect();
        let topology = SurfaceTopology::new(&narrow, triangles).expect("the mesh is valid");
        Self { topology, end: start.clone(), start }
    }

    pub(super) fn mesh(&self) -> SweptMesh<'_> {
        let (start, end) = (&self.start[..], &self.end[..]);
        SweptMesh { topology: &self.topology, start, end, drift: DVec3::ZERO, reach: THICKNESS }
    }

    pub(super) fn count(&self) -> u32 {
        self.topology.triangles().len() as u32
    }

    pub(super) fn move_each(&mut self, mut motion: impl FnMut(DVec3) -> DVec3) {
        self.end = self.start.iter().map(|&position| position + motion(position)).collect();
    }

    pub(super) fn translate(&mut self, offset: DVec3) {
        self.start.iter_mut().chain(&mut self.end).for_each(|position| *position += offset);
    }
}

/// A wavy sheet of `side`² vertices over a unit square centered at the origin.
pub(super) fn sheet(side: u32, waves: f64) -> Body {
    let place = |k: u32| f64::from(k) / f64::from(side - 1) - 0.5;
    let at = |x: f64, y: f64| DVec3::new(x, y, 0.05 * waves * ((7.0 * x).sin() + (5.0 * y).cos()));
    let positions = (0..side * side).map(|k| at(place(k % side), place(k / side))).collect();
    let triangles: Vec<[u32; 3]> = (0..(side - 1) * (side - 1))
        .map(|k| k / (side - 1) * side + k % (side - 1))
        .flat_map(|k| [[k, k + 1, k + side], [k + 1, k + side + 1, k + side]])
        .collect();
    Body::new(positions, &triangles)
}

/// Triangles of many sizes at random places that share no vertices.
pub(super) fn soup(random: &mut Random, count: u32) -> Body {
    let positions = (0..count).flat_map(|_| {
        let (middle, size) = (random.vector(), random.power_of_ten(-2.0, -0.3));
        [0; 3].map(|_| middle * 0.5 + random.vector() * size)
    });
    let positions = positions.collect();
    Body::new(positions, &(0..count).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect::<Vec<_>>())
}

/// Which of two meshes have a tree.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Trees {
    None,
    First,
    Second,
    Both,
}

pub(super) fn tree_of(mesh: &SweptMesh<'_>, with_tree: bool) -> SweepTree {
    let mut tree = SweepTree::default();
    tree.update(mesh);
    if with_tree {
        assert_eq!(tree.update_tree(), TreeWork::Built);
    }
    tree
}

fn swept(a: &SweptMesh<'_>, b: &SweptMesh<'_>, trees: Trees, separation: f64) -> Vec<PairImpact> {
    let tree_a = tree_of(a, matches!(trees, Trees::First | Trees::Both));
    let tree_b = tree_of(b, matches!(trees, Trees::Second | Trees::Both));
    let mut impacts = Vec::new();
    sweep(a, &tree_a, b, &tree_b, false, separation, &mut SweepBuffers::default(), &mut impacts);
    impacts
}

fn swept_self(mesh: &SweptMesh<'_>, with_tree: bool) -> Vec<PairImpact> {
    let tree = tree_of(mesh, with_tree);
    let mut impacts = Vec::new();
    sweep(mesh, &tree, mesh, &tree, true, 0.0, &mut SweepBuffers::default(), &mut impacts);
    impacts
}

fn is_fast(mesh: &SweptMesh<'_>, triangle: u32) -> bool {
    let corners = mesh.topology.triangles()[triangle as usize];
    corners.iter().any(|&corner| mesh.end[corner as usize].distance(mesh.start[corner as usize]) > mesh.reach)
}

/// Tests every pair alone and returns the impacts with a fast triangle, and the others.
fn one_by_one(a: &SweptMesh<'_>, b: &SweptMesh<'_>, same: bool, separation: f64) -> [Vec<PairImpact>; 2] {
    let side = |mesh: &SweptMesh<'_>| (mesh.topology.triangles().len() as u32, mesh.start.to_vec(), mesh.end.to_vec());
    let ((count_a, start_a, end_a), (count_b, start_b, end_b)) = (side(a), side(b));
    let candidates: Vec<[u32; 2]> = (0..count_a)
        .flat_map(|first| (if same { first + 1 } else { 0 }..count_b).map(move |second| [first, second]))
        .collect();
    let mut impacts = Vec::new();
    first_impacts(
        &MovingSide { topology: a.topology, start: &start_a, end: &end_a },
        &MovingSide { topology: b.topology, start: &start_b, end: &end_b },
        same,
        &candidates,
        separation,
        &mut impacts,
    );
    let (fast, slow) =
        impacts.into_iter().partition(|found| is_fast(a, found.triangle_a) || is_fast(b, found.triangle_b));
    [fast, slow]
}

/// Two nearby meshes. The first, the second, or both move by up to `speed`.
pub(super) fn pair(random: &mut Random, speed: f64, movers: [bool; 2], is_soup: bool) -> [Body; 2] {
    let mut bodies = if is_soup { [soup(random, 30), soup(random, 45)] } else { [sheet(5, 1.0), sheet(7, -1.0)] };
    bodies[0].translate(random.vector() * 0.3 + DVec3::Z * 0.1);
    for (body, moves) in bodies.iter_mut().zip(movers) {
        if moves {
            let (turn, shift) =
                (DQuat::from_axis_angle(random.direction(), random.range(0.0, 2.0)), random.direction());
            body.move_each(|position| {
                let turned = (turn * position - position) * speed.min(1.0);
                (shift + random.vector() * 0.2) * speed + turned * random.unit()
            });
        }
    }
    bodies
}

#[test]
fn a_sweep_finds_what_every_pair_tested_alone_does() {
    let mut random = Random::new(71);
    for thicknesses in [0.1, 1.0, 10.0, 100.0, 1000.0] {
        let (mut found, mut slow, mut pairs) = (0, 0, 0);
        for round in 0..12 {
            for movers in [[true, false], [false, true], [true, true]] {
                let [a, b] = pair(&mut random, thicknesses * THICKNESS, movers, round % 2 == 0);
                let separation = if round % 3 == 0 { 0.02 } else { 0.0 };
                let [expected, others] = one_by_one(&a.mesh(), &b.mesh(), false, separation);
                for trees in [Trees::None, Trees::First, Trees::Second, Trees::Both] {
                    let what = (thicknesses, round, movers, trees);
                    assert_eq!(swept(&a.mesh(), &b.mesh(), trees, separation), expected, "{what:?}");
                    let swapped: Vec<[u32; 2]> = swept(&b.mesh(), &a.mesh(), trees, separation)
                        .iter()
                        .map(|found| [found.triangle_b, found.triangle_a])
                        .collect();
                    let names: Vec<[u32; 2]> =
                        expected.iter().map(|found| [found.triangle_a, found.triangle_b]).collect();
                    assert!(
                        names.iter().all(|name| swapped.contains(name)) && names.len() == swapped.len(),
                        "{what:?}"
                    );
                }
                found += expected.len();
                slow += others.len();
                pairs += a.count() as usize * b.count() as usize;
            }
        }
        println!("{thicknesses} thicknesses: {found} impacts of fast pairs, {slow} of others, {pairs} pairs");
        assert!(if thicknesses < 1.0 { found == 0 && slow > 20 } else { found > 200 }, "{found} {slow}");
    }
}

#[test]
fn a_surface_swept_against_itself_finds_what_every_pair_tested_alone_does() {
    let mut random = Random::new(72);
    let mut partly = 0;
    for thicknesses in [0.1, 1.0, 10.0, 100.0, 1000.0] {
        let mut found = 0;
        for round in 0..8 {
            let mut body = if round % 2 == 0 { soup(&mut random, 60) } else { sheet(9, 2.0) };
            // In every other mesh, one half stays still.
            let rests = round % 4 < 2;
            body.move_each(|position| {
                if rests && position.x < 0.2 { DVec3::ZERO } else { random.vector() * (thicknesses * THICKNESS) }
            });
            let mesh = body.mesh();
            let [expected, _] = one_by_one(&mesh, &mesh, true, 0.0);
            for with_tree in [false, true] {
                assert_eq!(swept_self(&mesh, with_tree), expected, "{thicknesses} {round} {with_tree}");
            }
            assert!(expected.iter().all(|found| found.triangle_a < found.triangle_b));
            found += expected.len();
            partly += expected
                .iter()
                .filter(|found| is_fast(&mesh, found.triangle_a) != is_fast(&mesh, found.triangle_b))
                .count();
        }
        println!("{thicknesses} thicknesses: {found} impacts");
        assert!(thicknesses < 10.0 || found > 100, "{found}");
    }
    println!("{partly} impacts of a fast triangle with a slow one");
    assert!(partly > 50, "{partly}");
}

/// Both meshes as one. The vertex numbers of the second are shifted.
fn merged(a: &Body, b: &Body) -> (Vec<DVec3>, Vec<DVec3>, Vec<[u32; 3]>, Vec<u32>) {
    let join = |a: &[DVec3], b: &[DVec3]| [a, b].concat();
    let shift = a.start.len() as u32;
    let shifted = b.topology.triangles().iter().map(|corners| corners.map(|corner| corner + shift));
    let triangles = a.topology.triangles().iter().copied().chain(shifted).collect();
    let weld = (0..shift + b.start.len() as u32).collect();
    (join(&a.start, &b.start), join(&a.end, &b.end), triangles, weld)
}

#[test]
fn no_certified_impact_of_fast_meshes_is_missed_or_called_late() {
    let mut random = Random::new(73);
    let (mut compared, mut never) = (0, 0);
    for round in 0..30 {
        let speed = THICKNESS * [3.0, 30.0, 300.0][round % 3];
        let [a, b] = pair(&mut random, speed, [true, round % 4 == 0], round % 2 == 0);
        let (start, end, triangles, weld) = merged(&a, &b);
        let truth = MovingMesh { start: &start, end: &end, triangles: &triangles, weld: &weld };
        let found = swept(&a.mesh(), &b.mesh(), Trees::Second, 0.0);
        let time_of = |first: u32, second: u32| {
            let place = found.binary_search_by_key(&(first, second), |found| (found.triangle_a, found.triangle_b));
            place.ok().map(|place| found[place].impact.time)
        };
        let mut certified = 0;
        for impact in triangle_impacts_tree(&truth, 0.0) {
            let (first, second) = (impact.triangle_a, impact.triangle_b);
            if first >= a.count() || second < a.count() {
                continue;
            }
            let second = second - a.count();
            if !(is_fast(&a.mesh(), first) || is_fast(&b.mesh(), second)) {
                continue;
            }
            certified += 1;
            if let ImpactTruth::First { latest, .. } = impact.truth {
                let time = time_of(first, second);
                assert!(time.is_some_and(|time| time <= latest), "{round}: {first} {second}: {time:?}, {latest}");
                compared += 1;
            }
        }
        // The reference certifies that all other pairs stay apart. A sweep may report those that pass within its
        // resolution.
        never += found.len().saturating_sub(certified);
    }
    println!("{compared} certified impacts, {never} others called");
    assert!(compared > 1000 && never == 0, "{compared} {never}");
}

/// For each triangle, slightly less than half the distance at the start of the step to the nearest triangle that shares
/// no vertex with it.
pub(super) fn half_distances(own: &SweptMesh<'_>, other: &SweptMesh<'_>, same: bool) -> Vec<f64> {
    let corners = |mesh: &SweptMesh<'_>, triangle: u32| mesh.topology.triangles()[triangle as usize];
    let count = |mesh: &SweptMesh<'_>| mesh.topology.triangles().len() as u32;
    let half_distance = |triangle: u32| {
        let is_apart = |second: &u32| {
            !same || !corners(own, triangle).iter().any(|corner| corners(other, *second).contains(corner))
        };
        let distance = |second: u32| triangle_distance(&own.triangle(triangle).start, &other.triangle(second).start);
        (0..count(other)).filter(is_apart).map(distance).fold(f64::INFINITY, f64::min) * 0.49
    };
    (0..count(own)).map(half_distance).collect()
}

#[test]
fn what_is_left_out_for_how_far_apart_it_begins_does_not_meet() {
    let mut random = Random::new(77);
    let (mut found, mut left_out, mut asked_for) = (0, 0, 0);
    for round in 0..24 {
        let same = round % 3 == 0;
        let [mut a, mut b] = pair(&mut random, 0.0, [false, false], round % 2 == 0);
        // All vertices share a large motion, and each has a small one of its own.
        let (common, aside) = (random.direction() * 0.5, [0.01, 0.05][round % 4 / 2]);
        for body in [&mut a, &mut b] {
            body.move_each(|_| common + random.vector() * aside);
        }
        let (a, b) = (a.mesh(), if same { a.mesh() } else { b.mesh() });
        // Each mesh in the frame of its positions, or in one of its own.
        let drifting = |mesh: &SweptMesh<'_>, share: f64| drift(mesh.start, mesh.end) * share;
        let shares = [[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.5, -1.0]][round % 4];
        let (a, b) =
            (SweptMesh { drift: drifting(&a, shares[0]), ..a }, SweptMesh { drift: drifting(&b, shares[1]), ..b });
        let b = if same { a } else { b };
        let swept_of = |reaches: [&[f64]; 2], asked: [&dyn Fn(usize) -> bool; 2]| {
            let mut trees = [SweepTree::default(), SweepTree::default()];
            for (((tree, mesh), reaches), asked) in trees.iter_mut().zip([&a, &b]).zip(reaches).zip(asked) {
                tree.update_with_reaches(mesh, reaches);
                tree.update_tree();
                tree.ask_only(asked);
            }
            let mut impacts = Vec::new();
            let [tree_a, tree_b] = &trees;
            let tree_b = if same { tree_a } else { tree_b };
            sweep(&a, tree_a, &b, tree_b, same, 0.0, &mut SweepBuffers::default(), &mut impacts);
            impacts
        };
        let swept = |reaches_a: &[f64], reaches_b: &[f64]| swept_of([reaches_a, reaches_b], [&|_| true; 2]);
        let mut expected = one_by_one(&a, &b, same, 0.0).concat();
        sort_impacts(&mut expected);
        let (reaches_a, reaches_b) = (half_distances(&a, &b, same), half_distances(&b, &a, same));
        assert_eq!(swept(&reaches_a, &reaches_b), expected, "{round}");
        let unknown = |reaches: &[f64]| vec![f64::NEG_INFINITY; reaches.len()];
        assert_eq!(swept(&unknown(&reaches_a), &unknown(&reaches_b)), expected, "{round}: with unknown distances");
        // Pairs are found if either triangle is asked about, however slow that one is.
        let asked: [&dyn Fn(usize) -> bool; 2] = if same {
            [&|triangle| triangle % 3 == 0; 2]
        } else {
            [&|triangle| triangle % 3 == 0, &|triangle| triangle % 5 == 0]
        };
        let is_asked = |found: &&PairImpact| asked[0](found.triangle_a as usize) || asked[1](found.triangle_b as usize);
        let some: Vec<PairImpact> = expected.iter().filter(is_asked).copied().collect();
        assert_eq!(swept_of([&reaches_a, &reaches_b], asked), some, "{round}: of those that are asked about");
        assert_eq!(swept_of([&reaches_a, &reaches_b], [&|_| false; 2]), [], "{round}");
        asked_for += some.len();
        // Distances that are too large hide impacts, which proves that they are used.
        let too_much = |reaches: &[f64]| vec![0.4; reaches.len()];
        left_out += expected.len() - swept(&too_much(&reaches_a), &too_much(&reaches_b)).len();
        found += expected.len();
    }
    println!("{found} impacts, {left_out} hidden by false claims, {asked_for} asked about");
    assert!(found > 200 && left_out > 100, "{found} {left_out}");
    assert!(asked_for > found / 4 && asked_for < found * 3 / 4, "{asked_for} of {found}");
}

#[test]
fn what_slow_triangles_pass_through_touches_at_both_ends() {
    let mut random = Random::new(74);
    let mut passed = 0;
    for round in 0..40 {
        let (mut a, mut b) = (sheet(5, 0.0), sheet(7, 0.0));
        let turn = DQuat::from_axis_angle(random.direction(), random.range(0.0, 0.02));
        a.start.iter_mut().for_each(|position| *position = turn * *position + DVec3::Z * THICKNESS);
        a.move_each(|_| (random.vector() * 0.2 - DVec3::Z).normalize() * THICKNESS * 0.999);
        b.move_each(|_| (random.vector() * 0.2 + DVec3::Z).normalize() * THICKNESS * 0.999);
        let (a, b) = (a.mesh(), b.mesh());
        for slow in &one_by_one(&a, &b, false, 0.0)[1] {
            let (a, b) = (a.triangle(slow.triangle_a), b.triangle(slow.triangle_b));
            for (a, b) in [(a.start, b.start), (a.end, b.end)] {
                let distance = triangle_distance(&a, &b);
                assert!(distance <= 2.0 * THICKNESS, "{round}: {slow:?} is {distance} away");
            }
            passed += usize::from(slow.impact.cause == ImpactCause::Reached);
        }
    }
    assert!(passed > 50, "{passed} pairs are too few");
}

#[test]
fn a_common_motion_makes_nothing_fast_and_changes_no_impact() {
    let mut random = Random::new(75);
    let mut found = 0;
    for _ in 0..10 {
        let [mut a, b] = pair(&mut random, 20.0 * THICKNESS, [true, false], false);
        let resting = swept(&a.mesh(), &b.mesh(), Trees::Second, 0.0);
        // Both fall together by 100 times the motion of one of them.
        let fall = random.direction() * 20.0;
        a.end.iter_mut().for_each(|end| *end += fall);
        let falling = Body { end: b.start.iter().map(|start| *start + fall).collect(), ..b };
        let together = drift(&falling.start, &falling.end);
        // A sum of some fifty motions of 20, divided again.
        assert!(together.distance(fall) < 1.0e-12, "{together} {fall}");
        let along = |starts: &[DVec3]| starts.iter().map(|start| *start + together).collect::<Vec<_>>();
        let (start_a, start_b) = (along(&a.start), along(&falling.start));
        let (a, b) = (SweptMesh { start: &start_a, ..a.mesh() }, SweptMesh { start: &start_b, ..falling.mesh() });
        assert_eq!(tree_of(&b, false).fast_count(), 0);
        assert_eq!(tree_of(&falling.mesh(), false).fast_count(), falling.count() as usize);
        let moving = swept(&a, &b, Trees::Second, 0.0);
        assert_eq!(moving.len(), resting.len());
        for (moving, resting) in moving.iter().zip(&resting) {
            assert_eq!([moving.triangle_a, moving.triangle_b], [resting.triangle_a, resting.triangle_b]);
            // Coordinates of up to 20 rounded to f64, over a path of 0.2 that may pass at a small angle.
            assert!((moving.impact.time - resting.impact.time).abs() < 1.0e-10, "{moving:?} {resting:?}");
        }
        found += moving.len();
    }
    assert!(found > 200, "{found}");
    // Three of four vertices stay still.
    assert_eq!(drift(&[DVec3::ZERO; 4], &[DVec3::ZERO, DVec3::ZERO, DVec3::X, DVec3::ZERO]), DVec3::ZERO);
    assert_eq!(drift(&[], &[]), DVec3::ZERO);
    assert_eq!(drift(&[DVec3::ZERO, DVec3::ZERO], &[DVec3::X, DVec3::splat(f64::NAN)]), DVec3::ZERO);
    assert_eq!(drift(&[DVec3::ZERO], &[DVec3::splat(f64::INFINITY)]), DVec3::ZERO);
}

#[test]
fn parts_of_any_length_find_the_same() {
    let mut random = Random::new(76);
    for same in [false, true] {
        let [a, b] = pair(&mut random, if same { 3.0 } else { 0.5 }, [true, false], !same);
        let a = a.mesh();
        let b = if same { a } else { b.mesh() };
        let (tree_a, tree_b) = (tree_of(&a, same), tree_of(&b, true));
        let expected = if same { swept_self(&a, true) } else { swept(&a, &b, Trees::Second, 0.0) };
        assert!(expected.len() > 10);
        let sweep = Sweep {
            a: (a, &tree_a),
            b: (b, &tree_b),
            same_surface: same,
            list: ImpactList::Triangles,
            separation: 0.0,
        };
        let mut leaves = SweepLeaves::default();
        sweep.collect(&Sequential, &mut leaves);
        for length in [1, 3] {
            let (mut candidates, mut impacts) = (Vec::new(), Vec::new());
            for start in (0..leaves.len()).step_by(length).rev() {
                let part = start..(start + length).min(leaves.len());
                sweep.append_part(&leaves, part, &mut candidates, &mut impacts);
            }
            sort_impacts(&mut impacts);
            assert_eq!(impacts, expected);
        }
    }
}

#[test]
fn a_mesh_at_rest_keeps_its_tree_and_one_that_moves_is_followed() {
    let mut body = sheet(224, 1.0);
    assert!(body.count() > 99_000);
    let mut tree = SweepTree::default();
    let follow = |tree: &mut SweepTree, body: &Body| {
        tree.update(&body.mesh());
        tree.update_tree()
    };
    assert_eq!(follow(&mut tree, &body), TreeWork::Built);
    for _ in 0..3 {
        assert_eq!(follow(&mut tree, &body), TreeWork::Kept);
    }
    // Which triangles are fast may change without a change of any box.
    let impatient = SweptMesh { reach: -1.0, ..body.mesh() };
    tree.update(&impatient);
    assert_eq!((tree.fast_count(), tree.update_tree()), (body.count() as usize, TreeWork::Kept));
    let end = body.end.len() - 1;
    body.end[end].x += 0.001;
    assert_eq!(follow(&mut tree, &body), TreeWork::Refitted);
    assert_eq!(tree.fast_count(), 0);
    body.end[end].x += 0.1;
    assert_eq!(follow(&mut tree, &body), TreeWork::Refitted);
    assert_eq!(tree.fast_count(), 1, "the last corner belongs to one triangle");
    // The shuffled mesh has nothing in common with its tree.
    let mut random = Random::new(77);
    body.move_each(|_| random.vector());
    assert_eq!(follow(&mut tree, &body), TreeWork::Built);
    // Another mesh in the same place.
    assert_eq!(follow(&mut tree, &sheet(3, 1.0)), TreeWork::Built);
    assert_eq!(tree.boxes().len(), 8);
}

#[test]
fn meshes_without_fast_triangles_are_not_looked_at() {
    let (mut a, b) = (sheet(9, 1.0), sheet(9, -1.0));
    a.move_each(|_| DVec3::Z * (0.9 * THICKNESS));
    let trees = [tree_of(&a.mesh(), false), tree_of(&b.mesh(), false)];
    let mut impacts = Vec::new();
    let mut buffers = SweepBuffers::default();
    let mut count = |a: &SweptMesh<'_>, b: &SweptMesh<'_>, trees: &[SweepTree; 2]| {
        sweep(a, &trees[0], b, &trees[1], false, 0.0, &mut buffers, &mut impacts)
    };
    assert_eq!(count(&a.mesh(), &b.mesh(), &trees), 0);
    let endless = |body| SweptMesh { reach: f64::INFINITY, ..Body::mesh(body) };
    a.move_each(|_| DVec3::Z);
    let trees = [tree_of(&endless(&a), false), tree_of(&endless(&b), false)];
    assert_eq!(count(&endless(&a), &endless(&b), &trees), 0);
    let trees = [tree_of(&a.mesh(), false), tree_of(&endless(&b), false)];
    assert!(count(&a.mesh(), &endless(&b), &trees) > 100);
    assert!(!impacts.is_empty());
}

#[test]
fn boxes_hold_what_they_are_made_of_and_no_more_than_rounding() {
    let mut random = Random::new(78);
    for _ in 0..2000 {
        let points: [DVec3; 6] = [0; 6].map(|_| random.vector() * random.power_of_ten(-40.0, 9.0));
        let bounds = outward_box(points);
        for axis in 0..3 {
            let values = points.map(|point| point[axis]);
            let (low, high) = values.iter().fold((f64::MAX, f64::MIN), |(low, high), v| (low.min(*v), high.max(*v)));
            let (min, max) = (bounds.min[axis], bounds.max[axis]);
            assert!(f64::from(min) <= low && f64::from(min.next_up()) > low, "{min} {low}");
            assert!(f64::from(max) >= high && f64::from(max.next_down()) < high, "{max} {high}");
        }
    }
}

#[test]
fn coordinates_that_are_not_finite_meet_nothing_and_others_beyond_single_precision_meet() {
    let (mut a, b) = (sheet(4, 0.0), sheet(5, 0.0));
    a.translate(DVec3::new(0.01, 0.02, 0.3));
    a.move_each(|_| DVec3::Z * -0.6);
    let whole = swept(&a.mesh(), &b.mesh(), Trees::Second, 0.0);
    let (mut random, mut crumpled) = (Random::new(78), sheet(4, 0.0));
    crumpled.move_each(|_| random.vector() * 2.0);
    let of_one = swept_self(&crumpled.mesh(), true);
    let spoiled = 5;
    let has_spoiled =
        |body: &Body, triangle: u32| body.topology.triangles()[triangle as usize].contains(&(spoiled as u32));
    let spoiled_end = |body: &Body, value: f64| {
        let mut end = body.end.clone();
        end[spoiled].y = value;
        end
    };
    for value in [f64::NAN, f64::INFINITY] {
        let rest: Vec<PairImpact> = whole.iter().filter(|found| !has_spoiled(&a, found.triangle_a)).copied().collect();
        assert!(rest.len() < whole.len() && !rest.is_empty());
        let end = spoiled_end(&a, value);
        assert_eq!(swept(&SweptMesh { end: &end, ..a.mesh() }, &b.mesh(), Trees::Second, 0.0), rest);
        let is_left = |found: &&PairImpact| {
            ![found.triangle_a, found.triangle_b].iter().any(|&triangle| has_spoiled(&crumpled, triangle))
        };
        let rest: Vec<PairImpact> = of_one.iter().filter(is_left).copied().collect();
        assert!(rest.len() < of_one.len() && !rest.is_empty());
        let end = spoiled_end(&crumpled, value);
        assert_eq!(swept_self(&SweptMesh { end: &end, ..crumpled.mesh() }, true), rest);
    }
    // Scaling by a power of two changes no digits.
    let large =
        |positions: &[DVec3]| positions.iter().map(|position| *position * 2.0_f64.powi(200)).collect::<Vec<_>>();
    let (start, end, other) = (large(&a.start), large(&a.end), large(&b.start));
    let a = SweptMesh { start: &start, end: &end, ..a.mesh() };
    let b = SweptMesh { start: &other, end: &other, ..b.mesh() };
    let times = |impacts: &[PairImpact]| impacts.iter().map(|found| found.impact.time).collect::<Vec<_>>();
    assert_eq!(times(&swept(&a, &b, Trees::Second, 0.0)), times(&whole));
}

#[test]
fn a_flat_sheet_meets_another_at_the_time_of_the_closed_form() {
    for thicknesses in [1.5, 10.0, 100.0, 1000.0] {
        let (mut falling, resting) = (sheet(4, 0.0), sheet(6, 0.0));
        let (height, way) = (0.3 * thicknesses * THICKNESS, thicknesses * THICKNESS);
        falling.translate(DVec3::new(0.013, 0.017, height));
        falling.move_each(|_| DVec3::Z * -way);
        let found = swept(&falling.mesh(), &resting.mesh(), Trees::Second, 0.0);
        assert!(found.len() > 20, "{}", found.len());
        for found in &found {
            let time = found.impact.time;
            // 1e-12 is the kernel's resolution of 1.4e-14 times a size of 1, divided by the shortest path.
            assert!(time <= height / way && time > height / way - 1.0e-11, "{thicknesses}: {time}");
            assert!(found.impact.normal.distance(DVec3::NEG_Z) < 1.0e-9, "{:?}", found.impact);
            let point = |corners: [DVec3; 3], weights: [f64; 3]| -> DVec3 {
                corners.iter().zip(weights).map(|(corner, weight)| *corner * weight).sum()
            };
            let at = |mesh: &SweptMesh<'_>, triangle: u32| {
                let moving = mesh.triangle(triangle);
                std::array::from_fn(|k| moving.start[k].lerp(moving.end[k], time))
            };
            let point_a = point(at(&falling.mesh(), found.triangle_a), found.impact.barycentric_a);
            let point_b = point(at(&resting.mesh(), found.triangle_b), found.impact.barycentric_b);
            assert!(point_a.distance(point_b) < 1.0e-11, "{found:?}");
        }
    }
}
