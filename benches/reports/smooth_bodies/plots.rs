//! The plots of the report.

use std::{path::Path, sync::Arc};

use circumsphere_reports::{
    OutputError,
    drawing::{BLUE, SHAPES, Sheet, VERMILION, layout, marked_line, marker_entry},
    finding::figure,
};
use kuva::plot::LabelStyle;
use kuva::prelude::{Layout, LegendEntry, LinePlot, LineStyle, Plot, ScatterPlot, TickFormat};

use super::{
    Study,
    measure::Cell,
    rolling::{self, RollingRow},
    scenes::{Kind, SCENES},
};

/// A plot that was written: its file name without extension, and its description.
pub struct Drawn {
    pub name: &'static str,
    pub shows: &'static str,
}

/// Color, dash, and marker of flat and smooth surfaces.
const STYLES: [(&str, &str, LineStyle, usize); 2] =
    [("Flat", BLUE, LineStyle::Dashed, 1), ("Smooth", VERMILION, LineStyle::Solid, 0)];

/// A value of a cell on an axis, with the label of the axis.
type Axis = (&'static str, fn(&Cell) -> Option<f64>);

const TRIANGLES: Axis = ("triangles per body", |cell| Some(cell.triangles));
const TIME: Axis = ("time per tick (ms)", |cell| Some(cell.time_ms));
const ERROR: Axis = ("error of distance (% of size)", |cell| cell.error_mean.map(|error| 100.0 * error));
const NORMAL: Axis = ("error of normal (°)", |cell| cell.normal_mean_degrees);

/// Plain numbers, with powers of ten for small ones and thousands for large ones.
fn plain_powers() -> TickFormat {
    TickFormat::Custom(Arc::new(|value| match value {
        1.0e4.. => format!("{} k", figure(value / 1.0e3)),
        1.0e-3.. => figure(value),
        _ => format!("{value:.0e}"),
    }))
}

fn legend() -> Vec<LegendEntry> {
    STYLES.iter().map(|(name, color, _, shape)| marker_entry(&name.to_lowercase(), color, SHAPES[*shape])).collect()
}

/// Flat and smooth as two curves on logarithmic axes. Points without a value, or with a value of 0, are left out.
fn curves(curves: &[Vec<(f64, f64)>; 2], title: &str, x: &str, y: &str) -> (Vec<Plot>, Layout) {
    let mut plots = Vec::new();
    for ((_, color, style, shape), points) in STYLES.iter().zip(curves) {
        let drawn: Vec<(f64, f64)> = points.iter().copied().filter(|&(x, y)| x > 0.0 && y > 0.0).collect();
        plots.extend(marked_line(&drawn, color, style.clone(), SHAPES[*shape]));
    }
    let all = || curves.iter().flatten();
    let ends = |value: fn(&(f64, f64)) -> f64| {
        let values = all().map(value).filter(|value| *value > 0.0);
        values.fold((f64::INFINITY, 0.0_f64), |(low, high), value| (low.min(value), high.max(value)))
    };
    let ((left, right), (low, high)) = (ends(|point| point.0), ends(|point| point.1));
    let layout = layout(&plots, title, x, y)
        .with_log_scale()
        .with_tick_format(plain_powers())
        .with_x_axis_min(left / 1.3)
        .with_x_axis_max(right * 1.3)
        .with_y_axis_min(low / 1.5)
        .with_y_axis_max(high * 1.5);
    (plots, layout)
}

/// The curves of one scene with the first method.
fn scene_panel(study: &Study, scene: &str, x: Axis, y: Axis) -> (Vec<Plot>, Layout) {
    let points = STYLES.map(|(shape, ..)| -> Vec<(f64, f64)> {
        let cells = study.curve(scene, shape);
        cells.filter_map(|cell| Some((x.1(cell)?, y.1(cell)?))).collect()
    });
    curves(&points, scene, x.0, y.0)
}

/// The curves of the geometric means over all scenes, with the number of triangles beside each point.
fn summary_panel(study: &Study, y: Axis) -> (Vec<Plot>, Layout) {
    let (mut places, mut texts) = (Vec::new(), Vec::new());
    let points = STYLES.map(|(shape, ..)| {
        let mut points = Vec::new();
        for level in study.levels() {
            let of = |value| study.mean(level, shape, value);
            if let (Some(time), Some(error), Some(triangles)) = (of(TIME.1), of(y.1), of(TRIANGLES.1)) {
                points.push((time, error));
                places.push((time * 1.16, error * 1.25));
                texts.push(triangles.round().to_string());
            }
        }
        points
    });
    let (mut plots, layout) = curves(&points, "", TIME.0, y.0);
    let labels = ScatterPlot::new().with_data(places.clone()).with_marker_opacity(0.0).with_labels(texts);
    plots.push(labels.with_label_style(LabelStyle::Exact).into());
    // Room for the outermost labels.
    let end = |value: fn(&(f64, f64)) -> f64| places.iter().map(value).fold(0.0, f64::max);
    let layout = layout.with_x_axis_max(1.5 * end(|place| place.0)).with_y_axis_max(2.0 * end(|place| place.1));
    (plots, layout)
}

fn kind_sheet(study: &Study, kind: Kind) -> Option<Sheet> {
    let scenes: Vec<&str> = SCENES
        .iter()
        .filter(|scene| scene.kind == kind && study.curve(scene.name, "Flat").next().is_some())
        .map(|scene| scene.name)
        .collect();
    let panels: Vec<_> = scenes
        .iter()
        .flat_map(|scene| {
            [(TIME, ERROR), (TRIANGLES, ERROR), (TRIANGLES, NORMAL)].map(|(x, y)| scene_panel(study, scene, x, y))
        })
        .collect();
    let title = format!("Error against time and triangles, {}", kind.name());
    (!panels.is_empty()).then(|| Sheet { columns: 3, panel: (420, 300), title, panels, legend: legend() })
}

/// The errors along the paths of the rolling ball.
fn rolling_sheet(study: &Study) -> Option<Sheet> {
    let rows: Vec<&RollingRow> = study.rolling.iter().filter(|row| row.method == study.rolling[0].method).collect();
    let mut panels = Vec::new();
    for (ground, _) in rolling::GROUNDS {
        for (place, label) in [(0, "error of distance (edges)"), (1, "normal along the path (°)")] {
            let (mut plots, mut low, mut high): (Vec<Plot>, f64, f64) = (Vec::new(), 0.0, 0.0);
            for (shape, color, ..) in STYLES {
                let row = rows.iter().find(|row| row.ground == ground && row.shape == shape)?;
                let points: Vec<(f64, f64)> = (0..row.ticks)
                    .filter_map(|tick| Some((tick as f64 / row.ticks as f64, row.path[tick]?[place])))
                    .collect();
                for &(_, value) in &points {
                    (low, high) = (low.min(value), high.max(value));
                }
                plots.push(LinePlot::new().with_data(points).with_color(color).with_stroke_width(1.5).into());
            }
            let room = 0.06 * (high - low).max(f64::MIN_POSITIVE);
            let layout = layout(&plots, &format!("over a coarse {ground}"), "share of the path", label)
                .with_x_axis_min(0.0)
                .with_x_axis_max(1.0)
                .with_y_axis_min(low - room)
                .with_y_axis_max(high + room);
            panels.push((plots, layout));
        }
    }
    let title = "A ball of triangles rolls over coarse bodies".to_owned();
    Some(Sheet { columns: 2, panel: (600, 280), title, panels, legend: legend() })
}

/// Draws all plots for which there is data.
pub fn draw(folder: &Path, study: &Study) -> Result<Vec<Drawn>, OutputError> {
    let summary = Sheet {
        columns: 2,
        panel: (560, 420),
        title: format!(
            "Flat and smooth surfaces, mean of {} scenes; numbers: triangles per body",
            study.scenes().len()
        ),
        panels: [ERROR, NORMAL].map(|y| summary_panel(study, y)).into(),
        legend: legend(),
    };
    let sheets = [
        ("error_vs_time", "Error against time, flat and smooth", Some(summary)),
        (Kind::Bodies.file(), "Closed bodies of a fixed shape", kind_sheet(study, Kind::Bodies)),
        (Kind::Deforming.file(), "An ellipsoid that pulses", kind_sheet(study, Kind::Deforming)),
        (Kind::Cloth.file(), "A sheet with waves", kind_sheet(study, Kind::Cloth)),
        ("rolling", "Errors along the path of a rolling ball", rolling_sheet(study)),
    ];
    let mut drawn = Vec::new();
    for (name, shows, sheet) in sheets {
        if let Some(sheet) = sheet {
            sheet.write(folder, name)?;
            drawn.push(Drawn { name, shows });
        }
    }
    Ok(drawn)
}
