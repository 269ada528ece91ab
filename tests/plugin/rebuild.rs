//! A tree that no longer fits its mesh is rebuilt in slices. This changes neither contacts nor the regularity of ticks.

use std::time::Duration;

use bevy_app::prelude::*;
use bevy_circumsphere::{
    detection::{DetectionDiagnostics, SurfaceState, SurfaceStates},
    kernel::bvh::tree::BoxTree,
    prelude::*,
};
use bevy_ecs::prelude::*;
use circumsphere_support::scenes::{Diagonals, grid};
use glam::Vec3;

use crate::world::{app, ball, points, spawn, store, write_positions};

const TICKS: usize = 60;

/// A sheet with a stirred disc, and a ball in it. Stirring separates triangles that were neighbors, so their common
/// boxes grow long.
struct Stirred {
    app: App,
    sheet: Entity,
    ball: Entity,
    rest: Vec<Vec3>,
}

impl Stirred {
    fn new(cells: usize) -> Self {
        let mut app = app();
        app.insert_resource(CircumsphereSettings { threads: 1, ..Default::default() });
        let mesh = grid(cells, cells, 4.0, 4.0, Diagonals::Alternating);
        let thick = SurfaceThickness::World(0.002);
        let sheet = spawn(&mut app, &mesh, (thick, ContactMethod::Exact));
        let ball = spawn(&mut app, &ball(), (thick, ContactMethod::Exact));
        Self { app, sheet, ball, rest: points(&mesh) }
    }

    fn stir(&mut self, tick: usize) {
        let Self { app, sheet, rest, .. } = self;
        let mut positions = app.world_mut().get_mut::<SurfacePositions>(*sheet).expect("the entity is a surface");
        for (position, rest) in positions.0.iter_mut().zip(rest) {
            // The inside turns, the outside stays, and the part in between is stretched.
            let turned = (1.0 - rest.length() / 2.0).max(0.0) * 0.6 * tick as f32;
            *position = glam::DQuat::from_rotation_y(f64::from(turned)).as_quat() * *rest;
        }
    }

    fn put_ball(&mut self, height: f32) {
        let above: Vec<Vec3> = points(&ball()).iter().map(|&place| place + Vec3::Y * height).collect();
        write_positions(&mut self.app, self.ball, &above);
    }

    fn state(&self) -> &SurfaceState {
        self.app.world().resource::<SurfaceStates>().get(self.sheet).expect("the entity is a surface")
    }

    fn matches_boxes(&self) -> bool {
        self.state().is_tree_current()
    }

    fn tick(&mut self, tick: usize) -> (Duration, usize) {
        self.stir(tick);
        self.app.update();
        let diagnostics = self.app.world().resource::<DetectionDiagnostics>();
        (diagnostics.total(), diagnostics.trees_rebuilt)
    }
}

#[test]
fn no_tick_of_a_decaying_tree_takes_ten_times_the_median() {
    let mut least = vec![Duration::MAX; TICKS];
    let mut rebuilt = 0;
    // Run the same ticks several times and keep the minimum of each, because other processes slow down some of them.
    for _ in 0..3 {
        let mut scene = Stirred::new(150);
        scene.tick(0);
        rebuilt = 0;
        for (tick, least) in least.iter_mut().enumerate() {
            let (duration, trees) = scene.tick(tick + 1);
            rebuilt += trees;
            *least = duration.min(*least);
        }
    }
    let mut sorted = least.clone();
    sorted.sort_unstable();
    let (median, worst) = (sorted[TICKS / 2], sorted[TICKS - 1]);
    println!("{rebuilt} rebuilds, median {median:?}, worst {worst:?}");
    assert!(rebuilt >= 2, "{rebuilt} rebuilds");
    assert!(worst < 10 * median, "{worst:?} for a median of {median:?}");
}

#[test]
fn contacts_are_those_of_new_trees_while_old_ones_are_built_anew() {
    let mut scene = Stirred::new(40);
    let (mut rebuilt, mut contacts) = (0, 0);
    for tick in 0..TICKS {
        rebuilt += scene.tick(tick).1;
        let mut fresh = Stirred::new(40);
        fresh.tick(tick);
        let (kept, fresh) = (store(&scene.app), store(&fresh.app));
        assert!(kept.contacts().eq(fresh.contacts()), "tick {tick}");
        assert!(kept.touching().eq(fresh.touching()), "tick {tick}");
        contacts += kept.contact_count();
    }
    println!("{rebuilt} rebuilds, {contacts} contacts");
    assert!(rebuilt >= 2 && contacts > 1_000, "{rebuilt} rebuilds, {contacts} contacts");
}

/// The sum of the half areas of all boxes of a tree.
fn area(tree: &BoxTree) -> f32 {
    let mut area = 0.0;
    tree.for_each_node(|_, bounds| area += bounds.half_area());
    area
}

/// A rebuild that began before the tree rested is for a mesh that has long since changed.
#[test]
fn a_tree_that_has_rested_while_its_surface_was_alone_is_soon_as_good_as_a_new_one() {
    let mut scene = Stirred::new(40);
    assert!(scene.app.world().resource::<SurfaceStates>().get(scene.sheet).is_none());
    scene.put_ball(90.0);
    scene.tick(0);
    assert!(scene.matches_boxes(), "a tree is built for a new surface");
    scene.tick(1);
    assert!(!scene.matches_boxes());
    scene.put_ball(0.0);
    let mut tick = 1;
    while scene.state().tree().decay() <= 1.5 {
        tick += 1;
        assert!(tick < TICKS && scene.tick(tick).1 == 0 && scene.matches_boxes());
    }
    let area_before = area(scene.state().tree());
    scene.put_ball(90.0);
    for alone in 0..50 {
        assert_eq!(scene.tick(tick + alone).1, 0);
        assert!(!scene.matches_boxes() || alone == 0, "the tree is not needed");
        assert_eq!(area(scene.state().tree()), area_before);
    }
    scene.put_ball(0.0);
    for near in 0..15 {
        let stirred = tick + 6 + near % 2;
        scene.tick(stirred);
        assert!(scene.matches_boxes());
        let mut fresh = Stirred::new(40);
        fresh.tick(stirred);
        assert!(store(&scene.app).contacts().eq(store(&fresh.app).contacts()), "{near}");
        let [area, new] = [&scene, &fresh].map(|scene| area(scene.state().tree()));
        println!("{near}: {:.3} of a new tree", area / new);
        assert!(near < 10 || area < 1.3 * new, "the area is {area}, that of a new tree {new}");
    }
}
