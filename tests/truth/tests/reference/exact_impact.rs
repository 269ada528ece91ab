//! Impacts at distance 0, decided with integers only: no rounding, no tolerance, nothing undecided.
//!
//! A vertex is on a face, or two edges meet, if the origin is in the triangle of their differences, or in one of the
//! two triangles of the parallelogram of their differences. Every sign that decides this belongs to a polynomial of
//! time with integer coefficients, so it changes only at roots. Sturm's theorem isolates the roots. The sign of another
//! polynomial at a root is found by refining the root's interval, or it is 0 by a common divisor (Basu, Pollack, Roy,
//! "Algorithms in Real Algebraic Geometry", 2006, chapters 2 and 10).

use glam::DVec3;
use num_bigint::{BigInt, BigUint, Sign};

/// The requested gap between the bounds of a time, as a power of two.
const PRECISION: u64 = 40;

/// How many times a time is halved before common divisors are searched for. Most signs do not need them.
const WITHOUT_DIVISORS: u64 = 60;

/// Coefficients in ascending powers. The last one is not 0. Empty for 0.
type Polynomial = Vec<BigInt>;

/// A vector of polynomials.
type Moving = [Polynomial; 3];

/// Bounds of the first time in 0…1 at which a vertex (the first point) is on the closed triangle of the others, or
/// `None`. Equal bounds are the exact time.
pub fn vertex_face(start: &[DVec3; 4], end: &[DVec3; 4]) -> Option<[f64; 2]> {
    let points = moving_points(start, end);
    let difference = |corner: usize| minus(&points[corner], &points[0]);
    first_time_at_origin(&[difference(1), difference(2), difference(3)])
}

/// The same for two closed edges, of the first two and of the other two points.
pub fn edge_edge(start: &[DVec3; 4], end: &[DVec3; 4]) -> Option<[f64; 2]> {
    let points = moving_points(start, end);
    let difference = |a: usize, b: usize| minus(&points[a], &points[b]);
    let one = first_time_at_origin(&[difference(0, 2), difference(0, 3), difference(1, 3)]);
    let other = first_time_at_origin(&[difference(0, 2), difference(1, 2), difference(1, 3)]);
    earlier(one, other)
}

fn earlier(one: Option<[f64; 2]>, other: Option<[f64; 2]>) -> Option<[f64; 2]> {
    match (one, other) {
        (Some(one), Some(other)) => Some([one[0].min(other[0]), one[1].min(other[1])]),
        _ => one.or(other),
    }
}

fn moving_points(start: &[DVec3; 4], end: &[DVec3; 4]) -> [Moving; 4] {
    let (start, end) = (start.map(|p| p.to_array()), end.map(|p| p.to_array()));
    let all = || start.iter().chain(&end).flatten();
    let unit = all().filter(|coordinate| **coordinate != 0.0).map(|&coordinate| parts(coordinate).1).min().unwrap_or(0);
    let whole = |coordinate: f64| {
        let (mantissa, exponent) = parts(coordinate);
        if mantissa == 0 { BigInt::ZERO } else { BigInt::from(mantissa) << (exponent - unit) }
    };
    std::array::from_fn(|point| {
        std::array::from_fn(|axis| {
            let (from, to) = (whole(start[point][axis]), whole(end[point][axis]));
            trimmed(vec![from.clone(), to - from])
        })
    })
}

/// A finite number as an integer times a power of two.
fn parts(value: f64) -> (i64, i32) {
    let bits = value.to_bits();
    let (exponent, fraction) = ((bits >> 52 & 0x7ff) as i32, (bits & ((1 << 52) - 1)).cast_signed());
    let (mantissa, exponent) = if exponent == 0 { (fraction, -1074) } else { (fraction | 1 << 52, exponent - 1075) };
    let zeros = if mantissa == 0 { 0 } else { mantissa.trailing_zeros() };
    (if value < 0.0 { -(mantissa >> zeros) } else { mantissa >> zeros }, exponent + zeros.cast_signed())
}

/// The first time at which the origin is in the closed triangle of three moving points.
fn first_time_at_origin(corners: &[Moving; 3]) -> Option<[f64; 2]> {
    let [x, y, z] = corners;
    let faces = [cross(x, y), cross(y, z), cross(z, x)];
    let volume = dot(x, &faces[1]);
    let normal = [0, 1, 2].map(|axis| plus(&plus(&faces[0][axis], &faces[1][axis]), &faces[2][axis]));
    let sides = [0, 1, 2].map(|k| dot(&faces[k], &normal));
    let products = [dot(x, y), dot(y, z), dot(z, x)];
    let is_inside = |time: &mut Time| {
        if time.sign_of(&volume) != Sign::NoSign {
            return false;
        }
        if normal.iter().all(|coordinate| time.sign_of(coordinate) == Sign::NoSign) {
            // The corners are collinear: the triangle is the union of its edges.
            return (0..3).any(|k| {
                faces[k].iter().all(|coordinate| time.sign_of(coordinate) == Sign::NoSign)
                    && time.sign_of(&products[k]) != Sign::Plus
            });
        }
        sides.iter().all(|side| time.sign_of(side) != Sign::Minus)
    };
    let mut first = Time::whole(0);
    if is_inside(&mut first) {
        return Some([0.0, 0.0]);
    }
    // If the volume is not identically 0, it must be 0 at that time. Otherwise, any of the signs can change there.
    let candidates: Vec<&Polynomial> = if volume.is_empty() {
        normal.iter().chain(&sides).chain(&products).chain(faces.iter().flatten()).collect()
    } else {
        vec![&volume]
    };
    candidates
        .into_iter()
        .flat_map(roots)
        .filter_map(|mut root| is_inside(&mut root).then(|| root.bounds()))
        .fold(None, |first, bounds| earlier(first, Some(bounds)))
}

/// The only root of a polynomial between two times with a common denominator, a power of two, or an exact time.
struct Time {
    polynomial: Polynomial,
    /// The sign of the polynomial at `from`.
    before: Sign,
    from: BigInt,
    to: BigInt,
    exponent: u64,
}

impl Time {
    fn whole(time: i32) -> Self {
        Self {
            polynomial: Vec::new(),
            before: Sign::NoSign,
            from: BigInt::from(time),
            to: BigInt::from(time),
            exponent: 0,
        }
    }

    fn is_known(&self) -> bool {
        self.from == self.to
    }

    fn halve(&mut self) {
        let middle = &self.from + &self.to;
        self.exponent += 1;
        (self.from, self.to) = match sign_at(&self.polynomial, &middle, self.exponent) {
            Sign::NoSign => (middle.clone(), middle),
            now if now == self.before => (middle, &self.to << 1),
            _ => (&self.from << 1, middle),
        };
    }

    fn sign_of(&mut self, other: &Polynomial) -> Sign {
        if other.is_empty() {
            return Sign::NoSign;
        }
        // An upper bound of the slope in 0…1. A value that such a slope cannot bring to 0 keeps its sign.
        let steepest: BigInt =
            (0u32..).zip(other).map(|(power, coefficient)| coefficient.magnitude() * power).sum::<BigUint>().into();
        while !self.is_known() && self.exponent < WITHOUT_DIVISORS {
            let value = value_at(other, &self.from, self.exponent);
            let scale = self.exponent * (other.len() as u64).saturating_sub(2);
            if BigInt::from(value.magnitude().clone()) > (&steepest * (&self.to - &self.from)) << scale {
                return value.sign();
            }
            self.halve();
        }
        if !self.is_known() {
            let at = |polynomial: &Polynomial, time: &BigInt| sign_at(polynomial, time, self.exponent);
            let common = greatest_common_divisor(&self.polynomial, other);
            // Its roots are roots of the polynomial, so none is at a bound.
            if at(&common, &self.from) != at(&common, &self.to) {
                return Sign::NoSign;
            }
        }
        let chain = sturm_chain(other);
        while !self.is_known() {
            let sign = sign_at(other, &self.from, self.exponent);
            if sign != Sign::NoSign
                && sign_at(other, &self.to, self.exponent) != Sign::NoSign
                && changes(&chain, &self.from, self.exponent) == changes(&chain, &self.to, self.exponent)
            {
                return sign;
            }
            self.halve();
        }
        sign_at(other, &self.from, self.exponent)
    }

    fn bounds(mut self) -> [f64; 2] {
        while !self.is_known() && self.exponent < PRECISION {
            self.halve();
        }
        // An exact time with more digits is rounded outwards by more than its rounding.
        let value = |time: &BigInt| {
            let shift = self.exponent.saturating_sub(PRECISION);
            let digits = u64::try_from(time >> shift).expect("a time is in 0…1 and has few digits left");
            digits as f64 / (1u64 << (self.exponent - shift)) as f64
        };
        let one_step = if self.exponent > PRECISION { 1.0 / (1u64 << PRECISION) as f64 } else { 0.0 };
        [value(&self.from), value(&self.to) + one_step]
    }
}

/// The roots of a polynomial in 0…1.
fn roots(polynomial: &Polynomial) -> Vec<Time> {
    if polynomial.len() < 2 {
        return Vec::new();
    }
    let mut simple = polynomial.clone();
    let mut chain = sturm_chain(&simple);
    let repeated = chain.last().expect("it is not empty");
    if repeated.len() > 1 {
        simple = primitive(&quotient(polynomial, repeated));
        chain = sturm_chain(&simple);
    }
    let mut roots = Vec::new();
    if sign_at(&simple, &BigInt::ZERO, 0) == Sign::NoSign {
        roots.push(Time::whole(0));
    }
    // Sturm's theorem counts the roots after the start of a span, up to and including its end.
    let mut spans = vec![(BigInt::ZERO, BigInt::from(1), 0u64)];
    while let Some((from, to, exponent)) = spans.pop() {
        let count = changes(&chain, &from, exponent) - changes(&chain, &to, exponent);
        if count == 0 {
            continue;
        }
        if count == 1 {
            if sign_at(&simple, &to, exponent) == Sign::NoSign {
                roots.push(Time { polynomial: Vec::new(), before: Sign::NoSign, from: to.clone(), to, exponent });
                continue;
            }
            let before = sign_at(&simple, &from, exponent);
            if before != Sign::NoSign {
                roots.push(Time { polynomial: simple.clone(), before, from, to, exponent });
                continue;
            }
        }
        let middle = &from + &to;
        spans.push((from << 1, middle.clone(), exponent + 1));
        spans.push((middle, to << 1, exponent + 1));
    }
    roots
}

fn trimmed(mut polynomial: Polynomial) -> Polynomial {
    while polynomial.last().is_some_and(|last| last.sign() == Sign::NoSign) {
        polynomial.pop();
    }
    polynomial
}

fn combined(a: &Polynomial, b: &Polynomial, combine: impl Fn(&BigInt, &BigInt) -> BigInt) -> Polynomial {
    let power = |polynomial: &Polynomial, k: usize| polynomial.get(k).cloned().unwrap_or(BigInt::ZERO);
    trimmed((0..a.len().max(b.len())).map(|k| combine(&power(a, k), &power(b, k))).collect())
}

fn plus(a: &Polynomial, b: &Polynomial) -> Polynomial {
    combined(a, b, |a, b| a + b)
}

fn less(a: &Polynomial, b: &Polynomial) -> Polynomial {
    combined(a, b, |a, b| a - b)
}

fn times(a: &Polynomial, b: &Polynomial) -> Polynomial {
    if a.is_empty() || b.is_empty() {
        return Vec::new();
    }
    let mut product = vec![BigInt::ZERO; a.len() + b.len() - 1];
    for (i, one) in a.iter().enumerate() {
        for (j, other) in b.iter().enumerate() {
            product[i + j] += one * other;
        }
    }
    product
}

fn minus(a: &Moving, b: &Moving) -> Moving {
    std::array::from_fn(|axis| less(&a[axis], &b[axis]))
}

fn dot(a: &Moving, b: &Moving) -> Polynomial {
    (0..3).fold(Vec::new(), |sum, axis| plus(&sum, &times(&a[axis], &b[axis])))
}

fn cross(a: &Moving, b: &Moving) -> Moving {
    [(1, 2), (2, 0), (0, 1)].map(|(i, j)| less(&times(&a[i], &b[j]), &times(&a[j], &b[i])))
}

fn derivative(polynomial: &Polynomial) -> Polynomial {
    polynomial.iter().enumerate().skip(1).map(|(power, coefficient)| coefficient * power).collect()
}

/// The sign at `numerator` / 2^`exponent`.
fn sign_at(polynomial: &Polynomial, numerator: &BigInt, exponent: u64) -> Sign {
    value_at(polynomial, numerator, exponent).sign()
}

/// The value at `numerator` / 2^`exponent`, times 2^`exponent` to the power of the degree.
fn value_at(polynomial: &Polynomial, numerator: &BigInt, exponent: u64) -> BigInt {
    let mut value = BigInt::ZERO;
    for (lowered, coefficient) in (0u64..).zip(polynomial.iter().rev()) {
        value = value * numerator + (coefficient << (lowered * exponent));
    }
    value
}

/// A positive multiple of the remainder of a division.
fn remainder(dividend: &Polynomial, divisor: &Polynomial) -> Polynomial {
    let leading = divisor.last().expect("the divisor is not 0");
    let positive = BigInt::from(leading.magnitude().clone());
    let mut rest = dividend.clone();
    while rest.len() >= divisor.len() {
        let shift = rest.len() - divisor.len();
        let last = rest.last().expect("it is at least as long as the divisor");
        let factor = if leading.sign() == Sign::Minus { -last } else { last.clone() };
        for coefficient in &mut rest {
            *coefficient *= &positive;
        }
        for (k, coefficient) in divisor.iter().enumerate() {
            rest[k + shift] -= &factor * coefficient;
        }
        rest = trimmed(rest);
    }
    rest
}

/// Divides the coefficients by their common divisor.
fn primitive(polynomial: &Polynomial) -> Polynomial {
    let content = polynomial.iter().fold(BigInt::ZERO, |content, coefficient| {
        let (mut divisor, mut rest) = (content, coefficient.clone());
        while rest.sign() != Sign::NoSign {
            (divisor, rest) = (rest.clone(), divisor % rest);
        }
        divisor
    });
    let content = BigInt::from(content.magnitude().clone());
    polynomial.iter().map(|coefficient| coefficient / &content).collect()
}

fn greatest_common_divisor(a: &Polynomial, b: &Polynomial) -> Polynomial {
    let (mut a, mut b) = (a.clone(), b.clone());
    while !b.is_empty() {
        (a, b) = (b.clone(), remainder(&a, &b));
    }
    a
}

/// A multiple of the quotient of a division without remainder.
fn quotient(dividend: &Polynomial, divisor: &Polynomial) -> Polynomial {
    let leading = divisor.last().expect("the divisor is not 0");
    let mut rest = dividend.clone();
    let mut quotient = vec![BigInt::ZERO; dividend.len() + 1 - divisor.len()];
    while rest.len() >= divisor.len() {
        let shift = rest.len() - divisor.len();
        let factor = rest.last().expect("it is at least as long as the divisor").clone();
        for coefficient in quotient.iter_mut().chain(&mut rest) {
            *coefficient *= leading;
        }
        for (k, coefficient) in divisor.iter().enumerate() {
            rest[k + shift] -= &factor * coefficient;
        }
        quotient[shift] += factor;
        rest = trimmed(rest);
    }
    assert!(rest.is_empty(), "the division leaves no remainder");
    quotient
}

fn sturm_chain(polynomial: &Polynomial) -> Vec<Polynomial> {
    let mut chain = vec![polynomial.clone()];
    let mut next = derivative(polynomial);
    while !next.is_empty() {
        let following = remainder(chain.last().expect("it is not empty"), &next).into_iter().map(|k| -k).collect();
        chain.push(next);
        next = following;
    }
    chain
}

/// The number of sign changes along a Sturm chain.
fn changes(chain: &[Polynomial], numerator: &BigInt, exponent: u64) -> usize {
    let signs: Vec<Sign> =
        chain.iter().map(|p| sign_at(p, numerator, exponent)).filter(|&sign| sign != Sign::NoSign).collect();
    signs.windows(2).filter(|pair| pair[0] != pair[1]).count()
}

#[test]
fn times_are_those_of_known_polynomials() {
    let whole = |coefficients: &[i64]| trimmed(coefficients.iter().map(|&k| BigInt::from(k)).collect());
    let bounds = |coefficients: &[i64]| {
        let mut found: Vec<[f64; 2]> = roots(&whole(coefficients)).into_iter().map(Time::bounds).collect();
        found.sort_by(|a, b| a[0].total_cmp(&b[0]));
        found
    };
    // (2t − 1)(4t − 3)t, (2t − 1)³, t² + t − 1, t² + 1, and a polynomial with its roots outside.
    assert_eq!(bounds(&[0, 3, -10, 8]), [[0.0; 2], [0.5; 2], [0.75; 2]]);
    assert_eq!(bounds(&[-1, 6, -12, 8]), [[0.5; 2]]);
    let golden = bounds(&[-1, 1, 1]);
    assert_eq!(golden.len(), 1);
    let known = 0.5 * (5f64.sqrt() - 1.0);
    assert!(golden[0][0] <= known && known <= golden[0][1] && golden[0][1] - golden[0][0] < 1.0e-12);
    assert!(bounds(&[1, 0, 1]).is_empty() && bounds(&[-3, 1]).is_empty() && bounds(&[7]).is_empty());
    // Two roots 2^-40 apart around 1/3: (3t − 1)(3·2^40 t − 2^40 − 3).
    let unit = 1i64 << 40;
    assert_eq!(bounds(&[unit + 3, -6 * unit - 9, 9 * unit]).len(), 2);
    // The sign of another polynomial at a root: t − 1/2 and (2t − 1)(t² + t − 1) at the golden ratio.
    let mut time = roots(&whole(&[-1, 1, 1])).pop().expect("the polynomial has a root");
    assert_eq!(time.sign_of(&whole(&[-1, 2])), Sign::Plus);
    assert_eq!(time.sign_of(&whole(&[1, -2])), Sign::Minus);
    assert_eq!(time.sign_of(&times(&whole(&[-1, 2]), &whole(&[-1, 1, 1]))), Sign::NoSign);
}
