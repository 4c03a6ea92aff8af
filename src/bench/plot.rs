//! Plots of benchmarks.

use super::error::{Curve, Point};
use anyhow::{Result, anyhow};
use plotters::prelude::*;
use std::path::Path;

/// Panels across.
const COLUMNS: usize = 2;
/// Pixels of a panel.
const PANEL: (u32, u32) = (480, 320);

/// Relative mean square error over seconds, both logarithmic, a panel per scene.
///
/// # Errors
/// The file cannot be written.
pub fn error_over_time(path: &Path, panels: &[(String, Vec<Curve>)]) -> Result<()> {
    let rows = panels.len().div_ceil(COLUMNS);
    let root = SVGBackend::new(path, (PANEL.0 * COLUMNS as u32, PANEL.1 * rows as u32)).into_drawing_area();
    root.fill(&WHITE).map_err(|error| anyhow!("{}: {error}", path.display()))?;
    for (area, (scene, curves)) in root.split_evenly((rows, COLUMNS)).iter().zip(panels) {
        panel(area, scene, curves).map_err(|error| anyhow!("{}: {error}", path.display()))?;
    }
    root.present().map_err(|error| anyhow!("{}: {error}", path.display()))
}

type Fault = DrawingAreaErrorKind<<SVGBackend<'static> as DrawingBackend>::ErrorType>;

fn panel(
    area: &DrawingArea<SVGBackend<'_>, plotters::coord::Shift>,
    scene: &str,
    curves: &[Curve],
) -> Result<(), Fault> {
    let points: Vec<&Point> = curves.iter().flat_map(|curve| &curve.points).filter(|p| p.rel_mse > 0.0).collect();
    let range = |value: fn(&Point) -> f64| {
        let values = || points.iter().map(|point| value(point));
        values().fold(f64::INFINITY, f64::min)..1.01 * values().fold(f64::MIN_POSITIVE, f64::max)
    };
    let mut chart = ChartBuilder::on(area)
        .caption(scene, ("sans-serif", 16))
        .margin(8)
        .x_label_area_size(32)
        .y_label_area_size(56)
        .build_cartesian_2d(range(|point| point.seconds).log_scale(), range(|point| point.rel_mse).log_scale())?;
    chart
        .configure_mesh()
        .x_desc("seconds")
        .y_desc("relMSE")
        .y_label_formatter(&|value| format!("{value:.0e}"))
        .draw()?;
    for (index, curve) in curves.iter().enumerate() {
        let color = Palette99::pick(index).to_rgba();
        let line = curve.points.iter().filter(|p| p.rel_mse > 0.0).map(|p| (p.seconds, p.rel_mse));
        chart
            .draw_series(LineSeries::new(line, color.stroke_width(2)))?
            .label(curve.name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 16, y)], color.stroke_width(2)));
    }
    chart.configure_series_labels().background_style(WHITE.mix(0.8)).label_font(("sans-serif", 11)).draw()
}

/// Points joined by a line.
pub struct Line {
    /// What it is of.
    pub name: String,
    /// Both positive.
    pub points: Vec<(f64, f64)>,
}

/// Seconds over how many there are of something, both logarithmic, a panel per scene.
///
/// # Errors
/// The file cannot be written.
pub fn time_over(path: &Path, what: &str, panels: &[(String, Vec<Line>)]) -> Result<()> {
    lines(path, panels, [what, "seconds"], true)
}

/// Relative mean square error over seconds, both logarithmic: a mark for each of a way's settings.
///
/// # Errors
/// The file cannot be written.
pub fn error_of_settings(path: &Path, panels: &[(String, Vec<Line>)]) -> Result<()> {
    lines(path, panels, ["seconds a frame", "relMSE"], false)
}

fn lines(path: &Path, panels: &[(String, Vec<Line>)], axes: [&str; 2], joined: bool) -> Result<()> {
    let rows = panels.len().div_ceil(COLUMNS);
    let root = SVGBackend::new(path, (PANEL.0 * COLUMNS as u32, PANEL.1 * rows as u32)).into_drawing_area();
    let failed = |error: Fault| anyhow!("{}: {error}", path.display());
    root.fill(&WHITE).map_err(failed)?;
    for (area, (title, lines)) in root.split_evenly((rows, COLUMNS)).iter().zip(panels) {
        line_panel(area, title, lines, axes, joined).map_err(failed)?;
    }
    root.present().map_err(failed)
}

fn line_panel(
    area: &DrawingArea<SVGBackend<'_>, plotters::coord::Shift>,
    title: &str,
    lines: &[Line],
    axes: [&str; 2],
    joined: bool,
) -> Result<(), Fault> {
    let range = |value: fn(&(f64, f64)) -> f64| {
        let values = || lines.iter().flat_map(|line| &line.points).map(value);
        values().fold(f64::INFINITY, f64::min)..1.01 * values().fold(f64::MIN_POSITIVE, f64::max)
    };
    let mut chart = ChartBuilder::on(area)
        .caption(title, ("sans-serif", 16))
        .margin(8)
        .x_label_area_size(32)
        .y_label_area_size(56)
        .build_cartesian_2d(range(|point| point.0).log_scale(), range(|point| point.1).log_scale())?;
    chart.configure_mesh().x_desc(axes[0]).y_desc(axes[1]).y_label_formatter(&|value| format!("{value:.0e}")).draw()?;
    for (index, line) in lines.iter().enumerate() {
        let color = Palette99::pick(index).to_rgba();
        let points = || line.points.iter().copied();
        let series = if joined {
            chart.draw_series(LineSeries::new(points(), color.stroke_width(2)))?
        } else {
            chart.draw_series(points().map(|point| Circle::new(point, 3, color.filled())))?
        };
        series.label(&line.name).legend(move |(x, y)| PathElement::new([(x, y), (x + 16, y)], color.stroke_width(2)));
    }
    chart.configure_series_labels().background_style(WHITE.mix(0.8)).label_font(("sans-serif", 11)).draw()
}
