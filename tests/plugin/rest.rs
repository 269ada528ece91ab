//! Surfaces that do not move keep their boxes and trees, and contacts are the same as in a new world.

use bevy_app::prelude::*;
use bevy_circumsphere::{
    ActiveSurfaces, CircumsphereSettings,
    detection::{
        BroadPhasePlugin, BruteForceBroadPhasePlugin, CandidateTrianglePairs, DetectionDiagnostics, SurfaceState,
        SurfaceStates, TreeBroadPhasePlugin,
    },
    kernel::mesh::bounds::triangle_bounds,
    prelude::*,
};
use bevy_ecs::prelude::*;
use bevy_math::ops::sin;
use bevy_transform::components::Transform;
use circumsphere_support::{
    random::Random,
    scenes::{Diagonals, Mesh, grid, icosphere},
};
use glam::{Quat, Vec3};

use crate::world::{THIN, app, at, ball, fingerprint, insert, points, sheet, store, surface, write_positions};

/// The contents of a world, without what it remembers.
#[derive(Clone)]
struct Scene {
    meshes: [Mesh; 2],
    positions: [Vec<Vec3>; 2],
    thicknesses: [SurfaceThickness; 2],
    ball_at: Transform,
    margin: f32,
}

const NAMES: [&str; 2] = ["sheet", "ball"];

impl Scene {
    fn new() -> Self {
        let meshes = [sheet(), ball()];
        Self {
            positions: [points(&meshes[0]), points(&meshes[1])],
            meshes,
            thicknesses: [THIN; 2],
            ball_at: at(0.1, 0.53, 0.2),
            margin: 0.0,
        }
    }

    fn spawn(&self, app: &mut App) -> [Entity; 2] {
        [0, 1].map(|body| {
            let bundle = (Name::new(NAMES[body]), crate::world::Called(NAMES[body]), surface(&self.meshes[body]));
            app.world_mut().spawn(bundle).id()
        })
    }

    /// Writes all components, whether they have changed or not.
    fn write(&self, app: &mut App, bodies: [Entity; 2]) {
        let transforms = [Transform::IDENTITY, self.ball_at];
        for body in 0..2 {
            let positions = SurfacePositions(self.positions[body].clone());
            insert(app, bodies[body], (positions, self.thicknesses[body], transforms[body]));
        }
        app.world_mut().resource_mut::<CircumsphereSettings>().margin = self.margin;
    }
}

fn brute_force_app() -> App {
    let mut app = App::new();
    let plugins = DeformableCollisionPlugins::new(Update).build().disable::<TreeBroadPhasePlugin>();
    app.add_plugins(plugins.add_after::<BroadPhasePlugin>(BruteForceBroadPhasePlugin));
    app
}

/// A change of the scene, and how many surfaces keep their boxes in it.
type Step = (&'static str, fn(&mut Scene), usize);

const STEPS: [Step; 9] = [
    ("nothing", |_| (), 2),
    ("one vertex of the ball", |scene| scene.positions[1][7].y -= 0.02, 1),
    ("nothing again", |_| (), 2),
    ("the ball's transform", |scene| scene.ball_at.translation.y -= 0.02, 2),
    ("the sheet's thickness", |scene| scene.thicknesses[0] = SurfaceThickness::World(0.08), 1),
    ("the margin", |scene| scene.margin = 0.1, 0),
    ("all vertices of the sheet", |scene| scene.positions[0].iter_mut().for_each(|vertex| vertex.y += 0.01), 1),
    ("the ball's scale", |scene| scene.ball_at.scale = Vec3::splat(1.1), 1),
    ("nothing at last", |_| (), 2),
];

#[test]
fn boxes_are_kept_just_where_nothing_has_changed_and_contacts_are_those_of_a_new_world() {
    for brute_force in [false, true] {
        let make = || if brute_force { brute_force_app() } else { app() };
        let (mut scene, mut warm) = (Scene::new(), make());
        let bodies = scene.spawn(&mut warm);
        scene.write(&mut warm, bodies);
        warm.update();
        assert_eq!(warm.world().resource::<DetectionDiagnostics>().surfaces_unmoved, 0, "everything is new");
        let mut touching = 0;
        for (what, change, unmoved) in STEPS {
            change(&mut scene);
            scene.write(&mut warm, bodies);
            warm.update();
            assert_eq!(warm.world().resource::<DetectionDiagnostics>().surfaces_unmoved, unmoved, "{what}");
            let mut cold = make();
            let new_bodies = scene.spawn(&mut cold);
            scene.write(&mut cold, new_bodies);
            cold.update();
            assert_eq!(fingerprint(&warm), fingerprint(&cold), "{what}");
            assert!(store(&warm).touching().eq(store(&cold).touching()), "{what}");
            touching += store(&warm).touching_count();
        }
        assert!(touching > 50, "{touching} touching pairs");
    }
}

#[test]
fn another_mesh_of_the_same_positions_gets_boxes_of_its_own_triangles() {
    let mut app = app();
    let mesh = icosphere(1, 0.5);
    let entity = app.world_mut().spawn((surface(&mesh), THIN)).id();
    app.update();
    let fewer = Mesh { triangles: mesh.triangles[..20].to_vec(), ..mesh.clone() };
    insert(&mut app, entity, surface(&fewer).0);
    app.update();
    let bounds = app.world().resource::<SurfaceStates>().get(entity).expect("the entity is a surface");
    assert_eq!(bounds.triangle_boxes().len(), 20);
    assert_eq!(app.world().resource::<DetectionDiagnostics>().surfaces_unmoved, 0);
    assert_boxes(bounds, &points(&fewer), &fewer.triangles);
}

/// Asserts that boxes are grown by a thickness of 0.05, and by no less.
fn assert_boxes(bounds: &SurfaceState, positions: &[Vec3], triangles: &[[u32; 3]]) {
    let mut expected = Vec::new();
    triangle_bounds(positions, triangles, 0.05, &mut expected);
    assert_eq!(bounds.triangle_boxes().len(), expected.len());
    for (found, least) in bounds.triangle_boxes().iter().zip(&expected) {
        assert!(found.min.cmple(least.min).all() && found.max.cmpge(least.max).all());
        // Contacts end a thousandth farther out. Rounding adds 4 units in the last place of 1.
        let slack = Vec3::splat(0.05e-3 + 4.0 * f32::EPSILON);
        assert!((least.min - found.min).cmple(slack).all() && (found.max - least.max).cmple(slack).all());
    }
}

#[test]
fn boxes_of_what_is_near_nothing_are_those_of_the_last_detection_whenever_they_are_asked_for() {
    let mut app = app();
    let mesh = icosphere(1, 0.5);
    let entity = app.world_mut().spawn((surface(&mesh), THIN)).id();
    for tick in 0..4 {
        let positions: Vec<Vec3> = points(&mesh).iter().map(|&point| point * (1.0 + 0.1 * tick as f32)).collect();
        insert(&mut app, entity, SurfacePositions(positions.clone()));
        app.update();
        let bounds = app.world().resource::<SurfaceStates>().get(entity).expect("the entity is a surface");
        // In the second tick the boxes are not read. Positions written after a detection are not in its boxes.
        if tick != 1 {
            assert_boxes(bounds, &positions, &mesh.triangles);
        }
    }
    insert(&mut app, entity, SurfacePositions(vec![Vec3::ZERO; mesh.positions.len()]));
    let bounds = app.world().resource::<SurfaceStates>().get(entity).expect("the entity is a surface");
    let last: Vec<Vec3> = points(&mesh).iter().map(|&point| point * (1.0 + 0.1 * 3.0)).collect();
    assert_boxes(bounds, &last, &mesh.triangles);
}

#[test]
fn a_vertex_that_no_triangle_has_brings_nothing_near() {
    for is_named in [false, true] {
        let mut app = app();
        let (mut near, other) = (icosphere(1, 0.5), icosphere(1, 0.5).translate([5.0, 0.0, 0.0]));
        // Several surfaces of a model often share one list of vertices.
        near.positions.push([5.0, 0.0, 0.0]);
        if is_named {
            near.triangles.push([0, 1, near.positions.len() as u32 - 1]);
        }
        let bodies = [&near, &other].map(|mesh| app.world_mut().spawn((surface(mesh), THIN)).id());
        for _ in 0..2 {
            app.update();
            let active = app.world().resource::<ActiveSurfaces>();
            let [first, second] = bodies.map(|body| {
                active.surfaces.iter().find(|surface| surface.entity == body).expect("it is active").world_bounds
            });
            assert_eq!(first.overlaps(&second), is_named);
            let pairs = &app.world().resource::<CandidateTrianglePairs>().pairs();
            assert_eq!(pairs.iter().filter(|pair| !pair.is_self()).count(), usize::from(is_named));
        }
    }
}

#[test]
fn positions_are_read_again_where_somebody_has_written_to_them_and_only_there() {
    let mut app = app();
    let scene = Scene::new();
    let bodies = scene.spawn(&mut app);
    scene.write(&mut app, bodies);
    app.update();
    app.update();
    let before = fingerprint(&app);
    assert!(store(&app).touching_count() > 10);
    let body = bodies[1];
    let mut lifted = scene.positions[1].clone();
    for point in &mut lifted {
        point.y += 0.01;
    }

    // Write without change detection. The stages promise nothing in this case: here the pair is kept, as if nothing had
    // been written.
    let mut positions = app.world_mut().get_mut::<SurfacePositions>(body).expect("the entity is a surface");
    positions.bypass_change_detection().0.clone_from(&lifted);
    app.update();
    assert_eq!(fingerprint(&app), before);

    app.world_mut().get_mut::<SurfacePositions>(body).expect("the entity is a surface").set_changed();
    app.update();
    let lifted_too = {
        let mut fresh = crate::world::app();
        let scene = Scene { positions: [scene.positions[0].clone(), lifted], ..scene };
        let bodies = scene.spawn(&mut fresh);
        scene.write(&mut fresh, bodies);
        fresh.update();
        fingerprint(&fresh)
    };
    assert_ne!(lifted_too, before);
    assert_eq!(fingerprint(&app), lifted_too);
}

/// Bends the sheet now and then, and makes two balls jump above it. The vertices of one ball jump in the sheet's frame,
/// and the other ball has its own transform.
fn jump_about(app: &mut App, [sheet, near, turned]: [Entity; 3], random: &mut Random) {
    let mut number = |most: f32| most * random.signed_unit();
    if number(1.0) > 0.0 {
        let (phase, mut bent) = (number(3.0), points(&wide_sheet()));
        for point in &mut bent {
            point.y = 0.2 * sin(point.x + phase) * sin(1.3 * point.z);
        }
        write_positions(app, sheet, &bent);
    }
    if number(1.0) > 0.0 {
        let offset = Vec3::new(number(4.0), 0.5 + number(0.1), number(4.0));
        let jumped: Vec<Vec3> = points(&ball()).iter().map(|&point| point + offset).collect();
        write_positions(app, near, &jumped);
    }
    if number(1.0) > 0.0 {
        let rotation = Quat::from_euler(glam::EulerRot::XYZ, number(3.0), number(3.0), number(3.0));
        let translation = Vec3::new(number(4.0), 0.5 + number(0.1), number(4.0));
        insert(app, turned, Transform { translation, rotation, ..Transform::IDENTITY });
    }
}

fn wide_sheet() -> Mesh {
    grid(40, 40, 10.0, 10.0, Diagonals::Alternating)
}

#[test]
fn whatever_is_reached_of_a_surface_is_where_it_is_now() {
    for method in [ContactMethod::Exact, ContactMethod::Circumsphere] {
        let mut worlds = [app(), brute_force_app()].map(|mut app| {
            let bodies = [("sheet", wide_sheet()), ("near", ball()), ("turned", ball())].map(|(name, mesh)| {
                app.world_mut().spawn((crate::world::Called(name), surface(&mesh), THIN, method)).id()
            });
            (app, bodies, Random::new(5))
        });
        let (mut ticks_in_contact, mut touching) = (0, 0);
        for tick in 0..150 {
            for (app, bodies, random) in &mut worlds {
                jump_about(app, *bodies, random);
                app.update();
            }
            let [(by_trees, ..), (by_force, ..)] = &worlds;
            assert_eq!(fingerprint(by_trees), fingerprint(by_force), "{method:?} tick {tick}");
            ticks_in_contact += usize::from(store(by_trees).touching_count() > 0);
            touching += store(by_trees).touching_count();
        }
        assert!(ticks_in_contact > 120 && touching > 5000, "{method:?}: {touching} in {ticks_in_contact} ticks");
    }
}
