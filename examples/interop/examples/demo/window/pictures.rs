//! Saves pictures of the window, and closes it after a number of frames.

use std::path::PathBuf;

use bevy::{
    prelude::*,
    render::view::screenshot::{Screenshot, save_to_disk},
};

use crate::{Options, game::Ready};

/// How many frames to play, and which of them to save.
#[derive(Resource)]
struct Film {
    frames: u32,
    every: u32,
    folder: Option<PathBuf>,
    frame: u32,
}

pub fn plugin(options: &Options) -> impl Fn(&mut App) + Send + Sync + 'static {
    let (frames, every, folder) = (options.frames, options.every, options.screenshots.clone());
    move |app| {
        let Some(frames) = frames else { return };
        app.insert_resource(Film { frames, every, folder: folder.clone(), frame: 0 })
            .add_systems(Update, film.run_if(|ready: Res<Ready>| ready.0));
    }
}

fn film(
    mut commands: Commands,
    mut film: ResMut<Film>,
    mut exit: MessageWriter<AppExit>,
    pending: Query<(), With<Screenshot>>,
) {
    if film.frame == film.frames {
        if pending.is_empty() {
            exit.write(AppExit::Success);
        }
        return;
    }
    film.frame += 1;
    let Some(folder) = film.folder.as_ref().filter(|_| film.frame.is_multiple_of(film.every)) else { return };
    let picture = folder.join(format!("frame_{:05}.png", film.frame));
    commands.spawn(Screenshot::primary_window()).observe(save_to_disk(picture));
}
