//! Bind group layouts of a preview's passes, as `shaders/preview/bindings.wesl` and the passes declare them.

use super::layout::Projection;
use crate::render::gpu::Gpu;
use wgpu::{BindGroupLayout, BindingType, BufferBindingType, PipelineLayout, ShaderStages, TextureSampleType};

/// Distance of two projections in their buffer: that which every device allows.
pub const PROJECTION_STRIDE: u64 = 256;

/// Layouts by group, and of pipelines.
pub struct Layouts {
    /// Group 0: the scene, numbered as in `shaders/lib/bindings.wesl`.
    pub scene: BindGroupLayout,
    /// Group 1 of drawing passes: the projection.
    pub projection: BindGroupLayout,
    /// Group 2: light.
    pub light: BindGroupLayout,
    /// Group 3 of what is listed: blended triangles, spheres.
    pub listed: BindGroupLayout,
    /// Group 1 of culling.
    pub tiles: BindGroupLayout,
    /// Group 3 of passes over pixels.
    pub finish: BindGroupLayout,
    /// Of passes without light.
    pub depth_pipeline: PipelineLayout,
    /// Of drawing passes with light.
    pub light_pipeline: PipelineLayout,
    /// Of what is listed, without light.
    pub listed_depth_pipeline: PipelineLayout,
    /// The same with light.
    pub listed_light_pipeline: PipelineLayout,
    /// Of culling.
    pub tiles_pipeline: PipelineLayout,
    /// Of passes over pixels.
    pub finish_pipeline: PipelineLayout,
}

impl Layouts {
    /// All of them.
    pub fn new(gpu: &Gpu) -> Self {
        let everywhere = ShaderStages::VERTEX_FRAGMENT | ShaderStages::COMPUTE;
        let scene = group(
            gpu,
            "scene",
            &[
                (0, everywhere, uniform(false)),
                (2, ShaderStages::FRAGMENT | ShaderStages::COMPUTE, records()),
                (3, everywhere, records()),
                (4, everywhere, records()),
                (10, everywhere, pages(float())),
                (11, everywhere, pages(float())),
                (12, everywhere, texture(float())),
                (14, everywhere, texture(float())),
                (17, everywhere, texture(TextureSampleType::Uint)),
            ],
        );
        let projection = group(gpu, "projection", &[(0, ShaderStages::VERTEX_FRAGMENT, uniform(true))]);
        let light = group(
            gpu,
            "light",
            &[
                (0, everywhere, uniform(false)),
                (1, everywhere, storage(true)),
                (2, ShaderStages::FRAGMENT | ShaderStages::COMPUTE, storage(true)),
                (3, ShaderStages::FRAGMENT | ShaderStages::COMPUTE, uniform(false)),
                (4, ShaderStages::FRAGMENT | ShaderStages::COMPUTE, pages(TextureSampleType::Depth)),
                (5, ShaderStages::FRAGMENT | ShaderStages::COMPUTE, texture(float())),
            ],
        );
        let listed = group(gpu, "listed", &[(0, ShaderStages::VERTEX, storage(true))]);
        let compute = ShaderStages::COMPUTE;
        let tiles = group(
            gpu,
            "tiles",
            &[
                (0, compute, uniform(false)),
                (1, compute, storage(true)),
                (2, compute, storage(false)),
                (3, compute, storage(false)),
                (4, compute, texture(TextureSampleType::Depth)),
            ],
        );
        let finish = group(
            gpu,
            "finish",
            &[
                (0, compute, texture(TextureSampleType::Uint)),
                (1, compute, texture(float())),
                (2, compute, texture(TextureSampleType::Depth)),
                (3, compute, texture(float())),
                (4, compute, storage(false)),
            ],
        );
        let pipeline = |groups: &[Option<&BindGroupLayout>]| {
            gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some("preview"),
                bind_group_layouts: groups,
                immediate_size: 0,
            })
        };
        Self {
            depth_pipeline: pipeline(&[Some(&scene), Some(&projection)]),
            light_pipeline: pipeline(&[Some(&scene), Some(&projection), Some(&light)]),
            listed_depth_pipeline: pipeline(&[Some(&scene), Some(&projection), None, Some(&listed)]),
            listed_light_pipeline: pipeline(&[Some(&scene), Some(&projection), Some(&light), Some(&listed)]),
            tiles_pipeline: pipeline(&[Some(&scene), Some(&tiles)]),
            finish_pipeline: pipeline(&[Some(&scene), None, Some(&light), Some(&finish)]),
            scene,
            projection,
            light,
            listed,
            tiles,
            finish,
        }
    }
}

fn group(gpu: &Gpu, label: &str, bindings: &[(u32, ShaderStages, BindingType)]) -> BindGroupLayout {
    let entry = |&(binding, visibility, ty)| wgpu::BindGroupLayoutEntry { binding, visibility, ty, count: None };
    let entries: Vec<_> = bindings.iter().map(entry).collect();
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: Some(label), entries: &entries })
}

fn buffer(ty: BufferBindingType, has_dynamic_offset: bool, size: Option<u64>) -> BindingType {
    BindingType::Buffer { ty, has_dynamic_offset, min_binding_size: size.and_then(wgpu::BufferSize::new) }
}

/// One of many projections, if there is an offset.
fn uniform(has_dynamic_offset: bool) -> BindingType {
    buffer(BufferBindingType::Uniform, has_dynamic_offset, has_dynamic_offset.then_some(size_of::<Projection>() as u64))
}

fn records() -> BindingType {
    BindingType::StorageTexture {
        access: wgpu::StorageTextureAccess::ReadOnly,
        format: wgpu::TextureFormat::Rgba32Uint,
        view_dimension: wgpu::TextureViewDimension::D2,
    }
}

fn storage(read_only: bool) -> BindingType {
    buffer(BufferBindingType::Storage { read_only }, false, None)
}

fn float() -> TextureSampleType {
    TextureSampleType::Float { filterable: false }
}

fn texture(sample_type: TextureSampleType) -> BindingType {
    BindingType::Texture { sample_type, view_dimension: wgpu::TextureViewDimension::D2, multisampled: false }
}

fn pages(sample_type: TextureSampleType) -> BindingType {
    BindingType::Texture { sample_type, view_dimension: wgpu::TextureViewDimension::D2Array, multisampled: false }
}
