//! Worlds that go back in time and play again find what they found the first time, to the last bit.

mod game;
mod price;

use circumsphere_support::random::Random;

use self::game::{Game, TICKS, straight};

/// The most ticks by which the game goes back.
const MOST_BACK: u64 = 8;

#[test]
fn the_scene_has_what_history_decides() {
    let all = straight();
    let told = |what: &str| all.iter().filter(|text| text.contains(what)).count();
    assert!(told("SurfaceContactStart") > 10 && told("SurfaceContactEnd") > 5, "contacts start and end");
    assert!(told("distance: -0.0") > 5, "sheets have passed through each other");
    assert!(told("Impact {") > 5, "sweeps find impacts");
    assert!(told("SurfaceQuarantined") > 5, "a surface is quarantined");
    assert!(told("pushed") > 10, "a cloth pushes a rigid body in {} ticks", told("pushed"));
    let asleep = |tick: usize| all[tick].contains("asleep 1 ");
    assert!(!asleep(10) && asleep(90) && asleep(99) && !asleep(100), "the rag falls asleep, and is woken");
}

#[track_caller]
fn assert_same(results: &str, expected: &str, what: &str) {
    let mut both = results.bytes().zip(expected.bytes());
    let first = both.position(|(own, other)| own != other).unwrap_or(results.len().min(expected.len()));
    let around = |text: &str| text[first.saturating_sub(300)..(first + 100).min(text.len())].to_owned();
    assert!(results == expected, "{what}:\n{}\nis not\n{}", around(results), around(expected));
}

#[test]
fn a_thousand_rollbacks_change_nothing() {
    let expected = straight();
    let mut random = Random::new(28);
    let mut game = Game::new();
    let mut saved = vec![game.save()];
    for rollbacks in 0..1000 {
        // First along the whole game, each time a few ticks back. Then to anywhere in it.
        let furthest = saved.len() - 1;
        let is_along = furthest < TICKS;
        let back = if is_along { random.below(MOST_BACK + 1).min(furthest as u64) } else { random.below(TICKS as u64) };
        let saved_then = &saved[furthest - back as usize];
        game.go_back(saved_then);
        game.app.insert_resource(saved_then.history.clone());
        let ahead = random.below(2) as usize + if is_along { back as usize } else { 1 };
        for _ in 0..ahead.min(TICKS - game.tick) {
            let results = game.play();
            assert_same(&results, &expected[game.tick - 1], &format!("tick {}, {rollbacks} rollbacks", game.tick - 1));
            saved.splice(game.tick..(game.tick + 1).min(saved.len()), [game.save()]);
        }
    }
    assert_eq!(saved.len(), TICKS + 1, "the whole game was played");
}

#[test]
fn without_the_history_the_same_rollback_changes_what_follows() {
    let expected = straight();
    let mut different = 0;
    for from in (10..TICKS - 10).step_by(20) {
        let mut game = Game::new();
        (0..from).for_each(|_| _ = game.play());
        let saved = game.save();
        (0..6).for_each(|_| _ = game.play());
        game.go_back(&saved);
        different += (0..6).filter(|_| game.play() != expected[game.tick - 1]).count();
    }
    assert!(different > 10, "only {different} ticks differ");
}
