//! Bodies known in closed form, and meshes whose vertices lie on them.

use std::f64::consts::TAU;

use bevy_circumsphere::geometry::SurfaceTopology;
use circumsphere_support::scenes::{Diagonals, capsule, grid, icosphere, torus};
use circumsphere_truth::{BodyDistance, BodyShape, SmoothBody};
use glam::{DMat3, DVec3, Vec3};

/// Half the side of the sheet: its size.
pub const SHEET_HALF: f64 = 1.0;

/// Amplitude and length of the sheet's waves. Its least radius of curvature is λ² / 4π²a = 0.43.
const SHEET_AMPLITUDE: f64 = 0.15;
const SHEET_WAVE: f64 = 1.6;

/// The square sheet y = a sin(2πx/λ + phase), with x and z from −1 to 1.
#[derive(Clone, Copy, Debug)]
pub struct Sheet {
    pub phase: f64,
}

/// A body at a pose.
#[derive(Clone, Copy, Debug)]
pub enum Body {
    Closed(SmoothBody),
    Sheet(Sheet),
}

/// A mesh of a body, as points of a fixed domain that the body's shape maps onto its surface.
pub struct BodyMesh {
    pub triangles: Vec<[u32; 3]>,
    domain: Vec<DVec3>,
}

impl Sheet {
    fn angle(self, x: f64) -> f64 {
        TAU * x / SHEET_WAVE + self.phase
    }

    fn height(self, x: f64) -> f64 {
        SHEET_AMPLITUDE * self.angle(x).sin()
    }

    fn slope(self, x: f64) -> f64 {
        TAU / SHEET_WAVE * SHEET_AMPLITUDE * self.angle(x).cos()
    }

    pub fn point(self, x: f64, z: f64) -> DVec3 {
        DVec3::new(x, self.height(x), z)
    }

    /// The unit normal that points up.
    pub fn normal(self, x: f64) -> DVec3 {
        DVec3::new(-self.slope(x), 1.0, 0.0).normalize()
    }

    /// The closest point of the sheet: the best of many along a wave, then bisection on the derivative of the distance.
    pub fn closest(self, point: DVec3) -> DVec3 {
        const SAMPLES: u32 = 512;
        let step = 2.0 * SHEET_HALF / f64::from(SAMPLES);
        let distance = |x: f64| (x - point.x).hypot(self.height(x) - point.y);
        let samples = (0..=SAMPLES).map(|sample| f64::from(sample) * step - SHEET_HALF);
        let best = samples.min_by(|&one, &other| distance(one).total_cmp(&distance(other))).expect("there are samples");
        let (mut low, mut high) = ((best - step).max(-SHEET_HALF), (best + step).min(SHEET_HALF));
        for _ in 0..60 {
            let x = 0.5 * (low + high);
            if x - point.x + (self.height(x) - point.y) * self.slope(x) > 0.0 {
                high = x;
            } else {
                low = x;
            }
        }
        self.point(0.5 * (low + high), point.z.clamp(-SHEET_HALF, SHEET_HALF))
    }
}

impl Body {
    /// A mesh with about 80 · 4^level triangles.
    pub fn mesh(&self, level: u32) -> BodyMesh {
        let fine = 1_usize << level;
        let shape = match self {
            Self::Closed(body) => body.shape,
            Self::Sheet(_) => {
                let side = 2.0 * SHEET_HALF as f32;
                let mesh = grid(6 * fine, 6 * fine, side, side, Diagonals::Alternating);
                let domain = mesh.positions.iter().map(|&position| wide(position)).collect();
                return BodyMesh { triangles: mesh.triangles, domain };
            }
        };
        let mesh = match shape {
            BodyShape::Ball(_) | BodyShape::Ellipsoid(_) => icosphere(level + 1, 1.0),
            BodyShape::Torus(major, minor) => torus(major as f32, minor as f32, 8 * fine, 5 * fine),
            BodyShape::Capsule(radius, half) => capsule(radius as f32, half as f32, 6 * fine, 3 * fine, 2 * fine),
        };
        // Generated meshes are rounded to f32. Put their vertices back onto the body.
        let exact = match shape {
            BodyShape::Ball(_) | BodyShape::Ellipsoid(_) => BodyShape::Ball(1.0),
            shape => shape,
        };
        let exact = SmoothBody { shape: exact, rotation: DMat3::IDENTITY, center: DVec3::ZERO };
        let domain = mesh.positions.iter().map(|&position| exact.foot(wide(position)).point).collect();
        BodyMesh { triangles: mesh.triangles, domain }
    }

    /// The vertices of its mesh in the world, in f64.
    pub fn points(&self, mesh: &BodyMesh) -> Vec<DVec3> {
        let point = |&at: &DVec3| match self {
            Self::Sheet(sheet) => sheet.point(at.x, at.z),
            Self::Closed(body) => {
                let own = match body.shape {
                    BodyShape::Ball(radius) => at * radius,
                    BodyShape::Ellipsoid(axes) => at * axes,
                    BodyShape::Torus(..) | BodyShape::Capsule(..) => at,
                };
                body.rotation * own + body.center
            }
        };
        mesh.domain.iter().map(point).collect()
    }

    /// The vertices of its mesh in the world, as the plugin takes them.
    pub fn positions(&self, mesh: &BodyMesh) -> Vec<Vec3> {
        self.points(mesh).into_iter().map(DVec3::as_vec3).collect()
    }

    /// Mean length of the edges of its mesh.
    pub fn mean_edge(&self, mesh: &BodyMesh) -> f64 {
        let positions = self.positions(mesh);
        let topology = SurfaceTopology::new(&positions, &mesh.triangles).expect("a generated mesh is valid");
        topology.mean_edge_length(&positions)
    }

    /// How far a closed body is away. `starts` are points of this body's surface for the search, which a ball does not
    /// need.
    pub fn distance(&self, other: &SmoothBody, starts: &[DVec3]) -> BodyDistance {
        match (self, other.shape) {
            (Self::Sheet(sheet), BodyShape::Ball(radius)) => {
                let foot = sheet.closest(other.center);
                between_ball(foot, (other.center - foot).normalize(), foot.distance(other.center), other, radius)
            }
            (Self::Closed(body), BodyShape::Ball(radius)) => {
                let foot = body.foot(other.center);
                between_ball(foot.point, foot.normal, foot.distance, other, radius)
            }
            (Self::Closed(body), _) => body.distance(other, starts),
            (Self::Sheet(_), _) => unreachable!("sheets meet only balls"),
        }
    }
}

/// The distance of a ball from the closest point to its center, with the unit normal there.
fn between_ball(foot: DVec3, normal: DVec3, distance: f64, ball: &SmoothBody, radius: f64) -> BodyDistance {
    BodyDistance { points: [foot, ball.center - normal * radius], normal, distance: distance - radius }
}

fn wide(position: [f32; 3]) -> DVec3 {
    DVec3::from(position.map(f64::from))
}
