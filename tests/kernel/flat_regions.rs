//! Flat regions drop no pair of triangles within range, by f64 brute force, also where a contour comes back to itself.

use bevy_circumsphere::kernel::{
    bvh::{
        flat_regions::{FlatRegions, TreeOfMesh},
        leaf_triangles::{LeafMesh, PairCull},
        near_pairs::BoundedPairs,
    },
    mesh::{bounds::triangle_bounds, ids::TriangleId, motion::Motion},
};
use bevy_math::ops::{cos, sin, sin_cos};
use circumsphere_support::{
    random::Random,
    scenes::{Diagonals, Mesh, crumpled_sheet, duplicate_vertices, grid, icosphere, merge, torus, triangle_soup},
};
use circumsphere_truth::triangle_distance;
use glam::{DVec3, Vec2, Vec3};

use crate::surface_tree::Surface;

/// A strip of `cells` along and across, bent: `place` maps coordinates from 0 to 1.
fn strip(cells: [usize; 2], place: impl Fn(Vec2) -> Vec3) -> Mesh {
    let mut mesh = grid(cells[0], cells[1], 1.0, 1.0, Diagonals::Alternating);
    for position in &mut mesh.positions {
        let [x, y, z] = *position;
        let across = if y.abs() > z.abs() { y } else { z };
        *position = place(Vec2::new(x + 0.5, across + 0.5).clamp(Vec2::ZERO, Vec2::ONE)).into();
    }
    mesh
}

/// A ramp that winds up around the y axis, as seen from above, by so many turns of `cells` cells, and rises by `rise` in each.
fn ramp(turns: f32, rise: f32, cells: usize) -> Mesh {
    strip([cells, 4], |at| {
        let (sine, cosine) = sin_cos(at.x * turns * std::f32::consts::TAU);
        let radius = 1.0 + 0.4 * at.y;
        Vec3::new(radius * cosine, at.x * turns * rise, radius * sine)
    })
}

/// A sheet in whose middle a slit of a given width is open: its lips are no neighbors.
fn slit(width: f32) -> Mesh {
    let halves = [-1.0, 0.0].map(|start| {
        strip([16, 8], |at| {
            // The halves are joined at the beginning of the slit only.
            let opening = if at.x < 0.3 { 0.0 } else { (start + 0.5) * width };
            let across = start + at.y + opening;
            Vec3::new(2.0 * at.x, 0.1 * cos(at.x * 3.0), if across == 0.0 { 0.0 } else { across })
        })
    });
    merge(&halves)
}

/// Rings around each other in one plane, with gaps between them.
fn rings(gap: f32) -> Mesh {
    let ring = |inner: f32, outer: f32| {
        strip([48, 3], |at| {
            // Its ends are at exactly the same place.
            let (sine, cosine) = sin_cos(at.x.fract() * std::f32::consts::TAU);
            (inner + (outer - inner) * at.y) * Vec3::new(cosine, 0.0, sine)
        })
    };
    merge(&[ring(0.4, 0.7), ring(0.7 + gap, 1.0 + gap)])
}

fn scenes() -> Vec<(&'static str, Mesh)> {
    let wavy = strip([30, 30], |at| Vec3::new(3.0 * at.x, 0.2 * sin(7.0 * at.x) * cos(5.0 * at.y), 3.0 * at.y));
    let mut noisy = wavy.clone();
    let mut random = Random::new(5);
    for position in &mut noisy.positions {
        *position = position.map(|coordinate| coordinate + 0.03 * random.signed_unit());
    }
    vec![
        ("a sheet", wavy),
        ("a noisy sheet", noisy),
        ("half a turn of a ramp", ramp(0.5, 0.2, 20)),
        ("an open ring", ramp(0.99, 0.0, 40)),
        ("a ramp", ramp(1.7, 0.05, 68)),
        ("a steep ramp", ramp(2.5, 0.4, 100)),
        ("a slit", slit(0.01)),
        ("rings", rings(0.02)),
        (
            "a disk over a ring",
            merge(&[rings(0.02), grid(12, 12, 1.2, 1.2, Diagonals::Uniform).translate([0.0, 0.03, 0.0])]),
        ),
        (
            "sheets on each other",
            merge(&[0.0, 0.02].map(|z| grid(16, 16, 1.0, 1.0, Diagonals::Uniform).translate([0.0, 0.0, z]))),
        ),
        ("a ball", icosphere(4, 1.0)),
        ("a torus", torus(1.0, 0.3, 48, 16)),
        ("an unindexed torus", duplicate_vertices(&torus(1.0, 0.3, 48, 16))),
        ("a crumpled sheet", crumpled_sheet(4_000, 0.4)),
        ("a soup", triangle_soup(300, 3)),
    ]
}

/// The pairs that a traversal of the surface against itself leaves, those that it leaves in a list of near pairs, and
/// how many leaves are in a region.
fn traverse(surface: &Surface, range: f32, regions: &FlatRegions) -> [Vec<[u32; 2]>; 2] {
    let cull = PairCull {
        triangles: [&surface.triangles; 2],
        neighbors: true,
        slabs: range,
        search_from: regions.search_from(range),
        planes_only: false,
    };
    let (mut pairs, mut list) = (Vec::new(), BoundedPairs::default());
    let leaves = 0..surface.tree.leaf_count();
    surface.tree.self_pairs_of(leaves.clone(), Some(&cull), &mut pairs);
    surface.tree.bounded_self_pairs_of(leaves, range, 0.0, &cull, &mut list);
    let mut listed: Vec<[u32; 2]> = list.pairs().collect();
    pairs.sort_unstable();
    listed.sort_unstable();
    [pairs, listed]
}

fn tree_of(surface: &Surface) -> TreeOfMesh<'_> {
    let Surface { tree, triangles, topology, positions } = surface;
    TreeOfMesh { tree, triangles, topology, positions }
}

/// All pairs without a common vertex within range.
fn near_pairs(surface: &Surface, range: f32) -> Vec<[u32; 2]> {
    let count = surface.topology.triangles().len() as u32;
    let boxes: Vec<[Vec3; 2]> = (0..count)
        .map(|triangle| {
            let [a, b, c] = surface.corners(triangle).map(DVec3::as_vec3);
            [a.min(b).min(c) - range, a.max(b).max(c) + range]
        })
        .collect();
    let mut near = Vec::new();
    for first in 0..count {
        for second in first + 1..count {
            let [[low, high], [other_low, other_high]] = [first, second].map(|triangle| boxes[triangle as usize]);
            if low.cmple(other_high).all()
                && other_low.cmple(high).all()
                && !surface.topology.share_vertex(TriangleId(first), TriangleId(second))
                && triangle_distance(&surface.corners(first), &surface.corners(second)) <= f64::from(range)
            {
                near.push([first, second]);
            }
        }
    }
    near
}

#[test]
fn nothing_within_range_is_left_out() {
    let (mut near_count, mut in_regions, mut whole) = (0, 0, Vec::new());
    for (name, mesh) in scenes() {
        for range in [1e-4, 0.004, 0.008, 0.015, 0.025, 0.04, 0.08] {
            let surface = Surface::of_mesh(&mesh, range);
            let mut regions = FlatRegions::default();
            regions.find(&tree_of(&surface), range);
            in_regions += regions.leaf_count();
            if regions.search_from(range).iter().all(|&from| from as usize == surface.tree.leaf_count()) {
                whole.push((name, range));
            }
            let near = near_pairs(&surface, range);
            near_count += near.len();
            for found in traverse(&surface, range, &regions) {
                let lost: Vec<_> = near.iter().filter(|pair| found.binary_search(pair).is_err()).collect();
                assert!(lost.is_empty(), "{name} at {range}: {} of {} pairs are lost", lost.len(), near.len());
            }
        }
    }
    println!("{near_count} pairs within range, {in_regions} leaves in regions, whole: {whole:?}");
    assert!(near_count > 20_000 && in_regions > 8_000, "{near_count} pairs within range, {in_regions} leaves");
    let widest =
        |name: &str| whole.iter().filter(|(other, _)| *other == name).map(|(_, range)| *range).fold(0.0, f32::max);
    // What is flat as a whole, up to which range. The gap of the open ring is 2π/100 wide at its inner edge.
    assert!((0.04..0.0628).contains(&widest("an open ring")), "{}", widest("an open ring"));
    assert!(widest("half a turn of a ramp") >= 0.04);
    assert!((0.008..0.01).contains(&widest("a slit")), "{}", widest("a slit"));
    assert!((0.015..0.02).contains(&widest("rings")), "{}", widest("rings"));
    for name in ["a ramp", "a disk over a ring", "sheets on each other", "a ball", "a torus"] {
        assert!(widest(name) == 0.0, "{name} covers itself");
    }
}

#[test]
fn regions_are_kept_while_the_motion_lasts_and_lose_nothing() {
    let range = 0.01;
    let mut surface = Surface::of_mesh(&strip([40, 40], |at| Vec3::new(4.0 * at.x, 0.0, 4.0 * at.y)), range);
    let mut regions = FlatRegions::default();
    let (mut kept, mut found, mut near_count) = (0, 0, 0);
    let rest = surface.positions.clone();
    for tick in 0..40 {
        // It rolls up until it lies on itself, in eight large steps with small ones between.
        let bend = (tick / 5) as f32 * 0.3 + tick as f32 * 1e-4;
        let moved: Vec<Vec3> = rest
            .iter()
            .map(|at| {
                let (angle, x) = ((bend * at.x).max(1e-4), at.x);
                let (sine, cosine) = sin_cos(angle);
                Vec3::new(sine * x / angle, (1.0 - cosine) * x / angle - 0.0005 * angle * angle, at.z)
            })
            .collect();
        let motion = Motion::between(&surface.positions, &moved);
        let before = regions.search_from(range).to_vec();
        let triangles = surface.topology.triangles().to_vec();
        let next = Surface::new(moved, &triangles, range);
        // The same tree, refitted.
        let mut bounds = Vec::new();
        triangle_bounds(&next.positions, &triangles, 0.5 * range, &mut bounds);
        surface.positions = next.positions;
        surface.tree.refit(&bounds);
        let mesh = LeafMesh::flat(&surface.topology, &surface.positions);
        surface.triangles.update(&surface.tree, &mesh);
        regions.update(&tree_of(&surface), range, &motion);
        let now = regions.search_from(range);
        if !now.is_empty() && now == before {
            kept += 1;
        } else {
            found += 1;
        }
        let near = near_pairs(&surface, range);
        near_count += near.len();
        for left in traverse(&surface, range, &regions) {
            assert!(near.iter().all(|pair| left.binary_search(pair).is_ok()), "tick {tick}: a pair is lost");
        }
    }
    assert!(kept > 5 && found > 5 && near_count > 100, "kept {kept}, found {found}, {near_count} pairs");
}
