//! Lists of touching pairs: tree against brute force, closed forms, welding, invalid input, and the comparison.

use crate::common::{Mesh, Random, grid, joined, soup};
use circumsphere_truth::{
    ReferencePair, box_pairs, compare, exact_weld, mean_edge_length, touching_pairs_between_brute_force,
    touching_pairs_between_tree, touching_pairs_brute_force, touching_pairs_tree,
};
use glam::DVec3;

fn both_flavours(mesh: &Mesh, distance: f64) -> Vec<ReferencePair> {
    let weld = exact_weld(&mesh.positions);
    let brute = touching_pairs_brute_force(&mesh.positions, &mesh.triangles, &weld, distance);
    let tree = touching_pairs_tree(&mesh.positions, &mesh.triangles, &weld, distance);
    assert_eq!(brute, tree);
    assert!(brute.is_sorted_by_key(|pair| (pair.triangle_a, pair.triangle_b)));
    assert!(brute.iter().all(|pair| pair.triangle_a < pair.triangle_b && pair.distance <= distance));
    brute
}

#[test]
fn tree_equals_brute_force_on_soups() {
    let mut random = Random::new(1);
    let (mut found, mut crossing) = (0, 0);
    for round in 0..12 {
        let size = [0.02, 0.1, 0.3, 1.0][round % 4];
        let count = 40 + random.below(160);
        let mesh = soup(&mut random, count, size);
        for distance in [0.0, 0.01, 0.1] {
            let pairs = both_flavours(&mesh, distance);
            found += pairs.len();
            crossing += pairs.iter().filter(|pair| pair.distance == 0.0).count();
        }
    }
    println!("{found} pairs, {crossing} crossing");
    assert!(found > 1000 && crossing > 1000 && crossing < found);
}

#[test]
fn tree_equals_brute_force_between_soups() {
    let mut random = Random::new(2);
    let mut found = 0;
    for size in [0.05, 0.3] {
        let (a, b) = (soup(&mut random, 130, size), soup(&mut random, 90, size * 2.0));
        for distance in [0.0, 0.02] {
            let brute =
                touching_pairs_between_brute_force(&a.positions, &a.triangles, &b.positions, &b.triangles, distance);
            let tree = touching_pairs_between_tree(&a.positions, &a.triangles, &b.positions, &b.triangles, distance);
            assert_eq!(brute, tree);
            found += brute.len();
        }
    }
    assert!(found > 500, "{found}");
}

/// Layers of cloth: each triangle lies over its own counterpart, its edge neighbors, and its corner neighbors.
#[test]
fn layers_touch_exactly_where_they_lie_over_each_other() {
    let cells = 8;
    let (lower, upper) = (grid(cells, |_, _| 0.0), grid(cells, |_, _| 0.125));
    let sheet = joined(&lower, &upper);
    assert!(both_flavours(&sheet, 0.1249).iter().all(|pair| pair.triangle_b < 2 * cells * cells));
    let touching = both_flavours(&sheet, 0.125);
    let between: Vec<_> = touching
        .iter()
        .filter(|pair| pair.triangle_a < 2 * cells * cells && pair.triangle_b >= 2 * cells * cells)
        .collect();
    assert!(between.iter().all(|pair| pair.distance == 0.125));
    // The distance of a pair between the layers equals the gap exactly if the triangles are counterparts or share a
    // corner of the lattice.
    let share = |a: usize, b: usize| {
        let shifted = sheet.triangles[b].map(|vertex| vertex - lower.positions.len() as u32);
        sheet.triangles[a].iter().any(|vertex| shifted.contains(vertex))
    };
    let per_layer = lower.triangles.len();
    let expected = (0..per_layer)
        .flat_map(|a| (per_layer..2 * per_layer).map(move |b| (a, b)))
        .filter(|&(a, b)| share(a, b))
        .count();
    assert_eq!(between.len(), expected);
    assert!(expected > per_layer);
}

#[test]
fn grids_that_fold_over_themselves_agree_too() {
    // Folded along x = 7. From the fold on, the upper half rises above the lower one.
    let mut mesh = grid(14, |x, _| if x > 7 { f64::from(x - 7) * 0.03 } else { 0.0 });
    for position in &mut mesh.positions {
        position.x = 7.0 - (position.x - 7.0).abs();
    }
    let near = both_flavours(&mesh, 0.1).len();
    let all = both_flavours(&mesh, 0.25).len();
    assert!(near > 0 && all > near, "{near} {all}");
    let flat = grid(10, |_, _| 0.0);
    assert!(both_flavours(&flat, 0.5).is_empty(), "triangles of a flat grid that share no vertex are 0.7 apart");
    assert!(!both_flavours(&flat, 0.75).is_empty());
}

#[test]
fn triangles_that_share_a_vertex_are_left_out_by_weld() {
    let a = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.]];
    let b = [[-0., 0., -0.], [-1., 0., 0.], [0., -1., 0.]];
    let positions: Vec<DVec3> = a.into_iter().chain(b).map(DVec3::from_array).collect();
    let triangles = [[0, 1, 2], [3, 4, 5]];
    let weld = exact_weld(&positions);
    assert_eq!(weld, [0, 1, 2, 0, 4, 5]);
    assert!(touching_pairs_tree(&positions, &triangles, &weld, 0.1).is_empty());
    let unwelded = [0, 1, 2, 3, 4, 5];
    let expected = [ReferencePair { triangle_a: 0, triangle_b: 1, distance: 0.0 }];
    assert_eq!(touching_pairs_tree(&positions, &triangles, &unwelded, 0.1), expected);
    assert_eq!(touching_pairs_brute_force(&positions, &triangles, &unwelded, 0.1), expected);
}

#[test]
fn bad_coordinates_hide_no_other_pair() {
    let mut random = Random::new(3);
    let mut mesh = soup(&mut random, 120, 0.3);
    let whole = both_flavours(&mesh, 0.05);
    mesh.positions[3 * 17] = DVec3::new(f64::NAN, 0.0, 0.0);
    mesh.positions[3 * 40 + 1] = DVec3::new(0.0, f64::INFINITY, 0.0);
    let spoilt = both_flavours(&mesh, 0.05);
    let expected: Vec<_> = whole
        .into_iter()
        .filter(|pair| ![pair.triangle_a, pair.triangle_b].iter().any(|t| [17, 40].contains(t)))
        .collect();
    assert_eq!(spoilt, expected);
    assert!(!spoilt.is_empty());
}

#[test]
fn empty_and_single_triangle_meshes_touch_nothing() {
    let empty = Mesh { positions: Vec::new(), triangles: Vec::new() };
    assert!(both_flavours(&empty, 1.0).is_empty());
    assert!(both_flavours(&soup(&mut Random::new(4), 1, 1.0), 1.0).is_empty());
    assert_eq!(mean_edge_length(&[], &[], &[]), 0.0);
}

#[test]
fn box_pairs_are_those_of_every_two_boxes() {
    let mesh = soup(&mut Random::new(5), 150, 0.2);
    let distance = 0.05;
    let boxes: Vec<(DVec3, DVec3)> = mesh
        .triangles
        .iter()
        .map(|t| t.map(|vertex| mesh.positions[vertex as usize]))
        .map(|[a, b, c]| (a.min(b).min(c) - distance / 2.0, a.max(b).max(c) + distance / 2.0))
        .collect();
    let mut expected = Vec::new();
    for i in 0..boxes.len() {
        for j in i + 1..boxes.len() {
            if boxes[i].0.cmple(boxes[j].1).all() && boxes[j].0.cmple(boxes[i].1).all() {
                expected.push((i as u32, j as u32));
            }
        }
    }
    assert_eq!(box_pairs(&mesh.positions, &mesh.triangles, distance), expected);
    assert!(!expected.is_empty());
}

#[test]
fn edges_are_counted_once_in_the_mean() {
    // A square of side 2 with a diagonal. The second triangle has its own vertices.
    let corners = [[0., 0., 0.], [2., 0., 0.], [0., 2., 0.], [2., 0., 0.], [2., 2., 0.], [0., 2., 0.]];
    let positions: Vec<DVec3> = corners.into_iter().map(DVec3::from_array).collect();
    let weld = exact_weld(&positions);
    let mean = mean_edge_length(&positions, &[[0, 1, 2], [3, 4, 5]], &weld);
    assert!((mean - (4.0 * 2.0 + 8f64.sqrt()) / 5.0).abs() < 1e-15);
}

#[test]
fn comparison_tells_misses_from_false_pairs_and_leaves_the_band_free() {
    let pair = |triangle_a, triangle_b, distance| ReferencePair { triangle_a, triangle_b, distance };
    let truth =
        [pair(0, 1, 0.0), pair(0, 2, 0.5), pair(0, 3, 0.95), pair(0, 4, 1.05), pair(0, 5, 1.15), pair(0, 6, 0.3)];
    let found = [(0, 1, 0.0), (0, 2, 0.52), (0, 4, 1.0), (0, 5, 1.0), (0, 7, 0.9), (0, 2, 0.52), (2, 0, 0.5)];
    let comparison = compare(&found, &truth, 1.0, 0.1);
    assert_eq!(comparison.missed, [pair(0, 6, 0.3)]);
    assert_eq!(comparison.false_pairs, [(0, 5), (0, 7), (2, 0)]);
    assert_eq!(comparison.duplicates, [(0, 2)]);
    assert_eq!(comparison.in_band, 2);
    assert_eq!(comparison.matched, 2);
    assert!((comparison.worst_distance_error - 0.05).abs() < 1e-15);
    assert_eq!(comparison.worst_pair, Some((0, 4)));
    assert!(!comparison.is_exact());

    let exact: Vec<_> = truth.iter().map(|p| (p.triangle_a, p.triangle_b, p.distance)).collect();
    assert!(compare(&exact, &truth, 1.2, 1e-4).is_exact());
    let not_a_number = [(0, 1, f64::NAN)];
    assert_eq!(compare(&not_a_number, &truth[..1], 1.0, 0.1).worst_distance_error, f64::INFINITY);
    // At contact distance 0, the band is empty: crossing pairs are required, and all others are false.
    let crossing_only = compare(&found[..2], &truth, 0.0, 1e-4);
    assert_eq!((crossing_only.matched, crossing_only.in_band), (1, 0));
    assert_eq!(crossing_only.false_pairs, [(0, 2)]);
}
