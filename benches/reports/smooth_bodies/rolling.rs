//! A ball that rolls over coarse meshes at a constant distance from the bodies that they stand for: how much the
//! measured distance and normal ripple.

use std::f64::consts::TAU;

use bevy_circumsphere::ContactMethod;
use circumsphere_reports::statistics::mean;
use circumsphere_truth::{BodyShape, SmoothBody};
use glam::{DMat3, DVec3};
use serde::Serialize;

use super::{
    bodies::Body,
    measure::{Player, SHAPES, degrees_between},
    scenes::Moment,
};

/// Level of both meshes: about 320 triangles.
pub const LEVEL: u32 = 1;

/// Radius of the ball.
pub const BALL: f64 = 0.25;

/// Distance from the body, and contact distance, in mean edges of both meshes.
pub const GAP: f64 = 0.05;
const CONTACT_DISTANCE: f64 = 0.8;

/// The bodies, of size 1, and how often the path goes around the tube of the torus.
pub const GROUNDS: [(&str, BodyShape); 3] = [
    ("ball", BodyShape::Ball(1.0)),
    ("ellipsoid", BodyShape::Ellipsoid(DVec3::new(1.0, 0.7, 0.5))),
    ("torus", BodyShape::Torus(0.75, 0.25)),
];
const TUBE_TURNS: f64 = 3.0;

/// One surface shape on one ground. Distances are in edges, angles in degrees.
#[derive(Clone, Debug, Serialize)]
pub struct RollingRow {
    pub ground: &'static str,
    pub method: String,
    pub shape: String,
    pub triangles: f64,
    pub edge: f64,
    pub ticks: usize,
    /// Ticks without a contact. They have no error.
    pub lost_ticks: usize,
    /// Mean error of the distance: how much too far.
    pub offset_edges: Option<f64>,
    /// Standard deviation of the error of the distance along the path.
    pub ripple_edges: Option<f64>,
    /// The same in sizes: half of the body's longest extent.
    pub ripple: Option<f64>,
    /// Standard deviation of the normal's angle towards the direction of travel.
    pub normal_ripple_degrees: Option<f64>,
    /// Largest angle between the normal and the true one.
    pub normal_max_degrees: Option<f64>,
    /// Errors along the path: how much too far in edges, and the angle towards the direction of travel.
    #[serde(skip)]
    pub path: Vec<Option<[f64; 2]>>,
}

/// A point from which the closest point of the ground is a share of the path along.
fn above(shape: BodyShape, share: f64) -> DVec3 {
    let angle = TAU * share;
    match shape {
        BodyShape::Torus(major, minor) => {
            let tube = TUBE_TURNS * angle + 0.3;
            let out = major + 1.5 * minor * tube.cos();
            DVec3::new(out * angle.cos(), 1.5 * minor * tube.sin(), out * angle.sin())
        }
        // A great circle that follows no edges.
        _ => {
            DMat3::from_rotation_x(0.9) * DMat3::from_rotation_y(0.5) * DVec3::new(angle.cos(), angle.sin(), 0.0) * 2.0
        }
    }
}

fn deviation(values: &[f64]) -> Option<f64> {
    let middle = mean(values.iter().copied())?;
    mean(values.iter().map(|value| (value - middle).powi(2))).map(f64::sqrt)
}

/// Rolls the ball over one ground, flat and smooth.
pub fn measure(ground: &(&'static str, BodyShape), ticks: usize, method: ContactMethod) -> [RollingRow; 2] {
    let &(name, shape) = ground;
    let still = |shape| SmoothBody { shape, rotation: DMat3::IDENTITY, center: DVec3::ZERO };
    let body = still(shape);
    let at_rest = Moment { first: Body::Closed(body), second: still(BodyShape::Ball(BALL)) };
    let meshes = at_rest.meshes(LEVEL);
    let edge = at_rest.mean_edge(&meshes);
    let mut players = SHAPES.map(|shape| Player::new(&meshes, &at_rest, method, shape));
    let mut paths: [Vec<Option<[f64; 2]>>; 2] = [Vec::new(), Vec::new()];
    let (mut normal_max, mut rotation) = ([0.0_f64; 2], DMat3::IDENTITY);
    let feet: Vec<_> = (0..=ticks).map(|tick| body.foot(above(shape, tick as f64 / ticks as f64))).collect();
    for players in &mut players {
        players.set_contact_distance(CONTACT_DISTANCE * edge);
    }
    for pair in feet.windows(2) {
        let (foot, next) = (pair[0], pair[1]);
        let center = foot.point + foot.normal * (BALL + GAP * edge);
        let moment = Moment { second: SmoothBody { rotation, center, ..at_rest.second }, ..at_rest };
        let truth = moment.truth();
        let travel = (next.point - foot.point).reject_from(truth.normal).normalize();
        let positions = moment.positions(&meshes);
        for (number, player) in players.iter_mut().enumerate() {
            player.tick(&positions);
            paths[number].push(player.least().map(|(distance, normal)| {
                normal_max[number] = normal_max[number].max(degrees_between(normal, truth.normal));
                let along = normal.dot(travel).atan2(normal.dot(truth.normal)).to_degrees();
                [(distance - truth.distance) / edge, along]
            }));
        }
        let axis = truth.normal.cross(travel);
        rotation = DMat3::from_axis_angle(axis, next.point.distance(foot.point) / BALL) * rotation;
    }
    let mut paths = paths.into_iter().zip(normal_max);
    SHAPES.map(|shape| {
        let (path, normal_max) = paths.next().expect("there is one for each shape");
        let [distances, angles] =
            [0, 1].map(|place| -> Vec<f64> { path.iter().flatten().map(|at| at[place]).collect() });
        let ripple_edges = deviation(&distances);
        RollingRow {
            ground: name,
            method: format!("{method:?}"),
            shape: format!("{shape:?}"),
            triangles: 0.5 * (meshes[0].triangles.len() + meshes[1].triangles.len()) as f64,
            edge,
            ticks,
            lost_ticks: path.iter().filter(|at| at.is_none()).count(),
            offset_edges: mean(distances.iter().copied()),
            ripple_edges,
            ripple: ripple_edges.map(|ripple| ripple * edge),
            normal_ripple_degrees: deviation(&angles),
            normal_max_degrees: (!angles.is_empty()).then_some(normal_max),
            path,
        }
    })
}
