//! At equal error: how many times as many triangles and as much time flat surfaces need.
//!
//! Errors are in sizes, and those of normals in degrees.

use circumsphere_reports::bounded::{Bounded, at_error};
use serde::Serialize;

use super::measure::Cell;

/// Errors of distances below this are rounding: single precision at the size of 1.
const LEAST_ERROR: f64 = f32::EPSILON as f64;

/// Errors in sizes at which both shapes are compared.
pub const TARGETS: [f64; 3] = [1.0e-2, 1.0e-3, 1.0e-4];

/// An error of the two that are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Measure {
    Distance,
    Normal,
}

impl Measure {
    pub const ALL: [Self; 2] = [Self::Distance, Self::Normal];

    /// Errors below this count as this. A normal is as exact as a distance over an edge, so rounding is far below.
    fn least(self) -> f64 {
        match self {
            Self::Distance => LEAST_ERROR,
            Self::Normal => LEAST_ERROR.to_degrees(),
        }
    }

    pub fn of(self, cell: &Cell) -> Option<f64> {
        match self {
            Self::Distance => cell.error_mean,
            Self::Normal => cell.normal_mean_degrees,
        }
    }
}

/// How many times as many triangles and as much time flat surfaces need for the error of a surface.
#[derive(Clone, Debug, Serialize)]
pub struct EqualError {
    pub scene: &'static str,
    pub method: String,
    pub measure: Measure,
    /// The surface whose error both have: its shape, and its level of refinement.
    pub at: &'static str,
    pub level: u32,
    pub error: f64,
    pub triangles_factor: Bounded,
    pub time_factor: Bounded,
}

/// What both shapes need for a given error of the distance.
#[derive(Clone, Debug, Serialize)]
pub struct AtTarget {
    pub scene: &'static str,
    pub method: String,
    /// In sizes.
    pub error: f64,
    pub flat_triangles: Bounded,
    pub smooth_triangles: Bounded,
    pub flat_time_ms: Bounded,
    pub smooth_time_ms: Bounded,
    /// Flat over smooth. `None` where both curves end on the same side of the error.
    pub triangles_factor: Option<Bounded>,
    pub time_factor: Option<Bounded>,
}

/// The cells of one scene, method, and shape, coarse to fine.
pub fn curve_of<'a>(
    cells: &'a [Cell],
    scene: &'a str,
    method: &'a str,
    shape: &'a str,
) -> impl Iterator<Item = &'a Cell> {
    cells.iter().filter(move |cell| cell.scene == scene && cell.method == method && cell.shape == shape)
}

/// Scenes and methods of the cells, each pair once, in order.
fn groups(cells: &[Cell]) -> Vec<(&'static str, String)> {
    let mut groups: Vec<(&'static str, String)> = Vec::new();
    for cell in cells {
        let group = (cell.scene, cell.method.clone());
        if !groups.contains(&group) {
            groups.push(group);
        }
    }
    groups
}

/// Reads the curve of flat surfaces at the errors of smooth ones, and the other way round.
pub fn equal_errors(cells: &[Cell]) -> Vec<EqualError> {
    let mut found = Vec::new();
    for (scene, method) in groups(cells) {
        for measure in Measure::ALL {
            for [at, other] in [["Smooth", "Flat"], ["Flat", "Smooth"]] {
                let needed = |value: fn(&Cell) -> f64, error: f64| {
                    let curve: Vec<(f64, f64)> = curve_of(cells, scene, &method, other)
                        .filter_map(|cell| Some((measure.of(cell)?, value(cell))))
                        .collect();
                    at_error(&curve, error, measure.least())
                };
                found.extend(curve_of(cells, scene, &method, at).filter_map(|cell| {
                    let error = measure.of(cell)?;
                    let factor = |value: fn(&Cell) -> f64| {
                        let (own, needed) = (Bounded::exactly(value(cell)), needed(value, error)?);
                        if at == "Flat" { own.over(needed) } else { needed.over(own) }
                    };
                    let (triangles_factor, time_factor) =
                        (factor(|cell| cell.triangles)?, factor(|cell| cell.time_ms)?);
                    let (method, level) = (method.clone(), cell.level);
                    Some(EqualError { scene, method, measure, at, level, error, triangles_factor, time_factor })
                }));
            }
        }
    }
    found
}

pub fn at_targets(cells: &[Cell]) -> Vec<AtTarget> {
    let mut found = Vec::new();
    for (scene, method) in groups(cells) {
        let needed = |shape: &str, value: fn(&Cell) -> f64, error: f64| {
            let curve: Vec<(f64, f64)> = curve_of(cells, scene, &method, shape)
                .filter_map(|cell| Some((cell.error_mean?, value(cell))))
                .collect();
            at_error(&curve, error, LEAST_ERROR)
        };
        found.extend(TARGETS.into_iter().filter_map(|error| {
            let [flat_triangles, smooth_triangles] =
                [needed("Flat", |cell| cell.triangles, error)?, needed("Smooth", |cell| cell.triangles, error)?];
            let [flat_time_ms, smooth_time_ms] =
                [needed("Flat", |cell| cell.time_ms, error)?, needed("Smooth", |cell| cell.time_ms, error)?];
            Some(AtTarget {
                scene,
                method: method.clone(),
                error,
                flat_triangles,
                smooth_triangles,
                flat_time_ms,
                smooth_time_ms,
                triangles_factor: flat_triangles.over(smooth_triangles),
                time_factor: flat_time_ms.over(smooth_time_ms),
            })
        }));
    }
    found
}
