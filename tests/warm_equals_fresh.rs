//! A running world finds the same as a new one: after any changes to components, shapes, parents, and settings, its
//! contacts are bit-identical to those of a new world with the same state.
//!
//! Only what is remembered on purpose is excluded: the side of a sheet on which something was. There, distances and
//! normals are compared up to their sign. Spheres are made anew whenever their surface moves (`refit_threshold` 0),
//! because otherwise their age would matter.
//!
//! `WARM_CHANGES=100000` sets the number of changes, `WARM_SEED=7` selects others.

use std::{collections::VecDeque, env, fmt::Debug};

use bevy_app::prelude::*;
use bevy_circumsphere::{
    CircumsphereSettings, ContactStore, StoredPair,
    geometry::{CompactContact, CurvatureEstimator},
    prelude::*,
};
use bevy_ecs::{entity_disabling::Disabled, prelude::*};
use bevy_tasks::{ComputeTaskPool, TaskPoolBuilder};
use bevy_transform::components::Transform;
use circumsphere_support::{
    random::Random,
    scenes::{Diagonals, Mesh, cuboid, duplicate_vertices, grid, icosphere, torus},
};
use glam::{Quat, Vec3};

/// The default number of changes, and the number of changes after which a world is replaced by a new one.
const CHANGES: usize = 2000;
const CHANGES_OF_A_WORLD: usize = 250;

/// The number of consecutive ticks for which surfaces creep, and then do not.
const TICKS_OF_A_MOOD: usize = 10;

const SURFACES: usize = 6;
const SHAPES: usize = 3;
const PARENTS: usize = 2;

/// Indices into the [`State`]: surfaces first, then shapes.
#[derive(Component, Clone, Copy, Debug, PartialEq, Eq)]
struct Place(usize);

/// The state that determines the contacts of a surface or shape.
#[derive(Clone, Debug)]
#[expect(clippy::struct_excessive_bools, reason = "each is a component that is there or not")]
struct Thing {
    /// Lower numbers became surfaces or shapes earlier. `None` if it has never been one.
    registered: Option<usize>,
    exists: bool,
    /// Whether it has its surface or shape.
    is_whole: bool,
    mesh: usize,
    positions: Vec<Vec3>,
    shape: usize,
    transform: Transform,
    parent: Option<usize>,
    thickness: SurfaceThickness,
    layers: SurfaceLayers,
    method: ContactMethod,
    sidedness: Sidedness,
    frame: SurfaceFrame,
    order: Option<u32>,
    meets_itself: bool,
    disabled: bool,
    hidden: bool,
}

impl Thing {
    /// Registers it once it is a surface or shape. Only the first time counts.
    fn register(&mut self, next: &mut usize) {
        if self.is_whole && self.registered.is_none() {
            self.registered = Some(*next);
            *next += 1;
        }
    }

    /// The same for a new entity.
    fn register_anew(&mut self, next: &mut usize) {
        self.registered = None;
        self.register(next);
    }
}

#[derive(Clone, Debug)]
struct State {
    things: Vec<Thing>,
    parents: Vec<Transform>,
    settings: CircumsphereSettings,
    next: usize,
}

struct Tools {
    meshes: Vec<Mesh>,
    shapes: Vec<SharedShape>,
}

fn points(mesh: &Mesh) -> Vec<Vec3> {
    mesh.positions.iter().copied().map(Vec3::from_array).collect()
}

impl Tools {
    fn new() -> Self {
        let triangle = |size: f32| Mesh {
            positions: vec![[0.0, 0.0, 0.0], [size, 0.1, 0.0], [0.0, 0.0, size]],
            triangles: vec![[0, 2, 1]],
        };
        let meshes = vec![
            icosphere(1, 0.5),
            cuboid([0.5, 0.4, 0.3], 1),
            grid(4, 4, 1.4, 1.4, Diagonals::Alternating),
            torus(0.5, 0.2, 8, 6),
            triangle(1.5),
            triangle(0.7),
            duplicate_vertices(&cuboid([0.4, 0.4, 0.4], 2)),
            grid(6, 3, 2.0, 1.0, Diagonals::Uniform),
        ];
        let tiles = grid(4, 4, 2.0, 2.0, Diagonals::Uniform);
        let shapes = vec![
            SharedShape::ball(0.5),
            SharedShape::cuboid(0.5, 0.2, 0.4),
            SharedShape::halfspace(Vec3::Y),
            SharedShape::capsule_y(0.4, 0.2),
            SharedShape::trimesh(points(&tiles), tiles.triangles).expect("it is a mesh"),
        ];
        Self { meshes, shapes }
    }

    fn surface(&self, thing: &Thing) -> (DeformableSurface, SurfacePositions) {
        let mesh = &self.meshes[thing.mesh];
        let (surface, _) = DeformableSurface::from_mesh(&points(mesh), &mesh.triangles).expect("it is a mesh");
        (surface, SurfacePositions(thing.positions.clone()))
    }

    /// Whether a shape is an open triangle mesh that is not set to have an inside.
    fn is_sheet(&self, thing: &Thing) -> bool {
        self.shapes[thing.shape].as_trimesh().is_some() && thing.sidedness != Sidedness::OneSided
    }

    fn is_one_sided(&self, thing: &Thing) -> bool {
        match thing.sidedness {
            Sidedness::OneSided => true,
            Sidedness::TwoSided => false,
            Sidedness::Auto => self.surface(thing).0.topology().is_closed(),
        }
    }
}

fn app(settings: CircumsphereSettings) -> App {
    let mut app = App::new();
    app.add_plugins(DeformableCollisionPlugins::new(Update));
    app.insert_resource(settings);
    app.finish();
    app.cleanup();
    app
}

/// A world with a given state.
struct Living {
    app: App,
    things: Vec<Option<Entity>>,
    parents: Vec<Entity>,
}

impl Living {
    /// A new world, with everything spawned in order.
    fn new(state: &State, tools: &Tools) -> Self {
        let mut app = app(state.settings);
        let parents = state.parents.iter().map(|&transform| app.world_mut().spawn(transform).id()).collect();
        let mut living = Self { app, things: vec![None; state.things.len()], parents };
        let mut order: Vec<usize> = (0..state.things.len()).collect();
        order.sort_by_key(|&place| state.things[place].registered);
        for place in order {
            if state.things[place].exists {
                living.spawn(place, &state.things[place], tools);
            }
        }
        living
    }

    fn spawn(&mut self, place: usize, thing: &Thing, tools: &Tools) {
        let mut entity = self.app.world_mut().spawn((Place(place), thing.transform, thing.layers));
        if place < SURFACES {
            entity.insert((thing.thickness, thing.method, thing.sidedness, thing.frame));
            if thing.is_whole {
                entity.insert(tools.surface(thing));
            }
            if thing.meets_itself {
                entity.insert(SelfCollision);
            }
        } else if thing.is_whole {
            entity.insert(RigidShape(tools.shapes[thing.shape].clone()));
        }
        if let Some(order) = thing.order {
            entity.insert(SurfaceOrder(order));
        }
        if let Some(parent) = thing.parent {
            entity.insert(ChildOf(self.parents[parent]));
        }
        if thing.disabled {
            entity.insert(SurfaceDisabled);
        }
        if thing.hidden {
            entity.insert(Disabled);
        }
        self.things[place] = Some(entity.id());
    }

    fn insert(&mut self, place: usize, bundle: impl Bundle) {
        if let Some(entity) = self.things[place] {
            self.app.world_mut().entity_mut(entity).insert(bundle);
        }
    }

    fn remove<B: Bundle>(&mut self, place: usize) {
        if let Some(entity) = self.things[place] {
            self.app.world_mut().entity_mut(entity).remove::<B>();
        }
    }

    fn set(&mut self, place: usize, is_there: bool, bundle: impl Bundle + Clone) {
        fn remove<B: Bundle>(living: &mut Living, place: usize, _: &B) {
            living.remove::<B>(place);
        }
        if is_there {
            self.insert(place, bundle);
        } else {
            remove(self, place, &bundle);
        }
    }

    fn store(&self) -> &ContactStore {
        self.app.world().resource()
    }

    fn place_of(&self, side: ContactSide) -> usize {
        self.app.world().get::<Place>(side.entity()).expect("all sides belong to this test").0
    }
}

struct Dice(Random);

impl Dice {
    fn below(&mut self, end: usize) -> usize {
        self.0.below(end as u64) as usize
    }

    fn chance(&mut self, of: usize) -> bool {
        self.below(of) == 0
    }

    fn pick<T: Copy>(&mut self, choices: &[T]) -> T {
        choices[self.below(choices.len())]
    }

    fn vector(&mut self) -> Vec3 {
        Vec3::from_array(std::array::from_fn(|_| self.0.signed_unit()))
    }

    fn transform(&mut self) -> Transform {
        if self.chance(2) {
            return Transform::IDENTITY;
        }
        let scale = self.pick(&[1.0, 1.0, 1.0, 0.5, 2.0]);
        let mirrored = if self.chance(6) { Vec3::new(-1.0, 1.0, 1.0) } else { Vec3::ONE };
        let turn = if self.chance(3) { Quat::IDENTITY } else { Quat::from_scaled_axis(2.0 * self.vector()) };
        Transform::from_translation(self.vector()).with_rotation(turn).with_scale(scale * mirrored)
    }

    fn thickness(&mut self) -> SurfaceThickness {
        self.pick(&[
            SurfaceThickness::World(0.05),
            SurfaceThickness::World(0.1),
            SurfaceThickness::World(0.0),
            SurfaceThickness::MeanEdges(0.1),
            SurfaceThickness::MeanEdges(0.3),
            SurfaceThickness::World(-1.0),
        ])
    }

    fn layers(&mut self) -> SurfaceLayers {
        self.pick(&[
            SurfaceLayers::default(),
            SurfaceLayers::default(),
            SurfaceLayers { memberships: 2, filters: 1 },
            SurfaceLayers { memberships: 1, filters: 1 },
            SurfaceLayers { memberships: 3, filters: u32::MAX },
        ])
    }

    fn thing(&mut self, number: usize, tools: &Tools) -> Thing {
        let mesh = self.below(tools.meshes.len());
        let offset = 0.7 * self.vector();
        Thing {
            registered: Some(number),
            exists: true,
            is_whole: true,
            mesh,
            positions: points(&tools.meshes[mesh]).iter().map(|&point| point + offset).collect(),
            shape: self.below(tools.shapes.len()),
            transform: self.transform(),
            parent: if self.chance(3) { Some(self.below(PARENTS)) } else { None },
            thickness: self.thickness(),
            layers: SurfaceLayers::default(),
            method: if self.chance(2) { ContactMethod::Exact } else { self.pick(&ContactMethod::ALL) },
            sidedness: Sidedness::Auto,
            frame: SurfaceFrame::Local,
            order: None,
            meets_itself: self.chance(2),
            disabled: false,
            hidden: false,
        }
    }

    fn state(&mut self, tools: &Tools) -> State {
        let things = (0..SURFACES + SHAPES).map(|number| self.thing(number, tools)).collect();
        let settings = CircumsphereSettings { refit_threshold: 0.0, threads: 1, ..CircumsphereSettings::default() };
        State { things, parents: vec![Transform::IDENTITY; PARENTS], settings, next: SURFACES + SHAPES }
    }
}

/// Applies a change to the state and to its world, and returns a description.
#[expect(clippy::too_many_lines, reason = "one arm for each kind of change")]
fn change(state: &mut State, living: &mut Living, tools: &Tools, dice: &mut Dice) -> String {
    let place = dice.below(SURFACES + SHAPES);
    let is_surface = place < SURFACES;
    if dice.chance(12) {
        return change_settings(state, living, dice);
    }
    if dice.chance(12) {
        let parent = dice.below(PARENTS);
        state.parents[parent] = dice.transform();
        living.app.world_mut().entity_mut(living.parents[parent]).insert(state.parents[parent]);
        return format!("parent {parent} moves");
    }
    let State { things, next, .. } = state;
    let thing = &mut things[place];
    if !thing.exists {
        thing.exists = true;
        thing.register_anew(next);
        living.spawn(place, thing, tools);
        return format!("{place} is spawned again");
    }
    let what = if is_surface { dice.below(20) } else { dice.pick(&[6, 6, 6, 7, 10, 11, 12, 13, 14, 15, 16, 17]) };
    let name: &dyn Debug = match what {
        0..=3 => {
            creep(things, living, dice);
            &"creep"
        }
        4 => {
            let (way, bend) = (0.4 * dice.vector(), 0.1 * dice.vector());
            thing.positions.iter_mut().for_each(|position| *position += way + bend * position.x * position.y);
            write(living, place, thing);
            &"move"
        }
        5 => {
            // Unusable positions, the same positions again, or valid ones again.
            match dice.below(4) {
                0 => thing.positions = Vec::new(),
                1 => thing.positions.truncate(2),
                2 => thing.positions.iter_mut().take(1).for_each(|position| position.y = f32::NAN),
                _ => {}
            }
            write(living, place, thing);
            if dice.chance(2) {
                let offset = 0.5 * dice.vector();
                thing.positions = points(&tools.meshes[thing.mesh]).iter().map(|&point| point + offset).collect();
                write(living, place, thing);
            }
            &"odd positions"
        }
        6 => {
            thing.transform = dice.transform();
            if dice.chance(20) {
                thing.transform.scale = Vec3::new(1.0, 2.0, 1.0);
            }
            living.insert(place, thing.transform);
            &"transform"
        }
        7 => {
            thing.parent = if thing.parent.is_some() { None } else { Some(dice.below(PARENTS)) };
            match thing.parent {
                Some(parent) => living.insert(place, ChildOf(living.parents[parent])),
                None => living.remove::<ChildOf>(place),
            }
            &"parent"
        }
        8 => {
            thing.thickness = dice.thickness();
            living.insert(place, thing.thickness);
            &"thickness"
        }
        9 => {
            thing.method = dice.pick(&ContactMethod::ALL);
            living.insert(place, thing.method);
            &"method"
        }
        10 => {
            thing.layers = dice.layers();
            living.insert(place, thing.layers);
            &"layers"
        }
        11 => {
            thing.order = dice.pick(&[None, Some(0), Some(1), Some(2), Some(3)]);
            match thing.order {
                Some(order) => living.insert(place, SurfaceOrder(order)),
                None => living.remove::<SurfaceOrder>(place),
            }
            &"order"
        }
        12 => {
            thing.disabled = !thing.disabled;
            living.set(place, thing.disabled, SurfaceDisabled);
            &"SurfaceDisabled"
        }
        13 => {
            thing.hidden = !thing.hidden;
            living.set(place, thing.hidden, Disabled);
            &"Disabled"
        }
        14 => {
            let entity = living.things[place].take().expect("the entity exists");
            living.app.world_mut().despawn(entity);
            thing.exists = false;
            if dice.chance(2) {
                // The entity may be reused at once.
                thing.exists = true;
                thing.register_anew(next);
                living.spawn(place, thing, tools);
            }
            &"despawn"
        }
        15 => {
            living.insert(place, Teleported);
            &"teleport"
        }
        16 if is_surface => {
            thing.mesh = dice.below(tools.meshes.len());
            let offset = 0.5 * dice.vector();
            thing.positions = points(&tools.meshes[thing.mesh]).iter().map(|&point| point + offset).collect();
            thing.is_whole = true;
            thing.register(next);
            living.insert(place, tools.surface(thing));
            &"mesh"
        }
        16 => {
            thing.shape = dice.below(tools.shapes.len());
            thing.is_whole = true;
            thing.register(next);
            living.insert(place, RigidShape(tools.shapes[thing.shape].clone()));
            &"shape"
        }
        17 => {
            thing.is_whole = !thing.is_whole;
            thing.register(next);
            match (is_surface, thing.is_whole) {
                (true, true) => living.insert(place, tools.surface(thing)),
                (true, false) => living.remove::<DeformableSurface>(place),
                (false, true) => living.insert(place, RigidShape(tools.shapes[thing.shape].clone())),
                (false, false) => living.remove::<RigidShape>(place),
            }
            &"surface or shape"
        }
        18 => {
            if dice.chance(2) {
                thing.meets_itself = !thing.meets_itself;
                living.set(place, thing.meets_itself, SelfCollision);
            } else {
                thing.sidedness = dice.pick(&[Sidedness::Auto, Sidedness::OneSided, Sidedness::TwoSided]);
                living.insert(place, thing.sidedness);
            }
            &"sides"
        }
        _ => {
            thing.frame = dice.pick(&[SurfaceFrame::Local, SurfaceFrame::World]);
            living.insert(place, thing.frame);
            &"frame"
        }
    };
    format!("{place}: {name:?}")
}

/// Moves surfaces by less than their contact distance, so that lists of near pairs are made and reused.
fn creep(things: &mut [Thing], living: &mut Living, dice: &mut Dice) {
    let length = dice.pick(&[0.0005, 0.001, 0.003]);
    for (place, thing) in things.iter_mut().enumerate().take(SURFACES).filter(|(_, thing)| thing.exists) {
        let way = length * dice.vector();
        thing.positions.iter_mut().for_each(|position| *position += way);
        write(living, place, thing);
    }
}

fn write(living: &mut Living, place: usize, thing: &Thing) {
    if let Some(entity) = living.things[place]
        && let Some(mut positions) = living.app.world_mut().get_mut::<SurfacePositions>(entity)
    {
        positions.0.clone_from(&thing.positions);
    }
}

fn change_settings(state: &mut State, living: &mut Living, dice: &mut Dice) -> String {
    let settings = &mut state.settings;
    match dice.below(8) {
        0 => settings.margin = dice.pick(&[0.0, 0.02, 0.1]),
        1 => settings.sphere_offset = dice.pick(&[0.0, 0.5, 1.0]),
        2 => settings.curvature_threshold = dice.pick(&[0.5, 2.0]),
        3 => settings.plane_cull = !settings.plane_cull,
        4 => settings.widen_cones = !settings.widen_cones,
        5 => {
            settings.estimator = dice.pick(&[CurvatureEstimator::SignedEdge, CurvatureEstimator::DualAngleDeficit]);
        }
        6 => settings.threads = dice.pick(&[1, 1, 2]),
        _ => settings.memory = !settings.memory,
    }
    living.app.insert_resource(*settings);
    "settings".to_owned()
}

/// A contact as text, up to its sign where that is remembered.
fn named(contact: &CompactContact, remembers: bool) -> String {
    let (mut normal, mut distance) = (contact.normal, contact.distance);
    if remembers {
        (normal, distance) = (normal.abs(), distance.abs());
    }
    let key = (contact.key, contact.triangles(), contact.features, contact.swapped, contact.is_shared);
    // A zero may have either sign.
    let numbers = (contact.barycentric_a, contact.barycentric_b, contact.point_b + 0.0, normal + 0.0, distance + 0.0);
    format!("{key:?} {numbers:?}")
}

fn compare(living: &Living, new: &Living, state: &State, tools: &Tools) -> Result<usize, String> {
    let sides = |world: &Living, pair: &StoredPair| [world.place_of(pair.a), world.place_of(pair.b)];
    let names =
        |world: &Living| -> Vec<[usize; 2]> { world.store().pairs().iter().map(|pair| sides(world, pair)).collect() };
    if names(living) != names(new) {
        return Err(format!("different pairs: {:?} instead of {:?}", names(living), names(new)));
    }
    for (warm, fresh) in living.store().pairs().iter().zip(new.store().pairs()) {
        let [a, b] = sides(living, warm);
        let things = [a, b].map(|place| &state.things[place]);
        let is_one_sided = |place: usize| {
            if place < SURFACES {
                tools.is_one_sided(&state.things[place])
            } else {
                // A triangle mesh shape is a sheet, and a pair with any other shape is not a pair of surfaces.
                !tools.is_sheet(&state.things[place])
            }
        };
        let remembers = a == b || !(is_one_sided(a) || is_one_sided(b));
        let what = format!("{a} and {b} ({:?}, {:?})", things[0].method, things[1].method);
        let distances = |pair: &StoredPair| (pair.contact_distance.to_bits(), pair.nearest.to_bits());
        if distances(warm) != distances(fresh) || format!("{:?}", warm.frame_pose) != format!("{:?}", fresh.frame_pose)
        {
            return Err(format!("{what}: nearest {} instead of {}, or another frame", warm.nearest, fresh.nearest));
        }
        if *warm.touching != *fresh.touching {
            return Err(format!("{what}: {} touching triangles, not {}", warm.touching.len(), fresh.touching.len()));
        }
        let list = |pair: &StoredPair| -> Vec<String> { pair.contacts.iter().map(|it| named(it, remembers)).collect() };
        let (warm, fresh) = (list(warm), list(fresh));
        if let Some(place) = (0..warm.len().max(fresh.len())).find(|&place| warm.get(place) != fresh.get(place)) {
            let (warm_one, fresh_one) = (warm.get(place), fresh.get(place));
            return Err(format!(
                "{what}: contact {place} of {}, {}:\n{warm_one:?}\n{fresh_one:?}",
                warm.len(),
                fresh.len()
            ));
        }
    }
    Ok(new.store().contact_count())
}

fn setting(name: &str, default: usize) -> usize {
    env::var(name).ok().and_then(|value| value.parse().ok()).unwrap_or(default)
}

#[test]
fn after_any_change_contacts_are_those_of_a_new_world() {
    ComputeTaskPool::get_or_init(|| TaskPoolBuilder::new().num_threads(1).build());
    let (tools, first_seed) = (Tools::new(), setting("WARM_SEED", 1));
    let worlds = setting("WARM_CHANGES", CHANGES).div_ceil(CHANGES_OF_A_WORLD);
    let (mut contacts, mut kept, mut followed, mut failures) = (0, 0, 0, Vec::new());
    for seed in first_seed..first_seed + worlds {
        let mut dice = Dice(Random::new(seed as u64));
        let mut state = dice.state(&tools);
        let mut living = Living::new(&state, &tools);
        let (mut changed, mut tick, mut lately) = (0, 0, VecDeque::new());
        while changed < CHANGES_OF_A_WORLD {
            let mut changes = Vec::new();
            // For several consecutive ticks, many surfaces creep and little else happens.
            let creeps = tick / TICKS_OF_A_MOOD % 2 == 1;
            if creeps {
                creep(&mut state.things, &mut living, &mut dice);
            }
            for _ in 0..dice.below(if creeps { 2 } else { 4 }) {
                changes.push(change(&mut state, &mut living, &tools, &mut dice));
            }
            changed += changes.len();
            tick += 1;
            lately.push_back(changes.join(", "));
            if lately.len() > 6 {
                lately.pop_front();
            }
            living.app.update();
            let mut new = Living::new(&state, &tools);
            new.app.update();
            let diagnostics = living.app.world().resource::<bevy_circumsphere::detection::DetectionDiagnostics>();
            kept += diagnostics.pairs_kept;
            followed += diagnostics.lists_reused;
            match compare(&living, &new, &state, &tools) {
                Ok(count) => contacts += count,
                Err(what) => {
                    let lately: Vec<_> = lately.into_iter().collect();
                    failures.push(format!("seed {seed}, tick {tick}, after\n  {}\n{what}", lately.join("\n  ")));
                    break;
                }
            }
        }
    }
    println!("{contacts} contacts, {kept} pairs kept, {followed} lists followed in {worlds} worlds");
    assert!(failures.is_empty(), "{} of {worlds} worlds disagree\n{}", failures.len(), failures.join("\n\n"));
    assert!(contacts > 100 * worlds && kept > worlds && followed > worlds, "too little is reused");
}
