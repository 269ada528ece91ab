//! Recorded meshes: every exact method against the reference. Needs the folder of recordings in the environment
//! variable `CIRCUMSPHERE_DATA`. Without it, the tests print a message and are skipped.

use crate::detect::{BAND, BroadPhase, Detector, assert_agrees, crossings_without_near_features, truth};
use bevy_circumsphere::prelude::*;
use circumsphere_support::recording::{read_recording, recordings_folder};
use circumsphere_truth::{exact_weld, mean_edge_length};
use glam::{DVec3, Vec3};
use std::collections::HashSet;

/// The reference takes too long for larger recordings.
const MOST_TRIANGLES: usize = 50_000;

#[test]
fn exact_methods_find_the_pairs_of_the_reference_on_recordings() {
    let Some(folder) = recordings_folder() else { return };
    let mut paths: Vec<_> = std::fs::read_dir(&folder)
        .expect("the folder of recordings can be listed")
        .map(|entry| entry.expect("its entries can be read").path())
        // `NAME.bin` is a recording. `NAME.kind.bin` contains doubles, queries, or answers.
        .filter(|path| path.file_name().is_some_and(|name| name.to_string_lossy().matches('.').count() == 1))
        .filter(|path| path.extension().is_some_and(|extension| extension == "bin"))
        .collect();
    paths.sort();
    let (mut compared, mut hidden_crossings, mut recordings) = (0, 0, 0);
    for path in paths {
        let recording = read_recording(std::slice::from_ref(&path)).expect("the recording is valid");
        if recording.triangles.len() > MOST_TRIANGLES {
            continue;
        }
        recordings += 1;
        let frame =
            |frame: usize| -> Vec<Vec3> { recording.frames[frame].iter().copied().map(Vec3::from_array).collect() };
        let rest = frame(0);
        let wide: Vec<DVec3> = rest.iter().map(|position| position.as_dvec3()).collect();
        let mean_edge = mean_edge_length(&wide, &recording.triangles, &exact_weld(&wide));
        let mut frames = vec![0, recording.frames.len() / 2, recording.frames.len() - 1];
        frames.dedup();
        for edges in [0.02, 0.1, 0.5] {
            let distance = edges * mean_edge;
            let mut refined =
                Detector::new(&rest, &recording.triangles, ContactMethod::Exact, BroadPhase::Tree, distance);
            let mut without_cones = Detector::new(
                &rest,
                &recording.triangles,
                ContactMethod::Exact,
                BroadPhase::TreeWithoutCones,
                distance,
            );
            let mut polygon =
                Detector::new(&rest, &recording.triangles, ContactMethod::Polygon, BroadPhase::Tree, distance);
            let mut closest =
                Detector::new(&rest, &recording.triangles, ContactMethod::Closest, BroadPhase::Tree, distance);
            for &place in &frames {
                let positions = frame(place);
                let what = format!("{} frame {place} at {edges} edges", path.display());
                let truth = truth(&rest, &positions, &recording.triangles, distance);
                let (found, contacts) = refined.detect(&positions);
                assert!(
                    without_cones.detect(&positions) == (found.clone(), contacts),
                    "{what}: normal cones change contacts"
                );
                // The tolerance of separations is relative to the contact distance, which is the stricter bound.
                compared += assert_agrees(&what, &found, &truth, distance, 0.0).matched;
                assert_eq!(found, polygon.detect(&positions).0, "{what}: Exact and Polygon differ");
                let (found, _) = closest.detect(&positions);
                compared += assert_agrees(&what, &found, &truth, distance, 0.0).matched;
                hidden_crossings += crossings_without_near_features(&positions, &recording.triangles, &truth, distance);
            }
        }
    }
    println!("{recordings} recordings, {compared} pairs compared, {hidden_crossings} crossings without near features");
    if recordings > 0 {
        assert!(compared > 0, "no recording had a single touching pair");
    }
}

#[test]
fn the_crumpled_cloth_runs_through_every_method_on_both_frames() {
    let Some(folder) = recordings_folder() else { return };
    let path = folder.join("cloth_ball_92.bin");
    if !path.exists() {
        eprintln!("cloth_ball_92 is not in the folder of recordings: skipped");
        return;
    }
    let recording = read_recording(&[path]).expect("the recording is valid");
    let frames: Vec<Vec<Vec3>> =
        recording.frames.iter().map(|frame| frame.iter().copied().map(Vec3::from_array).collect()).collect();
    let wide: Vec<DVec3> = frames[0].iter().map(|position| position.as_dvec3()).collect();
    let distance = 0.1 * mean_edge_length(&wide, &recording.triangles, &exact_weld(&wide));
    let truths: Vec<_> =
        frames.iter().map(|positions| truth(&frames[0], positions, &recording.triangles, distance)).collect();
    for method in ContactMethod::ALL {
        let mut detector = Detector::new(&frames[0], &recording.triangles, method, BroadPhase::Tree, distance);
        for (frame, (positions, truth)) in frames.iter().zip(&truths).enumerate() {
            let what = format!("frame {frame}, {method:?}");
            let (found, contacts) = detector.detect(positions);
            assert!(
                contacts.iter().all(|contact| contact.normal.is_finite() && contact.distance.is_finite()),
                "{what}"
            );
            let sure = truth.iter().filter(|pair| pair.distance <= distance * (1.0 - BAND));
            let pairs: HashSet<[u32; 2]> = found.iter().map(|pair| [pair.triangle_a, pair.triangle_b]).collect();
            let (mut sure_count, mut missed) = (0, 0);
            for pair in sure {
                sure_count += 1;
                missed += usize::from(!pairs.contains(&[pair.triangle_a, pair.triangle_b]));
            }
            println!("{what}: {} pairs, {missed} of {sure_count} missed", found.len());
            assert!(sure_count > 200_000, "{what}");
            match method {
                ContactMethod::BoundingSphere => assert_eq!(missed, 0, "{what}: enclosing balls miss nothing"),
                // The cone rejects pairs by design: 0.001 of those in the first frame, or 0.13 without widened cones.
                ContactMethod::Circumsphere => assert!(missed < sure_count / 100, "{what}: {missed} missed"),
                ContactMethod::Closest | ContactMethod::Exact | ContactMethod::Polygon => {
                    assert_agrees(&what, &found, truth, distance, 0.0);
                }
            }
        }
    }
}
