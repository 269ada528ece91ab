//! Which joint moves the place that a ray hits.

use bevy_app::prelude::*;
use bevy_asset::Assets;
use bevy_circumsphere::{RayHit, prelude::*};
use bevy_ecs::{prelude::*, system::RunSystemOnce};
use bevy_mesh::{
    Mesh, VertexAttributeValues,
    skinning::{SkinnedMesh, SkinnedMeshInverseBindposes},
};
use bevy_transform::components::Transform;
use circumsphere_support::{
    random::Random,
    scenes::{self, Diagonals, grid},
};
use glam::{Mat4, Quat, Vec3};

use crate::world::{add, app, indexed, points, spawn};

fn between(random: &mut Random, low: f32, high: f32) -> f32 {
    low + (high - low) * random.unit() as f32
}

/// What moves a vertex.
type Influences = ([u16; 4], [f32; 4]);

/// A surface with joints at the origin, in bind pose.
fn skinned(app: &mut App, mesh: &scenes::Mesh, influences: &[Influences], joints: usize) -> (Entity, Vec<Entity>) {
    let joints: Vec<Entity> = (0..joints).map(|_| app.world_mut().spawn(Transform::default()).id()).collect();
    let indices = VertexAttributeValues::Uint16x4(influences.iter().map(|(joints, _)| *joints).collect());
    let weights: Vec<[f32; 4]> = influences.iter().map(|(_, weights)| *weights).collect();
    let mesh = indexed(mesh)
        .with_inserted_attribute(Mesh::ATTRIBUTE_JOINT_INDEX, indices)
        .with_inserted_attribute(Mesh::ATTRIBUTE_JOINT_WEIGHT, weights);
    let mesh = add(app, mesh);
    let bind_poses = SkinnedMeshInverseBindposes::from(vec![Mat4::IDENTITY; joints.len()]);
    let inverse_bindposes = app.world_mut().resource_mut::<Assets<SkinnedMeshInverseBindposes>>().add(bind_poses);
    let skin = SkinnedMesh { inverse_bindposes, joints: joints.clone() };
    (app.world_mut().spawn((mesh, skin, SurfaceFromMesh::default())).id(), joints)
}

/// Every triangle with vertices of its own.
fn unwelded(mesh: &scenes::Mesh) -> scenes::Mesh {
    let corners = mesh.triangles.iter().flatten().map(|&corner| mesh.positions[corner as usize]);
    let triangles = (0..mesh.triangles.len() as u32).map(|triangle| [0, 1, 2].map(|corner| 3 * triangle + corner));
    scenes::Mesh { positions: corners.collect(), triangles: triangles.collect() }
}

/// The hits of rays that go down from these places, with their joints.
fn shoot(app: &mut App, places: Vec<Vec3>) -> Vec<Option<(RayHit, Option<Entity>)>> {
    let shoot = move |surfaces: SurfaceQuery, joints: SurfaceJoints| {
        let shoot = |&place: &Vec3| {
            let hit = surfaces.cast_ray(place, Vec3::NEG_Y, f32::INFINITY, &SurfaceQueryFilter::default())?;
            Some((hit, joints.dominant(hit.entity, hit.triangle, hit.barycentric)))
        };
        places.iter().map(shoot).collect::<Vec<_>>()
    };
    app.world_mut().run_system_once(shoot).expect("the parameters are there")
}

/// An arm along x whose weights pass from the upper to the lower joint between 1 and 3, linearly: so the lower one has
/// more weight wherever x was above 2 at rest, whatever the triangles and the pose.
#[test]
fn an_arm_is_hit_in_the_part_that_moves_it_most() {
    let arm = grid(12, 3, 4.0, 0.5, Diagonals::Alternating);
    let arm = scenes::Mesh { positions: arm.positions.iter().map(|[x, y, z]| [x + 2.0, *y, *z]).collect(), ..arm };
    for mesh in [arm.clone(), unwelded(&arm)] {
        let mut app = app();
        let lower = |x: f32| ((x - 1.0) / 2.0).clamp(0.0, 1.0);
        let influences: Vec<Influences> =
            mesh.positions.iter().map(|&[x, ..]| ([7, 1, 0, 1], [0.0, lower(x), 1.0 - lower(x), 0.0])).collect();
        let (entity, joints) = skinned(&mut app, &mesh, &influences, 8);
        let mut random = Random::new(5);
        for angle in [0.0, 0.6, -0.9] {
            // The elbow turns.
            let elbow = Vec3::new(2.0, 0.0, 0.0);
            let turn = Quat::from_rotation_z(angle);
            *app.world_mut().get_mut::<Transform>(joints[1]).expect("it has one") =
                Transform { translation: elbow - turn * elbow, rotation: turn, scale: Vec3::ONE };
            app.update();
            let places =
                (0..400).map(|_| Vec3::new(between(&mut random, 0.0, 4.0), 9.0, between(&mut random, -0.25, 0.25)));
            let mut counts = [0; 2];
            for (hit, joint) in shoot(&mut app, places.collect()).into_iter().flatten() {
                let corners = mesh.triangles[hit.triangle.expect("a surface has triangles").index()];
                let x: f32 = corners
                    .iter()
                    .zip(hit.barycentric)
                    .map(|(&corner, share)| share * mesh.positions[corner as usize][0])
                    .sum();
                if angle == 0.0 {
                    assert!((hit.point.x - x).abs() < 1.0e-5, "at rest, where it was hit is where it is");
                }
                // At 2 both have the same weight.
                if (x - 2.0).abs() > 1.0e-4 {
                    assert_eq!((hit.entity, joint), (entity, Some(joints[usize::from(x > 2.0)])), "{x}");
                    counts[usize::from(x > 2.0)] += 1;
                }
            }
            assert!(counts.iter().all(|&count| count > 50), "{counts:?}");
        }
    }
}

/// Vertices at one place are one vertex to contacts, but each has weights of its own.
#[test]
fn weights_are_those_of_the_triangle_that_is_hit_also_at_welded_vertices() {
    let mesh = unwelded(&grid(6, 6, 2.0, 2.0, Diagonals::Uniform));
    let mut random = Random::new(9);
    let influences: Vec<Influences> = (0..mesh.positions.len())
        .map(|_| {
            let joints = [0, 1, 2, 3].map(|_| random.below(6) as u16);
            let weights = [0, 1, 2, 3].map(|_| between(&mut random, 0.0, 1.0));
            let sum: f32 = weights.iter().sum();
            (joints, weights.map(|weight| weight / sum))
        })
        .collect();
    let mut app = app();
    let (entity, joints) = skinned(&mut app, &mesh, &influences, 6);
    app.update();
    let weld = app.world().get::<DeformableSurface>(entity).expect("it is a surface").topology().weld().to_vec();
    let is_welded = weld.iter().enumerate().filter(|&(vertex, &weld)| vertex != weld as usize).count();
    assert!(is_welded > 100, "{is_welded}");
    let places = (0..2000).map(|_| Vec3::new(between(&mut random, -1.0, 1.0), 1.0, between(&mut random, -1.0, 1.0)));
    let (mut hit_joints, mut differ) = ([0; 6], 0);
    let strongest = |corners: [u32; 3], barycentric: [f32; 3]| {
        let mut sums = [0.0_f64; 6];
        for (corner, share) in corners.into_iter().zip(barycentric) {
            let (joints, weights) = influences[corner as usize];
            for (joint, weight) in joints.into_iter().zip(weights) {
                sums[usize::from(joint)] += f64::from(share) * f64::from(weight);
            }
        }
        (0..6).reduce(|best, joint| if sums[joint] > sums[best] { joint } else { best }).expect("there are six")
    };
    for shot in shoot(&mut app, places.collect()) {
        let (hit, joint) = shot.expect("the sheet is below");
        let corners = mesh.triangles[hit.triangle.expect("a surface has triangles").index()];
        let expected = strongest(corners, hit.barycentric);
        assert_eq!(joint, Some(joints[expected]), "{hit:?}");
        hit_joints[expected] += 1;
        let of_welded = strongest(corners.map(|corner| weld[corner as usize]), hit.barycentric);
        differ += usize::from(of_welded != expected);
    }
    assert!(hit_joints.iter().all(|&count| count > 20), "{hit_joints:?}");
    assert!(differ > 500, "the weights of welded vertices would be others: {differ}");
}

#[test]
fn what_has_no_skin_has_no_joint() {
    let mut app = app();
    let sheet = grid(2, 2, 2.0, 2.0, Diagonals::Uniform);
    let rigid = spawn(&mut app, indexed(&sheet), ());
    let (surface, positions) = DeformableSurface::from_mesh(&points(&sheet), &sheet.triangles).expect("it is valid");
    let own = app.world_mut().spawn((surface, positions)).id();
    let no_weights = vec![([0; 4], [0.0; 4]); sheet.positions.len()];
    let (unmoved, _) = skinned(&mut app, &sheet, &no_weights, 1);
    let (moved, joints) = skinned(&mut app, &sheet, &vec![([0; 4], [1.0, 0.0, 0.0, 0.0]); sheet.positions.len()], 1);
    app.update();
    let ask = move |of: SurfaceJoints| {
        let middle = [1.0 / 3.0; 3];
        let first = TriangleId(0);
        assert_eq!(of.dominant(moved, first, middle), Some(joints[0]));
        assert_eq!(of.dominant(moved, None, middle), None);
        assert_eq!(of.dominant(moved, TriangleId(99), middle), None);
        for other in [rigid, own, unmoved, joints[0], Entity::PLACEHOLDER] {
            assert_eq!(of.dominant(other, first, middle), None);
        }
    };
    app.world_mut().run_system_once(ask).expect("the parameters are there");
}
