//! The plots of the report, one sheet per experiment.

use circumsphere_reports::drawing::{
    BLACK, COLORS, DASHES, SHAPES, Sheet, layout, line_entry, marked_line, marker_entry, plain_numbers,
};
use kuva::prelude::{Layout, LegendEntry, LinePlot, LineStyle, Plot};

use super::{
    caps::CapsRow,
    delta::DeltaRow,
    iterations::IterationsRow,
    player::KINDS,
    sizes::{FRAME_MS, SizesRow},
    tested::Tested,
    tunnelling::{TARGETS, TunnellingRow},
};

/// Scales of the axes of a panel.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Axes {
    Linear,
    LogX,
    LogY,
    LogBoth,
}

/// A line over a setting: its points, and the index that selects color, dash, and marker.
type Series = (Vec<(f64, f64)>, usize);

/// Lines over a setting, with room for the outermost markers. If there is no point, the panel is empty.
fn panel(series: &[Series], title: &str, [x, y]: [&str; 2], axes: Axes, top: Option<f64>) -> (Vec<Plot>, Layout) {
    let is_log_y = matches!(axes, Axes::LogY | Axes::LogBoth);
    let is_drawn = |&(_, y): &(f64, f64)| y.is_finite() && (!is_log_y || y > 0.0);
    let mut plots: Vec<Plot> = Vec::new();
    let (mut left, mut right, mut low, mut high) = (f64::INFINITY, 0.0_f64, f64::INFINITY, 0.0_f64);
    for (points, number) in series {
        let points: Vec<(f64, f64)> = points.iter().copied().filter(is_drawn).collect();
        for &(x, y) in &points {
            (left, right, low, high) = (left.min(x), right.max(x), low.min(y), high.max(y));
        }
        if !points.is_empty() {
            let (color, dash) = (COLORS[number % COLORS.len()], DASHES[number % DASHES.len()].clone());
            plots.extend(marked_line(&points, color, dash, SHAPES[number % SHAPES.len()]));
        }
    }
    if plots.is_empty() {
        // All runs flew apart, so there is nothing to draw.
        (left, right, low, high) = (1.0, 10.0, 0.1, 1.0);
        plots.push(LinePlot::new().with_data(vec![(left, low), (left, low)]).with_color(BLACK).into());
    }
    let high = top.unwrap_or(if high > 0.0 { high } else { 1.0 });
    let mut layout = layout(&plots, title, x, y).with_tick_format(plain_numbers());
    layout = match axes {
        Axes::Linear | Axes::LogY => {
            let room = 0.03 * (right - left).max(1.0e-9);
            let layout = if is_log_y { layout.with_log_y() } else { layout };
            layout.with_x_axis_min(left - room).with_x_axis_max(right + room)
        }
        Axes::LogX => layout.with_log_x().with_x_axis_min(left / 1.3).with_x_axis_max(right * 1.3),
        Axes::LogBoth => layout.with_log_scale().with_x_axis_min(left / 1.3).with_x_axis_max(right * 1.3),
    };
    layout = if is_log_y {
        layout.with_y_axis_min(low / 1.5).with_y_axis_max(high * 1.5)
    } else {
        layout.with_y_axis_min(-0.04 * high).with_y_axis_max(1.06 * high)
    };
    (plots, layout)
}

fn entries<Name: AsRef<str>>(names: impl IntoIterator<Item = Name>) -> Vec<LegendEntry> {
    names
        .into_iter()
        .enumerate()
        .map(|(number, name)| marker_entry(name.as_ref(), COLORS[number % COLORS.len()], SHAPES[number % SHAPES.len()]))
        .collect()
}

fn method_entries() -> Vec<LegendEntry> {
    entries(Tested::ALL.map(|method| format!("{method:?}")))
}

pub fn delta(rows: &[DeltaRow]) -> Sheet {
    let measures: [(&str, fn(&DeltaRow) -> Option<f64>, Axes); 4] = [
        ("refresh time (µs per tick)", |row| Some(row.time_refresh_us), Axes::Linear),
        ("spheres refreshed (% per tick)", |row| Some(100.0 * row.refreshed_share), Axes::Linear),
        ("error of cap tops (edges)", |row| Some(row.surface_error_edges), Axes::Linear),
        ("trembling (edges per tick)", |row| row.trembling, Axes::LogY),
    ];
    let panels = measures.into_iter().map(|(label, value, axes)| {
        let series: Vec<Series> = KINDS
            .iter()
            .enumerate()
            .map(|(number, (_, scene))| {
                let own = rows.iter().filter(|row| row.scene == *scene);
                (own.filter_map(|row| Some((f64::from(row.delta), value(row)?))).collect(), number)
            })
            .collect();
        panel(&series, "", ["δ (shape change before a refresh)", label], axes, None)
    });
    Sheet {
        columns: 2,
        panel: (480, 320),
        title: "Spheres follow their triangles, and are made anew beyond a shape change of δ".to_owned(),
        panels: panels.collect(),
        legend: entries(KINDS.map(|(kind, scene)| format!("{scene} ({kind})"))),
    }
}

pub fn iterations(rows: &[IterationsRow]) -> Sheet {
    let measures: [(&str, fn(&IterationsRow) -> Option<f64>, Axes); 4] = [
        ("detection + response (ms)", |row| Some(row.time_detection_ms + row.time_response_ms), Axes::LogBoth),
        ("trembling (edges per tick)", |row| row.trembling, Axes::LogBoth),
        ("contact churn (%)", |row| row.churn.map(|churn| 100.0 * churn), Axes::LogX),
        ("penetration (contact distances)", |row| row.residual_mean, Axes::LogX),
    ];
    let mut panels = Vec::new();
    for (_, scene) in KINDS {
        for (label, value, axes) in measures {
            let of_method = |method: Tested| {
                let own = rows.iter().filter(move |row| row.scene == scene && row.method == method);
                own.filter_map(|row| Some((f64::from(row.iterations), value(row)?))).collect()
            };
            let series: Vec<Series> =
                Tested::ALL.iter().enumerate().map(|(number, &method)| (of_method(method), number)).collect();
            panels.push(panel(&series, scene, ["solver iterations", label], axes, None));
        }
    }
    Sheet {
        columns: 4,
        panel: (400, 280),
        title: "Contact methods against solver iterations (missing points: flew apart)".to_owned(),
        panels,
        legend: method_entries(),
    }
}

pub fn tunnelling(rows: &[TunnellingRow]) -> Sheet {
    let mut panels = Vec::new();
    for continuous in [false, true] {
        for (_, target) in TARGETS {
            let of_method = |method: Tested| {
                let own = rows
                    .iter()
                    .filter(move |row| row.target == target && row.continuous == continuous && row.method == method);
                own.map(|row| (f64::from(row.speed), 100.0 * row.rate)).collect()
            };
            let series: Vec<Series> =
                Tested::ALL.iter().enumerate().map(|(number, &method)| (of_method(method), number)).collect();
            let title = format!("{target}{}", if continuous { ", continuous detection" } else { "" });
            panels.push(panel(
                &series,
                &title,
                ["speed (thicknesses per tick)", "shots that tunnel (%)"],
                Axes::LogX,
                Some(100.0),
            ));
        }
    }
    Sheet {
        columns: 3,
        panel: (440, 300),
        title: "Tunnelling against speed, without and with continuous detection".to_owned(),
        panels,
        legend: method_entries(),
    }
}

pub fn caps(rows: &[CapsRow]) -> Sheet {
    let measures: [(&str, fn(&CapsRow) -> f64); 4] = [
        ("shots that tunnel (%)", |row| row.tunnelling_rate),
        ("touching pairs missed (%)", |row| row.missed_share),
        ("missed under the beam's edge (%)", |row| row.missed_share_on_edge),
        ("examined needlessly (%)", |row| row.needless_share),
    ];
    let mut thresholds: Vec<f32> = rows.iter().map(|row| row.curvature_threshold).collect();
    thresholds.sort_by(f32::total_cmp);
    thresholds.dedup();
    let panels = measures.into_iter().map(|(label, value)| {
        let of_threshold = |threshold: f32| {
            let own = rows.iter().filter(move |row| row.curvature_threshold == threshold);
            own.map(|row| (f64::from(row.phi), 100.0 * value(row))).collect()
        };
        let series: Vec<Series> =
            thresholds.iter().enumerate().map(|(number, &threshold)| (of_threshold(threshold), number)).collect();
        panel(&series, "", ["φ (center height in radii)", label], Axes::Linear, None)
    });
    Sheet {
        columns: 2,
        panel: (480, 320),
        title: "φ and the curvature threshold of the circumsphere method".to_owned(),
        panels: panels.collect(),
        legend: entries(thresholds.iter().map(|threshold| format!("threshold {threshold}"))),
    }
}

pub fn sizes(rows: &[SizesRow]) -> Sheet {
    let shares: [(&str, fn(&SizesRow) -> f64); 2] = [
        ("detection alone", |row| row.frame_share_detection_alone),
        ("detection and response", |row| row.frame_share_with_response),
    ];
    let (mut series, mut names) = (Vec::new(), Vec::new());
    for (name, share) in shares {
        for method in [Tested::Exact, Tested::Circumsphere] {
            let own = rows.iter().filter(|row| row.method == method);
            let points = own.map(|row| (row.deforming_vertices as f64, share(row) * FRAME_MS));
            series.push((points.collect(), series.len()));
            names.push(format!("{method:?}, {name}"));
        }
    }
    let (mut plots, layout) =
        panel(&series, "", ["deforming vertices", "time per tick (ms), one thread"], Axes::LogBoth, None);
    let ends =
        |pick: fn(f64, f64) -> f64, start: f64| rows.iter().map(|row| row.deforming_vertices as f64).fold(start, pick);
    let frame = vec![(ends(f64::min, f64::INFINITY), FRAME_MS), (ends(f64::max, 0.0), FRAME_MS)];
    plots.push(LinePlot::new().with_data(frame).with_color(BLACK).with_line_style(LineStyle::Dotted).into());
    let mut legend = entries(names);
    legend.push(line_entry("a frame at 60 frames per second", BLACK, &LineStyle::Dotted));
    Sheet {
        columns: 1,
        panel: (760, 460),
        title: "Cloth on ground with 33 triangles per cloth vertex".to_owned(),
        panels: vec![(plots, layout)],
        legend,
    }
}
