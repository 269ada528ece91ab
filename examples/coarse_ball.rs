//! A coarse ball rolls over another one, once as flat triangles and once as a smooth surface, and the app prints how far
//! the contacts are from those of true balls.
//!
//! `cargo run --release --example coarse_ball -- [options]`; `--help` lists the options.

use std::{
    f32::consts::TAU,
    io::{self, Write},
    process::ExitCode,
};

use bevy_app::prelude::*;
use bevy_circumsphere::{CircumsphereSettings, prelude::*};
use bevy_ecs::{prelude::*, system::RunSystemOnce};
use bevy_transform::components::Transform;
use circumsphere_examples::headless::{
    BAD_INPUT, detect, headless_app,
    recording::{Recorder, RecordingOptions},
};
use circumsphere_support::scenes::{cad_box, icosphere};
use clap::Parser;
use glam::{Quat, Vec3};

/// Radius of the ball that rolls, and of the one that it rolls over.
const RADII: [f32; 2] = [0.6, 1.0];

/// Distance of the true balls.
const GAP: f32 = 0.02;

/// Half the contact distance, above the error of the flat triangles.
const THICKNESS: SurfaceThickness = SurfaceThickness::World(0.08);

/// The rolling ball turns around a tilted axis, so that no two ticks are alike.
const START: Vec3 = Vec3::new(0.35, 1.0, 0.2);

/// Watch a coarse ball collide like a ball.
#[derive(Parser, Debug)]
#[command(name = "coarse_ball")]
struct Options {
    /// Number of ticks in which the ball rolls around the other one
    #[arg(long, value_name = "N", default_value_t = 60, value_parser = clap::value_parser!(u16).range(1..=10_000))]
    ticks: u16,
    /// Instead of balls, show a mesh that does not fit a smooth body: a box with narrow rounded edges
    #[arg(long)]
    unfit: bool,
    #[command(flatten)]
    recording: RecordingOptions,
}

/// Two balls of one shape.
struct Balls {
    rolling: Entity,
    below: Entity,
    center: Vec3,
}

impl Balls {
    fn spawn(app: &mut App, shape: SurfaceShape, center: Vec3) -> Result<Self> {
        let [rolling, below] = RADII.map(|radius| {
            let mesh = icosphere(1, radius);
            let positions: Vec<Vec3> = mesh.positions.into_iter().map(Vec3::from_array).collect();
            let surface = DeformableSurface::from_mesh(&positions, &mesh.triangles)?;
            let name = Name::new(format!("{shape:?} ball of radius {radius}").to_lowercase());
            Ok::<_, BevyError>(
                app.world_mut().spawn((surface, shape, THICKNESS, name, Transform::from_translation(center))).id(),
            )
        });
        Ok(Self { rolling: rolling?, below: below?, center })
    }

    /// Rolls to where the true balls are a gap apart. `turned` is from 0 to 1.
    fn roll(&self, app: &mut App, turned: f32) {
        let direction = Quat::from_rotation_z(-TAU * turned) * START.normalize();
        if let Some(mut pose) = app.world_mut().get_mut::<Transform>(self.rolling) {
            pose.translation = self.center + direction * (RADII[0] + RADII[1] + GAP);
            pose.rotation = Quat::from_rotation_z(-TAU * turned * (1.0 + RADII[1] / RADII[0]));
        }
    }

    /// How far the least contact is from that of the true balls, and by how many degrees its normal is off.
    fn error(&self, app: &mut App) -> Option<[f32; 2]> {
        let (rolling, below, center) = (self.rolling, self.below, self.center);
        let least = move |contacts: SurfaceContacts, poses: Query<&Transform>| {
            let direction = (poses.get(rolling).ok()?.translation - center).normalize();
            let least = contacts.between(below, rolling).min_by(|a, b| a.distance().total_cmp(&b.distance()))?;
            let angle = least.normal().angle_between(direction).to_degrees();
            Some([(least.distance() - GAP).abs(), angle])
        };
        app.world_mut().run_system_once(least).ok().flatten()
    }
}

/// A box, flat and smooth, each under a small ball. The patches of its large faces follow the normals of narrow strips.
fn show_unfit(options: &Options) -> Result {
    let recorder = options.recording.rerun.as_deref().map(|path| options.recording.recorder(path)).transpose()?;
    let plugins = DeformableCollisionPlugins::new(Update).build();
    let settings = CircumsphereSettings::default();
    let mut app = headless_app(plugins, settings, recorder.unwrap_or_else(Recorder::default));
    let mesh = cad_box(0.1, 2);
    let positions: Vec<Vec3> = mesh.positions.into_iter().map(Vec3::from_array).collect();
    for (shape, x) in [(SurfaceShape::Flat, -1.5), (SurfaceShape::Smooth, 1.5)] {
        let surface = DeformableSurface::from_mesh(&positions, &mesh.triangles)?;
        let name = Name::new(format!("{shape:?} box").to_lowercase());
        let unevenness = surface.0.topology().unevenness(&positions, settings.crease_angle);
        println!("{name}: unevenness {unevenness:.2}; above 0.7, smooth surfaces do not fit");
        app.world_mut().spawn((surface, shape, THICKNESS, name, Transform::from_xyz(x, 0.0, -0.8 * x)));
        let ball = Transform::from_xyz(x, 1.25, -0.8 * x);
        app.world_mut().spawn((RigidShape(SharedShape::ball(0.2)), ball));
    }
    detect(&mut app);
    Ok(())
}

fn play(options: &Options) -> Result {
    let recorder = options.recording.rerun.as_deref().map(|path| options.recording.recorder(path)).transpose()?;
    let plugins = DeformableCollisionPlugins::new(Update).build();
    let mut app = headless_app(plugins, CircumsphereSettings::default(), recorder.unwrap_or_else(Recorder::default));
    let flat = Balls::spawn(&mut app, SurfaceShape::Flat, Vec3::new(-1.0, 0.0, 0.8))?;
    let smooth = Balls::spawn(&mut app, SurfaceShape::Smooth, Vec3::new(1.0, 0.0, -0.8))?;
    let mut sums = [[0.0; 2]; 2];
    let mut lines = io::stdout().lock();
    writeln!(lines, "A ball of 80 triangles rolls over another one, {GAP} apart.\n")?;
    writeln!(lines, "tick  flat: distance off  normal off  smooth: distance off  normal off")?;
    for tick in 0..options.ticks {
        for balls in [&flat, &smooth] {
            balls.roll(&mut app, f32::from(tick) / f32::from(options.ticks));
        }
        detect(&mut app);
        let errors = [&flat, &smooth].map(|balls| balls.error(&mut app).unwrap_or([f32::NAN; 2]));
        for (sum, error) in sums.as_flattened_mut().iter_mut().zip(errors.as_flattened()) {
            *sum += error / f32::from(options.ticks);
        }
        let [[a, b], [c, d]] = errors;
        writeln!(lines, "{:4}  {a:18.4}  {b:9.2}°  {c:20.4}  {d:9.2}°", tick + 1)?;
    }
    let [[a, b], [c, d]] = sums;
    writeln!(lines, "mean  {a:18.4}  {b:9.2}°  {c:20.4}  {d:9.2}°")?;
    Ok(())
}

fn main() -> ExitCode {
    let options = Options::parse();
    match if options.unfit { show_unfit(&options) } else { play(&options) } {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(BAD_INPUT)
        }
    }
}
