//! The measures themselves against counts made by hand.

use bevy_circumsphere::{prelude::*, response::XpbdMaterial};
use bevy_transform::components::Transform;
use circumsphere_support::scenes::{Diagonals, Mesh, grid, icosphere, torus};
use glam::{DVec3, Quat, Vec3};
use parry3d::{math::Pose, utils::Array2};

use crate::{
    headless::recording::Recorder,
    play,
    scenes::{
        Energy, Stage, Variation,
        bullet_cloth::{Shot, Target},
        measure::Measure,
        truth::{Closed, Solid, crossing_pairs, vertices_in_shapes, vertices_inside},
    },
    small, varied,
};

fn empty() -> Stage {
    Stage::new(&Variation::default(), Recorder::default())
}

fn points(mesh: &Mesh) -> Vec<DVec3> {
    mesh.positions.iter().map(|&position| Vec3::from(position).as_dvec3()).collect()
}

/// Two triangles in the plane z = 0.
fn square() -> Mesh {
    Mesh {
        positions: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
    }
}

#[test]
fn a_ring_contains_what_is_in_its_tube_and_not_what_is_in_its_hole() {
    let mesh = torus(1.0, 0.25, 48, 24);
    for turned in [false, true] {
        let positions = points(&mesh);
        let turn = |&[a, b, c]: &[u32; 3]| if turned { [a, c, b] } else { [a, b, c] };
        let triangles: Vec<[u32; 3]> = mesh.triangles.iter().map(turn).collect();
        let ring = Closed::new(&positions, &triangles);
        let mut inside = 0;
        for step in 0..1000 {
            // Points all over the box, except near the surface, where mesh and ring differ.
            let share = |by: f64| (f64::from(step) * by).fract() * 2.6 - 1.3;
            let point = DVec3::new(share(0.754_877), 0.25 * share(0.569_84), share(0.326_12));
            let from_circle = (point.x.hypot(point.z) - 1.0).hypot(point.y);
            if (from_circle - 0.25).abs() > 0.02 {
                assert_eq!(ring.contains(point), from_circle < 0.25, "{point}");
                inside += usize::from(from_circle < 0.25);
            }
        }
        assert!(inside > 100, "only {inside} points are inside");
    }
}

#[test]
fn crossings_count_between_bodies_and_obstacles_and_not_between_obstacles() {
    // One edge of the spike passes through the first triangle of the square, none through the second.
    let spike =
        Mesh { positions: vec![[0.7, 0.2, -0.5], [0.7, 0.3, 1.0], [0.8, 0.2, 1.0]], triangles: vec![[0, 1, 2]] };
    let away = spike.clone().translate([0.0, 0.0, 3.0]);
    let body = |stage: &mut Stage, mesh: &Mesh| stage.add_body("body", mesh, XpbdMaterial::CLOTH, |body| body, ());
    for (spike, expected) in [(&spike, 1), (&away, 0)] {
        let mut stage = empty();
        stage.add_obstacle("square", &square(), ());
        body(&mut stage, spike);
        assert_eq!(crossing_pairs(&stage), expected);
        let mut stage = empty();
        body(&mut stage, &square());
        body(&mut stage, spike);
        assert_eq!(crossing_pairs(&stage), expected);
    }
    let mut stage = empty();
    stage.add_obstacle("square", &square(), ());
    stage.add_obstacle("spike", &spike, ());
    assert_eq!(crossing_pairs(&stage), 0);
    // Within one mesh, crossings count if it has self-collision.
    let both = circumsphere_support::scenes::merge(&[square(), spike]);
    for (meets_itself, expected) in [(true, 1), (false, 0)] {
        let mut stage = empty();
        let entity = body(&mut stage, &both);
        if meets_itself {
            stage.app.world_mut().entity_mut(entity).insert(SelfCollision);
        }
        assert_eq!(crossing_pairs(&stage), expected);
    }
}

#[test]
fn vertices_count_where_they_are_inside_another_closed_surface() {
    let mut stage = empty();
    stage.add_obstacle("ball", &icosphere(3, 0.38), ());
    // Vertices are at multiples of a tenth. The ball's flat faces are less than a hundredth below its radius.
    let sheet = grid(10, 10, 1.0, 1.0, Diagonals::Uniform);
    let expected = sheet.positions.iter().filter(|position| Vec3::from(**position).length() < 0.37).count();
    let between =
        sheet.positions.iter().filter(|position| (0.365..0.385).contains(&Vec3::from(**position).length())).count();
    assert!(expected > 20 && between == 0, "{expected} {between}");
    stage.add_body("sheet", &sheet, XpbdMaterial::CLOTH, |body| body, ());
    assert_eq!(vertices_inside(&stage), expected);
}

/// Every kind of shape in the scenes, each with points inside and outside.
#[test]
fn a_point_is_inside_a_rigid_shape_where_its_closed_form_says() {
    let cube = circumsphere_support::scenes::cuboid([0.2, 0.3, 0.4], 2);
    let vectors = |mesh: &Mesh| mesh.positions.iter().map(|&position| Vec3::from(position)).collect::<Vec<Vec3>>();
    let trimesh = |mesh: &Mesh| SharedShape::trimesh(vectors(mesh), mesh.triangles.clone()).expect("a mesh");
    let slope = |x: f32| 0.5 * x;
    let mut ground = grid(4, 4, 2.0, 2.0, Diagonals::Alternating);
    ground.positions.iter_mut().for_each(|position| position[1] = slope(position[0]));
    // Columns along x.
    let heights = (0..5).flat_map(|column| [slope(0.5 * column as f32 - 1.0); 5]).collect();
    let is_in_box = |point: DVec3| (point.abs() - DVec3::new(0.2, 0.3, 0.4)).max_element() < 0.0;
    let is_below = |point: DVec3| point.y < 0.5 * point.x && point.x.abs().max(point.z.abs()) < 1.0;
    let part = SharedShape::cuboid(0.1, 0.3, 0.4);
    let parts = [-0.1, 0.1].map(|x| (Pose::from_translation(Vec3::new(x, 0.0, 0.0)), part.clone()));
    let cases: [(SharedShape, &dyn Fn(DVec3) -> bool); 10] = [
        (SharedShape::ball(0.5), &|point| point.length() < 0.5),
        (SharedShape::cuboid(0.2, 0.3, 0.4), &is_in_box),
        (SharedShape::capsule_y(0.3, 0.2), &|point| {
            (point - point.clamp(-0.3 * DVec3::Y, 0.3 * DVec3::Y)).length() < 0.2
        }),
        (SharedShape::halfspace(Vec3::Z), &|point| point.z < 0.0),
        (SharedShape::cylinder(0.3, 0.4), &|point| point.y.abs() < 0.3 && point.x.hypot(point.z) < 0.4),
        (SharedShape::convex_hull(&vectors(&cube)).expect("a box is convex"), &is_in_box),
        (trimesh(&cube), &is_in_box),
        (trimesh(&ground), &is_below),
        (SharedShape::heightfield(Array2::new(5, 5, heights), Vec3::new(2.0, 1.0, 2.0)), &is_below),
        (SharedShape::compound(parts.to_vec()), &is_in_box),
    ];
    for (shape, expected) in cases {
        let solid = Solid::of(&*shape);
        let mut inside = 0;
        for step in 0..1000 {
            let share = |by: f64| (f64::from(step) * by).fract() * 1.8 - 0.9;
            let point = DVec3::new(share(0.754_877), share(0.569_84), share(0.326_12));
            // Near the boundary, rounding decides. A point is tested only if all points around it agree.
            let around = DVec3::AXES.map(|axis| [1.0e-4, -1.0e-4].map(|nudge| expected(point + axis * nudge)));
            let is_inside = expected(point);
            if around.iter().flatten().all(|&other| other == is_inside) {
                assert_eq!(solid.contains(point), is_inside, "{:?} at {point}", shape.shape_type());
                inside += usize::from(is_inside);
            }
        }
        assert!(inside > 10, "{:?}: only {inside} points are inside", shape.shape_type());
    }
}

#[test]
fn vertices_count_where_they_are_inside_a_rigid_shape_that_has_moved() {
    let mut stage = empty();
    let sheet = grid(10, 10, 1.0, 1.0, Diagonals::Uniform);
    stage.add_body("sheet", &sheet, XpbdMaterial::CLOTH, |body| body, ());
    let turned = Quat::from_rotation_y(std::f32::consts::FRAC_PI_2);
    let shape = stage.add_shape("box", SharedShape::cuboid(0.35, 0.1, 0.15), Transform::IDENTITY);
    // Vertices at multiples of a tenth: 7 by 3, or 3 by 7 when rotated.
    assert_eq!(vertices_in_shapes(&stage), 21);
    stage.place(shape, Transform::from_xyz(0.3, 0.0, 0.0).with_rotation(turned));
    assert_eq!(vertices_in_shapes(&stage), 21);
    stage.place(shape, Transform::from_xyz(0.5, 0.0, 0.0).with_rotation(turned));
    assert_eq!(vertices_in_shapes(&stage), 14);
    stage.place(shape, Transform::from_xyz(0.0, 0.2, 0.0));
    assert_eq!(vertices_in_shapes(&stage), 0);
}

#[test]
fn a_ball_that_nothing_stops_has_tunnelled_with_every_vertex() {
    for (target, speed) in [(Target::Sheet, 500.0), (Target::SheetBySheet, 500.0), (Target::Closed, 500.0)] {
        let variation = Variation { shot: Shot { target, speed }, continuous: false, ..Variation::default() };
        let mut scene = varied("bullet_cloth", &variation);
        assert_eq!(scene.tunnelled(), 0, "{target:?}");
        let shot = *scene.stage.bodies.last().expect("something is shot");
        // Teleported to the other side, so that detection sees neither the motion nor anything near.
        let below: Vec<Vec3> = scene.stage.positions(shot).iter().map(|&position| position - 4.0 * Vec3::Y).collect();
        let count = below.len();
        scene.stage.move_vertices(shot, below.into_iter().enumerate());
        assert_eq!(scene.tunnelled(), count, "{target:?}");
    }
}

#[test]
fn a_vertex_that_is_nowhere_has_not_been_stopped() {
    let mut scene = small("bullet_cloth", 1);
    assert_eq!(scene.tunnelled(), 0);
    let shot = *scene.stage.bodies.last().expect("something is shot");
    scene.stage.move_vertices(shot, [(3, Vec3::NAN), (5, Vec3::INFINITY)]);
    assert_eq!(scene.tunnelled(), 2);
}

#[test]
fn energy_is_that_of_the_formulas() {
    let mut stage = empty();
    let material =
        XpbdMaterial { area_density: 3.0, stretch_compliance: 0.5, bend_compliance: 0.25, ..XpbdMaterial::CLOTH };
    let entity = stage.add_body("square", &square(), material, |body| body.moving(Vec3::new(3.0, 4.0, 0.0)), ());
    // 3 kg at 5 m/s. Each corner has a third of each triangle's mass, so the mean heights are 1/3 and 2/3.
    let energy = Energy::of(&stage);
    assert!((energy.kinetic - 37.5).abs() < 1.0e-5, "{energy:?}");
    assert!((energy.height - 9.81 * 1.5 * (1.0 / 3.0 + 2.0 / 3.0)).abs() < 1.0e-5, "{energy:?}");
    assert_eq!(energy.elastic, 0.0);
    // Folded by a right angle around the diagonal in both directions, which changes no length.
    let root = 0.5_f32.sqrt();
    for side in [1.0, -1.0] {
        let folded = Vec3::new(0.5, 0.5, 0.0) + Vec3::new(0.0, 0.0, side * root);
        stage.move_vertices(entity, [(3, folded)]);
        let expected = 0.5 * (0.5 * std::f64::consts::PI).powi(2) / 0.25;
        let energy = Energy::of(&stage);
        assert!((energy.elastic - expected).abs() < 1.0e-5, "{energy:?} {expected}");
    }
    // Scaled to twice the size: every edge is longer by its own length.
    let doubled: Vec<Vec3> = square().positions.iter().map(|&position| 2.0 * Vec3::from(position)).collect();
    stage.move_vertices(entity, doubled.into_iter().enumerate());
    let expected = 0.5 * (4.0 + 2.0) / 0.5;
    assert!((Energy::of(&stage).elastic - expected).abs() < 1.0e-5);
}

/// One vertex lies on the ground, another is at rest. Only vertices in contact count.
#[test]
fn jitter_is_the_way_of_the_vertices_in_contact_in_edges() {
    let mut scene = small("layers", 1);
    let mut measure = Measure::default();
    // In the air, there are no contacts.
    let falling = measure.tick(&mut scene);
    assert_eq!(falling.jitter.step(), 0.0);
    assert_eq!((falling.contacts, falling.churn), (0, 0.0));
    play(&mut scene, 40);
    measure = Measure::default();
    let mut last = [Vec::new(), Vec::new(), Vec::new()];
    let mut tick = falling;
    for positions in &mut last {
        tick = measure.tick(&mut scene);
        *positions = scene.stage.bodies.iter().map(|&body| scene.stage.world_positions(body)).collect::<Vec<_>>();
    }
    assert!(tick.contacts > 0, "the sheets lie on each other by now");
    // At most the distance that any vertex of the scene has moved.
    let edge = f64::from(scene.stage.surface(scene.stage.bodies[0]).mean_edge());
    let ways = last[2].iter().flatten().zip(last[1].iter().flatten()).map(|(now, before)| now.distance(*before) / edge);
    let most = ways.fold(0.0, f64::max);
    assert!(tick.jitter.step() > 0.0 && tick.jitter.step() <= most * (1.0 + 1.0e-6), "{} {most}", tick.jitter.step());
    assert!((0.0..=1.0).contains(&tick.churn));
}
