//! The one bind group of all kernels, in the order of `shaders/lib/bindings.wesl`.

use super::device::Gpu;
use super::resources::{GpuEnvironment, GpuScene};

/// What a kernel reads and writes.
#[allow(missing_docs, reason = "named as in the shader")]
pub struct Bindings<'a> {
    pub frame: &'a wgpu::Buffer,
    pub slice: &'a wgpu::Buffer,
    pub scene: &'a GpuScene,
    pub lights: &'a wgpu::Buffer,
    pub picks: &'a wgpu::Buffer,
    pub counters: &'a wgpu::Buffer,
    pub environment: &'a GpuEnvironment,
    pub albedo: &'a wgpu::TextureView,
    pub work: &'a wgpu::TextureView,
    pub film: &'a wgpu::TextureView,
    pub profiles: &'a wgpu::TextureView,
}

impl Bindings<'_> {
    /// The bind group of the layout of [`layout_entries`].
    pub fn group(&self, gpu: &Gpu, layout: &wgpu::BindGroupLayout) -> wgpu::BindGroup {
        let resources = [
            self.frame.as_entire_binding(),
            self.slice.as_entire_binding(),
            wgpu::BindingResource::TextureView(&self.scene.nodes),
            wgpu::BindingResource::TextureView(&self.scene.triangles),
            wgpu::BindingResource::TextureView(&self.scene.records),
            wgpu::BindingResource::TextureView(&self.scene.light_nodes),
            wgpu::BindingResource::TextureView(&self.environment.tiles),
            self.lights.as_entire_binding(),
            self.picks.as_entire_binding(),
            self.counters.as_entire_binding(),
            wgpu::BindingResource::TextureView(&self.scene.color_pages),
            wgpu::BindingResource::TextureView(&self.scene.data_pages),
            wgpu::BindingResource::TextureView(&self.environment.texels),
            wgpu::BindingResource::TextureView(&self.environment.cells),
            wgpu::BindingResource::TextureView(self.albedo),
            wgpu::BindingResource::TextureView(self.work),
            wgpu::BindingResource::TextureView(self.film),
            wgpu::BindingResource::TextureView(self.profiles),
        ];
        let mut binding = 0;
        let entries = resources.map(|resource| {
            let entry = wgpu::BindGroupEntry { binding, resource };
            binding += 1;
            entry
        });
        gpu.device.create_bind_group(&wgpu::BindGroupDescriptor { label: Some("kernel"), layout, entries: &entries })
    }
}

/// Types of what a kernel reads and writes.
pub fn layout_entries() -> [wgpu::BindGroupLayoutEntry; 18] {
    let buffer = |ty| wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None };
    let uniform = buffer(wgpu::BufferBindingType::Uniform);
    let read = buffer(wgpu::BufferBindingType::Storage { read_only: true });
    let write = buffer(wgpu::BufferBindingType::Storage { read_only: false });
    let texture =
        |sample_type, view_dimension| wgpu::BindingType::Texture { sample_type, view_dimension, multisampled: false };
    let float = wgpu::TextureSampleType::Float { filterable: false };
    let pages = texture(float, wgpu::TextureViewDimension::D2Array);
    let table = texture(float, wgpu::TextureViewDimension::D2);
    let list = texture(wgpu::TextureSampleType::Uint, wgpu::TextureViewDimension::D2);
    let stored = |access, format| wgpu::BindingType::StorageTexture {
        access,
        format,
        view_dimension: wgpu::TextureViewDimension::D2,
    };
    let records = stored(wgpu::StorageTextureAccess::ReadOnly, wgpu::TextureFormat::Rgba32Uint);
    let film = stored(wgpu::StorageTextureAccess::WriteOnly, wgpu::TextureFormat::Rgba32Float);
    let types = [
        uniform, uniform, records, records, records, list, table, read, read, write, pages, pages, table, table, table,
        list, film, list,
    ];
    let mut binding = 0;
    types.map(|ty| {
        let entry = wgpu::BindGroupLayoutEntry { binding, visibility: wgpu::ShaderStages::COMPUTE, ty, count: None };
        binding += 1;
        entry
    })
}
