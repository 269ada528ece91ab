//! Skins and morph targets, compared with the formula of Bevy's vertex shader in f64.
//!
//! The shader adds `weight · displacement` of each morph target to a vertex, then multiplies it by the sum of
//! `weight · joint matrix · inverse bind pose` of its four joints. It does not normalize weights.

#![expect(clippy::cast_sign_loss, reason = "numbers from 0 to 1 have no sign")]

use bevy_app::prelude::*;
use bevy_asset::Assets;
use bevy_circumsphere::prelude::*;
use bevy_ecs::prelude::*;
use bevy_mesh::{
    Mesh, Mesh3d, VertexAttributeValues,
    morph::{MeshMorphWeights, MorphAttributes, MorphWeights},
    skinning::{SkinnedMesh, SkinnedMeshInverseBindposes},
};
use bevy_transform::{
    TransformPlugin,
    components::{GlobalTransform, Transform},
};
use glam::{DMat4, DVec3, Mat4, Quat, Vec3};

use crate::world::{
    THIN, add, app, changes, contacts_of, count_changes, failure, floor, indexed, points, positions, sheet, status,
};

/// Numbers between 0 and 1, always the same ones.
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> f32 {
        // Knuth's multiplier; the upper bits are the good ones.
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1u64 << 24) as f32
    }

    fn vector(&mut self) -> Vec3 {
        Vec3::new(self.next(), self.next(), self.next()) * 2.0 - 1.0
    }

    fn rotation(&mut self) -> Quat {
        let axis = self.vector().normalize();
        Quat::from_axis_angle(axis, 3.0 * self.next())
    }
}

const TARGETS: usize = 3;

/// What a character is made of, to compute from.
struct Figure {
    entity: Entity,
    root: Entity,
    joints: Vec<Entity>,
    rest: Vec<Vec3>,
    influences: Vec<([u16; 4], [f32; 4])>,
    displacements: Vec<Vec3>,
    bind_poses: Vec<Mat4>,
}

/// A sheet with random influences of six joints, the first four of which are a chain below a root, and three morph
/// targets.
fn figure(app: &mut App, seed: u64) -> Figure {
    let mut numbers = Numbers(seed);
    let sheet = sheet();
    let rest = points(&sheet);
    let root = app.world_mut().spawn(Transform::from_xyz(0.5, 1.0, -2.0)).id();
    let mut joints: Vec<Entity> = Vec::new();
    for number in 0..6 {
        let transform = Transform {
            translation: numbers.vector(),
            rotation: numbers.rotation(),
            // Skins may have what surfaces may not: scales that differ by axis, and mirroring.
            scale: if number == 2 { Vec3::new(-1.0, 1.5, 0.5) } else { Vec3::ONE },
        };
        let parent = if (1..4).contains(&number) { joints[number - 1] } else { root };
        joints.push(app.world_mut().spawn((transform, ChildOf(parent))).id());
    }
    let bind_poses: Vec<Mat4> =
        (0..6).map(|_| Mat4::from_rotation_translation(numbers.rotation(), numbers.vector())).collect();
    let mut influences = Vec::new();
    for vertex in 0..rest.len() {
        let joints = [0, 1, 2, 3].map(|_| ((numbers.next() * 6.0) as u16).min(5));
        let weights = [0, 1, 2, 3].map(|_| numbers.next());
        // Most sum to 1. Bevy draws the others as they are.
        let sum = if vertex % 7 == 0 { 1.5 } else { weights.iter().sum() };
        influences.push((joints, weights.map(|weight| weight / sum)));
    }
    let displacements: Vec<Vec3> = (0..TARGETS * rest.len()).map(|_| 0.3 * numbers.vector()).collect();
    let joint_indices = influences.iter().map(|(joints, _)| *joints).collect();
    let mesh = indexed(&sheet)
        .with_inserted_attribute(Mesh::ATTRIBUTE_JOINT_INDEX, VertexAttributeValues::Uint16x4(joint_indices))
        .with_inserted_attribute(
            Mesh::ATTRIBUTE_JOINT_WEIGHT,
            influences.iter().map(|(_, weights)| *weights).collect::<Vec<_>>(),
        )
        .with_morph_targets(
            displacements.iter().map(|&position| MorphAttributes::new(position, Vec3::ZERO, Vec3::ZERO)).collect(),
        );
    let mesh = add(app, mesh);
    let bind_pose_asset = SkinnedMeshInverseBindposes::from(bind_poses.clone());
    let inverse_bindposes = app.world_mut().resource_mut::<Assets<SkinnedMeshInverseBindposes>>().add(bind_pose_asset);
    let skin = SkinnedMesh { inverse_bindposes, joints: joints.clone() };
    // Where the entity itself is has no effect on a skin.
    let away = Transform::from_xyz(100.0, 0.0, 0.0);
    let entity = app.world_mut().spawn((mesh, skin, SurfaceFromMesh::default(), away, THIN)).id();
    Figure { entity, root, joints, rest, influences, displacements, bind_poses }
}

/// The transform of an entity in the world.
fn global(world: &World, entity: Entity) -> DMat4 {
    let own = world.get::<Transform>(entity).expect("it has a transform");
    let own = DMat4::from_scale_rotation_translation(
        own.scale.as_dvec3(),
        own.rotation.as_dquat().normalize(),
        own.translation.as_dvec3(),
    );
    world.get::<ChildOf>(entity).map_or(own, |parent| global(world, parent.parent()) * own)
}

impl Figure {
    fn morphed(&self, weights: &[f32]) -> Vec<DVec3> {
        let count = self.rest.len();
        (0..count)
            .map(|vertex| {
                let displaced = weights.iter().enumerate().map(|(target, &weight)| {
                    f64::from(weight) * self.displacements[target * count + vertex].as_dvec3()
                });
                self.rest[vertex].as_dvec3() + displaced.sum::<DVec3>()
            })
            .collect()
    }

    fn skinned(&self, world: &World, positions: &[DVec3]) -> Vec<DVec3> {
        let matrices: Vec<DMat4> = self
            .joints
            .iter()
            .zip(&self.bind_poses)
            .map(|(&joint, bind_pose)| global(world, joint) * bind_pose.as_dmat4())
            .collect();
        let positions = positions.iter().zip(&self.influences).map(|(&position, (joints, weights))| {
            let terms = joints.iter().zip(weights);
            terms.map(|(&joint, &weight)| f64::from(weight) * matrices[joint as usize].transform_point3(position)).sum()
        });
        positions.collect()
    }

    /// Moves everything.
    fn animate(&self, app: &mut App, numbers: &mut Numbers) {
        for &entity in self.joints.iter().chain([&self.root]) {
            let mut transform = app.world_mut().get_mut::<Transform>(entity).expect("it has a transform");
            transform.rotation = numbers.rotation();
            transform.translation += 0.1 * numbers.vector();
        }
    }
}

/// The rounding error of skinning in f32: each coordinate is a sum of four weighted matrices with entries of up to 2,
/// times a position of up to 2, plus translations of up to 4, each rounded; and once more for the joint matrices.
const ROUNDING: f64 = 32.0 * f32::EPSILON as f64 * 4.0;

#[track_caller]
fn farthest(found: &[Vec3], expected: &[DVec3]) -> f64 {
    assert_eq!(found.len(), expected.len());
    found.iter().zip(expected).map(|(found, expected)| found.as_dvec3().distance(*expected)).fold(0.0, f64::max)
}

#[test]
fn skins_are_where_the_formula_puts_them() {
    let mut app = app();
    let figure = figure(&mut app, 7);
    let mut numbers = Numbers(1);
    for tick in 0..20 {
        figure.animate(&mut app, &mut numbers);
        app.update();
        let found = positions(&app, figure.entity);
        let rest: Vec<DVec3> = figure.rest.iter().map(|point| point.as_dvec3()).collect();
        let error = farthest(&found, &figure.skinned(app.world(), &rest));
        assert!(error <= ROUNDING, "tick {tick}: {error}");
        assert!(farthest(&found, &rest) > 0.5, "the skin moves");
    }
    assert_eq!(app.world().get::<SurfaceFrame>(figure.entity), Some(&SurfaceFrame::World));
    // A weight that is wrong by a thousandth would be noticed.
    let mut wrong = figure;
    wrong.influences[3].1[0] += 1.0e-3;
    let rest: Vec<DVec3> = wrong.rest.iter().map(|point| point.as_dvec3()).collect();
    assert!(farthest(&positions(&app, wrong.entity), &wrong.skinned(app.world(), &rest)) > 4.0 * ROUNDING);
}

/// As `bevy_pbr` fills the buffers of the shader, and as the shader computes: in f32, from `GlobalTransform`s.
#[test]
fn skins_are_where_bevy_draws_them() {
    let mut app = app();
    app.add_plugins(TransformPlugin);
    let figure = figure(&mut app, 11);
    figure.animate(&mut app, &mut Numbers(5));
    // Bevy propagates in PostUpdate, so in the second update what was set before the first is there.
    app.update();
    app.update();
    let matrices: Vec<Mat4> = figure
        .joints
        .iter()
        .zip(&figure.bind_poses)
        .map(|(&joint, &pose)| app.world().get::<GlobalTransform>(joint).expect("propagated").affine() * pose)
        .collect();
    let drawn = figure.rest.iter().zip(&figure.influences).map(|(position, (joints, weights))| {
        let [a, b, c, d] = [0, 1, 2, 3].map(|place| matrices[joints[place] as usize] * weights[place]);
        ((a + b + c + d) * position.extend(1.0)).truncate().as_dvec3()
    });
    let error = farthest(&positions(&app, figure.entity), &drawn.collect::<Vec<_>>());
    assert!(error <= 2.0 * ROUNDING, "{error}");
}

#[test]
fn morph_targets_come_before_the_skin() {
    let mut app = app();
    let figure = figure(&mut app, 23);
    let weights = [0.5, 0.0, 1.25];
    app.world_mut().entity_mut(figure.entity).insert(MeshMorphWeights::Value { weights: weights.to_vec() });
    figure.animate(&mut app, &mut Numbers(3));
    app.update();
    let found = positions(&app, figure.entity);
    let error = farthest(&found, &figure.skinned(app.world(), &figure.morphed(&weights)));
    assert!(error <= ROUNDING, "{error}");
    // In the other order, or without the targets, it would be elsewhere.
    let rest: Vec<DVec3> = figure.rest.iter().map(|point| point.as_dvec3()).collect();
    let skinned_only = figure.skinned(app.world(), &rest);
    let other_order: Vec<DVec3> = skinned_only
        .iter()
        .zip(figure.morphed(&weights))
        .zip(&rest)
        .map(|((skinned, morphed), rest)| *skinned + (morphed - rest))
        .collect();
    assert!(farthest(&found, &skinned_only) > 0.1 && farthest(&found, &other_order) > 0.1);
}

#[test]
fn weights_come_from_the_entity_or_from_the_one_it_refers_to() {
    let mut app = app();
    let figure = figure(&mut app, 31);
    app.world_mut().entity_mut(figure.entity).remove::<SkinnedMesh>();
    let at = |app: &App, weights: &[f32]| {
        let error = farthest(&positions(app, figure.entity), &figure.morphed(weights));
        assert!(error <= ROUNDING, "{weights:?}: {error}");
        assert_eq!(status(app, figure.entity), SurfaceStatus::Active);
    };
    app.update();
    at(&app, &[0.0; 3]);
    app.world_mut().entity_mut(figure.entity).insert(MeshMorphWeights::Value { weights: vec![0.0, -2.0] });
    app.update();
    at(&app, &[0.0, -2.0, 0.0]);
    let weights = MorphWeights::new(vec![0.25, 0.5, 0.75, 9.0], None).expect("few enough");
    let controller = app.world_mut().spawn(weights).id();
    app.world_mut().entity_mut(figure.entity).insert(MeshMorphWeights::Reference(controller));
    app.update();
    at(&app, &[0.25, 0.5, 0.75]);
    app.world_mut().get_mut::<MorphWeights>(controller).expect("spawned").weights_mut()[1] = 0.0;
    app.update();
    at(&app, &[0.25, 0.0, 0.75]);
    app.world_mut().entity_mut(controller).despawn();
    app.update();
    at(&app, &[0.0; 3]);
    assert_eq!(app.world().get::<SurfaceFrame>(figure.entity), Some(&SurfaceFrame::Local));
}

#[test]
fn nothing_is_written_while_nothing_moves() {
    let mut app = app();
    let figure = figure(&mut app, 41);
    app.world_mut().entity_mut(figure.entity).insert(MeshMorphWeights::Value { weights: vec![0.5] });
    count_changes(&mut app);
    app.update();
    app.update();
    changes(&mut app);
    app.update();
    assert_eq!(changes(&mut app), (0, 0));
    // Values that are the same change nothing, whatever change detection says.
    for &joint in &figure.joints {
        app.world_mut().get_mut::<Transform>(joint).expect("it has one").set_changed();
    }
    app.world_mut().get_mut::<MeshMorphWeights>(figure.entity).expect("it has some").set_changed();
    app.update();
    assert_eq!(changes(&mut app), (0, 0));
    // Where the entity is does not matter.
    app.world_mut().get_mut::<Transform>(figure.entity).expect("it has one").translation.x += 1.0;
    app.update();
    assert_eq!(changes(&mut app), (0, 0));
    // Each of these is seen, once.
    app.world_mut().get_mut::<Transform>(figure.root).expect("it has one").translation.x += 1.0;
    app.update();
    assert_eq!(changes(&mut app), (0, 1));
    app.world_mut().entity_mut(figure.entity).insert(MeshMorphWeights::Value { weights: vec![0.5, 0.5] });
    app.update();
    assert_eq!(changes(&mut app), (0, 1));
    let bind_poses = app.world().get::<SkinnedMesh>(figure.entity).expect("it has one").inverse_bindposes.clone();
    let moved: Vec<Mat4> = figure.bind_poses.iter().map(|pose| Mat4::from_translation(Vec3::Y) * *pose).collect();
    app.world_mut()
        .resource_mut::<Assets<SkinnedMeshInverseBindposes>>()
        .insert(&bind_poses, moved.into())
        .expect("it is there");
    app.update();
    assert_eq!(changes(&mut app), (0, 1));
    app.update();
    assert_eq!(changes(&mut app), (0, 0));
}

#[derive(Resource)]
struct Height(f32);

#[test]
fn what_an_animation_sets_before_prepare_is_seen_in_the_same_tick() {
    let mut app = app();
    floor(&mut app);
    let figure = figure(&mut app, 53);
    let root = figure.root;
    app.insert_resource(Height(50.0)).add_systems(
        PostUpdate,
        (move |height: Res<Height>, mut transforms: Query<&mut Transform>| {
            transforms.get_mut(root).expect("the root").translation.y = height.0;
        })
        .before(DeformableSystems::Prepare),
    );
    app.update();
    assert!(contacts_of(&mut app, figure.entity).is_empty());
    app.world_mut().resource_mut::<Height>().0 = 0.0;
    app.update();
    assert!(!contacts_of(&mut app, figure.entity).is_empty(), "the figure is partly below the floor");
    app.world_mut().resource_mut::<Height>().0 = 50.0;
    app.update();
    assert!(contacts_of(&mut app, figure.entity).is_empty());
}

#[test]
fn the_thickness_is_that_of_the_posed_mesh() {
    let mut app = app();
    let mut figure = figure(&mut app, 61);
    // A vertex whose weights do not sum to 1 follows only a part of a translation, so that lengths would depend on it.
    app.world_mut().get_mut::<Transform>(figure.root).expect("it has one").translation = Vec3::ZERO;
    app.update();
    let before = app.world().get::<DeformableSurface>(figure.entity).expect("it is one").mean_edge();
    // A rig in centimeters: its meshes are a hundred times larger than what is drawn.
    app.world_mut().get_mut::<Transform>(figure.root).expect("it has one").scale = Vec3::splat(0.01);
    let mesh = app.world().get::<Mesh3d>(figure.entity).expect("it has one").clone();
    let skin = app.world().get::<SkinnedMesh>(figure.entity).expect("it has one").clone();
    figure.entity = app.world_mut().spawn((mesh, skin, SurfaceFromMesh::default())).id();
    app.update();
    let after = app.world().get::<DeformableSurface>(figure.entity).expect("it is one").mean_edge();
    assert!((after / before - 0.01).abs() < 1.0e-5, "{before} {after}");
}

#[test]
fn compressed_weights_are_those_that_bevy_draws() {
    let mut app = app();
    let figure = figure(&mut app, 71);
    let mesh = app.world().get::<Mesh3d>(figure.entity).expect("it has one").clone();
    let quantized: Vec<[u16; 4]> = figure
        .influences
        .iter()
        .map(|(_, weights)| weights.map(|weight| (weight.clamp(0.0, 1.0) * 65535.0).round() as u16))
        .collect();
    let joints = VertexAttributeValues::Uint16x4(figure.influences.iter().map(|(joints, _)| *joints).collect());
    let attribute =
        bevy_mesh::MeshVertexAttribute { format: bevy_mesh::VertexFormat::Unorm16x4, ..Mesh::ATTRIBUTE_JOINT_WEIGHT };
    let compressed = indexed(&sheet())
        .with_inserted_attribute(Mesh::ATTRIBUTE_JOINT_INDEX, joints)
        .with_inserted_attribute(attribute, VertexAttributeValues::Unorm16x4(quantized.clone()));
    app.world_mut().resource_mut::<Assets<Mesh>>().insert(&mesh.0, compressed).expect("it is there");
    app.update();
    let mut figure = figure;
    for (influences, quantized) in figure.influences.iter_mut().zip(quantized) {
        influences.1 = quantized.map(|weight| (f64::from(weight) / 65535.0) as f32);
    }
    let rest: Vec<DVec3> = figure.rest.iter().map(|point| point.as_dvec3()).collect();
    let error = farthest(&positions(&app, figure.entity), &figure.skinned(app.world(), &rest));
    assert!(error <= ROUNDING, "{error}");
}

#[test]
fn skins_that_cannot_be_posed_are_quarantined_until_they_can() {
    let mut app = app();
    let figure = figure(&mut app, 83);
    let entity = figure.entity;
    app.update();
    assert_eq!(status(&app, entity), SurfaceStatus::Active);
    let whole = app.world().get::<SkinnedMesh>(entity).expect("it has one").clone();

    // A joint is missing.
    let lost = app.world_mut().spawn_empty().id();
    app.world_mut().despawn(lost);
    app.world_mut().get_mut::<SkinnedMesh>(entity).expect("it has one").joints[2] = lost;
    app.update();
    assert_eq!(failure(&app, entity), SurfaceMeshError::MissingJoint(lost));
    assert!(app.world().get::<DeformableSurface>(entity).is_none());
    app.world_mut().entity_mut(entity).insert(whole.clone());
    app.update();
    assert_eq!(status(&app, entity), SurfaceStatus::Active);

    // There are fewer joints than a vertex names.
    app.world_mut().get_mut::<SkinnedMesh>(entity).expect("it has one").joints.truncate(5);
    app.update();
    let SurfaceMeshError::JointOutOfRange { vertex, joint: 5, joints: 5 } = failure(&app, entity) else {
        panic!("{:?}", failure(&app, entity));
    };
    assert!(figure.influences[vertex].0.contains(&5));
    app.world_mut().entity_mut(entity).insert(whole.clone());

    // The bind poses are not loaded yet.
    let reserved = app.world().resource::<Assets<SkinnedMeshInverseBindposes>>().reserve_handle();
    app.world_mut().get_mut::<SkinnedMesh>(entity).expect("it has one").inverse_bindposes = reserved.clone();
    app.update();
    assert_eq!(status(&app, entity), SurfaceStatus::Waiting);
    let bind_poses = SkinnedMeshInverseBindposes::from(figure.bind_poses.clone());
    app.world_mut()
        .resource_mut::<Assets<SkinnedMeshInverseBindposes>>()
        .insert(&reserved, bind_poses)
        .expect("reserved");
    app.update();
    assert_eq!(status(&app, entity), SurfaceStatus::Active);

    // The mesh has no influences.
    let bare = add(&mut app, indexed(&sheet()));
    app.world_mut().entity_mut(entity).insert(bare);
    app.update();
    assert_eq!(failure(&app, entity), SurfaceMeshError::NoInfluences);
    app.world_mut().entity_mut(entity).remove::<SkinnedMesh>();
    app.update();
    assert_eq!(status(&app, entity), SurfaceStatus::Active);
    assert_eq!(positions(&app, entity), figure.rest);
}

#[test]
fn morph_targets_must_fit_the_vertices() {
    let mut app = app();
    let targets = vec![MorphAttributes::default(); 26];
    let mesh = indexed(&sheet()).with_morph_targets(targets);
    let entity = crate::world::spawn(&mut app, mesh, ());
    app.update();
    assert_eq!(failure(&app, entity), SurfaceMeshError::MorphTargets { vertices: 25, displacements: 26 });
}
