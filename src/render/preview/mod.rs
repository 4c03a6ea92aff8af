//! `mode: preview`: the scene rasterised, lit by punctual lights and the environment, with shadow maps or shadow rays.
//!
//! Two ways to the same picture: *deferred* draws surfaces to a G-buffer and lights each pixel once, *forward* lights surfaces as they
//! are drawn. Both list the lights that reach each tile of the picture. It shares the scene's uploads and the shaders' library
//! with the tracer: surfaces, materials, lights and shadow rays are the same functions.

mod ambient;
mod bands;
mod camera;
mod draws;
mod faces;
mod frame;
mod groups;
mod layout;
mod layouts;
mod lights;
mod pipelines;
mod prefilter;
mod render;
mod shadow_maps;
mod surroundings;
mod targets;

pub use render::PreviewRender;

use crate::render::gpu::Gpu;
use layouts::Layouts;
use pipelines::Pipelines;
use surroundings::SurroundingsCache;
use targets::TargetCache;

/// What previews leave behind for the next ones.
pub struct Previews {
    layouts: Layouts,
    pipelines: Pipelines,
    targets: TargetCache,
    surroundings: SurroundingsCache,
}

impl Previews {
    /// Nothing yet.
    pub fn new(gpu: &Gpu) -> Self {
        Self {
            layouts: Layouts::new(gpu),
            pipelines: Pipelines::new(),
            targets: TargetCache::default(),
            surroundings: SurroundingsCache::default(),
        }
    }
}
