//! Wind, forces, impulses, tethers, and reactions.

use bevy_circumsphere::{prelude::*, response::*};
use bevy_ecs::prelude::*;
use bevy_transform::components::Transform;
use circumsphere_support::scenes::{Diagonals, Mesh, cuboid, grid, icosphere};
use glam::{DVec3, Quat, Vec3};

use crate::harness::{LOSSLESS, Scene, TICK, mean, ticks_in};

fn sheet(cells: usize, width: f32) -> Mesh {
    grid(cells, cells, width, width, Diagonals::Alternating)
}

/// The mass of a body in kilograms.
fn mass(scene: &Scene, body: Entity) -> f64 {
    scene.body(body).inverse_masses.iter().map(|&inverse| f64::from(inverse).recip()).sum()
}

fn transform_of(time: f64) -> Transform {
    let time = time as f32;
    let turn = Quat::from_axis_angle(Vec3::new(1.0, 2.0, -0.5).normalize(), 2.5 * time);
    Transform::from_xyz(3.0 * time, (5.0 * time).min(0.4), -time).with_rotation(turn)
}

#[test]
fn pins_are_where_the_entity_is_that_they_follow() {
    for rate in [30.0, 60.0, 120.0] {
        let mut scene = Scene::new();
        // The bone is the child of a cart, which is scaled.
        let cart = scene.app.world_mut().spawn(transform_of(0.0)).id();
        let bone = Transform::from_xyz(0.1, 0.2, 0.3).with_scale(Vec3::new(1.0, 2.0, 0.5));
        let bone = scene.app.world_mut().spawn((bone, ChildOf(cart))).id();
        let points = [Vec3::new(-0.1, 0.0, 0.0), Vec3::new(0.1, 0.0, 0.1)];
        let pins = [(0, points[0]), (10, points[1])]
            .map(|(vertex, point)| Tether::pin(VertexId(vertex), TetherTarget::Entity { entity: bone, point }));
        let body = scene.add(&sheet(10, 0.4), XpbdMaterial::CLOTH, (XpbdTethers::new(pins), SweptCollision));
        for tick in 1..=ticks_in(1.0, rate) {
            let transform = transform_of(tick as f64 / rate);
            *scene.app.world_mut().get_mut::<Transform>(cart).unwrap() = transform;
            scene.tick(1.0 / rate);
            for (vertex, point) in [(0, points[0]), (10, points[1])] {
                let at = transform.transform_point(Vec3::new(0.1, 0.2, 0.3) + point * Vec3::new(1.0, 2.0, 0.5));
                let found = scene.positions(body)[vertex];
                assert!(found.distance(at) < 1e-5, "{rate} Hz, tick {tick}: {found} instead of {at}");
            }
        }
        let reach = scene.positions(body).iter().map(|at| at.distance(scene.positions(body)[0])).fold(0.0, f32::max);
        assert!(reach < 1.0, "{rate} Hz: the cloth follows its pins, and is {reach} m long");
        // Without its target, the cloth is free.
        scene.app.world_mut().despawn(cart);
        let before = mean(scene.positions(body)).y;
        scene.run(30);
        assert!(mean(scene.positions(body)).y < before - 0.3 && scene.diagnostics().refused.is_empty());
    }
}

/// A shirt around a cylinder that walks, bends, and turns: every vertex stays within its distance of the place on the
/// cylinder that it is tethered to, and comes no nearer to the cylinder than the clearance.
#[test]
fn a_garment_stays_near_the_body_that_wears_it() {
    const LONGEST: f32 = 0.03;
    const CLEARANCE: f32 = 0.007;
    let mut scene = Scene::new();
    let skin = icosphere(3, 0.2);
    let body = scene.add_obstacle(&skin, (SurfaceFrame::World, SurfaceThickness::World(0.001)));
    let shirt = icosphere(3, 0.21).rotate([0.3, 1.0, 0.2], 0.7);
    let positions: Vec<Vec3> = skin.positions.iter().map(|&at| Vec3::from(at)).collect();
    let garment: Vec<Vec3> = shirt.positions.iter().map(|&at| Vec3::from(at)).collect();
    let tethers = XpbdTethers::to_surface(body, (&positions, &skin.triangles), &garment, LONGEST, CLEARANCE);
    assert_eq!(tethers.tethers.len(), garment.len());
    let soft = XpbdMaterial { volume_compliance: f32::INFINITY, ..XpbdMaterial::CLOTH };
    // A closed mesh would be a solid, and have the body inside.
    let extra = (tethers.clone(), SurfaceThickness::World(0.001), SelfCollision, SweptCollision, Sidedness::TwoSided);
    let shirt = scene.add(&shirt, soft, extra);
    let (mut farthest, mut nearest) = (0.0_f32, f32::INFINITY);
    scene.run(1);
    for tick in 1..=120_u16 {
        let time = f32::from(tick) / 60.0;
        let turn = Quat::from_rotation_y(3.0 * time);
        let posed: Vec<Vec3> = positions
            .iter()
            .map(|&at| turn * (at + Vec3::X * (0.1 * at.y * bevy_math::ops::sin(6.0 * time))) + Vec3::X * (1.5 * time))
            .collect();
        scene.app.world_mut().get_mut::<SurfacePositions>(body).unwrap().0.clone_from(&posed);
        scene.tick(TICK);
        for tether in &tethers.tethers {
            let TetherTarget::Surface { triangle, barycentric, height, .. } = tether.target else { panic!() };
            let [a, b, c] = skin.triangles[triangle.0 as usize].map(|vertex| posed[vertex as usize]);
            let normal = (b - a).cross(c - a).normalize();
            let target = a * barycentric[0] + b * barycentric[1] + c * barycentric[2] + normal * height;
            let offset = scene.positions(shirt)[tether.vertex.index()] - target;
            farthest = farthest.max(offset.length());
            nearest = nearest.min(height + offset.dot(normal));
        }
    }
    assert!(farthest < 1.001 * LONGEST && farthest > 0.5 * LONGEST, "{farthest} of {LONGEST}");
    assert!(nearest > 0.999 * CLEARANCE && nearest < 1.1 * CLEARANCE, "{nearest} of {CLEARANCE}");
}

#[test]
fn tethers_that_cannot_hold_do_nothing() {
    let nobody = Entity::PLACEHOLDER;
    let (vertex, triangle, barycentric) = (VertexId(0), TriangleId(9), [1.0, 0.0, 0.0]);
    let pin = |target| Tether::pin(vertex, target);
    let cases = [
        pin(TetherTarget::Entity { entity: nobody, point: Vec3::ZERO }),
        pin(TetherTarget::Surface { entity: nobody, triangle, barycentric, height: 0.0 }),
        pin(TetherTarget::World(Vec3::NAN)),
        Tether { longest: f32::NAN, ..pin(TetherTarget::World(Vec3::ZERO)) },
        Tether::pin(VertexId(1000), TetherTarget::World(Vec3::ZERO)),
    ];
    let fall = |tethers: Option<XpbdTethers>| {
        let mut scene = Scene::new();
        let body = scene.add(&sheet(4, 0.2), XpbdMaterial::CLOTH, ());
        if let Some(tethers) = tethers {
            scene.app.world_mut().entity_mut(body).insert(tethers);
        }
        scene.run(20);
        scene.positions(body).to_vec()
    };
    let free = fall(None);
    for tether in cases {
        assert_eq!(fall(Some(XpbdTethers::new([tether]))), free, "{tether:?}");
    }
}

/// Head-on, `dv/dt = k (V − v)²` with `k = ½ρC/σ`, so that `v = V − V / (1 + kVt)`.
#[test]
fn a_sheet_is_blown_along_as_the_formula_says() {
    const WIND: f32 = 6.0;
    let mut scene = Scene::new();
    scene.settings().gravity = Vec3::ZERO;
    let wind = SurfaceWind { velocity: Vec3::Y * WIND, ..SurfaceWind::default() };
    let stiff = XpbdMaterial { bend_compliance: 0.0, ..LOSSLESS };
    let body = scene.add(&sheet(8, 0.5), stiff, wind);
    let k = f64::from(0.5 * wind.density * wind.drag / stiff.area_density);
    for tick in 1..=60 {
        scene.run(1);
        let time = f64::from(tick) * TICK;
        let wind = f64::from(WIND);
        let expected = wind - wind / (1.0 + k * wind * time);
        let found = mean(&scene.body(body).velocities).y;
        // Corners have a sixth or a third of a triangle's mass less than others, and lag or lead a little.
        assert!((found - expected).abs() < 0.02 * wind, "{time}: {found} instead of {expected}");
    }
    // In a hurricane, with long ticks, nothing overshoots.
    let gale = SurfaceWind { velocity: Vec3::new(80.0, 40.0, 0.0), ..wind };
    scene.app.world_mut().entity_mut(body).insert(gale);
    for _ in 0..60 {
        scene.tick(1.0 / 15.0);
        assert!(scene.fastest(body) < 2.0 * 90.0, "{}", scene.fastest(body));
    }
}

#[test]
fn a_gale_in_a_pinned_sheet_adds_no_speed_and_no_area() {
    for (velocity, lift) in [(Vec3::X * 30.0, 0.5), (Vec3::Z * 30.0, 0.5), (Vec3::Z * 30.0, 0.0)] {
        let mut scene = Scene::new();
        let wind = SurfaceWind { velocity, lift, ..SurfaceWind::default() };
        let body = scene.add(&sheet(16, 2.0), XpbdMaterial::CLOTH, wind);
        let pinned = scene.body(body).clone().pinned([VertexId(0), VertexId(16)]);
        scene.app.world_mut().entity_mut(body).insert(pinned);
        for _ in 0..150 {
            scene.tick(1.0 / 30.0);
            assert!(scene.fastest(body) < 2.0 * 30.0, "{wind:?}: {}", scene.fastest(body));
            let farthest = scene.positions(body).iter().map(|at| at.length()).fold(0.0, f32::max);
            assert!(farthest < 60.0, "{wind:?}: {farthest}");
        }
    }
}

/// The length of the shortest way along the edges from a vertex to each other one, by relaxing all edges until nothing
/// changes.
fn along_edges(mesh: &Mesh, from: usize) -> Vec<f64> {
    let at = |vertex: u32| Vec3::from(mesh.positions[vertex as usize]).as_dvec3();
    let mut lengths = vec![f64::INFINITY; mesh.positions.len()];
    lengths[from] = 0.0;
    loop {
        let before = lengths.clone();
        for &[a, b, c] in &mesh.triangles {
            for [from, to] in [[a, b], [b, c], [c, a], [b, a], [c, b], [a, c]] {
                let along = lengths[from as usize] + at(from).distance(at(to));
                lengths[to as usize] = lengths[to as usize].min(along);
            }
        }
        if lengths == before {
            return lengths;
        }
    }
}

#[test]
fn pinned_cloth_is_no_longer_than_its_way_along_the_edges() {
    // Bounds of the longest distance from a pin, as a multiple of the way, and of the longest edge. In a gale, two pins pull
    // a vertex apart.
    for (wind, rate, cells, most_of_way, most_of_edge) in [
        (0.0, 60.0, 16, 1.01, 1.02),
        (0.0, 30.0, 16, 1.01, 1.05),
        (0.0, 60.0, 40, 1.03, 1.1),
        (10.0, 60.0, 16, 1.05, 1.2),
        (30.0, 30.0, 40, 1.3, 4.0),
    ] {
        let mut scene = Scene::new();
        let mesh = sheet(cells, 2.0);
        let pins = [0, cells];
        let wind = SurfaceWind { velocity: Vec3::Z * wind, ..SurfaceWind::default() };
        let body = scene.add(&mesh, XpbdMaterial::CLOTH, wind);
        let pinned = scene.body(body).clone().pinned(pins.map(|pin| VertexId(pin as u32)));
        scene.app.world_mut().entity_mut(body).insert(pinned);
        let ways = pins.map(|pin| along_edges(&mesh, pin));
        let rest: Vec<Vec3> = scene.positions(body).to_vec();
        let (mut fullest, mut longest) = (0.0_f64, 0.0_f32);
        for _ in 0..ticks_in(3.0, rate) {
            scene.tick(1.0 / rate);
            let now = scene.positions(body);
            for (pin, way) in pins.iter().zip(&ways) {
                for (vertex, length) in way.iter().enumerate().filter(|(_, length)| **length > 0.0) {
                    fullest = fullest.max(now[vertex].as_dvec3().distance(now[*pin].as_dvec3()) / length);
                }
            }
            for &[a, b, c] in &mesh.triangles {
                for [from, to] in [[a, b], [b, c], [c, a]].map(|ends| ends.map(|end| end as usize)) {
                    longest = longest.max(now[from].distance(now[to]) / rest[from].distance(rest[to]));
                }
            }
        }
        let is_taut = (0.99..most_of_way).contains(&fullest);
        assert!(is_taut, "{wind:?} at {rate} Hz, {cells} cells: {fullest} of the way");
        assert!(longest < most_of_edge, "{wind:?} at {rate} Hz, {cells} cells: an edge is {longest} times as long");
        // What is no longer pinned falls.
        scene.body_mut(body).inverse_masses[0] = 10.0;
        scene.body_mut(body).inverse_masses[cells] = 10.0;
        scene.run(60);
        assert!(scene.positions(body)[0].distance(rest[0]) > 1.0);
    }
}

#[test]
fn elastic_cloth_may_hang_lower_than_its_way_along_the_edges() {
    let mut scene = Scene::new();
    let material = XpbdMaterial { stretch_compliance: 0.2, ..XpbdMaterial::CLOTH };
    let body = scene.add(&sheet(8, 1.0), material, ());
    let pinned = scene.body(body).clone().pinned((0..9).map(VertexId));
    scene.app.world_mut().entity_mut(body).insert(pinned);
    let last = scene.positions(body).len() - 1;
    let top = scene.positions(body)[8];
    scene.run(300);
    assert!(scene.positions(body)[last].distance(top) > 1.05, "{}", scene.positions(body)[last].distance(top));
}

#[test]
fn forces_and_impulses_accelerate_by_what_they_weigh() {
    let mut scene = Scene::new();
    let body = scene.add(&sheet(6, 0.3), LOSSLESS, ());
    let total = mass(&scene, body);
    // Each vertex carries its own weight, so the body hangs in the air. One more newton pulls it sideways.
    let up = scene.body(body).inverse_masses.iter().map(|inverse| Vec3::Y * (9.81 / inverse));
    let count = scene.positions(body).len();
    let forces: Vec<Vec3> = up.map(|up| up + Vec3::X / count as f32).collect();
    scene.app.world_mut().entity_mut(body).insert(SurfaceForces(forces));
    scene.run(30);
    let momentum = |scene: &Scene| -> DVec3 {
        let own = scene.body(body);
        own.velocities.iter().zip(&own.inverse_masses).map(|(v, inverse)| v.as_dvec3() / f64::from(*inverse)).sum()
    };
    let expected = DVec3::X * (30.0 * TICK);
    assert!(momentum(&scene).distance(expected) < 1e-3 * total.max(1.0), "{} for {expected}", momentum(&scene));
    let before = momentum(&scene);
    scene.body_mut(body).apply_impulse(VertexId(3), Vec3::new(0.0, 0.5, -0.25));
    scene.body_mut(body).apply_impulse(VertexId(9999), Vec3::ONE);
    let gained = momentum(&scene) - before;
    assert!(gained.distance(DVec3::new(0.0, 0.5, -0.25)) < 1e-5, "{gained}");
    scene.app.world_mut().entity_mut(body).insert(SurfaceForces(vec![Vec3::NAN; count]));
    scene.run(2);
    assert!(scene.positions(body).iter().all(|at| at.is_finite()) && scene.diagnostics().refused.is_empty());
}

/// What lies at rest pushes its support by its weight, where it lies, and what hits something gives it its momentum.
#[test]
fn reactions_are_what_bodies_weigh_and_what_they_bring() {
    // A static surface, a solid, and a plane; the surface's triangles get contacts of features.
    type Support = fn(&mut Scene) -> Entity;
    let supports: [(&str, Support); 3] = [
        ("surface", |scene| {
            scene.add_obstacle(
                &cuboid([1.0, 0.1, 1.0], 3),
                (SurfaceReaction::default(), Transform::from_xyz(2.0, -0.1, 0.0)),
            )
        }),
        ("cuboid", |scene| {
            let shape = RigidShape(SharedShape::cuboid(1.0, 0.1, 1.0));
            scene.app.world_mut().spawn((shape, SurfaceReaction::default(), Transform::from_xyz(2.0, -0.1, 0.0))).id()
        }),
        ("plane", |scene| {
            let shape = RigidShape(SharedShape::halfspace(Vec3::Y));
            scene.app.world_mut().spawn((shape, SurfaceReaction::default(), Transform::from_xyz(2.0, 0.0, 0.0))).id()
        }),
    ];
    for (name, support) in supports {
        let mut scene = Scene::new();
        let support = support(&mut scene);
        let place = Vec3::new(2.4, 0.05, 0.2);
        let body = scene.add(
            &sheet(8, 0.4).rotate([0.0, 1.0, 0.0], 0.3).translate(place.to_array()),
            LOSSLESS,
            (SweptCollision, SurfaceThickness::World(0.005)),
        );
        let reaction = |scene: &Scene| *scene.app.world().get::<SurfaceReaction>(support).unwrap();
        let (weight, mut brought) = (mass(&scene, body) * 9.81, DVec3::ZERO);
        let ticks = 180;
        for _ in 0..ticks {
            scene.run(1);
            brought += reaction(&scene).impulse.as_dvec3();
        }
        let expected = DVec3::NEG_Y * (weight * f64::from(ticks) * TICK);
        assert!(brought.distance(expected) < 0.02 * expected.length(), "{name}: {brought} instead of {expected}");
        let SurfaceReaction { impulse, angular_impulse } = reaction(&scene);
        let [impulse, angular] = [impulse, angular_impulse].map(Vec3::as_dvec3);
        let expected = DVec3::NEG_Y * (weight * TICK);
        assert!(impulse.distance(expected) < 0.02 * expected.length(), "{name}: {impulse} instead of {expected}");
        // About the origin of the support.
        let arm = mean(scene.positions(body)) - DVec3::X * 2.0;
        let moment = arm.cross(expected);
        let off = (angular - moment) * DVec3::new(1.0, 0.0, 1.0);
        assert!(off.length() < 0.03 * moment.length(), "{name}: {angular} instead of {moment}");
        // Once it is gone, nothing is left.
        scene.app.world_mut().despawn(body);
        scene.run(1);
        assert_eq!(reaction(&scene), SurfaceReaction::default(), "{name}");
    }
}

/// What a sheet loses where it hits something is in the reaction, including the bounce that contacts remove.
#[test]
fn reactions_and_momentum_of_bodies_add_up() {
    for (shape, name) in [(SharedShape::ball(0.3), "ball"), (SharedShape::cuboid(0.2, 0.1, 0.2), "cuboid")] {
        let mut scene = Scene::new();
        scene.settings().gravity = Vec3::ZERO;
        let support = scene.app.world_mut().spawn((RigidShape(shape), SurfaceReaction::default())).id();
        let body = scene.add(
            &sheet(20, 1.0).translate([0.1, 0.4, 0.05]),
            LOSSLESS,
            (SurfaceThickness::World(0.01), SelfCollision, SweptCollision),
        );
        scene.body_mut(body).velocities.fill(Vec3::NEG_Y * 2.0);
        let momentum = |scene: &Scene| -> DVec3 {
            let body = scene.body(body);
            let parts = body.velocities.iter().zip(&body.inverse_masses);
            parts.map(|(velocity, inverse)| velocity.as_dvec3() / f64::from(*inverse)).sum()
        };
        let start = momentum(&scene);
        let mut brought = DVec3::ZERO;
        for tick in 0..90 {
            scene.run(1);
            brought += scene.app.world().get::<SurfaceReaction>(support).unwrap().impulse.as_dvec3();
            // The solver works in f32.
            let off = (momentum(&scene) + brought - start).length();
            assert!(off < 1.0e-4 * start.length(), "{name}, tick {tick}: {off} of {start}");
        }
        assert!(brought.length() > 0.3 * start.length(), "{name}: it has hit: {brought} of {start}");
    }
}
