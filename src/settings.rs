//! Every setting that is not a component, with its default and the reason for it.

use bevy_ecs::prelude::*;

use crate::kernel::{
    mesh::smooth_normal::CreaseAngle,
    spheres::{circumsphere::RecipeSettings, curvature::CurvatureEstimator},
};

/// Two surfaces have parted only when they are farther apart than their contact distance by this share of it: at rest
/// on the threshold, rounding does not make them part and meet in every tick.
pub(crate) const EVENT_HYSTERESIS: f32 = 1.0e-3;

/// What the sphere methods write about contacts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SphereContactDetail {
    /// Which triangles are in contact and how far apart they are, in [`StoredPair::sphere_contacts`](crate::StoredPair::sphere_contacts).
    /// The lists of contacts and touching pairs stay empty. Takes half of the time or less.
    Distances,
    /// Contacts with points and normals, as the exact methods write them.
    #[default]
    Points,
}

/// How surfaces are tested. You need not touch this: the defaults miss no contact.
///
/// Changes take effect in the next tick; a value out of range is replaced by the nearest one in range.
#[derive(Resource, Clone, Copy, Debug, PartialEq)]
pub struct CircumsphereSettings {
    /// How much farther than the contact distance contacts are still reported, in world units, with positive
    /// separation. 0 or more. Default 0: a solver that steps between detections sets it to what moves meanwhile.
    pub margin: f32,
    /// Height of a flat triangle's sphere center below its plane, in radii of the triangle. 0 or more. Default 0.5,
    /// where the cap bulges by 0.62 radii: least error over generated scenes and recordings together. Only for the `Circumsphere` method.
    pub phi: f32,
    /// Curvature times radius at which a sphere is no longer offset. More than 0, useful from 0.5 to 2. Default 2.
    /// Only for the `Circumsphere` method.
    pub curvature_threshold: f32,
    /// Whether two triangles that their planes, or the planes across the line between their sphere centers, hold apart
    /// are apart whatever their caps do. Default true; the source paper goes by spheres and cones alone. Only for the
    /// `Circumsphere` method.
    pub plane_cull: bool,
    /// Whether safety cones are widened by the angle to the neighboring triangles, so that they leave no gap between
    /// them. Default true; the source paper's are not. Only for the `Circumsphere` method.
    pub widen_cones: bool,
    /// Shape change beyond which a triangle's sphere is made anew: relative change of an edge, or of a dihedral angle
    /// in radians. 0 makes all of them anew in every tick in which the surface moves. Default 0.7, the source paper's choice
    /// for steadiness. Only for the `Circumsphere` method.
    pub delta: f32,
    /// How curvature is estimated. Default: signed edge curvature, which holds on stretched meshes. Only for the
    /// `Circumsphere` method.
    pub estimator: CurvatureEstimator,
    /// Angle between the normals of two faces, in radians, at which their edge is a crease to
    /// [smooth normals](crate::SmoothNormals). 0 (every edge is one) to π. Up to half of it an edge is smooth; in between
    /// it fades. Default 1, or 57°: box edges stay sharp, spheres of 80 triangles become round. Beside an edge that counts
    /// as smooth, the normal turns over whole triangles: where large flat faces meet at small angles, as a floor and a
    /// ramp do, use 0, which brings exact normals into the range that the faces around a feature span, and no more.
    pub crease_angle: f32,
    /// What the methods `BoundingSphere` and `Circumsphere` write about contacts. Default: contacts with points and normals.
    pub sphere_contacts: SphereContactDetail,
    /// How many threads may work on one tick, the calling one included. 1 never touches a task pool. Default 0: as
    /// many as Bevy's compute task pool has, where the app has one. Contacts are the same for any number.
    pub threads: usize,
    /// Whether a pair of surfaces that is as it was in the last tick, bit by bit, keeps what was found then; whether a surface
    /// that rests in its own frame keeps its spheres while others move; and whether surfaces that move by less than a
    /// fraction of the contact distance a tick keep lists of the triangles that are near each other, with bounds of their
    /// distances, for as many ticks as these hold (`Refined` and `Closest`, surfaces in one frame, not where one of two surfaces
    /// has an inside). Default true. Contacts are the same either way: false is for measuring what a tick costs in which
    /// everything has moved.
    pub memory: bool,
}

impl Default for CircumsphereSettings {
    fn default() -> Self {
        Self {
            margin: 0.0,
            phi: 0.5,
            curvature_threshold: 2.0,
            plane_cull: true,
            widen_cones: true,
            delta: 0.7,
            estimator: CurvatureEstimator::SignedEdge,
            crease_angle: 1.0,
            sphere_contacts: SphereContactDetail::Points,
            threads: 0,
            memory: true,
        }
    }
}

impl CircumsphereSettings {
    /// The margin, in range.
    pub(crate) fn margin(&self) -> f32 {
        if self.margin.is_finite() { self.margin.max(0.0) } else { 0.0 }
    }

    /// Which edges are creases.
    pub(crate) fn crease(&self) -> CreaseAngle {
        CreaseAngle::new(if self.crease_angle.is_nan() { Self::default().crease_angle } else { self.crease_angle })
    }

    /// What shapes the spheres, in range.
    pub(crate) fn recipe(&self) -> RecipeSettings {
        let default = Self::default();
        let in_range =
            |value: f32, least: f32, default: f32| if value.is_nan() { default } else { value.clamp(least, f32::MAX) };
        RecipeSettings {
            phi: in_range(self.phi, 0.0, default.phi).min(1.0e6),
            curvature_threshold: in_range(self.curvature_threshold, f32::MIN_POSITIVE, default.curvature_threshold),
            delta: in_range(self.delta, 0.0, default.delta),
        }
    }
}
