//! The hierarchy of regions as the top of a tree, against the tree as it is.
//!
//! A tree with regions on top is here one tree for each region, below one over the boxes of all regions.

use std::time::Instant;

use bevy_circumsphere::{
    geometry::{Aabb, thin_wall::ThinWalls},
    kernel::{bvh::tree::BoxTree, mesh::bounds::triangle_bounds},
};
use circumsphere_support::scenes::{Panel, panel};

use super::{find, recordings::recorded};

/// How often each is timed.
const TIMES: usize = 15;

fn bounds(walls: &ThinWalls) -> Vec<Aabb> {
    let mut bounds = Vec::new();
    // Boxes are all as large as the contact distance asks for.
    let most = walls.half_thickness.iter().copied().fold(0.0, f32::max);
    triangle_bounds(&walls.positions, &walls.triangles, most, &mut bounds);
    bounds
}

/// The triangles of each region, and what is left.
fn regions(walls: &ThinWalls) -> Vec<Vec<u32>> {
    let mut regions = vec![Vec::new(); walls.regions.len() + 1];
    for triangle in 0..walls.triangles.len() {
        let region = walls.sheet_regions.get(triangle).map_or(walls.regions.len(), |&region| region as usize);
        regions[region].push(triangle as u32);
    }
    regions.retain(|triangles| !triangles.is_empty());
    regions
}

fn plain_pairs(tree: &BoxTree, pairs: &mut Vec<[u32; 2]>) {
    pairs.clear();
    tree.self_pairs(pairs);
}

fn region_pairs(trees: &[BoxTree], regions: &[Vec<u32>], bounds: &[Aabb], pairs: &mut Vec<[u32; 2]>) {
    pairs.clear();
    let around =
        |region: &Vec<u32>| region.iter().fold(Aabb::EMPTY, |all, &triangle| all.union(&bounds[triangle as usize]));
    let top: Vec<Aabb> = regions.iter().map(around).collect();
    let mut near = Vec::new();
    BoxTree::new(&top).self_pairs(&mut near);
    near.extend((0..regions.len() as u32).map(|region| [region; 2]));
    let mut own = Vec::new();
    for [a, b] in near.into_iter().map(|pair| pair.map(|region| region as usize)) {
        own.clear();
        if a == b {
            trees[a].self_pairs(&mut own);
        } else {
            trees[a].pairs_of(0..trees[a].leaf_count(), &trees[b], None, &mut own);
        }
        pairs.extend(own.iter().map(|&[first, second]| {
            let [first, second] = [regions[a][first as usize], regions[b][second as usize]];
            [first.min(second), first.max(second)]
        }));
    }
}

fn fastest(mut work: impl FnMut()) -> f64 {
    let time = |_| {
        let start = Instant::now();
        work();
        1.0e6 * start.elapsed().as_secs_f64()
    };
    (0..TIMES).map(time).fold(f64::INFINITY, f64::min)
}

#[test]
fn regions_as_the_top_of_the_tree_find_the_same_pairs() {
    let ribbed = panel(&Panel { longest_side: 0.01, ..Panel::ribbed() });
    let named =
        [("ribbed panel", Some(ribbed)), ("tray", recorded("tray_bottom_thinwall")), ("cat", recorded("hollow_cat"))];
    for (name, mesh) in named {
        let Some(mesh) = mesh else { continue };
        let (walls, _) = find(&mesh);
        let (bounds, regions) = (bounds(&walls), regions(&walls));
        let tree = BoxTree::new(&bounds);
        let of_region = |region: &Vec<u32>| {
            let own: Vec<Aabb> = region.iter().map(|&triangle| bounds[triangle as usize]).collect();
            BoxTree::new(&own)
        };
        let trees: Vec<BoxTree> = regions.iter().map(of_region).collect();
        let (mut plain, mut by_region) = (Vec::new(), Vec::new());
        let times = [
            fastest(|| plain_pairs(&tree, &mut plain)),
            fastest(|| region_pairs(&trees, &regions, &bounds, &mut by_region)),
        ];
        plain.sort_unstable();
        by_region.sort_unstable();
        assert!(plain.len() > walls.triangles.len());
        assert_eq!(plain, by_region, "{name}");
        println!(
            "{name}: {} triangles in {} regions: pairs in {:.0} µs by the tree, {:.0} µs with regions on top",
            walls.triangles.len(),
            regions.len(),
            times[0],
            times[1]
        );
    }
}
