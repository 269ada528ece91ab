//! The configurations to measure: every method, and `Circumsphere` with a range of settings.
//!
//! Settings vary one factor at a time around the defaults. Two more series are the full product of φ, plane cull, and
//! contact distance, and φ with cones that are not widened. To add a setting, add a line to [`FURTHER_SETTINGS`].

use std::fmt::Write;

use bevy_circumsphere::{CircumsphereSettings, ContactMethod, geometry::CurvatureEstimator};

use super::options::Extent;

/// Contact distances in mean edges.
pub const ALL_DISTANCES: [f64; 3] = [0.02, 0.1, 0.5];
/// The distance at which single factors vary.
pub const DEFAULT_DISTANCE: f64 = 0.1;

const PHIS: [f32; 6] = [0.0, 0.5, 1.0, 2.0, 5.0, 10.0];
const THRESHOLDS: [f32; 3] = [0.5, 1.0, 2.0];
const DELTAS: [f32; 5] = [0.0, 0.3, 0.7, 0.9, 2.0];
const ESTIMATORS: [CurvatureEstimator; 2] = [CurvatureEstimator::SignedEdge, CurvatureEstimator::DualAngleDeficit];

/// Settings of `Circumsphere` outside the grid: a name, and the change to the defaults.
const FURTHER_SETTINGS: [(&str, fn(&mut CircumsphereSettings)); 1] = [("as in the source paper", |settings| {
    settings.sphere_offset = 1.0;
    settings.plane_cull = false;
    settings.widen_cones = false;
    settings.estimator = CurvatureEstimator::DualAngleDeficit;
})];

/// One configuration of detection.
#[derive(Clone, Debug, PartialEq)]
pub struct Configuration {
    /// Unique name, without the contact distance.
    pub name: String,
    pub method: ContactMethod,
    pub settings: CircumsphereSettings,
    /// Contact distance in mean edges.
    pub distance_edges: f64,
}

impl Configuration {
    /// The method with the default settings.
    fn new(method: ContactMethod, distance_edges: f64) -> Self {
        // One thread, because times with a thread pool vary too much to compare.
        let settings = CircumsphereSettings { threads: 1, ..CircumsphereSettings::default() };
        Self { name: format!("{method:?}"), method, settings, distance_edges }
    }

    fn circumsphere(settings: CircumsphereSettings, distance_edges: f64) -> Self {
        let default = Self::new(ContactMethod::Circumsphere, distance_edges);
        Self { name: default.name.clone() + &differences(&settings), settings, ..default }
    }

    /// Whether this is `Circumsphere` with default settings once `put_back` has reset the settings that may differ.
    pub fn is_default_but(&self, put_back: impl FnOnce(&mut CircumsphereSettings, &CircumsphereSettings)) -> bool {
        let default = CircumsphereSettings { threads: 1, ..CircumsphereSettings::default() };
        let mut settings = self.settings;
        put_back(&mut settings, &default);
        self.method == ContactMethod::Circumsphere && settings == default
    }

    /// Whether this is a method with default settings.
    pub fn is_default(&self) -> bool {
        self.name == format!("{:?}", self.method)
    }
}

/// Describes how the grid's factors differ from the defaults.
fn differences(settings: &CircumsphereSettings) -> String {
    let default = CircumsphereSettings::default();
    let mut words = String::new();
    let mut say = |differs: bool, what: String| {
        if differs {
            let _ = write!(words, "{} {what}", if words.is_empty() { ":" } else { "," });
        }
    };
    say(settings.sphere_offset != default.sphere_offset, format!("phi {}", settings.sphere_offset));
    say(settings.plane_cull != default.plane_cull, (if settings.plane_cull { "cull" } else { "no cull" }).to_owned());
    say(settings.widen_cones != default.widen_cones, "narrow cones".to_owned());
    say(settings.estimator != default.estimator, estimator_name(settings.estimator).to_owned());
    say(
        settings.curvature_threshold != default.curvature_threshold,
        format!("threshold {}", settings.curvature_threshold),
    );
    say(settings.refit_threshold != default.refit_threshold, format!("delta {}", settings.refit_threshold));
    words
}

pub const fn estimator_name(estimator: CurvatureEstimator) -> &'static str {
    match estimator {
        CurvatureEstimator::SignedEdge => "signed edge",
        CurvatureEstimator::DualAngleDeficit => "dual angle deficit",
    }
}

/// All configurations at the given contact distances, without duplicates. Single factors vary at the default distance
/// only, or at the first one if the default is not in the list.
pub fn configurations(distances: &[f64], extent: Extent) -> Vec<Configuration> {
    let few = extent == Extent::Smoke;
    let phis: &[f32] = if few { &[0.0, 1.0, 5.0] } else { &PHIS };
    let deltas: &[f32] = if few { &[0.0, 0.7] } else { &DELTAS };
    let thresholds: &[f32] = if few { &[1.0, 2.0] } else { &THRESHOLDS };
    let center = if distances.contains(&DEFAULT_DISTANCE) { DEFAULT_DISTANCE } else { distances[0] };
    let default = Configuration::new(ContactMethod::Circumsphere, center).settings;

    let mut all = Vec::new();
    for &distance in distances {
        all.extend(ContactMethod::ALL.map(|method| Configuration::new(method, distance)));
        // A quick run only has time for the product at one distance.
        if extent == Extent::Full || distance == center {
            for &phi in phis {
                for plane_cull in [true, false] {
                    let settings = CircumsphereSettings { sphere_offset: phi, plane_cull, ..default };
                    all.push(Configuration::circumsphere(settings, distance));
                }
            }
        }
    }
    for &phi in phis {
        all.push(Configuration::circumsphere(
            CircumsphereSettings { sphere_offset: phi, widen_cones: false, ..default },
            center,
        ));
    }
    for estimator in ESTIMATORS {
        for &curvature_threshold in thresholds {
            let settings = CircumsphereSettings { estimator, curvature_threshold, ..default };
            all.push(Configuration::circumsphere(settings, center));
        }
    }
    for &delta in deltas {
        all.push(Configuration::circumsphere(CircumsphereSettings { refit_threshold: delta, ..default }, center));
    }
    for (name, change) in FURTHER_SETTINGS {
        let mut configuration = Configuration::new(ContactMethod::Circumsphere, center);
        change(&mut configuration.settings);
        configuration.name = format!("Circumsphere: {name}");
        all.push(configuration);
    }
    let mut unique: Vec<Configuration> = Vec::new();
    for configuration in all {
        let known = |other: &Configuration| {
            (other.method, other.settings, other.distance_edges)
                == (configuration.method, configuration.settings, configuration.distance_edges)
        };
        if !unique.iter().any(known) {
            unique.push(configuration);
        }
    }
    unique
}
