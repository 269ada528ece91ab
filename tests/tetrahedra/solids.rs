//! Bodies whose inside resists, against closed forms of elasticity and what is conserved.

use bevy_circumsphere::{prelude::*, response::*};
use bevy_tasks::{ComputeTaskPool, TaskPoolBuilder};
use circumsphere_support::{
    random::Random,
    tetrahedra::{tetrahedral_ball, tetrahedral_box},
};
use glam::{DQuat, DVec3, Vec3};

use crate::world::{LOSSLESS, World, lame_parameters, moved};

/// Solves `function(x) = 0` for a rising function.
fn root(function: impl Fn(f64) -> f64, [mut low, mut high]: [f64; 2]) -> f64 {
    assert!(function(low) < 0.0 && function(high) > 0.0);
    for _ in 0..100 {
        let middle = f64::midpoint(low, high);
        if function(middle) < 0.0 { low = middle } else { high = middle }
    }
    low
}

fn elastic(young_modulus: f32, poisson_ratio: f32) -> XpbdMaterial {
    // They come to rest.
    XpbdMaterial { young_modulus, poisson_ratio, drag: 5.0, damping: 50.0, ..XpbdMaterial::SOLID }
}

/// Applies a force per reference area to the surface, given its outward area, and lets the body come to rest.
fn loaded(world: &mut World, solid: &crate::world::Solid, force: impl Fn(DVec3) -> DVec3) {
    let forces = solid.areas(world).into_iter().map(|area| force(area).as_vec3()).collect();
    world.app.world_mut().entity_mut(solid.entity).insert(SurfaceForces(forces));
    world.run(240);
    assert!(world.fastest(solid) < 1.0e-2, "{}", world.fastest(solid));
}

/// The stretches of a box along and across x, by its extents in the middle.
fn stretches(world: &World, solid: &crate::world::Solid) -> [f64; 2] {
    let now = world.positions(solid);
    let extent = |points: &[DVec3], axis: usize| {
        // Near the middle, far from where forces act.
        let near = solid.rest.iter().zip(points).filter(|(rest, _)| rest.x.abs() < 0.21);
        let (low, high) = near.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), (_, point)| {
            (low.min(point[axis]), high.max(point[axis]))
        });
        high - low
    };
    [0, 1].map(|axis| extent(&now, axis) / extent(&solid.rest, axis))
}

#[test]
fn a_bar_stretches_by_youngs_modulus_and_thins_by_poissons_ratio() {
    for (young_modulus, poisson_ratio, stretch) in
        [(1.0e5, 0.45, 1.005), (1.0e5, 0.3, 1.005), (3.0e4, 0.0, 1.005), (1.0e5, 0.3, 1.5), (1.0e5, 0.45, 1.2)]
    {
        let mut world = World::new();
        let bar = world.add(&tetrahedral_box([16, 4, 4], [0.4, 0.1, 0.1]), elastic(young_modulus, poisson_ratio), ());
        let [shear, lame] = lame_parameters(&world.body(&bar).material);
        // Uniaxial stress: the sides are free. From ∂Ψ/∂F = μ F + (λ J − λ − 2μ + μ J) cof F.
        let hydrostatic = |volume: f64| (lame + shear) * (volume - 1.0) - shear;
        let free = |across: f64| shear * across + hydrostatic(stretch * across * across) * stretch * across;
        let across = root(free, [0.5, 1.5]);
        let stress = shear * stretch + hydrostatic(stretch * across * across) * across * across;
        loaded(&mut world, &bar, |area| DVec3::X * area.x * stress);
        let [along, thin] = stretches(&world, &bar);
        // The default number of substeps leaves some of the force unsolved, in proportion to the stiffness.
        assert!(((along - stretch) / (stretch - 1.0)).abs() < 0.02, "{young_modulus} {poisson_ratio}: {along}");
        assert!(((thin - across) / (stretch - 1.0)).abs() < 0.015, "{young_modulus} {poisson_ratio}: {thin} {across}");
        if stretch == 1.005 {
            // Linear elasticity, within the strain.
            let [young_modulus, poisson_ratio] = [young_modulus, poisson_ratio].map(f64::from);
            let found = stress / (along - 1.0);
            assert!((found / young_modulus - 1.0).abs() < 0.05, "{found} instead of {young_modulus}");
            let found = (1.0 - thin) / (along - 1.0);
            assert!((found - poisson_ratio).abs() < 0.02, "{found} instead of {poisson_ratio}");
        }
    }
}

#[test]
fn a_bar_as_stiff_as_the_solver_can_make_it_is_a_fifth_too_soft_and_less_with_more_substeps() {
    // Its density times the square of its edge per substep.
    let most = 1000.0 * f64::powi(0.05 * 60.0 * 10.0, 2);
    for (substeps, error) in [(10, 0.25), (30, 0.05)] {
        let mut world = World::new();
        world.settings().substeps = substeps;
        let bar = world.add(&tetrahedral_box([16, 4, 4], [0.4, 0.1, 0.1]), elastic(most as f32, 0.3), ());
        loaded(&mut world, &bar, |area| DVec3::X * area.x * (0.02 * most));
        let [along, _] = stretches(&world, &bar);
        println!("{substeps} substeps: {along}");
        // Of the second order in the strain, it is nonlinear.
        assert!((-0.03..error).contains(&((along - 1.0) / 0.02 - 1.0)), "{substeps}: {along}");
    }
}

#[test]
fn a_cube_that_is_pulled_from_all_sides_grows_by_its_bulk_modulus() {
    for (young_modulus, poisson_ratio, scale) in [(1.0e5, 0.45, 1.005), (1.0e5, 0.3, 1.05), (5.0e4, 0.4, 1.05)] {
        let mut world = World::new();
        let cube = world.add(&tetrahedral_box([6; 3], [0.2; 3]), elastic(young_modulus, poisson_ratio), ());
        let [shear, lame] = lame_parameters(&world.body(&cube).material);
        let change = f64::powi(scale, 3) - 1.0;
        let stress = shear * scale + ((lame + shear) * change - shear) * scale * scale;
        loaded(&mut world, &cube, |area| area * stress);
        let volumes = world.volumes(&cube);
        let mean = volumes.iter().sum::<f64>() / volumes.len() as f64 - 1.0;
        // The stiffer, the more of the force do the default substeps leave unsolved.
        assert!((mean / change - 1.0).abs() < 0.05, "{young_modulus} {poisson_ratio}: {mean} instead of {change}");
        if scale == 1.005 {
            let bulk_modulus = lame + 2.0 / 3.0 * shear;
            let found = stress / mean;
            assert!((found / bulk_modulus - 1.0).abs() < 0.06, "{found} instead of {bulk_modulus}");
        }
    }
}

#[test]
fn energy_does_not_grow_and_momenta_are_kept() {
    for (young_modulus, stretch, spin) in
        [1.0e4, 1.0e5, 1.0e7, 1.0e10].into_iter().flat_map(|modulus| [(modulus, 1.2, 0.0), (modulus, 1.0, 1.0)])
    {
        let mut world = World::new();
        let ball = world.add(&tetrahedral_ball(6, 0.2), XpbdMaterial { young_modulus, ..LOSSLESS }, ());
        // It begins stretched, or turns, and flies.
        let stretched = ball.rest.iter().map(|at| *at * DVec3::new(stretch, 1.0, 1.0)).collect::<Vec<_>>();
        let spin = DVec3::new(0.2, 0.6, 0.3) * spin;
        let velocities = stretched.iter().map(|at| (DVec3::new(0.3, 0.1, -0.2) + spin.cross(*at)).as_vec3()).collect();
        world.place(&ball, stretched.into_iter());
        world.body_mut(&ball).velocities = velocities;
        let energy = |world: &World| world.body(&ball).kinetic_energy() + world.elastic_energy(&ball);
        let ([momentum, angular], before) = (world.momenta(&ball), energy(&world));
        let mut most = before;
        for tick in 0..120 {
            world.tick();
            let now = energy(&world);
            assert!(now < most * 1.002, "{young_modulus} {stretch}: {now} after {most} in tick {tick}");
            most = now;
        }
        let [momentum_after, angular_after] = world.momenta(&ball);
        assert!(momentum.distance(momentum_after) < 1.0e-4 * momentum.length(), "{momentum} {momentum_after}");
        println!("{young_modulus:e} {stretch}: angular momentum {angular:.4} {angular_after:.4}");
        // A solve keeps it at the positions of its time, so what springs back from a large stretch may turn a little.
        if stretch == 1.0 {
            assert!(angular.distance(angular_after) < 0.02 * angular.length(), "{angular} {angular_after}");
        }
    }
}

#[test]
fn what_is_turned_inside_out_crushed_or_torn_comes_back() {
    for young_modulus in [1.0e4, 1.0e5, 1.0e8] {
        for kind in 0..4 {
            let mut random = Random::new(0x5c4a);
            let mut world = World::new();
            let cube = world.add(
                &tetrahedral_box([5; 3], [0.1; 3]),
                XpbdMaterial { young_modulus, ..XpbdMaterial::SOLID },
                (),
            );
            let mut place = |at: DVec3| match kind {
                0 => DVec3::from_array(std::array::from_fn(|_| 0.1 * f64::from(random.signed_unit()))),
                1 => at * DVec3::new(1.0, 1.0e-4, 1.0),
                2 => at * DVec3::new(-1.0, 1.0, 1.0),
                _ => at * 0.01,
            };
            let places: Vec<DVec3> = cube.rest.iter().map(|&at| place(at)).collect();
            world.place(&cube, places.into_iter());
            assert!(kind % 2 == 1 || world.inverted(&cube) > 200, "{}", world.inverted(&cube));
            world.run(180);
            let volumes = world.volumes(&cube);
            let worst = volumes.iter().map(|volume| (volume - 1.0).abs()).fold(0.0, f64::max);
            assert_eq!(world.inverted(&cube), 0, "{young_modulus} {kind}");
            // The softest is not yet at rest.
            assert!(worst < 0.01 || young_modulus <= 1.0e4, "{young_modulus} {kind}: {worst}");
        }
    }
}

#[test]
fn vertices_inside_neither_fall_nor_creep_and_the_body_sleeps() {
    let mut world = World::new();
    world.settings().gravity = Vec3::NEG_Y * 9.81;
    world.settings().sleep_speed = XpbdSettings::default().sleep_speed;
    world.app.world_mut().spawn(RigidShape(SharedShape::halfspace(Vec3::Y)));
    let mesh = tetrahedral_box([6, 6, 6], [0.15; 3]);
    let cubes = [1.0e5_f32, 1.0e7, 1.0e9].map(|young_modulus| {
        let at = [young_modulus.log10(), 0.2, 0.0];
        (at, world.add(&moved(&mesh, at), XpbdMaterial { young_modulus, ..XpbdMaterial::SOLID }, ()))
    });
    world.run(240);
    assert_eq!(world.app.world().resource::<XpbdDiagnostics>().asleep, 3);
    for (at, cube) in &cubes {
        let lowest = world.positions(cube).into_iter().map(|at| at.y).fold(f64::INFINITY, f64::min);
        assert!((0.0..0.01).contains(&lowest), "{at:?} {lowest}");
        let volumes = world.volumes(cube);
        // Its own weight presses the softest by ρ g h / E, 3 %.
        assert!(volumes.iter().all(|volume| (0.94..1.03).contains(volume)), "{at:?} {volumes:?}");
    }
}

#[test]
fn a_pinned_bar_hangs_and_its_pins_stay() {
    let mut world = World::new();
    world.settings().gravity = Vec3::NEG_Y * 9.81;
    let bar = world.add(&tetrahedral_box([4, 12, 4], [0.1, 0.3, 0.1]), elastic(1.0e5, 0.3), ());
    let top = |at: &DVec3| at.y > 0.299;
    for (vertex, _) in bar.rest.iter().enumerate().filter(|(_, at)| top(at)) {
        world.body_mut(&bar).inverse_masses[vertex] = 0.0;
    }
    world.run(240);
    let now = world.positions(&bar);
    assert!(bar.rest.iter().zip(&now).filter(|(rest, _)| top(rest)).all(|(rest, now)| rest == now));
    // A bar of length L under its own weight gets longer by ρ g L² / 2E, 1.8 %. That of the pinned end, which cannot get
    // thinner, is a little stiffer.
    let lowest = now.iter().map(|at| at.y).fold(f64::INFINITY, f64::min);
    let expected = 1000.0 * 9.81 * 0.36 / 2.0e5;
    assert!(((-0.3 - lowest) / expected - 1.0).abs() < 0.1, "{lowest} {expected}");
}

#[test]
fn a_solution_is_the_same_to_the_last_bit_for_any_number_of_threads() {
    let pool = ComputeTaskPool::get_or_init(|| TaskPoolBuilder::new().num_threads(3).build());
    assert!(pool.thread_num() > 1);
    let fallen = |threads: usize| {
        let mut world = World::new();
        world.app.world_mut().resource_mut::<CircumsphereSettings>().threads = threads;
        world.settings().gravity = Vec3::NEG_Y * 9.81;
        world.app.world_mut().spawn(RigidShape(SharedShape::halfspace(Vec3::Y)));
        let bar = tetrahedral_box([30, 9, 9], [0.6, 0.1, 0.1]);
        let bars = [0.12, 0.4].map(|y| world.add(&moved(&bar, [0.1 * y, y, 0.0]), XpbdMaterial::SOLID, SelfCollision));
        world.run(30);
        let bits = |at: DVec3| at.to_array().map(f64::to_bits);
        bars.map(|bar| world.positions(&bar).into_iter().map(bits).collect::<Vec<_>>())
    };
    let alone = fallen(1);
    // Each bar is in several slabs.
    assert!(alone[0].len() > 2048);
    for threads in [2, 0] {
        assert!(fallen(threads) == alone, "{threads} threads");
    }
}

#[test]
fn what_cannot_be_a_solid_is_refused_with_the_reason() {
    let mesh = tetrahedral_box([2; 3], [0.1; 3]);
    let rest: Vec<Vec3> = mesh.positions.iter().copied().map(Vec3::from_array).collect();
    let (inside, surface, positions) = TetrahedralBody::from_mesh(&rest, &mesh.tetrahedra).unwrap();
    let refused = |material| XpbdBody::tetrahedral(&inside, &surface, &positions, material).unwrap_err().to_string();
    let solid = XpbdMaterial::SOLID;
    for young_modulus in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        assert!(refused(XpbdMaterial { young_modulus, ..solid }).starts_with("Young's modulus is"));
    }
    for poisson_ratio in [-0.1, 0.51, f32::NAN] {
        assert!(refused(XpbdMaterial { poisson_ratio, ..solid }).starts_with("Poisson's ratio is"));
    }
    assert!(refused(XpbdMaterial { density: 0.0, ..solid }).starts_with("the density is 0"));
    // A body of the surface alone would let the vertices inside fall.
    let mut world = World::new();
    let body = XpbdBody::new(&surface, &positions, solid).unwrap();
    let entity = world.app.world_mut().spawn((inside, surface, positions, body)).id();
    world.tick();
    let XpbdDiagnostics { refused, .. } = world.app.world().resource::<XpbdDiagnostics>();
    assert_eq!(*refused, [(entity, XpbdBodyError::Tetrahedra)]);
}

#[test]
fn inverted_and_flat_tetrahedra_at_rest_are_left_out_and_the_others_hold() {
    let mut mesh = tetrahedral_box([4; 3], [0.1; 3]);
    // The middle vertex is pulled through a face, and one next to it into a face.
    let middle = mesh.positions.iter().position(|at| *at == [0.0; 3]).unwrap();
    mesh.positions[middle] = [0.06, 0.0, 0.0];
    let mut world = World::new();
    world.settings().gravity = Vec3::NEG_Y * 9.81;
    world.app.world_mut().spawn(RigidShape(SharedShape::halfspace(Vec3::Y)));
    let cube = world.add(&moved(&mesh, [0.0, 0.11, 0.0]), XpbdMaterial::SOLID, ());
    let left_out: Vec<usize> = world.body(&cube).left_out().iter().map(|id| id.index()).collect();
    let report =
        TetrahedralBody::from_mesh(&cube.rest.iter().map(|at| at.as_vec3()).collect::<Vec<_>>(), &cube.tetrahedra);
    let inverted = report.unwrap().0.topology().report().inverted.clone();
    assert!(inverted.len() > 2 && inverted.iter().all(|id| left_out.contains(&id.index())), "{left_out:?}");
    world.run(120);
    assert!(world.fastest(&cube) < 1.0e-2, "{}", world.fastest(&cube));
    let volumes = world.volumes(&cube);
    let others = volumes.iter().enumerate().filter(|(place, _)| !left_out.contains(place));
    assert!(others.clone().all(|(_, volume)| (0.8..1.2).contains(volume)), "{:?}", others.collect::<Vec<_>>());
}

#[test]
fn a_body_far_from_the_origin_and_scaled_behaves_as_one_near_it() {
    let fall = |origin: DVec3, scale: f32| {
        let mut world = World::new();
        let mesh = moved(&tetrahedral_ball(4, 0.2 / f64::from(scale)), [0.0; 3]);
        let turn = DQuat::from_rotation_x(0.5).as_quat();
        let pose = bevy_transform::components::Transform::from_translation(origin.as_vec3())
            .with_rotation(turn)
            .with_scale(Vec3::splat(scale));
        let material = XpbdMaterial { density: 1000.0 * scale.powi(3), ..LOSSLESS };
        let ball = world.add(&mesh, material, pose);
        let squeezed: Vec<DVec3> = ball.rest.iter().map(|at| *at * DVec3::new(1.1, 0.9, 1.0)).collect();
        world.place(&ball, squeezed.into_iter());
        world.run(20);
        world.volumes(&ball)
    };
    let near = fall(DVec3::ZERO, 1.0);
    assert!(near.iter().any(|volume| (volume - 1.0).abs() > 1.0e-4));
    for other in [fall(DVec3::new(1.0e5, -3.0e4, 2.0e5), 1.0), fall(DVec3::ZERO, 4.0)] {
        let worst = near.iter().zip(&other).map(|(one, other)| (one - other).abs()).fold(0.0, f64::max);
        assert!(worst < 2.0e-4, "{worst}");
    }
}
