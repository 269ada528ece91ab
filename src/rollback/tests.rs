//! Each part of the history is needed: what goes back without it finds something else than the first time.

#[path = "../../tests/rollback/game.rs"]
mod game;

use self::game::{Game, TICKS, straight};
use super::{CollisionHistory, SurfaceHistory};
use crate::response::HISTORY_PARTS;

/// Ticks after which the game goes back.
const AHEAD: usize = 6;

/// A part, and how one history takes it over from another.
type Part = (&'static str, Box<dyn Fn(&mut CollisionHistory, &CollisionHistory)>);

fn parts() -> Vec<Part> {
    let own: [Part; 6] = [
        ("contacts", Box::new(|own, other| own.store = other.store.clone())),
        ("what touches", Box::new(|own, other| own.touching = other.touching.clone())),
        ("poses of shapes", Box::new(|own, other| own.swept = other.swept.clone())),
        ("status", of_surfaces(|own, other| own.status = other.status.clone())),
        ("swept positions", of_surfaces(|own, other| own.previous = other.previous.clone())),
        ("spheres", of_surfaces(|own, other| own.spheres = other.spheres.clone())),
    ];
    let response = HISTORY_PARTS.map(|(name, take_over)| -> Part {
        (name, Box::new(move |own, other| take_over(&mut own.response, &other.response)))
    });
    own.into_iter().chain(response).collect()
}

fn of_surfaces(
    take_over: fn(&mut SurfaceHistory, &SurfaceHistory),
) -> Box<dyn Fn(&mut CollisionHistory, &CollisionHistory)> {
    Box::new(move |own, other| {
        for (entity, own) in &mut own.surfaces {
            take_over(own, &other.surfaces[entity]);
        }
    })
}

/// Nothing changed without them in this game: the direction in which a body leaves a solid is kept once it has been chosen,
/// and would have been chosen again as it was.
const NOT_SHOWN: &str = "ways out of solids";

#[test]
fn each_part_is_needed() {
    let expected = straight();
    let mut game = Game::new();
    let parts = parts();
    let mut different = vec![0; parts.len()];
    let all_that_follows = |game: &mut Game| (0..AHEAD).filter(|_| game.play() != expected[game.tick - 1]).count();
    for from in 1..TICKS - AHEAD {
        _ = game.play();
        let saved = game.save();
        assert_eq!(all_that_follows(&mut game), 0, "nothing has gone back, or all of it has, to before tick {from}");
        let future = game.save().history;
        for ((_, take_over), different) in parts.iter().zip(&mut different) {
            let mut history = saved.history.clone();
            take_over(&mut history, &future);
            game.go_back(&saved);
            game.app.insert_resource(history);
            *different += usize::from(all_that_follows(&mut game) > 0);
        }
        game.go_back(&saved);
        game.app.insert_resource(saved.history);
    }
    let needed = parts.iter().zip(different).map(|((name, _), different)| (*name, different));
    let not_needed: Vec<(&str, usize)> =
        needed.filter(|&(name, different)| different == 0 && name != NOT_SHOWN).collect();
    assert!(not_needed.is_empty(), "without these, nothing changes: {not_needed:?}");
}
