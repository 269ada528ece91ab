//! What bodies are made of.

#[cfg(feature = "reflect")]
use bevy_reflect::prelude::*;

#[cfg(doc)]
use super::body::XpbdBody;
use super::error::XpbdBodyError;
#[cfg(doc)]
use crate::kernel::mesh::topology::SurfaceTopology;

/// The material of a body. A compliance is one over a stiffness: 0 is as stiff as the solver can make it, infinite is
/// no resistance.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "reflect", derive(Reflect), reflect(Clone, Debug, PartialEq))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct XpbdMaterial {
    /// Mass per area of the surface, in kilograms per square meter; more than 0. Default 0.2, a light cloth. Unused if
    /// the body is [tetrahedral](XpbdBody::tetrahedral).
    pub area_density: f32,
    /// Compliance of every edge against stretching and compression, in meters per newton; 0 or more. Default 0: cloth
    /// hardly stretches, and no vertex gets farther from the pins than the way along the edges is long at rest (Kim,
    /// Chentanez and Müller-Fischer 2012, "Long Range Attachments"). If the body is tetrahedral, edges inside count too.
    #[cfg_attr(feature = "serde", serde(with = "super::infinite"))]
    pub stretch_compliance: f32,
    /// Compliance of every inner edge against bending, in radians per newton meter; 0 or more. Default 30,000, a soft
    /// cloth with edges of a few centimeters.
    #[cfg_attr(feature = "serde", serde(with = "super::infinite"))]
    pub bend_compliance: f32,
    /// Compliance of a closed body against a change of its volume, in cubic meters per pascal; 0 or more. Default
    /// infinite: cloth has no volume. It has no effect on surfaces that are not [closed](SurfaceTopology::is_closed):
    /// [`XpbdBody::new`] warns about the first one.
    #[cfg_attr(feature = "serde", serde(with = "super::infinite"))]
    pub volume_compliance: f32,
    /// Share of the velocity lost to air drag, per second; 0 or more. Default 2: a light cloth falls at 5 meters per
    /// second at most.
    pub drag: f32,
    /// Decay rate of oscillations along the edges, per second; 0 or more. Default 100: without damping, the residual
    /// stretch that a substep leaves keeps oscillating.
    pub damping: f32,
    /// Mass per volume of a tetrahedral body, in kilograms per cubic meter; more than 0. Default 1000, as water.
    pub density: f32,
    /// Young's modulus of a tetrahedral body, in pascals: the force per area over the share by which it stretches a bar;
    /// more than 0. Default 100,000, a soft rubber. The solver can make a body about as stiff as its density times the
    /// square of its mean edge per substep: 1,000,000 for edges of 5 centimeters and the default substeps.
    pub young_modulus: f32,
    /// Poisson's ratio of a tetrahedral body: the share of its stretch by which a bar gets thinner; from 0 to 0.5, where
    /// 0.5 keeps the volume. Default 0.45. At more than 0.49, tetrahedra lock: they hardly bend.
    pub poisson_ratio: f32,
}

impl XpbdMaterial {
    /// A soft rubber, for [tetrahedral](XpbdBody::tetrahedral) bodies: the inside resists, not the edges.
    pub const SOLID: Self = Self {
        area_density: 1.0,
        stretch_compliance: f32::INFINITY,
        bend_compliance: f32::INFINITY,
        volume_compliance: f32::INFINITY,
        drag: 0.5,
        damping: 10.0,
        density: 1000.0,
        young_modulus: 1.0e5,
        poisson_ratio: 0.45,
    };

    /// A light cloth.
    pub const CLOTH: Self = Self {
        area_density: 0.2,
        stretch_compliance: 0.0,
        bend_compliance: 3.0e4,
        volume_compliance: f32::INFINITY,
        drag: 2.0,
        damping: 100.0,
        ..Self::SOLID
    };

    /// A rubber ball: a skin that stretches a little around an incompressible volume.
    pub const SOFT: Self = Self {
        area_density: 2.0,
        stretch_compliance: 1.0e-4,
        bend_compliance: 1.0e1,
        volume_compliance: 0.0,
        drag: 2.0,
        damping: 100.0,
        ..Self::SOLID
    };
}

impl Default for XpbdMaterial {
    fn default() -> Self {
        Self::CLOTH
    }
}

pub(super) fn check_material(material: &XpbdMaterial) -> Result<(), XpbdBodyError> {
    let wrong = |what, value, range| Err(XpbdBodyError::Material { what, value, range });
    let amounts = [
        ("the area density", material.area_density),
        ("the density", material.density),
        ("Young's modulus", material.young_modulus),
    ];
    if let Some((what, value)) = amounts.into_iter().find(|&(_, value)| !(value.is_finite() && value > 0.0)) {
        return wrong(what, value, "finite and more than 0");
    }
    if !(0.0..=0.5).contains(&material.poisson_ratio) {
        return wrong("Poisson's ratio", material.poisson_ratio, "from 0 to 0.5");
    }
    let rates = [("the drag", material.drag), ("the damping", material.damping)];
    if let Some((what, value)) = rates.into_iter().find(|&(_, value)| !(value.is_finite() && value >= 0.0)) {
        return wrong(what, value, "finite and 0 or more");
    }
    let compliances = [
        ("the stretch compliance", material.stretch_compliance),
        ("the bend compliance", material.bend_compliance),
        ("the volume compliance", material.volume_compliance),
    ];
    match compliances.into_iter().find(|&(_, value)| value.is_nan() || value < 0.0) {
        Some((what, value)) => wrong(what, value, "0 or more, where infinite is no resistance"),
        None => Ok(()),
    }
}
