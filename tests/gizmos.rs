//! The lines that the gizmo plugin draws, read from the assets that Bevy would render, against the world that they show.
//!
//! `cargo test --features gizmos,mesh --test gizmos`

use std::{
    collections::{BTreeMap, BTreeSet},
    time::Duration,
};

use bevy_app::prelude::*;
use bevy_asset::{AssetPlugin, Assets};
use bevy_circumsphere::{
    ContactStore, EnclosingBalls,
    debug::{DeformableGizmos, DeformableGizmosPlugin, LevelOfDetail},
    prelude::*,
};
use bevy_ecs::{prelude::*, system::RunSystemOnce};
use bevy_gizmos::{GizmoAsset, GizmoHandles, GizmoPlugin, config::GizmoConfigStore};
use bevy_time::{TimePlugin, TimeUpdateStrategy};
use bevy_transform::components::Transform;
use circumsphere_support::scenes::{Diagonals, Mesh, grid, icosphere};
use glam::{Quat, Vec3};

/// A line: its ends and its color, bit by bit, so that lines can be counted.
type Line = ([[u32; 3]; 2], [u32; 4]);

const THIN: SurfaceThickness = SurfaceThickness::World(0.02);

/// Colors of the layers, as a screen takes them.
const NORMALS: [u8; 3] = [240, 228, 66];
const TOUCHING: [u8; 3] = [230, 159, 0];
const PENETRATING: [u8; 3] = [213, 94, 0];
const NEAR: [u8; 3] = [86, 180, 233];
const CROSSINGS: [u8; 3] = [204, 121, 167];

fn linear([red, green, blue]: [u8; 3]) -> [u32; 4] {
    let color: bevy_color::LinearRgba = bevy_color::Srgba::rgb_u8(red, green, blue).into();
    [color.red, color.green, color.blue, color.alpha].map(f32::to_bits)
}

fn app(schedule: impl bevy_ecs::schedule::ScheduleLabel, draws: bool) -> App {
    let mut app = App::new();
    app.add_plugins((TaskPoolPlugin::default(), AssetPlugin::default(), TimePlugin, GizmoPlugin));
    app.add_plugins(DeformableCollisionPlugins::new(schedule));
    if draws {
        app.add_plugins(DeformableGizmosPlugin);
    }
    app.finish();
    app.cleanup();
    app
}

fn layers(app: &mut App) -> Mut<'_, DeformableGizmos> {
    app.world_mut().resource_mut::<GizmoConfigStore>().map_unchanged(|store| store.config_mut::<DeformableGizmos>().1)
}

fn nothing() -> DeformableGizmos {
    DeformableGizmos {
        meshes: LevelOfDetail::Off,
        shapes: false,
        contacts: false,
        penetrations: false,
        patches: LevelOfDetail::Off,
        ..DeformableGizmos::default()
    }
}

fn everything() -> DeformableGizmos {
    DeformableGizmos {
        patches: LevelOfDetail::All,
        pairs: LevelOfDetail::All,
        spheres: LevelOfDetail::All,
        cones: LevelOfDetail::All,
        curvature: LevelOfDetail::All,
        recipe_age: LevelOfDetail::All,
        tree_levels: u32::MAX,
        ..DeformableGizmos::default()
    }
}

/// All lines of the last update, with their numbers.
fn lines(app: &App) -> BTreeMap<Line, usize> {
    let mut lines = BTreeMap::new();
    let mut add = |ends: [Vec3; 2], color: bevy_color::LinearRgba| {
        let color = [color.red, color.green, color.blue, color.alpha].map(f32::to_bits);
        *lines.entry((ends.map(|end| end.to_array().map(f32::to_bits)), color)).or_default() += 1;
    };
    let assets = app.world().resource::<Assets<GizmoAsset>>();
    for handle in app.world().resource::<GizmoHandles>().handles().values().flatten() {
        let buffer = assets.get(handle).expect("the handle is that of an asset").buffer().buffer();
        for (ends, colors) in buffer.list_positions.as_chunks::<2>().0.iter().zip(buffer.list_colors.as_chunks::<2>().0)
        {
            add(*ends, colors[0]);
        }
        for (ends, colors) in buffer.strip_positions.windows(2).zip(buffer.strip_colors.windows(2)) {
            if !ends[0].is_nan() && !ends[1].is_nan() {
                add([ends[0], ends[1]], colors[0]);
            }
        }
    }
    lines
}

fn ends(line: &Line) -> [Vec3; 2] {
    line.0.map(|end| Vec3::from_array(end.map(f32::from_bits)))
}

fn of_color(lines: &BTreeMap<Line, usize>, color: [u8; 3]) -> Vec<[Vec3; 2]> {
    let of_color = lines.iter().filter(|(line, _)| line.1 == linear(color));
    of_color.flat_map(|(line, &count)| std::iter::repeat_n(ends(line), count)).collect()
}

/// The lines of the next update, with these layers.
fn drawn(app: &mut App, shown: DeformableGizmos) -> BTreeMap<Line, usize> {
    *layers(app) = shown;
    app.update();
    lines(app)
}

fn spawn(app: &mut App, mesh: &Mesh, extra: impl Bundle) -> Entity {
    let positions: Vec<Vec3> = mesh.positions.iter().copied().map(Vec3::from_array).collect();
    let surface = DeformableSurface::from_mesh(&positions, &mesh.triangles).expect("the mesh is valid");
    app.world_mut().spawn((surface, extra)).id()
}

/// A sheet with a wave, a ball that is in it, a ball above it with a pose, a solid, and a smooth ball that touches the
/// solid. The methods differ, so that every layer has something to show.
struct Scene {
    sheet: Entity,
    balls: [Entity; 2],
    sheet_mesh: Mesh,
}

fn scene(app: &mut App) -> Scene {
    let mut sheet_mesh = grid(8, 8, 2.0, 2.0, Diagonals::Uniform);
    for position in &mut sheet_mesh.positions {
        position[1] = 0.05 * bevy_math::ops::sin(4.0 * position[0]);
    }
    let sheet = spawn(app, &sheet_mesh, THIN);
    let at = |x: f32, y: f32, z: f32| Transform::from_xyz(x, y, z);
    let caps = spawn(app, &icosphere(2, 0.3), (THIN, ContactMethod::Circumsphere, at(-0.5, 0.2, 0.0)));
    let placed = at(0.5, 0.47, 0.0).with_rotation(Quat::from_rotation_x(0.4)).with_scale(Vec3::splat(1.5));
    let bounding = ContactMethod::BoundingSphere;
    let balls = [
        spawn(app, &icosphere(2, 0.3), (THIN, bounding, placed)),
        spawn(app, &icosphere(1, 0.3), (THIN, bounding, at(0.9, 1.05, 0.2))),
    ];
    spawn(app, &icosphere(2, 0.3), (THIN, ContactMethod::Circumsphere, at(-0.5, 0.79, 0.0)));
    let smooth = spawn(app, &icosphere(1, 0.3), (THIN, SurfaceShape::Smooth, at(5.0, 0.0, 0.0)));
    app.world_mut().spawn((RigidShape(SharedShape::ball(0.5)), at(5.0, 0.79, 0.0)));
    app.world_mut().spawn((RigidShape(SharedShape::halfspace(Vec3::Y)), at(0.0, -0.03, 0.0)));
    assert_ne!(caps, smooth);
    Scene { sheet, balls, sheet_mesh }
}

/// A contact, as a game reads it.
struct Seen {
    sides: [Entity; 2],
    points: [Vec3; 2],
    normal: Vec3,
    is_crossing: bool,
    distance: f32,
    separation: f32,
}

fn contacts(app: &mut App) -> Vec<Seen> {
    let seen = |contact: Contact| Seen {
        sides: [contact.a().entity(), contact.b().entity()],
        points: contact.points().into(),
        normal: contact.normal(),
        is_crossing: contact.is_crossing(),
        distance: contact.distance(),
        separation: contact.separation(),
    };
    let read = move |contacts: SurfaceContacts| contacts.iter().map(seen).collect::<Vec<_>>();
    app.world_mut().run_system_once(read).expect("the parameters are there")
}

/// The mean length of a surface's edges in world units.
fn mean_edge(app: &App, surface: Entity) -> Option<f32> {
    let world = app.world();
    let positions = world.get::<SurfacePositions>(surface)?;
    let topology = world.get::<DeformableSurface>(surface)?.topology();
    let edges: BTreeSet<[u32; 2]> = topology
        .triangles()
        .iter()
        .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
        .map(|[a, b]| [a.min(b), a.max(b)])
        .collect();
    let length = |[a, b]: &[u32; 2]| positions.0[*a as usize].distance(positions.0[*b as usize]);
    let scale = world.get::<Transform>(surface).map_or(1.0, |transform| transform.scale.x);
    Some(edges.iter().map(length).sum::<f32>() / edges.len() as f32 * scale)
}

#[test]
fn every_contact_has_its_point_and_its_normal() {
    let mut app = app(Update, true);
    scene(&mut app);
    app.insert_resource(CircumsphereSettings { margin: 0.02, ..CircumsphereSettings::default() });
    let lines = drawn(&mut app, DeformableGizmos { contacts: true, ..nothing() });
    let contacts = contacts(&mut app);
    let mut normals: Vec<[Vec3; 2]> = of_color(&lines, NORMALS);
    assert_eq!(normals.len(), contacts.len());
    let total: usize = lines.values().sum();
    assert_eq!(total, 4 * contacts.len(), "three lines of a cross, and the normal");
    let (mut touching, mut passed, mut near) = (0, 0, 0);
    for contact in &contacts {
        let finer = contact.sides.iter().filter_map(|&side| mean_edge(&app, side)).reduce(f32::min);
        let length = 0.5 * finer.expect("a surface is always there");
        let end = contact.points[0] + contact.normal * length;
        let found = normals.iter().position(|line| line[0] == contact.points[0] && line[1].distance(end) < 1.0e-5);
        normals.remove(found.expect("the normal is drawn at the point"));
        let (color, count) = match contact {
            contact if contact.is_crossing || contact.distance < 0.0 => (PENETRATING, &mut passed),
            contact if contact.separation <= 0.0 => (TOUCHING, &mut touching),
            _ => (NEAR, &mut near),
        };
        *count += 1;
        let is_around = |line: &&[Vec3; 2]| line[0].midpoint(line[1]).distance(contact.points[0]) < 1.0e-5;
        assert!(of_color(&lines, color).iter().filter(is_around).count() >= 3);
    }
    assert!(touching > 10 && passed > 10 && near > 10, "{touching}, {passed}, {near}");
}

#[test]
fn what_has_passed_is_drawn_between_its_points() {
    let mut app = app(Update, true);
    scene(&mut app);
    let lines = drawn(&mut app, DeformableGizmos { penetrations: true, ..nothing() });
    let contacts = contacts(&mut app);
    let (crossing, rest): (Vec<&Seen>, Vec<&Seen>) = contacts.iter().partition(|contact| contact.is_crossing);
    let passed: Vec<&Seen> = rest.into_iter().filter(|contact| contact.distance < 0.0).collect();
    let depths = of_color(&lines, PENETRATING);
    assert!(crossing.len() > 10 && passed.len() > 10, "{} {}", crossing.len(), passed.len());
    assert_eq!([of_color(&lines, CROSSINGS).len(), depths.len()], [3 * crossing.len(), passed.len()]);
    assert_eq!(lines.values().sum::<usize>(), 3 * crossing.len() + passed.len());
    assert!(passed.iter().all(|contact| depths.contains(&contact.points)));
}

#[test]
fn each_switch_adds_its_own_layer_and_nothing_else() {
    let mut app = app(Update, true);
    scene(&mut app);
    let set: [(&str, fn(&mut DeformableGizmos, &DeformableGizmos)); 11] = [
        ("meshes", |to, from| to.meshes = from.meshes),
        ("shapes", |to, from| to.shapes = from.shapes),
        ("contacts", |to, from| to.contacts = from.contacts),
        ("penetrations", |to, from| to.penetrations = from.penetrations),
        ("patches", |to, from| to.patches = from.patches),
        ("pairs", |to, from| to.pairs = from.pairs),
        ("spheres", |to, from| to.spheres = from.spheres),
        ("cones", |to, from| to.cones = from.cones),
        ("curvature", |to, from| to.curvature = from.curvature),
        ("recipe_age", |to, from| to.recipe_age = from.recipe_age),
        ("tree", |to, from| to.tree_levels = from.tree_levels),
    ];
    // Whatever the first ticks compute for the first time.
    (0..3).for_each(|_| app.update());
    let scattered = |app: &mut App, shown| {
        // Moved in every tick, so that nothing is kept from the last one.
        for mut positions in app.world_mut().query::<&mut SurfacePositions>().iter_mut(app.world_mut()) {
            positions.set_changed();
        }
        drawn(app, shown)
    };
    let all = scattered(&mut app, everything());
    let mut sum: BTreeMap<Line, usize> = BTreeMap::new();
    for (name, set) in set {
        let mut one = nothing();
        set(&mut one, &everything());
        let one = scattered(&mut app, one);
        assert!(!one.is_empty(), "{name} draws nothing");
        let mut others = everything();
        set(&mut others, &nothing());
        let mut rest = scattered(&mut app, others);
        for (&line, &count) in &one {
            *rest.entry(line).or_default() += count;
            *sum.entry(line).or_default() += count;
        }
        assert!(rest == all, "without {name}, other layers change");
    }
    assert!(sum == all, "the layers together are more or less than all of them");
    assert!(scattered(&mut app, nothing()).is_empty());
}

#[test]
fn edges_are_drawn_once_and_colored_where_triangles_touch() {
    let mut app = app(Update, true);
    let Scene { sheet, sheet_mesh, .. } = scene(&mut app);
    let lines = drawn(&mut app, DeformableGizmos { meshes: LevelOfDetail::All, ..nothing() });
    let near = drawn(&mut app, DeformableGizmos { meshes: LevelOfDetail::NearContacts, ..nothing() });
    let unordered = |lines: &BTreeMap<Line, usize>| -> BTreeSet<Line> {
        lines.keys().map(|&([a, b], color)| ([a.min(b), a.max(b)], color)).collect()
    };
    assert!(near.len() < lines.len() && unordered(&near).is_subset(&unordered(&lines)));
    // The state of each triangle of the sheet, as the game reads it: 0 nothing, 1 touches, 2 has passed.
    let mut states = vec![0; sheet_mesh.triangles.len()];
    for pair in app.world().resource::<ContactStore>().pairs() {
        for touching in pair.touching.iter() {
            for (side, triangle) in [(pair.a, touching.triangle_a), (pair.b, touching.triangle_b)] {
                if side.entity() == sheet {
                    states[triangle as usize] = 1;
                }
            }
        }
    }
    let read = move |contacts: SurfaceContacts| {
        let passed = contacts.contacts_with(sheet).filter(|contact| contact.is_crossing() || contact.distance() < 0.0);
        passed.map(|contact| contact.triangles().0.expect("a surface has triangles").0).collect::<Vec<_>>()
    };
    for triangle in app.world_mut().run_system_once(read).expect("the parameters are there") {
        states[triangle as usize] = 2;
    }
    let mut expected: BTreeMap<[u32; 2], u8> = BTreeMap::new();
    for (&[a, b, c], &state) in sheet_mesh.triangles.iter().zip(&states) {
        for [start, end] in [[a, b], [b, c], [c, a]] {
            let edge = expected.entry([start.min(end), start.max(end)]).or_default();
            *edge = state.max(*edge);
        }
    }
    let (mut found, mut by_state) = (0, [0; 3]);
    for (edge, state) in &expected {
        let [start, end] = edge.map(|vertex| Vec3::from_array(sheet_mesh.positions[vertex as usize]));
        let is_edge = |line: &[Vec3; 2]| *line == [start, end] || *line == [end, start];
        let drawn: Vec<(&Line, &usize)> = lines.iter().filter(|(line, _)| is_edge(&ends(line))).collect();
        let [(line, 1)] = drawn[..] else { panic!("{edge:?} is drawn {} times", drawn.len()) };
        found += 1;
        let color = line.1;
        let drawn_state = if color == linear(PENETRATING) { 2 } else { usize::from(color == linear(TOUCHING)) };
        assert_eq!(drawn_state, usize::from(*state), "{edge:?}");
        by_state[drawn_state] += 1;
    }
    assert_eq!(found, expected.len());
    assert!(by_state.iter().all(|&count| count > 5), "{by_state:?}");
}

#[test]
fn spheres_and_boxes_are_where_the_stages_put_them() {
    let mut app = app(Update, true);
    let Scene { sheet, balls: [ball, _], sheet_mesh } = scene(&mut app);
    let lines = drawn(&mut app, DeformableGizmos { spheres: LevelOfDetail::All, ..nothing() });
    let transform = *app.world().get::<Transform>(ball).expect("it has one");
    let balls: Vec<(Vec3, f32)> = app
        .world()
        .get::<EnclosingBalls>(ball)
        .expect("it is a surface")
        .iter()
        .map(|ball| (transform.transform_point(ball.center), ball.radius * transform.scale.x))
        .collect();
    assert!(!balls.is_empty());
    for (center, radius) in balls {
        // Three circles of a ball have their points at its radius.
        let on_it = |line: &&Line| ends(line).iter().all(|end| (end.distance(center) - radius).abs() < 1.0e-5);
        assert!(lines.keys().filter(on_it).count() >= 3 * 24, "{center} {radius}");
    }
    let root = drawn(&mut app, DeformableGizmos { tree_levels: 1, ..nothing() });
    let points: Vec<Vec3> = sheet_mesh.positions.iter().copied().map(Vec3::from_array).collect();
    let [low, high] =
        [Vec3::min as fn(Vec3, Vec3) -> Vec3, Vec3::max].map(|of| points.iter().copied().reduce(of).unwrap());
    // Boxes of a tree contain a little more than their triangles.
    let is_corner = |point: Vec3| {
        let off = (point - low).abs().min((point - high).abs());
        off.max_element() < 0.1
    };
    let of_sheet = root.keys().filter(|line| ends(line).into_iter().all(is_corner)).count();
    assert!(of_sheet >= 12, "{of_sheet} edges of the box around {sheet}");
}

#[test]
fn a_disabled_group_draws_nothing_and_contacts_do_not_depend_on_it() {
    let seen = |app: &mut App| -> Vec<String> {
        let seen = |contact: Contact| format!("{:?} {:?} {}", contact.key(), contact.points(), contact.normal());
        let read = move |contacts: SurfaceContacts| contacts.iter().map(seen).collect::<Vec<_>>();
        app.world_mut().run_system_once(read).expect("the parameters are there")
    };
    let mut without = app(Update, false);
    scene(&mut without);
    let mut with = app(Update, true);
    scene(&mut with);
    without.update();
    assert!(!drawn(&mut with, everything()).is_empty());
    assert!(seen(&mut with).len() > 30);
    assert_eq!(seen(&mut with), seen(&mut without));
    with.world_mut().resource_mut::<GizmoConfigStore>().config_mut::<DeformableGizmos>().0.enabled = false;
    assert!(drawn(&mut with, everything()).is_empty());
}

#[test]
fn a_fixed_schedule_draws_in_every_frame_with_and_without_a_tick() {
    let mut app = app(FixedPostUpdate, true);
    scene(&mut app);
    let step = app.world().resource::<bevy_time::Time<bevy_time::Fixed>>().timestep();
    let mut frame = |length: Duration| {
        app.insert_resource(TimeUpdateStrategy::ManualDuration(length));
        app.update();
        lines(&app)
    };
    frame(Duration::ZERO);
    let one = frame(step);
    assert!(!one.is_empty());
    assert_eq!(frame(2 * step), one, "ticks of a frame do not add up");
    assert_eq!(frame(Duration::ZERO), one, "between ticks, the last one stays");
}

#[test]
fn it_can_be_added_before_the_plugins_that_it_draws() {
    let mut app = App::new();
    app.add_plugins((DeformableGizmosPlugin, DeformableCollisionPlugins::new(Update)));
    app.add_plugins((TaskPoolPlugin::default(), AssetPlugin::default(), TimePlugin, GizmoPlugin));
    app.finish();
    app.cleanup();
    scene(&mut app);
    assert!(!drawn(&mut app, everything()).is_empty());
}

#[test]
#[should_panic(expected = "DeformableGizmosPlugin works on what DeformableCollisionPlugins detect")]
fn it_needs_the_plugins_that_it_draws() {
    App::new().add_plugins((AssetPlugin::default(), GizmoPlugin, DeformableGizmosPlugin)).finish();
}

#[test]
#[should_panic(expected = "add Bevy's DefaultPlugins, or GizmoPlugin")]
fn it_needs_gizmos() {
    let mut app = App::new();
    app.add_plugins((DeformableCollisionPlugins::new(Update), DeformableGizmosPlugin));
    app.finish();
}
