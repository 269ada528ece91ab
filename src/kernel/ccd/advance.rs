//! How long a moving convex hull stays away from the origin, and when a moving polygon reaches it.
//!
//! The innermost question of continuous detection: the differences between the points of two features form such a
//! polygon. The method is additive continuous collision detection (M. Li, D. Kaufman, C. Jiang, "Codimensional
//! Incremental Potential Contact", 2021, section 5): from a time at which the origin is clear, advance by a step that
//! is certainly clear too, and add up the steps. That method divides the distance by the speeds of the corners. Here a
//! plane between origin and polygon bounds the step, and turns with the polygon: see [`Plane::clear_for`]. On recorded
//! impacts this takes 4 to 5 steps where speeds take 35 to 250, more for a smaller impact distance. It also passes a
//! near miss instead of creeping up to it, so a separation of zero needs no such distance.

use glam::DVec3;

/// Half the distance from 1 to the next f64: the relative error of one rounded operation.
const ROUNDING: f64 = f64::EPSILON / 2.0;

/// Bound of the error in the height of a corner over a plane, if the normal has unit length and no coordinate exceeds
/// 1.
///
/// In units of [`ROUNDING`]: a corner is off by 8 in each coordinate (1 for the start, 4 for the rate, 2 for the
/// product, and 1 for the sum), which makes 8√3 along a unit vector. The dot product adds 3√3, and a time rounded to
/// its last bit moves a corner by √3. Together below 21; the rest is reserve.
pub(super) const HEIGHT_ERROR: f64 = 64.0 * ROUNDING;

/// What a step adds to that bound per unit of time, for a plane at rest and per unit of its turning.
///
/// In units of [`ROUNDING`]: the height changes by the normal times the rate (error 4√3, sums 3·2√3), and by the
/// turning times corner and rate (8√3 + 3√3, and as much as before). Adding the terms rounds 3 times. The root is that
/// of an equation whose coefficients are off by 5 and 12 times their last bit. Together below 47 at rest, and below 92
/// for the turning.
const STEP_ERROR: f64 = 128.0 * ROUNDING;

/// Separations are multiplied by this, because normals and their lengths are rounded.
pub(super) const LENGTH_SLACK: f64 = 1.0 + 16.0 * ROUNDING;

/// Features this close to the separation count as within it, relative to the largest coordinate difference between the
/// two features over the step: about 1.4e-14. Rounding of directions at corners and on slivers can add to that: of half
/// a million synthetic impacts, the farthest was reported at a distance of 1e-13.
pub const RESOLUTION: f64 = 2.0 * HEIGHT_ERROR;

/// Points of a polygon are equally close if their squared distances differ by no more than this share.
const TIE: f64 = 16.0 * ROUNDING;

/// The cosine of an angle between a side and the connection to its end that counts as a right angle: what [`TIE`]
/// leaves undecided.
const NEARLY_ACROSS: f64 = 1.0e-7;

/// Steps after which the search gives up, and reports the time that it has reached as an impact. Recorded impacts take
/// at most 19. Of synthetic impacts that graze within 1e-12 of their speed, one in a thousand takes more than 120.
pub const MOST_STEPS: u32 = 512;

/// Why the search for a time of impact ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum ImpactCause {
    /// The features are within the separation at the start of the step. The time is 0, however they move on.
    Within,
    /// An edge pierces a face at the start of the step. The time is 0, however they move on.
    Crossing,
    /// They come within the separation.
    Reached,
    /// The search was stopped after [`MOST_STEPS`]. The features do not come within the separation before this time,
    /// but may do so at this time, later, or not at all.
    Undecided,
}

/// Where the search for a polygon ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Arrival {
    /// The polygon is clear up to this time, 0 to 1.
    pub time: f64,
    pub cause: ImpactCause,
    /// Unit vector from the origin toward the polygon, perpendicular to a plane that has separated them until this
    /// time. Zero if the origin is in the polygon at the start.
    pub normal: DVec3,
    /// The polygon's point closest to the origin, as shares of the edges from the first corner to the second and to the
    /// last.
    pub place: [f64; 2],
    /// The number of steps.
    pub steps: u32,
}

/// The convex hull of corners that move in straight lines from time 0 to time 1.
pub(super) struct MovingHull<const CORNERS: usize> {
    start: [DVec3; CORNERS],
    rate: [DVec3; CORNERS],
    /// Power of two by which coordinates were multiplied so that none exceeds 1. This is exact.
    scale: f64,
}

/// A plane through the origin, with its normal on the hull's side.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plane {
    /// Unit vector, or zero if there is no direction.
    normal: DVec3,
    /// Rate of change of the normal, to first order.
    turning: DVec3,
}

impl Plane {
    /// The plane whose normal has the direction of `across`, which changes at the rate `change`.
    pub fn new(across: DVec3, change: DVec3) -> Self {
        let length = across.length();
        let (normal, turning) = (across / length, change / length);
        if !(length > 0.0 && normal.is_finite()) {
            return Self { normal: DVec3::ZERO, turning: DVec3::ZERO };
        }
        Self { normal, turning: if turning.is_finite() { turning } else { DVec3::ZERO } }
    }

    /// The same plane at rest.
    fn at_rest(self) -> Self {
        Self { turning: DVec3::ZERO, ..self }
    }

    /// Height of the lowest corner.
    fn height(&self, corners: &[DVec3]) -> f64 {
        corners.iter().map(|corner| self.normal.dot(*corner)).fold(f64::INFINITY, f64::min)
    }

    /// Its normal after a step of time.
    fn normal_after(&self, step: f64) -> DVec3 {
        (self.normal + self.turning * step).normalize_or(self.normal)
    }

    /// How long every corner certainly stays more than `separation` above the origin, by the turning plane, and by the
    /// plane at rest. Infinite if forever.
    ///
    /// With the normal `n + s m` after a time `s`, and a corner `c + s w`, the corner's height is the polynomial
    /// `n·c + s (n·w + m·c) + s² m·w`, and `separation · |n + s m|` is at most
    /// `separation · (1 + s n·m + s² |m|² / 2)`, because `√(1 + x) ≤ 1 + x / 2`. Until the first root of the
    /// difference, less the bounds of rounding errors, every corner is beyond a plane that is `separation` away from
    /// the origin, and so is the hull.
    fn clear_for(&self, corners: &[DVec3], rates: &[DVec3], separation: f64) -> Clear {
        let turning_squared = self.turning.length_squared();
        let turning_length = turning_squared.sqrt();
        let constant = separation + HEIGHT_ERROR;
        let linear = separation * (self.normal.dot(self.turning) + 16.0 * ROUNDING * turning_length)
            + STEP_ERROR * (1.0 + turning_length);
        let quadratic = 0.5 * separation * turning_squared * LENGTH_SLACK;
        let mut clear = Clear { turning: f64::INFINITY, at_rest: f64::INFINITY };
        for (corner, rate) in corners.iter().zip(rates) {
            let height = self.normal.dot(*corner) - constant;
            let rise = self.normal.dot(*rate);
            let change = rise + self.turning.dot(*corner) - linear;
            let root = first_positive_root(height, change, self.turning.dot(*rate) - quadratic);
            clear.turning = clear.turning.min(root);
            clear.at_rest = clear.at_rest.min(first_positive_root(height, rise - STEP_ERROR, 0.0));
        }
        clear
    }
}

/// How long a plane keeps a hull away from the origin.
#[derive(Clone, Copy, Debug)]
struct Clear {
    turning: f64,
    at_rest: f64,
}

/// The first root above 0 of `constant + linear s + quadratic s²`. Infinite if there is none, and 0 if the constant is
/// not positive. Every value before the root is positive. NaN among the coefficients makes it 0.
fn first_positive_root(constant: f64, linear: f64, quadratic: f64) -> f64 {
    if constant.is_nan() || constant <= 0.0 {
        return 0.0;
    }
    let discriminant = linear * linear - 4.0 * constant * quadratic;
    // With a positive slope, a root is ahead only if the parabola opens downward.
    if discriminant < 0.0 || linear >= 0.0 && quadratic >= 0.0 {
        return f64::INFINITY;
    }
    // Both forms add numbers of one sign, so the root is that of coefficients changed in their last bits.
    let root = discriminant.sqrt();
    let step = if linear <= 0.0 { 2.0 * constant / (root - linear) } else { (-root - linear) / (2.0 * quadratic) };
    if step.is_nan() { 0.0 } else { step }
}

impl<const CORNERS: usize> MovingHull<CORNERS> {
    /// `None` if a coordinate is not finite, or too large to be doubled.
    pub fn new(start: [DVec3; CORNERS], end: [DVec3; CORNERS]) -> Option<Self> {
        let reach =
            |corners: &[DVec3; CORNERS]| corners.iter().fold(DVec3::ZERO, |reach, corner| reach.max(corner.abs()));
        let finite = |corners: &[DVec3; CORNERS]| corners.iter().all(|corner| corner.is_finite());
        let largest = reach(&start).max(reach(&end)).max_element();
        if !(finite(&start) && finite(&end) && largest < f64::MAX / 2.0) {
            return None;
        }
        let scale = scale_to_one(largest);
        let start = start.map(|corner| corner * scale);
        let mut rate = end.map(|corner| corner * scale);
        for corner in 0..CORNERS {
            rate[corner] -= start[corner];
        }
        Some(Self { start, rate, scale })
    }

    /// Converts a separation to the hull's own unit.
    fn scaled(&self, separation: f64) -> f64 {
        separation * self.scale * LENGTH_SLACK
    }

    /// How long from the start a plane certainly keeps the hull more than `separation` away from the origin, on the
    /// side of the plane where more of the hull starts.
    pub fn clear_from_start(&self, plane: Plane, separation: f64) -> f64 {
        let middle: DVec3 = self.start.iter().sum();
        let plane = if plane.normal.dot(middle) < 0.0 {
            Plane { normal: -plane.normal, turning: -plane.turning }
        } else {
            plane
        };
        let clear = plane.clear_for(&self.start, &self.rate, self.scaled(separation));
        clear.turning.max(clear.at_rest)
    }

    fn at(&self, time: f64) -> [DVec3; CORNERS] {
        std::array::from_fn(|corner| self.start[corner] + self.rate[corner] * time)
    }

    /// The time in `from..=until` at which the polygon first comes within `separation` of the origin, or somewhat
    /// earlier. The corners must be in one plane and in cyclic order, as in a triangle or a parallelogram. The polygon
    /// must be clear before `from`.
    pub fn arrival(&self, separation: f64, from: f64, until: f64) -> Option<Arrival> {
        let separation = self.scaled(separation);
        let mut time = from;
        let mut steps = 0;
        let mut approach = None;
        loop {
            let corners = self.at(time);
            let closest = Closest::new(&corners, &self.rate);
            let planes = [closest.boundary, closest.face].map(|plane| (plane.height(&corners), plane));
            let (height, highest) = if planes[1].0 > planes[0].0 { planes[1] } else { planes[0] };
            // Written so that NaN counts as an impact.
            let is_clear = height > separation + RESOLUTION;
            let mut step = 0.0_f64;
            if is_clear && steps < MOST_STEPS {
                let remaining = until - time;
                let mut leading = highest;
                for (height, plane) in planes {
                    if height <= separation {
                        continue;
                    }
                    let clear = plane.clear_for(&corners, &self.rate, separation);
                    for (clear, plane) in [(clear.turning, plane), (clear.at_rest, plane.at_rest())] {
                        if clear > remaining {
                            return None;
                        }
                        if clear > step {
                            (step, leading) = (clear, plane);
                        }
                    }
                }
                approach = Some(leading.normal_after(step));
            }
            if time + step > time {
                time += step;
                steps += 1;
                continue;
            }
            let cause = match (is_clear, time > 0.0) {
                (false, false) => ImpactCause::Within,
                (false, true) => ImpactCause::Reached,
                (true, _) => ImpactCause::Undecided,
            };
            let place = closest.place(&corners);
            return Some(Arrival { time, cause, normal: approach.unwrap_or(highest.normal), place, steps });
        }
    }
}

/// The point of a polygon's boundary that is closest to the origin, and two planes. The higher one is the highest of
/// all planes between origin and polygon, and its height is their distance.
struct Closest {
    side: usize,
    along: f64,
    /// Perpendicular to the connection of the origin with that point.
    boundary: Plane,
    /// Parallel to the polygon.
    face: Plane,
}

impl Closest {
    fn new<const CORNERS: usize>(corners: &[DVec3; CORNERS], rates: &[DVec3; CORNERS]) -> Self {
        let is_inside = |along: f64| along > 0.0 && along < 1.0;
        let edge_of = |side: usize| corners[(side + 1) % CORNERS] - corners[side];
        let (mut point, mut distance_squared, mut side, mut along) = (DVec3::INFINITY, f64::INFINITY, 0, 0.0);
        for corner in 0..CORNERS {
            let edge = edge_of(corner);
            let squared = edge.length_squared();
            let share = if squared > 0.0 { (-corners[corner].dot(edge) / squared).clamp(0.0, 1.0) } else { 0.0 };
            let candidate = corners[corner] + edge * share;
            // Rounding hides how little closer the inside of a side is than a corner near it.
            let favor = match (is_inside(share), is_inside(along)) {
                (true, false) => 1.0 + TIE,
                (false, true) => 1.0 - TIE,
                _ => 1.0,
            };
            if candidate.length_squared() < distance_squared * favor {
                (point, distance_squared, side, along) = (candidate, candidate.length_squared(), corner, share);
            }
        }
        let next = (side + 1) % CORNERS;
        let mut change = rates[side].lerp(rates[next], along);
        // If the features are close, rounding leaves too much of a side's direction in the connection.
        if is_inside(along) {
            let edge = edge_of(side);
            // The closest point slides along the side, so that the connection stays perpendicular to it.
            change -= edge * ((change.dot(edge) + point.dot(rates[next] - rates[side])) / edge.length_squared());
            point = part_across(point, edge);
        } else {
            let corner = if along > 0.0 { next } else { side };
            for edge in [edge_of(corner), edge_of((corner + CORNERS - 1) % CORNERS)] {
                // Removes what rounding may have added, which is everything if the features nearly touch.
                let lean = NEARLY_ACROSS * distance_squared.sqrt() + 16.0 * ROUNDING;
                if point.dot(edge).abs() <= lean * edge.length() {
                    point = part_across_or_all(point, edge);
                }
            }
        }
        let last = CORNERS - 1;
        let [first_edge, last_edge] = [corners[1] - corners[0], corners[last] - corners[0]];
        let [first_change, last_change] = [rates[1] - rates[0], rates[last] - rates[0]];
        let normal = across_both(first_edge, last_edge);
        let turning = first_change.cross(last_edge) + first_edge.cross(last_change);
        let face = Plane::new(normal, turning);
        let side_of_polygon = if normal.dot(corners[0]) < 0.0 { -1.0 } else { 1.0 };
        let face = Plane { normal: face.normal * side_of_polygon, turning: face.turning * side_of_polygon };
        Self { side, along, boundary: Plane::new(point, change), face }
    }

    /// The closest point, as shares of the edges from the first corner to the second and to the last.
    fn place<const CORNERS: usize>(&self, corners: &[DVec3; CORNERS]) -> [f64; 2] {
        let (along, rest) = (self.along, 1.0 - self.along);
        let on_boundary = match (CORNERS, self.side) {
            (_, 0) => [along, 0.0],
            (3, 1) => [rest, along],
            (_, 1) => [1.0, along],
            (4, 2) => [rest, 1.0],
            _ => [0.0, rest],
        };
        // One share after the other: the second compensates for the rounding of the first on a sliver.
        let [first_edge, last_edge] = [corners[1] - corners[0], corners[CORNERS - 1] - corners[0]];
        let across = part_across(last_edge, first_edge);
        let last = limited(-corners[0].dot(across) / across.dot(last_edge), 1.0);
        let most = if CORNERS == 3 { 1.0 - last } else { 1.0 };
        let rest = corners[0] + last_edge * last;
        let first = limited(-rest.dot(first_edge) / first_edge.length_squared(), most);
        let distance = |[first, last]: [f64; 2]| (corners[0] + first_edge * first + last_edge * last).length_squared();
        if distance([first, last]) < distance(on_boundary) { [first, last] } else { on_boundary }
    }
}

/// A share clamped between 0 and `most`. 0 for the NaN of an edge without length.
fn limited(share: f64, most: f64) -> f64 {
    if share > 0.0 { share.min(most) } else { 0.0 }
}

/// The component of a vector that is perpendicular to a direction. The second pass removes what rounding left in the
/// first, which is everything if the two are nearly parallel.
fn part_across(vector: DVec3, direction: DVec3) -> DVec3 {
    let inverse = direction.length_squared().recip();
    let once = vector - direction * (vector.dot(direction) * inverse);
    once - direction * (once.dot(direction) * inverse)
}

/// Like [`part_across`], or the whole vector if there is no direction.
fn part_across_or_all(vector: DVec3, direction: DVec3) -> DVec3 {
    let across = part_across(vector, direction);
    if across.is_finite() { across } else { vector }
}

/// The cross product of two vectors, made as perpendicular to both as f64 allows, even if they are nearly parallel.
fn across_both(first: DVec3, second: DVec3) -> DVec3 {
    let product = first.cross(second);
    let across_first = part_across(product, first);
    let rest = part_across(second, first);
    let across = across_first - rest * (across_first.dot(second) / rest.dot(second));
    if across.is_finite() { across } else { product }
}

/// A power of two that scales a positive number to between ½ and 1, or as near to that as f64 allows. 1 for 0.
fn scale_to_one(value: f64) -> f64 {
    const EXPONENT: u64 = 0x7FF << 52;
    if value > 0.0 { 0.5 / f64::from_bits(value.to_bits() & EXPONENT).max(f64::MIN_POSITIVE) } else { 1.0 }
}
