//! A picture that is to be denoised: what guides the denoiser is found first, so that however the render ends, it is there.

use super::cpu::GuideTracer;
use super::{DeviceInfo, NonFinite, Render, RenderError, StopReason};
use crate::film::{Film, Guides};

/// Two stages of one render.
pub struct Guided {
    tracer: Option<GuideTracer>,
    guides: Option<Guides>,
    light: Box<dyn Render>,
}

impl Guided {
    /// Nothing traced yet.
    pub fn new(tracer: GuideTracer, light: Box<dyn Render>) -> Self {
        Self { tracer: Some(tracer), guides: None, light }
    }
}

impl Render for Guided {
    fn device(&self) -> &DeviceInfo {
        self.light.device()
    }

    fn is_ready(&self) -> bool {
        self.light.is_ready()
    }

    fn step(&mut self) -> Result<Option<StopReason>, RenderError> {
        let Some(tracer) = &mut self.tracer else { return self.light.step() };
        if let Some(guides) = tracer.step() {
            (self.guides, self.tracer) = (Some(guides), None);
        }
        Ok(None)
    }

    fn film(&self) -> &Film {
        self.light.film()
    }

    fn into_film(self: Box<Self>) -> Film {
        self.light.into_film()
    }

    fn progress(&self) -> f64 {
        self.light.progress()
    }

    fn non_finite(&self) -> NonFinite {
        self.light.non_finite()
    }

    fn take_guides(&mut self) -> Option<Guides> {
        self.guides.take()
    }
}
