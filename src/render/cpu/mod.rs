//! A second path tracer, in f64, on all cores: the oracle of the tests, and the engine where there is no graphics card.
//!
//! It reads the same [`CompiledScene`], lighting and view as `render::gpu`, and shares no transport code with it: another
//! tree, another triangle test, other random numbers, other sampling of facets and triangles. Where the two agree, neither is
//! wrong by itself.

mod bend;
pub mod bvh;
pub mod camera;
pub mod environment;
pub mod extended_light;
mod guides;
pub mod integrator;
pub mod layers;
pub mod light;
mod light_choice;
pub mod light_tree;
pub mod material;
pub mod motion;
mod phong;
pub mod place;
mod relief;
mod render;
pub mod sampler;
pub mod sampling;
mod sphere;
pub mod surface;
mod texture;

pub use guides::GuideTracer;
pub use render::CpuRender;

use super::{DeviceInfo, Engine, Render, RenderError, Work};
use crate::compile::CompiledScene;
use crate::film::Film;
use bvh::Bvh;
use std::sync::{Arc, Weak};

/// Trees of the scenes in use.
pub struct CpuEngine {
    info: DeviceInfo,
    /// A scene that nobody else holds any more is dropped at the next render.
    trees: Vec<(Weak<CompiledScene>, Arc<Bvh>)>,
}

impl CpuEngine {
    /// On all cores.
    pub fn new() -> Self {
        let info = DeviceInfo {
            engine: "cpu",
            name: format!("{} threads", rayon::current_num_threads()),
            backend: "cpu".to_owned(),
            driver: bvh::Unit::detect().name().to_owned(),
            hardware: false,
        };
        Self { info, trees: Vec::new() }
    }

    /// What traces.
    pub fn device(&self) -> &DeviceInfo {
        &self.info
    }

    /// The tree of a scene, built if need be.
    pub fn tree(&mut self, scene: &Arc<CompiledScene>) -> Arc<Bvh> {
        self.trees.retain(|(source, _)| source.strong_count() > 0);
        let known = self.trees.iter().find(|(source, _)| source.as_ptr() == Arc::as_ptr(scene));
        if let Some((_, tree)) = known {
            return Arc::clone(tree);
        }
        let tree = Arc::new(Bvh::new(scene));
        self.trees.push((Arc::downgrade(scene), Arc::clone(&tree)));
        tree
    }
}

impl CpuEngine {
    /// What will find the guides of a picture, whichever engine traces its light.
    pub fn guides(&mut self, work: &Work) -> GuideTracer {
        GuideTracer::new(work.clone(), self.tree(&work.scene))
    }
}

impl Default for CpuEngine {
    fn default() -> Self {
        Self::new()
    }
}

impl Engine for CpuEngine {
    fn begin(&mut self, work: Work, film: Option<Film>) -> Result<Box<dyn Render>, RenderError> {
        let tree = self.tree(&work.scene);
        Ok(Box::new(CpuRender::new(self.info.clone(), work, tree, film)))
    }
}
