//! The wgpu compute tracer.
//!
//! [`GpuEngine`] owns a device, the pipelines made on it (one per set of features) and what has been uploaded;
//! [`GpuRender`] is one picture under way, cut into dispatches of about 40 ms.

mod bindings;
mod device;
pub mod layout;
pub(in crate::render) mod pipeline;
mod probe;
mod profiles;
mod records;
pub(in crate::render) mod render;
pub(in crate::render) mod resources;

pub use device::{Gpu, has_hardware_adapter};
pub use pipeline::PATHTRACE_WGSL;
pub use probe::Probe;
pub use render::GpuRender;

use super::preview::{PreviewRender, Previews};
use super::{DeviceInfo, Engine, Render, RenderError, Work};
use crate::film::Film;
use crate::params::Mode;
use pipeline::Pipelines;
use resources::Resources;
use std::sync::Arc;

/// A device with its pipelines and uploads.
pub struct GpuEngine {
    gpu: Arc<Gpu>,
    pipelines: Pipelines,
    resources: Resources,
    previews: Previews,
}

impl GpuEngine {
    /// Opens the adapter that promises most: hardware before software.
    ///
    /// # Errors
    /// [`RenderError::NoAdapter`] if there is none that runs compute shaders.
    pub fn new() -> Result<Self, RenderError> {
        let gpu = Arc::new(Gpu::new()?);
        let pipelines = Pipelines::new(&gpu);
        let resources = Resources::new(&gpu);
        let previews = Previews::new(&gpu);
        Ok(Self { gpu, pipelines, resources, previews })
    }

    /// What traces.
    pub fn device(&self) -> &DeviceInfo {
        &self.gpu.info
    }

    /// The device, for benchmarks and tests.
    pub fn gpu(&self) -> &Arc<Gpu> {
        &self.gpu
    }
}

impl Engine for GpuEngine {
    fn begin(&mut self, work: Work, film: Option<Film>) -> Result<Box<dyn Render>, RenderError> {
        if work.settings.mode == Mode::Preview {
            let render = PreviewRender::new(&self.gpu, &mut self.previews, &mut self.resources, &work)?;
            self.gpu.fault()?;
            return Ok(Box::new(render));
        }
        let kernel = self.pipelines.get(&self.gpu, &work);
        let scene = self.resources.scene(&self.gpu, &work.scene)?;
        let environment = self.resources.environment(&self.gpu, &work.lighting.environment)?;
        let render = GpuRender::new(
            &self.gpu,
            kernel,
            &self.pipelines.layout,
            &mut self.resources,
            &scene,
            &environment,
            &work,
            film,
        )?;
        self.gpu.fault()?;
        Ok(Box::new(render))
    }
}
