//! A sheet sinks onto a ball, and the app prints when and where they touch.
//!
//! `cargo run --release --example first_contact`

use bevy_app::prelude::*;
use bevy_circumsphere::prelude::*;
use bevy_ecs::prelude::*;
use glam::Vec3;

fn spawn(mut commands: Commands) -> Result {
    let corners = [Vec3::new(-1.0, 1.0, -1.0), Vec3::new(1.0, 1.0, -1.0), Vec3::new(0.0, 1.0, 1.0)];
    commands.spawn((DeformableSurface::from_mesh(&corners, &[[0, 2, 1]])?, ContactEventsEnabled));
    commands.spawn(RigidShape(SharedShape::ball(0.5)));
    Ok(())
}

/// Whatever moves the vertices of a mesh: an animation, a solver, the network.
fn sink(mut sheets: Query<&mut SurfacePositions, With<DeformableSurface>>) {
    for mut positions in &mut sheets {
        positions.0.iter_mut().for_each(|position| position.y -= 0.1);
    }
}

fn announce(mut starts: MessageReader<SurfaceContactStart>, contacts: SurfaceContacts) {
    for start in starts.read() {
        println!("tick {}: {} touches {}", contacts.tick(), start.entity, start.other);
        for contact in contacts.between(start.entity, start.other) {
            println!("  at {} along {}, {} apart", contact.points().0, contact.normal(), contact.distance());
        }
    }
}

fn main() {
    let mut app = App::new();
    app.add_plugins(DeformableCollisionPlugins::new(Update)).add_systems(Startup, spawn);
    app.add_systems(Update, (sink.before(DeformableSystems::Prepare), announce.after(DeformableSystems::Events)));
    (0..10).for_each(|_| app.update());
}
