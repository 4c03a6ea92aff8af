//! Candela, a render server. The map: one line per room; dependencies run downwards only.
//!
//! `http -> jobs -> render -> compile -> scene`, `film` below `render`, `params` a leaf.

pub mod bench;
pub mod cli;
pub mod compile;
pub mod config;
pub mod demo;
pub mod denoise;
pub mod film;
pub mod http;
pub mod jobs;
pub mod params;
mod pod;
mod process;
pub mod render;
pub mod scene;
