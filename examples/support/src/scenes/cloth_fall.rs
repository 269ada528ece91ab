//! The embedded scene: a hanging cloth falls onto a torus that bends and swells, topples over a ball, and folds onto
//! itself.
//!
//! A position-based simulation with small steps (Macklin et al., "Small Steps in Physics Simulation", 2019), in `f64`
//! and in one fixed order. It is made to look plausible and to produce collisions rather than to be exact. Cloth, ball,
//! and torus are one mesh, which is the recorded one, and its parts keep a small thickness apart. The floor is a
//! formula. No step moves a vertex of the cloth farther than half of the distance to the nearest part (Chen et al.,
//! "Offset Geometric Contact", 2025), and the torus moves by far less than the thickness. So nothing tunnels, although
//! the thickness is small.

use std::collections::BTreeSet;
use std::f64::consts::TAU;
use std::ops::Range;

use super::{Diagonals, grid, icosphere, merge, torus};
use crate::recording::Recording;

/// Number of frames in the recording.
pub const FRAMES: usize = 120;
/// Frames per second of scene time.
pub const FRAMES_PER_SECOND: f32 = 60.0;

/// Vertices along each side of the cloth.
pub const CLOTH_SIDE_VERTICES: usize = 26;
/// Rest distance of adjacent cloth vertices, in meters.
pub const CLOTH_EDGE: f32 = 0.08;
/// Center of the ball, in meters. The floor is at y = 0.
pub const BALL_CENTER: [f32; 3] = [-0.15, 0.6, -0.25];
/// Radius of the ball, in meters.
pub const BALL_RADIUS: f32 = 0.25;

/// The bodies, in the order of their vertices and triangles.
pub const CLOTH_FALL_BODIES: [&str; 3] = ["cloth", "ball", "ring"];

/// Vertices of the cloth, row by row.
pub const CLOTH_VERTICES: Range<usize> = 0..CLOTH_COUNT;
/// Vertices of the ball, which is static.
pub const BALL_VERTICES: Range<usize> = CLOTH_VERTICES.end..CLOTH_VERTICES.end + 162;
/// Vertices of the torus.
pub const TORUS_VERTICES: Range<usize> = BALL_VERTICES.end..BALL_VERTICES.end + RING_SEGMENTS * TUBE_SEGMENTS;
/// Triangles of the cloth.
pub const CLOTH_TRIANGLES: Range<usize> = 0..2 * CLOTH_CELLS * CLOTH_CELLS;
/// Triangles of the ball.
pub const BALL_TRIANGLES: Range<usize> = CLOTH_TRIANGLES.end..CLOTH_TRIANGLES.end + 320;
/// Triangles of the torus.
pub const TORUS_TRIANGLES: Range<usize> = BALL_TRIANGLES.end..BALL_TRIANGLES.end + 2 * RING_SEGMENTS * TUBE_SEGMENTS;

const CLOTH_CELLS: usize = CLOTH_SIDE_VERTICES - 1;
const CLOTH_COUNT: usize = CLOTH_SIDE_VERTICES * CLOTH_SIDE_VERTICES;
const CLOTH_HEIGHT: f32 = 1.55;
const RING_SEGMENTS: usize = 24;
const TUBE_SEGMENTS: usize = 12;
const RING_CENTER: Point = [0.1, 0.25, 0.3];
const RING_MAJOR: f64 = 0.42;
const RING_MINOR: f64 = 0.1;

const SUBSTEPS: usize = 12;
const STEP: f64 = 1.0 / (FRAMES_PER_SECOND as f64 * SUBSTEPS as f64);
const GRAVITY: f64 = 9.81;
/// Share of the velocity lost to air drag, per second.
const DRAG: f64 = 2.0;
/// Bending resistance: share of the error that a step removes where vertices two apart are too close.
const BENDING_STIFFNESS: f64 = 0.01;
/// The same for the diagonals of a cell, because cloth shears far more easily than it stretches.
const SHEAR_STIFFNESS: f64 = 0.1;
/// Distance kept between the cloth and itself, the ball, and the torus. It is slightly less than a tenth of the mean
/// edge of the scene, so that resting parts count as touching by default.
const THICKNESS: f64 = 0.0075;
/// Height of the cloth above the floor.
const CLEARANCE: f64 = 0.02;
/// Share of the sliding on the floor and the torus that a step removes.
const FRICTION: f64 = 0.1;
/// The same for the ball, which is smoother.
const BALL_FRICTION: f64 = 0.02;
/// Distance beyond the thickness within which parts are listed as possible contacts. The list is valid until a vertex
/// has moved by a quarter of it. Then parts that are not listed are still beyond the thickness by at least half of it.
const REACH: f64 = 0.3 * CLOTH_EDGE as f64;
/// Half the length of a diagonal of the cloth, including the residual stretch of the springs.
const LONGEST_HALF_EDGE: f64 = 0.8 * CLOTH_EDGE as f64;
/// Share of the distance to the nearest part that a vertex may move in a step. Two parts that approach each other use
/// twice as much, and still leave a gap.
const ROOM: f64 = 0.45;
/// Top speed of a vertex, in meters per second. It limits the whipping of free corners.
const TOP_SPEED: f64 = 5.0;

type Point = [f64; 3];

/// The recording of the scene: cloth, ball (an icosphere of level 2), and torus (24 by 12) as one mesh, in meters.
///
/// It has [`FRAMES`] frames, and the range constants name its parts. In no frame do two triangles of different parts
/// cross, or two triangles of the cloth without a common vertex. It takes about three seconds to compute with
/// optimizations, and half a minute without.
pub fn cloth_fall() -> Recording {
    cloth_fall_start(FRAMES)
}

/// The first `frames` frames of [`cloth_fall`], or more frames than it has.
pub fn cloth_fall_start(frames: usize) -> Recording {
    let mut simulation = Simulation::new();
    let mut recording = Recording { triangles: simulation.triangles.clone(), frames: Vec::with_capacity(frames) };
    for frame in 0..frames {
        if frame > 0 {
            simulation.advance(time_of(frame - 1));
        }
        recording.frames.push(simulation.vertices());
    }
    recording
}

/// Scene time of a frame, in seconds.
fn time_of(frame: usize) -> f64 {
    frame as f64 / f64::from(FRAMES_PER_SECOND)
}

/// The vertices of the torus at one time, in the order of [`torus`]: a circle that shrinks and bends like the rim of a
/// saddle, with a tube that swells in waves.
fn ring_vertices(time: f64) -> impl Iterator<Item = Point> {
    let bend = 0.12 * libm::sin(TAU * 0.75 * time);
    let major = RING_MAJOR * (1.0 - 0.15 * (1.0 - libm::cos(TAU * 0.5 * time)));
    (0..RING_SEGMENTS).flat_map(move |segment| {
        let angle = TAU * segment as f64 / RING_SEGMENTS as f64;
        let outward = [libm::cos(angle), 0.0, libm::sin(angle)];
        let height = [0.0, bend * libm::cos(2.0 * angle), 0.0];
        let center = add_scaled(add_scaled(RING_CENTER, outward, major), height, 1.0);
        let wave = libm::sin(3.0 * angle - TAU * time);
        let radius = RING_MINOR * (1.0 + 0.2 * wave);
        (0..TUBE_SEGMENTS).map(move |tube| {
            let angle = TAU * tube as f64 / TUBE_SEGMENTS as f64;
            let out = add_scaled(center, outward, radius * libm::cos(angle));
            add_scaled(out, [0.0, 1.0, 0.0], radius * libm::sin(angle))
        })
    })
}

/// A distance constraint between two vertices.
struct Spring {
    ends: [usize; 2],
    length: f64,
    /// Share of the error that a step removes if the two are too far apart.
    stretched: f64,
    /// The same if they are too close.
    compressed: f64,
}

/// Two parts without common vertices. At least one belongs to the cloth.
enum Contact {
    VertexTriangle(usize, [usize; 3]),
    EdgeEdge([usize; 2], [usize; 2]),
}

struct Simulation {
    /// The vertices of cloth, ball, and torus. Only those of the cloth move freely.
    positions: Vec<Point>,
    triangles: Vec<[u32; 3]>,
    edges: Vec<[usize; 2]>,
    springs: Vec<Spring>,
    /// Parts that may touch before the next search.
    contacts: Vec<Contact>,
    /// The positions at the last search; empty before the first.
    searched: Vec<Point>,
    /// The positions of the cloth before the step, and its velocities.
    previous: Vec<Point>,
    velocities: Vec<Point>,
    /// For each vertex of the cloth, the smallest gap of its contacts before the step.
    room: Vec<f64>,
    /// For each vertex of the cloth, the sum of the directions in which ball and torus pushed it, and the friction of
    /// the last of them.
    pushes: Vec<(Point, f64)>,
}

impl Simulation {
    fn new() -> Self {
        let size = CLOTH_EDGE * CLOTH_CELLS as f32;
        // The rotations are slightly off the axes, so that no symmetry keeps the cloth from falling to one side.
        let sheet = grid(CLOTH_CELLS, CLOTH_CELLS, size, size, Diagonals::Alternating)
            .rotate([0.0, 1.0, 0.0], 0.2)
            .rotate([1.0, 0.0, 0.1], 1.4)
            .translate([0.0, CLOTH_HEIGHT, 0.0]);
        let scene = merge(&[
            sheet,
            icosphere(2, BALL_RADIUS).translate(BALL_CENTER),
            torus(RING_MAJOR as f32, RING_MINOR as f32, RING_SEGMENTS, TUBE_SEGMENTS),
        ]);
        let positions: Vec<Point> = scene.positions.iter().map(|position| position.map(f64::from)).collect();
        let mut simulation = Self {
            previous: positions[CLOTH_VERTICES].to_vec(),
            positions,
            edges: edges(&scene.triangles),
            triangles: scene.triangles,
            springs: springs(),
            contacts: Vec::new(),
            searched: Vec::new(),
            velocities: vec![[0.0; 3]; CLOTH_COUNT],
            room: vec![0.0; CLOTH_COUNT],
            pushes: vec![([0.0; 3], 0.0); CLOTH_COUNT],
        };
        simulation.move_ring(0.0);
        simulation
    }

    /// The positions in the precision of the recording.
    fn vertices(&self) -> Vec<[f32; 3]> {
        let single = |position: &Point| position.map(|value| value as f32);
        self.positions.iter().map(single).collect()
    }

    /// Advances by one frame from `time`, in seconds.
    fn advance(&mut self, time: f64) {
        for substep in 0..SUBSTEPS {
            self.move_ring(time + (substep + 1) as f64 * STEP);
            self.search_contacts();
            self.measure_room();
            self.predict();
            self.satisfy_springs();
            self.separate_contacts();
            self.leave_floor();
            self.finish();
        }
    }

    fn move_ring(&mut self, time: f64) {
        for (position, vertex) in self.positions[TORUS_VERTICES].iter_mut().zip(ring_vertices(time)) {
            *position = vertex;
        }
    }

    /// Finds pairs of a vertex and a triangle, and pairs of edges, that may come within the thickness before the next
    /// search.
    fn search_contacts(&mut self) {
        let positions = &self.positions;
        let is_valid = !self.searched.is_empty()
            && positions
                .iter()
                .zip(&self.searched)
                .all(|(position, searched)| distance(*position, *searched) < 0.25 * REACH);
        if is_valid {
            return;
        }
        self.searched.clone_from(positions);
        let contacts = &mut self.contacts;
        contacts.clear();
        let margin = THICKNESS + REACH;

        let vertices = CellHash::new(positions);
        for triangle in &self.triangles {
            let corners = triangle.map(|corner| corner as usize);
            let points = corners.map(|corner| positions[corner]);
            vertices.visit(&points, margin, |vertex| {
                if corners.contains(&vertex) || !(is_cloth(vertex) || is_cloth(corners[0])) {
                    return;
                }
                let weights = nearest_weights(positions[vertex], points);
                let nearest = weighted(&points, &weights);
                if distance(positions[vertex], nearest) < margin {
                    contacts.push(Contact::VertexTriangle(vertex, corners));
                }
            });
        }

        // Edges of the cloth come first.
        let cloth_edges = self.edges.partition_point(|edge| is_cloth(edge[0]));
        let middles: Vec<Point> = self.edges[..cloth_edges]
            .iter()
            .map(|edge| weighted(&edge.map(|end| positions[end]), &[0.5, 0.5]))
            .collect();
        let middles = CellHash::new(&middles);
        for (first, &edge) in self.edges.iter().enumerate() {
            let ends = edge.map(|end| positions[end]);
            middles.visit(&ends, margin + LONGEST_HALF_EDGE, |second| {
                let other = self.edges[second];
                if second >= first || other.iter().any(|end| edge.contains(end)) {
                    return;
                }
                let other_ends = other.map(|end| positions[end]);
                if !are_boxes_near(ends, other_ends, margin) {
                    return;
                }
                let (part, other_part) = nearest_parts(ends, other_ends);
                let near = weighted(&ends, &[1.0 - part, part]);
                let other_near = weighted(&other_ends, &[1.0 - other_part, other_part]);
                if distance(near, other_near) < margin {
                    contacts.push(Contact::EdgeEdge(edge, other));
                }
            });
        }
    }

    fn measure_room(&mut self) {
        self.room.fill(THICKNESS + 0.5 * REACH);
        for contact in &self.contacts {
            let nearest = contact.nearest(&self.positions);
            let gap = nearest.gap();
            for vertex in nearest.vertices {
                if is_cloth(vertex) && gap < self.room[vertex] {
                    self.room[vertex] = gap;
                }
            }
        }
    }

    fn predict(&mut self) {
        self.previous.copy_from_slice(&self.positions[CLOTH_VERTICES]);
        for (position, velocity) in self.positions.iter_mut().zip(&mut self.velocities) {
            velocity[1] -= GRAVITY * STEP;
            *velocity = scaled(*velocity, 1.0 - DRAG * STEP);
            *position = add_scaled(*position, *velocity, STEP);
        }
    }

    fn satisfy_springs(&mut self) {
        for spring in &self.springs {
            let [a, b] = spring.ends;
            let between = subtract(self.positions[b], self.positions[a]);
            let distance = dot(between, between).sqrt();
            let error = distance - spring.length;
            let stiffness = if error > 0.0 { spring.stretched } else { spring.compressed };
            if distance > 0.0 {
                let share = 0.5 * stiffness * error / distance;
                self.positions[a] = add_scaled(self.positions[a], between, share);
                self.positions[b] = add_scaled(self.positions[b], between, -share);
            }
        }
    }

    /// Pushes close parts apart to the thickness, and applies friction to the cloth.
    fn separate_contacts(&mut self) {
        self.pushes.fill(([0.0; 3], 0.0));
        for contact in &self.contacts {
            let nearest = contact.nearest(&self.positions);
            let gap = nearest.gap();
            if gap >= THICKNESS || gap == 0.0 {
                continue;
            }
            let movable = nearest.vertices.into_iter().zip(nearest.weights).filter(|&(vertex, _)| is_cloth(vertex));
            let mobility: f64 = movable.clone().map(|(_, weight)| weight * weight).sum();
            let obstacle = nearest.vertices.into_iter().find(|&vertex| !is_cloth(vertex));
            let normal = scaled(nearest.between, 1.0 / gap);
            for (vertex, weight) in movable {
                self.positions[vertex] =
                    add_scaled(self.positions[vertex], normal, weight * (THICKNESS - gap) / mobility);
                if let Some(obstacle) = obstacle {
                    let (direction, friction) = &mut self.pushes[vertex];
                    *direction = add_scaled(*direction, normal, weight);
                    *friction = if BALL_VERTICES.contains(&obstacle) { BALL_FRICTION } else { FRICTION };
                }
            }
        }
        for ((position, previous), (direction, friction)) in
            self.positions.iter_mut().zip(&self.previous).zip(&self.pushes)
        {
            let length = dot(*direction, *direction).sqrt();
            if length > 0.0 {
                rub(position, *previous, scaled(*direction, 1.0 / length), friction * length.min(1.0));
            }
        }
    }

    fn leave_floor(&mut self) {
        for (position, previous) in self.positions.iter_mut().zip(&self.previous) {
            if position[1] < CLEARANCE {
                position[1] = CLEARANCE;
                rub(position, *previous, [0.0, 1.0, 0.0], FRICTION);
            }
        }
    }

    fn finish(&mut self) {
        let cloth = self.positions.iter_mut().zip(&self.previous).zip(&mut self.velocities).zip(&self.room);
        for (((position, previous), velocity), room) in cloth {
            let moved = subtract(*position, *previous);
            let distance = dot(moved, moved).sqrt();
            let farthest = (ROOM * room).min(TOP_SPEED * STEP);
            if distance > farthest {
                *position = add_scaled(*previous, moved, farthest / distance);
            }
            *velocity = scaled(subtract(*position, *previous), 1.0 / STEP);
        }
    }
}

impl Contact {
    fn nearest(&self, positions: &[Point]) -> Nearest {
        match *self {
            Self::VertexTriangle(vertex, [a, b, c]) => {
                let points = [a, b, c].map(|corner| positions[corner]);
                let weights = nearest_weights(positions[vertex], points);
                Nearest {
                    vertices: [vertex, a, b, c],
                    weights: [1.0, -weights[0], -weights[1], -weights[2]],
                    between: subtract(positions[vertex], weighted(&points, &weights)),
                }
            }
            Self::EdgeEdge([a, b], [c, d]) => {
                let (first, second) = ([a, b].map(|end| positions[end]), [c, d].map(|end| positions[end]));
                let (part, other_part) = nearest_parts(first, second);
                let weights = [1.0 - part, part, other_part - 1.0, -other_part];
                let points = [first[0], first[1], second[0], second[1]];
                Nearest { vertices: [a, b, c, d], weights, between: weighted(&points, &weights) }
            }
        }
    }
}

/// The nearest points of two parts.
struct Nearest {
    vertices: [usize; 4],
    /// Weight of each vertex in `between`, negative for the second part.
    weights: [f64; 4],
    /// From the point on the second part to the point on the first.
    between: Point,
}

impl Nearest {
    fn gap(&self) -> f64 {
        dot(self.between, self.between).sqrt()
    }
}

fn is_cloth(vertex: usize) -> bool {
    CLOTH_VERTICES.contains(&vertex)
}

/// Undoes a share of the motion since `previous` that is perpendicular to the `normal`.
fn rub(position: &mut Point, previous: Point, normal: Point, friction: f64) {
    let moved = subtract(*position, previous);
    let sliding = add_scaled(moved, normal, -dot(moved, normal));
    *position = add_scaled(*position, sliding, -friction);
}

/// All edges of the triangles without duplicates, in a fixed order.
fn edges(triangles: &[[u32; 3]]) -> Vec<[usize; 2]> {
    let sides = triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
    let edges: BTreeSet<[usize; 2]> = sides.map(|[a, b]| [a.min(b) as usize, a.max(b) as usize]).collect();
    edges.into_iter().collect()
}

/// Springs from every vertex to its neighbors, across its cell, and to the vertices two away.
fn springs() -> Vec<Spring> {
    // Columns and rows from one end to the other, and the resistance to compression.
    let kinds: [(i32, i32, f64); 6] = [
        (2, 0, BENDING_STIFFNESS),
        (0, 2, BENDING_STIFFNESS),
        (1, 1, SHEAR_STIFFNESS),
        (-1, 1, SHEAR_STIFFNESS),
        (1, 0, 1.0),
        (0, 1, 1.0),
    ];
    let side = CLOTH_SIDE_VERTICES as i32;
    let mut springs = Vec::new();
    for row in 0..side {
        for column in 0..side {
            for (columns, rows, compressed) in kinds {
                let (to_column, to_row) = (column + columns, row + rows);
                if (0..side).contains(&to_column) && (0..side).contains(&to_row) {
                    let steps = f64::from(columns * columns + rows * rows).sqrt();
                    springs.push(Spring {
                        ends: [(row * side + column) as usize, (to_row * side + to_column) as usize],
                        length: steps * f64::from(CLOTH_EDGE),
                        stretched: 1.0,
                        compressed,
                    });
                }
            }
        }
    }
    springs
}

/// Points sorted by their cell in a hashed lattice.
struct CellHash {
    /// Start of the entries of each slot, with one extra element at the end.
    starts: Vec<usize>,
    entries: Vec<Entry>,
}

#[derive(Clone, Copy)]
struct Entry {
    index: usize,
    point: Point,
    cell: [i64; 3],
}

impl CellHash {
    const SLOTS: usize = 2048;
    const CELL: f64 = 2.0 * CLOTH_EDGE as f64;

    fn new(points: &[Point]) -> Self {
        let mut entries: Vec<Entry> = points
            .iter()
            .enumerate()
            .map(|(index, &point)| Entry { index, point, cell: point.map(Self::cell) })
            .collect();
        entries.sort_by_key(|entry| Self::slot(entry.cell));
        let mut starts = vec![0; Self::SLOTS + 1];
        for entry in &entries {
            starts[Self::slot(entry.cell) + 1] += 1;
        }
        for slot in 0..Self::SLOTS {
            starts[slot + 1] += starts[slot];
        }
        Self { starts, entries }
    }

    /// Visits, once each, the points in the bounding box of `corners` grown by `margin`.
    fn visit(&self, corners: &[Point], margin: f64, mut visit: impl FnMut(usize)) {
        let bound = |start: f64, pick: fn(f64, f64) -> f64, margin: f64| -> Point {
            std::array::from_fn(|axis| {
                let coordinates = corners.iter().map(|corner| corner[axis]);
                coordinates.fold(start, pick) + margin
            })
        };
        let low = bound(f64::INFINITY, f64::min, -margin);
        let high = bound(f64::NEG_INFINITY, f64::max, margin);
        let (first, last) = (low.map(Self::cell), high.map(Self::cell));
        for x in first[0]..=last[0] {
            for y in first[1]..=last[1] {
                for z in first[2]..=last[2] {
                    let cell = [x, y, z];
                    let slot = Self::slot(cell);
                    for entry in &self.entries[self.starts[slot]..self.starts[slot + 1]] {
                        let is_inside =
                            (0..3).all(|axis| low[axis] <= entry.point[axis] && entry.point[axis] <= high[axis]);
                        // Another cell may share the slot. Its points are visited with that cell.
                        if is_inside && entry.cell == cell {
                            visit(entry.index);
                        }
                    }
                }
            }
        }
    }

    fn cell(coordinate: f64) -> i64 {
        (coordinate / Self::CELL).floor() as i64
    }

    fn slot([x, y, z]: [i64; 3]) -> usize {
        let mixed = x.wrapping_mul(73_856_093) ^ y.wrapping_mul(19_349_663) ^ z.wrapping_mul(83_492_791);
        mixed.rem_euclid(Self::SLOTS as i64) as usize
    }
}

/// Barycentric weights of the point of a triangle nearest to `point`.
///
/// The regions of the plane are those of Ericson, "Real-Time Collision Detection" (2005), section 5.1.5.
fn nearest_weights(point: Point, [a, b, c]: [Point; 3]) -> [f64; 3] {
    let (ab, ac) = (subtract(b, a), subtract(c, a));
    let from_a = subtract(point, a);
    let (a_ab, a_ac) = (dot(ab, from_a), dot(ac, from_a));
    if a_ab <= 0.0 && a_ac <= 0.0 {
        return [1.0, 0.0, 0.0];
    }
    let from_b = subtract(point, b);
    let (b_ab, b_ac) = (dot(ab, from_b), dot(ac, from_b));
    if b_ab >= 0.0 && b_ac <= b_ab {
        return [0.0, 1.0, 0.0];
    }
    let over_ab = a_ab * b_ac - b_ab * a_ac;
    if over_ab <= 0.0 && a_ab >= 0.0 && b_ab <= 0.0 {
        let part = a_ab / (a_ab - b_ab);
        return [1.0 - part, part, 0.0];
    }
    let from_c = subtract(point, c);
    let (c_ab, c_ac) = (dot(ab, from_c), dot(ac, from_c));
    if c_ac >= 0.0 && c_ab <= c_ac {
        return [0.0, 0.0, 1.0];
    }
    let over_ac = c_ab * a_ac - a_ab * c_ac;
    if over_ac <= 0.0 && a_ac >= 0.0 && c_ac <= 0.0 {
        let part = a_ac / (a_ac - c_ac);
        return [1.0 - part, 0.0, part];
    }
    let over_bc = b_ab * c_ac - c_ab * b_ac;
    let (towards_c, towards_b) = (b_ac - b_ab, c_ab - c_ac);
    if over_bc <= 0.0 && towards_c >= 0.0 && towards_b >= 0.0 {
        let part = towards_c / (towards_c + towards_b);
        return [0.0, 1.0 - part, part];
    }
    let total = over_ab + over_ac + over_bc;
    [over_bc / total, over_ac / total, over_ab / total]
}

/// Parameters from 0 to 1 of the nearest points of two segments.
///
/// The cases are those of Ericson, "Real-Time Collision Detection" (2005), section 5.1.9, without segments of zero
/// length, which the springs of the cloth prevent.
fn nearest_parts([a, b]: [Point; 2], [c, d]: [Point; 2]) -> (f64, f64) {
    let (first, second, between) = (subtract(b, a), subtract(d, c), subtract(a, c));
    let (first_squared, second_squared) = (dot(first, first), dot(second, second));
    let product = dot(first, second);
    let (on_first, on_second) = (dot(first, between), dot(second, between));
    let determinant = first_squared * second_squared - product * product;
    let part = if determinant > 0.0 {
        ((product * on_second - on_first * second_squared) / determinant).clamp(0.0, 1.0)
    } else {
        0.0
    };
    let other_part = (product * part + on_second) / second_squared;
    let clamped = other_part.clamp(0.0, 1.0);
    if clamped == other_part {
        (part, other_part)
    } else {
        let part = (product * clamped - on_first) / first_squared;
        (part.clamp(0.0, 1.0), clamped)
    }
}

/// Whether the bounding boxes of two segments are less than `margin` apart along every axis.
fn are_boxes_near([a, b]: [Point; 2], [c, d]: [Point; 2], margin: f64) -> bool {
    (0..3).all(|axis| {
        a[axis].max(b[axis]) + margin > c[axis].min(d[axis]) && c[axis].max(d[axis]) + margin > a[axis].min(b[axis])
    })
}

/// The weighted sum of `points`.
fn weighted<const N: usize>(points: &[Point; N], weights: &[f64; N]) -> Point {
    points.iter().zip(weights).fold([0.0; 3], |sum, (point, weight)| add_scaled(sum, *point, *weight))
}

fn distance(a: Point, b: Point) -> f64 {
    let between = subtract(a, b);
    dot(between, between).sqrt()
}

fn dot(a: Point, b: Point) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn subtract(a: Point, b: Point) -> Point {
    std::array::from_fn(|axis| a[axis] - b[axis])
}

fn scaled(a: Point, factor: f64) -> Point {
    a.map(|value| value * factor)
}

fn add_scaled(a: Point, b: Point, factor: f64) -> Point {
    std::array::from_fn(|axis| a[axis] + b[axis] * factor)
}
