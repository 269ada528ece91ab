//! Trees that a mesh has outgrown: built anew in slices, which changes neither contacts nor the rhythm of ticks.

use std::time::Duration;

use bevy_app::prelude::*;
use bevy_circumsphere::{detection::DetectionDiagnostics, prelude::*};
use bevy_ecs::prelude::*;
use circumsphere_support::scenes::{Diagonals, grid};
use glam::Vec3;

use crate::world::{app, ball, points, spawn, store};

const TICKS: usize = 60;

/// A disc of a sheet that is stirred, so that boxes of what once lay together grow long, and a ball in it.
struct Stirred {
    app: App,
    sheet: Entity,
    rest: Vec<Vec3>,
}

impl Stirred {
    fn new(cells: usize) -> Self {
        let mut app = app();
        app.insert_resource(CircumsphereSettings { threads: 1, ..Default::default() });
        let mesh = grid(cells, cells, 4.0, 4.0, Diagonals::Alternating);
        let thick = SurfaceThickness::World(0.002);
        let sheet = spawn(&mut app, &mesh, (thick, ContactMethod::Refined));
        spawn(&mut app, &ball(), (thick, ContactMethod::Refined));
        Self { app, sheet, rest: points(&mesh) }
    }

    fn stir(&mut self, tick: usize) {
        let Self { app, sheet, rest } = self;
        let mut positions = app.world_mut().get_mut::<SurfacePositions>(*sheet).expect("it is a surface");
        for (position, rest) in positions.0.iter_mut().zip(rest) {
            // The inside turns, the outside stays, and what is between them is drawn out.
            let turned = (1.0 - rest.length() / 2.0).max(0.0) * 0.6 * tick as f32;
            *position = glam::DQuat::from_rotation_y(f64::from(turned)).as_quat() * *rest;
        }
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
    // The same ticks several times, of each the least: what else runs on the machine takes longer now and then.
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
    assert!(worst < 10 * median, "{worst:?} against {median:?}");
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
