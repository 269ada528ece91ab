//! Headless worlds of one hard case: bodies, a pair of neighbors that the bodies must not affect, and a judgment of the
//! results. The truth is the f64 reference over stored positions and poses, both taken as exact. Every tick of every
//! test goes through [`Run::tick`], which checks what must hold in every case.

use std::{
    collections::{BTreeMap, BTreeSet},
    ops::AddAssign,
};

use bevy_app::prelude::*;
use bevy_circumsphere::{
    ContactStore, StoredPair,
    detection::{BruteForceBroadPhasePlugin, TreeBroadPhasePlugin},
    geometry::{CompactContact, TouchingPair},
    prelude::*,
};
use bevy_ecs::{
    prelude::*,
    schedule::{ScheduleLabel, SingleThreadedExecutor},
};
use bevy_transform::components::Transform;
use circumsphere_support::{
    bars::{BAND, SEPARATION_TOLERANCE},
    scenes::{Mesh, cuboid, icosphere},
};
use circumsphere_truth::ParryBroadPhasePlugin;
use circumsphere_truth::{
    ReferencePair, exact_weld, point_segment, point_triangle, segment_segment, touching_pairs_between_tree,
    touching_pairs_tree,
};
use glam::{DAffine3, DQuat, DVec3, Quat, Vec3};

/// Weights and normals are stored in f32: a few roundings.
const STORAGE: f32 = 8.0 * f32::EPSILON;

pub const BROAD_PHASES: [BroadPhase; 3] = [BroadPhase::Tree, BroadPhase::BruteForce, BroadPhase::Parry];

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BroadPhase {
    Tree,
    BruteForce,
    Parry,
}

/// Every method with every broad phase.
pub fn combinations() -> impl Iterator<Item = (ContactMethod, BroadPhase)> {
    ContactMethod::ALL
        .into_iter()
        .flat_map(|method| BROAD_PHASES.into_iter().map(move |broad_phase| (method, broad_phase)))
}

/// A rotation by an angle in radians, computed in f64 so that its f32 value does not depend on the platform's sine.
pub fn turned(axis: Vec3, angle: f64) -> Quat {
    DQuat::from_axis_angle(axis.as_dvec3().normalize(), angle).as_quat()
}

pub fn at(x: f32, y: f32, z: f32) -> Transform {
    Transform::from_xyz(x, y, z)
}

pub fn points(mesh: &Mesh) -> Vec<Vec3> {
    mesh.positions.iter().copied().map(Vec3::from_array).collect()
}

/// A mesh of triangles that share no vertices.
pub fn loose_triangles(triangles: &[[Vec3; 3]]) -> Mesh {
    Mesh {
        positions: triangles.iter().flatten().map(Vec3::to_array).collect(),
        triangles: (0..triangles.len() as u32).map(|triangle| [0, 1, 2].map(|k| 3 * triangle + k)).collect(),
    }
}

/// Pseudo-random numbers for scenes: a multiplicative congruential generator modulo the prime 2^61 - 1 (Lehmer 1951).
pub struct Random(u64);

impl Random {
    const MODULUS: u64 = (1 << 61) - 1;

    pub fn new(seed: u64) -> Self {
        let mut random = Self(seed % (Self::MODULUS - 1) + 1);
        for _ in 0..20 {
            random.unit();
        }
        random
    }

    /// A number from 0 to 1, excluding 1.
    pub fn unit(&mut self) -> f64 {
        const MULTIPLIER: u128 = 1_037_567_919_013_379;
        self.0 = (u128::from(self.0) * MULTIPLIER % u128::from(Self::MODULUS)) as u64;
        self.0 as f64 / (Self::MODULUS as f64 + 512.0)
    }

    pub fn range(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    #[expect(clippy::cast_sign_loss, reason = "a number from 0 to 1 has no sign")]
    pub fn below(&mut self, end: usize) -> usize {
        (self.unit() * end as f64) as usize
    }

    /// A point in the cube from -1 to 1.
    pub fn vector(&mut self) -> DVec3 {
        DVec3::new(self.range(-1.0, 1.0), self.range(-1.0, 1.0), self.range(-1.0, 1.0))
    }

    /// A unit vector.
    pub fn direction(&mut self) -> DVec3 {
        loop {
            let vector = self.vector();
            if (0.01..=1.0).contains(&vector.length_squared()) {
                return vector.normalize();
            }
        }
    }
}

/// One surface of a case.
#[derive(Clone, Debug)]
pub struct Body {
    surface: DeformableSurface,
    /// The positions that the surface is made from.
    rest: Vec<Vec3>,
    pub positions: Vec<Vec3>,
    pub triangles: Vec<[u32; 3]>,
    pub transform: Transform,
    parent: Option<Transform>,
    /// Half the contact distance, in world units.
    thickness: f32,
    self_collision: bool,
}

impl Body {
    pub fn new(mesh: &Mesh, thickness: f32) -> Self {
        let (surface, _) = DeformableSurface::from_mesh(&points(mesh), &mesh.triangles).expect("the mesh is valid");
        Self {
            surface,
            rest: points(mesh),
            positions: points(mesh),
            triangles: mesh.triangles.clone(),
            transform: Transform::IDENTITY,
            parent: None,
            thickness,
            self_collision: false,
        }
    }

    pub fn at(self, transform: Transform) -> Self {
        Self { transform, ..self }
    }

    pub fn under(self, parent: Transform) -> Self {
        Self { parent: Some(parent), ..self }
    }

    pub fn meeting_itself(self) -> Self {
        Self { self_collision: true, ..self }
    }

    /// From the body to the world, composed in f64.
    fn pose(&self) -> DAffine3 {
        let affine = |transform: &Transform| {
            DAffine3::from_scale_rotation_translation(
                transform.scale.as_dvec3(),
                transform.rotation.as_dquat().normalize(),
                transform.translation.as_dvec3(),
            )
        };
        let own = affine(&self.transform);
        self.parent.as_ref().map_or(own, |parent| affine(parent) * own)
    }

    /// The world positions of the vertices.
    pub fn world_positions(&self) -> Vec<DVec3> {
        let pose = self.pose();
        self.positions.iter().map(|position| pose.transform_point3(position.as_dvec3())).collect()
    }
}

/// The bodies of a case in the world, and the true pairs.
pub struct Truth {
    places: Vec<Vec<DVec3>>,
    triangles: Vec<Vec<[u32; 3]>>,
    /// For every two bodies that meet, their touching pairs up to the end of the band.
    pairs: BTreeMap<(usize, usize), BodyPairTruth>,
}

struct BodyPairTruth {
    contact_distance: f64,
    /// Up to this distance a pair must be found. Beyond `allowed_up_to` it must not be.
    required_up_to: f64,
    allowed_up_to: f64,
    distances: BTreeMap<(u32, u32), f64>,
}

impl BodyPairTruth {
    fn required(&self) -> impl Iterator<Item = (u32, u32)> {
        self.distances.iter().filter(|&(_, &distance)| distance <= self.required_up_to).map(|(&pair, _)| pair)
    }

    fn allows(&self, pair: (u32, u32)) -> bool {
        self.distances.get(&pair).is_some_and(|&distance| distance <= self.allowed_up_to)
    }
}

impl Truth {
    pub fn of(bodies: &[Body]) -> Self {
        let places: Vec<Vec<DVec3>> = bodies.iter().map(Body::world_positions).collect();
        let mut pairs = BTreeMap::new();
        for (first, body) in bodies.iter().enumerate() {
            for (second, other) in bodies.iter().enumerate().skip(first) {
                if first == second && !body.self_collision {
                    continue;
                }
                let contact_distance = f64::from(body.thickness + other.thickness);
                let band = BAND * contact_distance;
                let reach = contact_distance + 2.0 * band;
                let found: Vec<ReferencePair> = if first == second {
                    let rest: Vec<DVec3> = body.rest.iter().map(|position| position.as_dvec3()).collect();
                    touching_pairs_tree(&places[first], &body.triangles, &exact_weld(&rest), reach)
                } else {
                    let (one, two) = (&places[first], &places[second]);
                    touching_pairs_between_tree(one, &body.triangles, two, &other.triangles, reach)
                };
                let distances = found.iter().map(|pair| ((pair.triangle_a, pair.triangle_b), pair.distance)).collect();
                let truth = BodyPairTruth {
                    contact_distance,
                    required_up_to: contact_distance - band,
                    allowed_up_to: contact_distance + band,
                    distances,
                };
                pairs.insert((first, second), truth);
            }
        }
        Self { places, triangles: bodies.iter().map(|body| body.triangles.clone()).collect(), pairs }
    }

    fn corners(&self, body: usize, triangle: u32) -> [DVec3; 3] {
        self.triangles[body][triangle as usize].map(|vertex| self.places[body][vertex as usize])
    }

    /// The number of pairs that cross.
    pub fn crossing(&self) -> usize {
        self.pairs.values().flat_map(|pair| pair.distances.values()).filter(|&&distance| distance == 0.0).count()
    }
}

fn longest_edge(corners: &[DVec3; 3]) -> f64 {
    (0..3).map(|k| corners[k].distance(corners[(k + 1) % 3])).fold(0.0, f64::max)
}

/// The connection between two features of two triangles, from the second one's point to the first one's.
fn feature_connection(a: &[DVec3; 3], b: &[DVec3; 3], features: FeaturesOf) -> DVec3 {
    let edge = |corners: &[DVec3; 3], k: u8| (corners[k as usize], corners[(k as usize + 1) % 3]);
    match features {
        (Feature::Vertex(k), Feature::Vertex(l)) => a[k as usize] - b[l as usize],
        (Feature::Vertex(k), Feature::Edge(l)) => {
            let (start, end) = edge(b, l);
            a[k as usize] - point_segment(a[k as usize], start, end).point
        }
        (Feature::Edge(k), Feature::Vertex(l)) => {
            let (start, end) = edge(a, k);
            point_segment(b[l as usize], start, end).point - b[l as usize]
        }
        (Feature::Vertex(k), Feature::Face) => a[k as usize] - point_triangle(a[k as usize], b).point,
        (Feature::Face, Feature::Vertex(l)) => point_triangle(b[l as usize], a).point - b[l as usize],
        (Feature::Edge(k), Feature::Edge(l)) => {
            let ((a0, a1), (b0, b1)) = (edge(a, k), edge(b, l));
            let closest = segment_segment(a0, a1, b0, b1);
            closest.point_a - closest.point_b
        }
        // An edge that pierces a face has distance 0 from it.
        (Feature::Edge(_), Feature::Face) | (Feature::Face, Feature::Edge(_)) => DVec3::ZERO,
        (Feature::Face, Feature::Face) => panic!("an exact contact never joins two faces"),
    }
}

type FeaturesOf = (Feature, Feature);

/// The pairs found between the bodies of a case in one tick.
#[derive(Clone, Debug)]
pub struct Found {
    /// By the places of two bodies in the case, lower first.
    pub pairs: BTreeMap<(usize, usize), FoundPair>,
}

#[derive(Clone, Debug)]
pub struct FoundPair {
    pub touching: Vec<TouchingPair>,
    pub contacts: Vec<CompactContact>,
    /// The world normals of the contacts.
    pub normals: Vec<Vec3>,
}

impl Found {
    pub fn touching(&self) -> usize {
        self.pairs.values().map(|pair| pair.touching.len()).sum()
    }

    pub fn contacts(&self) -> usize {
        self.pairs.values().map(|pair| pair.contacts.len()).sum()
    }

    /// The touching pairs of triangles, with the bodies they belong to.
    pub fn touching_set(&self) -> BTreeSet<(usize, usize, u32, u32)> {
        self.pairs
            .iter()
            .flat_map(|(&(first, second), pair)| {
                pair.touching.iter().map(move |touching| (first, second, touching.triangle_a, touching.triangle_b))
            })
            .collect()
    }

    /// The keys of the contacts.
    pub fn contact_keys(&self) -> BTreeSet<(usize, usize, ContactKey)> {
        self.pairs
            .iter()
            .flat_map(|(&(first, second), pair)| pair.contacts.iter().map(move |contact| (first, second, contact.key)))
            .collect()
    }

    /// The least signed distance of any contact. Infinite if there is none.
    pub fn deepest(&self) -> f32 {
        let contacts = self.pairs.values().flat_map(|pair| &pair.contacts);
        contacts.map(|contact| contact.distance).fold(f32::INFINITY, f32::min)
    }

    #[track_caller]
    pub fn assert_same_bits(&self, other: &Self, what: &str) {
        let keys = |found: &Self| found.pairs.keys().copied().collect::<Vec<_>>();
        assert_eq!(keys(self), keys(other), "{what}");
        for (pair, of_other) in self.pairs.values().zip(other.pairs.values()) {
            assert_eq!(pair.touching, of_other.touching, "{what}");
            assert_same_contact_bits(&pair.contacts, &of_other.contacts, what);
        }
    }
}

/// Equal to the last bit, including the signs of zeros.
#[track_caller]
fn assert_same_contact_bits(contacts: &[CompactContact], others: &[CompactContact], what: &str) {
    let bits = |contact: &CompactContact| {
        let CompactContact { barycentric_a: a, barycentric_b: b, point_b: point, normal, distance, .. } = *contact;
        [a[0], a[1], b[0], b[1], point.x, point.y, point.z, normal.x, normal.y, normal.z, distance].map(f32::to_bits)
    };
    assert_eq!(contacts, others, "{what}");
    assert!(contacts.iter().zip(others).all(|(one, other)| bits(one) == bits(other)), "{what}: signs of zeros differ");
}

/// How the found pairs compare with the truth.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Verdict {
    /// True pairs that must be found.
    pub touching: usize,
    pub missed: usize,
    pub false_pairs: usize,
    /// Two bodies touch, but no touching pair of their triangles was found.
    pub bodies_missed: usize,
    /// Of touching pairs and of contacts, relative to the larger of contact distance and triangle size.
    pub worst_separation_error: f64,
}

impl AddAssign for Verdict {
    fn add_assign(&mut self, other: Self) {
        self.touching += other.touching;
        self.missed += other.missed;
        self.false_pairs += other.false_pairs;
        self.bodies_missed += other.bodies_missed;
        self.worst_separation_error = self.worst_separation_error.max(other.worst_separation_error);
    }
}

/// Counts missed and false pairs.
pub fn judge(found: &Found, truth: &Truth) -> Verdict {
    let mut verdict = Verdict::default();
    for (bodies, truth) in &truth.pairs {
        let touching = found.pairs.get(bodies).map_or(&[][..], |pair| &pair.touching);
        let named: BTreeSet<(u32, u32)> = touching.iter().map(|pair| (pair.triangle_a, pair.triangle_b)).collect();
        assert_eq!(named.len(), touching.len(), "a pair is listed twice");
        let required: Vec<(u32, u32)> = truth.required().collect();
        verdict.touching += required.len();
        verdict.missed += required.iter().filter(|&pair| !named.contains(pair)).count();
        let false_pairs = named.iter().filter(|&&pair| !truth.allows(pair)).count();
        verdict.false_pairs += false_pairs;
        verdict.bodies_missed += usize::from(!required.is_empty() && named.len() == false_pairs);
    }
    let strangers = found.pairs.keys().filter(|bodies| !truth.pairs.contains_key(bodies));
    assert_eq!(strangers.count(), 0, "bodies that must not meet are in contact");
    verdict
}

/// Counts the same, and measures the separations of an exact method: those of touching pairs, and of the two features
/// of each contact. Checks that the normal of each contact runs along the connection of its points.
#[track_caller]
pub fn judge_exact(found: &Found, truth: &Truth, what: &str) -> Verdict {
    let mut verdict = judge(found, truth);
    for (&(first, second), pair) in &found.pairs {
        let of_pair = &truth.pairs[&(first, second)];
        let size = |a: &[DVec3; 3], b: &[DVec3; 3]| {
            of_pair.contact_distance.max(longest_edge(a)).max(longest_edge(b)).max(f64::MIN_POSITIVE)
        };
        let mut error = 0.0_f64;
        for touching in &pair.touching {
            let (a, b) = (truth.corners(first, touching.triangle_a), truth.corners(second, touching.triangle_b));
            if let Some(distance) = of_pair.distances.get(&(touching.triangle_a, touching.triangle_b)) {
                error = error.max((touching.distance - distance).abs() / size(&a, &b));
            }
        }
        for (contact, normal) in pair.contacts.iter().zip(&pair.normals) {
            let (a, b) = (truth.corners(first, contact.triangle_a), truth.corners(second, contact.triangle_b));
            let scale = size(&a, &b);
            let connection = feature_connection(&a, &b, (contact.features.a, contact.features.b));
            let stored = f64::from(contact.distance.abs());
            error = error.max((stored - connection.length()).abs() / scale);
            let place = |corners: &[DVec3; 3], weights: [f32; 2]| {
                let [u, v] = weights.map(f64::from);
                corners[0] * u + corners[1] * v + corners[2] * (1.0 - u - v)
            };
            let joined = place(&a, contact.barycentric_a) - place(&b, contact.barycentric_b);
            error = error.max((joined.length() - stored).abs() / scale);
            assert!(
                of_pair.allows((contact.triangle_a, contact.triangle_b)),
                "{what}: a contact of triangles that do not touch: {contact:?}"
            );
            // A direction is only as accurate as the points that give it.
            if connection.length() > 1.0e3 * SEPARATION_TOLERANCE * scale {
                let along = connection.normalize().dot(normal.as_dvec3()).abs();
                assert!(along > 0.9999, "{what}: {contact:?} is not along {connection}");
            }
        }
        verdict.worst_separation_error = verdict.worst_separation_error.max(error);

        assert!(pair.touching.is_empty() || !pair.contacts.is_empty(), "{what}: pairs touch without a contact");
        // Where nothing has penetrated, the nearest pair is among the contacts.
        let nearest = of_pair.distances.iter().min_by(|one, other| one.1.total_cmp(other.1));
        if let Some((&(triangle_a, triangle_b), &nearest)) = nearest
            && nearest <= of_pair.required_up_to
            && pair.contacts.iter().all(|contact| contact.distance >= 0.0)
        {
            let reported = pair.contacts.iter().map(|contact| contact.distance).fold(f32::INFINITY, f32::min);
            let scale = size(&truth.corners(first, triangle_a), &truth.corners(second, triangle_b));
            let error = (f64::from(reported) - nearest).abs() / scale;
            assert!(error <= SEPARATION_TOLERANCE, "{what}: the nearest contact is at {reported}, not at {nearest}");
        }
    }
    verdict
}

/// The numbers of events that a run has sent.
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct EventCounts {
    pub started: usize,
    pub ended: usize,
}

fn count_events(
    mut counts: ResMut<EventCounts>,
    mut started: MessageReader<SurfaceContactStart>,
    mut ended: MessageReader<SurfaceContactEnd>,
) {
    counts.started += started.read().count();
    counts.ended += ended.read().count();
}

/// An app that detects in `Update` on one thread and counts its events.
pub fn new_app(broad_phase: BroadPhase, settings: CircumsphereSettings) -> App {
    let mut app = App::new();
    match broad_phase {
        BroadPhase::Tree => app.add_plugins(DeformableCollisionPlugins::new(Update)),
        BroadPhase::BruteForce => app
            .add_plugins(DeformableCollisionPlugins::new(Update).build().disable::<TreeBroadPhasePlugin>())
            .add_plugins(BruteForceBroadPhasePlugin),
        BroadPhase::Parry => app
            .add_plugins(DeformableCollisionPlugins::new(Update).build().disable::<TreeBroadPhasePlugin>())
            .add_plugins(ParryBroadPhasePlugin),
    };
    // Running a few small systems on worker threads costs more than the systems themselves.
    for schedule in [First.intern(), Update.intern()] {
        app.edit_schedule(schedule, |schedule| {
            schedule.set_executor(SingleThreadedExecutor::new());
        });
    }
    app.insert_resource(CircumsphereSettings { threads: 1, ..settings })
        .init_resource::<EventCounts>()
        .add_systems(Update, count_events.in_set(DeformableSystems::Log));
    app
}

/// A small plate, and a ball that rotates on it, penetrating slightly.
struct Neighbors([Entity; 2]);

/// The pose of the ball in a tick. It rotates, so that its contacts change.
fn ball_pose(place: Transform, tick: u64) -> Transform {
    let turn = turned(Vec3::new(0.3, 1.0, 0.2), 0.37 * tick as f64);
    place * Transform { translation: Vec3::new(0.011, 0.067, 0.007), rotation: turn, scale: Vec3::ONE }
}

impl Neighbors {
    fn spawn(app: &mut App, method: ContactMethod, place: Transform) -> Self {
        let plate = (cuboid([0.1, 0.02, 0.08], 1), place);
        let ball = (icosphere(0, 0.06), ball_pose(place, 0));
        Self([plate, ball].map(|(mesh, transform)| {
            let surface = DeformableSurface::from_mesh(&points(&mesh), &mesh.triangles).expect("the mesh is valid");
            app.world_mut().spawn((surface, SurfaceThickness::World(0.005), method, transform)).id()
        }))
    }

    fn turn(&self, app: &mut App, place: Transform, tick: u64) {
        *app.world_mut().get_mut::<Transform>(self.0[1]).expect("a neighbor has a transform") = ball_pose(place, tick);
    }

    fn pair<'a>(&self, store: &'a ContactStore) -> &'a StoredPair {
        let is_ours = |pair: &&StoredPair| [pair.a.entity(), pair.b.entity()] == self.0;
        store.pairs().iter().find(is_ours).expect("the neighbors are in contact")
    }
}

/// A world with a case and one without it, run tick by tick.
pub struct Run {
    pub app: App,
    control: App,
    pub bodies: Vec<Body>,
    pub entities: Vec<Entity>,
    neighbors: Neighbors,
    control_neighbors: Neighbors,
    neighbor_place: Transform,
    pub method: ContactMethod,
    ticks: u64,
}

impl Run {
    pub fn new(case: &Case, method: ContactMethod, broad_phase: BroadPhase) -> Self {
        let mut app = new_app(broad_phase, case.settings);
        let mut control = new_app(broad_phase, case.settings);
        let entities = case.bodies.iter().map(|body| spawn(&mut app, body, method)).collect();
        Self {
            neighbors: Neighbors::spawn(&mut app, method, case.neighbor_place),
            control_neighbors: Neighbors::spawn(&mut control, method, case.neighbor_place),
            app,
            control,
            bodies: case.bodies.clone(),
            entities,
            neighbor_place: case.neighbor_place,
            method,
            ticks: 0,
        }
    }

    /// Moves a body.
    pub fn place(&mut self, body: usize, transform: Transform) {
        self.bodies[body].transform = transform;
        *self.app.world_mut().get_mut::<Transform>(self.entities[body]).expect("a body has a transform") = transform;
    }

    /// Deforms a body.
    pub fn deform(&mut self, body: usize, positions: Vec<Vec3>) {
        self.app
            .world_mut()
            .get_mut::<SurfacePositions>(self.entities[body])
            .expect("it is a surface")
            .0
            .clone_from(&positions);
        self.bodies[body].positions = positions;
    }

    /// Runs one tick of both worlds. Checks that everything is finite and that the neighbors are unaffected.
    #[track_caller]
    pub fn tick(&mut self) -> Found {
        self.ticks += 1;
        for (app, neighbors) in [(&mut self.app, &self.neighbors), (&mut self.control, &self.control_neighbors)] {
            neighbors.turn(app, self.neighbor_place, self.ticks);
            app.update();
        }
        let normals = assert_finite(&mut self.app);
        let store = self.app.world().resource::<ContactStore>();
        self.assert_neighbors_unaffected(store);
        let place = |entity: Entity| self.entities.iter().position(|&other| other == entity);
        let (mut pairs, mut normals) = (BTreeMap::new(), normals.into_iter());
        for pair in store.pairs() {
            let normals: Vec<Vec3> = normals.by_ref().take(pair.contacts.len()).collect();
            let (Some(first), Some(second)) = (place(pair.a.entity()), place(pair.b.entity())) else { continue };
            let found = FoundPair { touching: pair.touching.to_vec(), contacts: pair.contacts.to_vec(), normals };
            assert!(pairs.insert((first, second), found).is_none(), "two bodies are paired twice");
        }
        Found { pairs }
    }

    #[track_caller]
    fn assert_neighbors_unaffected(&self, store: &ContactStore) {
        let alone = self.control.world().resource::<ContactStore>();
        let (pair, without) = (self.neighbors.pair(store), self.control_neighbors.pair(alone));
        let contacts = &pair.contacts;
        assert!(!contacts.is_empty(), "the neighbors have contacts to compare");
        assert_same_contact_bits(contacts, &without.contacts, "the neighbors are affected");
        assert_eq!(*pair.touching, *without.touching);
        assert_eq!(pair.nearest.to_bits(), without.nearest.to_bits());
    }

    /// The events of the whole run, from bodies with events enabled.
    pub fn events(&self) -> EventCounts {
        *self.app.world().resource::<EventCounts>()
    }

    pub fn truth(&self) -> Truth {
        Truth::of(&self.bodies)
    }
}

fn spawn(app: &mut App, body: &Body, method: ContactMethod) -> Entity {
    let surface = body.surface.instance();
    let positions = SurfacePositions(body.positions.clone());
    let thickness = SurfaceThickness::World(body.thickness);
    let mut entity = app.world_mut().spawn((surface, positions, thickness, method, body.transform));
    if body.self_collision {
        entity.insert(SelfCollision);
    }
    let entity = entity.id();
    if let Some(parent) = body.parent {
        let parent = app.world_mut().spawn(parent).id();
        app.world_mut().entity_mut(entity).insert(ChildOf(parent));
    }
    entity
}

/// Reads every contact of the world as a game would, and returns the normals.
#[track_caller]
fn assert_finite(app: &mut App) -> Vec<Vec3> {
    app.world_mut().run_system_cached(finite_normals).expect("contacts can be read")
}

fn finite_normals(contacts: SurfaceContacts) -> Vec<Vec3> {
    contacts.iter().map(finite_normal).collect()
}

fn finite_normal(contact: Contact<'_>) -> Vec3 {
    let (point_a, point_b) = contact.points();
    let (weights_a, weights_b) = contact.barycentrics();
    let lengths = [contact.distance(), contact.separation(), contact.contact_distance()];
    assert!(lengths.iter().all(|length| length.is_finite()), "{:?} has lengths {lengths:?}", contact.key());
    assert!(point_a.is_finite() && point_b.is_finite(), "{:?} joins {point_a} and {point_b}", contact.key());
    for weights in [weights_a, weights_b] {
        let inside = weights.iter().all(|weight| (-STORAGE..=1.0 + STORAGE).contains(weight));
        let whole = (weights.iter().sum::<f32>() - 1.0).abs() <= STORAGE;
        assert!(inside && whole, "{:?} has weights {weights:?}", contact.key());
    }
    let normal = contact.normal();
    assert!((normal.length() - 1.0).abs() <= STORAGE, "{:?} has the normal {normal}", contact.key());
    for entry in &contact.stencil() {
        assert!(entry.weight.is_finite() && entry.normal.is_finite(), "{:?} pushes by {entry:?}", contact.key());
    }
    normal
}

/// A static scene.
#[derive(Clone)]
pub struct Case {
    pub bodies: Vec<Body>,
    pub settings: CircumsphereSettings,
    neighbor_place: Transform,
}

impl Case {
    pub fn new(bodies: impl Into<Vec<Body>>) -> Self {
        // In the middle of most cases, so that the bodies meet the neighbors, too.
        let neighbor_place = at(0.21, 0.03, -0.17);
        Self { bodies: bodies.into(), settings: CircumsphereSettings::default(), neighbor_place }
    }

    /// The same case with other settings.
    pub fn with_settings(self, settings: CircumsphereSettings) -> Self {
        Self { settings, ..self }
    }

    /// The same case with its neighbors elsewhere.
    pub fn with_neighbors_at(self, neighbor_place: Transform) -> Self {
        Self { neighbor_place, ..self }
    }

    /// One world for each combination of method and broad phase. [`tick_all`] runs them.
    pub fn runs(&self) -> Vec<Run> {
        combinations().map(|(method, broad_phase)| Run::new(self, method, broad_phase)).collect()
    }

    /// Runs the scene for one tick, see [`tick_all`].
    #[track_caller]
    pub fn judge(&self, what: &str) -> Tally {
        tick_all(&mut self.runs(), what).0
    }
}

/// Runs one tick of the worlds of a case ([`Case::runs`]) and judges them. The exact methods must be right, and all
/// broad phases must agree to the last bit. Errors of the other methods are counted. Also returns the results of each
/// method, in the order of [`ContactMethod::ALL`].
#[track_caller]
pub fn tick_all(runs: &mut [Run], what: &str) -> (Tally, Vec<Found>) {
    let truth = runs[0].truth();
    let mut tally = Tally { crossing: truth.crossing(), ..Tally::default() };
    let mut found_by_method = Vec::new();
    for runs in runs.chunks_mut(BROAD_PHASES.len()) {
        let what = format!("{what}, {:?}", runs[0].method);
        let mut found: Vec<Found> = runs.iter_mut().map(Run::tick).collect();
        for other in &found[1..] {
            other.assert_same_bits(&found[0], &what);
        }
        tally.add(runs[0].method, &found[0], &truth, &what);
        found_by_method.push(found.swap_remove(0));
    }
    (tally, found_by_method)
}

/// The results of every method in one or more scenes.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tally {
    pub crossing: usize,
    pub balls: Verdict,
    pub caps: Verdict,
    pub closest: Verdict,
    pub refined: Verdict,
    pub polygon: Verdict,
}

impl AddAssign for Tally {
    fn add_assign(&mut self, other: Self) {
        self.crossing += other.crossing;
        self.balls += other.balls;
        self.caps += other.caps;
        self.closest += other.closest;
        self.refined += other.refined;
        self.polygon += other.polygon;
    }
}

/// Known facts about a case: how many pairs touch, and the errors of the approximate methods. Balls contain their
/// triangles, so they miss no pair.
#[derive(Clone, Copy, Debug)]
pub struct Stated {
    /// Pairs of triangles that touch according to the reference. Must be equal; otherwise the case has changed.
    pub touching: usize,
    /// The most pairs that `BoundingSphere` may report although they are farther apart.
    pub false_by_balls: usize,
    /// The most touching pairs that `Circumsphere` may miss.
    pub missed_by_caps: usize,
    /// The most times that two bodies may touch while `Circumsphere` reports none of their touching pairs.
    pub bodies_missed_by_caps: usize,
    /// The most pairs that `Circumsphere` may report although they are farther apart.
    pub false_by_caps: usize,
}

impl Tally {
    /// Judges one tick of one method. Fails if an exact method is wrong.
    #[track_caller]
    pub fn add(&mut self, method: ContactMethod, found: &Found, truth: &Truth, what: &str) {
        if method.is_exact() {
            let verdict = judge_exact(found, truth, what);
            let Verdict { touching, missed, false_pairs, worst_separation_error: error, .. } = verdict;
            assert!(missed == 0 && false_pairs == 0, "{what}: {missed} of {touching} missed, {false_pairs} false");
            assert!(error <= SEPARATION_TOLERANCE, "{what}: a separation is wrong by {error:e} of its size");
            match method {
                ContactMethod::Closest => self.closest += verdict,
                ContactMethod::Exact => self.refined += verdict,
                _ => self.polygon += verdict,
            }
        } else {
            let verdict = judge(found, truth);
            if method == ContactMethod::Circumsphere { self.caps += verdict } else { self.balls += verdict }
        }
    }

    /// Compares with the stated facts about the case.
    #[track_caller]
    pub fn assert_as(&self, stated: Stated) {
        println!("{self:?}");
        assert_eq!(self.refined.touching, stated.touching, "the case has changed");
        assert_eq!(self.balls.missed, 0, "a ball that contains its triangle misses nothing");
        let Verdict { missed, bodies_missed, false_pairs, .. } = self.caps;
        let found = [self.balls.false_pairs, missed, bodies_missed, false_pairs];
        let Stated { false_by_balls, missed_by_caps, bodies_missed_by_caps, false_by_caps, .. } = stated;
        let bounds = [false_by_balls, missed_by_caps, bodies_missed_by_caps, false_by_caps];
        assert!(
            found.iter().zip(&bounds).all(|(found, bound)| found <= bound),
            "false by balls, missed, bodies missed and false by caps: {found:?} of {} touching, stated {bounds:?}",
            stated.touching
        );
    }
}
