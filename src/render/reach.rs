//! Whether any path from the camera finds its way to the environment.

use super::cpu::CpuEngine;
use super::prepare::render_to_end;
use super::{RenderError, Work};
use crate::compile::{EnvironmentKind, Lighting};
use glam::Vec3;
use std::sync::Arc;

/// Pixels a side of the trial picture.
const SIDE: u32 = 32;
/// Its samples per pixel.
const SAMPLES: u32 = 4;

/// Work that spends no light samples on an environment that nothing sees, as in a closed room. Unbiased whatever the trial
/// finds: a scattered ray that meets the environment after all counts in full where light samples cannot.
///
/// # Errors
/// As of [`render_to_end`].
pub fn without_unseen_environment(cpu: &mut CpuEngine, work: Work) -> Result<Work, RenderError> {
    let share = work.lighting.environment_probability;
    if share <= 0.0 || share >= 1.0 || environment_is_seen(cpu, &work)? {
        return Ok(work);
    }
    let lighting = Lighting { environment_probability: 0.0, ..Lighting::clone(&work.lighting) };
    Ok(Work { lighting: Arc::new(lighting), ..work })
}

/// Draws the same paths under a white and under a black environment: no pixel differs if none gets there.
fn environment_is_seen(cpu: &mut CpuEngine, work: &Work) -> Result<bool, RenderError> {
    let mut pixels = |radiance: Vec3| {
        let mut work = work.clone();
        let mut lighting = Lighting { environment_probability: 0.0, ..Lighting::clone(&work.lighting) };
        lighting.environment.kind = EnvironmentKind::Constant(radiance);
        work.lighting = Arc::new(lighting);
        (work.view.width, work.view.height) = (SIDE, SIDE * work.view.height / work.view.width.max(1));
        work.view.height = work.view.height.clamp(1, SIDE);
        work.settings.max_samples = SAMPLES;
        work.settings.deadline = None;
        Ok(render_to_end(cpu, work, &mut |_| {})?.film.picture().pixels)
    };
    Ok(pixels(Vec3::ONE)? != pixels(Vec3::ZERO)?)
}
