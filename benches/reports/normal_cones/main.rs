//! How many comparisons of a self-collision normal cones save, and how much time, on smooth and crumpled meshes.
//!
//! `cargo run --release --example normal_cones -- [FILES]`; `--help` lists the options.

use std::{
    io::{self, Write},
    path::PathBuf,
    time::Duration,
};

use bevy_app::prelude::*;
use bevy_circumsphere::{
    CircumsphereSettings, ContactStore,
    detection::{DetectionDiagnostics, NormalConeCullingPlugin},
    kernel::{
        bvh::{
            flat_regions::{FlatRegions, TreeOfMesh},
            leaf_triangles::{LeafMesh, LeafTriangles},
            tree::BoxTree,
        },
        mesh::{bounds::triangle_bounds, topology::SurfaceTopology},
    },
    prelude::*,
};
use circumsphere_examples::headless::{headless_app, move_surface, recording::Recorder};
use circumsphere_support::{
    recording::read_recording,
    scenes::{Character, CharacterFineness, Mesh, character_skirt, crumpled_sheet, icosphere},
};
use clap::Parser;
use glam::Vec3;

/// Measure what normal cones save in a self-collision, on one thread. Fails if they change a contact.
#[derive(Parser, Debug)]
#[command(name = "normal_cones")]
struct Options {
    /// Further meshes: PLY, OBJ, or recordings, of which the first frame counts
    files: Vec<PathBuf>,
    /// Ticks that are measured
    #[arg(long, value_name = "N", default_value_t = 32, value_parser = clap::value_parser!(u32).range(1..))]
    ticks: u32,
}

/// Contact distances, and how far the fastest vertices move per tick, in mean edges.
const CASES: [(f32, f32); 4] = [(0.02, 0.02), (0.1, 0.02), (0.1, 0.1), (0.1, 0.5)];

/// Ticks before the measured ones.
const WARM: u32 = 4;

struct Surface {
    name: String,
    positions: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
}

impl Surface {
    fn new(name: impl Into<String>, Mesh { positions, triangles }: Mesh) -> Self {
        let positions = positions.into_iter().map(Vec3::from).collect();
        Self { name: name.into(), positions, triangles }
    }

    /// A standing wave as long as the surface, in which the fastest vertices move by `motion` per tick.
    fn moved(&self, motion: f32, tick: u32) -> Vec<Vec3> {
        const SPEED: f32 = 0.2;
        let (low, high) = self
            .positions
            .iter()
            .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), &at| (low.min(at), high.max(at)));
        let size = (high - low).max_element();
        let amount = motion / SPEED * bevy_math::ops::sin(SPEED * tick as f32);
        let wave = |along: f32| bevy_math::ops::sin(std::f32::consts::TAU * along / size);
        let sway = |at: Vec3| Vec3::new(wave(at.y), wave(at.z), wave(at.x)) / 3_f32.sqrt();
        self.positions.iter().map(|&at| at + amount * sway(at - low)).collect()
    }
}

/// Shares of the pairs of leaves that a traversal compares.
struct Shares {
    /// That regions leave out.
    left_out: f64,
    /// Of which both leaves are in regions, if not in the same one.
    both_in_regions: f64,
    /// Whose normals are all within 90 degrees of one axis, without which no region contains both.
    in_one_cone: f64,
}

fn shares(surface: &Surface, range: f32) -> Shares {
    let positions = &surface.positions;
    let topology = SurfaceTopology::new(positions, &surface.triangles).expect("the mesh has been read");
    let mut bounds = Vec::new();
    triangle_bounds(positions, &surface.triangles, 0.5 * range, &mut bounds);
    let tree = BoxTree::new(&bounds);
    let mut triangles = LeafTriangles::default();
    triangles.update(&tree, &LeafMesh::flat(&topology, positions));
    let mut regions = FlatRegions::default();
    regions.find(&TreeOfMesh { tree: &tree, triangles: &triangles, topology: &topology, positions }, range);
    let search_from = regions.search_from(range);
    let leaves: Vec<_> = (0..tree.leaf_count()).map(|leaf| *tree.leaf_bounds(leaf)).collect();
    // A leaf is compared with itself too.
    let mut pairs: Vec<[u32; 2]> = (0..leaves.len() as u32).map(|leaf| [leaf, leaf]).collect();
    BoxTree::new(&leaves).self_pairs(&mut pairs);
    // The leaves of a region search from its end on.
    let region = |leaf: u32| search_from.get(leaf as usize).copied().filter(|&from| from > leaf);
    let normals: Vec<Vec<Vec3>> = (0..tree.leaf_count())
        .map(|leaf| {
            let corners =
                |triangle: &u32| surface.triangles[*triangle as usize].map(|vertex| positions[vertex as usize]);
            let normal = |[a, b, c]: [Vec3; 3]| (b - a).cross(c - a).normalize_or_zero();
            tree.leaf_items(leaf).iter().map(corners).map(normal).collect()
        })
        .collect();
    let fit_one_cone = |[first, second]: [u32; 2]| {
        let all = || normals[first as usize].iter().chain(&normals[second as usize]);
        // The perceptron's rule finds an axis if there is one with some room.
        let mut axis: Vec3 = all().sum();
        (0..64).any(|_| {
            let worst = all().copied().min_by(|a, b| a.dot(axis).total_cmp(&b.dot(axis))).unwrap_or_default();
            axis += worst;
            all().all(|normal| normal.dot(axis) > 0.0)
        })
    };
    let share = |counts: &dyn Fn([u32; 2]) -> bool| {
        pairs.iter().filter(|&&pair| counts(pair)).count() as f64 / pairs.len().max(1) as f64
    };
    Shares {
        left_out: share(&|[first, second]| region(first.min(second)).is_some_and(|from| from > first.max(second))),
        both_in_regions: share(&|pair| pair.into_iter().all(|leaf| region(leaf).is_some())),
        in_one_cone: share(&fit_one_cone),
    }
}

/// Medians over the ticks, and all contacts.
struct Measured {
    broad_phase: Duration,
    whole: Duration,
    touching: Vec<Vec<(u32, u32, f64)>>,
}

fn measure(surface: &Surface, [range, motion]: [f32; 2], with_cones: bool, ticks: u32) -> Measured {
    let settings = CircumsphereSettings { threads: 1, ..CircumsphereSettings::default() };
    let plugins = DeformableCollisionPlugins::new(Update).build();
    let plugins = if with_cones { plugins } else { plugins.disable::<NormalConeCullingPlugin>() };
    let mut app = headless_app(plugins, settings, Recorder::default());
    let (mesh, positions) =
        DeformableSurface::from_mesh(&surface.positions, &surface.triangles).expect("the mesh has been read");
    let entity = app.world_mut().spawn((mesh, positions, SelfCollision, SurfaceThickness::World(0.5 * range))).id();
    let (mut times, mut wholes, mut touching) = (Vec::new(), Vec::new(), Vec::new());
    for tick in 0..WARM + ticks {
        move_surface(&mut app, entity, surface.moved(motion, tick));
        app.update();
        let store = app.world().resource::<ContactStore>();
        touching.push(store.touching().map(|pair| (pair.triangle_a, pair.triangle_b, pair.distance)).collect());
        if tick >= WARM {
            let diagnostics = app.world().resource::<DetectionDiagnostics>();
            let stages = diagnostics
                .stages
                .iter()
                .filter(|stage| matches!(stage.name, "tree update" | "normal cones" | "broad phase"));
            times.push(stages.map(|stage| stage.duration).sum());
            wholes.push(diagnostics.total());
        }
    }
    let median = |mut times: Vec<Duration>| {
        times.sort_unstable();
        times[times.len() / 2]
    };
    Measured { broad_phase: median(times), whole: median(wholes), touching }
}

fn surfaces(options: &Options) -> io::Result<Vec<Surface>> {
    let character = Character::new(CharacterFineness::Finest, 1.0);
    let mut surfaces = vec![
        Surface::new("ball", icosphere(5, 1.0)),
        Surface::new("skirt", character_skirt(80, 120)),
        Surface::new(
            "character",
            Mesh { positions: character.positions(0.3), triangles: character.rest().triangles.clone() },
        ),
        Surface::new("crumpled cloth", crumpled_sheet(20_000, 0.0)),
    ];
    for path in &options.files {
        let recording = read_recording(std::slice::from_ref(path)).map_err(io::Error::other)?;
        let name = path.file_stem().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let positions = recording.frames.first().cloned().unwrap_or_default();
        surfaces.push(Surface::new(name, Mesh { positions, triangles: recording.triangles }));
    }
    Ok(surfaces)
}

fn main() -> io::Result<()> {
    let options = Options::parse();
    let mut out = io::stdout().lock();
    writeln!(
        out,
        "Pairs of leaves: left out by regions; both leaves in regions; normals in one cone of 90 degrees.\n\
         Milliseconds of the broad phase, and in parentheses of the whole detection.\n"
    )?;
    writeln!(
        out,
        "| surface | triangles | contact distance | motion | left out | in regions | in one cone | without | with cones |"
    )?;
    writeln!(out, "|---|---:|---:|---:|---:|---:|---:|---:|---:|")?;
    for surface in surfaces(&options)? {
        let topology = SurfaceTopology::new(&surface.positions, &surface.triangles).map_err(io::Error::other)?;
        let edge = topology.mean_edge_length(&surface.positions) as f32;
        for (distance, motion) in CASES {
            let [range, way] = [distance * edge, motion * edge];
            let Shares { left_out, both_in_regions, in_one_cone } = shares(&surface, range);
            let [without, with] =
                [false, true].map(|with_cones| measure(&surface, [range, way], with_cones, options.ticks));
            assert!(without.touching == with.touching, "{}: normal cones change contacts", surface.name);
            let percent = |share: f64| format!("{:.0} %", 100.0 * share);
            let time = |Measured { broad_phase, whole, .. }: &Measured| {
                format!("{:.2} ({:.2})", broad_phase.as_secs_f64() * 1e3, whole.as_secs_f64() * 1e3)
            };
            writeln!(
                out,
                "| {} | {} | {distance} | {motion} | {} | {} | {} | {} | {} |",
                surface.name,
                surface.triangles.len(),
                percent(left_out),
                percent(both_in_regions),
                percent(in_one_cone),
                time(&without),
                time(&with),
            )?;
            out.flush()?;
        }
    }
    Ok(())
}
