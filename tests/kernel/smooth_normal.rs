//! Smooth normals against closed forms for planes, spheres, cylinders, and boxes, and on meshes that are not smooth at
//! all.

use bevy_circumsphere::kernel::{
    mesh::{
        feature::Feature,
        ids::{EdgeId, TriangleId, VertexId},
        side::face_normal,
        smooth_normal::{CreaseAngle, NormalCone, SurfacePlace, smooth_normal},
        topology::SurfaceTopology,
    },
    pose::Pose,
};
use circumsphere_support::scenes::{Diagonals, Mesh, cuboid, cylinder_side, grid, icosphere, saddle, triangle_soup};
use glam::{Affine3A, DVec3, Quat, Vec3};

use crate::{
    common::Random,
    truth::{ROUNDING, positions, random_rotation},
};

/// The default of the plugin's settings.
const CREASE: f32 = 1.0;

/// Rounding of a few hundred f64 operations on unit vectors.
const EXACT: f64 = 1.0e-13;

struct Surface {
    topology: SurfaceTopology,
    positions: Vec<Vec3>,
    one_sided: bool,
}

impl Surface {
    fn new(mesh: &Mesh, one_sided: bool) -> Self {
        Self::at(positions(mesh), &mesh.triangles, one_sided)
    }

    fn at(positions: Vec<Vec3>, triangles: &[[u32; 3]], one_sided: bool) -> Self {
        let topology = SurfaceTopology::new(&positions, triangles).expect("the mesh is valid");
        Self { topology, positions, one_sided }
    }

    fn triangle_count(&self) -> u32 {
        self.topology.triangles().len() as u32
    }

    fn corners(&self, triangle: u32) -> [DVec3; 3] {
        self.topology.triangles()[triangle as usize].map(|vertex| self.positions[vertex as usize].as_dvec3())
    }

    fn facet(&self, triangle: u32) -> DVec3 {
        face_normal(&self.corners(triangle))
    }

    fn cone(&self, triangle: u32, feature: Feature, barycentric: [f64; 3], crease: f32) -> NormalCone {
        let Self { topology, positions, one_sided } = self;
        let place = SurfacePlace { topology, positions, triangle, feature, one_sided: *one_sided, barycentric };
        NormalCone::of(&place, CreaseAngle::new(crease))
    }

    fn point(&self, triangle: u32, barycentric: [f64; 3]) -> DVec3 {
        self.corners(triangle).iter().zip(barycentric).map(|(corner, weight)| *corner * weight).sum()
    }

    fn is_inner(&self, triangle: u32, feature: Feature) -> bool {
        let corners = self.topology.triangles()[triangle as usize];
        let inner_vertex = |corner: usize| {
            self.topology.triangles_of_vertex(VertexId(corners[corner])).iter().all(|&around| {
                let vertices = self.topology.welded_triangles()[around as usize];
                (0..3).all(|k| {
                    let edge = self.topology.triangle_edges()[around as usize][k];
                    let meets = vertices[k] == corners[corner] || vertices[(k + 1) % 3] == corners[corner];
                    !meets || self.topology.triangles_of_edge(EdgeId(edge)).len() == 2
                })
            })
        };
        match feature {
            Feature::Vertex(corner) => inner_vertex(corner as usize),
            Feature::Edge(edge) => {
                let edge = self.topology.triangle_edges()[triangle as usize][edge as usize];
                self.topology.triangles_of_edge(EdgeId(edge)).len() == 2
            }
            Feature::Face => true,
        }
    }
}

/// A random feature and weights on it.
fn random_feature(random: &mut Random) -> (Feature, [f64; 3]) {
    let k = random.below(3);
    let mut weights = [0.0; 3];
    match random.below(3) {
        0 => {
            weights[k] = 1.0;
            (Feature::Vertex(k as u8), weights)
        }
        1 => {
            weights[k] = random.unit();
            weights[(k + 1) % 3] = 1.0 - weights[k];
            (Feature::Edge(k as u8), weights)
        }
        _ => {
            let (u, v) = (random.unit(), random.unit());
            let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
            (Feature::Face, [u, v, 1.0 - u - v])
        }
    }
}

/// The flat sheet with its inner vertices moved within the plane, so that edges run at all angles.
fn irregular_sheet(random: &mut Random, cells: usize) -> Mesh {
    let mut mesh = grid(cells, cells, 1.0, 1.0, Diagonals::Alternating);
    let cell = 1.0 / cells as f32;
    for [x, _, z] in &mut mesh.positions {
        if x.abs() < 0.499 && z.abs() < 0.499 {
            *x += random.range(-0.3, 0.3) as f32 * cell;
            *z += random.range(-0.3, 0.3) as f32 * cell;
        }
    }
    mesh
}

#[test]
fn a_plane_has_its_own_normal_whatever_the_direction_it_is_met_from() {
    let mut random = Random::new(1);
    let mut oblique = 0;
    for trial in 0..12 {
        let mesh = irregular_sheet(&mut random, 8);
        let turn = if trial == 0 { glam::DQuat::IDENTITY } else { random_rotation(&mut random) };
        let turned = positions(&mesh).iter().map(|point| (turn * point.as_dvec3()).as_vec3()).collect();
        let surface = Surface::at(turned, &mesh.triangles, false);
        let up = turn * DVec3::Y;
        // Rounding of corners at coordinates below 1 tilts a triangle by twice that error over its height, 0.02 on the
        // lowest. A weight of 1 / length² may favor the lowest triangles. Without rotation, nothing is rounded.
        let tolerance = if trial == 0 { EXACT } else { 8.0 * ROUNDING / 0.02 };
        for _ in 0..4_000 {
            let triangle = random.below(surface.triangle_count() as usize) as u32;
            let (feature, weights) = random_feature(&mut random);
            if !surface.is_inner(triangle, feature) {
                continue;
            }
            let direction = random.direction();
            let height = direction.dot(up);
            if height.abs() < 0.05 {
                continue;
            }
            let cone = surface.cone(triangle, feature, weights, CREASE);
            let expected = up * height.signum();
            assert!(cone.nearest(direction).distance(expected) <= tolerance, "{feature:?} {cone:?}");
            let smooth = smooth_normal(direction, direction * 0.1, &cone, &NormalCone::anything());
            assert!(smooth.distance(expected) <= tolerance, "{feature:?} {smooth} {expected}");
            oblique += usize::from(height.abs() < 0.8);
        }
    }
    assert!(oblique > 10_000, "most directions are far from the plane's normal: {oblique}");
}

/// The largest errors of smooth normals and of facets against the true normals.
fn errors(surface: &Surface, truth: impl Fn(DVec3) -> DVec3, inner_only: bool) -> (f64, f64) {
    let mut random = Random::new(2);
    let (mut smooth, mut facet): (f64, f64) = (0.0, 0.0);
    for _ in 0..6_000 {
        let triangle = random.below(surface.triangle_count() as usize) as u32;
        let (feature, weights) = random_feature(&mut random);
        let whole = (0..3).all(|corner| surface.is_inner(triangle, Feature::Vertex(corner)));
        if inner_only && !whole {
            continue;
        }
        let normal = truth(surface.point(triangle, weights));
        let cone = surface.cone(triangle, feature, weights, CREASE);
        smooth = smooth.max(cone.nearest(normal).distance(normal));
        facet = facet.max(surface.facet(triangle).distance(normal));
    }
    (smooth, facet)
}

#[test]
fn on_a_sphere_normals_are_radial() {
    for level in 1..5 {
        let surface = Surface::new(&icosphere(level, 1.5), true);
        let (smooth, facet) = errors(&surface, DVec3::normalize, false);
        // Rounding of corners at 1.5 tilts a triangle by that error over its height. Edges start at 0.93 and halve with
        // every level.
        let height = 0.8 * 0.93 / f64::from(1 << (level - 1));
        assert!(smooth <= 8.0 * 1.5 * ROUNDING / height, "level {level}: {smooth}");
        println!("sphere, level {level}: smooth {smooth:.1e}, facets {facet:.4} rad");
        assert!(facet > 0.2 / f64::from(1 << level), "facets are off by half a triangle: {facet}");
    }
}

#[test]
fn on_an_irregular_sphere_normals_are_radial() {
    let mut random = Random::new(3);
    let mut mesh = icosphere(3, 1.0);
    for position in &mut mesh.positions {
        let moved = Vec3::from(*position).as_dvec3() + random.vector() * 0.03;
        *position = moved.normalize().as_vec3().to_array();
    }
    let surface = Surface::new(&mesh, true);
    let (smooth, facet) = errors(&surface, DVec3::normalize, false);
    // Edges of 0.15 are moved by up to a third of their length, so heights are at least a quarter of it.
    assert!(smooth <= 16.0 * ROUNDING / 0.04, "{smooth}");
    assert!(facet > 0.08, "{facet}");
}

#[test]
fn on_a_cylinder_normals_are_radial() {
    let surface = Surface::new(&cylinder_side(1.0, 3.0, 24, 8), false);
    let radial = |point: DVec3| DVec3::new(point.x, 0.0, point.z).normalize();
    let (smooth, facet) = errors(&surface, radial, true);
    // Both sides of a vertex have the same weight, however their rectangles are divided.
    assert!(smooth <= 8.0 * ROUNDING / 0.2, "{smooth}");
    assert!(facet > 0.12, "facets are off by half of 15°: {facet}");
}

#[test]
fn on_a_saddle_normals_are_ten_times_as_true_as_facets() {
    let surface = Surface::new(&saddle(16, 1.0, 0.5), false);
    let truth = |point: DVec3| DVec3::new(-0.5 * point.x, 0.5 * point.y, 1.0).normalize();
    let (smooth, facet) = errors(&surface, truth, true);
    println!("saddle: smooth {smooth:.2e}, facets {facet:.2e}");
    // The scheme is exact on spheres and planes. Halving the edges checks its second order on the saddle.
    assert!(smooth <= 0.1 * facet, "{smooth} {facet}");
    let (finer, _) = errors(&Surface::new(&saddle(32, 1.0, 0.5), false), truth, true);
    assert!(finer <= 0.35 * smooth, "{finer} {smooth}");
}

#[test]
fn normals_are_continuous_across_inner_edges_and_vertices() {
    let mut random = Random::new(4);
    let mut mesh = saddle(12, 1.0, 1.0);
    for [x, y, z] in &mut mesh.positions {
        *x += random.range(-0.03, 0.03) as f32;
        *y += random.range(-0.03, 0.03) as f32;
        *z = 0.5 * (*x * *x - *y * *y);
    }
    let surface = Surface::new(&mesh, false);
    let single = |cone: NormalCone| {
        let (one, other) = (cone.nearest(DVec3::new(0.6, 0.0, 0.8)), cone.nearest(DVec3::new(-0.6, 0.0, 0.8)));
        assert_eq!(one, other, "one direction: {cone:?}");
        one
    };
    let (mut edges, mut facet_jump): (usize, f64) = (0, 0.0);
    for triangle in 0..surface.triangle_count() {
        for k in 0..3_u8 {
            let edge = EdgeId(surface.topology.triangle_edges()[triangle as usize][k as usize]);
            let &[first, second] = surface.topology.triangles_of_edge(edge) else { continue };
            let other = if first == triangle { second } else { first };
            if !surface.is_inner(triangle, Feature::Vertex(k))
                || !surface.is_inner(triangle, Feature::Vertex((k + 1) % 3))
            {
                continue;
            }
            let along = random.unit();
            let mut weights = [0.0; 3];
            weights[k as usize] = 1.0 - along;
            weights[(k as usize + 1) % 3] = along;
            let vertices = surface.topology.triangles()[triangle as usize];
            let other_weights = surface.topology.triangles()[other as usize].map(|vertex| {
                vertices.iter().zip(weights).filter(|(own, _)| **own == vertex).map(|(_, weight)| weight).sum::<f64>()
            });
            let on_edge = single(surface.cone(triangle, Feature::Edge(k), weights, CREASE));
            let on_this = single(surface.cone(triangle, Feature::Face, weights, CREASE));
            let on_other = single(surface.cone(other, Feature::Face, other_weights, CREASE));
            assert!(on_edge.distance(on_this) <= EXACT && on_edge.distance(on_other) <= EXACT, "{on_edge} {on_other}");
            let at_vertex = single(surface.cone(triangle, Feature::Vertex(k), corner(k), CREASE));
            let beside_vertex = single(surface.cone(triangle, Feature::Face, corner(k), CREASE));
            assert!(at_vertex.distance(beside_vertex) <= EXACT);
            edges += 1;
            // Half the crease angle. Below it, edges are inner edges of a curved surface.
            assert!(surface.facet(triangle).angle_between(surface.facet(other)) < 0.5);
            facet_jump = facet_jump.max(surface.facet(triangle).distance(surface.facet(other)));
        }
    }
    assert!(edges > 500 && facet_jump > 0.1, "{edges} edges, facets jump by up to {facet_jump}");
}

fn corner(k: u8) -> [f64; 3] {
    std::array::from_fn(|corner| if corner == k as usize { 1.0 } else { 0.0 })
}

#[test]
fn a_box_lets_directions_be_that_its_edges_and_corners_span() {
    // The closed form of the nearest direction: clamped to the positive octant, or to the part allowed at an edge or
    // face.
    let surface = Surface::new(&cuboid([1.0, 2.0, 0.5], 3), true);
    let half_extents = DVec3::new(1.0, 2.0, 0.5);
    let mut random = Random::new(5);
    let (mut kept, mut clamped) = (0, 0);
    for _ in 0..60_000 {
        let triangle = random.below(surface.triangle_count() as usize) as u32;
        let (feature, weights) = random_feature(&mut random);
        let point = surface.point(triangle, weights);
        let outward = (0..3).map(|axis| {
            let on_face = (point[axis].abs() - half_extents[axis]).abs() < 1.0e-6;
            if on_face { point[axis].signum() } else { 0.0 }
        });
        let outward = DVec3::from_array(outward.collect::<Vec<_>>().try_into().expect("three axes"));
        let direction = random.direction();
        let clamp = |axis: usize| outward[axis] * (outward[axis] * direction[axis]).max(0.0);
        let expected = DVec3::new(clamp(0), clamp(1), clamp(2));
        if expected.length() < 1.0e-3 {
            continue;
        }
        let expected = expected.normalize();
        let cone = surface.cone(triangle, feature, weights, CREASE);
        // Apart from the rounding of positions at thirds, the faces of the box are planes.
        let found = cone.nearest(direction);
        assert!(found.distance(expected) <= 1.0e-6, "{feature:?} {point} {direction}: {found} is not {expected}");
        if found.distance(direction) < 1.0e-9 { kept += 1 } else { clamped += 1 }
    }
    assert!(kept > 100 && clamped > 10_000, "{kept} kept, {clamped} clamped");
}

#[test]
fn no_direction_of_a_cone_is_nearer_than_the_nearest() {
    let mut random = Random::new(6);
    for _ in 0..5_000 {
        let axis = random.direction();
        let spanning: Vec<DVec3> = (0..=random.below(7)).map(|_| (axis + random.vector() * 0.9).normalize()).collect();
        let cone = NormalCone::between(spanning.iter().copied());
        let direction = random.direction();
        let nearest = cone.nearest(direction);
        assert!((nearest.length() - 1.0).abs() <= EXACT);
        // Inside the cone: no plane that has the whole cone on one side separates the direction from it.
        for one in &spanning {
            for other in &spanning {
                let plane = one.cross(*other);
                if spanning.iter().all(|spanning| plane.dot(*spanning) >= -1.0e-12) {
                    assert!(plane.dot(nearest) >= -1.0e-9, "{nearest} is outside of {spanning:?}");
                }
            }
        }
        for _ in 0..50 {
            let mix: DVec3 = spanning.iter().map(|spanning| *spanning * random.unit().powi(3)).sum();
            let Some(mix) = mix.try_normalize() else { continue };
            assert!(mix.dot(direction) <= nearest.dot(direction) + 1.0e-9, "{mix} is nearer to {direction}");
        }
    }
}

#[test]
fn spheres_part_along_the_line_through_their_centers() {
    let mut random = Random::new(7);
    for (level_a, radius_a, level_b, radius_b) in [(2, 1.0, 2, 1.0), (3, 1.0, 2, 0.3), (1, 0.5, 4, 2.0)] {
        let sides =
            [Surface::new(&icosphere(level_a, radius_a), true), Surface::new(&icosphere(level_b, radius_b), true)];
        let (mut worst, mut worst_facet): (f64, f64) = (0.0, 0.0);
        for _ in 0..400 {
            // Any places on the two spheres within half a triangle of the true contact. The line is the same for all of
            // them.
            let line = random.direction();
            let mut cones = Vec::new();
            let mut facets = Vec::new();
            for (surface, outward) in [(&sides[0], -line), (&sides[1], line)] {
                let (triangle, weights) = (0..surface.triangle_count())
                    .map(|triangle| (triangle, random_feature(&mut random).1))
                    .max_by(|(one, by), (other, with)| {
                        let along = |triangle: u32, weights: [f64; 3]| {
                            surface.point(triangle, weights).normalize().dot(outward)
                        };
                        along(*one, *by).total_cmp(&along(*other, *with))
                    })
                    .expect("the mesh has triangles");
                let place = surface.cone(triangle, Feature::Face, weights, CREASE);
                cones.push((place, surface.point(triangle, weights)));
                facets.push(surface.facet(triangle));
            }
            // Place the bodies so that the two points are a tenth apart, in an oblique direction.
            let exact = (facets[1] + random.vector() * 0.5).normalize();
            let distance = random.range(-0.1, 0.1);
            let centers = cones[1].1 - cones[0].1 + exact * distance;
            let expected = centers.normalize();
            let found = smooth_normal(exact, exact * distance, &cones[1].0, &cones[0].0);
            worst = worst.max(found.distance(expected));
            worst_facet = worst_facet.max(facets[1].distance(expected));
        }
        println!("spheres of {radius_a} and {radius_b}: {worst:.4}, facets {worst_facet:.4}");
        // Radii are estimated from facets, which lie below the sphere by the square of half a triangle's angle.
        assert!(worst <= 0.2 * worst_facet, "{radius_a} {radius_b}: {worst} {worst_facet}");
    }
}

#[test]
fn the_flatter_side_decides() {
    let tilted = DVec3::new(0.1, 1.0, 0.0).normalize();
    let (flat, ball) = (NormalCone::single(DVec3::Y, 0.0), NormalCone::single(-tilted, 2.0));
    assert_eq!(smooth_normal(DVec3::Y, DVec3::ZERO, &flat, &ball), DVec3::Y);
    assert_eq!(smooth_normal(-DVec3::Y, DVec3::ZERO, &ball, &flat), -DVec3::Y);
    // Two equal sides give the middle, a corner and a ball give the ball.
    let other = NormalCone::single(DVec3::Y, 2.0);
    let middle = (DVec3::Y + tilted).normalize();
    assert!(smooth_normal(DVec3::Y, DVec3::ZERO, &other, &ball).distance(middle) <= EXACT);
    let corner = NormalCone::between([DVec3::X, DVec3::Y, DVec3::Z]);
    assert!(smooth_normal(DVec3::Y, DVec3::ZERO, &corner, &ball).distance(tilted) <= EXACT);
    // Directions towards the wrong side are ignored.
    let opposite = NormalCone::single(DVec3::Y, 0.0);
    assert_eq!(smooth_normal(DVec3::Y, DVec3::ZERO, &NormalCone::anything(), &opposite), DVec3::Y);
}

#[test]
fn a_crease_angle_tells_curved_from_creased() {
    let surface = Surface::new(&cylinder_side(1.0, 3.0, 12, 4), false);
    // Edges along the tube are bent by 30°.
    let bent = 30.0_f32.to_radians();
    let width = |crease: f32| {
        let mut widest: f64 = 0.0;
        for triangle in 0..surface.triangle_count() {
            for k in 0..3 {
                let mut weights = [0.5; 3];
                weights[(k + 2) % 3] = 0.0;
                if !surface.is_inner(triangle, Feature::Edge(k as u8)) {
                    continue;
                }
                let cone = surface.cone(triangle, Feature::Edge(k as u8), weights, crease);
                let facet = surface.facet(triangle);
                let across = |side: f64| cone.nearest((facet + DVec3::Y.cross(facet) * side).normalize());
                widest = widest.max(across(1.0).distance(across(-1.0)));
            }
        }
        widest
    };
    let facets = 2.0 * f64::from(bent / 2.0).sin();
    assert!((width(0.0) - facets).abs() <= 1.0e-6, "all edges are creases: {}", width(0.0));
    assert!((width(bent * 0.99) - facets).abs() <= 1.0e-6);
    assert_eq!(width(bent * 2.01), 0.0, "no edge is a crease");
    let fading: Vec<f64> = (0..=20).map(|step| width(bent * (1.0 + 0.05 * step as f32))).collect();
    assert!(fading.windows(2).all(|pair| pair[1] <= pair[0] && pair[0] - pair[1] < 0.2 * facets), "{fading:?}");
    assert!(CreaseAngle::new(f32::NAN) == CreaseAngle::new(0.0) && CreaseAngle::new(9.0) == CreaseAngle::new(4.0));
}

#[test]
fn a_border_lets_directions_be_that_lead_past_it() {
    let surface = Surface::new(&grid(4, 4, 1.0, 1.0, Diagonals::Alternating), false);
    let mut random = Random::new(8);
    let mut seen = 0;
    for triangle in 0..surface.triangle_count() {
        for k in 0..3_u8 {
            let edge = surface.topology.triangle_edges()[triangle as usize][k as usize];
            if surface.topology.triangles_of_edge(EdgeId(edge)).len() != 1 {
                continue;
            }
            let mut weights = [0.5; 3];
            weights[(k as usize + 2) % 3] = 0.0;
            let point = surface.point(triangle, weights);
            let beyond =
                if point.x.abs() > point.z.abs() { DVec3::X * point.x.signum() } else { DVec3::Z * point.z.signum() };
            let cone = surface.cone(triangle, Feature::Edge(k), weights, CREASE);
            let along = beyond.cross(DVec3::Y);
            for _ in 0..50 {
                let direction = random.direction();
                let (out, up, sideways) = (direction.dot(beyond), direction.dot(DVec3::Y), direction.dot(along));
                let expected = (beyond * out.max(0.0) + DVec3::Y * up).normalize();
                assert!(cone.nearest(direction).distance(expected) <= 1.0e-9, "{direction} {cone:?}");
                seen += usize::from(sideways.abs() > 0.1 && out > 0.0);
            }
        }
    }
    assert!(seen > 200);
}

#[test]
fn a_pose_moves_a_cone_with_its_surface() {
    let mesh = icosphere(2, 0.5);
    let surface = Surface::new(&mesh, true);
    let mut random = Random::new(9);
    for mirror in [Vec3::ONE, Vec3::new(-1.0, 1.0, 1.0), Vec3::NEG_ONE] {
        let rotation = Quat::from_rotation_x(0.7) * Quat::from_rotation_z(-1.1);
        let affine = Affine3A::from_scale_rotation_translation(mirror * 2.0, rotation, Vec3::new(3.0, -2.0, 5.0));
        let pose = Pose::from_affine(&affine).expect("a similarity");
        let outside = |point: DVec3| affine.transform_vector3(point.as_vec3()).as_dvec3().normalize();
        for _ in 0..200 {
            let triangle = random.below(surface.triangle_count() as usize) as u32;
            let (feature, weights) = random_feature(&mut random);
            let cone = surface.cone(triangle, feature, weights, CREASE).moved(&pose);
            let expected = outside(surface.point(triangle, weights));
            // One f32 rounding of a rotated vector, and positions on a sphere of 0.5.
            assert!(cone.nearest(expected).distance(expected) <= 1.0e-5, "{mirror} {expected}");
            // Twice as large means half as curved. Against a ball of radius 1, the normal is in the middle.
            let other = DVec3::new(-expected.y, expected.x, 0.3 * expected.z).normalize();
            let tilted = (expected * 20.0 + other).normalize();
            let found = smooth_normal(expected, DVec3::ZERO, &cone, &NormalCone::single(-tilted, 1.0));
            let middle = (expected + tilted).normalize();
            // Curvature is estimated from facets, as above.
            assert!(found.distance(middle) <= 0.1 * tilted.distance(expected), "{found} {middle}");
        }
    }
}

#[test]
fn nothing_about_a_mesh_makes_a_normal_that_is_none() {
    let soup = triangle_soup(200, 1);
    let mut random = Random::new(10);
    let mut meshes: Vec<(Vec<Vec3>, Vec<[u32; 3]>)> = vec![
        (positions(&soup), soup.triangles.clone()),
        // Three triangles at an edge, two joined only at a vertex, one with reversed winding, and one without area.
        (
            vec![
                Vec3::ZERO,
                Vec3::X,
                Vec3::Y,
                Vec3::Z,
                Vec3::NEG_Y,
                Vec3::NEG_X,
                Vec3::NEG_Z,
                Vec3::new(2.0, 0.0, 0.0),
            ],
            vec![[0, 1, 2], [0, 1, 3], [1, 0, 4], [0, 5, 6], [0, 1, 7], [2, 1, 7], [2, 2, 3], [5, 5, 5]],
        ),
        // Folded flat onto itself.
        (vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Y], vec![[0, 1, 2], [1, 0, 3]]),
        (vec![Vec3::ZERO, Vec3::X, Vec3::new(0.5, 1.0e-20, 0.0), Vec3::splat(1.0e30)], vec![[0, 1, 2], [0, 1, 3]]),
    ];
    // Few vertices and many triangles, which makes tangles of every kind.
    for _ in 0..60 {
        let points: Vec<Vec3> = (0..7).map(|_| (random.vector() * 2.0).round().as_vec3()).collect();
        let triangles = (0..12).map(|_| std::array::from_fn(|_| random.below(7) as u32)).collect();
        meshes.push((points, triangles));
    }
    let mut smoothed = 0;
    for (points, triangles) in meshes {
        for broken in [false, true] {
            let mut surface = Surface::at(points.clone(), &triangles, broken);
            if broken {
                // Positions that may occur after detection: NaN, infinite, or too few.
                surface.positions[0] = Vec3::NAN;
                surface.positions[1].x = f32::INFINITY;
                surface.positions.pop();
            }
            for _ in 0..300 {
                let triangle = random.below(surface.triangle_count() as usize) as u32;
                let (feature, weights) = random_feature(&mut random);
                let (exact, apart) = (random.direction(), random.vector());
                let one = surface.cone(triangle, feature, weights, CREASE);
                let (feature, weights) = random_feature(&mut random);
                let other = surface.cone(random.below(triangles.len()) as u32, feature, weights, CREASE);
                for found in
                    [smooth_normal(exact, apart, &other, &one), one.nearest(exact), one.nearest_unsmoothed(exact)]
                {
                    assert!((found.length() - 1.0).abs() <= 1.0e-9, "{found} {one:?}");
                }
                let found = smooth_normal(exact, apart, &other, &one);
                assert!(found.dot(exact) > 0.0);
                smoothed += usize::from(found != exact);
            }
        }
    }
    assert!(smoothed > 3_000, "{smoothed}");
}

#[test]
fn vertices_that_have_come_apart_are_no_longer_smoothed_over() {
    // A tent of two triangles. Each has its own copies of the vertices at their common edge.
    let tent = |gap: f32| {
        vec![
            Vec3::ZERO,
            Vec3::Z,
            Vec3::new(1.0, -0.2, 0.5),
            Vec3::new(-gap, 0.0, 1.0),
            Vec3::new(-gap, 0.0, 0.0),
            Vec3::new(-1.0 - gap, -0.2, 0.5),
        ]
    };
    let mut surface = Surface::at(tent(0.0), &[[0, 1, 2], [3, 4, 5]], false);
    assert!(surface.topology.share_vertex(TriangleId(0), TriangleId(1)));
    let at = |surface: &Surface| surface.cone(0, Feature::Face, [0.5, 0.5, 0.0], CREASE).nearest(DVec3::Y);
    assert!(at(&surface).distance(DVec3::Y) <= 1.0e-6, "{}", at(&surface));
    surface.positions = tent(0.1);
    assert!(at(&surface).distance(surface.facet(0)) <= EXACT, "{}", at(&surface));
}
