//! Layers of single triangles.

use std::collections::BTreeSet;

use bevy_circumsphere::{ContactStore, QuarantineReason, prelude::*, response::*};
use bevy_ecs::prelude::*;
use bevy_transform::components::Transform;
use circumsphere_support::{
    bars::BAND,
    random::Random,
    scenes::{Diagonals, Mesh, crumpled_sheet, grid, icosphere},
};
use circumsphere_truth::{ReferencePair, exact_weld, touching_pairs_between_brute_force, touching_pairs_brute_force};
use glam::{DVec3, Vec3};

use crate::world::{World, surface};

/// Half the contact distance. The edges of the cloth are about 2.7 long.
const THICKNESS: f32 = 0.15;

/// Layers of three groups, different for each triangle.
fn random_layers(mesh: &Mesh, seed: u64) -> Vec<SurfaceLayers> {
    let mut random = Random::new(seed);
    let mut bits = || random.below(8) as u32;
    mesh.triangles.iter().map(|_| SurfaceLayers { memberships: bits(), filters: bits() }).collect()
}

/// Whether two layers meet, in the words of the docs: each belongs to a group that the other one meets.
fn meet(a: SurfaceLayers, b: SurfaceLayers) -> bool {
    let belongs = |own: SurfaceLayers, other: SurfaceLayers| {
        (0..32).any(|group| own.memberships >> group & 1 == 1 && other.filters >> group & 1 == 1)
    };
    belongs(a, b) && belongs(b, a)
}

fn points(mesh: &Mesh) -> Vec<DVec3> {
    mesh.positions.iter().map(|&point| Vec3::from(point).as_dvec3()).collect()
}

/// Touching pairs of a mesh with itself or with another one, by f64 brute force: those within a distance for certain, and
/// those that may be.
fn reference(mesh: &Mesh, other: Option<&Mesh>) -> [Vec<ReferencePair>; 2] {
    [-BAND, BAND].map(|band| {
        let distance = f64::from(2.0 * THICKNESS) * (1.0 + band);
        let own = points(mesh);
        match other {
            None => touching_pairs_brute_force(&own, &mesh.triangles, &exact_weld(&own), distance),
            Some(other) => {
                let others = points(other);
                touching_pairs_between_brute_force(&own, &mesh.triangles, &others, &other.triangles, distance)
            }
        }
    })
}

/// The touching pairs of triangles of two entities, or of one with itself.
fn touching(world: &World, a: Entity, b: Entity) -> BTreeSet<[u32; 2]> {
    let store = world.app.world().resource::<ContactStore>();
    let pairs = store.pairs().iter().filter(|pair| [pair.a.entity(), pair.b.entity()] == [a, b]);
    pairs.flat_map(|pair| pair.touching.iter().map(|pair| [pair.triangle_a, pair.triangle_b])).collect()
}

fn names(pairs: &[ReferencePair], meet: impl Fn(&ReferencePair) -> bool) -> BTreeSet<[u32; 2]> {
    pairs.iter().filter(|pair| meet(pair)).map(|pair| [pair.triangle_a, pair.triangle_b]).collect()
}

#[test]
fn triangles_touch_as_in_the_reference_if_their_layers_meet() {
    let mesh = crumpled_sheet(200, 0.0);
    let ball = icosphere(3, 4.0).translate(mesh.positions[60]);
    let own = random_layers(&mesh, 1);
    let others = random_layers(&ball, 2);
    let whole = SurfaceLayers { memberships: 5, filters: 6 };
    let [with_ball, with_itself] = [reference(&mesh, Some(&ball)), reference(&mesh, None)];
    for method in [ContactMethod::Closest, ContactMethod::Exact, ContactMethod::Polygon] {
        // Both sides by triangle, and one of them as a whole.
        for of_ball in [Some(&others), None] {
            let mut world = World::detecting();
            let extra = (SurfaceThickness::World(THICKNESS), method);
            let layers = TriangleLayers::new(own.iter().copied());
            // All layers of the surfaces meet.
            let all = SurfaceLayers { memberships: u32::MAX, filters: u32::MAX };
            let cloth = world.spawn(&mesh, (extra, SelfCollision, all, layers));
            let ball_entity = world.spawn(&ball, (extra, whole));
            if let Some(layers) = of_ball {
                world.insert(ball_entity, (all, TriangleLayers::new(layers.iter().copied())));
            }
            world.app.update();
            let of_other = |triangle: u32| of_ball.map_or(whole, |layers| layers[triangle as usize]);
            let [certain, possible] = with_ball
                .each_ref()
                .map(|pairs| names(pairs, |pair| meet(own[pair.triangle_a as usize], of_other(pair.triangle_b))));
            let found = touching(&world, cloth, ball_entity);
            assert!(found.is_superset(&certain) && found.is_subset(&possible), "{method:?}");
            assert!(!found.is_empty() && found.len() < with_ball[0].len());
            let [certain, possible] = with_itself
                .each_ref()
                .map(|pairs| names(pairs, |pair| meet(own[pair.triangle_a as usize], own[pair.triangle_b as usize])));
            let found = touching(&world, cloth, cloth);
            assert!(found.is_superset(&certain) && found.is_subset(&possible), "{method:?}");
            assert!(!found.is_empty() && found.len() < with_itself[0].len());
        }
    }
}

#[test]
fn rigid_shapes_meet_triangles_by_their_layers() {
    let sheet = grid(8, 8, 4.0, 4.0, Diagonals::Uniform);
    // Above the middle of the sheet, which the shapes pass through.
    let in_the_middle = |triangle: usize| (triangle / 16).is_multiple_of(2);
    let [low, high] = [1, 2].map(|group| SurfaceLayers { memberships: group, filters: u32::MAX });
    let layers = (0..sheet.triangles.len()).map(|triangle| if in_the_middle(triangle) { low } else { high });
    let shapes: [SharedShape; 2] = [
        SharedShape::ball(0.9),
        SharedShape::trimesh(
            icosphere(2, 0.9).positions.iter().map(|&point| Vec3::from(point)).collect(),
            icosphere(2, 0.9).triangles,
        )
        .expect("the mesh is sound"),
    ];
    for shape in shapes {
        let triangles = |of_sheet: Option<TriangleLayers>, of_shape: SurfaceLayers| -> BTreeSet<u32> {
            let mut world = World::detecting();
            let all = SurfaceLayers { memberships: u32::MAX, filters: u32::MAX };
            let entity = world.spawn(&sheet, (SurfaceThickness::World(0.05), all));
            if let Some(layers) = of_sheet {
                world.insert(entity, layers);
            }
            world.app.world_mut().spawn((RigidShape(shape.clone()), Transform::default(), of_shape));
            world.app.update();
            let store = world.app.world().resource::<ContactStore>();
            store.touching().map(|pair| pair.triangle_a).collect()
        };
        let meets_low = SurfaceLayers { memberships: 4, filters: 1 };
        let all = triangles(None, meets_low);
        let expected: BTreeSet<u32> =
            all.iter().copied().filter(|&triangle| in_the_middle(triangle as usize)).collect();
        assert!(!expected.is_empty() && expected.len() < all.len());
        assert_eq!(triangles(Some(TriangleLayers::new(layers.clone())), meets_low), expected);
    }
}

#[test]
fn a_change_of_layers_takes_effect_where_nothing_moves() {
    let sheet = grid(2, 2, 1.0, 1.0, Diagonals::Uniform);
    let mut world = World::detecting();
    let thin = SurfaceThickness::World(0.05);
    let lower = world.spawn(&sheet, thin);
    let upper = world.spawn(&sheet.clone().translate([0.01, 0.05, 0.02]), thin);
    let count = |world: &mut World| {
        world.app.update();
        world.app.update();
        touching(world, lower, upper).len()
    };
    let all = count(&mut world);
    assert!(all > 8);
    let [meeting, passing] = [u32::MAX, 2].map(|filters| SurfaceLayers { memberships: 1, filters });
    let layers = (0..8).map(|triangle| if triangle < 4 { passing } else { meeting });
    world.insert(lower, TriangleLayers::new(layers));
    let some = count(&mut world);
    assert!(0 < some && some < all);
    // The layers of the other surface count for its triangles.
    world.insert(upper, SurfaceLayers { memberships: 3, filters: u32::MAX });
    assert_eq!(count(&mut world), all);
    world.insert(upper, SurfaceLayers { memberships: 1, filters: u32::MAX });
    assert_eq!(count(&mut world), some);
    world.app.world_mut().entity_mut(lower).remove::<TriangleLayers>();
    assert_eq!(count(&mut world), all);
}

#[test]
fn layers_of_another_number_of_triangles_are_refused() {
    let mut world = World::detecting();
    let sheet = grid(2, 2, 1.0, 1.0, Diagonals::Uniform);
    let layers = |count: usize| TriangleLayers::new(vec![SurfaceLayers::default(); count]);
    let entity = world.spawn(&sheet, layers(7));
    let trimesh = SharedShape::trimesh(vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![[0, 1, 2]]).expect("the mesh is sound");
    let shape = world.app.world_mut().spawn((RigidShape(trimesh), layers(2))).id();
    world.app.update();
    let status = |world: &World, entity| world.app.world().get::<SurfaceStatus>(entity).expect("it has one").clone();
    let refused = |expected, found| SurfaceStatus::Quarantined(QuarantineReason::TriangleLayers { expected, found });
    assert_eq!(status(&world, entity), refused(8, 7));
    assert_eq!(status(&world, shape), refused(1, 2));
    world.insert(entity, layers(8));
    world.insert(shape, layers(1));
    world.app.update();
    assert_eq!(status(&world, entity), SurfaceStatus::Active);
    assert_eq!(status(&world, shape), SurfaceStatus::Active);
}

/// A strip of cloth from inside a ball to outside, pinned inside. Returns the largest distance by which a vertex moves
/// within a second, of those that begin inside.
fn collar(with_layers: bool, is_solid: bool) -> f32 {
    let strip = grid(12, 2, 3.0, 0.5, Diagonals::Alternating).translate([1.0, 0.0, 0.0]);
    let mut world = World::responding();
    world.app.world_mut().resource_mut::<XpbdSettings>().gravity = Vec3::ZERO;
    let (surface, positions) = surface(&strip);
    let is_inside = |vertex: u32| positions.0[vertex as usize].length() < 1.1;
    let body = XpbdBody::new(&surface, &positions, XpbdMaterial::CLOTH).expect("the mesh can be a body").pinned([
        VertexId(0),
        VertexId(13),
        VertexId(26),
    ]);
    let clothes = SurfaceLayers { memberships: 2, filters: u32::MAX };
    let layers = strip.triangles.iter().map(|corners| {
        let is_collar = corners.iter().any(|&vertex| is_inside(vertex));
        SurfaceLayers { filters: if is_collar { !1 } else { u32::MAX }, ..clothes }
    });
    let layers = TriangleLayers::new(layers);
    let before = positions.0.clone();
    let thin = SurfaceThickness::World(0.02);
    let entity = world.app.world_mut().spawn((surface, positions, body, thin, clothes, SweptCollision)).id();
    if with_layers {
        world.insert(entity, layers);
    }
    if is_solid {
        world.app.world_mut().spawn(RigidShape(SharedShape::ball(1.0)));
    } else {
        world.spawn(&icosphere(3, 1.0), thin);
    }
    (0..60).for_each(|_| world.tick());
    let after = &world.app.world().get::<SurfacePositions>(entity).expect("it is a surface").0;
    let moved = before.iter().zip(after).filter(|(before, _)| before.length() < 0.9);
    moved.map(|(before, after)| before.distance(*after)).fold(0.0, f32::max)
}

#[test]
fn a_collar_stays_in_its_neck() {
    for is_solid in [false, true] {
        let [pushed, left] = [false, true].map(|with_layers| collar(with_layers, is_solid));
        assert!(pushed > 0.1, "solid {is_solid}: without layers it is pushed out by only {pushed}");
        assert!(left < 1.0e-3, "solid {is_solid}: with layers it is moved by {left}");
    }
}

#[test]
fn the_guard_lets_triangles_pass_whose_layers_do_not_meet() {
    for passes in [false, true] {
        let mut world = World::responding();
        let thin = SurfaceThickness::World(0.01);
        let floor = world.spawn(&grid(2, 2, 4.0, 4.0, Diagonals::Uniform), thin);
        if passes {
            let none = SurfaceLayers { memberships: 1, filters: 2 };
            world.insert(floor, TriangleLayers::new(vec![none; 8]));
        }
        let falling = world.shoot_down(thin);
        world.tick();
        let height = world.height(falling);
        assert_eq!(height < 0.0, passes, "it is at {height}");
    }
}
