//! What `candela render` says at the end.

use crate::params::{Mode, RenderParams};
use crate::render::report::Report;
use std::fmt::{self, Display, Formatter};

/// A report in lines for people.
pub struct Summary<'a> {
    /// Where the picture is.
    pub place: &'a str,
    /// What it was made from.
    pub params: &'a RenderParams,
    /// What was found.
    pub report: &'a Report,
}

impl Display for Summary<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Self { place, params, report } = self;
        let mut line = |label: &str, text: String| writeln!(f, "{label:<9} {text}");
        let (width, height, samples) = (params.width, params.height, report.samples);
        let reason = report.stop_reason.name();
        let (least, most) = (report.samples_min, report.samples_max);
        let spread = if least < most { format!(" ({least} to {most})") } else { String::new() };
        line(
            "picture",
            format!("{place}: {width} x {height}, {samples} samples per pixel{spread}, ended by {reason}"),
        )?;
        line("error", error(params, report))?;
        line("seconds", report.stage_line())?;
        let device = &report.device;
        line("device", format!("{} ({}, {})", device.name, device.backend, device.driver))?;
        for default in &report.defaults {
            line("default", format!("{} = {}", default.what, default.value))?;
        }
        for bias in &report.biases {
            line("bias", bias.clone())?;
        }
        for warning in &report.warnings {
            line("warning", format!("{} {}: {}", warning.code, warning.pointer, warning.detail))?;
        }
        let dropped = report.non_finite;
        if dropped.nan + dropped.infinite > 0 {
            line("fault", format!("{} NaN and {} infinite samples were dropped", dropped.nan, dropped.infinite))?;
        }
        Ok(())
    }
}

fn error(params: &RenderParams, report: &Report) -> String {
    match (report.error, report.error_bound_95) {
        _ if params.mode == Mode::Preview => "not measured: a preview states none, but what it leaves out".to_owned(),
        (Some(error), Some(bound)) => format!("{:.3} % (95 %: below {:.3} %)", 100.0 * error, 100.0 * bound),
        _ => "not measured: that takes at least 2 samples per pixel".to_owned(),
    }
}
