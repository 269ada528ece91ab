//! Scenes: two bodies near each other in random poses, and how they move on from there.

use std::f64::consts::TAU;

use circumsphere_support::random::Random;
use circumsphere_truth::{BodyDistance, BodyShape, SmoothBody};
use glam::{DMat3, DQuat, DVec3};

use super::bodies::{Body, SHEET_HALF, Sheet};

/// Distances of the bodies in mesh edges. Each pose has one of them.
pub const GAPS: [f64; 2] = [0.05, 0.3];

/// How far each body of a pair spins about the normal per tick, in radians.
const SPIN: f64 = 0.01;

/// How fast the axes of the pulsing ellipsoid and the waves of the sheet change, in radians per tick.
const PHASE_STEP: f64 = 0.05;

/// By how much the axes of the pulsing ellipsoid change, as a share of their mean.
const PULSE: f64 = 0.15;

/// Radius of the ball on the sheet: less than the sheet's least radius of curvature.
const SHEET_BALL: f64 = 0.3;

/// Level of the mesh whose vertices start the search for closest points.
const START_LEVEL: u32 = 1;

/// What happens in a scene. The size of every first body, half of its longest extent, is 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    Bodies,
    Deforming,
    Cloth,
}

pub struct Scene {
    pub name: &'static str,
    pub what: &'static str,
    pub kind: Kind,
    /// Shapes at rest. The second is `None` for the sheet's ball.
    shapes: Option<[BodyShape; 2]>,
}

const ELLIPSOID: BodyShape = BodyShape::Ellipsoid(PULSING_AXES);
const PULSING_AXES: DVec3 = DVec3::new(1.0, 0.7, 0.5);

pub const SCENES: [Scene; 7] = [
    Scene {
        name: "balls",
        what: "two balls",
        kind: Kind::Bodies,
        shapes: Some([BodyShape::Ball(1.0), BodyShape::Ball(1.0)]),
    },
    Scene { name: "ellipsoids", what: "two ellipsoids", kind: Kind::Bodies, shapes: Some([ELLIPSOID, ELLIPSOID]) },
    Scene {
        name: "tori",
        what: "two tori",
        kind: Kind::Bodies,
        shapes: Some([BodyShape::Torus(0.7, 0.3), BodyShape::Torus(0.7, 0.3)]),
    },
    Scene {
        name: "capsules",
        what: "two capsules",
        kind: Kind::Bodies,
        shapes: Some([BodyShape::Capsule(0.4, 0.6), BodyShape::Capsule(0.4, 0.6)]),
    },
    Scene {
        name: "ball_ellipsoid",
        what: "an ellipsoid and a ball",
        kind: Kind::Bodies,
        shapes: Some([ELLIPSOID, BodyShape::Ball(0.7)]),
    },
    Scene {
        name: "pulse",
        what: "an ellipsoid whose axes pulse, and a ball",
        kind: Kind::Deforming,
        shapes: Some([ELLIPSOID, BodyShape::Ball(0.7)]),
    },
    Scene {
        name: "cloth",
        what: "a sheet with travelling sine waves, and a ball on either side",
        kind: Kind::Cloth,
        shapes: None,
    },
];

/// Two bodies at one time.
#[derive(Clone, Copy, Debug)]
pub struct Moment {
    pub first: Body,
    pub second: SmoothBody,
}

/// A random pose that touches, from which a gap is opened.
#[derive(Clone, Debug)]
pub struct Pose {
    kind: Kind,
    touching: Moment,
    /// Closest points and normal of the touching bodies.
    contact: BodyDistance,
    phase: f64,
    /// In the sheet's case, where the ball is: x, z, and the side.
    place: [f64; 3],
}

fn direction(random: &mut Random) -> DVec3 {
    let height = 2.0 * random.unit() - 1.0;
    let angle = TAU * random.unit();
    let radius = (1.0 - height * height).sqrt();
    DVec3::new(radius * angle.cos(), height, radius * angle.sin())
}

/// A uniform random rotation (Shoemake 1992).
fn rotation(random: &mut Random) -> DMat3 {
    let [share, first, second] = [(); 3].map(|()| random.unit());
    let ((sine, cosine), (other_sine, other_cosine)) = ((TAU * first).sin_cos(), (TAU * second).sin_cos());
    let [one, other] = [(1.0 - share).sqrt(), share.sqrt()];
    DMat3::from_quat(DQuat::from_xyzw(one * sine, one * cosine, other * other_sine, other * other_cosine).normalize())
}

/// Points of the first body from which the search for the closest ones starts. A ball needs none.
fn starts(first: &Body, second: &SmoothBody) -> Vec<DVec3> {
    match second.shape {
        BodyShape::Ball(_) => Vec::new(),
        _ => first.points(&first.mesh(START_LEVEL)),
    }
}

/// Moves the second body along a direction from the first until it is as far away as asked.
fn approach(first: &Body, mut second: SmoothBody, direction: DVec3, gap: f64) -> (SmoothBody, BodyDistance) {
    const STEPS: usize = 100;
    const PRECISION: f64 = 1.0e-10;
    let starts = starts(first, &second);
    second.center = direction * 3.0;
    let mut found = first.distance(&second, &starts);
    for _ in 0..STEPS {
        if (found.distance - gap).abs() < PRECISION {
            break;
        }
        second.center -= direction * (found.distance - gap);
        found = first.distance(&second, &starts);
    }
    (second, found)
}

fn ellipsoid_at(phase: f64) -> BodyShape {
    let waves = DVec3::new(phase.sin(), (phase + TAU / 3.0).sin(), (phase + 2.0 * TAU / 3.0).sin());
    BodyShape::Ellipsoid(PULSING_AXES * (DVec3::ONE + PULSE * waves))
}

impl Scene {
    /// Both bodies at rest, for meshes and their edges.
    pub fn at_rest(&self) -> Moment {
        let body = |shape| SmoothBody { shape, rotation: DMat3::IDENTITY, center: DVec3::ZERO };
        match self.shapes {
            Some([first, second]) => Moment { first: Body::Closed(body(first)), second: body(second) },
            None => Moment { first: Body::Sheet(Sheet { phase: 0.0 }), second: body(BodyShape::Ball(SHEET_BALL)) },
        }
    }

    /// A random pose. The same number gives the same pose in every run, whatever the resolution.
    pub fn pose(&self, number: usize) -> Pose {
        let seed = self.name.bytes().fold(number as u64, |seed, byte| seed.wrapping_mul(257) + u64::from(byte));
        let mut random = Random::new(seed);
        let mut touching = self.at_rest();
        let phase = TAU * random.unit();
        let from = direction(&mut random);
        touching.second.rotation = rotation(&mut random);
        let along = |random: &mut Random| 0.95 * SHEET_HALF * (2.0 * random.unit() - 1.0);
        let place = [along(&mut random), along(&mut random), if random.unit() < 0.5 { -1.0 } else { 1.0 }];
        let contact = match &mut touching.first {
            Body::Closed(body) => {
                body.rotation = rotation(&mut random);
                if self.kind == Kind::Deforming {
                    body.shape = ellipsoid_at(phase);
                }
                let contact;
                (touching.second, contact) = approach(&touching.first, touching.second, from, 0.0);
                contact
            }
            Body::Sheet(sheet) => {
                sheet.phase = phase;
                touching.second.center = on_sheet(*sheet, place, 0.0);
                touching.first.distance(&touching.second, &[])
            }
        };
        Pose { kind: self.kind, touching, contact, phase, place }
    }
}

/// The center of the ball that is `gap` above or below a place of the sheet.
fn on_sheet(sheet: Sheet, [x, z, side]: [f64; 3], gap: f64) -> DVec3 {
    sheet.point(x, z) + sheet.normal(x) * side * (SHEET_BALL + gap)
}

/// A body turned about an axis through a point.
fn turned(body: SmoothBody, axis: DVec3, point: DVec3, angle: f64) -> SmoothBody {
    let turn = DMat3::from_axis_angle(axis, angle);
    SmoothBody { rotation: turn * body.rotation, center: point + turn * (body.center - point), ..body }
}

impl Pose {
    /// The bodies at a tick, with about the given distance between them in every tick. Tick 0 is the pose itself.
    ///
    /// Bodies of a fixed shape spin about their common normal, in opposite directions: that moves every vertex, and
    /// leaves closest points, distance, and normal of convex bodies where they are. Bodies that change their shape do so
    /// under a ball that keeps its distance.
    pub fn moment(&self, tick: usize, gap: f64) -> Moment {
        let mut moment = self.touching;
        let normal = self.contact.normal;
        let phase = self.phase + PHASE_STEP * tick as f64;
        match (&mut moment.first, self.kind) {
            (Body::Sheet(sheet), _) => {
                sheet.phase = phase;
                moment.second.center = on_sheet(*sheet, self.place, gap);
            }
            (Body::Closed(body), Kind::Deforming) => {
                body.shape = ellipsoid_at(phase);
                let along = moment.second.center.normalize();
                moment.second = approach(&moment.first, moment.second, along, gap).0;
            }
            (Body::Closed(body), _) => {
                let [first, second] = self.contact.points;
                let angle = SPIN * tick as f64;
                *body = turned(*body, normal, first, angle);
                moment.second = turned(moment.second, normal, second, -angle);
                moment.second.center += normal * gap;
            }
        }
        moment
    }
}

impl Moment {
    /// How far the bodies are apart.
    pub fn truth(&self) -> BodyDistance {
        self.first.distance(&self.second, &starts(&self.first, &self.second))
    }
}

impl Kind {
    pub const ALL: [Self; 3] = [Self::Bodies, Self::Deforming, Self::Cloth];

    pub fn name(self) -> &'static str {
        match self {
            Self::Bodies => "closed bodies of a fixed shape",
            Self::Deforming => "a body that deforms",
            Self::Cloth => "a cloth",
        }
    }

    /// File name of its plot, without extension.
    pub fn file(self) -> &'static str {
        match self {
            Self::Bodies => "bodies",
            Self::Deforming => "deforming",
            Self::Cloth => "cloth",
        }
    }
}
