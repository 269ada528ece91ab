//! Measures one scene with one configuration: missed and false pairs, accuracy, steadiness, and costs.

use std::{collections::HashMap, time::Duration};

use bevy_circumsphere::{
    ContactMethod,
    detection::StageDiagnostics,
    geometry::{CompactContact, Feature, FeatureKind, feature_number},
};
use circumsphere_reports::statistics::{Spread, mean, median};
use glam::DVec3;
use serde::Serialize;

use super::{
    configurations::{Configuration, estimator_name},
    options::Extent,
    player::{Memory, PlayedTick, TickCost, play},
    scene::Scene,
    truth::{BAND, PairName, TrueTick},
};

/// Smallest number of ticks in which a configuration is timed. Scenes with fewer ticks are played several times.
const TIMED_TICKS: usize = 5;

/// Two contacts of one pair of triangles count as the same if their distances differ by less than this share of the
/// pair's size. Single precision resolves distances to about 1e-7 of it.
const SAME_FEATURES: f64 = 1.0e-5;

/// One line of `measures.csv`. Rates are shares from 0 to 1, and angles are in degrees. Columns whose names start with
/// `time` are times. All other columns are equal in any two runs on one machine.
#[derive(Clone, Debug, Default, Serialize)]
pub struct MeasureRow {
    pub scene: String,
    pub configuration: String,
    pub method: String,
    pub sphere_offset: Option<f32>,
    pub plane_cull: Option<bool>,
    pub widen_cones: Option<bool>,
    pub estimator: Option<&'static str>,
    pub curvature_threshold: Option<f32>,
    pub refit_threshold: Option<f32>,
    pub contact_distance_edges: f64,
    pub ticks: usize,
    pub ticks_measured: usize,
    /// Pairs of triangles that must be found, over the measured ticks.
    pub true_pairs: usize,
    pub found_pairs: usize,
    pub missed_pairs: usize,
    pub false_pairs: usize,
    /// Pairs within the band, which a method may report or not.
    pub band_pairs: usize,
    /// Missed pairs / true pairs: 1 − recall.
    pub pair_miss_rate: Option<f64>,
    /// False pairs / found pairs: 1 − precision.
    pub pair_false_rate: Option<f64>,
    /// 1 − F1, where F1 is the harmonic mean of recall and precision.
    pub pair_error: Option<f64>,
    pub true_triangles: usize,
    pub triangle_miss_rate: Option<f64>,
    pub triangle_false_rate: Option<f64>,
    pub true_vertices: usize,
    pub vertex_miss_rate: Option<f64>,
    pub vertex_false_rate: Option<f64>,
    /// Touching pairs of bodies, including bodies with themselves, and the share of them for which nothing is found.
    pub true_body_pairs: usize,
    pub object_miss_rate: Option<f64>,
    /// |found − true|, relative to the contact distance or the longest edge, whichever is larger, over true pairs that
    /// were found.
    pub separation_error_median: Option<f64>,
    pub separation_error_p99: Option<f64>,
    pub separation_error_max: Option<f64>,
    pub crossing_pairs_found: usize,
    /// The same for crossing pairs, whose true distance is 0.
    pub crossing_separation_error_median: Option<f64>,
    pub crossing_separation_error_p99: Option<f64>,
    pub crossing_separation_error_max: Option<f64>,
    /// Angle between a contact's normal and the direction between the closest features of its pair.
    pub normals_measured: usize,
    pub normal_error_median: Option<f64>,
    pub normal_error_p99: Option<f64>,
    pub normal_error_max: Option<f64>,
    /// Found pairs that do not cross and whose closest features have no contact.
    pub pairs_without_contact: usize,
    /// 1 − |both ticks| / |either tick|, for contact keys and for touching pairs; mean over ticks.
    pub contact_churn: Option<f64>,
    pub pair_churn: Option<f64>,
    /// Rotation of the normal of a persistent contact within a tick.
    pub normal_jump_median: Option<f64>,
    pub normal_jump_p99: Option<f64>,
    pub normal_jump_max: Option<f64>,
    /// The same for contacts that are crossings in both ticks, where an edge pierces a face.
    pub crossing_normal_jump_p99: Option<f64>,
    pub crossing_normal_jump_max: Option<f64>,
    pub candidates_per_tick: f64,
    pub contacts_per_tick: f64,
    /// Without the first tick, which makes every recipe.
    pub recipes_refreshed_per_tick: Option<f64>,
    pub recipes_refreshed_share: Option<f64>,
    pub bytes_per_triangle: f64,
    pub bytes_per_candidate: Option<f64>,
    pub bytes_per_contact: Option<f64>,
    /// Median over ticks of the fastest round. The first tick is left out if there are others.
    pub time_ms: f64,
}

/// One line of `stages.csv`.
#[derive(Clone, Debug, Serialize)]
pub struct StageRow {
    pub scene: String,
    pub configuration: String,
    pub method: String,
    pub contact_distance_edges: f64,
    pub stage: &'static str,
    pub pairs_in_per_tick: f64,
    pub pairs_out_per_tick: f64,
    pub time_ms: f64,
}

/// A measured configuration.
pub struct Measured {
    pub configuration: Configuration,
    pub row: MeasureRow,
    pub stages: Vec<StageRow>,
    /// The costs of each tick, round by round.
    rounds: Vec<Vec<TickCost>>,
}

pub fn milliseconds(duration: Duration) -> f64 {
    duration.as_secs_f64() * 1.0e3
}

fn share(part: usize, whole: usize) -> Option<f64> {
    (whole > 0).then(|| part as f64 / whole as f64)
}

/// Number of rounds in which a scene is timed. Other programs disturb the times, and a tick's fastest round is the
/// least disturbed.
pub fn rounds(scene: &Scene, extent: Extent) -> usize {
    let least = match extent {
        Extent::Smoke => 1,
        Extent::Quick | Extent::Full => 2,
    };
    least.max(TIMED_TICKS.div_ceil(scene.ticks()))
}

/// Plays a scene with a configuration and compares the results with the truth, which must cover the configuration's
/// contact distance.
pub fn measure(scene: &Scene, truth: &[TrueTick], configuration: &Configuration) -> Measured {
    let Configuration { method, settings, distance_edges, .. } = *configuration;
    let mut errors = Errors::new(scene, distance_edges, method);
    let mut steadiness = Steadiness::default();
    let (costs, memory) = play(scene, method, settings, distance_edges, |played| {
        steadiness.add(played);
        if let Ok(place) = scene.measured.binary_search(&played.tick) {
            errors.add(played, &truth[place]);
        }
    });
    let mut row = MeasureRow {
        scene: scene.name.clone(),
        configuration: configuration.name.clone(),
        method: format!("{method:?}"),
        contact_distance_edges: distance_edges,
        ticks: scene.ticks(),
        ticks_measured: scene.measured.len(),
        ..MeasureRow::default()
    };
    if method == ContactMethod::Circumsphere {
        row.sphere_offset = Some(settings.sphere_offset);
        row.plane_cull = Some(settings.plane_cull);
        row.widen_cones = Some(settings.widen_cones);
        row.estimator = Some(estimator_name(settings.estimator));
        row.curvature_threshold = Some(settings.curvature_threshold);
        row.refit_threshold = Some(settings.refit_threshold);
    }
    errors.write(&mut row);
    steadiness.write(&mut row);
    write_costs(scene, &costs, memory, &mut row);
    let stages = stage_rows(&row, &costs);
    let mut measured = Measured { configuration: configuration.clone(), row, stages, rounds: vec![costs] };
    measured.set_times();
    measured
}

impl Measured {
    /// Plays the scene once more to measure times only.
    pub fn time_again(&mut self, scene: &Scene) {
        let Configuration { method, settings, distance_edges, .. } = self.configuration;
        self.rounds.push(play(scene, method, settings, distance_edges, |_| ()).0);
        self.set_times();
    }

    fn set_times(&mut self) {
        let rounds = &self.rounds;
        self.row.time_ms = steady_median(rounds, |cost| Some(cost.total)).unwrap_or_default();
        for stage in &mut self.stages {
            let time = |cost: &TickCost| find_stage(cost, stage.stage).map(|found| found.duration);
            stage.time_ms = steady_median(rounds, time).unwrap_or_default();
        }
    }
}

/// The median over ticks of each tick's fastest round, in milliseconds. The first tick is left out if there are others.
fn steady_median(rounds: &[Vec<TickCost>], value: impl Fn(&TickCost) -> Option<Duration>) -> Option<f64> {
    let ticks = rounds[0].len();
    let fastest = |tick: usize| rounds.iter().filter_map(|costs| value(&costs[tick])).min().map(milliseconds);
    median((usize::from(ticks > 1)..ticks).filter_map(fastest).collect())
}

fn find_stage<'a>(cost: &'a TickCost, name: &str) -> Option<&'a StageDiagnostics> {
    cost.stages.iter().find(|stage| stage.name == name)
}

fn write_costs(scene: &Scene, costs: &[TickCost], memory: Memory, row: &mut MeasureRow) {
    let per_tick =
        |value: fn(&TickCost) -> usize| mean(costs.iter().map(|cost| value(cost) as f64)).unwrap_or_default();
    row.candidates_per_tick = per_tick(|cost| cost.candidates);
    row.contacts_per_tick = per_tick(|cost| cost.contacts);
    row.recipes_refreshed_per_tick = mean(costs.iter().skip(1).map(|cost| cost.recipes_refreshed as f64));
    row.recipes_refreshed_share = row.recipes_refreshed_per_tick.map(|count| count / scene.triangles() as f64);
    let last = costs.last();
    let lists = memory.candidate_lists + memory.contact_lists;
    row.bytes_per_triangle = memory.all.saturating_sub(lists) as f64 / scene.triangles() as f64;
    row.bytes_per_candidate = last.and_then(|cost| share(memory.candidate_lists, cost.candidates));
    row.bytes_per_contact = last.and_then(|cost| share(memory.contact_lists, cost.contacts));
}

fn stage_rows(row: &MeasureRow, costs: &[TickCost]) -> Vec<StageRow> {
    let mut names: Vec<&'static str> = Vec::new();
    for stage in costs.iter().flat_map(|cost| &cost.stages) {
        if !names.contains(&stage.name) {
            names.push(stage.name);
        }
    }
    names
        .into_iter()
        .map(|name| {
            let pairs = |value: fn(&StageDiagnostics) -> usize| {
                mean(costs.iter().map(|cost| find_stage(cost, name).map_or(0, value) as f64)).unwrap_or_default()
            };
            StageRow {
                scene: row.scene.clone(),
                configuration: row.configuration.clone(),
                method: row.method.clone(),
                contact_distance_edges: row.contact_distance_edges,
                stage: name,
                pairs_in_per_tick: pairs(|stage| stage.pairs_in),
                pairs_out_per_tick: pairs(|stage| stage.pairs_out),
                time_ms: 0.0,
            }
        })
        .collect()
}

/// Counts of items that are required, missed, found, and false.
#[derive(Default)]
struct Marks {
    required: usize,
    missed: usize,
    found: usize,
    made_up: usize,
}

impl Marks {
    const REQUIRED: u8 = 1;
    const ALLOWED: u8 = 2;
    const FOUND: u8 = 4;

    fn count(&mut self, marks: &[u8]) {
        for &mark in marks {
            let has = |bit: u8| mark & bit != 0;
            self.required += usize::from(has(Self::REQUIRED));
            self.missed += usize::from(has(Self::REQUIRED) && !has(Self::FOUND));
            self.found += usize::from(has(Self::FOUND));
            self.made_up += usize::from(has(Self::FOUND) && !has(Self::ALLOWED));
        }
    }
}

/// Errors of a method over the measured ticks.
struct Errors<'a> {
    scene: &'a Scene,
    distance: f64,
    /// Whether the method reports exact features.
    exact: bool,
    matched: usize,
    missed: usize,
    made_up: usize,
    found: usize,
    in_band: usize,
    triangles: Marks,
    vertices: Marks,
    body_pairs: Marks,
    separations: Vec<f64>,
    crossing_separations: Vec<f64>,
    normals: Vec<f64>,
    without_contact: usize,
}

impl<'a> Errors<'a> {
    fn new(scene: &'a Scene, distance_edges: f64, method: ContactMethod) -> Self {
        Self {
            scene,
            distance: scene.thickness(distance_edges).1,
            exact: method.is_exact(),
            matched: 0,
            missed: 0,
            made_up: 0,
            found: 0,
            in_band: 0,
            triangles: Marks::default(),
            vertices: Marks::default(),
            body_pairs: Marks::default(),
            separations: Vec::new(),
            crossing_separations: Vec::new(),
            normals: Vec::new(),
            without_contact: 0,
        }
    }

    fn add(&mut self, played: &PlayedTick, truth: &TrueTick) {
        let found = touching_pairs(played);
        self.found += found.len();
        let (required_up_to, allowed_up_to) = (self.distance * (1.0 - BAND), self.distance * (1.0 + BAND));
        let normals = ContactNormals::new(self.scene, played);
        let mut marks = TickMarks::new(self.scene);
        let mut unmatched = found.iter().peekable();
        let mut made_up = 0;
        for pair in truth.iter().filter(|pair| pair.distance <= allowed_up_to) {
            while unmatched.next_if(|(name, _)| *name < pair.name).is_some() {
                made_up += 1;
            }
            let is_required = pair.distance <= required_up_to;
            marks.set(pair.name, if is_required { Marks::REQUIRED | Marks::ALLOWED } else { Marks::ALLOWED });
            self.in_band += usize::from(!is_required);
            let Some(&(_, found_distance)) = unmatched.next_if(|(name, _)| *name == pair.name) else {
                self.missed += usize::from(is_required);
                continue;
            };
            self.matched += usize::from(is_required);
            let separations = if pair.crosses { &mut self.crossing_separations } else { &mut self.separations };
            separations.push((found_distance - pair.distance).abs() / self.distance.max(pair.size));
            if let Some(direction) = pair.direction {
                match normals.of(pair.name, self.exact) {
                    // With exact features, the contact must belong to the closest features.
                    Some((normal, distance))
                        if !self.exact
                            || (distance.abs() - pair.distance).abs()
                                <= SAME_FEATURES * self.distance.max(pair.size) =>
                    {
                        self.normals.push(normal_error(normal, distance, direction));
                    }
                    _ => self.without_contact += 1,
                }
            }
        }
        self.made_up += made_up + unmatched.count();
        for (name, _) in &found {
            marks.set(*name, Marks::FOUND);
        }
        self.triangles.count(&marks.triangles.concat());
        self.vertices.count(&marks.vertices.concat());
        self.body_pairs.count(&marks.body_pairs);
    }

    fn write(self, row: &mut MeasureRow) {
        let required = self.matched + self.missed;
        row.true_pairs = required;
        row.found_pairs = self.found;
        row.missed_pairs = self.missed;
        row.false_pairs = self.made_up;
        row.band_pairs = self.in_band;
        row.pair_miss_rate = share(self.missed, required);
        row.pair_false_rate = share(self.made_up, self.found);
        row.pair_error = share(self.missed + self.made_up, 2 * self.matched + self.missed + self.made_up);
        row.true_triangles = self.triangles.required;
        row.triangle_miss_rate = share(self.triangles.missed, self.triangles.required);
        row.triangle_false_rate = share(self.triangles.made_up, self.triangles.found);
        row.true_vertices = self.vertices.required;
        row.vertex_miss_rate = share(self.vertices.missed, self.vertices.required);
        row.vertex_false_rate = share(self.vertices.made_up, self.vertices.found);
        row.true_body_pairs = self.body_pairs.required;
        row.object_miss_rate = share(self.body_pairs.missed, self.body_pairs.required);
        let separation = Spread::of(self.separations);
        row.separation_error_median = separation.median;
        row.separation_error_p99 = separation.p99;
        row.separation_error_max = separation.max;
        row.crossing_pairs_found = self.crossing_separations.len();
        let crossing = Spread::of(self.crossing_separations);
        row.crossing_separation_error_median = crossing.median;
        row.crossing_separation_error_p99 = crossing.p99;
        row.crossing_separation_error_max = crossing.max;
        row.normals_measured = self.normals.len();
        let normal = Spread::of(self.normals);
        row.normal_error_median = normal.median;
        row.normal_error_p99 = normal.p99;
        row.normal_error_max = normal.max;
        row.pairs_without_contact = self.without_contact;
    }
}

/// All touching pairs with their distances, sorted by name.
fn touching_pairs(played: &PlayedTick) -> Vec<(PairName, f64)> {
    let mut pairs: Vec<(PairName, f64)> = Vec::with_capacity(played.store.touching_count());
    for stored in played.store.pairs() {
        let bodies = [stored.a, stored.b].map(|side| played.body(side.entity()) as u32);
        pairs.extend(
            stored
                .touching
                .iter()
                .map(|touching| ([bodies[0], bodies[1], touching.triangle_a, touching.triangle_b], touching.distance)),
        );
    }
    pairs.sort_unstable_by_key(|(name, _)| *name);
    pairs
}

/// The triangles, vertices, and pairs of bodies that touch in one tick, and those that are found.
struct TickMarks<'a> {
    scene: &'a Scene,
    triangles: Vec<Vec<u8>>,
    vertices: Vec<Vec<u8>>,
    body_pairs: Vec<u8>,
}

impl<'a> TickMarks<'a> {
    fn new(scene: &'a Scene) -> Self {
        Self {
            scene,
            triangles: scene.bodies.iter().map(|body| vec![0; body.triangles.len()]).collect(),
            vertices: scene.bodies.iter().map(|body| vec![0; body.ticks[0].len()]).collect(),
            body_pairs: vec![0; scene.bodies.len() * scene.bodies.len()],
        }
    }

    fn set(&mut self, [body_a, body_b, triangle_a, triangle_b]: PairName, mark: u8) {
        for (body, triangle) in [(body_a as usize, triangle_a as usize), (body_b as usize, triangle_b as usize)] {
            self.triangles[body][triangle] |= mark;
            for vertex in self.scene.bodies[body].triangles[triangle] {
                self.vertices[body][vertex as usize] |= mark;
            }
        }
        self.body_pairs[body_a as usize * self.scene.bodies.len() + body_b as usize] |= mark;
    }
}

/// A feature of a body: its kind, and its number among the body's features of that kind.
type FeatureName = (u8, u32);

const FEATURES: [Feature; 7] = [
    Feature::Vertex(0),
    Feature::Vertex(1),
    Feature::Vertex(2),
    Feature::Edge(0),
    Feature::Edge(1),
    Feature::Edge(2),
    Feature::Face,
];

/// Normals and distances of a tick's contacts, by features. A contact represents all pairs of triangles that have its
/// two features.
struct ContactNormals<'a> {
    scene: &'a Scene,
    played: &'a PlayedTick<'a>,
    of_features: HashMap<([u32; 2], FeatureName, FeatureName), (DVec3, f64)>,
}

const fn rank(feature: Feature) -> u8 {
    match feature {
        Feature::Vertex(_) => 0,
        Feature::Edge(_) => 1,
        Feature::Face => 2,
    }
}

impl<'a> ContactNormals<'a> {
    fn new(scene: &'a Scene, played: &'a PlayedTick<'a>) -> Self {
        let mut of_features = HashMap::new();
        for stored in played.store.pairs() {
            let bodies = [stored.a, stored.b].map(|side| played.body(side.entity()) as u32);
            for contact in stored.contacts.iter() {
                let numbers = contact.feature_numbers();
                let names = ((rank(contact.features.a), numbers[0]), (rank(contact.features.b), numbers[1]));
                let normal = stored.frame_pose.transform_direction(contact.normal.as_dvec3());
                let distance = f64::from(contact.distance);
                of_features.insert((bodies, names.0, names.1), (normal, distance));
                if bodies[0] == bodies[1] {
                    of_features.insert((bodies, names.1, names.0), (-normal, distance));
                }
            }
        }
        Self { scene, played, of_features }
    }

    /// The contact of the closest features of a touching pair of triangles.
    fn of(&self, [body_a, body_b, triangle_a, triangle_b]: PairName, exact: bool) -> Option<(DVec3, f64)> {
        // Spheres touch as whole faces.
        let features = if exact { &FEATURES[..] } else { &FEATURES[6..] };
        let name = |body: u32, triangle: u32, feature: Feature| {
            let positions = &self.scene.bodies[body as usize].ticks[self.played.tick];
            (rank(feature), feature_number(&self.played.topologies[body as usize], positions, triangle, feature))
        };
        let names = |body: u32, triangle: u32| features.iter().map(move |&feature| name(body, triangle, feature));
        let names_b: Vec<FeatureName> = names(body_b, triangle_b).collect();
        names(body_a, triangle_a)
            .flat_map(|name_a| names_b.iter().map(move |&name_b| (name_a, name_b)))
            .filter_map(|(name_a, name_b)| self.of_features.get(&([body_a, body_b], name_a, name_b)).copied())
            .min_by(|(_, a), (_, b)| a.abs().total_cmp(&b.abs()))
    }
}

/// Angle in degrees between a contact's normal and the direction between its pair's closest points. The normal of a
/// penetrating contact points in the direction that separates the sides, so either direction along that line is right.
fn normal_error(normal: DVec3, distance: f64, direction: DVec3) -> f64 {
    let angle = normal.angle_between(direction).to_degrees();
    if distance < 0.0 { angle.min(180.0 - angle) } else { angle }
}

/// Changes of contacts from tick to tick.
#[derive(Default)]
struct Steadiness {
    last: Option<TickContacts>,
    contact_churns: Vec<f64>,
    pair_churns: Vec<f64>,
    jumps: Vec<f64>,
    crossing_jumps: Vec<f64>,
}

struct TickContacts {
    /// Bodies, key, normal, and whether it is a crossing. Sorted by bodies and key. The key includes the kinds of the
    /// features.
    contacts: Vec<([u32; 2], u64, DVec3, bool)>,
    pairs: Vec<PairName>,
}

impl TickContacts {
    fn of(played: &PlayedTick) -> Self {
        let mut contacts = Vec::with_capacity(played.store.contact_count());
        for stored in played.store.pairs() {
            let bodies = [stored.a, stored.b].map(|side| played.body(side.entity()) as u32);
            contacts.extend(stored.contacts.iter().map(|contact: &CompactContact| {
                let normal = stored.frame_pose.transform_direction(contact.normal.as_dvec3());
                let crosses = contact.features.kind() == FeatureKind::EdgeFace;
                (bodies, contact.key.0, if contact.swapped { -normal } else { normal }, crosses)
            }));
        }
        contacts.sort_by_key(|&(bodies, key, ..)| (bodies, key));
        Self { contacts, pairs: touching_pairs(played).into_iter().map(|(name, _)| name).collect() }
    }
}

impl Steadiness {
    fn add(&mut self, played: &PlayedTick) {
        let now = TickContacts::of(played);
        if let Some(last) = &self.last {
            let mut lasting = 0;
            let mut before = last.contacts.iter().peekable();
            for (bodies, key, normal, crosses) in &now.contacts {
                while before.next_if(|other| (other.0, other.1) < (*bodies, *key)).is_some() {}
                if let Some((_, _, old, _)) = before.next_if(|other| (other.0, other.1) == (*bodies, *key)) {
                    lasting += 1;
                    let jumps = if *crosses { &mut self.crossing_jumps } else { &mut self.jumps };
                    jumps.push(normal.angle_between(*old).to_degrees());
                }
            }
            self.contact_churns.extend(churn(last.contacts.len(), now.contacts.len(), lasting));
            let lasting = now.pairs.iter().filter(|name| last.pairs.binary_search(name).is_ok()).count();
            self.pair_churns.extend(churn(last.pairs.len(), now.pairs.len(), lasting));
        }
        self.last = Some(now);
    }

    fn write(self, row: &mut MeasureRow) {
        row.contact_churn = mean(self.contact_churns);
        row.pair_churn = mean(self.pair_churns);
        let jump = Spread::of(self.jumps);
        row.normal_jump_median = jump.median;
        row.normal_jump_p99 = jump.p99;
        row.normal_jump_max = jump.max;
        let crossing = Spread::of(self.crossing_jumps);
        row.crossing_normal_jump_p99 = crossing.p99;
        row.crossing_normal_jump_max = crossing.max;
    }
}

/// Churn from the counts of two ticks. `None` if both are empty.
fn churn(before: usize, now: usize, both: usize) -> Option<f64> {
    share(before + now - 2 * both, before + now - both)
}
