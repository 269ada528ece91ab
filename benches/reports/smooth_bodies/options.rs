//! The command-line options and the values derived from them.

use std::path::PathBuf;

use bevy_circumsphere::ContactMethod;
use circumsphere_examples::headless::method::Method;
use clap::Parser;

use super::scenes::{SCENES, Scene};

/// Measure the time and the errors of flat and smooth surfaces against the bodies that their meshes stand for, and
/// write a report.
#[derive(Parser, Debug)]
#[command(name = "smooth_bodies")]
pub struct Options {
    /// Folder for the report; created if missing
    #[arg(long, value_name = "DIR", default_value = "smooth_bodies")]
    pub out: PathBuf,
    /// Measure fewer poses and three resolutions; takes seconds
    #[arg(long)]
    pub quick: bool,
    /// Measure only these scenes, by name
    #[arg(long, value_name = "NAME,…", value_delimiter = ',')]
    pub scenes: Vec<String>,
    /// Contact methods to measure; the plots show the first
    #[arg(long, value_enum, value_name = "METHOD,…", value_delimiter = ',', default_values_t = [Method::Exact])]
    pub methods: Vec<Method>,
    /// Number of random poses per scene and gap [default: 48; 6 with --quick]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub poses: Option<u32>,
}

#[derive(Debug, thiserror::Error)]
pub enum OptionsError {
    #[error("--scenes {name}: expected one or more of {known}")]
    NoSuchScene { name: String, known: String },
}

impl Options {
    /// The scenes to measure, in order.
    pub fn chosen_scenes(&self) -> Result<Vec<&'static Scene>, OptionsError> {
        if let Some(name) = self.scenes.iter().find(|name| !SCENES.iter().any(|scene| scene.name == *name)) {
            let known = SCENES.map(|scene| scene.name).join(", ");
            return Err(OptionsError::NoSuchScene { name: name.clone(), known });
        }
        let is_chosen = |name: &str| self.scenes.is_empty() || self.scenes.iter().any(|chosen| chosen == name);
        Ok(SCENES.iter().filter(|scene| is_chosen(scene.name)).collect())
    }

    /// The contact methods to measure, in order, each once.
    pub fn contact_methods(&self) -> Vec<ContactMethod> {
        let mut methods: Vec<ContactMethod> = Vec::new();
        for method in self.methods.iter().copied().map(ContactMethod::from) {
            if !methods.contains(&method) {
                methods.push(method);
            }
        }
        methods
    }

    /// Levels of refinement: each has four times the triangles of the one before.
    pub fn levels(&self) -> &'static [u32] {
        if self.quick { &[0, 1, 2] } else { &[0, 1, 2, 3, 4] }
    }

    /// Number of random poses per scene and gap.
    pub fn poses_per_gap(&self) -> usize {
        self.poses.map_or(if self.quick { 6 } else { 48 }, |poses| poses as usize)
    }

    /// Number of timed ticks per pose.
    pub fn timed_ticks(&self) -> usize {
        if self.quick { 2 } else { 4 }
    }

    /// Number of ticks of a rolling ball.
    pub fn rolling_ticks(&self) -> usize {
        if self.quick { 100 } else { 600 }
    }
}
