//! Every scene twice, and on one thread and two.

use bevy_tasks::{ComputeTaskPool, TaskPoolBuilder};

use crate::{play, scenes::SCENES, small};

/// Enough for contacts in most scenes. The instrument is still on its way down to the organ.
const TICKS: u32 = 24;

#[test]
fn scenes_end_alike_to_the_last_bit_from_run_to_run_and_for_one_thread_or_two() {
    let pool = ComputeTaskPool::get_or_init(|| TaskPoolBuilder::new().num_threads(2).build());
    assert!(pool.thread_num() > 1, "the pool of this process has one thread, so there is nothing to compare");
    for name in SCENES {
        let end = |threads: usize| {
            let mut scene = small(name, threads);
            let start = scene.stage.hash();
            play(&mut scene, TICKS);
            assert_ne!(scene.stage.hash(), start, "{name}: nothing has moved, so the test proves nothing");
            scene.stage.hash()
        };
        let alone = end(1);
        assert_eq!(end(1), alone, "{name}: another run ends differently");
        assert_eq!(end(2), alone, "{name}: two threads end differently");
    }
}

#[test]
fn scenes_stay_finite() {
    for name in SCENES {
        let mut scene = small(name, 1);
        play(&mut scene, TICKS);
        for &body in &scene.stage.bodies {
            assert!(scene.stage.positions(body).iter().all(|position| position.is_finite()), "{name}");
        }
        let energy = crate::scenes::Energy::of(&scene.stage);
        assert!(energy.total().is_finite(), "{name}: {energy:?}");
    }
}

#[test]
fn scenes_begin_with_nothing_where_it_cannot_be() {
    for name in SCENES {
        let scene = small(name, 1);
        assert_eq!(scene.tunnelled(), 0, "{name}");
        assert_eq!(crate::scenes::truth::crossing_pairs(&scene.stage), 0, "{name}");
    }
}

#[test]
fn a_hash_sees_the_last_bit_of_a_position() {
    let scene = || small("layers", 1);
    let (mut one, same) = (scene(), scene());
    assert_eq!(one.stage.hash(), same.stage.hash());
    let last = *one.stage.bodies.last().expect("there are sheets");
    let position = *one.stage.positions(last).last().expect("a sheet has vertices");
    let vertex = one.stage.positions(last).len() - 1;
    one.stage.move_vertices(last, [(vertex, glam::Vec3 { z: position.z.next_up(), ..position })]);
    assert_ne!(one.stage.hash(), same.stage.hash());
}
