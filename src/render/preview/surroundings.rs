//! What previews read of an environment: harmonics for diffuse lobes, prefiltered radiance for the others.

use super::ambient::{self, Harmonics};
use super::prefilter::Prefiltered;
use crate::compile::{Environment, EnvironmentKind, Hdri};
use crate::render::gpu::Gpu;
use crate::render::gpu::resources::texture;
use glam::Vec3;
use std::sync::{Arc, Weak};

/// Of one environment, in its own frame at intensity 1.
pub struct Surroundings {
    /// Irradiance.
    pub harmonics: Harmonics,
    /// [`Prefiltered`]; of one texel that is not read where radiance is the same from everywhere.
    pub reflected: wgpu::TextureView,
}

/// Those of pictures, kept as long as these live.
#[derive(Default)]
pub struct SurroundingsCache(Vec<(Weak<Hdri>, Arc<Surroundings>)>);

impl SurroundingsCache {
    /// Of an environment.
    pub fn get(&mut self, gpu: &Gpu, environment: &Environment) -> Arc<Surroundings> {
        let even = |radiance: Vec3| {
            let mut harmonics = [[0.0; 4]; 9];
            harmonics[0] = radiance.extend(0.0).to_array();
            Surroundings::new(gpu, harmonics, &Prefiltered { width: 1, height: 1, texels: vec![[0.0; 4]] })
        };
        match &environment.kind {
            EnvironmentKind::None => Arc::new(even(Vec3::ZERO)),
            EnvironmentKind::Constant(radiance) => Arc::new(even(*radiance)),
            EnvironmentKind::Gradient { top, horizon, bottom } => {
                let at = |y: f32| horizon.lerp(if y > 0.0 { *top } else { *bottom }, y.abs());
                Arc::new(Surroundings::new(gpu, ambient::of_heights(at), &Prefiltered::of_heights(at)))
            }
            EnvironmentKind::Hdri(hdri) => self.of_picture(gpu, hdri),
        }
    }

    fn of_picture(&mut self, gpu: &Gpu, hdri: &Arc<Hdri>) -> Arc<Surroundings> {
        self.0.retain(|(weak, _)| weak.strong_count() > 0);
        if let Some((_, known)) = self.0.iter().find(|(weak, _)| std::ptr::eq(weak.as_ptr(), Arc::as_ptr(hdri))) {
            return Arc::clone(known);
        }
        let (width, height) = (hdri.width, hdri.height);
        let texel = |x: u32, y: u32| Vec3::from_array(hdri.texels[y as usize * width as usize + x as usize]);
        let prefiltered = Prefiltered::of_picture(width, height, texel);
        let found = Arc::new(Surroundings::new(gpu, ambient::of_picture(width, height, texel), &prefiltered));
        self.0.push((Arc::downgrade(hdri), Arc::clone(&found)));
        found
    }
}

impl Surroundings {
    fn new(gpu: &Gpu, harmonics: Harmonics, prefiltered: &Prefiltered) -> Self {
        let size = (prefiltered.width, prefiltered.height, 1);
        let format = wgpu::TextureFormat::Rgba32Float;
        let texels = bytemuck::cast_slice(&prefiltered.texels);
        Self { harmonics, reflected: texture(gpu, "reflected environment", size, format, texels) }
    }
}
