//! Strategies of proptest for meshes, motions, and sizes: both typical and defective ones.
//!
//! Meshes are about one unit large, near the origin, and have at most [`MOST_TRIANGLES`] triangles, so that brute force
//! can judge them. [`Placement`] gives them any size and distance from the origin. [`Motion`] moves them from one tick
//! to the next. Everything shrinks towards simple cases: fewer flaws, no motion, unit size.

use proptest::{prelude::*, sample::Index};

use circumsphere_support::{
    random::Random,
    scenes::{
        Diagonals, Mesh, cuboid, cylinder_side, duplicate_vertices, grid, icosphere, merge, saddle, torus,
        triangle_soup, twisted_rod,
    },
};

/// Largest number of triangles of a mesh.
pub const MOST_TRIANGLES: usize = 400;

/// Largest distance of a placement from the origin, in sizes of the mesh.
pub const FARTHEST: f32 = 1.0e6;

/// Any mesh: closed, open, non-manifold, or degenerate, alone or as two meshes of very different sizes.
pub fn mesh() -> BoxedStrategy<Mesh> {
    prop_oneof![
        2 => closed_mesh(),
        2 => open_mesh(),
        1 => non_manifold_mesh(),
        3 => degenerate_mesh(),
        1 => mesh_of_mixed_sizes(),
    ]
    .boxed()
}

/// A mesh with an inside: a ball, a box, a torus, or two of them that pass through each other.
pub fn closed_mesh() -> BoxedStrategy<Mesh> {
    let one = || {
        prop_oneof![
            (0u32..2, 0.3f32..1.0).prop_map(|(level, radius)| icosphere(level, radius)),
            (prop::array::uniform3(0.05f32..0.8), 1usize..3).prop_map(|(half, cells)| cuboid(half, cells)),
            (0.1f32..0.45, 3usize..7, 3usize..6).prop_map(|(minor, around, tube)| torus(0.6, minor, around, tube)),
        ]
    };
    prop_oneof![
        3 => (one(), turn()).prop_map(|(mesh, turn)| turn.apply(mesh)),
        1 => (one(), one(), turn(), offset(0.8)).prop_map(|(first, second, turn, offset)| {
            merge(&[first, turn.apply(second).translate(offset)])
        }),
    ]
    .boxed()
}

/// A mesh with boundaries: flat and crumpled sheets, tubes, saddles, twisted rods, or loose triangles.
pub fn open_mesh() -> BoxedStrategy<Mesh> {
    let diagonals = prop_oneof![Just(Diagonals::Uniform), Just(Diagonals::Alternating)];
    let sheet = (1usize..7, 1usize..7, diagonals, 0.2f32..1.5)
        .prop_map(|(columns, rows, diagonals, depth)| grid(columns, rows, 1.5, depth, diagonals));
    let shape = prop_oneof![
        sheet,
        (3usize..9, 1usize..5, 0.05f32..0.5)
            .prop_map(|(around, along, radius)| cylinder_side(radius, 1.4, around, along)),
        (1usize..7, -4.0f32..4.0).prop_map(|(cells, curvature)| saddle(cells, 1.2, curvature)),
        (1usize..6, 0.0f32..12.0).prop_map(|(along, twist)| twisted_rod(1.6, 0.2, along, 1, twist)),
        (1usize..40, any::<u64>()).prop_map(|(count, seed)| triangle_soup(count, seed)),
    ];
    (shape, crumple(), turn()).prop_map(|(mesh, crumple, turn)| turn.apply(crumple.apply(mesh))).boxed()
}

/// A mesh with an edge of more than two triangles, or with parts that share a single vertex.
pub fn non_manifold_mesh() -> BoxedStrategy<Mesh> {
    let book = (3usize..9, any::<u64>()).prop_map(|(pages, seed)| book(pages, seed));
    let glued = (prop_oneof![closed_mesh(), open_mesh()], any::<Index>(), any::<Index>(), offset(0.5)).prop_map(
        |(mut mesh, triangle, vertex, offset)| {
            // A flap on an edge that already has its triangles.
            let [a, b, _] = mesh.triangles[triangle.index(mesh.triangles.len())];
            let base = mesh.positions[vertex.index(mesh.positions.len())];
            let tip = number(mesh.positions.len());
            mesh.positions.push(std::array::from_fn(|axis| base[axis] + offset[axis]));
            mesh.triangles.push([a, b, tip]);
            mesh
        },
    );
    let bow = (open_mesh(), open_mesh(), any::<Index>(), any::<Index>()).prop_map(|(first, second, own, other)| {
        let (own, other) = (first.positions[own.index(first.positions.len())], other.index(second.positions.len()));
        let other = second.positions[other];
        merge(&[first, second.translate(std::array::from_fn(|axis| own[axis] - other[axis]))])
    });
    (prop_oneof![book, glued, bow], turn()).prop_map(|(mesh, turn)| turn.apply(mesh)).boxed()
}

/// A mesh with one or more flaws.
pub fn degenerate_mesh() -> BoxedStrategy<Mesh> {
    (prop_oneof![closed_mesh(), open_mesh(), non_manifold_mesh()], prop::collection::vec(flaw(), 1..6))
        .prop_map(|(mesh, flaws)| flaws.into_iter().fold(mesh, |mesh, flaw| flaw.apply(mesh)))
        .boxed()
}

/// A small mesh near a vertex of another one that is a thousand times as large.
pub fn mesh_of_mixed_sizes() -> BoxedStrategy<Mesh> {
    (prop_oneof![closed_mesh(), open_mesh()], closed_mesh(), any::<Index>(), offset(1.0))
        .prop_map(|(large, small, vertex, offset)| {
            let at = large.positions[vertex.index(large.positions.len())];
            let small = small.translate(offset).scale(1.0e-3).translate(at);
            merge(&[large, small])
        })
        .boxed()
}

/// Two meshes that pass through each other, touch, or narrowly miss each other.
pub fn two_meshes() -> BoxedStrategy<[Mesh; 2]> {
    let beside = (mesh(), mesh(), any::<Index>(), any::<Index>(), offset(0.3)).prop_map(
        |(first, second, own, other, offset)| {
            let own = first.positions[own.index(first.positions.len())];
            let other = second.positions[other.index(second.positions.len())];
            let second = second.translate(std::array::from_fn(|axis| own[axis] - other[axis] + offset[axis]));
            [first, second]
        },
    );
    let within = (mesh(), mesh(), offset(0.6)).prop_map(|(first, second, offset)| [first, second.translate(offset)]);
    // The same mesh twice: coinciding, or displaced within itself.
    let twice = (mesh(), prop_oneof![Just([0.0; 3]), offset(0.1)])
        .prop_map(|(mesh, offset)| [mesh.clone(), mesh.translate(offset)]);
    prop_oneof![2 => beside, 2 => within, 1 => twice].boxed()
}

/// A flaw of a mesh.
#[derive(Clone, Copy, Debug)]
pub enum Flaw {
    /// A corner of a triangle is moved towards the previous one until this share of their edge is left.
    Needle(Index, f32),
    /// A corner is exactly in the middle of the opposite edge, within the precision of f32.
    ZeroArea(Index),
    /// A corner is exactly at the position of the previous one, but remains a separate vertex.
    DuplicateVertices(Index),
    /// A triangle names a vertex twice.
    RepeatedIndex(Index),
    /// A triangle names one vertex three times.
    Point(Index),
    /// An edge is split in its triangle, but not in the neighbor.
    TJunction(Index),
    /// A triangle has reversed winding.
    FlippedWinding(Index),
    /// A triangle exists twice.
    DuplicateTriangle(Index),
    /// A vertex belongs to no triangle.
    LooseVertex,
    /// Each triangle has its own vertices, at the same positions.
    Unindexed,
}

/// Any flaw.
pub fn flaw() -> BoxedStrategy<Flaw> {
    let at = any::<Index>;
    prop_oneof![
        Just(Flaw::LooseVertex),
        Just(Flaw::Unindexed),
        at().prop_map(Flaw::FlippedWinding),
        at().prop_map(Flaw::TJunction),
        at().prop_map(Flaw::DuplicateTriangle),
        at().prop_map(Flaw::RepeatedIndex),
        at().prop_map(Flaw::Point),
        at().prop_map(Flaw::DuplicateVertices),
        at().prop_map(Flaw::ZeroArea),
        (at(), -7i32..-1).prop_map(|(at, power)| Flaw::Needle(at, power_of_ten(power as f32))),
    ]
    .boxed()
}

impl Flaw {
    /// Applies the flaw to a mesh.
    #[must_use]
    pub fn apply(self, mut mesh: Mesh) -> Mesh {
        let count = mesh.triangles.len();
        let vertices = |at: Index| mesh.triangles[at.index(count)].map(|vertex| vertex as usize);
        match self {
            Self::Needle(at, share) => {
                let [a, b, _] = vertices(at);
                let (from, to) = (mesh.positions[a], mesh.positions[b]);
                mesh.positions[b] = std::array::from_fn(|axis| from[axis] + share * (to[axis] - from[axis]));
            }
            Self::ZeroArea(at) => {
                let [a, b, c] = vertices(at);
                let (from, to) = (mesh.positions[a], mesh.positions[b]);
                mesh.positions[c] = std::array::from_fn(|axis| from[axis] + 0.5 * (to[axis] - from[axis]));
            }
            Self::DuplicateVertices(at) => {
                let [a, b, _] = vertices(at);
                mesh.positions[b] = mesh.positions[a];
            }
            Self::RepeatedIndex(at) => {
                let [a, b, _] = mesh.triangles[at.index(count)];
                mesh.triangles[at.index(count)] = [a, b, b];
            }
            Self::Point(at) => {
                let [a, ..] = mesh.triangles[at.index(count)];
                mesh.triangles[at.index(count)] = [a; 3];
            }
            Self::TJunction(at) => {
                let [a, b, c] = mesh.triangles[at.index(count)];
                let (from, to) = (mesh.positions[a as usize], mesh.positions[b as usize]);
                let middle = number(mesh.positions.len());
                mesh.positions.push(std::array::from_fn(|axis| from[axis] + 0.5 * (to[axis] - from[axis])));
                mesh.triangles[at.index(count)] = [a, middle, c];
                mesh.triangles.push([middle, b, c]);
            }
            Self::FlippedWinding(at) => {
                let [a, b, c] = mesh.triangles[at.index(count)];
                mesh.triangles[at.index(count)] = [a, c, b];
            }
            Self::DuplicateTriangle(at) => mesh.triangles.push(mesh.triangles[at.index(count)]),
            Self::LooseVertex => mesh.positions.push([0.3; 3]),
            Self::Unindexed => mesh = duplicate_vertices(&mesh),
        }
        mesh
    }
}

/// Motion of a surface of about unit size from one tick to the next.
#[derive(Clone, Copy, Debug)]
pub enum Motion {
    /// No motion.
    Rest,
    /// A rotation and a translation.
    Rigid(Turn, [f32; 3]),
    /// A rotation and a change of size, with mirroring if the flag is set.
    Similarity(Turn, f32, bool),
    /// A rotation about the y axis, by this angle per unit along the axis.
    Twist(f32),
    /// A displacement of each vertex by up to this amount, from a few units in the last place upwards.
    Noise(f32, u64),
    /// Stretching and compression along the axes, all at once.
    ShapeChange([f32; 3]),
    /// A jump to a place where nothing from the last tick is useful.
    Teleport([f32; 3]),
}

/// Any motion.
pub fn motion() -> BoxedStrategy<Motion> {
    prop_oneof![
        1 => Just(Motion::Rest),
        2 => (turn(), offset(0.3)).prop_map(|(turn, offset)| Motion::Rigid(turn, offset)),
        1 => (turn(), 0.2f32..5.0, any::<bool>())
            .prop_map(|(turn, factor, mirrored)| Motion::Similarity(turn, factor, mirrored)),
        2 => (-8.0f32..8.0).prop_map(Motion::Twist),
        3 => (-7.0f32..-0.5, any::<u64>()).prop_map(|(power, seed)| Motion::Noise(power_of_ten(power), seed)),
        1 => prop::array::uniform3(0.02f32..3.0).prop_map(Motion::ShapeChange),
        1 => offset(100.0).prop_map(Motion::Teleport),
    ]
    .boxed()
}

impl Motion {
    /// Applies the motion to a mesh.
    #[must_use]
    pub fn apply(self, mesh: Mesh) -> Mesh {
        match self {
            Self::Rest => mesh,
            Self::Rigid(turn, offset) => turn.apply(mesh).translate(offset),
            Self::Similarity(turn, factor, mirrored) => {
                let sign = if mirrored { -1.0 } else { 1.0 };
                stretched(turn.apply(mesh), [sign * factor, factor, factor])
            }
            Self::Twist(rate) => {
                let mut mesh = mesh;
                for [x, y, z] in &mut mesh.positions {
                    let (sine, cosine) = (libm::sinf(rate * *y), libm::cosf(rate * *y));
                    (*x, *z) = (cosine * *x + sine * *z, cosine * *z - sine * *x);
                }
                mesh
            }
            Self::Noise(amplitude, seed) => displaced(mesh, amplitude, seed),
            Self::ShapeChange(factors) => stretched(mesh, factors),
            Self::Teleport(offset) => mesh.translate(offset),
        }
    }
}

/// Placement of a mesh of about unit size.
#[derive(Clone, Copy, Debug)]
pub struct Placement {
    /// Scale factor.
    pub scale: f32,
    /// Displacement before scaling, in sizes of the mesh.
    pub offset: [f32; 3],
}

/// Scales from 1e-6 to 1e6, at the origin and up to [`FARTHEST`] sizes away from it.
pub fn placement() -> BoxedStrategy<Placement> {
    (scale(), far_offset()).prop_map(|(scale, offset)| Placement { scale, offset }).boxed()
}

impl Placement {
    /// Applies the placement to a mesh. Far from the origin, f32 leaves little of its shape: it becomes a different,
    /// degenerate mesh.
    #[must_use]
    pub fn apply(self, mesh: Mesh) -> Mesh {
        mesh.translate(self.offset).scale(self.scale)
    }
}

/// Factors from 1e-6 to 1e6, including 1 and powers of two.
pub fn scale() -> impl Strategy<Value = f32> {
    prop_oneof![
        2 => Just(1.0),
        1 => (-19i32..20).prop_map(power_of_two),
        2 => (-6.0f32..6.0).prop_map(power_of_ten),
    ]
}

/// No offset, or one of up to [`FARTHEST`] in each coordinate, at all orders of magnitude.
pub fn far_offset() -> impl Strategy<Value = [f32; 3]> {
    prop_oneof![
        2 => Just([0.0; 3]),
        1 => (offset(1.0), 0.0f32..6.0).prop_map(|(direction, power)| {
            direction.map(|coordinate| coordinate * power_of_ten(power).min(FARTHEST))
        }),
    ]
}

/// Offsets of up to `reach` in each coordinate.
pub fn offset(reach: f32) -> impl Strategy<Value = [f32; 3]> {
    prop::array::uniform3(-reach..reach)
}

/// A rotation.
#[derive(Clone, Copy, Debug)]
pub struct Turn {
    /// The axis, of any length except zero.
    pub axis: [f32; 3],
    /// The angle in radians.
    pub angle: f32,
}

/// No rotation, a right angle about a coordinate axis, or any rotation.
pub fn turn() -> BoxedStrategy<Turn> {
    let right_angle = (0usize..3).prop_map(|axis| Turn {
        axis: std::array::from_fn(|other| f32::from(u8::from(other == axis))),
        angle: std::f32::consts::FRAC_PI_2,
    });
    // The first coordinate is not zero, so the axis has a length.
    let any = (0.01f32..1.0, -1.0f32..1.0, -1.0f32..1.0, -3.2f32..3.2)
        .prop_map(|(x, y, z, angle)| Turn { axis: [x, y, z], angle });
    prop_oneof![
        1 => Just(Turn { axis: [0.0, 1.0, 0.0], angle: 0.0 }),
        1 => right_angle,
        3 => any,
    ]
    .boxed()
}

impl Turn {
    /// Rotates a mesh about the origin.
    #[must_use]
    pub fn apply(self, mesh: Mesh) -> Mesh {
        // A zero rotation must not change any bit.
        if self.angle == 0.0 { mesh } else { mesh.rotate(self.axis, self.angle) }
    }
}

/// A displacement of the vertices of a sheet.
#[derive(Clone, Copy, Debug)]
enum Crumple {
    None,
    /// By up to this amount.
    Any(f32, u64),
    /// To multiples of an eighth, so that vertices, edges, and planes coincide.
    Eighths(u64),
}

fn crumple() -> impl Strategy<Value = Crumple> {
    prop_oneof![
        Just(Crumple::None),
        (0.01f32..0.6, any::<u64>()).prop_map(|(amplitude, seed)| Crumple::Any(amplitude, seed)),
        any::<u64>().prop_map(Crumple::Eighths),
    ]
}

impl Crumple {
    fn apply(self, mesh: Mesh) -> Mesh {
        match self {
            Self::None => mesh,
            Self::Any(amplitude, seed) => displaced(mesh, amplitude, seed),
            Self::Eighths(seed) => {
                let mut mesh = displaced(mesh, 0.4, seed);
                for coordinate in mesh.positions.iter_mut().flatten() {
                    *coordinate = (*coordinate * 8.0).round() / 8.0;
                }
                mesh
            }
        }
    }
}

fn displaced(mut mesh: Mesh, amplitude: f32, seed: u64) -> Mesh {
    let mut random = Random::new(seed);
    for coordinate in mesh.positions.iter_mut().flatten() {
        *coordinate += amplitude * random.signed_unit();
    }
    mesh
}

fn stretched(mut mesh: Mesh, factors: [f32; 3]) -> Mesh {
    for position in &mut mesh.positions {
        *position = std::array::from_fn(|axis| position[axis] * factors[axis]);
    }
    mesh
}

/// Triangles that all share one edge.
fn book(pages: usize, seed: u64) -> Mesh {
    let mut random = Random::new(seed);
    let mut mesh = Mesh { positions: vec![[0.0, -0.5, 0.0], [0.0, 0.5, 0.0]], triangles: Vec::new() };
    for _ in 0..pages {
        mesh.triangles.push([0, 1, number(mesh.positions.len())]);
        mesh.positions.push(std::array::from_fn(|_| random.signed_unit()));
    }
    mesh
}

/// A vertex index as the `u32` that triangles store.
fn number(vertex: usize) -> u32 {
    u32::try_from(vertex).expect("a mesh has fewer than 2^32 vertices")
}

fn power_of_ten(power: f32) -> f32 {
    libm::powf(10.0, power)
}

fn power_of_two(power: i32) -> f32 {
    libm::ldexpf(1.0, power)
}
