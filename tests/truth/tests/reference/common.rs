//! Shared by the tests of the f64 reference: a seeded generator of hard triangle pairs, and simple meshes.
#![allow(dead_code, unreachable_pub, reason = "each test binary uses its own part")]

use glam::DVec3;

/// Random numbers, vectors, and weights.
pub struct Random(circumsphere_support::random::Random);

impl Random {
    pub fn new(seed: u64) -> Self {
        Self(circumsphere_support::random::Random::new(seed))
    }

    pub fn bits(&mut self) -> u64 {
        self.0.bits()
    }

    /// Uniform in 0…1.
    pub fn unit(&mut self) -> f64 {
        self.0.unit()
    }

    pub fn range(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// 0…count − 1.
    pub fn below(&mut self, count: usize) -> usize {
        self.0.below(count as u64) as usize
    }

    /// An integer in low…high.
    pub fn whole(&mut self, low: i32, high: i32) -> i32 {
        self.range(f64::from(low), f64::from(high) + 1.0).floor() as i32
    }

    pub fn vector(&mut self) -> DVec3 {
        DVec3::new(self.range(-1.0, 1.0), self.range(-1.0, 1.0), self.range(-1.0, 1.0))
    }

    pub fn direction(&mut self) -> DVec3 {
        loop {
            let vector = self.vector();
            if vector.length_squared() > 1e-4 {
                return vector.normalize();
            }
        }
    }

    /// A power of ten with a uniformly distributed exponent.
    pub fn power_of_ten(&mut self, low: f64, high: f64) -> f64 {
        10f64.powf(self.range(low, high))
    }

    /// Barycentric weights, some of them on the boundary.
    pub fn weights(&mut self) -> [f64; 3] {
        let (mut u, mut v) = (self.unit(), self.unit());
        if u + v > 1.0 {
            (u, v) = (1.0 - u, 1.0 - v);
        }
        [1.0 - u - v, u, v]
    }

    pub fn grid_point(&mut self, half_width: usize) -> DVec3 {
        let mut coordinate = || self.below(2 * half_width + 1) as f64 - half_width as f64;
        DVec3::new(coordinate(), coordinate(), coordinate())
    }
}

pub type Triangle = [DVec3; 3];

/// The categories of pairs that [`hard_pair`] generates.
pub const CATEGORIES: [&str; 16] = [
    "random",
    "needle",
    "cap",
    "zero area",
    "coplanar axis plane",
    "coplanar oblique plane",
    "nearly coplanar",
    "parallel edges",
    "shared vertex",
    "shared edge",
    "touching in a point",
    "crossing",
    "1000:1 sizes",
    "integer grid",
    "small gap",
    "far apart",
];

fn random_triangle(random: &mut Random) -> Triangle {
    [random.vector(), random.vector(), random.vector()]
}

fn at(triangle: &Triangle, weights: [f64; 3]) -> DVec3 {
    triangle[0] * weights[0] + triangle[1] * weights[1] + triangle[2] * weights[2]
}

fn sliver(random: &mut Random, apex_at: f64) -> Triangle {
    let start = random.vector();
    let along = random.direction() * random.range(0.5, 1.5);
    let across = along.cross(random.direction()).normalize_or(DVec3::X) * random.power_of_ten(-9.0, -1.0);
    [start, start + along, start + along * apex_at + across]
}

fn zero_area(random: &mut Random) -> Triangle {
    // Grid points keep the collinearity exact in f32.
    let (start, step) = (random.grid_point(2), random.grid_point(2));
    let multiple = random.below(5) as f64 - 2.0;
    let mut corners = match random.below(3) {
        0 => [start, start, start + step],
        1 => [start; 3],
        _ => [start, start + step, start + step * multiple],
    };
    let turn = random.below(3);
    corners.rotate_left(turn);
    corners.map(|corner| corner * 0.25)
}

/// A pair of triangles of one of the [`CATEGORIES`], in coordinates that f32 can represent, with any winding and order
/// of corners. Its length is between 1e-6 and 1e6, or near the extremes of f32 in one of sixteen pairs. Some pairs are
/// far from the origin.
#[expect(clippy::too_many_lines, reason = "one arm per category reads better than one function per category")]
pub fn hard_pair(random: &mut Random, category: usize) -> (Triangle, Triangle) {
    let near = |random: &mut Random, triangle: Triangle, reach: f64| {
        let shift = random.vector() * reach;
        triangle.map(|corner| corner + shift)
    };
    let (mut a, mut b) = match CATEGORIES[category] {
        "random" => {
            let b = random_triangle(random);
            (random_triangle(random), near(random, b, 1.0))
        }
        "needle" => {
            let (needle, other) = (sliver(random, 0.0), random_triangle(random));
            if random.below(2) == 0 { (needle, other) } else { (needle, sliver(random, 1.0)) }
        }
        "cap" => {
            let apex_at = random.unit();
            let (cap, other) = (sliver(random, apex_at), random_triangle(random));
            if random.below(2) == 0 { (cap, other) } else { (cap, sliver(random, 0.5)) }
        }
        "zero area" => {
            let other = if random.below(2) == 0 {
                zero_area(random)
            } else {
                let grid = [random.grid_point(2), random.grid_point(2), random.grid_point(2)];
                grid.map(|corner| corner * 0.25)
            };
            (zero_area(random), other)
        }
        "coplanar axis plane" => {
            let flat = |triangle: Triangle| triangle.map(|p| DVec3::new(p.x, p.y, 0.375));
            let b = random_triangle(random);
            let b = near(random, b, 1.0);
            (flat(random_triangle(random)), flat(b))
        }
        "coplanar oblique plane" => {
            // Coordinates on a coarse grid, whose sum is exact in f32. So z = x + y is a plane of stored points.
            let mut point = || {
                let p = random.grid_point(4) * 0.125;
                DVec3::new(p.x, p.y, p.x + p.y)
            };
            ([point(), point(), point()], [point(), point(), point()])
        }
        "nearly coplanar" => {
            let a = random_triangle(random);
            let slack = random.power_of_ten(-8.0, -2.0);
            let mut point = || {
                let (u, v) = (random.range(-1.5, 1.5), random.range(-1.5, 1.5));
                at(&a, [1.0 - u - v, u, v]) + random.vector() * slack
            };
            (a, [point(), point(), point()])
        }
        "parallel edges" => {
            let a = random_triangle(random);
            let shift = random.vector() * random.power_of_ten(-6.0, 0.0);
            let stretch = random.range(-2.0, 2.0);
            let slide = (a[1] - a[0]) * random.range(-1.5, 1.5);
            let start = a[0] + shift + slide;
            (a, [start, start + (a[1] - a[0]) * stretch, random.vector()])
        }
        "shared vertex" => {
            let a = random_triangle(random);
            (a, [random.vector(), a[1], random.vector()])
        }
        "shared edge" => {
            let a = random_triangle(random);
            (a, [a[1], a[0], random.vector()])
        }
        "touching in a point" => {
            let a = zero_free_grid_triangle(random);
            // The midpoint of an edge, or a corner, in exact arithmetic.
            let contact = if random.below(2) == 0 { (a[0] + a[1]) * 0.5 } else { a[2] };
            let spread = random.grid_point(3);
            let b = match random.below(3) {
                0 => [contact, contact + spread, contact + random.grid_point(3)],
                1 => [contact - spread, contact + spread, contact + random.grid_point(3)],
                _ => [contact + random.grid_point(3), contact, contact - spread],
            };
            (a.map(|p| p * 0.125), b.map(|p| p * 0.125))
        }
        "crossing" => {
            let a = random_triangle(random);
            let through = at(&a, random.weights());
            let direction = random.direction();
            let reach = random.power_of_ten(-3.0, 0.5);
            let b = [
                through + direction * reach,
                through - direction * reach * random.range(0.01, 1.0),
                through + random.vector() * reach,
            ];
            (a, b)
        }
        "1000:1 sizes" => {
            let large = random_triangle(random).map(|p| p * 1000.0);
            let base = at(&large, random.weights()) + random.vector() * random.power_of_ten(-2.0, 1.0);
            (large, random_triangle(random).map(|p| p + base))
        }
        "integer grid" => {
            let mut point = || random.grid_point(2);
            ([point(), point(), point()], [point(), point(), point()])
        }
        "small gap" => {
            let a = random_triangle(random);
            let normal = (a[1] - a[0]).cross(a[2] - a[0]).normalize_or(DVec3::Z);
            let gap = random.power_of_ten(-6.0, -1.0);
            let lift = random.power_of_ten(-6.0, 0.0);
            let mut point = |height: f64| at(&a, random.weights()) + normal * height;
            (a, [point(gap), point(gap + lift), point(gap + lift * 2.0)])
        }
        _ => {
            let b = random_triangle(random);
            (random_triangle(random), near(random, b, 1000.0))
        }
    };
    let (turn_a, turn_b) = (random.below(3), random.below(3));
    a.rotate_left(turn_a);
    b.rotate_left(turn_b);
    if random.below(2) == 0 {
        a.swap(0, 1);
    }
    if random.below(2) == 0 {
        b.swap(0, 1);
    }
    if random.below(2) == 0 {
        std::mem::swap(&mut a, &mut b);
    }

    // Powers of two keep the exact degeneracies exact.
    let scale = match random.below(16) {
        0 => 2f64.powi(random.whole(0, 1) * 200 - 100),
        1..6 => 1.0,
        _ => 2f64.powi(random.whole(-20, 20)),
    };
    let offset = match random.below(6) {
        // Whole units: rounding the sum to f32 merges and moves points, as happens far from the origin.
        0 => random.vector().round() * random.power_of_ten(0.0, 6.0).round() * scale,
        _ => DVec3::ZERO,
    };
    let stored = |p: DVec3| (p * scale + offset).as_vec3().as_dvec3();
    (a.map(stored), b.map(stored))
}

fn zero_free_grid_triangle(random: &mut Random) -> Triangle {
    loop {
        let corners = [random.grid_point(3), random.grid_point(3), random.grid_point(3)].map(|p| p * 2.0);
        if (corners[1] - corners[0]).cross(corners[2] - corners[0]) != DVec3::ZERO {
            return corners;
        }
    }
}

/// A mesh: vertex positions and triangles.
pub struct Mesh {
    pub positions: Vec<DVec3>,
    pub triangles: Vec<[u32; 3]>,
}

/// Random triangles in a box of side 1, with three vertices each and edges of about `size`.
pub fn soup(random: &mut Random, count: usize, size: f64) -> Mesh {
    let mut positions = Vec::new();
    for _ in 0..count {
        let centre = random.vector() * 0.5;
        for _ in 0..3 {
            positions.push((centre + random.vector() * size).as_vec3().as_dvec3());
        }
    }
    let triangles = (0..count as u32).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
    Mesh { positions, triangles }
}

/// A square grid of `cells` × `cells` unit quads of two triangles each, at height `height(x, y)`.
pub fn grid(cells: u32, height: impl Fn(u32, u32) -> f64) -> Mesh {
    let side = cells + 1;
    let positions = (0..side * side)
        .map(|k| {
            let (x, y) = (k % side, k / side);
            DVec3::new(f64::from(x), f64::from(y), height(x, y)).as_vec3().as_dvec3()
        })
        .collect();
    let triangles = (0..cells * cells)
        .flat_map(|k| {
            let corner = k / cells * side + k % cells;
            [[corner, corner + 1, corner + side], [corner + 1, corner + side + 1, corner + side]]
        })
        .collect();
    Mesh { positions, triangles }
}

/// Two meshes merged into one, with the indices of the second shifted.
pub fn joined(a: &Mesh, b: &Mesh) -> Mesh {
    let shift = a.positions.len() as u32;
    Mesh {
        positions: a.positions.iter().chain(&b.positions).copied().collect(),
        triangles: a
            .triangles
            .iter()
            .copied()
            .chain(b.triangles.iter().map(|triangle| triangle.map(|vertex| vertex + shift)))
            .collect(),
    }
}
