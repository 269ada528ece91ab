//! Signed distance and support points of cylinders and cones, in closed form.
//!
//! Both are frustums about the y axis: a convex polygon in the half-plane of radius and height, revolved about the
//! axis. A border adds everything within its radius to the solid, which reduces every signed distance by it, inside and
//! outside. `frustum_contacts` builds the contacts of a triangle on these.

use glam::{DVec2, DVec3};

use super::foot::{ShapeFoot, root_of_curvature};

/// The part of a frustum that is closest to a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    Mantle,
    BottomCap,
    TopCap,
    BottomRim,
    /// The apex of a cone.
    TopRim,
}

impl Part {
    /// 0 to 4, the same in every tick.
    pub(super) const fn number(self) -> u32 {
        self as u32
    }

    /// Whether the surface is smooth at the part with a number.
    pub(super) const fn is_number_smooth(number: u32) -> bool {
        number < Self::BottomRim.number()
    }

    /// Whether the surface is smooth there.
    pub(super) const fn is_smooth(self) -> bool {
        Self::is_number_smooth(self.number())
    }
}

/// A cylinder, or a cone with its apex up, about the y axis and centered at the origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frustum {
    half_height: f64,
    bottom_radius: f64,
    /// At most the radius of the bottom. 0 for a cone.
    top_radius: f64,
    border: f64,
    /// Unit vectors of the mantle's profile, by radius and height: outward, and from the bottom rim to the top.
    outward: DVec2,
    along: DVec2,
    slant: f64,
}

/// The place on the surface that is closest to a point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Foot {
    /// Signed distance, negative inside.
    pub(super) distance: f64,
    /// Unit vector out of the solid.
    pub(super) normal: DVec3,
    pub(super) part: Part,
}

/// The point of a solid that is farthest in some direction.
#[derive(Clone, Copy, Debug)]
pub(super) struct Support {
    pub(super) point: DVec3,
    pub(super) part: Part,
}

impl Frustum {
    /// Sizes must be finite and at least 0, and the top no wider than the bottom.
    pub(super) fn new(half_height: f64, bottom_radius: f64, top_radius: f64, border: f64) -> Self {
        let slope = DVec2::new(top_radius - bottom_radius, 2.0 * half_height);
        // A disc has the mantle of a cylinder without height.
        let along = slope.try_normalize().unwrap_or(DVec2::Y);
        let outward = DVec2::new(along.y, -along.x);
        Self { half_height, bottom_radius, top_radius, border, outward, along, slant: slope.length() }
    }

    pub(super) const fn half_height(&self) -> f64 {
        self.half_height
    }

    pub(super) const fn bottom_radius(&self) -> f64 {
        self.bottom_radius
    }

    pub(super) const fn top_radius(&self) -> f64 {
        self.top_radius
    }

    pub(super) const fn border(&self) -> f64 {
        self.border
    }

    /// The largest of its extents.
    pub(super) fn size(&self) -> f64 {
        2.0 * (self.half_height.max(self.bottom_radius) + self.border)
    }

    /// The largest coordinates. The smallest are their negatives.
    pub(super) fn half_extents(&self) -> DVec3 {
        DVec3::new(self.bottom_radius, self.half_height, self.bottom_radius) + self.border
    }

    /// The unit vector away from the axis at a point, and the radius there. On the axis, where every direction is
    /// equivalent, the x axis.
    fn radial(point: DVec3) -> (DVec3, f64) {
        let flat = DVec3::new(point.x, 0.0, point.z);
        let radius = flat.length();
        (flat.try_normalize().unwrap_or(DVec3::X), radius)
    }

    fn lift(radial: DVec3, profile: DVec2) -> DVec3 {
        radial * profile.x + DVec3::Y * profile.y
    }

    /// The place on the surface that is closest to a point. On the rim itself the normal is halfway between those of
    /// the two sides that meet there, within half of that angle of either.
    pub(super) fn foot(&self, point: DVec3) -> Foot {
        let (radial, radius) = Self::radial(point);
        let beside = DVec2::new(radius - self.bottom_radius, point.y + self.half_height);
        let (over_top, over_bottom) = (point.y - self.half_height, -point.y - self.half_height);
        let from_mantle = self.outward.dot(beside);
        let foot = |distance: f64, normal: DVec3, part: Part| Foot { distance: distance - self.border, normal, part };
        let mantle = || foot(from_mantle, Self::lift(radial, self.outward), Part::Mantle);
        if over_top <= 0.0 && over_bottom <= 0.0 && from_mantle <= 0.0 {
            return if from_mantle > over_top.max(over_bottom) {
                mantle()
            } else if over_bottom > over_top {
                foot(over_bottom, DVec3::NEG_Y, Part::BottomCap)
            } else {
                foot(over_top, DVec3::Y, Part::TopCap)
            };
        }
        if over_top >= 0.0 && radius <= self.top_radius {
            return foot(over_top, DVec3::Y, Part::TopCap);
        }
        if over_bottom >= 0.0 && radius <= self.bottom_radius {
            return foot(over_bottom, DVec3::NEG_Y, Part::BottomCap);
        }
        let along = self.along.dot(beside);
        if from_mantle >= 0.0 && along > 0.0 && along < self.slant {
            return mantle();
        }
        let (part, cap, rim) = if along >= self.slant {
            (Part::TopRim, DVec2::Y, DVec2::new(self.top_radius, self.half_height))
        } else {
            (Part::BottomRim, DVec2::NEG_Y, DVec2::new(self.bottom_radius, -self.half_height))
        };
        let from_rim = DVec2::new(radius, point.y) - rim;
        let halfway = || (self.outward + cap).try_normalize().unwrap_or(cap);
        let normal = from_rim.try_normalize().unwrap_or_else(halfway);
        foot(from_rim.length(), Self::lift(radial, normal), part)
    }

    /// Like [`foot`](Self::foot), with the curvature there.
    pub(super) fn shape_foot(&self, point: DVec3) -> ShapeFoot {
        let Foot { distance, normal, part } = self.foot(point);
        let (radial, radius) = Self::radial(point);
        let around = DVec3::Y.cross(radial);
        // Around the axis, every surface of revolution has the curvature of the circle, seen from the side.
        let first = if radius > 0.0 { around * (normal.dot(radial).max(0.0) / radius).sqrt() } else { DVec3::ZERO };
        let along = if part.is_smooth() { 0.0 } else { root_of_curvature(distance + self.border) };
        let bends = [first, normal.cross(around) * along];
        ShapeFoot { bends, ..ShapeFoot::flat(distance, normal, part.number()) }
    }

    /// The farthest point in a direction of unit length. If that is a whole cap, its center.
    pub(super) fn support(&self, direction: DVec3) -> Support {
        let (radial, across) = Self::radial(direction);
        let bottom = across * self.bottom_radius - direction.y * self.half_height;
        let top = across * self.top_radius + direction.y * self.half_height;
        let (radius, height, cap, rim) = if top >= bottom {
            (self.top_radius, self.half_height, Part::TopCap, Part::TopRim)
        } else {
            (self.bottom_radius, -self.half_height, Part::BottomCap, Part::BottomRim)
        };
        let (radius, part) = if across > 0.0 || radius == 0.0 { (radius, rim) } else { (0.0, cap) };
        Support { point: radial * radius + DVec3::Y * height + direction * self.border, part }
    }

    /// The planes through the caps, and the plane of the mantle that is nearest to a point: unit normals, and heights
    /// along them.
    pub(super) fn planes(&self, point: DVec3) -> [(DVec3, f64); 3] {
        let mantle = Self::lift(Self::radial(point).0, self.outward);
        [DVec3::Y, DVec3::NEG_Y, mantle].map(|normal| (normal, normal.dot(self.support(normal).point)))
    }

    /// Points of both rims on which a face may rest: on each rim the one that is farthest toward `toward`, and four
    /// fixed ones. Each comes with its part, and its index among the points of that part, 0 for the farthest.
    pub(super) fn rim_points(&self, toward: DVec3) -> impl Iterator<Item = (DVec3, Part, u32)> {
        let sides = [Self::radial(toward).0, DVec3::X, DVec3::Z, DVec3::NEG_X, DVec3::NEG_Z];
        let rims = [
            (self.bottom_radius, -self.half_height, Part::BottomRim),
            (self.top_radius, self.half_height, Part::TopRim),
        ];
        rims.into_iter().flat_map(move |(radius, height, part)| {
            let count = if radius > 0.0 { sides.len() } else { 1 };
            sides
                .into_iter()
                .zip(0..)
                .take(count)
                .map(move |(side, place)| (side * radius + DVec3::Y * height, part, place))
        })
    }
}
