//! Queries of smooth surfaces, against parry on patches that are cut into small triangles. Their offsets come straight from
//! the definition.

use std::collections::HashMap;

use bevy_app::prelude::*;
use bevy_circumsphere::{ClosestPoint, RayHit, ShapeHit, prelude::*};
use bevy_ecs::{prelude::*, system::RunSystemOnce};
use bevy_transform::components::Transform;
use circumsphere_support::{
    random::Random,
    scenes::{Diagonals, Mesh, grid, icosphere, lobed_ball},
};
use circumsphere_truth::ReferencePatch;
use glam::{DQuat, DVec3, Quat, Vec3};
use parry3d_f64::{
    math::Pose3,
    query::{PointQuery, Ray, RayCast, distance},
    shape::{Cuboid, Segment, TriMesh, Triangle},
};

use crate::surfaces::Surface;

const ALL: SurfaceQueryFilter<'_> = SurfaceQueryFilter {
    layers: SurfaceLayers { memberships: u32::MAX, filters: u32::MAX },
    excluded: &[],
    predicate: None,
    culls_back_faces: false,
};

/// Into how many parts each edge of a patch is cut.
const PARTS: usize = 16;

/// Rays whose cosine to the surface is less are not compared where they hit.
const OBLIQUE: f64 = 0.2;

/// A smooth surface in an app, and the truth in the world.
struct Scene {
    app: App,
    entity: Entity,
    /// The small triangles of all patches, those of a patch together.
    truth: TriMesh,
    center: DVec3,
    /// Half the size.
    size: f64,
    /// How far the truth may be from its patches, and rounding.
    tolerance: f64,
}

fn random_vector(random: &mut Random) -> DVec3 {
    DVec3::from_array(std::array::from_fn(|_| f64::from(random.signed_unit())))
}

impl Scene {
    fn new(mesh: &Mesh, transform: Transform, shape: SurfaceShape) -> Self {
        let surface = Surface::of(mesh);
        let mut app = App::new();
        app.add_plugins(DeformableCollisionPlugins::new(Update));
        let component = DeformableSurface::from_mesh(&surface.rest, &surface.triangles).expect("the mesh is valid");
        let topology = component.0.topology().clone();
        let entity = app.world_mut().spawn((component, transform, shape)).id();
        app.update();

        let crease = CircumsphereSettings::default().crease_angle;
        let own: Vec<DVec3> = surface.positions.iter().map(|point| point.as_dvec3()).collect();
        let offsets: HashMap<[u32; 2], DVec3> = surface.truth(&own, crease).into_iter().collect();
        let rotation = transform.rotation.as_dquat().normalize();
        let scale = transform.scale.as_dvec3();
        let to_world = |point: DVec3| rotation * (point * scale) + transform.translation.as_dvec3();
        let (mut points, mut triangles, mut height) = (Vec::new(), Vec::new(), 0.0_f64);
        for (number, corners) in topology.triangles().iter().enumerate() {
            let bends = std::array::from_fn(|k| {
                let ends = [corners[k], corners[(k + 1) % 3]];
                let bend = offsets.get(&ends).or_else(|| offsets.get(&[ends[1], ends[0]])).copied();
                if shape == SurfaceShape::Flat { DVec3::ZERO } else { bend.unwrap_or(DVec3::ZERO) }
            });
            height = bends.iter().fold(height, |height, bend: &DVec3| height.max(bend.length()));
            let patch = ReferencePatch::bent(surface.corners(number), bends);
            let first = points.len() as u32;
            let mut rows = Vec::new();
            for row in 0..=PARTS {
                rows.push(points.len() as u32);
                for place in 0..=PARTS - row {
                    let (second, third) = (place as f64 / PARTS as f64, row as f64 / PARTS as f64);
                    points.push(to_world(patch.point([1.0 - second - third, second, third])));
                }
            }
            assert_eq!(rows[0], first);
            for row in 0..PARTS {
                let (low, high) = (rows[row], rows[row + 1]);
                for place in 0..(PARTS - row) as u32 {
                    triangles.push([low + place, low + place + 1, high + place]);
                    if place + 1 < (PARTS - row) as u32 {
                        triangles.push([low + place + 1, high + place + 1, high + place]);
                    }
                }
            }
        }
        let truth = TriMesh::new(points, triangles).expect("patches have triangles");
        let scale = scale.x.abs();
        let size = own.iter().map(|point| point.length()).fold(0.0, f64::max) * scale;
        // A quadratic curve over a part is as far from its chord as over the whole edge, times the square of the share.
        let tolerance = height * scale / (PARTS * PARTS) as f64 + 1.0e-5 * size;
        Self { app, entity, truth, center: transform.translation.as_dvec3(), size, tolerance }
    }

    fn query<T: Send + 'static>(&mut self, read: impl Fn(&SurfaceQuery) -> T + Send + Sync + 'static) -> T {
        self.app.world_mut().run_system_once(move |query: SurfaceQuery| read(&query)).expect("surfaces can be queried")
    }

    /// The distance of the true surface from a point.
    fn distance(&self, point: DVec3) -> f64 {
        self.truth.project_local_point(point, false).point.distance(point)
    }

    /// A ray through the surface: its start, its direction of unit length, and its length.
    fn random_ray(&self, random: &mut Random) -> (Vec3, Vec3, f32) {
        let start = (self.center + random_vector(random).normalize() * 2.5 * self.size).as_vec3();
        let towards = self.center + random_vector(random) * self.size;
        let direction = (towards.as_vec3() - start).normalize();
        (start, direction, (6.0 * self.size) as f32)
    }
}

fn scenes() -> Vec<Scene> {
    let mut random = Random::new(5);
    let sheet = {
        let mut mesh = grid(12, 12, 2.0, 2.0, Diagonals::Alternating);
        for [x, y, z] in &mut mesh.positions {
            *y = (f64::from(*x) * 2.5).sin() as f32 * 0.2 + (f64::from(*z) * 3.0).cos() as f32 * 0.15;
        }
        mesh
    };
    let meshes = [icosphere(1, 1.0), lobed_ball(2, 1.0), sheet];
    let mut scenes = Vec::new();
    for mesh in &meshes {
        for place in 0..2 {
            let turn = DQuat::from_scaled_axis(random_vector(&mut random) * 3.0).as_quat().normalize();
            let transform = if place == 0 {
                Transform::IDENTITY
            } else {
                Transform { translation: Vec3::new(30.0, -4.0, 7.0), rotation: turn, scale: Vec3::new(-0.6, 0.6, 0.6) }
            };
            scenes.push(Scene::new(mesh, transform, SurfaceShape::Smooth));
        }
    }
    scenes
}

#[test]
fn rays_hit_patches_where_parry_does() {
    let mut random = Random::new(1);
    let (mut compared, mut missed, mut flat_differs) = (0, 0, 0);
    for mut scene in scenes() {
        let rays: Vec<_> = (0..2_000).map(|_| scene.random_ray(&mut random)).collect();
        let copy = rays.clone();
        let hits: Vec<(Option<RayHit>, Vec<RayHit>)> = scene.query(move |query| {
            copy.iter()
                .map(|&(o, d, range)| (query.cast_ray(o, d, range, &ALL), query.ray_hits(o, d, range, &ALL)))
                .collect()
        });
        for ((origin, direction, range), (hit, all)) in rays.into_iter().zip(hits) {
            assert_eq!(hit, all.first().copied());
            assert!(all.is_sorted_by(|one, other| one.distance <= other.distance));
            let ray = Ray::new(origin.as_dvec3(), direction.as_dvec3());
            let truth = scene.truth.cast_local_ray_and_get_normal(&ray, f64::from(range), false);
            let cosine = truth.map_or(1.0, |truth| truth.normal.dot(ray.dir).abs());
            let own_cosine = hit.map_or(1.0, |hit| f64::from(hit.normal.dot(direction).abs()));
            for hit in &all {
                assert!(scene.distance(hit.point.as_dvec3()) <= scene.tolerance, "{hit:?}");
                let along = origin.as_dvec3() + ray.dir * f64::from(hit.distance);
                assert!(along.distance(hit.point.as_dvec3()) < 1.0e-5 * scene.size + 1.0e-4, "{hit:?}");
            }
            if cosine < OBLIQUE || own_cosine < OBLIQUE {
                continue;
            }
            match (hit, truth) {
                (None, None) => missed += 1,
                (Some(hit), Some(truth)) => {
                    let off = (f64::from(hit.distance) - truth.time_of_impact).abs();
                    assert!(off <= scene.tolerance / OBLIQUE, "{hit:?} {}", truth.time_of_impact);
                    let turned = hit.normal.as_dvec3().dot(truth.normal).abs();
                    assert!(turned > 0.99, "{hit:?} {:?}", truth.normal);
                    compared += 1;
                }
                // Through the border of a sheet.
                (Some(hit), None) => assert!(near_border(&scene, hit.point.as_dvec3()), "{hit:?}"),
                (None, Some(truth)) => {
                    assert!(near_border(&scene, ray.point_at(truth.time_of_impact)), "{truth:?}");
                }
            }
            if let (Some(hit), Some(triangle)) = (hit, hit.and_then(|hit| hit.triangle)) {
                assert_eq!(hit.entity, scene.entity);
                let positions = &scene.app.world().get::<SurfacePositions>(scene.entity).expect("a surface").0;
                let surface = scene.app.world().get::<DeformableSurface>(scene.entity).expect("a surface");
                let pose = scene.app.world().get::<Transform>(scene.entity).expect("it has a pose");
                let corners = surface.topology().triangles()[triangle.index()].map(|vertex| positions[vertex as usize]);
                let flat: Vec3 = corners.iter().zip(hit.barycentric).map(|(&corner, weight)| corner * weight).sum();
                let off = pose.transform_point(flat).as_dvec3().distance(hit.point.as_dvec3());
                flat_differs += usize::from(off > 10.0 * scene.tolerance);
            }
        }
    }
    assert!(compared > 5_000 && missed > 500 && flat_differs > 3_000, "{compared} {missed} {flat_differs}");
}

/// Whether a point is near the border of an open surface.
fn near_border(scene: &Scene, point: DVec3) -> bool {
    let surface = scene.app.world().get::<DeformableSurface>(scene.entity).expect("a surface");
    let pose = scene.app.world().get::<Transform>(scene.entity).expect("it has a pose");
    let local = pose.compute_affine().inverse().transform_point3(point.as_vec3());
    let is_sheet = surface.topology().triangles().len() == 288;
    is_sheet && local.x.abs().max(local.z.abs()) > 1.0 - 10.0 * scene.tolerance as f32
}

#[test]
fn rays_through_shared_edges_and_corners_of_patches_never_slip_through() {
    let mut scene = Scene::new(&icosphere(1, 1.0), Transform::IDENTITY, SurfaceShape::Smooth);
    let points: Vec<DVec3> = scene.truth.vertices().to_vec();
    let outward = scene.query(move |query| {
        let hits = |point: &DVec3| query.ray_hits(Vec3::ZERO, point.as_vec3(), 2.0, &ALL).len();
        points.iter().map(hits).collect::<Vec<usize>>()
    });
    // In f32 few of these rays meet an edge exactly. Those along the axes of symmetry do.
    assert!(outward.iter().all(|&hits| hits >= 1), "{outward:?}");
    assert!(outward.iter().any(|&hits| hits > 1), "some ray meets an edge");
}

#[test]
fn a_smooth_ball_is_hit_nearly_where_the_ball_is() {
    let error = |shape| {
        let mut scene = Scene::new(&icosphere(2, 1.0), Transform::IDENTITY, shape);
        let mut random = Random::new(3);
        let directions: Vec<Vec3> = (0..500).map(|_| random_vector(&mut random).normalize().as_vec3()).collect();
        scene.query(move |query| {
            let off = |direction: &Vec3| {
                let hit = query.cast_ray(3.0 * *direction, -*direction, 3.0, &ALL).expect("the ball is hit");
                let closest = query.closest_point(3.0 * *direction, 3.0, &ALL).expect("the ball is near");
                (hit.point.length() - 1.0).abs().max((closest.distance - 2.0).abs())
            };
            directions.iter().map(off).fold(0.0, f32::max)
        })
    };
    let (flat, smooth) = (error(SurfaceShape::Flat), error(SurfaceShape::Smooth));
    assert!(smooth < 0.1 * flat && flat > 0.01, "{smooth} {flat}");
}

#[test]
fn closest_points_of_patches_are_parrys() {
    let mut random = Random::new(2);
    let (mut inside, mut far) = (0, 0);
    for mut scene in scenes() {
        let points: Vec<Vec3> = (0..500)
            .map(|_| (scene.center + random_vector(&mut random) * 1.6 * scene.size).as_vec3())
            .chain([scene.center.as_vec3()])
            .collect();
        let (copy, range) = (points.clone(), (0.5 * scene.size) as f32);
        let found: Vec<[Option<ClosestPoint>; 2]> = scene.query(move |query| {
            copy.iter().map(|&at| [f32::INFINITY, range].map(|range| query.closest_point(at, range, &ALL))).collect()
        });
        for (point, [found, near]) in points.into_iter().zip(found) {
            let found = found.expect("something is within an infinite distance");
            let at = point.as_dvec3();
            let truth = scene.distance(at);
            assert!((f64::from(found.distance.abs()) - truth).abs() <= scene.tolerance, "{found:?} {truth}");
            assert!(scene.distance(found.point.as_dvec3()) <= scene.tolerance, "{found:?}");
            if truth < f64::from(range) - scene.tolerance {
                assert_eq!(near, Some(found));
            } else if truth > f64::from(range) + scene.tolerance {
                assert_eq!(near, None);
                far += 1;
            }
            // The balls are star-shaped around their centers. A ray outward tells on which side the point is.
            if scene.truth.indices().len() != 288 * PARTS * PARTS && truth > scene.tolerance {
                let ray = Ray::new(at, (at - scene.center).try_normalize().unwrap_or(DVec3::X));
                let is_inside = scene.truth.cast_local_ray(&ray, f64::MAX, false).is_some();
                assert_eq!(found.distance < 0.0, is_inside, "{point} {found:?}");
                inside += usize::from(is_inside);
            }
        }
    }
    assert!(inside > 200 && far > 500, "{inside} {far}");
}

#[test]
fn moving_balls_and_boxes_stop_at_patches_and_not_before() {
    let mut random = Random::new(4);
    let (mut hit_count, mut free) = (0, 0);
    for mut scene in scenes() {
        let radius = (0.15 * scene.size) as f32;
        let half = Vec3::new(0.2, 0.1, 0.15) * scene.size as f32;
        let rotation = Quat::from_rotation_x(0.4) * Quat::from_rotation_z(0.9);
        let rays: Vec<_> = (0..150).map(|_| scene.random_ray(&mut random)).collect();
        let copy = rays.clone();
        let found: Vec<[Option<ShapeHit>; 2]> = scene.query(move |query| {
            let shape = SharedShape::cuboid(half.x, half.y, half.z);
            let cast = |&(start, direction, range): &(Vec3, Vec3, f32)| {
                let solid = query.cast_shape(&shape, start, rotation, direction, range, &ALL);
                [query.cast_ball(start, radius, direction, range, &ALL), solid.expect("a cuboid is a solid")]
            };
            copy.iter().map(cast).collect()
        });
        let cuboid = Cuboid::new(half.as_dvec3());
        for ((start, direction, range), hits) in rays.into_iter().zip(found) {
            let at = |moved: f64| start.as_dvec3() + direction.as_dvec3() * moved;
            for (number, hit) in hits.into_iter().enumerate() {
                let gap = |moved: f64| {
                    if number == 0 {
                        return scene.distance(at(moved)) - f64::from(radius);
                    }
                    let pose = Pose3::from_parts(at(moved), rotation.as_dquat());
                    distance(&pose, &cuboid, &Pose3::IDENTITY, &scene.truth).expect("parry knows both").distance
                };
                let tolerance = 2.0 * scene.tolerance;
                let end = hit.map_or(f64::from(range), |hit| f64::from(hit.distance));
                for step in 0..12 {
                    let before = gap(end * f64::from(step) / 12.0);
                    assert!(before > -tolerance, "{hit:?} {before}");
                }
                if let Some(hit) = hit {
                    assert!(gap(end).abs() <= tolerance, "{number} {hit:?} {}", gap(end));
                    assert!(scene.distance(hit.point.as_dvec3()) <= tolerance, "{number} {hit:?}");
                    assert!(hit.normal.dot(direction) < 0.0, "{hit:?}");
                    hit_count += 1;
                } else {
                    free += 1;
                }
            }
        }
    }
    assert!(hit_count > 800 && free > 150, "{hit_count} {free}");
}

#[test]
fn volumes_overlap_the_patches_that_they_reach() {
    let mut random = Random::new(6);
    let (mut overlapping, mut apart) = (0, 0);
    for mut scene in scenes() {
        let size = scene.size;
        let half = DVec3::new(0.2, 0.1, 0.15) * size;
        let centers: Vec<DVec3> = (0..40).map(|_| scene.center + random_vector(&mut random) * 1.2 * size).collect();
        let copy = centers.clone();
        let found = scene.query(move |query| {
            let shape = SharedShape::cuboid(half.x as f32, half.y as f32, half.z as f32);
            let volumes = |center: &DVec3| {
                let (center, half) = (center.as_vec3(), half.as_vec3());
                let aabb = bevy_circumsphere::geometry::Aabb { min: center - half, max: center + half };
                let solid = query.shape_intersections(&shape, center, Quat::IDENTITY, &ALL);
                [
                    query.ball_intersections(center, (0.2 * size) as f32, &ALL),
                    query.aabb_intersections(&aabb, &ALL),
                    solid.expect("a cuboid is a solid"),
                ]
            };
            copy.iter().map(volumes).collect::<Vec<_>>()
        });
        let cuboid = Cuboid::new(half);
        let all = &scene.truth;
        let patches: Vec<TriMesh> = all
            .indices()
            .chunks(PARTS * PARTS)
            .map(|parts| {
                let first = parts.iter().flatten().copied().min().expect("a patch has parts");
                let last = parts.iter().flatten().copied().max().expect("a patch has parts");
                let own = parts.iter().map(|corners| corners.map(|corner| corner - first)).collect();
                TriMesh::new(all.vertices()[first as usize..=last as usize].to_vec(), own).expect("it has triangles")
            })
            .collect();
        for (center, found) in centers.into_iter().zip(found) {
            let [in_ball, in_box, in_solid] = found;
            assert_eq!(in_box, in_solid);
            for (triangle, patch) in patches.iter().enumerate() {
                let to_center = patch.project_local_point(center, false).point.distance(center) - 0.2 * size;
                let pose = Pose3::from_translation(center);
                let to_box = distance(&pose, &cuboid, &Pose3::IDENTITY, patch).expect("parry knows both").distance;
                for (gap, found) in [(to_center, &in_ball), (to_box, &in_box)] {
                    let is_found = found.iter().any(|one| one.triangle.is_some_and(|own| own.index() == triangle));
                    // A box that is touched is at distance 0, however deep.
                    if gap < -scene.tolerance || gap == 0.0 {
                        let is_deep = gap < 0.0 || touches_deeply(patch, &cuboid, center, scene.tolerance);
                        assert!(is_found || !is_deep, "{center} {triangle} {gap} {size} {found:?}");
                        overlapping += usize::from(is_found);
                    } else if gap > scene.tolerance {
                        assert!(!is_found, "{center} {triangle} {gap}");
                        apart += 1;
                    }
                }
            }
        }
    }
    assert!(overlapping > 300 && apart > 10_000, "{overlapping} {apart}");
}

/// Whether a patch also touches a box that is smaller all around.
fn touches_deeply(patch: &TriMesh, cuboid: &Cuboid, center: DVec3, tolerance: f64) -> bool {
    let smaller = Cuboid::new(cuboid.half_extents - tolerance);
    let pose = Pose3::from_translation(center);
    distance(&pose, &smaller, &Pose3::IDENTITY, patch).expect("parry knows both").distance == 0.0
}

#[test]
fn shapes_without_volume_overlap_the_patches_that_they_pierce() {
    let mut random = Random::new(8);
    let (mut overlapping, mut apart) = (0, 0);
    for mut scene in scenes() {
        let size = scene.size;
        let corners: Vec<[DVec3; 3]> = (0..150)
            .map(|_| {
                let center = scene.center + random_vector(&mut random) * size;
                std::array::from_fn(|_| (center + random_vector(&mut random) * 0.4 * size).as_vec3().as_dvec3())
            })
            .collect();
        let copy = corners.clone();
        let found = scene.query(move |query| {
            let overlap = |corners: &[DVec3; 3]| {
                let [a, b, c] = corners.map(DVec3::as_vec3);
                [SharedShape::segment(a, b), SharedShape::triangle(a, b, c)].map(|shape| {
                    let found = query.shape_intersections(&shape, Vec3::ZERO, Quat::IDENTITY, &ALL);
                    let cast = query.cast_shape(&shape, Vec3::ZERO, Quat::IDENTITY, Vec3::X, 0.0, &ALL);
                    let cast = cast.expect("it can be cast").is_some();
                    (!found.expect("it can overlap").is_empty(), cast)
                })
            };
            copy.iter().map(overlap).collect::<Vec<_>>()
        });
        for (corners, found) in corners.into_iter().zip(found) {
            let [a, b, c] = corners;
            let at = Pose3::IDENTITY;
            let gaps = [
                distance(&at, &Segment::new(a, b), &at, &scene.truth),
                distance(&at, &Triangle::new(a, b, c), &at, &scene.truth),
            ];
            // How far each pierces the surface: its ends are on both sides, away from it.
            let is_deep = corners.iter().all(|corner| scene.distance(*corner) > 4.0 * scene.tolerance);
            for (gap, (overlaps, is_hit)) in gaps.into_iter().zip(found) {
                let gap = gap.expect("parry knows both").distance;
                if gap > scene.tolerance {
                    assert!(!overlaps, "{corners:?} {gap}");
                    apart += 1;
                } else if gap == 0.0 && is_deep {
                    assert!(overlaps && is_hit, "{corners:?} {overlaps} {is_hit}");
                    overlapping += 1;
                }
            }
        }
    }
    assert!(overlapping > 200 && apart > 500, "{overlapping} {apart}");
}
