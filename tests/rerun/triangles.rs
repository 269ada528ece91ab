//! Spheres, cones, curvature, recipe ages, and boxes in the recording match those that the stages keep.

use std::collections::{BTreeMap, BTreeSet};

use bevy_circumsphere::{
    ActiveSurfaces, Circumspheres, EnclosingBalls, TriangleCones, TriangleCurvature,
    debug::{LevelOfDetail, RerunSettings},
    detection::{CandidateTrianglePairs, DetectionDiagnostics, OtherSide, SurfaceStates},
    prelude::*,
};
use bevy_ecs::prelude::*;
use glam::{Quat, Vec3};

use crate::{
    recording::{Components, bits},
    world::{
        Made, Recorded, Scene, THIN, everything, near, near_contacts, nothing, positions, sheet, spawn, world_affine,
    },
};

/// The surfaces of all pairs that are tested by `method`.
fn used_by(recorded: &Recorded, method: ContactMethod) -> BTreeSet<Entity> {
    let active = recorded.app.world().resource::<ActiveSurfaces>();
    let pairs = recorded.app.world().resource::<CandidateTrianglePairs>().pairs().iter();
    let sides = pairs.filter(|pair| pair.method == method).flat_map(|pair| {
        let second = match pair.second {
            OtherSide::Surface(second) => Some(second),
            OtherSide::Shape(_) => None,
        };
        [Some(pair.first), second].into_iter().flatten()
    });
    sides.map(|place| active.surfaces[place].entity).collect()
}

fn is_one_sided(recorded: &Recorded, entity: Entity) -> bool {
    let active = recorded.app.world().resource::<ActiveSurfaces>();
    active.surfaces.iter().find(|surface| surface.entity == entity).expect("the surface is active").one_sided
}

fn wanted(recorded: &mut Recorded, level: LevelOfDetail, entity: Entity) -> Vec<u32> {
    let count = recorded.app.world().get::<Made>(entity).expect("the entity has its mesh").0.triangles.len() as u32;
    match level {
        LevelOfDetail::Off => Vec::new(),
        LevelOfDetail::NearContacts => near_contacts(&mut recorded.app, entity).into_iter().collect(),
        LevelOfDetail::All => (0..count).collect(),
    }
}

#[track_caller]
pub fn assert_posed(recorded: &Recorded, entity: Entity, components: &Components) {
    let affine = world_affine(recorded.app.world(), entity);
    assert_eq!(components.vectors::<9>("Transform3D:mat3x3"), [affine.matrix3.as_mat3().to_cols_array()]);
    assert_eq!(components.vectors::<3>("Transform3D:translation"), [affine.translation.as_vec3().to_array()]);
}

/// A sphere or the top of a cone: its triangle, center, axis, radius, and the cosine of the cone's half angle.
#[derive(Clone, Copy, Debug)]
struct Cap {
    triangle: u32,
    center: Vec3,
    axis: Vec3,
    radius: f32,
    cosine: f32,
}

/// Both caps of each triangle of a sheet, or the one cap of a solid's.
fn caps(recorded: &Recorded, entity: Entity, triangles: &[u32]) -> Vec<Cap> {
    let one_sided = is_one_sided(recorded, entity);
    let entity = recorded.app.world().entity(entity);
    let spheres = entity.get::<Circumspheres>().expect("the entity is a surface");
    let cones = entity.get::<TriangleCones>().expect("the entity is a surface");
    let mut caps = Vec::new();
    for &triangle in triangles {
        let place = triangle as usize;
        let (center, height, radius) = (spheres.centers[place], spheres.heights[place], spheres.radii[place]);
        let (axis, cosine) = (cones.axes[place], cones.cosines[place]);
        caps.push(Cap { triangle, center, axis, radius, cosine });
        if !one_sided && height > 0.0 {
            caps.push(Cap { triangle, center: center + 2.0 * height * axis, axis: -axis, radius, cosine });
        }
    }
    caps
}

#[test]
fn spheres_and_balls_are_those_of_the_stages() {
    for (level, settings) in [(LevelOfDetail::All, everything()), (LevelOfDetail::NearContacts, near())] {
        for method in ContactMethod::ALL {
            let mut recorded = Recorded::new(settings.clone());
            let scene = Scene::spawn(&mut recorded.app, method);
            let (mut count, mut behind) = (0, 0);
            for tick in 0..3 {
                scene.advance(&mut recorded.app, tick);
                recorded.tick();
                for (name, entity) in scene.surfaces() {
                    let triangles = wanted(&mut recorded, level, entity);
                    let mut expected: Vec<(u32, Vec3, f32)> = Vec::new();
                    if used_by(&recorded, ContactMethod::Circumsphere).contains(&entity) {
                        let caps = caps(&recorded, entity, &triangles);
                        behind += caps.len() - triangles.len();
                        expected.extend(caps.iter().map(|cap| (cap.triangle, cap.center, cap.radius)));
                    }
                    if used_by(&recorded, ContactMethod::BoundingSphere).contains(&entity) {
                        let balls = recorded.app.world().get::<EnclosingBalls>(entity).expect("it is a surface");
                        let ball = |triangle: u32| balls[triangle as usize];
                        expected.extend(
                            triangles.iter().map(|&triangle| (triangle, ball(triangle).center, ball(triangle).radius)),
                        );
                    }
                    let shown = recorded.viewer.of(&["spheres", name]);
                    assert_eq!(shown.is_some(), !expected.is_empty(), "{method:?}: {name} at {tick}");
                    let Some(shown) = shown else { continue };
                    assert_posed(&recorded, entity, shown);
                    assert_eq!(shown.wholes("triangle"), expected.iter().map(|sphere| sphere.0).collect::<Vec<_>>());
                    let centers = shown.vectors::<3>("Ellipsoids3D:centers");
                    let half_sizes = shown.vectors::<3>("Ellipsoids3D:half_sizes");
                    assert_eq!((centers.len(), half_sizes.len()), (expected.len(), expected.len()));
                    for ((_, center, radius), (found, half_size)) in
                        expected.iter().zip(centers.into_iter().zip(half_sizes))
                    {
                        // The mirrored center is rounded twice, with coordinates within 2.
                        assert!(
                            center.distance(Vec3::from_array(found)) < 8.0 * f32::EPSILON,
                            "{found:?} is not {center}"
                        );
                        assert_eq!(half_size, [*radius; 3]);
                    }
                    count += expected.len();
                }
            }
            let has_spheres = method < ContactMethod::Closest;
            assert_eq!(count > 300, has_spheres, "{method:?} at {level:?}: {count} spheres");
            assert!(method != ContactMethod::Circumsphere || behind > 100, "{behind} behind sheets");
        }
    }
}

#[test]
fn cones_stand_on_their_sphere_and_open_as_wide_as_the_stage_says() {
    for (level, settings) in [(LevelOfDetail::All, everything()), (LevelOfDetail::NearContacts, near())] {
        let mut recorded = Recorded::new(settings);
        // The paper's cones are narrow, and ours are widened. Some of these open beyond a right angle.
        let scene = Scene::spawn(&mut recorded.app, ContactMethod::Circumsphere);
        let (mut count, mut wide, mut everywhere) = (0, 0, 0);
        for tick in 0..4 {
            recorded.app.insert_resource(CircumsphereSettings { widen_cones: tick % 2 == 0, ..Default::default() });
            scene.advance(&mut recorded.app, tick);
            recorded.tick();
            for (name, entity) in scene.surfaces() {
                let triangles = wanted(&mut recorded, level, entity);
                let all = caps(&recorded, entity, &triangles);
                let expected: Vec<Cap> = all.iter().copied().filter(|cap| cap.cosine > -1.0).collect();
                everywhere += all.len() - expected.len();
                let shown = recorded.viewer.of(&["cones", name]).unwrap_or_else(|| panic!("{name} is not shown"));
                assert_posed(&recorded, entity, shown);
                assert_eq!(shown.wholes("triangle"), expected.iter().map(|cap| cap.triangle).collect::<Vec<_>>());
                let translations = shown.vectors::<3>("InstancePoses3D:translations");
                let quaternions = shown.vectors::<4>("InstancePoses3D:quaternions");
                let scales = shown.vectors::<3>("InstancePoses3D:scales");
                let angles = shown.floats("half_angle_degrees");
                assert_eq!([translations.len(), quaternions.len(), scales.len(), angles.len()], [expected.len(); 4]);
                // Before it is posed, the mesh opens along z from the origin to a circle of radius 1 at z = 1.
                for corner in shown.vectors::<3>("Mesh3D:vertex_positions") {
                    let [x, y, z] = corner.map(f64::from);
                    assert!(corner == [0.0; 3] || z == 1.0 && (x.hypot(y) - 1.0).abs() < 1.0e-6, "{corner:?}");
                }
                for (place, cap) in expected.iter().enumerate() {
                    let top = Vec3::from_array(translations[place]);
                    assert!(top.distance(cap.center) < 8.0 * f32::EPSILON, "{top} is not {}", cap.center);
                    // Unit quaternions in f32: a few units in the last place.
                    let axis = Quat::from_array(quaternions[place]) * Vec3::Z;
                    assert!(axis.distance(cap.axis) < 2.0e-6, "{axis} is not {}", cap.axis);
                    let [x, y, z] = scales[place].map(f64::from);
                    assert_eq!(x, y);
                    // The rim lies on the sphere.
                    assert!((x.hypot(z) - f64::from(cap.radius)).abs() < 1.0e-6 * f64::from(cap.radius));
                    let half_angle = f64::from(cap.cosine).acos();
                    // The root of 1 − c² loses half of the digits where c is near 1.
                    assert!((x.atan2(z) - half_angle).abs() < 4.0e-4, "{} is not {half_angle}", x.atan2(z));
                    assert!((f64::from(angles[place]).to_radians() - half_angle).abs() < 4.0e-4);
                    wide += usize::from(z < 0.0);
                }
                count += expected.len();
            }
        }
        assert!(
            count > 500 && wide > 50,
            "{level:?}: {count} cones, {wide} beyond a right angle, {everywhere} everywhere"
        );
    }
}

#[test]
fn curvature_and_recipe_ages_are_those_of_the_stages() {
    for (level, settings) in [(LevelOfDetail::All, everything()), (LevelOfDetail::NearContacts, near())] {
        let mut recorded = Recorded::new(settings);
        recorded.app.insert_resource(CircumsphereSettings { refit_threshold: 0.004, ..Default::default() });
        let scene = Scene::spawn(&mut recorded.app, ContactMethod::Circumsphere);
        let (mut values, mut ages_seen) = (BTreeSet::new(), BTreeMap::new());
        for tick in 0..6 {
            scene.advance(&mut recorded.app, tick);
            recorded.tick();
            let mut new_recipes = 0;
            for (name, entity) in scene.surfaces() {
                let triangles = wanted(&mut recorded, level, entity);
                let world = recorded.app.world();
                let curvatures = &world.get::<TriangleCurvature>(entity).expect("the entity is a surface").curvatures;
                let ages: Vec<u32> =
                    world.get::<Circumspheres>(entity).expect("the entity is a surface").recipe_ages().collect();
                let mesh = &world.get::<Made>(entity).expect("the entity has its mesh").0;
                let positions = positions(world, entity);
                let corners = bits(triangles.iter().flat_map(|&triangle| {
                    mesh.triangles[triangle as usize].map(|vertex| positions[vertex as usize].to_array())
                }));
                for layer in ["curvature", "recipe_age"] {
                    let shown = recorded.viewer.of(&[layer, name]).unwrap_or_else(|| panic!("{name} has no {layer}"));
                    assert_posed(&recorded, entity, shown);
                    assert_eq!(shown.wholes("triangle"), triangles, "{name}");
                    assert_eq!(bits(shown.vectors::<3>("Mesh3D:vertex_positions")), corners);
                    assert_eq!(shown.wholes("Mesh3D:vertex_colors").len(), corners.len());
                    assert!(!shown.has("Mesh3D:triangle_indices"), "separate vertices per triangle need no indices");
                }
                let shown = recorded.viewer.of(&["curvature", name]).expect("the viewer shows it");
                let expected: Vec<u32> =
                    triangles.iter().map(|&triangle| curvatures[triangle as usize].to_bits()).collect();
                let found: Vec<u32> = shown.floats("curvature").into_iter().map(f32::to_bits).collect();
                assert_eq!(found, expected, "{name}");
                values.extend(found);
                let shown = recorded.viewer.of(&["recipe_age", name]).expect("the viewer shows it");
                let expected: Vec<u32> = triangles.iter().map(|&triangle| ages[triangle as usize]).collect();
                assert_eq!(shown.wholes("recipe_age"), expected, "{name}");
                for age in expected {
                    *ages_seen.entry(age).or_insert(0) += 1;
                }
                new_recipes += ages.iter().filter(|&&age| age == 0).count();
            }
            assert_eq!(new_recipes, recorded.app.world().resource::<DetectionDiagnostics>().recipes_refreshed);
        }
        assert!(values.len() > 100, "{level:?}: {} curvatures", values.len());
        assert!(ages_seen.len() >= 3, "{level:?}: {ages_seen:?}");
    }
}

#[test]
fn what_a_method_does_not_compute_is_not_recorded() {
    for method in [ContactMethod::Closest, ContactMethod::Exact, ContactMethod::Polygon] {
        let mut recorded = Recorded::new(everything());
        let scene = Scene::spawn(&mut recorded.app, ContactMethod::Circumsphere);
        recorded.tick();
        assert_eq!(recorded.viewer.below(&["curvature"]).len(), 3);
        for (_, entity) in scene.surfaces() {
            recorded.app.world_mut().entity_mut(entity).insert(method);
        }
        recorded.tick();
        for layer in ["spheres", "cones", "curvature", "recipe_age"] {
            assert!(recorded.viewer.below(&[layer]).is_empty(), "{method:?} has {layer}");
        }
    }
    // Far from everything else, no stage has computed anything in this tick.
    let mut recorded = Recorded::new(everything());
    spawn(&mut recorded.app, "alone", &sheet(2), (THIN, ContactMethod::Circumsphere));
    let layers: Vec<String> = recorded.tick().layers().into_iter().map(str::to_owned).collect();
    assert!(!layers.iter().any(|layer| layer == "cones" || layer == "spheres" || layer == "curvature"), "{layers:?}");
}

pub type Box3 = (Vec3, Vec3);

pub fn boxes(components: &Components) -> Vec<Box3> {
    let centers = components.vectors::<3>("Boxes3D:centers");
    let half_sizes = components.vectors::<3>("Boxes3D:half_sizes");
    assert_eq!(centers.len(), half_sizes.len());
    let pairs =
        centers.into_iter().zip(half_sizes).map(|(center, half)| (Vec3::from_array(center), Vec3::from_array(half)));
    pairs.map(|(center, half)| (center - half, center + half)).collect()
}

/// Whether one box contains another, up to the rounding of center and half size, with coordinates within 2.
fn holds(outer: &Box3, inner: &Box3) -> bool {
    let slack = Vec3::splat(8.0 * f32::EPSILON);
    inner.0.cmpge(outer.0 - slack).all() && inner.1.cmple(outer.1 + slack).all()
}

#[test]
fn boxes_of_a_tree_lie_in_those_of_the_level_above_and_the_root_holds_just_all_triangles() {
    for tree_levels in [0, 1, 2, u32::MAX] {
        let mut recorded = Recorded::new(RerunSettings { tree_levels, ..nothing() });
        let scene = Scene::spawn(&mut recorded.app, ContactMethod::Exact);
        let mut deepest = 0;
        for tick in 0..3 {
            scene.advance(&mut recorded.app, tick);
            recorded.tick();
            for (name, entity) in scene.surfaces() {
                let shown = recorded.viewer.below(&["tree", name]);
                let levels: Vec<Vec<Box3>> = shown.values().map(|components| boxes(components)).collect();
                let names: Vec<String> = shown.keys().map(|path| path.join("|")).collect();
                assert!(
                    names.iter().enumerate().all(|(level, name)| *name == format!("level {level:02}")),
                    "{names:?}"
                );
                for components in shown.values() {
                    assert_posed(&recorded, entity, components);
                }
                deepest = deepest.max(levels.len());
                let Some(root) = levels.first() else { continue };
                assert_eq!(root.len(), 1);
                let triangles = recorded
                    .app
                    .world()
                    .resource::<SurfaceStates>()
                    .get(entity)
                    .expect("the entity is a surface")
                    .triangle_boxes();
                let least = triangles.iter().fold(Vec3::INFINITY, |least, bounds| least.min(bounds.min));
                let most = triangles.iter().fold(Vec3::NEG_INFINITY, |most, bounds| most.max(bounds.max));
                assert!(holds(&root[0], &(least, most)) && holds(&(least, most), &root[0]), "{name}: {root:?}");
                for (level, pair) in levels.windows(2).enumerate() {
                    let inside = pair[1].iter().all(|inner| pair[0].iter().any(|outer| holds(outer, inner)));
                    assert!(inside, "{name}: a box of level {} sticks out", level + 1);
                    assert!(pair[1].len() <= bevy_circumsphere::kernel::bvh::tree::LEAF_WIDTH * pair[0].len());
                }
                if tree_levels == u32::MAX {
                    let all: Vec<&Box3> = levels.iter().flatten().collect();
                    let is_held = |bounds: &bevy_circumsphere::geometry::Aabb| {
                        all.iter().filter(|outer| holds(outer, &(bounds.min, bounds.max))).count() >= levels.len() / 2
                    };
                    assert!(triangles.iter().all(is_held));
                }
            }
        }
        match tree_levels {
            u32::MAX => assert!(deepest > 2, "{deepest} levels"),
            levels => assert_eq!(deepest, levels as usize),
        }
    }
}
