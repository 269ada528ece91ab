//! The shortest way out of a union of convex parts, for a point inside.
//!
//! Outside a convex part means beyond one of its planes. The nearest point outside all parts is therefore, for some
//! choice of one plane for each part in the way, the projection onto what is beyond all chosen planes. The choices are
//! searched depth first, and cut off once they are farther than the best. For curved parts, the planes nearest to the
//! current point represent all. This may lead a little farther than needed, never to a point inside.

use glam::DVec3;

use super::{
    ShapeGeometry, ShapeProximity,
    compound::{Compound, Part},
    rounded,
};

/// More planes than this at once do not determine a point.
const MOST_PLANES: usize = 3;

/// Bisection steps from the size of the whole compound down to the resolution of f64.
const HALVINGS: usize = 60;

/// Share of a seam by which a point on a surface may seem to be inside because of rounding.
const LEFT_ROUNDING: f64 = 1.0e-3;

/// A plane to get beyond: its unit normal, and its height along the normal.
#[derive(Clone, Copy)]
struct Plane {
    normal: DVec3,
    height: f64,
}

struct Search<'a> {
    compound: &'a Compound,
    from: DVec3,
    best: Option<(f64, DVec3)>,
}

impl Compound {
    /// Redirects a contact that leads from one part into another, so that it leads out of the union, to the nearest
    /// point outside. `None` if `point`, its place on the triangle, is outside already.
    pub(super) fn led_out(&self, point: DVec3, proximity: ShapeProximity) -> Option<ShapeProximity> {
        let mut search = Search { compound: self, from: point, best: None };
        search.descend(&mut Vec::with_capacity(MOST_PLANES), point, proximity.normal);
        let place = search.best.map_or_else(|| self.straight_out(point, proximity.normal), |(_, place)| place);
        let way = place - point;
        // A point without a way is on the surface itself, where the direction of the part leads into another part.
        let normal = way.try_normalize()?;
        Some(ShapeProximity { shape_point: place, normal, distance: -way.length(), crossing: false, ..proximity })
    }
}

impl Compound {
    /// Where the shortest of a few straight ways leaves the union, for places that too many parts share for a search.
    fn straight_out(&self, point: DVec3, outward: DVec3) -> DVec3 {
        let axes = [DVec3::X, DVec3::Y, DVec3::Z];
        let directions = axes.into_iter().chain(axes.map(|axis| -axis)).chain([outward]);
        let bounds = self.bounds();
        let across = (bounds.max.as_dvec3() - bounds.min.as_dvec3()).length() + self.seam();
        let leaves_after = |direction: DVec3| {
            let mut gone = 0.0;
            // Each part is left once: a straight line never enters a convex part again.
            for _ in 0..self.parts().len() {
                let (here, past) = (point + direction * gone, point + direction * (gone + self.seam()));
                // Because of rounding, the point may be slightly inside the part that was left last.
                let rounding = LEFT_ROUNDING * self.seam();
                let leads_into =
                    |part: &&Part| part.signed_distance(past) < 0.0 || part.signed_distance(here) < -rounding;
                let Some(part) = self.parts().iter().find(leads_into) else { break };
                let entered = if part.signed_distance(past) < 0.0 { gone + self.seam() } else { gone };
                let (mut inside, mut outside) = (entered, entered + across);
                for _ in 0..HALVINGS {
                    let middle = 0.5 * (inside + outside);
                    let is_inside = part.signed_distance(point + direction * middle) < 0.0;
                    if is_inside { inside = middle } else { outside = middle }
                }
                gone = outside;
            }
            gone
        };
        let ways = directions.map(|direction| (leaves_after(direction), direction));
        let (gone, direction) = ways.min_by(|one, other| one.0.total_cmp(&other.0)).unwrap_or_default();
        point + direction * gone
    }
}

impl Search<'_> {
    /// `place` is the nearest point beyond the chosen planes, and `outward` the direction in which to probe from there.
    fn descend(&mut self, chosen: &mut Vec<Plane>, place: DVec3, outward: DVec3) {
        let distance = place.distance(self.from);
        if self.best.is_some_and(|(best, _)| distance >= best) {
            return;
        }
        let past = place + outward * self.compound.seam();
        let in_the_way = |part: &&Part| part.signed_distance(past) < 0.0;
        let Some(part) = self.compound.parts().iter().find(in_the_way) else {
            self.best = Some((distance, place));
            return;
        };
        if chosen.len() == MOST_PLANES {
            return;
        }
        for plane in planes(part, past) {
            chosen.push(plane);
            if let Some(next) = beyond(self.from, chosen) {
                // Away from every plane that the point is on: the way there may lead down onto a plane where two parts
                // meet.
                let slack = self.compound.seam();
                let touched = chosen.iter().filter(|plane| plane.normal.dot(next) <= plane.height + slack);
                let outward = touched.map(|plane| plane.normal).sum::<DVec3>().try_normalize();
                self.descend(chosen, next, outward.unwrap_or(plane.normal));
            }
            chosen.pop();
        }
    }
}

/// The planes of a part that lead out of it near a point.
fn planes(part: &Part, point: DVec3) -> Vec<Plane> {
    let local = part.inward(point);
    let own: Vec<(DVec3, f64)> = match &part.geometry {
        ShapeGeometry::Rounded { start, end, radius } => {
            let foot = rounded::foot(local, [*start, *end]);
            let square = || (*end - *start).try_normalize().map_or(DVec3::Y, |axis| axis.any_orthonormal_vector());
            let normal = (local - foot).try_normalize().unwrap_or_else(square);
            // Around a segment, any direction perpendicular to it leads out too.
            vec![(normal, normal.dot(foot) + radius)]
        }
        ShapeGeometry::Polytope(polytope) => polytope.planes().collect(),
        ShapeGeometry::Convex(frustum) => frustum.planes(local).to_vec(),
        // Compounds do not contain these.
        ShapeGeometry::HalfSpace { .. } | ShapeGeometry::Compound(_) => Vec::new(),
    };
    let moved = |(normal, height): (DVec3, f64)| {
        let normal_here = part.turned(normal);
        Plane { normal: normal_here, height: normal_here.dot(part.outward(normal * height)) }
    };
    own.into_iter().map(moved).collect()
}

/// The nearest point to `from` that is on or beyond all planes (three at most): the nearest of the projections onto
/// each subset of them that is beyond the others. `None` if there is no such point.
fn beyond(from: DVec3, planes: &[Plane]) -> Option<DVec3> {
    let slack = 1.0e-9 * planes.iter().map(|plane| plane.height.abs()).fold(from.abs().max_element(), f64::max);
    let is_beyond = |point: &DVec3| planes.iter().all(|plane| plane.normal.dot(*point) >= plane.height - slack);
    (0..1 << planes.len())
        .filter_map(|subset: usize| {
            let picked =
                planes.iter().enumerate().filter(|(place, _)| subset >> place & 1 == 1).map(|(_, plane)| *plane);
            projection(from, &picked.collect::<Vec<_>>())
        })
        .filter(is_beyond)
        .min_by(|one, other| one.distance_squared(from).total_cmp(&other.distance_squared(from)))
}

/// The nearest point on all planes. `None` if their normals are linearly dependent.
fn projection(from: DVec3, planes: &[Plane]) -> Option<DVec3> {
    let lift = |plane: &Plane| plane.height - plane.normal.dot(from);
    let determinant_is_clear = |determinant: f64| determinant.abs() > 1.0e-9;
    match planes {
        [] => Some(from),
        [one] => Some(from + one.normal * lift(one)),
        [one, two] => {
            let cosine = one.normal.dot(two.normal);
            let determinant = 1.0 - cosine * cosine;
            let (a, b) = (lift(one), lift(two));
            determinant_is_clear(determinant).then(|| {
                from + one.normal * ((a - cosine * b) / determinant) + two.normal * ((b - cosine * a) / determinant)
            })
        }
        [one, two, three] => {
            let (a, b, c) = (one.normal, two.normal, three.normal);
            let determinant = a.dot(b.cross(c));
            determinant_is_clear(determinant).then(|| {
                from + (b.cross(c) * lift(one) + c.cross(a) * lift(two) + a.cross(b) * lift(three)) / determinant
            })
        }
        _ => None,
    }
}
