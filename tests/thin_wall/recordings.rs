//! Recorded parts with thin walls, and solids without.

use std::{env, path::PathBuf};

use circumsphere_support::{
    recording::{FOLDER_VARIABLE, read_recording},
    scenes::Mesh,
};

use super::{assert_unchanged, find, truth};

/// How many random balls look for lost contacts.
const PROBES: usize = 10_000;

/// A recording, or `None` if there are none.
pub fn recorded(name: &str) -> Option<Mesh> {
    let Some(folder) = env::var_os(FOLDER_VARIABLE) else {
        println!("skipped: {FOLDER_VARIABLE} is not set");
        return None;
    };
    let file = PathBuf::from(folder).join(format!("{name}.bin"));
    let mut recording = read_recording(&[file]).expect("the recording can be read");
    Some(Mesh { positions: recording.frames.swap_remove(0), triangles: recording.triangles })
}

#[test]
fn thin_walled_parts_become_sheets() {
    for (name, most) in [("tray_bottom_thinwall", 0.05), ("hollow_cat", 0.25), ("mat100x100", 0.05)] {
        let Some(mesh) = recorded(name) else { return };
        let (walls, deviation) = find(&mesh);
        let share = walls.abstracted_area / walls.thin_area;
        println!(
            "{name}: thin {:.3}, {share:.3} of it replaced, {} of {} triangles, {:.3} thicknesses",
            walls.thin_area / walls.area_before,
            walls.triangles.len(),
            mesh.triangles.len(),
            deviation.over_thickness
        );
        assert!(walls.thin_area > 0.0, "{name} is thin");
        assert!(share >= 0.9, "{name}: {share}, {:?}", walls.left_out);
        assert!(deviation.over_thickness <= most, "{name}: {deviation:?}");
        truth::probe(name, &mesh, &walls, &deviation, PROBES);
    }
}

#[test]
fn solids_stay_as_they_were() {
    for name in ["bunny_3485", "fandisk"] {
        let Some(mesh) = recorded(name) else { return };
        let (walls, _) = find(&mesh);
        assert_unchanged(&mesh, &walls);
    }
}
