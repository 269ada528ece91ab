//! Contact normals of the smooth surfaces that meshes approximate, without the bumps of inner edges.
//!
//! A vertex gets the normal of the sphere on which it and its neighbors lie, exactly if they lie on one (Max, "Weights
//! for computing vertex normals from facet normals", 1999). Inside a face, barycentric weights blend the three vertex
//! normals. The result is exactly radial on a sphere, exactly the normal of a plane, and continuous over inner edges.
//! Creases stay sharp. The two sides are weighted by their radii of curvature, like the line through the centers of two
//! spheres. Runs last and only on request, on the places of contacts and the positions around them.

use fearless_simd::{f32x8, prelude::*};
use glam::{DQuat, DVec3, Vec3};

use self::fan::{Across, Fan};
use super::{barycentric::point_at, feature::Feature, topology::SurfaceTopology};
use crate::kernel::{pose::Pose, simd::lanes::VectorLanes};

mod fan;

/// Two unit normals that differ by less than this count as equal, in radians. Above the tilt that rounded positions
/// give the faces of a flat mesh, and far below a tilt that affects a body.
const FLAT: f64 = 1.0e-4;

/// Two directions are the same if their squared sine is below this.
const SAME_DIRECTION: f64 = 1.0e-24;

/// How far beyond a plane of a cone a direction may lie and still count as inside, as a sine. Covers the rounding of
/// f64.
const INSIDE_SLACK: f64 = 1.0e-12;

/// Defines which edges are creases: those bent by at least an angle. Up to half that angle an edge is an inner edge of
/// a curved surface. In between, the smoothing fades out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CreaseAngle {
    /// Squared distances of two unit normals, at half the angle and at the angle.
    from: f64,
    to: f64,
}

impl CreaseAngle {
    /// Creates the setting from the angle between the normals of two faces, in radians from 0 (every bent edge is a
    /// crease) to π. Values out of range are clamped, and NaN becomes 0.
    #[must_use]
    pub fn new(radians: f32) -> Self {
        let radians = if radians.is_nan() { 0.0 } else { radians.clamp(0.0, core::f32::consts::PI) };
        let squared_chord = |angle: f32| f64::from(2.0 * bevy_math::ops::sin(0.5 * angle)).powi(2);
        Self { from: squared_chord(0.5 * radians), to: squared_chord(radians) }
    }

    /// Like [`softness`](Self::softness) for eight pairs of faces, by the vector between their unit normals.
    #[cfg_attr(not(unoptimized), inline(always))]
    pub(super) fn softness_in_lanes<S: Simd>(&self, simd: S, between: VectorLanes<S>) -> f32x8<S> {
        let width = (self.to - self.from) as f32;
        let scale = if width > f32::MIN_POSITIVE { width.recip() } else { f32::MAX };
        let t = ((between.dot(between) - self.from as f32) * scale).max(0.0).min(1.0);
        f32x8::splat(simd, 1.0) - t * t * (f32x8::splat(simd, 3.0) - t * 2.0)
    }

    /// 1 if two faces belong to one curved surface, 0 across a crease, and the cubic Hermite curve in between.
    pub(super) fn softness(&self, one: DVec3, other: DVec3) -> f64 {
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
    /// The feature of the triangle that the place is on.
    pub feature: Feature,
    /// Whether the surface has an inside, so that only the side of its normals counts.
    pub one_sided: bool,
    /// Weights of the triangle's corners. They sum to 1, and are 0 for corners that do not belong to the feature.
    pub barycentric: [f64; 3],
}

/// The directions out of a surface in which something may touch it at one place: a single direction where the surface
/// is smooth, and a range at a crease, a corner, or a border.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NormalCone {
    /// Smooth unit normals of the faces that meet at the place. Empty if any direction is allowed.
    faces: Vec<DVec3>,
    /// The unsmoothed normals of the same faces.
    facets: Vec<DVec3>,
    /// At a border, the directions away from the surface.
    border: Vec<DVec3>,
    /// In 1/length, at least 0. Infinite if any direction is allowed.
    curvature: f64,
    /// Whether the opposite directions are allowed too.
    two_sided: bool,
}

impl NormalCone {
    /// Allows any direction.
    #[must_use]
    pub fn anything() -> Self {
        Self { curvature: f64::INFINITY, ..Self::default() }
    }

    /// Allows one direction, at a place of the given curvature (0 or more, in 1/length).
    #[must_use]
    pub fn single(direction: DVec3, curvature: f64) -> Self {
        Self { faces: vec![direction], facets: vec![direction], curvature, ..Self::default() }
    }

    /// Allows all directions between the unit normals of plane faces, or any direction if there is none. A single
    /// normal has no curvature, like a plane. An edge or a corner leaves the choice to the other side.
    #[must_use]
    pub fn between(faces: impl IntoIterator<Item = DVec3>) -> Self {
        let faces: Vec<DVec3> = faces.into_iter().filter(|normal| *normal != DVec3::ZERO).collect();
        let curvature = if faces.is_empty() || spread(&faces) > FLAT { f64::INFINITY } else { 0.0 };
        Self { facets: faces.clone(), faces, curvature, ..Self::default() }
    }

    /// The cone of a place on a surface. Allows any direction if an edge there has more than two triangles, or the
    /// triangle has no area.
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
            // Beyond a border, one side continues into the other.
            cone.border.extend(cone.faces.iter().map(|face| -*face));
            cone.two_sided = false;
        }
        // A range of directions is a normal that turns within the triangle, and adds that curvature.
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

    /// Transforms the cone.
    #[must_use]
    pub fn moved(mut self, pose: &Pose) -> Self {
        for direction in self.faces.iter_mut().chain(&mut self.facets).chain(&mut self.border) {
            *direction = pose.transform_direction(*direction).normalize_or_zero();
        }
        self.curvature /= pose.scale();
        self
    }

    /// Rotates the cone.
    #[must_use]
    pub(in crate::kernel) fn turned(mut self, rotation: DQuat) -> Self {
        for direction in self.faces.iter_mut().chain(&mut self.facets).chain(&mut self.border) {
            *direction = rotation * *direction;
        }
        self
    }

    /// The direction of the cone that is nearest to a unit vector, or the vector itself if it is in the cone. For a
    /// two-sided surface the vector selects the side.
    #[must_use]
    pub fn nearest(&self, direction: DVec3) -> DVec3 {
        nearest_in_hull(&self.faces, &self.border, self.side(direction), direction)
    }

    /// Like [`nearest`](Self::nearest), for the cone of the unsmoothed normals.
    #[must_use]
    pub fn nearest_unsmoothed(&self, direction: DVec3) -> DVec3 {
        nearest_in_hull(&self.facets, &self.border, self.side(direction), direction)
    }

    /// −1 if a direction is on the other side of a two-sided surface, otherwise 1.
    fn side(&self, direction: DVec3) -> f64 {
        let turned = self.two_sided && self.faces.iter().sum::<DVec3>().dot(direction) < 0.0;
        if turned { -1.0 } else { 1.0 }
    }
}

/// The unit normal from the first side to the second that suits the cones of both sides best, given the exact normal
/// and the vector from the place on the first side to the place on the second. The exact normal if nothing else suits.
///
/// Two spheres separate along the line between their centers. With outward normals n and radii R at any two of their
/// places, that is the direction `R_a n_a − R_b n_b` plus the vector from one place to the other. So the flatter side
/// has more weight, and a contact of places beside the closest ones has the same normal as theirs.
#[must_use]
pub fn smooth_normal(exact: DVec3, apart: DVec3, a: &NormalCone, b: &NormalCone) -> DVec3 {
    let (side_a, side_b) = (a.side(exact), b.side(-exact));
    let in_a = |normal: DVec3| nearest_in_hull(&a.faces, &a.border, side_a, normal);
    let in_b = |normal: DVec3| -nearest_in_hull(&b.faces, &b.border, side_b, -normal);
    // First into one cone, then into the other: at a crease a side leaves the choice to the other one.
    let (by_a, by_b) = (in_a(in_b(exact)), in_b(in_a(exact)));
    let share = share_of_first(a.curvature, b.curvature);
    let radii = a.curvature.recip() + b.curvature.recip();
    let smooth = (by_a * share + by_b * (1.0 - share) + apart / radii).normalize_or_zero();
    if smooth.dot(exact) > 0.0 { smooth } else { exact }
}

/// The weight of the first side in a normal, proportional to its radius of curvature.
fn share_of_first(first: f64, second: f64) -> f64 {
    match (first.is_finite(), second.is_finite()) {
        (true, true) if first + second > 0.0 => second / (first + second),
        (true, false) => 1.0,
        (false, true) => 0.0,
        _ => 0.5,
    }
}

/// The largest distance between any two of the unit vectors.
fn spread(directions: &[DVec3]) -> f64 {
    let apart = |one: &DVec3| directions.iter().map(|other| one.distance(*other)).fold(0.0, f64::max);
    directions.iter().map(apart).fold(0.0, f64::max)
}

/// The unit vector nearest to `direction` in the cone that is spanned by `faces`, all multiplied by `side`, and
/// `border`. The vector itself if there are no faces.
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
    // The projection p of d on a convex cone satisfies (d − p)·g ≤ 0 for every generator g. It lies on one of them or
    // between two. If none of these is the projection, the direction is inside the cone.
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
    /// The point with these weights.
    #[must_use]
    pub fn point(&self) -> DVec3 {
        point_at(&self.corners(self.triangle), &self.barycentric)
    }

    fn corners(&self, triangle: u32) -> [DVec3; 3] {
        self.topology.triangles()[triangle as usize]
            .map(|vertex| self.positions.get(vertex as usize).map_or(DVec3::NAN, |position| position.as_dvec3()))
    }
}
