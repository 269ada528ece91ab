//! Contacts of a triangle with the union of several shapes, each with its own pose.
//!
//! Every part whose box is in reach is examined by itself. A contact that leads from one part into another is dropped,
//! or replaced by the way out of the union, see `union`.

use glam::{DAffine3, DQuat, DVec3, Vec3};

use super::{ShapeError, ShapeFoot, ShapeGeometry, ShapeProximity, rounded};
use crate::kernel::{
    contact::FEATURE_BITS,
    exact::triangle_pair::PairProximity,
    mesh::{barycentric::point_at, bounds::Aabb, smooth_normal::NormalCone},
};

/// Parts no farther apart than this, relative to the size of the whole, have no gap between them. Covers the rounding
/// of f32 poses.
const SEAM: f64 = 1.0e-5;

/// How far along a normal another part is looked for, relative to the size of the whole.
const PROBE: f64 = 1.0e-2;

/// A part that is closer to the probed point by this share extends beyond the contact. This is a tilt of half a degree,
/// and far more than rounding.
const PROBE_ROUNDING: f64 = 2.0e-5;

/// Cosine between a contact's normal and the part's own normal there. Below it, the contact does not lead out of that
/// part.
const SAME_DIRECTION: f64 = 0.99;

/// Several shapes as one.
#[derive(Clone)]
pub struct Compound {
    parts: Vec<Part>,
    bounds: Aabb,
    seam: f64,
}

/// A shape in a compound.
#[derive(Clone)]
pub(super) struct Part {
    pub(super) geometry: ShapeGeometry,
    rotation: DQuat,
    translation: DVec3,
    bounds: Aabb,
    first_feature: u32,
}

impl Part {
    pub(super) fn new(geometry: ShapeGeometry, rotation: DQuat, translation: DVec3) -> Self {
        let local = geometry.bounds().unwrap_or_default();
        let corner = |corner: u8| {
            let pick = |axis: usize| if corner >> axis & 1 == 0 { local.min[axis] } else { local.max[axis] };
            (rotation * Vec3::new(pick(0), pick(1), pick(2)).as_dvec3() + translation).as_vec3()
        };
        let bounds = Aabb::from_points((0..8).map(corner)).grown(0.0);
        Self { geometry, rotation, translation, bounds, first_feature: 0 }
    }

    pub(super) fn inward(&self, point: DVec3) -> DVec3 {
        self.rotation.inverse() * (point - self.translation)
    }

    /// The transform from the compound's frame to the part's.
    pub(super) fn inward_transform(&self) -> DAffine3 {
        let rotation = self.rotation.inverse();
        DAffine3::from_rotation_translation(rotation, rotation * -self.translation)
    }

    pub(super) fn outward(&self, point: DVec3) -> DVec3 {
        self.rotation * point + self.translation
    }

    pub(super) fn turned(&self, direction: DVec3) -> DVec3 {
        self.rotation * direction
    }

    /// Signed distance of a point in the compound's frame, negative inside.
    pub(super) fn signed_distance(&self, point: DVec3) -> f64 {
        self.geometry.signed_distance(self.inward(point))
    }

    /// Whether a point may be closer to the part than a distance.
    fn may_reach(&self, point: DVec3, distance: f64) -> bool {
        let (min, max) = (self.bounds.min.as_dvec3() - distance, self.bounds.max.as_dvec3() + distance);
        point.cmpge(min).all() && point.cmple(max).all()
    }
}

impl Compound {
    pub(super) fn new(mut parts: Vec<Part>) -> Result<Self, ShapeError> {
        let mut features = 0;
        for part in &mut parts {
            part.first_feature = features as u32;
            features += part.geometry.feature_count();
            if features >= 1 << FEATURE_BITS {
                return Err(ShapeError::Part);
            }
        }
        if parts.is_empty() {
            return Err(ShapeError::Part);
        }
        let bounds = parts.iter().fold(Aabb::EMPTY, |whole, part| whole.union(&part.bounds));
        let seam = SEAM * (bounds.max.as_dvec3() - bounds.min.as_dvec3()).length();
        Ok(Self { parts, bounds, seam })
    }

    pub(super) fn parts(&self) -> &[Part] {
        &self.parts
    }

    /// Parts closer to each other than this touch.
    pub(super) const fn seam(&self) -> f64 {
        self.seam
    }

    pub(super) const fn bounds(&self) -> Aabb {
        self.bounds
    }

    pub(super) fn feature_count(&self) -> usize {
        self.parts.iter().map(|part| part.geometry.feature_count()).sum()
    }

    /// The place on the surface of the nearest part, or of the one that a point is deepest in.
    pub(super) fn foot(&self, point: DVec3) -> ShapeFoot {
        let feet = self.parts.iter().map(|part| (part, part.geometry.foot(part.inward(point))));
        let nearest = feet.min_by(|(_, one), (_, other)| one.distance.total_cmp(&other.distance));
        nearest.map_or(ShapeFoot::flat(f64::INFINITY, DVec3::Y, 0), |(part, foot)| {
            let shape_feature = foot.shape_feature + part.first_feature;
            ShapeFoot { shape_feature, ..foot.turned(part.rotation) }
        })
    }

    pub(super) fn normal_cone(&self, shape_feature: u32, outward: DVec3) -> NormalCone {
        let place = self.parts.partition_point(|part| part.first_feature <= shape_feature);
        let Some(part) = place.checked_sub(1).map(|place| &self.parts[place]) else { return NormalCone::anything() };
        let local = part.rotation.inverse() * outward;
        let cone = part.geometry.normal_cone(shape_feature - part.first_feature, local);
        // A contact that was redirected out of the union may leave by another part than the one that it is named after.
        if cone.nearest(local).dot(local) < SAME_DIRECTION {
            return NormalCone::anything();
        }
        cone.turned(part.rotation)
    }

    pub(super) fn examine(
        &self,
        triangle: &[DVec3; 3],
        range: f64,
        scratch: &mut PairProximity,
        found: &mut Vec<ShapeProximity>,
    ) {
        let before = found.len();
        let reach = Aabb::from_points(rounded(triangle)).grown(range as f32);
        // The part that each proximity belongs to.
        let mut owners = Vec::new();
        for (number, part) in self.parts.iter().enumerate() {
            if !reach.overlaps(&part.bounds) {
                continue;
            }
            let own = found.len();
            part.geometry.examine(&triangle.map(|corner| part.inward(corner)), range, scratch, found);
            for proximity in &mut found[own..] {
                proximity.shape_feature += part.first_feature;
                proximity.shape_point = part.outward(proximity.shape_point);
                proximity.normal = part.turned(proximity.normal);
            }
            owners.resize(found.len() - before, number);
        }
        let mut kept = before;
        for (place, &owner) in owners.iter().enumerate() {
            let proximity = found[before + place];
            let point = point_at(triangle, &proximity.barycentric);
            let proximity = if !self.hides(owner, &proximity) {
                Some(proximity)
            } else if proximity.distance <= 0.0 {
                // Each part that contains the point leads to the same place.
                self.led_out(point, proximity).filter(|out| {
                    !found[before..kept].iter().any(|known| {
                        known.feature == out.feature && known.shape_point.distance(out.shape_point) <= self.seam
                    })
                })
            } else {
                None
            };
            if let Some(proximity) = proximity {
                found[kept] = proximity;
                kept += 1;
            }
        }
        found.truncate(kept);
    }

    /// A contact of a part, or its way out of the union if it leads into another part.
    pub(super) fn out_of_all(&self, point: DVec3, proximity: ShapeProximity) -> Option<ShapeProximity> {
        let owner = self.parts.partition_point(|part| part.first_feature <= proximity.shape_feature).checked_sub(1)?;
        if self.hides(owner, &proximity) { self.led_out(point, proximity) } else { Some(proximity) }
    }

    /// Whether a contact of a part leads into another part, or points across a seam: from an edge or a corner that
    /// another part continues, in a direction in which that part extends farther.
    fn hides(&self, owner: usize, proximity: &ShapeProximity) -> bool {
        let own = &self.parts[owner];
        let is_smooth = own.geometry.is_smooth_at(proximity.shape_feature - own.first_feature);
        let place = proximity.shape_point;
        let (past, probe) = (place + proximity.normal * self.seam, place + proximity.normal * self.probe());
        self.parts.iter().enumerate().any(|(number, other)| {
            if number == owner || !other.may_reach(place, 2.0 * self.seam) {
                return false;
            }
            if other.signed_distance(past) < 0.0 {
                return true;
            }
            let apart = other.signed_distance(place);
            let aligned = self.probe() + apart.min(0.0) - PROBE_ROUNDING * self.probe();
            !is_smooth && apart <= self.seam && other.signed_distance(probe) < aligned
        })
    }

    /// How far out a part that extends beyond a contact is looked for.
    fn probe(&self) -> f64 {
        PROBE / SEAM * self.seam
    }
}
