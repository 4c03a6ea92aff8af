//! The engines of this machine, each opened when first wanted.

use super::cpu::CpuEngine;
use super::gpu::{GpuEngine, has_hardware_adapter};
use super::guided::Guided;
use super::reach::without_unseen_environment;
use super::{Engine, Render, RenderError, Work};
use crate::film::Film;
use crate::params::{EngineChoice, Mode};

/// Hands each render to the engine that its settings ask for.
pub struct Engines {
    gpu: Option<GpuEngine>,
    cpu: CpuEngine,
    /// What [`EngineChoice::Auto`] is here.
    automatic: EngineChoice,
}

impl Engines {
    /// Looks for a graphics card, and opens it if there is one. A software adapter is about as fast as
    /// the cores by themselves (docs/accuracy.md), but compiles for seconds for each kind of scene: the choice falls on the cores.
    pub fn new() -> Self {
        let mut engines = Self { gpu: None, cpu: CpuEngine::new(), automatic: EngineChoice::Cpu };
        if has_hardware_adapter() {
            match engines.gpu() {
                Ok(_) => engines.automatic = EngineChoice::Gpu,
                Err(error) => tracing::warn!(%error, "the graphics card cannot be used; rendering on the processor"),
            }
        }
        engines
    }

    fn gpu(&mut self) -> Result<&mut GpuEngine, RenderError> {
        match &mut self.gpu {
            Some(engine) => Ok(engine),
            missing => Ok(missing.insert(GpuEngine::new()?)),
        }
    }
}

impl Default for Engines {
    fn default() -> Self {
        Self::new()
    }
}

impl Engine for Engines {
    fn begin(&mut self, work: Work, film: Option<Film>) -> Result<Box<dyn Render>, RenderError> {
        let choice = match work.settings.engine {
            // Rasterised by the driver, also where it has no hardware.
            _ if work.settings.mode == Mode::Preview => EngineChoice::Gpu,
            // It alone carries more than one sum.
            _ if !work.lighting.groups.is_empty() => EngineChoice::Cpu,
            EngineChoice::Auto => self.automatic,
            given => given,
        };
        let work = without_unseen_environment(&mut self.cpu, work)?;
        let guides = work.settings.denoise.then(|| self.cpu.guides(&work));
        let render = match choice {
            EngineChoice::Gpu => self.gpu()?.begin(work, film),
            EngineChoice::Cpu | EngineChoice::Auto => self.cpu.begin(work, film),
        }?;
        Ok(match guides {
            Some(guides) => Box::new(Guided::new(guides, render)),
            None => render,
        })
    }
}
