//! Which meshes are fit for smooth surfaces.

use bevy_circumsphere::{
    geometry::SurfaceTopology,
    kernel::mesh::{
        curved_edges::{CurvedEdges, MOST_UNEVEN},
        smooth_normal::CreaseAngle,
    },
};
use circumsphere_support::{random::Random, scenes::cad_box};
use circumsphere_truth::{BodyShape, SmoothBody};
use glam::{DMat2, DMat3, DVec2, DVec3, Vec3};

use crate::bodies::{BodyMesh, CREASE, mesh_of};

struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }
}

/// How badly a mesh fits, and the mean distance of its patches from a body over that of its triangles.
fn measured(topology: &SurfaceTopology, positions: &[Vec3], distance: impl Fn(DVec3) -> f64) -> (f32, f64) {
    let mut edges = CurvedEdges::default();
    edges.update(topology, positions, CreaseAngle::new(CREASE));
    let (mut flat, mut smooth) = (0.0, 0.0);
    for (corners, sides) in topology.triangles().iter().zip(topology.triangle_edges()) {
        let corners = corners.map(|vertex| positions[vertex as usize]);
        let offsets = sides.map(|edge| edges.offsets()[edge as usize]);
        let area = f64::from((corners[1] - corners[0]).cross(corners[2] - corners[0]).length());
        for weights in [[1.0, 1.0, 1.0], [4.0, 1.0, 1.0], [1.0, 4.0, 1.0], [1.0, 1.0, 4.0], [1.0, 1.0, 0.0]] {
            let sum: f32 = weights.iter().sum();
            let [a, b, c] = weights.map(|weight| weight / sum);
            let point: Vec3 = corners[0] * a + corners[1] * b + corners[2] * c;
            let bent = point + offsets[0] * (a * b) + offsets[1] * (b * c) + offsets[2] * (c * a);
            flat += area * distance(point.as_dvec3()).abs();
            smooth += area * distance(bent.as_dvec3()).abs();
        }
    }
    (edges.unevenness(topology, positions), smooth / flat)
}

/// Vertices on a body, and moved off it by up to a share of the mean edge.
fn noisy(shape: BodyShape, level: u32, noise: f64) -> (f32, f64) {
    let body = SmoothBody { shape, rotation: DMat3::IDENTITY, center: DVec3::ZERO };
    let mut mesh = BodyMesh::new(body, &mesh_of(shape, level));
    let edge = mesh.edge();
    let mut random = Noise(7);
    for position in &mut mesh.positions {
        let normal = body.foot(position.as_dvec3()).normal;
        *position += (normal * (random.next() * noise * edge)).as_vec3();
    }
    measured(&mesh.topology, &mesh.positions, |point| body.foot(point).distance)
}

/// A box of half size 1 with rounded edges, as CAD programs mesh it.
fn rounded_box(radius: f64, strips: usize) -> (f32, f64) {
    let core_of = |point: DVec3| point.clamp(DVec3::splat(radius - 1.0), DVec3::splat(1.0 - radius));
    let distance = move |point: DVec3| {
        let inner = core_of(point);
        if inner == point { point.abs().max_element() - 1.0 } else { (point - inner).length() - radius }
    };
    let mesh = cad_box(radius, strips);
    let positions: Vec<Vec3> = mesh.positions.iter().copied().map(Vec3::from_array).collect();
    let topology = SurfaceTopology::new(&positions, &mesh.triangles).expect("a rounded box is a mesh");
    measured(&topology, &positions, distance)
}

#[test]
fn vertices_off_the_body_never_make_smooth_much_worse() {
    let shapes = [
        BodyShape::Ball(1.0),
        BodyShape::Ellipsoid(DVec3::new(1.2, 0.5, 0.4)),
        BodyShape::Torus(0.8, 0.3),
        BodyShape::Capsule(0.3, 0.6),
    ];
    let mut worse = 0;
    for shape in shapes {
        for level in 0..=4 {
            let mut before = 0.0;
            for noise in [0.0, 0.01, 0.02, 0.05, 0.1, 0.2] {
                let (unevenness, ratio) = noisy(shape, level, noise);
                println!("{shape:?} level {level} noise {noise}: unevenness {unevenness:.3}, error {ratio:.3} of flat");
                assert!(unevenness >= before, "more noise is more uneven");
                before = unevenness;
                // Below the threshold, smooth is better than flat, or as good.
                assert!(ratio < 1.2 && (unevenness > MOST_UNEVEN || ratio < 1.02), "{unevenness} {ratio}");
                worse += usize::from(ratio > 1.0);
            }
        }
    }
    assert!(worse > 10, "the comparison covers meshes that are not fit");
}

#[test]
fn large_faces_with_narrow_rounded_edges_do_not_fit() {
    for radius in [0.02, 0.05, 0.1, 0.3, 0.6] {
        for strips in [1, 2, 3, 6] {
            let (unevenness, ratio) = rounded_box(radius, strips);
            println!("radius {radius}, {strips} strips: unevenness {unevenness:.3}, error {ratio:.3} of flat");
            // At a radius of 0.6 the box is nearly a ball. Its flat faces bulge, but less than they would be noticed.
            assert!(unevenness > MOST_UNEVEN || radius > 0.5, "{radius} {strips}: {unevenness} {ratio}");
        }
    }
}

/// A sheet that is known in closed form: a sum of waves, with the wavelength of the shortest in edges of the mesh, and
/// the slope of each.
struct CrumpledSheet {
    waves: Vec<(DVec2, f64, f64)>,
}

impl CrumpledSheet {
    fn new(shortest: f64, slope: f64) -> Self {
        let mut random = Random::new(11);
        let waves = (0..6)
            .map(|number| {
                let length = shortest * (1.0 + 0.3 * f64::from(number));
                let direction = DVec2::from_angle(std::f64::consts::PI * random.unit());
                let turns = std::f64::consts::TAU / length;
                (direction * turns, slope / turns, std::f64::consts::TAU * random.unit())
            })
            .collect();
        Self { waves }
    }

    /// The height, with its first and second derivatives.
    fn height(&self, place: DVec2) -> (f64, DVec2, DMat2) {
        let (mut height, mut slope, mut bend) = (0.0, DVec2::ZERO, DMat2::ZERO);
        for &(turns, amplitude, phase) in &self.waves {
            let (sine, cosine) = (turns.dot(place) + phase).sin_cos();
            height += amplitude * sine;
            slope += turns * (amplitude * cosine);
            bend += DMat2::from_cols(turns * turns.x, turns * turns.y) * (-amplitude * sine);
        }
        (height, slope, bend)
    }

    /// The distance of a point that is near the sheet, by Newton steps to its foot.
    fn distance(&self, point: DVec3) -> f64 {
        let mut foot = point.truncate();
        for _ in 0..30 {
            let (height, slope, bend) = self.height(foot);
            let above = height - point.z;
            let off = foot - point.truncate() + slope * above;
            let matrix = DMat2::IDENTITY + DMat2::from_cols(slope * slope.x, slope * slope.y) + bend * above;
            let step = if matrix.determinant() > 0.1 { matrix.inverse() * off } else { off * 0.3 };
            foot -= step.clamp_length_max(0.5);
        }
        point.distance(foot.extend(self.height(foot).0))
    }
}

#[test]
fn crumpled_sheets_are_no_worse_or_are_said_not_to_fit() {
    const CELLS: u32 = 40;
    let mut worse = 0;
    for shortest in [1.3, 1.6, 2.2, 3.0, 4.0, 6.0, 10.0] {
        for slope in [0.1, 0.3, 0.6, 1.0] {
            let sheet = CrumpledSheet::new(shortest, slope);
            let at = |x: u32, y: u32| {
                let place = DVec2::new(f64::from(x), f64::from(y));
                place.extend(sheet.height(place).0).as_vec3()
            };
            let positions: Vec<Vec3> =
                (0..=CELLS).flat_map(|y| (0..=CELLS).map(move |x| (x, y))).map(|(x, y)| at(x, y)).collect();
            let corner = |x: u32, y: u32| y * (CELLS + 1) + x;
            let triangles: Vec<[u32; 3]> = (0..CELLS * CELLS)
                .flat_map(|cell| {
                    let (x, y) = (cell % CELLS, cell / CELLS);
                    let [a, b, c, d] = [corner(x, y), corner(x + 1, y), corner(x + 1, y + 1), corner(x, y + 1)];
                    if (x + y) % 2 == 0 { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] }
                })
                .collect();
            let topology = SurfaceTopology::new(&positions, &triangles).expect("a sheet is a mesh");
            let (unevenness, ratio) = measured(&topology, &positions, |point| sheet.distance(point));
            println!("waves of {shortest} edges, slope {slope}: unevenness {unevenness:.3}, error {ratio:.3} of flat");
            assert!(ratio < 1.2 || unevenness > MOST_UNEVEN, "{shortest} {slope}: {unevenness} {ratio}");
            worse += usize::from(ratio > 0.8);
        }
    }
    assert!(worse > 2, "the comparison covers sheets that are not fit");
}
