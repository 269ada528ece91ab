//! Sliding bodies: steadiness and accuracy of contact normals, and the bumps that they cause.
//!
//! A ball and a box, as rigid shapes and as meshes, are guided over irregularly triangulated ground. Their true
//! distance is constant, so the true normal is known in every tick. Then they are pushed over flat ground, supported
//! only by their contacts. The motion is the same for every kind of normal, including parry's triangle mesh with and
//! without its fix for internal edges.

use bevy_app::prelude::*;
use bevy_circumsphere::{
    geometry::{CurvatureEstimator, SurfaceTopology},
    kernel::spheres::{
        circumsphere::{OffsetSpheres, RecipeSettings},
        cone::SafetyCones,
        curvature::Curvatures,
    },
    prelude::*,
};
use bevy_ecs::{prelude::*, system::SystemState};
use bevy_transform::components::Transform;
use circumsphere_support::{
    random::Random,
    scenes::{Mesh, cuboid, icosphere},
};
use glam::{DQuat, DVec3, Quat, Vec3};
use parry3d::{
    math::Pose as ParryPose,
    query::{ContactManifold, DefaultQueryDispatcher, PersistentQueryDispatcher},
    shape::{Ball, Cuboid, Shape, TriMesh, TriMeshFlags},
};
use serde::Serialize;

/// The contact distance, and the distance from the true ground at which bodies are guided: two fifths of the former.
const CONTACT_DISTANCE: f64 = 0.05;
const GAP: f64 = 0.02;

/// Mean edge of the ground. The vertices are displaced from a regular grid by up to a third of it.
const EDGE: f64 = 0.3;
const CELLS: usize = 24;

const BALL_RADIUS: f64 = 0.5;
const BOX_HALF_EXTENTS: [f64; 3] = [0.4, 0.3, 0.4];

/// Distance that a body moves per tick.
const TICK: f64 = 0.004;

/// In the pushed motion: ticks per second, and gravity in lengths/second². The speed is 0.24 per second.
const TICK_RATE: f64 = 60.0;
const GRAVITY: f64 = 9.81;

/// A tick of the pushed motion is a bump if the velocity after it is off by more than this share of the speed.
const BUMP: f64 = 0.01;

/// One kind of normal over one ground. Angles are in degrees. Jumps are between consecutive ticks, and errors are
/// against the true normal. `deepest` is the contact with the smallest separation. `mean` is the mean over touching
/// contacts, weighted by their overlap.
#[derive(Clone, Debug, Serialize)]
pub struct SlidingRow {
    /// The ground.
    pub ground: &'static str,
    /// The sliding body.
    pub body: &'static str,
    /// The kind of normals.
    pub normals: &'static str,
    /// Ticks of the guided motion.
    pub ticks: usize,
    /// Ticks of the guided motion without a touching contact.
    pub lost_ticks: usize,
    /// Mean number of touching contacts per tick.
    pub contacts: f64,
    /// Largest jump of the deepest contact's normal.
    pub deepest_jump_max: f64,
    /// Root mean square jump of the deepest contact's normal.
    pub deepest_jump_rms: f64,
    /// Largest jump of the mean normal.
    pub mean_jump_max: f64,
    /// Root mean square jump of the mean normal.
    pub mean_jump_rms: f64,
    /// Largest error of the deepest contact's normal.
    pub deepest_error_max: f64,
    /// Root mean square error of the deepest contact's normal.
    pub deepest_error_rms: f64,
    /// Largest error of the mean normal.
    pub mean_error_max: f64,
    /// Root mean square error of the mean normal.
    pub mean_error_rms: f64,
    /// Largest error of any touching contact.
    pub any_error_max: f64,
    /// Pushed motion, only on flat ground: share of ticks with a bump.
    pub bump_share: Option<f64>,
    /// Largest share of the forward speed lost in one tick.
    pub speed_loss_max: Option<f64>,
    /// Height range of the path, in edges of the ground.
    pub height_range: Option<f64>,
}

/// Measures all combinations. A quick run covers about a sixth of the path.
#[must_use]
pub fn measure(quick: bool) -> Vec<SlidingRow> {
    let ticks = if quick { 160 } else { 1_000 };
    let mut rows = Vec::new();
    for ground in grounds() {
        let mesh = ground.mesh(CELLS, EDGE);
        let path = ground.path(ticks);
        for body in Body::ALL {
            if body.is_box() && !ground.takes_boxes {
                continue;
            }
            rows.push(truth_row(&ground, body, &path));
            for normals in Normals::ALL {
                let mut row = led(&ground, &mesh, &path, body, normals);
                if ground.name == "flat" {
                    let pushed = push(&mesh, ticks, body, normals);
                    row.bump_share = Some(pushed.bump_share);
                    row.speed_loss_max = Some(pushed.speed_loss_max);
                    row.height_range = Some(pushed.height_range / EDGE);
                }
                rows.push(row);
            }
        }
    }
    rows
}

/// A sliding body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Body {
    Ball,
    BallMesh,
    Box,
    BoxMesh,
}

impl Body {
    const ALL: [Self; 4] = [Self::Ball, Self::BallMesh, Self::Box, Self::BoxMesh];

    fn name(self) -> &'static str {
        match self {
            Self::Ball => "ball",
            Self::BallMesh => "ball of 320 triangles",
            Self::Box => "box",
            Self::BoxMesh => "box of 108 triangles",
        }
    }

    fn is_box(self) -> bool {
        matches!(self, Self::Box | Self::BoxMesh)
    }

    fn is_mesh(self) -> bool {
        matches!(self, Self::BallMesh | Self::BoxMesh)
    }

    fn mesh(self) -> Mesh {
        if self.is_box() {
            cuboid(BOX_HALF_EXTENTS.map(|extent| extent as f32), 3)
        } else {
            icosphere(2, BALL_RADIUS as f32)
        }
    }

    fn shape(self) -> SharedShape {
        let [x, y, z] = BOX_HALF_EXTENTS.map(|extent| extent as f32);
        if self.is_box() { SharedShape::cuboid(x, y, z) } else { SharedShape::ball(BALL_RADIUS as f32) }
    }

    /// Height of the center above the ground when the body stands on it.
    fn height(self) -> f64 {
        if self.is_box() { BOX_HALF_EXTENTS[1] } else { BALL_RADIUS }
    }

    /// The pose at which the body's lowest point is `gap` above a place on the ground.
    fn pose(self, foot: DVec3, normal: DVec3, gap: f64) -> Transform {
        let turned = DQuat::from_rotation_arc(DVec3::Y, normal) * DQuat::from_rotation_y(0.5);
        let center = foot + normal * (self.height() + gap);
        Transform::from_translation(center.as_vec3()).with_rotation(turned.as_quat())
    }
}

/// A kind of normals.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Normals {
    /// Exact normals of the features in contact.
    Exact,
    /// Smooth normals of this crate.
    Smooth,
    /// Smooth normals with every bent edge as a crease. These are the exact normals, clamped to the range that the
    /// faces at their features span.
    Sharp,
    /// Normals of the spheres of the two triangles, as in the source paper.
    Caps,
    /// Interpolated, angle-weighted vertex normals without creases, as a renderer uses for shading.
    Interpolated,
    /// parry's triangle mesh.
    Parry,
    /// parry's triangle mesh with fixed internal edges.
    ParryFixed,
}

impl Normals {
    const ALL: [Self; 7] =
        [Self::Exact, Self::Smooth, Self::Sharp, Self::Caps, Self::Interpolated, Self::Parry, Self::ParryFixed];

    fn name(self) -> &'static str {
        match self {
            Self::Exact => "exact",
            Self::Smooth => "smooth",
            Self::Sharp => "smooth, all edges sharp",
            Self::Caps => "caps",
            Self::Interpolated => "interpolated",
            Self::Parry => "parry",
            Self::ParryFixed => "parry, fixed edges",
        }
    }
}

/// A touching contact: the unit normal from the ground to the body, and the distance less the contact distance.
#[derive(Clone, Copy, Debug)]
struct Touch {
    /// Unit vector from the ground to the body.
    normal: DVec3,
    separation: f64,
}

/// Finds the touching contacts of a body at a pose.
trait Detector {
    fn touches(&mut self, pose: &Transform) -> Vec<Touch>;
}

fn detector(ground: &Mesh, body: Body, normals: Normals) -> Box<dyn Detector> {
    match normals {
        Normals::Parry => Box::new(ParryDetector::new(ground, body, TriMeshFlags::empty())),
        Normals::ParryFixed => Box::new(ParryDetector::new(ground, body, TriMeshFlags::FIX_INTERNAL_EDGES)),
        _ => Box::new(OwnDetector::new(ground, body, normals)),
    }
}

fn points(mesh: &Mesh) -> Vec<Vec3> {
    mesh.positions.iter().copied().map(Vec3::from).collect()
}

/// This crate's contacts, with the chosen kind of normal.
struct OwnDetector {
    app: App,
    ground: Entity,
    body: Entity,
    normals: Normals,
    peers: Peers,
    state: SystemState<(SurfaceContacts<'static>, SmoothNormals<'static, 'static>)>,
}

impl OwnDetector {
    fn new(ground: &Mesh, body: Body, normals: Normals) -> Self {
        let mut app = App::new();
        app.add_plugins(DeformableCollisionPlugins::new(Update));
        if normals == Normals::Sharp {
            app.insert_resource(CircumsphereSettings { crease_angle: 0.0, ..Default::default() });
        }
        let surface = |mesh: &Mesh| {
            DeformableSurface::from_mesh(&points(mesh), &mesh.triangles).expect("a generated mesh is valid")
        };
        // A rigid shape has no thickness of its own.
        let thickness = if body.is_mesh() { 0.5 * CONTACT_DISTANCE } else { CONTACT_DISTANCE } as f32;
        let thickness = SurfaceThickness::World(thickness);
        let ground_entity = app.world_mut().spawn((surface(ground), thickness)).id();
        let body_entity = if body.is_mesh() {
            app.world_mut().spawn((surface(&body.mesh()), thickness)).id()
        } else {
            app.world_mut().spawn((RigidShape(body.shape()), Transform::default())).id()
        };
        let state = SystemState::new(app.world_mut());
        Self {
            app,
            ground: ground_entity,
            body: body_entity,
            normals,
            peers: Peers { ground: PeerNormals::new(ground), body: PeerNormals::new(&body.mesh()) },
            state,
        }
    }
}

/// Computes the normals of other methods for this crate's contacts.
struct Peers {
    ground: PeerNormals,
    body: PeerNormals,
}

impl Peers {
    fn normal(&self, contact: &Contact<'_>, turned: Quat, by_caps: bool) -> DVec3 {
        let exact = -contact.normal().as_dvec3();
        let (of_body, of_ground) = (contact.triangles().0, contact.triangles().1);
        let (at_body, at_ground) = contact.barycentrics();
        let mut sum = DVec3::ZERO;
        if let Some(triangle) = of_ground {
            let normal = self.ground.at(triangle, at_ground, by_caps);
            // The ground is a two-sided sheet.
            sum += if normal.dot(exact) < 0.0 { -normal } else { normal };
        }
        if let Some(triangle) = of_body {
            sum -= turned.as_dquat() * self.body.at(triangle, at_body, by_caps);
        }
        sum.try_normalize().unwrap_or(exact)
    }
}

impl Detector for OwnDetector {
    fn touches(&mut self, pose: &Transform) -> Vec<Touch> {
        *self.app.world_mut().get_mut::<Transform>(self.body).expect("the body has a transform") = *pose;
        self.app.update();
        let (contacts, smooth_normals) = self.state.get(self.app.world()).expect("the plugins insert the store");
        let touching = contacts.between(self.body, self.ground).filter(|contact| contact.separation() <= 0.0);
        touching
            .map(|contact| Touch {
                normal: match self.normals {
                    Normals::Exact => -contact.normal().as_dvec3(),
                    Normals::Smooth | Normals::Sharp => -smooth_normals.of(&contact).as_dvec3(),
                    _ => self.peers.normal(&contact, pose.rotation, self.normals == Normals::Caps),
                },
                separation: f64::from(contact.separation()),
            })
            .collect()
    }
}

/// Normals of other methods, in the mesh's own frame.
struct PeerNormals {
    mesh: Mesh,
    spheres: OffsetSpheres,
    by_vertex: Vec<DVec3>,
}

impl PeerNormals {
    fn new(mesh: &Mesh) -> Self {
        let positions = points(mesh);
        let topology = SurfaceTopology::new(&positions, &mesh.triangles).expect("a generated mesh is valid");
        let mut curvatures = Curvatures::default();
        curvatures.measure(&topology, &positions, CurvatureEstimator::SignedEdge);
        let mut spheres = OffsetSpheres::default();
        let defaults = CircumsphereSettings::default();
        let settings = RecipeSettings {
            sphere_offset: defaults.sphere_offset,
            curvature_threshold: defaults.curvature_threshold,
            refit_threshold: 0.0,
        };
        let mut cones = SafetyCones::default();
        spheres.refit(&positions, &mesh.triangles, &curvatures.curvatures, &curvatures.dihedrals, settings, &mut cones);
        let mut by_vertex = vec![DVec3::ZERO; positions.len()];
        for corners in &mesh.triangles {
            let places = corners.map(|vertex| positions[vertex as usize].as_dvec3());
            for k in 0..3 {
                let (u, v) = (places[(k + 1) % 3] - places[k], places[(k + 2) % 3] - places[k]);
                by_vertex[corners[k] as usize] += u.cross(v).normalize_or_zero() * u.angle_between(v);
            }
        }
        let by_vertex = by_vertex.into_iter().map(DVec3::normalize_or_zero).collect();
        Self { mesh: mesh.clone(), spheres, by_vertex }
    }

    fn at(&self, triangle: TriangleId, weights: [f32; 3], by_caps: bool) -> DVec3 {
        let corners = self.mesh.triangles[triangle.index()].map(|vertex| vertex as usize);
        let blend = |of: &dyn Fn(usize) -> DVec3| -> DVec3 {
            corners.iter().zip(weights).map(|(vertex, weight)| of(*vertex) * f64::from(weight)).sum()
        };
        if by_caps {
            let point = blend(&|vertex| Vec3::from(self.mesh.positions[vertex]).as_dvec3());
            (point - self.spheres.centers[triangle.index()].as_dvec3()).normalize_or_zero()
        } else {
            blend(&|vertex| self.by_vertex[vertex]).normalize_or_zero()
        }
    }
}

/// parry's contact manifolds, kept between ticks as in a physics engine.
struct ParryDetector {
    ground: TriMesh,
    body: Box<dyn Shape>,
    manifolds: Vec<ContactManifold<(), ()>>,
    workspace: Option<parry3d::query::ContactManifoldsWorkspace>,
}

impl ParryDetector {
    fn new(ground: &Mesh, body: Body, flags: TriMeshFlags) -> Self {
        let mesh = |mesh: &Mesh| {
            TriMesh::with_flags(points(mesh), mesh.triangles.clone(), flags).expect("a generated mesh is valid")
        };
        let [x, y, z] = BOX_HALF_EXTENTS.map(|extent| extent as f32);
        let shape: Box<dyn Shape> = match body {
            Body::Ball => Box::new(Ball::new(BALL_RADIUS as f32)),
            Body::Box => Box::new(Cuboid::new(Vec3::new(x, y, z))),
            Body::BallMesh | Body::BoxMesh => Box::new(mesh(&body.mesh())),
        };
        Self { ground: mesh(ground), body: shape, manifolds: Vec::new(), workspace: None }
    }
}

impl Detector for ParryDetector {
    fn touches(&mut self, pose: &Transform) -> Vec<Touch> {
        let pose = ParryPose::from_parts(pose.translation, pose.rotation);
        DefaultQueryDispatcher
            .contact_manifolds(
                &pose,
                &self.ground,
                self.body.as_ref(),
                CONTACT_DISTANCE as f32,
                &mut self.manifolds,
                &mut self.workspace,
            )
            .expect("parry tests meshes against these shapes");
        let mut touches = Vec::new();
        for manifold in &self.manifolds {
            for point in &manifold.points {
                let separation = f64::from(point.dist) - CONTACT_DISTANCE;
                if separation <= 0.0 {
                    touches.push(Touch { normal: manifold.local_n1.as_dvec3(), separation });
                }
            }
        }
        touches
    }
}

/// A flat, curved, or creased ground, as a map from the plane.
struct Ground {
    name: &'static str,
    takes_boxes: bool,
    place: Box<dyn Fn(f64, f64) -> DVec3>,
    normal: Box<dyn Fn(f64, f64) -> DVec3>,
    /// Half the angle of the crease along u = 0. 0 without a crease.
    ridge: f64,
    /// Start and direction of the path. With a crease, the start along u is computed instead, from the point at which
    /// the path reaches the crease.
    start: [f64; 2],
    direction: [f64; 2],
}

fn grounds() -> Vec<Ground> {
    let graph = |name, height: fn(f64, f64) -> f64, slope: fn(f64, f64) -> [f64; 2]| Ground {
        name,
        takes_boxes: false,
        place: Box::new(move |u, v| DVec3::new(u, height(u, v), v)),
        normal: Box::new(move |u, v| DVec3::new(-slope(u, v)[0], 1.0, -slope(u, v)[1]).normalize()),
        ridge: 0.0,
        start: [-1.9, -1.2],
        direction: [0.85, 0.53],
    };
    let flat = Ground { takes_boxes: true, ..graph("flat", |_, _| 0.0, |_, _| [0.0; 2]) };
    let sphere = |u: f64, v: f64| {
        let (angle, around) = (u.hypot(v) / 3.0, v.atan2(u));
        DVec3::new(angle.sin() * around.cos(), angle.cos(), angle.sin() * around.sin())
    };
    let cylinder = |u: f64| DVec3::new((u / 2.0).sin(), (u / 2.0).cos(), 0.0);
    let curved = |name, place: Box<dyn Fn(f64, f64) -> DVec3>, normal: Box<dyn Fn(f64, f64) -> DVec3>| Ground {
        name,
        takes_boxes: true,
        place,
        normal,
        ridge: 0.0,
        start: [-1.9, -1.2],
        direction: [0.85, 0.53],
    };
    let roof = |name, half_angle: f64| Ground {
        name,
        takes_boxes: false,
        place: Box::new(move |u, v| DVec3::new(u * half_angle.cos(), -u.abs() * half_angle.sin(), v)),
        normal: Box::new(move |u, _| DVec3::new(half_angle.sin() * u.signum(), half_angle.cos(), 0.0)),
        ridge: half_angle,
        start: [0.0, -1.0],
        direction: [0.85, 0.53],
    };
    let ramp = |name, angle: f64| Ground {
        name,
        takes_boxes: false,
        place: Box::new(move |u, v| DVec3::new(u + u.max(0.0) * (angle.cos() - 1.0), u.max(0.0) * angle.sin(), v)),
        normal: Box::new(|_, _| DVec3::Y),
        ridge: 0.0,
        // The path runs along the foot of the ramp, over the triangles beside it, but not so close that the body
        // touches the ramp.
        start: [-0.22, -2.0],
        direction: [0.0, 1.0],
    };
    vec![
        flat,
        curved("sphere", Box::new(move |u, v| sphere(u, v) * 3.0), Box::new(sphere)),
        curved("cylinder", Box::new(move |u, v| cylinder(u) * 2.0 + DVec3::Z * v), Box::new(move |u, _| cylinder(u))),
        graph("saddle", |u, v| 0.15 * (u * u - v * v), |u, v| [0.3 * u, -0.3 * v]),
        graph(
            "waves",
            |u, v| 0.1 * ((2.0 * u).sin() + (2.0 * v).sin()),
            |u, v| [0.2 * (2.0 * u).cos(), 0.2 * (2.0 * v).cos()],
        ),
        roof("roof of 20°", 10.0_f64.to_radians()),
        roof("roof of 60°", 30.0_f64.to_radians()),
        roof("step of 90°", 45.0_f64.to_radians()),
        ramp("floor by a ramp of 25°", 25.0_f64.to_radians()),
    ]
}

impl Ground {
    /// An irregular mesh with edges of about `edge`. The vertices along u = 0 are not displaced, because creases are
    /// there.
    fn mesh(&self, cells: usize, edge: f64) -> Mesh {
        let mut random = Random::new(7);
        let mut mesh = Mesh::default();
        let half = 0.5 * cells as f64;
        for row in 0..=cells {
            for column in 0..=cells {
                let jitter = [signed(&mut random) / 3.0, signed(&mut random) / 3.0];
                let on_crease = 2 * column == cells;
                let u = if on_crease { 0.0 } else { column as f64 - half + jitter[0] };
                let v = row as f64 - half + jitter[1];
                mesh.positions.push((self.place)(u * edge, v * edge).as_vec3().to_array());
            }
        }
        for row in 0..cells {
            for column in 0..cells {
                let vertex = |right: usize, front: usize| ((row + front) * (cells + 1) + column + right) as u32;
                let [a, b, c, d] = [vertex(0, 0), vertex(0, 1), vertex(1, 1), vertex(1, 0)];
                mesh.triangles.extend(if signed(&mut random) > 0.0 {
                    [[a, b, c], [a, c, d]]
                } else {
                    [[b, c, d], [b, d, a]]
                });
            }
        }
        mesh
    }

    /// The place of the body's lowest point in each tick, and the true normal there.
    fn path(&self, ticks: usize) -> Vec<(DVec3, DVec3)> {
        let mut path = Vec::with_capacity(ticks);
        let [mut u, mut v] = self.start;
        if self.ridge > 0.0 {
            // The path reaches the ridge after a third of its length.
            u = -TICK * self.direction[0] * (ticks / 3) as f64;
        }
        while path.len() < ticks {
            let before = u;
            u += TICK * self.direction[0];
            v += TICK * self.direction[1];
            if self.ridge > 0.0 && before < 0.0 && u >= 0.0 {
                // A ball rolls over the ridge: its center moves on an arc about the contact point.
                let mut angle = -self.ridge;
                while angle < self.ridge {
                    path.push(((self.place)(0.0, v), DVec3::new(angle.sin(), angle.cos(), 0.0)));
                    angle += TICK / (BALL_RADIUS + GAP);
                }
            }
            path.push(((self.place)(u, v), (self.normal)(u, v)));
        }
        path.truncate(ticks);
        path
    }
}

fn degrees_between(one: DVec3, other: DVec3) -> f64 {
    one.cross(other).length().atan2(one.dot(other)).to_degrees()
}

/// Maximum and root mean square of the added values.
#[derive(Clone, Copy, Debug, Default)]
struct Spread {
    largest: f64,
    squares: f64,
    count: usize,
}

impl Spread {
    fn add(&mut self, value: f64) {
        self.largest = self.largest.max(value);
        self.squares += value * value;
        self.count += 1;
    }

    fn root_mean_square(&self) -> f64 {
        (self.squares / self.count.max(1) as f64).sqrt()
    }
}

fn truth_row(ground: &Ground, body: Body, path: &[(DVec3, DVec3)]) -> SlidingRow {
    let mut jump = Spread::default();
    path.windows(2).for_each(|pair| jump.add(degrees_between(pair[0].1, pair[1].1)));
    SlidingRow {
        ground: ground.name,
        body: body.name(),
        normals: "true",
        ticks: path.len(),
        lost_ticks: 0,
        contacts: 0.0,
        deepest_jump_max: jump.largest,
        deepest_jump_rms: jump.root_mean_square(),
        mean_jump_max: jump.largest,
        mean_jump_rms: jump.root_mean_square(),
        deepest_error_max: 0.0,
        deepest_error_rms: 0.0,
        mean_error_max: 0.0,
        mean_error_rms: 0.0,
        any_error_max: 0.0,
        bump_share: None,
        speed_loss_max: None,
        height_range: None,
    }
}

/// Guides a body along the path.
fn led(ground: &Ground, mesh: &Mesh, path: &[(DVec3, DVec3)], body: Body, normals: Normals) -> SlidingRow {
    let mut detector = detector(mesh, body, normals);
    let (mut deepest_jump, mut mean_jump) = (Spread::default(), Spread::default());
    let (mut deepest_error, mut mean_error) = (Spread::default(), Spread::default());
    let (mut any_error, mut contacts, mut lost_ticks): (f64, usize, usize) = (0.0, 0, 0);
    let mut before: Option<[DVec3; 2]> = None;
    for &(foot, normal) in path {
        let touches = detector.touches(&body.pose(foot, normal, GAP));
        contacts += touches.len();
        let Some(deepest) = touches.iter().min_by(|a, b| a.separation.total_cmp(&b.separation)) else {
            lost_ticks += 1;
            before = None;
            continue;
        };
        let mean = touches.iter().map(|touch| touch.normal * -touch.separation).sum::<DVec3>();
        let mean = mean.try_normalize().unwrap_or(deepest.normal);
        deepest_error.add(degrees_between(deepest.normal, normal));
        mean_error.add(degrees_between(mean, normal));
        for touch in &touches {
            any_error = any_error.max(degrees_between(touch.normal, normal));
        }
        if let Some([last_deepest, last_mean]) = before {
            deepest_jump.add(degrees_between(deepest.normal, last_deepest));
            mean_jump.add(degrees_between(mean, last_mean));
        }
        before = Some([deepest.normal, mean]);
    }
    SlidingRow {
        ground: ground.name,
        body: body.name(),
        normals: normals.name(),
        ticks: path.len(),
        lost_ticks,
        contacts: contacts as f64 / path.len() as f64,
        deepest_jump_max: deepest_jump.largest,
        deepest_jump_rms: deepest_jump.root_mean_square(),
        mean_jump_max: mean_jump.largest,
        mean_jump_rms: mean_jump.root_mean_square(),
        deepest_error_max: deepest_error.largest,
        deepest_error_rms: deepest_error.root_mean_square(),
        mean_error_max: mean_error.largest,
        mean_error_rms: mean_error.root_mean_square(),
        any_error_max: any_error,
        bump_share: None,
        speed_loss_max: None,
        height_range: None,
    }
}

/// Results of the pushed motion.
struct Pushed {
    bump_share: f64,
    speed_loss_max: f64,
    height_range: f64,
}

/// Pushes a body over flat ground. Its horizontal velocity is reset in every tick, and gravity pulls it down. Every
/// touching contact removes the velocity into the ground and moves the body out along the contact's normal.
fn push(mesh: &Mesh, ticks: usize, body: Body, normals: Normals) -> Pushed {
    let mut detector = detector(mesh, body, normals);
    let speed = TICK * TICK_RATE;
    let forward = DVec3::new(0.85, 0.0, 0.53).normalize();
    let mut foot = DVec3::new(-1.9, CONTACT_DISTANCE, -1.2);
    let mut vertical = 0.0;
    let (mut bumps, mut loss): (usize, f64) = (0, 0.0);
    let (mut lowest, mut highest) = (foot.y, foot.y);
    for _ in 0..ticks {
        let mut velocity = forward * speed + DVec3::Y * (vertical - GRAVITY / TICK_RATE);
        foot += velocity / TICK_RATE;
        let mut touches = detector.touches(&body.pose(foot, DVec3::Y, 0.0));
        touches.sort_by(|a, b| a.separation.total_cmp(&b.separation));
        let before = foot;
        for _ in 0..4 {
            for touch in &touches {
                velocity -= touch.normal * velocity.dot(touch.normal).min(0.0);
                foot -= touch.normal * (touch.separation + (foot - before).dot(touch.normal)).min(0.0);
            }
        }
        vertical = velocity.y;
        let lost = 1.0 - velocity.dot(forward) / speed;
        loss = loss.max(lost);
        let sideways = velocity - forward * velocity.dot(forward) - DVec3::Y * velocity.y;
        let off = lost.abs().max(sideways.length() / speed).max(velocity.y.max(0.0) / speed);
        bumps += usize::from(off > BUMP);
        lowest = lowest.min(foot.y);
        highest = highest.max(foot.y);
    }
    Pushed { bump_share: bumps as f64 / ticks as f64, speed_loss_max: loss, height_range: highest - lowest }
}

/// Uniform from −1 to 1.
fn signed(random: &mut Random) -> f64 {
    2.0 * random.unit() - 1.0
}
