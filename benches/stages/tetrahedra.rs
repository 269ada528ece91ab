//! Ticks of 20,000 tetrahedra in motion that collide with themselves and each other, with and without the search for
//! contained vertices. Items are tetrahedra.

use bevy_app::prelude::*;
use bevy_circumsphere::{CircumsphereSettings, prelude::*};
use circumsphere_examples::headless::{detect, headless_app, move_surface, recording::Recorder};
use circumsphere_support::tetrahedra::CurlingBar;
use divan::{Bencher, counter::ItemsCount};
use glam::Vec3;

#[divan::bench(args = [false, true], sample_count = 60, sample_size = 1)]
fn curling_bar(bencher: Bencher, with_containments: bool) {
    let motion = CurlingBar::default();
    let settings = CircumsphereSettings { threads: 1, ..CircumsphereSettings::default() };
    let plugins = DeformableCollisionPlugins::new(Update).build();
    let plugins = if with_containments { plugins.add(TetrahedralContainmentPlugin) } else { plugins };
    let mut app = headless_app(plugins, settings, Recorder::default());
    let points = |positions: &[[f32; 3]]| positions.iter().copied().map(Vec3::from_array).collect::<Vec<_>>();
    let bodies = [&motion.bar, &motion.ball].map(|mesh| {
        let body = TetrahedralBody::from_mesh(&points(&mesh.positions), &mesh.tetrahedra).expect("the body is valid");
        app.world_mut().spawn((body, SelfCollision)).id()
    });
    let tetrahedra = motion.bar.tetrahedra.len() + motion.ball.tetrahedra.len();
    // There and back, so that no tick follows from another by a jump.
    let mut tick = 0;
    let step = || {
        let place = tick % (2 * CurlingBar::TICKS);
        let positions = motion.positions_at(place.min(2 * CurlingBar::TICKS - 1 - place));
        tick += 1;
        positions.map(|positions| points(&positions))
    };
    bencher.counter(ItemsCount::new(tetrahedra)).with_inputs(step).bench_local_values(|positions| {
        for (body, positions) in bodies.into_iter().zip(positions) {
            move_surface(&mut app, body, positions);
        }
        detect(&mut app);
    });
}
