//! Rigid bodies that contacts push, from part to part of a tick.

use bevy_ecs::prelude::*;
use glam::{DAffine3, DMat3, DVec3};

use super::{Motions, course::Stand};
use crate::{
    kernel::{
        pose::Pose,
        xpbd::{Deviation, RigidBodies, RigidBody},
    },
    response::rigid_body::{RigidMass, RigidPart, RigidPush},
};

/// A rigid body in a tick.
#[derive(Clone, Debug)]
pub(super) struct Pushed {
    mass: RigidMass,
    /// Its shapes, with the center of mass in their frames.
    shapes: Vec<(Entity, DVec3)>,
    /// Its deviation in the parts that are over, and the velocities of that.
    deviation: Deviation,
    velocity: [DVec3; 2],
    /// Its number in the solver, in this part.
    number: Option<u32>,
}

/// A pose, deviated about a center of mass.
fn deviated(pose: &Pose, center: DVec3, deviation: &Deviation) -> Pose {
    if *deviation == Deviation::default() {
        return *pose;
    }
    let Deviation { translation, rotation } = *deviation;
    let center = pose.transform_point(center);
    let motion = DAffine3::from_translation(center + translation)
        * DAffine3::from_quat(rotation)
        * DAffine3::from_translation(-center);
    Pose::from_double_affine(&(motion * pose.to_affine())).unwrap_or(*pose)
}

impl Pushed {
    /// What the tick did to it.
    fn push(&self) -> RigidPush {
        let [velocity, angular_velocity] = self.velocity.map(DVec3::as_vec3);
        let Deviation { translation, rotation } = self.deviation;
        RigidPush { velocity, angular_velocity, translation: translation.as_vec3(), rotation: rotation.as_quat() }
    }

    fn deviate(&self, stand: &mut Stand, center: DVec3) {
        stand.pose = deviated(&stand.pose, center, &self.deviation);
    }
}

/// Which entities are rigid bodies that contacts push.
pub(super) type Masses<'w, 's> = (Query<'w, 's, &'static RigidMass>, Query<'w, 's, &'static RigidPart>);

impl Motions {
    /// Finds the rigid body of a shape that the game has put at a pose. Returns whether there is one.
    pub(super) fn weigh(&mut self, shape: Entity, pose: &Pose, (masses, parts): &Masses<'_, '_>) -> bool {
        let entity = parts.get(shape).map_or(shape, |part| part.0);
        let Ok(mass) = masses.get(entity) else { return false };
        if !mass.is_usable() {
            if self.massless.insert(entity) {
                log::warn!("rigid body {entity} is not pushed: its RigidMass is negative or not finite: {mass:?}");
            }
            return false;
        }
        self.massless.remove(&entity);
        let pushed = self.pushed.entry(entity).or_insert_with(|| Pushed {
            mass: *mass,
            shapes: Vec::new(),
            deviation: Deviation::default(),
            velocity: [DVec3::ZERO; 2],
            number: None,
        });
        pushed.shapes.push((shape, pose.inverse().transform_point(mass.center_of_mass.as_dvec3())));
        true
    }

    /// Hands bodies that are near something to the solver, for a part of the tick. Calls `add` with every shape and the number
    /// of its body.
    pub(in crate::response) fn hand_over(&mut self, bodies: &mut RigidBodies, mut add: impl FnMut(Entity, u32)) {
        let Self { pushed, courses, .. } = self;
        for Pushed { mass, shapes, velocity, number, .. } in pushed.values_mut() {
            let mut near = shapes.iter().filter_map(|(shape, center)| Some((courses.get(shape)?, *center)));
            *number = near.next().map(|(course, center)| {
                let center = [&course.now, &course.ahead].map(|stand| stand.pose.transform_point(center));
                let &mut RigidMass { inverse_mass, inverse_inertia, .. } = mass;
                let inverse_inertia = DMat3::from_cols_array(&inverse_inertia.to_cols_array().map(f64::from));
                bodies.push(RigidBody {
                    inverse_mass: inverse_mass.as_dvec3(),
                    inverse_inertia,
                    center,
                    velocity: *velocity,
                })
            });
            if let Some(number) = *number {
                for &(shape, _) in &*shapes {
                    add(shape, number);
                }
            }
        }
    }

    /// Notes where a solution has moved rigid bodies.
    pub(in crate::response) fn push(&mut self, bodies: &RigidBodies) {
        let Self { pushed, courses, .. } = self;
        for (Pushed { shapes, .. }, number) in pushed.values().filter_map(|pushed| Some((pushed, pushed.number?))) {
            let (deviation, _) = bodies.state(number);
            for (shape, center) in shapes {
                if let Some(course) = courses.get_mut(shape) {
                    course.pushed = Some(deviated(&course.ahead.pose, *center, &deviation));
                }
            }
        }
    }

    /// Ends a part of the tick: what the last solution did stays.
    pub(in crate::response) fn keep_pushed(&mut self, bodies: &RigidBodies) {
        let Self { pushed, courses, .. } = self;
        for Pushed { deviation, velocity, number, .. } in pushed.values_mut() {
            let Some(number) = number.take() else { continue };
            let (next, speeds) = bodies.state(number);
            (*deviation, *velocity) = (deviation.followed_by(next), speeds);
        }
        for course in courses.values_mut() {
            if let Some(pose) = course.pushed.take() {
                course.ahead.pose = pose;
            }
        }
    }

    /// Moves the ends of paths in the part that begins by what earlier parts have pushed.
    pub(super) fn look_ahead_pushed(&mut self) {
        let Self { pushed, courses, .. } = self;
        for pushed in pushed.values() {
            for (shape, center) in &pushed.shapes {
                if let Some(course) = courses.get_mut(shape) {
                    pushed.deviate(&mut course.ahead, *center);
                }
            }
        }
    }

    /// Ends the tick: writes the pushes, and remembers where they have moved shapes.
    pub(in crate::response) fn end_pushes(&mut self, pushes: &mut Query<(Entity, &mut RigidPush)>) {
        let Self { pushed, traces, .. } = self;
        for pushed in pushed.values() {
            for (shape, center) in &pushed.shapes {
                if let Some(trace) = traces.get_mut(shape) {
                    pushed.deviate(&mut trace.stand, *center);
                }
            }
        }
        for (entity, mut push) in pushes {
            push.set_if_neq(pushed.get(&entity).map(Pushed::push).unwrap_or_default());
        }
    }
}
