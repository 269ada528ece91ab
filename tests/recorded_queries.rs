//! Recorded queries for continuous collision detection with exact answers. Needs the folder of recordings in the
//! environment variable `CIRCUMSPHERE_DATA`. Without it, the tests print a message and are skipped.

use std::{
    collections::HashMap,
    hint::black_box,
    path::{Path, PathBuf},
    time::Instant,
};

use bevy_circumsphere::{
    geometry::{Aabb, ImpactCause, SurfaceTopology, TriangleId},
    kernel::{
        bvh::tree::BoxTree,
        ccd::{FeatureImpact, MovingSide, PairImpact, edge_edge_impact, first_impacts, vertex_face_impact},
    },
};
use circumsphere_support::recording::{
    QueryKind, RecordedImpacts, read_ccd_queries, read_f64_recording, read_recorded_impacts, read_recording,
    recordings_folder,
};
use glam::{DVec3, Vec3};

/// The most pairs of triangles of one recording that are tested.
const MOST_PAIRS: usize = 100_000;

/// Two moving features, and whether they meet.
struct Query {
    start: [DVec3; 4],
    end: [DVec3; 4],
    collides: bool,
}

fn impact(kind: QueryKind, query: &Query) -> Option<FeatureImpact> {
    match kind {
        QueryKind::VertexFace => vertex_face_impact(&query.start, &query.end, 0.0),
        QueryKind::EdgeEdge => edge_edge_impact(&query.start, &query.end, 0.0),
    }
}

fn files(folder: &Path, ending: &str) -> Vec<PathBuf> {
    let mut paths: Vec<_> = std::fs::read_dir(folder)
        .expect("the folder of recordings can be listed")
        .map(|entry| entry.expect("its entries can be read").path())
        .filter(|path| path.file_name().is_some_and(|name| name.to_string_lossy().ends_with(ending)))
        .collect();
    paths.sort();
    paths
}

fn name(path: &Path) -> String {
    path.file_name().expect("a file has a name").to_string_lossy().into_owned()
}

/// The triangles of a recording and its first two frames, in double precision if available.
struct Step {
    triangles: Vec<[u32; 3]>,
    frames: [Vec<DVec3>; 2],
}

fn step(truth: &Path) -> Step {
    let stem = name(truth).split('.').next().expect("a name has a beginning").to_owned();
    let place = |ending: &str| truth.with_file_name(format!("{stem}{ending}"));
    let (triangles, frames): (_, Vec<Vec<DVec3>>) = if place(".f64.bin").exists() {
        let recording = read_f64_recording(&place(".f64.bin")).expect("the recording is valid");
        let wide = |frame: &Vec<[f64; 3]>| frame.iter().copied().map(DVec3::from_array).collect();
        (recording.triangles, recording.frames.iter().take(2).map(wide).collect())
    } else {
        let recording = read_recording(&[place(".bin")]).expect("the recording is valid");
        let wide = |frame: &Vec<[f32; 3]>| frame.iter().map(|point| Vec3::from_array(*point).as_dvec3()).collect();
        (recording.triangles, recording.frames.iter().take(2).map(wide).collect())
    };
    Step { triangles, frames: frames.try_into().expect("a step has two frames") }
}

fn queries_of(step: &Step, truth: &RecordedImpacts) -> Vec<Query> {
    let points = |frame: usize, vertices: [u32; 4]| vertices.map(|vertex| step.frames[frame][vertex as usize]);
    let query = |answer: &circumsphere_support::recording::ImpactAnswer| Query {
        start: points(0, answer.vertices),
        end: points(1, answer.vertices),
        collides: answer.collides,
    };
    truth.answers.iter().map(query).collect()
}

/// The time of `work` per item, in nanoseconds, measured in batches of about a millisecond. The shortest of a few runs
/// counts, because other load on the machine only adds time.
fn least_nanoseconds<Item>(items: &[Item], mut work: impl FnMut(&[Item])) -> f64 {
    let mut sum = 0.0;
    for batch in items.chunks(512) {
        let mut run = || {
            let begin = Instant::now();
            work(black_box(batch));
            begin.elapsed().as_nanos()
        };
        sum += (0..5).map(|_| run()).min().expect("there are runs") as f64;
    }
    sum / items.len().max(1) as f64
}

/// The kernel's results for one file.
#[derive(Default)]
struct Score {
    colliding: usize,
    apart: usize,
    missed: usize,
    false_impacts: usize,
    undecided: usize,
}

fn score(name: &str, kind: QueryKind, queries: &[Query]) -> Score {
    let impacts: Vec<_> = queries.iter().map(|query| impact(kind, query)).collect();
    let nanoseconds = least_nanoseconds(queries, |batch| {
        for query in batch {
            black_box(impact(kind, query));
        }
    });
    let mut score = Score::default();
    let mut steps = Vec::new();
    for (query, impact) in queries.iter().zip(&impacts) {
        score.colliding += usize::from(query.collides);
        score.apart += usize::from(!query.collides);
        match impact {
            None => score.missed += usize::from(query.collides),
            Some(impact) => {
                assert!((0.0..=1.0).contains(&impact.time), "{name}: {impact:?}");
                score.false_impacts += usize::from(!query.collides);
                score.undecided += usize::from(impact.cause == ImpactCause::Undecided);
                steps.push(impact.steps);
            }
        }
    }
    steps.sort_unstable();
    let percentile = |percent: usize| steps.get(steps.len().saturating_sub(1) * percent / 100).copied().unwrap_or(0);
    println!(
        "{name}: {} collide, {} missed; {} do not, {} false; {} undecided; steps to an impact: median {}, 99 % {}, most {}; \
         {nanoseconds:.0} ns a query",
        score.colliding,
        score.missed,
        score.apart,
        score.false_impacts,
        score.undecided,
        percentile(50),
        percentile(99),
        percentile(100),
    );
    score
}

#[test]
fn no_recorded_collision_is_missed() {
    let Some(folder) = recordings_folder() else { return };
    let (mut exact, mut must_find) = (Score::default(), Score::default());
    let add = |sum: &mut Score, score: Score| {
        sum.colliding += score.colliding;
        sum.apart += score.apart;
        sum.missed += score.missed;
        sum.false_impacts += score.false_impacts;
        sum.undecided += score.undecided;
    };
    for path in files(&folder, ".ccdq.bin") {
        let file = read_ccd_queries(&path).expect("the queries are valid");
        let wide = |points: [[f64; 3]; 4]| points.map(DVec3::from_array);
        let query = |query: &circumsphere_support::recording::CcdQuery| Query {
            start: wide(query.start),
            end: wide(query.end),
            collides: query.collides,
        };
        let queries: Vec<_> = file.queries.iter().map(query).collect();
        add(&mut exact, score(&name(&path), file.kind, &queries));
    }
    for path in files(&folder, ".gt.bin") {
        let truth = read_recorded_impacts(&path).expect("the answers are valid");
        add(&mut must_find, score(&name(&path), truth.kind, &queries_of(&step(&path), &truth)));
    }
    for score in [&exact, &must_find] {
        assert_eq!(score.missed, 0);
    }
    assert!(exact.colliding + must_find.colliding > 0, "the folder has no queries");
    // Features that pass each other within the kernel's resolution of 1e-14 count as meeting. None of the queries used
    // to write this test do, but others may.
    assert!(exact.false_impacts * 20 <= exact.apart, "{} of {}", exact.false_impacts, exact.apart);
}

#[test]
fn every_recorded_collision_of_features_is_one_of_their_triangles() {
    let Some(folder) = recordings_folder() else { return };
    let mut compared = 0;
    for path in files(&folder, ".gt.bin") {
        let truth = read_recorded_impacts(&path).expect("the answers are valid");
        let step = step(&path);
        let queries = queries_of(&step, &truth);
        let rest: Vec<Vec3> = step.frames[0].iter().map(|position| position.as_vec3()).collect();
        let topology = SurfaceTopology::new(&rest, &step.triangles).expect("the mesh is valid");
        // A triangle for each vertex, edge, and face.
        let mut owners: HashMap<Vec<u32>, u32> = HashMap::new();
        for (triangle, corners) in step.triangles.iter().enumerate() {
            for features in [&[0][..], &[1], &[2], &[0, 1], &[1, 2], &[2, 0], &[0, 1, 2]] {
                let mut vertices: Vec<u32> = features.iter().map(|&corner: &usize| corners[corner]).collect();
                vertices.sort_unstable();
                owners.entry(vertices).or_insert(triangle as u32);
            }
        }
        let owner = |vertices: &[u32]| {
            let mut vertices = vertices.to_vec();
            vertices.sort_unstable();
            owners[&vertices]
        };
        let split = if truth.kind == QueryKind::VertexFace { 1 } else { 2 };
        let candidates: Vec<[u32; 2]> = truth
            .answers
            .iter()
            .map(|answer| [owner(&answer.vertices[..split]), owner(&answer.vertices[split..])])
            .collect();
        let side = MovingSide { topology: &topology, start: &step.frames[0], end: &step.frames[1] };
        let mut impacts: Vec<PairImpact> = Vec::new();
        first_impacts(&side, &side, true, &candidates, 0.0, &mut impacts);
        let (mut found, mut crossing) = (impacts.iter().peekable(), 0);
        for (query, pair) in queries.iter().zip(&candidates) {
            let here = found.next_if(|found| [found.triangle_a, found.triangle_b] == *pair).map(|found| found.impact);
            if !query.collides {
                continue;
            }
            // Welding makes triangles neighbors if their vertices start at equal positions, and merges their features.
            let [a, b] = pair.map(|triangle| step.triangles[triangle as usize]);
            let is_welded_alone = !a.iter().any(|vertex| b.contains(vertex))
                && topology.share_vertex(TriangleId(pair[0]), TriangleId(pair[1]));
            if here.is_none() && is_welded_alone {
                continue;
            }
            compared += 1;
            let triangles = here.unwrap_or_else(|| panic!("{}: triangles {pair:?} are missed", path.display()));
            let features = impact(truth.kind, query).expect("no query is missed");
            crossing += usize::from(triangles.cause == ImpactCause::Crossing);
            // The search for triangles starts where a plane allows it, so the last digits of the times may differ.
            assert!(triangles.time <= features.time + 1.0e-9, "{pair:?}: {triangles:?} after {features:?}");
        }
        println!("{}: {crossing} of {} pairs of triangles cross at the start", name(&path), queries.len());
    }
    assert!(compared > 0, "the folder has no answers");
}

#[test]
fn no_stage_before_the_features_drops_an_impact_of_a_recorded_step() {
    let Some(folder) = recordings_folder() else { return };
    let mut recordings: Vec<_> = files(&folder, ".vf.gt.bin");
    recordings.sort();
    for path in recordings {
        let stem = name(&path).split('.').next().expect("a name has a beginning").to_owned();
        let recording = read_recording(&[path.with_file_name(format!("{stem}.bin"))]).expect("the recording is valid");
        let frame = |frame: usize| -> Vec<Vec3> { recording.frames[frame].iter().copied().map(Vec3::from).collect() };
        let (start, end) = (frame(0), frame(1));
        let topology = SurfaceTopology::new(&start, &recording.triangles).expect("the mesh is valid");
        let corners = |positions: &[Vec3], triangle: &[u32; 3]| triangle.map(|vertex| positions[vertex as usize]);
        let swept = |triangle: &[u32; 3]| {
            Aabb::from_points(corners(&start, triangle).into_iter().chain(corners(&end, triangle)))
        };
        let mut candidates = Vec::new();
        BoxTree::new(&recording.triangles.iter().map(swept).collect::<Vec<_>>()).self_pairs(&mut candidates);
        let all = candidates.len();
        // Evenly spread over the mesh, because a million pairs take seconds.
        let stride = all.div_ceil(MOST_PAIRS);
        let candidates: Vec<_> = candidates.into_iter().step_by(stride).collect();

        let side = MovingSide { topology: &topology, start: &start, end: &end };
        let mut impacts = Vec::new();
        let nanoseconds = least_nanoseconds(&candidates, |batch| {
            impacts.clear();
            first_impacts(&side, &side, true, batch, 0.0, &mut impacts);
        });
        impacts.clear();
        first_impacts(&side, &side, true, &candidates, 0.0, &mut impacts);

        println!(
            "{stem}: {all} pairs of swept boxes, {} of {} of them have an impact ({nanoseconds:.0} ns a pair)",
            impacts.len(),
            candidates.len(),
        );
        // Pairs dropped by planes and boxes have no features that meet.
        let mut dropped = 0;
        let mut found = impacts.iter().peekable();
        for pair in candidates {
            if found.next_if(|found| [found.triangle_a, found.triangle_b] == pair).is_some() {
                continue;
            }
            dropped += 1;
            let [a, b] = pair.map(|triangle| recording.triangles[triangle as usize]);
            let welded = pair.map(|triangle| topology.welded_triangles()[triangle as usize]);
            if dropped % 16 > 0 || welded[0].iter().any(|vertex| welded[1].contains(vertex)) {
                continue;
            }
            let points =
                |positions: &[Vec3], vertices: [u32; 4]| vertices.map(|vertex| positions[vertex as usize].as_dvec3());
            for k in 0..9 {
                let (first, second) = (k / 3, k % 3);
                let edges = [a[first], a[(first + 1) % 3], b[second], b[(second + 1) % 3]];
                assert_eq!(
                    edge_edge_impact(&points(&start, edges), &points(&end, edges), 0.0),
                    None,
                    "{stem}: {pair:?}"
                );
            }
            for k in 0..6 {
                let (own, other) = if k < 3 { (a, b) } else { (b, a) };
                let vertices = [own[k % 3], other[0], other[1], other[2]];
                let impact = vertex_face_impact(&points(&start, vertices), &points(&end, vertices), 0.0);
                assert_eq!(impact, None, "{stem}: {pair:?}");
            }
        }
        assert!(!impacts.is_empty() && dropped > 0, "{stem}");
    }
}
