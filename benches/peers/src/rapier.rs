//! rapier3d's soft bodies with self-contacts on the same mesh: one soft body without cells, whose surface meets itself.
//!
//! A step of no time applies the positions and updates the contacts, and nothing else: that is detection alone, and rapier's
//! own clock tells its narrow phase apart, which for one body is its self-contacts: a sweep for crossing triangles through
//! `Bvh`, then each vertex against faces and each edge against edges within reach. Its skin is half the contact distance on
//! either side. It leaves out faces of a vertex's whole neighborhood, keeps a vertex's nearest faces only, and lets what
//! crosses stand down: it reports fewer contacts. They are counted once, after a step of a little time, because only the
//! solver's lists are public.

use circumsphere_support::recording::Recording;
use rapier3d::prelude::*;

use super::{Counts, Peer, Row, timed, vector};

/// A step so short that nothing moves, after which the contacts can be read.
const MOMENT: f32 = 1.0e-6;

/// Two worlds with the same mesh: a solver leaves something behind that changes what the next detection costs.
pub struct Rapier {
    detecting: World,
    solving: World,
}

struct World {
    world: PhysicsWorld,
    body: SoftBodyHandle,
}

impl World {
    fn new(recording: &Recording, skin: f32) -> Result<Self, String> {
        let vertices = recording.frames[1].iter().copied().map(vector).collect();
        // Elasticity is none of detection's business: no edges to keep, no shape to match.
        let body = SoftBodyBuilder::new(vertices)
            .surface(recording.triangles.clone())
            .self_contacts(true)
            .particle_radius(skin)
            .can_sleep(false);
        let mut world = PhysicsWorld::new();
        world.gravity = Vector::ZERO;
        // Contacts within the skins and no farther.
        world.integration_parameters.normalized_prediction_distance = 0.0;
        world.physics_pipeline.counters.enable();
        world.configure_thread_pool(1).map_err(|error| error.to_string())?;
        let body = world.insert_soft_body(body);
        world.soft_bodies.get(body).ok_or("rapier refuses the soft body")?;
        Ok(Self { world, body })
    }

    fn place(&mut self, positions: &[[f32; 3]]) {
        if let Some(body) = self.world.soft_bodies.get_mut(self.body) {
            for (number, &position) in positions.iter().enumerate() {
                body.set_particle_position(number, vector(position));
                body.set_particle_velocity(number, Vector::ZERO);
            }
        }
    }

    fn step(&mut self, time: f32) {
        self.world.integration_parameters.dt = time;
        self.world.step();
    }

    fn contacts(&self) -> u64 {
        self.world.soft_bodies.get(self.body).map_or(0, |body| {
            let vertices = body.vertex_contact_segments(&self.world.soft_bodies).count();
            let edges = body.edge_contact_segments(&self.world.soft_bodies).count();
            (vertices + edges) as u64
        })
    }
}

impl Rapier {
    pub fn new(recording: &Recording, skin: f32) -> Result<Self, String> {
        Ok(Self { detecting: World::new(recording, skin)?, solving: World::new(recording, skin)? })
    }
}

impl Peer for Rapier {
    fn name(&self) -> String {
        "rapier3d".to_owned()
    }

    fn run(&mut self, before: &[[f32; 3]], now: &[[f32; 3]]) -> Vec<Row> {
        let Self { detecting, solving } = self;
        detecting.place(before);
        detecting.step(0.0);
        detecting.place(now);
        let (detection, ()) = timed(|| detecting.step(0.0));
        let narrow_phase = detecting.world.physics_pipeline.counters.cd.narrow_phase_time.time();
        solving.place(now);
        let (whole, ()) = timed(|| solving.step(MOMENT));
        let counts = Counts { box_pairs: None, contacts: Some(solving.contacts()) };
        let row = |what, duration, counts| Row { what, is_whole: true, duration, counts };
        vec![
            row("a step of no time: colliders and detection", detection, counts),
            row("narrow phase (self-contacts of the soft body)", narrow_phase, counts),
            row("a step of a little time, with its solver", whole, counts),
        ]
    }
}
