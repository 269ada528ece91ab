//! Figures for reports: sheets of panels, each as SVG and PNG. Color-blind readers can tell the colors apart (Okabe and
//! Ito, 2008), and each series has its own marker or dash.

use std::{fs, path::Path, sync::Arc};

use kuva::{
    backend::{raster::RasterBackend, svg::SvgBackend},
    prelude::{
        Figure, Layout, LegendEntry, LegendPlot, LegendShape, LinePlot, LineStyle, MarkerShape, Plot, ScatterPlot,
        TickFormat,
    },
};

use crate::OutputError;

pub const BLACK: &str = "#000000";
pub const ORANGE: &str = "#E69F00";
pub const SKY: &str = "#56B4E9";
pub const GREEN: &str = "#009E73";
pub const YELLOW: &str = "#F0E442";
pub const BLUE: &str = "#0072B2";
pub const VERMILION: &str = "#D55E00";
pub const PURPLE: &str = "#CC79A7";
pub const COLORS: [&str; 8] = [BLUE, ORANGE, GREEN, PURPLE, SKY, VERMILION, BLACK, YELLOW];
pub const SHAPES: [MarkerShape; 6] = [
    MarkerShape::Circle,
    MarkerShape::Square,
    MarkerShape::Triangle,
    MarkerShape::Diamond,
    MarkerShape::TriangleDown,
    MarkerShape::Pentagon,
];
pub const DASHES: [LineStyle; 4] = [LineStyle::Solid, LineStyle::Dashed, LineStyle::Dotted, LineStyle::DashDot];

/// PNG pixels per drawing unit: sharp at the width of a README.
const PIXELS: f32 = 2.0;

/// A figure: panels in rows, followed by a cell with the legend.
pub struct Sheet {
    pub columns: usize,
    /// Width and height of a panel.
    pub panel: (u16, u16),
    pub title: String,
    pub panels: Vec<(Vec<Plot>, Layout)>,
    pub legend: Vec<LegendEntry>,
}

impl Sheet {
    pub fn write(self, folder: &Path, name: &str) -> Result<(), OutputError> {
        let (mut plots, mut layouts): (Vec<_>, Vec<_>) = self.panels.into_iter().unzip();
        // In a full grid, the legend gets its own row at full width. Otherwise it uses the free cells.
        let is_full = plots.len() % self.columns == 0;
        let rows = plots.len() / self.columns + 1;
        let mut structure: Vec<Vec<usize>> = (0..plots.len()).map(|cell| vec![cell]).collect();
        structure.push((plots.len()..rows * self.columns).collect());
        let mut legend = LegendPlot::from_entries(self.legend.clone()).without_box();
        // A letter is rarely wider than nine units, and a swatch with its margins takes 45.
        let longest = self.legend.iter().map(|entry| entry.label.chars().count()).max().unwrap_or(0);
        let legend_columns =
            if is_full { (usize::from(self.panel.0) * self.columns / (9 * longest + 45)).max(1) } else { 1 };
        let legend_rows = self.legend.len().div_ceil(legend_columns);
        legend = legend.with_cols(legend_columns);
        let legend: Vec<Plot> = vec![legend.into()];
        layouts.push(layout(&legend, "", "", ""));
        plots.push(legend);
        let mut figure = Figure::new(rows, self.columns)
            .with_structure(structure)
            .with_cell_size(f64::from(self.panel.0), f64::from(self.panel.1))
            .with_title(self.title)
            .with_title_size(18)
            .with_plots(plots)
            .with_layouts(layouts);
        if is_full {
            figure = figure.with_row_height(rows - 1, 60.0 + 22.0 * legend_rows as f64);
        }
        let scene = figure.render();
        let svg = folder.join(format!("{name}.svg"));
        let text = SvgBackend::new().render_scene(&scene);
        fs::write(&svg, text).map_err(|source| OutputError::File { path: svg, source })?;
        let png = folder.join(format!("{name}.png"));
        let bytes = RasterBackend::new()
            .with_scale(PIXELS)
            .render_scene(&scene)
            .map_err(|reason| OutputError::Figure { path: png.clone(), reason })?;
        fs::write(&png, bytes).map_err(|source| OutputError::File { path: png, source })
    }
}

pub fn marker_entry(label: &str, color: &str, shape: MarkerShape) -> LegendEntry {
    LegendEntry { label: label.to_owned(), color: color.to_owned(), shape: LegendShape::Marker(shape), dasharray: None }
}

pub fn line_entry(label: &str, color: &str, style: &LineStyle) -> LegendEntry {
    LegendEntry {
        label: label.to_owned(),
        color: color.to_owned(),
        shape: LegendShape::Line,
        dasharray: style.dasharray(),
    }
}

pub fn layout(plots: &[Plot], title: &str, x: &str, y: &str) -> Layout {
    Layout::auto_from_plots(plots)
        .with_title(title)
        .with_x_label(x)
        .with_y_label(y)
        .with_title_size(15)
        .with_label_size(14)
        .with_tick_size(12)
        .with_body_size(13)
}

/// A line with a marker on each point.
pub fn marked_line(points: &[(f64, f64)], color: &str, style: LineStyle, shape: MarkerShape) -> [Plot; 2] {
    let line = LinePlot::new().with_data(points.to_vec()).with_color(color).with_stroke_width(2.0);
    let marks = ScatterPlot::new().with_data(points.to_vec()).with_color(color).with_size(4.5).with_marker(shape);
    [line.with_line_style(style).into(), marks.into()]
}

/// Plain numbers, with suffixes for thousands and millions.
pub fn plain_numbers() -> TickFormat {
    TickFormat::Custom(Arc::new(|value| {
        let (scaled, unit) = match value {
            1.0e6.. => (value / 1.0e6, " M"),
            1.0e4.. => (value / 1.0e3, " k"),
            _ => (value, ""),
        };
        let rounded = format!("{scaled:.3}");
        rounded.trim_end_matches('0').trim_end_matches('.').to_owned() + unit
    }))
}
