//! The window of the demo: what Bevy draws, the camera, keys, and pictures.

mod camera;
mod look;
mod overlay;
mod pictures;

use bevy::{prelude::*, window::PresentMode};
use bevy_circumsphere::debug::DeformableGizmosPlugin;

use crate::{
    Options,
    game::{GamePlugin, Pace},
    headless::{assets, pools},
};

/// Opens the window, and plays the game until it is closed.
pub fn show(options: &Options) -> Result<(), String> {
    if let Some(folder) = &options.screenshots {
        std::fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    }
    let window = Window {
        title: "bevy_circumsphere".to_owned(),
        resolution: (options.size[0], options.size[1]).into(),
        // Who asks for a number of frames does not watch them.
        present_mode: if options.frames.is_some() { PresentMode::AutoNoVsync } else { PresentMode::AutoVsync },
        ..default()
    };
    let plugins = DefaultPlugins
        .set(pools(options.threads))
        .set(AssetPlugin { file_path: assets().display().to_string(), ..default() })
        .set(WindowPlugin { primary_window: Some(window), ..default() });
    let pace = if options.frames.is_some() { Pace::Even } else { Pace::Real };
    let mut app = App::new();
    app.add_plugins((plugins, GamePlugin(pace), DeformableGizmosPlugin)).add_plugins((
        camera::plugin,
        look::plugin,
        overlay::plugin(options),
        pictures::plugin(options),
    ));
    match app.run() {
        AppExit::Success => Ok(()),
        AppExit::Error(code) => Err(format!("the window closed with code {code}")),
    }
}
