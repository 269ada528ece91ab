//! Settings that are not components, with their defaults and the reasons for them.
//!
//! The stages read [`CircumsphereSettings`]. Values out of range are clamped here.

use bevy_ecs::prelude::*;
#[cfg(feature = "reflect")]
use bevy_reflect::prelude::*;

use crate::kernel::{
    mesh::smooth_normal::CreaseAngle,
    spheres::{circumsphere::RecipeSettings, curvature::CurvatureEstimator},
};

/// Two surfaces count as separated only if they are farther apart than their contact distance by this share of it.
/// Otherwise rounding could end and start the contact in every tick where surfaces rest at the threshold.
pub(crate) const EVENT_HYSTERESIS: f32 = 1.0e-3;

/// What the sphere methods report about contacts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Clone, Debug, Default, PartialEq))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum SphereContactDetail {
    /// Only which triangles are in contact and how far apart they are, in
    /// [`StoredPair::sphere_contacts`](crate::StoredPair::sphere_contacts). The lists of contacts and touching pairs
    /// stay empty. Takes at most half of the time.
    Distances,
    /// Contacts with points and normals, like the exact methods.
    #[default]
    Points,
}

/// How surfaces are tested. The defaults miss no contact, so most games need not change anything.
///
/// Changes take effect in the next tick. Values out of range are clamped. NaN becomes the default, and a margin that is
/// not finite becomes 0.
#[derive(Resource, Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Resource, Clone, Debug, Default, PartialEq))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct CircumsphereSettings {
    /// How much farther than the contact distance contacts are still reported, with positive separation. In world
    /// units, 0 or more. Default: 0. A solver that takes several steps per detection sets it to how far things move in
    /// between.
    pub margin: f32,
    /// Height of a flat triangle's sphere center below its plane, in radii of the triangle: the source paper's φ. 0 to
    /// 1e6. Default: 0.5, where the cap bulges by 0.62 radii. This has the least error over generated scenes and
    /// recordings together. Only for the `Circumsphere` method.
    pub sphere_offset: f32,
    /// Curvature times radius at which a sphere is no longer offset. More than 0, useful from 0.5 to 2. Default: 2.
    /// Only for the `Circumsphere` method.
    pub curvature_threshold: f32,
    /// Whether to drop pairs of triangles that are separated along one of their normals, or along the line between
    /// their sphere centers, whatever their caps do. Default: true. The source paper uses only spheres and cones. Only
    /// for the `Circumsphere` method.
    pub plane_cull: bool,
    /// Whether to widen safety cones by the angle to the neighboring triangles, so that there are no gaps between
    /// cones. Default: true. The source paper does not widen them. Only for the `Circumsphere` method.
    pub widen_cones: bool,
    /// Change of shape beyond which a triangle's sphere is computed anew, the source paper's δ: the relative change of
    /// an edge length, or the change of a dihedral angle in radians. 0 or more. 0 computes all spheres anew in every
    /// tick in which the surface moves. Default: 0.7, which the source paper chose for stability. Only for the
    /// `Circumsphere` method.
    pub refit_threshold: f32,
    /// How curvature is estimated. Default: signed edge curvature, which is reliable on stretched meshes. Only for the
    /// `Circumsphere` method.
    pub estimator: CurvatureEstimator,
    /// Angle between the normals of two faces, in radians, from which [smooth normals](crate::SmoothNormals) treat
    /// their edge as a crease. 0 (every edge is a crease) to π. Edges up to half of this angle are smooth. In between,
    /// the smoothing fades out. Default: 1, or 57°. Box edges stay sharp, and spheres of 80 triangles become round.
    ///
    /// Next to a smooth edge, the normal turns over whole triangles. Where large flat faces meet at small angles, such
    /// as a floor and a ramp, use 0. It brings exact normals into the range that the faces around a feature span, and
    /// does no more.
    pub crease_angle: f32,
    /// What the methods `BoundingSphere` and `Circumsphere` report about contacts. Default: contacts with points and
    /// normals.
    pub sphere_contacts: SphereContactDetail,
    /// How many threads may work on one tick, including the calling one. 1 never touches a task pool. Default: 0, which
    /// uses all threads of Bevy's compute task pool if the app has one. Contacts are the same for any number.
    pub threads: usize,
    /// Whether to reuse results of earlier ticks:
    ///
    /// - A pair of surfaces that has not changed since the last tick, bit by bit, keeps its results.
    /// - A surface whose positions do not change keeps its spheres while others move.
    /// - Surfaces that move by less than a fraction of the contact distance per tick keep lists of near pairs with
    ///   bounds of their distances, for as many ticks as the bounds are conclusive. This applies to `Exact` and
    ///   `Closest`, to surfaces in one frame, and not if one of two surfaces has an inside.
    ///
    /// Default: true. Contacts are the same either way. Use false to measure what a tick costs in which everything has
    /// moved.
    pub memory: bool,
}

impl Default for CircumsphereSettings {
    fn default() -> Self {
        Self {
            margin: 0.0,
            sphere_offset: 0.5,
            curvature_threshold: 2.0,
            plane_cull: true,
            widen_cones: true,
            refit_threshold: 0.7,
            estimator: CurvatureEstimator::SignedEdge,
            crease_angle: 1.0,
            sphere_contacts: SphereContactDetail::Points,
            threads: 0,
            memory: true,
        }
    }
}

impl CircumsphereSettings {
    /// The margin, clamped.
    pub(crate) fn margin(&self) -> f32 {
        if self.margin.is_finite() { self.margin.max(0.0) } else { 0.0 }
    }

    /// The crease angle. NaN becomes the default, and [`CreaseAngle::new`] clamps the rest.
    pub(crate) fn crease(&self) -> CreaseAngle {
        CreaseAngle::new(if self.crease_angle.is_nan() { Self::default().crease_angle } else { self.crease_angle })
    }

    /// The settings of recipes, clamped.
    pub(crate) fn recipe(&self) -> RecipeSettings {
        let default = Self::default();
        let in_range =
            |value: f32, least: f32, default: f32| if value.is_nan() { default } else { value.clamp(least, f32::MAX) };
        RecipeSettings {
            sphere_offset: in_range(self.sphere_offset, 0.0, default.sphere_offset).min(1.0e6),
            curvature_threshold: in_range(self.curvature_threshold, f32::MIN_POSITIVE, default.curvature_threshold),
            refit_threshold: in_range(self.refit_threshold, 0.0, default.refit_threshold),
        }
    }
}

#[cfg(feature = "reflect")]
bevy_reflect::impl_reflect_opaque!(
    (in bevy_circumsphere::geometry) CurvatureEstimator(Clone, Debug, Default, PartialEq)
);
