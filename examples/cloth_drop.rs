//! A cloth that meets itself falls onto a ball and comes to rest.
#[path = "headless/mod.rs"]
mod headless;
#[path = "scenes/mod.rs"]
mod scenes;

use bevy_circumsphere::{detection::DetectionDiagnostics, response::XpbdDiagnostics};
use scenes::{Variation, cloth_drop::cloth_drop, layers::layers, measure};

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let cells = arguments[2].parse().unwrap();
    let ticks: usize = arguments[3].parse().unwrap();
    let variation = Variation::default();
    let recorder = headless::recording::Recorder::default();
    let mut stage = match arguments[1].as_str() {
        "drop" => cloth_drop(cells, &variation, recorder).stage,
        _ => layers(10, cells, &variation, recorder).stage,
    };
    let mut motion = measure::Motion::default();
    for tick in 0..ticks {
        stage.tick();
        let way = motion.step(&stage);
        if tick % (ticks / 30) == 0 {
            let world = stage.app.world();
            let d = world.resource::<DetectionDiagnostics>();
            let x = world.resource::<XpbdDiagnostics>();
            println!(
                "{tick:5} mean {:.2e} most {:.2e} energy {:9.5} crossings {} contacts {} pressing {} margin {:.4} detect {:?} gather {:?} solve {:?} impacts {} stopped {} left {} guard {:?}",
                way.mean, way.most, measure::energy(&stage), measure::crossings(&stage), x.contacts, x.pressing,
                world.resource::<bevy_circumsphere::CircumsphereSettings>().margin,
                d.total(), x.gathering, x.solving, x.impacts, x.vertices_stopped, x.impacts_remaining, x.guarding
            );
        }
    }
}
