//! A tick stays within its byte budget, and layers that do not fit are thinned evenly.
//!
//! The sizes are those of an uncompressed file with each row in a chunk of its own. Ticks that are far apart in time
//! are written like that. Faster ones share the overhead of chunks.

use std::collections::BTreeMap;

use bevy_app::prelude::*;
use bevy_circumsphere::{
    debug::{LevelOfDetail, RerunSettings},
    prelude::*,
};
use bevy_time::TimePlugin;
use rerun::{
    external::re_log_encoding::rrd::{Encoder, EncodingOptions},
    log::LogMsg,
};

use crate::{
    recording::{Recording, Row, path},
    world::{Made, Recorded, Scene, everything, nothing},
};

/// The size of the rows of one kind.
#[derive(Clone, Copy, Debug, Default)]
struct Taken {
    rows: usize,
    /// Bytes as encoded.
    bytes: usize,
    /// Bytes of the numbers alone.
    numbers: usize,
    /// The largest number of bytes that one row takes in addition to its numbers.
    most_beside: usize,
}

/// The bytes of a tick's rows, by the first part of their path. `cleared` is for removed entities, `timeless` for rows
/// that are recorded once, and `answer` for the curves that follow after the response.
fn taken(recording: &Recording) -> BTreeMap<String, Taken> {
    let mut encoder =
        Encoder::new_eager(rerun::build_info().version, EncodingOptions::PROTOBUF_UNCOMPRESSED, Vec::new())
            .expect("memory can be written to");
    let mut taken: BTreeMap<String, Taken> = BTreeMap::new();
    for message in recording.messages.iter().filter(|message| message.store_id().is_recording()) {
        let bytes = encoder.append(message).expect("the message can be encoded") as usize;
        if !matches!(message, LogMsg::ArrowMsg(..)) {
            continue;
        }
        let single = Recording::of(vec![message.clone()]);
        let [row] = single.rows.as_slice() else { panic!("a chunk of a tick has {} rows", single.rows.len()) };
        let kind = if row.times.is_empty() {
            "timeless"
        } else if single.clears().len() == 1 {
            "cleared"
        } else if row.path.starts_with(&path(&["series", "depths"])) {
            "answer"
        } else {
            row.path[0].as_str()
        };
        let numbers = row.components.bytes();
        let of_kind = taken.entry(kind.to_owned()).or_default();
        of_kind.rows += 1;
        of_kind.bytes += bytes;
        of_kind.numbers += numbers;
        of_kind.most_beside = of_kind.most_beside.max(bytes - numbers);
    }
    taken
}

/// The bytes that are recorded whatever the budget, and all others.
fn split(taken: &BTreeMap<String, Taken>) -> (usize, usize) {
    let is_always = |kind: &str| ["timeless", "cleared", "series", "answer", "log"].contains(&kind);
    let sum = |always: bool| {
        taken.iter().filter(|(kind, _)| is_always(kind) == always).map(|(_, taken)| taken.bytes).sum::<usize>()
    };
    (sum(true), sum(false))
}

/// Every tick of the scene and what it takes, with a clock and with names as games use them.
fn ticks(settings: &RerunSettings, count: u32) -> Vec<(Recording, BTreeMap<String, Taken>)> {
    let mut recorded = Recorded::with(settings.clone(), DeformableCollisionPlugins::new(Update), |app| {
        app.add_plugins(TimePlugin);
    });
    let scene = Scene::spawn(&mut recorded.app, ContactMethod::Circumsphere);
    let tick = |tick| {
        scene.advance(&mut recorded.app, tick);
        recorded.tick();
        let taken = taken(&recorded.last);
        (std::mem::take(&mut recorded.last), taken)
    };
    (0..count).map(tick).collect()
}

/// The number of instances in each layer. Meshes and shapes are recorded whole or not at all, so they count as one
/// each.
fn instances(recording: &Recording) -> BTreeMap<String, usize> {
    let mut instances = BTreeMap::new();
    for row in recording.below(&[]).into_iter().filter(|row| !row.times.is_empty()) {
        let layer = row.path[0].as_str();
        let count = match layer {
            "series" | "log" => continue,
            "meshes" | "shapes" => 1,
            "contacts" if row.path[1] != "points" => continue,
            "cones" => row.components.wholes("triangle").len(),
            _ => row.components.longest(),
        };
        *instances.entry(layer.to_owned()).or_insert(0) += count;
    }
    instances.retain(|_, count| *count > 0);
    instances
}

const BUDGETS: [usize; 7] = [0, 1 << 10, 20 << 10, 60 << 10, 120 << 10, 250 << 10, 400 << 10];

#[test]
fn no_tick_takes_more_than_it_may_and_what_is_left_out_is_told() {
    let settings = RerunSettings { times: false, ..everything() };
    let whole = ticks(&settings, 3);
    let least_needed = whole.iter().map(|(_, taken)| split(taken).1).min().expect("there are ticks");
    assert!(least_needed > 500_000, "{least_needed} bytes are too few for the budgets to matter");
    for budget in BUDGETS {
        let mut warned: Vec<String> = Vec::new();
        for ((recording, taken), (whole, _)) in
            ticks(&RerunSettings { bytes_per_tick: budget, ..settings.clone() }, 3).iter().zip(&whole)
        {
            let (_, layers) = split(taken);
            let with_curves = layers + taken["series"].bytes;
            let may = budget.max(taken["series"].bytes);
            assert!(with_curves <= may, "{with_curves} bytes instead of at most {may}: {taken:#?}");
            if budget >= 120 << 10 {
                assert!(with_curves > budget / 2, "only {with_curves} of {budget} bytes are used");
            }
            for row in recording.of_entity(&["log", "warnings"]) {
                for line in row.components.texts("TextLog:text")[0].lines() {
                    warned.push(line.replace('_', " "));
                }
            }
            let (found, expected) = (instances(recording), instances(whole));
            for (layer, &expected) in &expected {
                let found = found.get(layer).copied().unwrap_or(0);
                let is_warned = warned.iter().any(|line| line.contains(&layer.replace('_', " ")));
                // A mesh that was left out before may be recorded later, in a tick with room for it.
                assert!(found <= expected || layer == "meshes" || layer == "shapes", "{layer}: {found} of {expected}");
                assert!(
                    found >= expected || is_warned,
                    "{found} of {expected} {layer} with {budget} bytes: {warned:?}"
                );
            }
            assert!(!found.contains_key("tree") || budget > 0);
        }
        assert!(!warned.is_empty());
    }
}

#[test]
fn a_budget_that_suffices_leaves_nothing_out() {
    let of = |bytes_per_tick| {
        let settings = RerunSettings { times: false, bytes_per_tick, ..RerunSettings::everything() };
        let rows = |(recording, _): (Recording, _)| -> Vec<_> {
            let id = rerun::log::RowId::ZERO;
            recording.rows.into_iter().map(|row| Row { id, times: BTreeMap::new(), ..row }).collect()
        };
        ticks(&settings, 4).into_iter().flat_map(rows).collect::<Vec<Row>>()
    };
    let (enough, unlimited) = (of(RerunSettings::default().bytes_per_tick), of(usize::MAX));
    assert!(unlimited.len() > 200, "{} rows", unlimited.len());
    assert!(enough == unlimited);
    assert!(!enough.iter().any(|row| row.path.last().is_some_and(|part| part == "warnings")));
}

#[test]
fn what_no_longer_fits_as_a_whole_is_not_shown_as_it_was() {
    let mut recorded = Recorded::new(RerunSettings { bytes_per_tick: 1 << 20, ..nothing() });
    recorded.settings().meshes = LevelOfDetail::All;
    recorded.settings().shapes = true;
    let scene = Scene::spawn(&mut recorded.app, ContactMethod::Exact);
    let shown =
        |recorded: &Recorded| [recorded.viewer.below(&["meshes"]).len(), recorded.viewer.below(&["shapes"]).len()];
    recorded.tick();
    assert_eq!(shown(&recorded), [3, 2]);
    recorded.settings().bytes_per_tick = 100;
    recorded.tick();
    assert_eq!(shown(&recorded), [3, 2], "nothing has changed, so there is nothing to record");
    scene.advance(&mut recorded.app, 0);
    recorded.tick();
    // Everything except the floor has changed.
    assert_eq!(shown(&recorded), [0, 1]);
    recorded.tick();
    assert!(recorded.last.clears().is_empty());
    recorded.settings().bytes_per_tick = 1 << 20;
    recorded.tick();
    assert_eq!(shown(&recorded), [3, 2]);
    assert!(recorded.viewer.below(&["meshes"]).values().all(|mesh| mesh.has("Mesh3D:triangle_indices")));
}

#[test]
fn what_is_thinned_is_spread_evenly_over_a_layer() {
    let settings = RerunSettings { curvature: LevelOfDetail::All, ..nothing() };
    let mut thinned = 0;
    for budget in [0, 6_000, 9_000, 12_000, 20_000, 25_000, 30_000, 40_000, 100_000] {
        let mut recorded = Recorded::new(RerunSettings { bytes_per_tick: budget, ..settings.clone() });
        let scene = Scene::spawn(&mut recorded.app, ContactMethod::Circumsphere);
        recorded.tick();
        let (mut kept, mut counts, mut before) = (Vec::new(), Vec::new(), 0);
        for (name, entity) in scene.surfaces() {
            let shown = recorded.viewer.of(&["curvature", name]);
            let triangles = shown.map(|shown| shown.wholes("triangle")).unwrap_or_default();
            let count = recorded.app.world().get::<Made>(entity).expect("the entity has its mesh").0.triangles.len();
            kept.extend(triangles.iter().map(|&triangle| before + triangle as usize));
            counts.push((triangles.len(), count));
            before += count;
        }
        let all = before;
        if kept.is_empty() {
            assert!(budget <= 9_000, "{budget} bytes are enough for one triangle");
            continue;
        }
        let share = kept.len() as f64 / all as f64;
        for (kept, count) in counts {
            assert!((kept as f64 - share * count as f64).abs() <= 1.0, "{kept} of {count}, but the share is {share}");
        }
        let widest = all.div_ceil(kept.len());
        // The layer counts as a ring: the gaps at both ends count together.
        let around = kept[0] + all - kept[kept.len() - 1];
        let gaps: Vec<usize> = kept.windows(2).map(|pair| pair[1] - pair[0]).chain([around]).collect();
        assert!(gaps.iter().all(|gap| (1..=widest).contains(gap)), "{budget}: {gaps:?}");
        assert_eq!(kept.len() == all, budget == 100_000, "{} of {all} with {budget}", kept.len());
        thinned += usize::from(kept.len() < all);
    }
    assert!(thinned >= 5, "only {thinned} budgets thin the layer");
}

#[test]
fn curves_log_and_removal_take_what_the_documentation_says() {
    // Curves of eight surfaces that jitter, each in a chunk of its own.
    let mut most = 0;
    for (_, taken) in &ticks(&RerunSettings { bytes_per_tick: 0, ..everything() }, 6)[1..] {
        let (always, layers) = split(taken);
        assert_eq!(layers, 0);
        most = most.max(always);
    }
    assert!((20_000..100_000).contains(&most), "{most} bytes are always recorded");
    // Ticks within the batcher's fifth of a second share their chunks.
    let mut recorded = Recorded::new(RerunSettings { bytes_per_tick: 0, ..everything() });
    let scene = Scene::spawn(&mut recorded.app, ContactMethod::Circumsphere);
    for tick in 0..60 {
        scene.advance(&mut recorded.app, tick);
        recorded.app.update();
    }
    let messages = recorded.storage.take();
    let mut encoder =
        Encoder::new_eager(rerun::build_info().version, EncodingOptions::PROTOBUF_UNCOMPRESSED, Vec::new())
            .expect("memory can be written to");
    let recording = messages.iter().filter(|message| message.store_id().is_recording());
    let bytes: usize = recording.map(|message| encoder.append(message).expect("it can be encoded") as usize).sum();
    let shared = bytes / 60;
    println!("always recorded: {most} bytes a tick in chunks of its own, {shared} in shared ones");
    assert!(shared < most / 8, "{shared} bytes a tick");
}

#[test]
#[ignore = "prints the figures of the documentation"]
fn print_bytes_of_each_layer() {
    for (label, settings) in [("default", RerunSettings::default()), ("everything", everything())] {
        let (_, taken) = &ticks(&settings, 4)[3];
        println!("{label}: always, and layers: {:?}", split(taken));
        for (kind, taken) in taken {
            println!("  {kind}: {taken:?}");
        }
    }
}
