//! Textures of the shadow maps.

use super::targets::DEPTH;
use crate::params::{PreviewParams, ShadowAlgorithm};
use crate::render::RenderError;
use crate::render::gpu::Gpu;

/// Shadow maps: all for the shaders, each to draw to.
pub struct ShadowMaps {
    /// All of them.
    pub array: wgpu::TextureView,
    /// One by one; none: shadows are traced.
    pub layers: Vec<wgpu::TextureView>,
}

impl ShadowMaps {
    /// Empty ones.
    ///
    /// # Errors
    /// [`RenderError::TooLarge`] if the device has no textures so large.
    pub fn new(gpu: &Gpu, params: &PreviewParams, faces: u32) -> Result<Self, RenderError> {
        let drawn = if params.shadows.algorithm == ShadowAlgorithm::Ray { 0 } else { faces };
        let limits = gpu.device.limits();
        let side = if drawn > 0 { params.shadows.map_size } else { 1 };
        if side > limits.max_texture_dimension_2d || drawn > limits.max_texture_array_layers {
            return Err(RenderError::TooLarge(format!(
                "{drawn} shadow maps of {side} texels a side; {} takes {} of {}: ask for smaller maps or fewer lights with shadows",
                gpu.info.name, limits.max_texture_array_layers, limits.max_texture_dimension_2d
            )));
        }
        let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: Some("shadow maps"),
            size: wgpu::Extent3d { width: side, height: side, depth_or_array_layers: drawn.max(1) },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: DEPTH,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        });
        let layer = |base_array_layer| {
            texture.create_view(&wgpu::TextureViewDescriptor {
                dimension: Some(wgpu::TextureViewDimension::D2),
                base_array_layer,
                array_layer_count: Some(1),
                ..Default::default()
            })
        };
        let dimension = Some(wgpu::TextureViewDimension::D2Array);
        Ok(Self {
            array: texture.create_view(&wgpu::TextureViewDescriptor { dimension, ..Default::default() }),
            layers: (0..drawn).map(layer).collect(),
        })
    }
}
