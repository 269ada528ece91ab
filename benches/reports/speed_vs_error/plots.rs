//! The plots of the report.

use std::path::Path;

use bevy_circumsphere::ContactMethod;
use circumsphere_reports::{
    drawing::{
        BLACK, BLUE, COLORS, DASHES, GREEN, ORANGE, PURPLE, SHAPES, SKY, Sheet, VERMILION, YELLOW, layout, line_entry,
        marked_line, marker_entry, plain_numbers,
    },
    statistics::{mean, pareto_front},
};
use kuva::prelude::{BarPlot, Layout, LegendEntry, LegendShape, LinePlot, LineStyle, MarkerShape, Plot, ScatterPlot};

use super::{
    ReportError,
    configurations::{DEFAULT_DISTANCE, estimator_name},
    measure::Measured,
    pooled::Pooled,
    report::Study,
    scaling,
};

/// A plot that was written: its file name without extension, and its description.
pub struct Drawn {
    pub name: &'static str,
    pub shows: &'static str,
}

/// Points, color, dash, and marker of a line.
type Line<'a> = (Vec<(f64, f64)>, &'a str, usize, MarkerShape);

/// Lines over a setting, with y from 0 upwards and room for the outermost markers.
fn line_panel(lines: &[Line], x: &str, y: &str) -> (Vec<Plot>, Layout) {
    let mut plots = Vec::new();
    let (mut left, mut right, mut top) = (f64::INFINITY, f64::NEG_INFINITY, 0.0_f64);
    for (points, color, dash, shape) in lines {
        plots.extend(marked_line(points, color, DASHES[*dash].clone(), *shape));
        for &(x, y) in points {
            (left, right, top) = (left.min(x), right.max(x), top.max(y));
        }
    }
    let room = 0.03 * (right - left);
    let top = if top > 0.0 { top } else { 1.0 };
    let layout = layout(&plots, "", x, y)
        .with_x_axis_min(left - room)
        .with_x_axis_max(right + room)
        .with_y_axis_min(-0.03 * top)
        .with_y_axis_max(1.06 * top);
    (plots, layout)
}

fn percent(share: Option<f64>) -> Option<f64> {
    share.map(|share| 100.0 * share)
}

/// Series of a speed–error plot: label, color, marker, and size.
const GROUPS: [(&str, &str, MarkerShape, f64); 7] = [
    ("BoundingSphere", ORANGE, MarkerShape::Square, 6.0),
    ("Circumsphere without plane cull", SKY, MarkerShape::TriangleDown, 4.5),
    ("Circumsphere with plane cull", BLUE, MarkerShape::Circle, 4.5),
    ("Circumsphere, defaults", VERMILION, MarkerShape::Star, 8.0),
    ("Closest", PURPLE, MarkerShape::Diamond, 7.0),
    ("Exact (default method)", GREEN, MarkerShape::Diamond, 7.0),
    ("Polygon", BLACK, MarkerShape::Cross, 6.0),
];

fn group(configuration: &super::configurations::Configuration) -> usize {
    match configuration.method {
        ContactMethod::BoundingSphere => 0,
        ContactMethod::Circumsphere if configuration.is_default() => 3,
        ContactMethod::Circumsphere if configuration.settings.plane_cull => 2,
        ContactMethod::Circumsphere => 1,
        ContactMethod::Closest => 4,
        ContactMethod::Exact => 5,
        ContactMethod::Polygon => 6,
    }
}

fn group_legend() -> Vec<LegendEntry> {
    let mut entries: Vec<LegendEntry> =
        GROUPS.iter().map(|&(label, color, shape, _)| marker_entry(label, color, shape)).collect();
    entries.push(line_entry("Pareto front (ringed)", BLACK, &LineStyle::Dashed));
    entries
}

/// Points by time and error, colored by group, with the Pareto front marked.
fn speed_error_panel(points: &[(usize, f64, f64)], title: &str, x: &str, y: &str) -> (Vec<Plot>, Layout) {
    let mut plots: Vec<Plot> = Vec::new();
    let places: Vec<(f64, f64)> = points.iter().map(|&(_, time, error)| (time, error)).collect();
    let front: Vec<(f64, f64)> = pareto_front(&places).into_iter().map(|place| places[place]).collect();
    let line = LinePlot::new().with_data(front.clone()).with_color(BLACK).with_stroke_width(1.2).with_step();
    plots.push(line.with_line_style(LineStyle::Dashed).into());
    let rings = ScatterPlot::new().with_data(front).with_color(BLACK).with_size(10.0);
    plots.push(rings.with_marker_opacity(0.0).with_marker_stroke_width(1.5).into());
    for (number, &(_, color, shape, size)) in GROUPS.iter().enumerate() {
        let own: Vec<(f64, f64)> =
            points.iter().filter(|point| point.0 == number).map(|&(_, time, error)| (time, error)).collect();
        if !own.is_empty() {
            let marks = ScatterPlot::new().with_data(own).with_color(color).with_marker(shape).with_size(size);
            plots.push(marks.with_marker_opacity(0.85).into());
        }
    }
    let top = places.iter().map(|place| place.1).fold(1.0, f64::max) * 1.06;
    let right = places.iter().map(|place| place.0).fold(0.0, f64::max) * 1.06;
    let layout = layout(&plots, title, x, y)
        .with_x_axis_min(0.0)
        .with_x_axis_max(right)
        // Room for the markers of points without error.
        .with_y_axis_min(-0.05 * top)
        .with_y_axis_max(top);
    (plots, layout)
}

/// Draws all plots for which there is data.
pub fn draw(folder: &Path, study: &Study) -> Result<Vec<Drawn>, ReportError> {
    let mut drawn = Vec::new();
    let mut add = |name: &'static str, shows: &'static str, sheet: Option<Sheet>| -> Result<(), ReportError> {
        if let Some(sheet) = sheet {
            sheet.write(folder, name)?;
            drawn.push(Drawn { name, shows });
        }
        Ok(())
    };
    add("speed_vs_error", "Time against error, all scenes pooled", Some(speed_vs_error(study)))?;
    add("speed_vs_error_by_scene", "Time against error, scene by scene", Some(speed_vs_error_by_scene(study)))?;
    add("error_vs_phi", "Error against φ", error_vs_phi(study))?;
    add("error_vs_curvature", "Error against curvature estimator and threshold", error_vs_curvature(study))?;
    add("error_vs_delta", "Error and refresh cost against δ", error_vs_delta(study))?;
    add("time_vs_triangles", "Time against number of triangles", time_vs_triangles(study))?;
    add("time_by_stage", "Time by stage", Some(time_by_stage(study)))?;
    Ok(drawn)
}

/// An error measure to draw: the label of its axis, its value for a scene, and its value for all scenes.
type ErrorMeasure = (&'static str, fn(&Measured) -> Option<f64>, fn(&Pooled) -> Option<f64>);
const ERRORS: [ErrorMeasure; 3] = [
    ("missed pairs (%)", |one| percent(one.row.pair_miss_rate), |all| percent(all.row.pair_miss_rate)),
    ("false pairs (%)", |one| percent(one.row.pair_false_rate), |all| percent(all.row.pair_false_rate)),
    ("1 − F1 (%)", |one| percent(one.row.pair_error), |all| percent(all.row.pair_error)),
];

fn speed_vs_error(study: &Study) -> Sheet {
    let distance = study.center_distance();
    let panels: Vec<_> = ERRORS
        .iter()
        .map(|&(label, _, of_all)| {
            let points: Vec<(usize, f64, f64)> = study
                .pooled
                .iter()
                .filter(|all| all.configuration.distance_edges == distance)
                .filter_map(|all| Some((group(&all.configuration), all.row.time_ratio?, of_all(all)?)))
                .collect();
            speed_error_panel(&points, "", "time (Exact = 1)", label)
        })
        .collect();
    Sheet {
        columns: 2,
        panel: (470, 340),
        title: format!("Speed against error, mean of {} scenes, contact distance {distance} edges", study.scenes.len()),
        panels,
        legend: group_legend(),
    }
}

fn speed_vs_error_by_scene(study: &Study) -> Sheet {
    let distance = study.center_distance();
    let mut panels = Vec::new();
    for scene in &study.scenes {
        for &(label, of_scene, _) in &ERRORS {
            let points: Vec<(usize, f64, f64)> = study
                .measured
                .iter()
                .filter(|one| one.row.scene == scene.name && one.configuration.distance_edges == distance)
                .filter_map(|one| Some((group(&one.configuration), one.row.time_ms, of_scene(one)?)))
                .collect();
            panels.push(speed_error_panel(&points, &scene.name, "time per tick (ms)", label));
        }
    }
    Sheet {
        columns: 3,
        panel: (440, 300),
        title: format!("Speed against error, scene by scene, contact distance {distance} edges"),
        panels,
        legend: group_legend(),
    }
}

/// Panels of all error measures over a setting, with one line per series. `None` if no series has two points.
fn error_lines(
    x: &str,
    series: &[(String, &str, usize, Vec<(f64, &Pooled)>)],
) -> Option<(Vec<(Vec<Plot>, Layout)>, Vec<LegendEntry>)> {
    if series.iter().all(|(.., points)| points.len() < 2) {
        return None;
    }
    let panels = ERRORS
        .iter()
        .map(|&(label, _, of_all)| {
            let lines = series.iter().enumerate().map(|(number, (_, color, dash, points))| {
                let points = points.iter().filter_map(|&(x, all)| Some((x, of_all(all)?))).collect();
                (points, *color, *dash, SHAPES[number % SHAPES.len()])
            });
            line_panel(&lines.collect::<Vec<_>>(), x, label)
        })
        .collect();
    let entry = |(number, (name, color, ..)): (usize, &(String, &str, usize, Vec<(f64, &Pooled)>))| {
        marker_entry(name, color, SHAPES[number % SHAPES.len()])
    };
    Some((panels, series.iter().enumerate().map(entry).collect()))
}

fn error_vs_phi(study: &Study) -> Option<Sheet> {
    let mut series = Vec::new();
    for (number, &distance) in study.distances().iter().enumerate() {
        for (plane_cull, widen_cones) in [(true, true), (false, true), (true, false)] {
            let mut points: Vec<(f64, &Pooled)> = study
                .pooled
                .iter()
                .filter(|all| {
                    let configuration = &all.configuration;
                    configuration.distance_edges == distance
                        && configuration.settings.plane_cull == plane_cull
                        && configuration.settings.widen_cones == widen_cones
                        && configuration.is_default_but(|settings, default| {
                            settings.sphere_offset = default.sphere_offset;
                            settings.plane_cull = default.plane_cull;
                            settings.widen_cones = default.widen_cones;
                        })
                })
                .map(|all| (f64::from(all.configuration.settings.sphere_offset), all))
                .collect();
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            let (what, dash) = match (plane_cull, widen_cones) {
                (true, true) => ("defaults", 0),
                (false, _) => ("no plane cull", 1),
                (true, false) => ("narrow cones", 2),
            };
            series.push((format!("{distance} edges, {what}"), COLORS[number % COLORS.len()], dash, points));
        }
    }
    series.retain(|(.., points)| points.len() > 1);
    let (panels, legend) = error_lines("φ (center height in radii)", &series)?;
    let title = "Circumsphere: error against φ, mean of all scenes".to_owned();
    Some(Sheet { columns: 2, panel: (470, 340), title, panels, legend })
}

fn error_vs_curvature(study: &Study) -> Option<Sheet> {
    let mut series: Vec<(String, &str, usize, Vec<(f64, &Pooled)>)> = Vec::new();
    for all in &study.pooled {
        let configuration = &all.configuration;
        let only_curvature = configuration.is_default_but(|settings, default| {
            settings.estimator = default.estimator;
            settings.curvature_threshold = default.curvature_threshold;
        });
        if !only_curvature || configuration.distance_edges != study.center_distance() {
            continue;
        }
        let name = estimator_name(configuration.settings.estimator);
        let point = (f64::from(configuration.settings.curvature_threshold), all);
        if let Some((.., points)) = series.iter_mut().find(|(known, ..)| known == name) {
            points.push(point);
        } else {
            let number = series.len();
            series.push((name.to_owned(), COLORS[number % COLORS.len()], number % DASHES.len(), vec![point]));
        }
    }
    for (.., points) in &mut series {
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
    }
    let (panels, legend) = error_lines("curvature threshold (curvature × radius)", &series)?;
    let title = "Circumsphere: error against curvature estimator and threshold, mean of all scenes".to_owned();
    Some(Sheet { columns: 2, panel: (470, 340), title, panels, legend })
}

/// Measures to draw against δ: the label of the axis, and the value for a scene.
const DELTA_MEASURES: [(&str, fn(&Measured) -> Option<f64>); 4] = [
    ("missed pairs (%)", |one| percent(one.row.pair_miss_rate)),
    ("false pairs (%)", |one| percent(one.row.pair_false_rate)),
    ("spheres refreshed per tick (%)", |one| percent(one.row.recipes_refreshed_share)),
    ("normal jump, 99th percentile (°)", |one| one.row.normal_jump_p99),
];

fn error_vs_delta(study: &Study) -> Option<Sheet> {
    let scenes: Vec<&str> =
        study.scenes.iter().filter(|scene| scene.deforms).map(|scene| scene.name.as_str()).take(6).collect();
    let points = |scene: &str, value: fn(&Measured) -> Option<f64>| {
        let mut points: Vec<(f64, f64)> = study
            .delta_series(scene)
            .filter_map(|one| Some((f64::from(one.configuration.settings.refit_threshold), value(one)?)))
            .collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        points
    };
    if scenes.iter().all(|scene| points(scene, DELTA_MEASURES[0].1).len() < 2) {
        return None;
    }
    let panels = DELTA_MEASURES
        .iter()
        .map(|&(label, value)| {
            let lines = scenes
                .iter()
                .enumerate()
                .map(|(number, scene)| (points(scene, value), COLORS[number], number % DASHES.len(), SHAPES[number]));
            line_panel(&lines.collect::<Vec<_>>(), "δ (shape change before a refresh)", label)
        })
        .collect();
    let legend =
        scenes.iter().enumerate().map(|(number, scene)| marker_entry(scene, COLORS[number], SHAPES[number])).collect();
    let title = "Circumsphere: error and refresh cost against δ, deforming scenes".to_owned();
    Some(Sheet { columns: 2, panel: (470, 320), title, panels, legend })
}

fn time_vs_triangles(study: &Study) -> Option<Sheet> {
    if study.scaling.is_empty() {
        return None;
    }
    let mut plots = Vec::new();
    let mut legend = Vec::new();
    let colors = [ORANGE, VERMILION, PURPLE, GREEN, BLACK];
    for (number, method) in ContactMethod::ALL.into_iter().enumerate() {
        let name = format!("{method:?}");
        let points: Vec<(f64, f64)> = study
            .scaling
            .iter()
            .filter(|row| row.method == name)
            .map(|row| (row.triangles as f64, row.time_ms))
            .collect();
        plots.extend(marked_line(&points, colors[number], DASHES[number % DASHES.len()].clone(), SHAPES[number]));
        let slope =
            scaling::slope(&study.scaling, method).map_or_else(String::new, |slope| format!(", slope {slope:.2}"));
        legend.push(marker_entry(&(name + &slope), colors[number], SHAPES[number]));
    }
    let largest = study.scaling.iter().map(|row| row.triangles as f64).fold(0.0, f64::max);
    let layout = layout(&plots, "", "triangles", "time per tick (ms)")
        .with_log_scale()
        .with_tick_format(plain_numbers())
        // Room for the outermost markers.
        .with_x_axis_min(800.0)
        .with_x_axis_max(1.3 * largest);
    let title = format!("Time against number of triangles, contact distance {DEFAULT_DISTANCE} edges");
    Some(Sheet { columns: 1, panel: (760, 480), title, panels: vec![(plots, layout)], legend })
}

/// Groups of stages that are drawn together, and their colors.
const STAGE_GROUPS: [(&str, &[&str], &str); 8] = [
    ("bounds and trees", &["prepare", "bounds", "pair surfaces", "patches", "tree update"], BLACK),
    ("broad phase", &["broad phase"], SKY),
    ("curvature", &["curvature"], YELLOW),
    ("spheres", &["refit", "refit balls"], ORANGE),
    ("overlap", &["overlap"], BLUE),
    ("cone", &["cone"], PURPLE),
    ("exact", &["exact"], GREEN),
    ("contacts", &["contacts"], VERMILION),
];

/// Milliseconds per thousand triangles that a method spends in a group of stages, mean of all scenes.
pub fn stage_time(study: &Study, method: ContactMethod, group: usize) -> f64 {
    let times = study.scenes.iter().map(|scene| {
        let stages = study
            .measured
            .iter()
            .filter(|one| {
                one.row.scene == scene.name
                    && one.configuration.method == method
                    && one.configuration.is_default()
                    && one.configuration.distance_edges == study.center_distance()
            })
            .flat_map(|one| &one.stages)
            .filter(|stage| stage_group(stage.stage) == group);
        stages.map(|stage| stage.time_ms).sum::<f64>() * 1.0e3 / scene.triangles as f64
    });
    mean(times).unwrap_or_default()
}

/// The group of a stage. A stage without a group belongs to the first one.
fn stage_group(stage: &str) -> usize {
    STAGE_GROUPS.iter().position(|(_, stages, _)| stages.contains(&stage)).unwrap_or(0)
}

fn time_by_stage(study: &Study) -> Sheet {
    let mut bars = BarPlot::new();
    for method in ContactMethod::ALL {
        let values: Vec<(f64, &str)> = STAGE_GROUPS
            .iter()
            .enumerate()
            .map(|(group, &(_, _, color))| (stage_time(study, method, group), color))
            .collect();
        bars = bars.with_group(format!("{method:?}"), values);
    }
    let plots: Vec<Plot> = vec![bars.with_stacked().into()];
    let layout = layout(&plots, "", "method", "time per tick (ms per 1000 triangles)");
    let legend = STAGE_GROUPS
        .iter()
        .map(|&(name, _, color)| LegendEntry {
            label: name.to_owned(),
            color: color.to_owned(),
            shape: LegendShape::Rect,
            dasharray: None,
        })
        .collect();
    let title = format!("Time by stage, mean of all scenes, contact distance {} edges", study.center_distance());
    Sheet { columns: 1, panel: (760, 460), title, panels: vec![(plots, layout)], legend }
}

/// Names of the groups of stages, in drawing order.
pub fn stage_group_names() -> impl Iterator<Item = &'static str> {
    STAGE_GROUPS.iter().map(|(name, ..)| *name)
}
