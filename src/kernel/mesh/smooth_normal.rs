//! Contact normals of the smooth surfaces that meshes stand for, free of the bumps that inner edges give.
//!
//! A vertex has the normal of the sphere on which it and its neighbors lie, as far as they lie on one (Max, "Weights for
//! computing vertex normals from facet normals", 1999); inside a face, barycentric weights blend the three: exactly
//! radial on a sphere, exactly the normal of a plane, and continuous over inner edges. Creases stay sharp. What one side
//! says is weighed against the other by the radii of curvature, as the line through the centers of two spheres runs.
//! Reads a contact's places and the positions around them, after everything else and only on request.

use glam::{DQuat, DVec3, Vec3};

use self::fan::{Across, Fan};
use super::{barycentric::point_at, feature::Feature, topology::SurfaceTopology};
use crate::kernel::pose::Pose;

mod fan;

/// Two unit normals that differ by less count as one, in radians: above what rounding of positions tilts the faces of a
/// flat mesh, far below what tilts a body.
const FLAT: f64 = 1.0e-4;

/// Squared sine below which two directions are the same direction.
const SAME_DIRECTION: f64 = 1.0e-24;

/// How far a direction may lie beyond a plane of a cone and still count as inside, as a sine: rounding of f64.
const INSIDE_SLACK: f64 = 1.0e-12;

/// Which edges are creases: those bent by at least an angle. Up to half that angle an edge is an inner edge of a curved
/// surface; in between it fades from one to the other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CreaseAngle {
    /// Squared distances of two unit normals at half the angle and at the angle.
    from: f64,
    to: f64,
}

impl CreaseAngle {
    /// The angle between the normals of two faces, in radians from 0 (every bent edge is a crease) to π. What is out of
    /// range is replaced by the nearest value in range.
    #[must_use]
    pub fn new(radians: f32) -> Self {
        let radians = if radians.is_nan() { 0.0 } else { radians.clamp(0.0, core::f32::consts::PI) };
        let squared_chord = |angle: f32| f64::from(2.0 * bevy_math::ops::sin(0.5 * angle)).powi(2);
        Self { from: squared_chord(0.5 * radians), to: squared_chord(radians) }
    }

    /// 1 where two faces belong to one curved surface, 0 across a crease; the cubic Hermite curve in between.
    fn softness(&self, one: DVec3, other: DVec3) -> f64 {
        let chord = one.distance_squared(other);
        if chord <= self.from {
            1.0
        } else if chord >= self.to {
            0.0
        } else {
            let t = (chord - self.from) / (self.to - self.from);
            1.0 - t * t * (3.0 - 2.0 * t)
        }
    }
}

/// A place on a surface.
#[derive(Clone, Copy)]
pub struct SurfacePlace<'a> {
    /// The surface's triangles.
    pub topology: &'a SurfaceTopology,
    /// Its vertices.
    pub positions: &'a [Vec3],
    /// The triangle.
    pub triangle: u32,
    /// Which part of the triangle the place is on.
    pub feature: Feature,
    /// Whether the surface has an inside, so that its normals' side is the only one.
    pub one_sided: bool,
    /// Weights of the triangle's corners. They sum to 1, and those of corners that are no part of the feature are 0.
    pub barycentric: [f64; 3],
}

/// The directions out of a surface in which something may touch it at one place: a single one where the surface is
/// smooth, a range at a crease, a corner or a border.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NormalCone {
    /// Smooth unit normals of the faces that meet in the place; empty where any direction will do.
    faces: Vec<DVec3>,
    /// The same faces' own normals.
    facets: Vec<DVec3>,
    /// At a border, away from the surface.
    border: Vec<DVec3>,
    /// In 1/length, at least 0; infinite where any direction will do.
    curvature: f64,
    /// Whether the opposite directions will do as well.
    two_sided: bool,
}

impl NormalCone {
    /// Any direction.
    #[must_use]
    pub fn anything() -> Self {
        Self { curvature: f64::INFINITY, ..Self::default() }
    }

    /// One direction, at a place of the given curvature (0 or more, in 1/length).
    #[must_use]
    pub fn single(direction: DVec3, curvature: f64) -> Self {
        Self { faces: vec![direction], facets: vec![direction], curvature, ..Self::default() }
    }

    /// All directions between the unit normals of plane faces: any where there is none. A single one is that of a plane, an
    /// edge or a corner leaves the choice to what it touches.
    #[must_use]
    pub fn between(faces: impl IntoIterator<Item = DVec3>) -> Self {
        let faces: Vec<DVec3> = faces.into_iter().filter(|normal| *normal != DVec3::ZERO).collect();
        let curvature = if faces.is_empty() || spread(&faces) > FLAT { f64::INFINITY } else { 0.0 };
        Self { facets: faces.clone(), faces, curvature, ..Self::default() }
    }

    /// The cone of a place on a surface: any direction where edges have more than two triangles, or the triangle has no
    /// area.
    #[must_use]
    pub fn of(place: &SurfacePlace<'_>, crease: CreaseAngle) -> Self {
        let fan = |corner: usize| Fan::around(place, corner, crease);
        let own = place.triangle;
        let cone = match place.feature {
            Feature::Vertex(corner) => Self::at_vertex(&fan(usize::from(corner) % 3), own),
            Feature::Edge(edge) => Self::on_edge(place, usize::from(edge) % 3, fan),
            Feature::Face => Self::on_face(place, fan),
        };
        let Some(mut cone) = cone else { return Self::anything() };
        cone.two_sided = !place.one_sided;
        if cone.two_sided && !cone.border.is_empty() {
            // Past a border one side goes over into the other.
            cone.border.extend(cone.faces.iter().map(|face| -*face));
            cone.two_sided = false;
        }
        // A range of directions is one that turns within the triangle: as curved as that.
        let [one, two, three] = place.corners(own);
        let size = one.distance(two).max(two.distance(three)).max(three.distance(one));
        cone.curvature += spread(&[&cone.faces[..], &cone.border].concat()) / size;
        if cone.is_finite() { cone } else { Self::anything() }
    }

    fn at_vertex(fan: &Fan, own: u32) -> Option<Self> {
        let fan = fan.manifold().then_some(fan)?;
        let first = fan.place_of(own).unwrap_or(0);
        let (_, curvature) = fan.corner_normal(first)?;
        let (faces, facets) = if fan.is_smooth() {
            (vec![fan.corner_normal(first)?.0], fan.faces.iter().map(|face| face.normal).collect())
        } else {
            (0..fan.faces.len()).filter_map(|face| Some((fan.corner_normal(face)?.0, fan.faces[face].normal))).unzip()
        };
        let border: Vec<DVec3> = fan.ends.iter().filter_map(|end| *end).filter(|end| *end != DVec3::ZERO).collect();
        Some(Self { faces, facets, border, curvature, two_sided: false })
    }

    fn on_edge(place: &SurfacePlace<'_>, edge: usize, fan: impl Fn(usize) -> Fan) -> Option<Self> {
        let next = (edge + 1) % 3;
        let (weight, next_weight) = (place.barycentric[edge], place.barycentric[next]);
        let fans = [fan(edge), fan(next)];
        let mut cone = Self::default();
        let mut add = |triangle: u32| {
            let places = [fans[0].place_of(triangle)?, fans[1].place_of(triangle)?];
            let ends = [fans[0].corner_normal(places[0])?, fans[1].corner_normal(places[1])?];
            cone.faces.push((ends[0].0 * weight + ends[1].0 * next_weight).try_normalize()?);
            cone.facets.push(fans[0].faces[places[0]].normal);
            cone.curvature = cone.curvature.max(ends[0].1 * weight + ends[1].1 * next_weight);
            Some(())
        };
        add(place.triangle)?;
        match place.across(place.triangle, edge) {
            Across::Triangle { triangle, .. } => {
                // A neighbor without area has no normal to add.
                let _ = add(triangle);
            }
            Across::Nothing => cone.border.push(place.beyond(place.triangle, edge)),
            Across::Several => return None,
        }
        Some(cone)
    }

    fn on_face(place: &SurfacePlace<'_>, fan: impl Fn(usize) -> Fan) -> Option<Self> {
        let (mut sum, mut curvature, mut facet) = (DVec3::ZERO, 0.0, DVec3::ZERO);
        for (corner, weight) in place.barycentric.into_iter().enumerate() {
            let fan = fan(corner);
            let own = fan.place_of(place.triangle)?;
            let (normal, corner_curvature) = fan.corner_normal(own)?;
            sum += normal * weight;
            curvature += corner_curvature * weight;
            facet = fan.faces[own].normal;
        }
        Some(Self { faces: vec![sum.try_normalize()?], facets: vec![facet], curvature, ..Self::default() })
    }

    fn is_finite(&self) -> bool {
        let all = self.faces.iter().chain(&self.facets).chain(&self.border);
        self.curvature.is_finite() && all.into_iter().all(|direction| direction.is_finite())
    }

    /// The cone where a pose takes it.
    #[must_use]
    pub fn moved(mut self, pose: &Pose) -> Self {
        for direction in self.faces.iter_mut().chain(&mut self.facets).chain(&mut self.border) {
            *direction = pose.transform_direction(*direction).normalize_or_zero();
        }
        self.curvature /= pose.scale();
        self
    }

    /// The cone turned.
    #[must_use]
    pub(in crate::kernel) fn turned(mut self, rotation: DQuat) -> Self {
        for direction in self.faces.iter_mut().chain(&mut self.facets).chain(&mut self.border) {
            *direction = rotation * *direction;
        }
        self
    }

    /// The direction of the cone that is nearest to a unit vector, which tells the side of a surface that has two. The
    /// vector itself where it is in the cone.
    #[must_use]
    pub fn nearest(&self, direction: DVec3) -> DVec3 {
        nearest_in_hull(&self.faces, &self.border, self.side(direction), direction)
    }

    /// The same for the cone of the faces as they are, without smoothing.
    #[must_use]
    pub fn nearest_unsmoothed(&self, direction: DVec3) -> DVec3 {
        nearest_in_hull(&self.facets, &self.border, self.side(direction), direction)
    }

    /// −1 where a direction is on the other side of a surface that has two.
    fn side(&self, direction: DVec3) -> f64 {
        let turned = self.two_sided && self.faces.iter().sum::<DVec3>().dot(direction) < 0.0;
        if turned { -1.0 } else { 1.0 }
    }
}

/// The unit normal from the second side to the first that suits both sides' cones best, given the exact normal and the
/// way from the place on the second side to that on the first; the exact one where nothing else suits.
///
/// Two spheres part along the line between their centers: with outward normals n and radii R at any two places of theirs
/// that is `R_b n_b − R_a n_a` and the way from one place to the other. So the flatter side has the larger say, and a
/// contact of places beside the closest ones has the same normal as theirs.
#[must_use]
pub fn smooth_normal(exact: DVec3, apart: DVec3, a: &NormalCone, b: &NormalCone) -> DVec3 {
    let (side_a, side_b) = (a.side(-exact), b.side(exact));
    let in_a = |normal: DVec3| -nearest_in_hull(&a.faces, &a.border, side_a, -normal);
    let in_b = |normal: DVec3| nearest_in_hull(&b.faces, &b.border, side_b, normal);
    // First into one cone, then into the other: at a crease a side leaves the choice to the other one.
    let (by_a, by_b) = (in_a(in_b(exact)), in_b(in_a(exact)));
    let share = share_of_first(a.curvature, b.curvature);
    let radii = a.curvature.recip() + b.curvature.recip();
    let smooth = (by_a * share + by_b * (1.0 - share) + apart / radii).normalize_or_zero();
    if smooth.dot(exact) > 0.0 { smooth } else { exact }
}

/// The first side's share of a normal: proportional to its radius of curvature.
fn share_of_first(first: f64, second: f64) -> f64 {
    match (first.is_finite(), second.is_finite()) {
        (true, true) if first + second > 0.0 => second / (first + second),
        (true, false) => 1.0,
        (false, true) => 0.0,
        _ => 0.5,
    }
}

/// Largest distance between two of some unit vectors.
fn spread(directions: &[DVec3]) -> f64 {
    let apart = |one: &DVec3| directions.iter().map(|other| one.distance(*other)).fold(0.0, f64::max);
    directions.iter().map(apart).fold(0.0, f64::max)
}

/// The unit vector nearest to `direction` in the cone spanned by `faces`, all times `side`, and `border`; the vector itself
/// where there are no faces.
fn nearest_in_hull(faces: &[DVec3], border: &[DVec3], side: f64, direction: DVec3) -> DVec3 {
    match (faces, border) {
        ([], _) => return direction,
        ([only], []) => return *only * side,
        _ => {}
    }
    let mut spanning: Vec<DVec3> = Vec::with_capacity(faces.len() + border.len());
    for next in faces.iter().map(|face| *face * side).chain(border.iter().copied()) {
        let known = |other: &DVec3| other.dot(next) > 0.0 && other.cross(next).length_squared() <= SAME_DIRECTION;
        if !spanning.iter().any(known) {
            spanning.push(next);
        }
    }
    // The projection p of d on a convex cone has (d − p)·g ≤ 0 for every spanning g. It lies on one of them or between
    // two; where none of these is it, the direction is inside the cone.
    let is_projection = |point: DVec3| {
        let rest = direction - point;
        spanning.iter().all(|generator| rest.dot(*generator) <= INSIDE_SLACK)
    };
    let closest = |best: DVec3, next: &DVec3| if next.dot(direction) > best.dot(direction) { *next } else { best };
    let closest = spanning.iter().fold(spanning[0], closest);
    if closest.dot(direction) <= 0.0 {
        return closest;
    }
    for (place, one) in spanning.iter().enumerate() {
        let along = direction.dot(*one);
        if along > 0.0 && is_projection(*one * along) {
            return *one;
        }
        for other in &spanning[..place] {
            let Some(across) = one.cross(*other).try_normalize() else { continue };
            let point = direction - across * direction.dot(across);
            let between = one.cross(point).dot(across) >= 0.0 && point.cross(*other).dot(across) >= 0.0;
            if between && is_projection(point) {
                return point.try_normalize().unwrap_or(direction);
            }
        }
    }
    direction
}

impl SurfacePlace<'_> {
    /// The point that the weights stand for.
    #[must_use]
    pub fn point(&self) -> DVec3 {
        point_at(&self.corners(self.triangle), &self.barycentric)
    }

    fn corners(&self, triangle: u32) -> [DVec3; 3] {
        self.topology.triangles()[triangle as usize]
            .map(|vertex| self.positions.get(vertex as usize).map_or(DVec3::NAN, |position| position.as_dvec3()))
    }
}
