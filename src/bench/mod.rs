//! Benchmarks: `candela bench ...`. Each prints a table and compares side by side, interleaved, within one run: on a
//! shared machine only ratios of the same run mean anything.

pub mod adaptive;
pub mod agreement;
mod cases;
pub mod clock;
pub mod coverage;
pub mod denoise;
pub mod detail;
pub mod error;
mod flip;
pub mod http;
pub mod many_lights;
pub mod memory;
mod pictures;
mod plot;
pub mod preview;
pub mod skip;
pub mod trace;
mod yardstick;

/// What every table is measured on, for the line above it.
pub fn machine(device: &crate::render::DeviceInfo) -> String {
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let checks = if cfg!(debug_assertions) { ", built with debug assertions" } else { "" };
    format!("{} ({}, {}), {cores} cores{checks}", device.name, device.backend, device.driver)
}
