//! rapier's steps, in a program of their own: see `benches/peers/src/steps.rs`.
//!
//! It is started with `steps` and seven arguments: a recording of the cloth, the obstacle (`ball:RADIUS`, or a
//! recording), the thickness or `default`, the mass per area, the number of threads, the number of steps, and a file for
//! the end. After each step it prints a line with `step`, nanoseconds, and the number of substeps, separated by tabs.
//! Before it exits, it writes the last positions of the cloth as a recording.

use std::{
    io::{BufRead, BufReader},
    path::Path,
    process::{Command, Stdio},
};

use bevy_circumsphere::response::XpbdMaterial;
use circumsphere_reports::cloth_scenes::{ClothScene, Obstacle};
use circumsphere_support::{
    recording::{Recording, read_recording, write_recording},
    scenes::Mesh,
};

use super::{super::peers::build_package, Played};

fn write(path: &Path, mesh: &Mesh) -> Result<(), String> {
    let recording = Recording { triangles: mesh.triangles.clone(), frames: vec![mesh.positions.clone()] };
    write_recording(path, &recording).map_err(|error| error.to_string())
}

/// Nanoseconds and substeps of a line that the program has printed.
fn parse(line: &str) -> Option<(f64, u32)> {
    let (nanoseconds, substeps) = line.strip_prefix("step\t")?.split_once('\t')?;
    Some((nanoseconds.parse().ok()?, substeps.parse().ok()?))
}

/// The thickness of rapier's cloth.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Radius {
    /// That of the scene, for the same contact distance as ours.
    OfScene,
    /// Half an edge, which is rapier's default. The obstacle has none.
    Default,
}

/// Plays the scene with this number of threads. `report` receives the number of steps so far.
pub fn play(
    scene: &ClothScene,
    threads: usize,
    radius: Radius,
    mut report: impl FnMut(usize),
) -> Result<Played, String> {
    let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
    let [cloth, obstacle, end] = ["cloth.bin", "obstacle.bin", "end.bin"].map(|name| folder.path().join(name));
    write(&cloth, &scene.cloth)?;
    let mut command = Command::new(build_package()?);
    command.arg("steps").arg(&cloth);
    match &scene.obstacle {
        Obstacle::Ball(radius) => command.arg(format!("ball:{radius:.9e}")),
        Obstacle::Closed(mesh) | Obstacle::Ground(mesh) => {
            write(&obstacle, mesh)?;
            command.arg(&obstacle)
        }
    };
    let steps = scene.fall + scene.measured;
    let mut child = command
        .arg(match radius {
            Radius::OfScene => format!("{:.9e}", scene.thickness),
            Radius::Default => "default".to_owned(),
        })
        .arg(format!("{:.9e}", XpbdMaterial::CLOTH.area_density))
        .args([threads.to_string(), steps.to_string()])
        .arg(&end)
        .stdout(Stdio::piped())
        .spawn()
        .map_err(|error| error.to_string())?;
    let output = child.stdout.take().ok_or("the program has no output")?;
    let mut played = Played::default();
    let mut count = 0;
    for line in BufReader::new(output).lines() {
        let line = line.map_err(|error| error.to_string())?;
        let (nanoseconds, substeps) = parse(&line).ok_or_else(|| format!("unexpected output {line:?}"))?;
        count += 1;
        report(count);
        if count > scene.fall {
            played.milliseconds.push(nanoseconds * 1.0e-6);
            played.substeps.push(substeps);
        }
    }
    let status = child.wait().map_err(|error| error.to_string())?;
    if !status.success() || count != steps {
        return Err(format!("the program ended after {count} of {steps} steps"));
    }
    let mut recording = read_recording(&[end]).map_err(|error| error.to_string())?;
    played.end = recording.frames.pop().ok_or("the program has written no positions")?;
    Ok(played)
}
