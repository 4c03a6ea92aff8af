//! Runs another kernel over the shaders' functions, for tests of their parts: one invocation per list of arguments.

use super::GpuEngine;
use super::bindings::Bindings;
use super::device::Gpu;
use super::layout::{Frame, Slice};
use super::pipeline;
use super::render::{buffer, create_texture, uniform};
use super::resources::{GpuEnvironment, GpuScene, upload_profiles};
use crate::render::{RenderError, Work};
use std::sync::Arc;
use wgpu::util::{DeviceExt, TextureDataOrder};

/// Invocations side by side: no wider than any adapter's textures may be, and rows aligned as copies ask for.
const WIDTH: usize = 1024;
/// Bytes of a row of results.
const ROW: u32 = 16 * WIDTH as u32;
/// Side of a workgroup.
const GROUP: u32 = 8;

/// A kernel with the uploads of some [`Work`] bound, as a picture's kernel has them.
///
/// Beside those bindings the kernel has `@group(1) @binding(0) var arguments: texture_2d_array<u32>`: texel (x, y) of
/// layer k is the k-th argument of invocation (x, y), of which workgroups take 8 x 8. Its result goes to texel (x, y) of
/// `film`.
pub struct Probe {
    gpu: Arc<Gpu>,
    pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
    arguments: wgpu::BindGroupLayout,
    frame: wgpu::Buffer,
    slice: wgpu::Buffer,
    counters: wgpu::Buffer,
    /// Without entries: no pass is under way.
    work: wgpu::Texture,
    lights: wgpu::Buffer,
    picks: wgpu::Buffer,
    scene: Arc<GpuScene>,
    environment: Arc<GpuEnvironment>,
    albedo: wgpu::TextureView,
    profiles: wgpu::TextureView,
}

impl GpuEngine {
    /// Makes a kernel of WGSL source and uploads what it reads. Pipeline constants are set as for the work's picture.
    ///
    /// # Errors
    /// [`RenderError`] if the device cannot hold the work, or the driver refuses the kernel.
    pub fn probe(&mut self, work: &Work, wgsl: &str, entry: &str) -> Result<Probe, RenderError> {
        let gpu = Arc::clone(&self.gpu);
        let arguments = arguments_layout(&gpu);
        let pipeline = pipeline::probe(&gpu, work, wgsl, entry, [&self.pipelines.layout, &arguments]);
        let (format, usage) = (wgpu::TextureFormat::Rgba32Uint, wgpu::TextureUsages::TEXTURE_BINDING);
        let probe = Probe {
            pipeline,
            layout: self.pipelines.layout.clone(),
            arguments,
            frame: uniform(&gpu, "frame", bytemuck::bytes_of(&Frame::new(work))),
            slice: uniform(&gpu, "slice", &[0; size_of::<Slice>()]),
            counters: buffer(&gpu, "counters", 8, wgpu::BufferUsages::STORAGE),
            work: create_texture(&gpu, "work", (1, 1), format, usage),
            lights: gpu.storage("lights", bytemuck::cast_slice(work.lighting.over_time()), 64)?,
            picks: gpu.storage("light table", bytemuck::cast_slice(&work.lighting.picks), 32)?,
            scene: self.resources.scene(&gpu, &work.scene)?,
            environment: self.resources.environment(&gpu, &work.lighting.environment)?,
            albedo: self.resources.albedo(&gpu, &work.scene),
            profiles: upload_profiles(&gpu, &work.lighting.profiles)?,
            gpu,
        };
        probe.gpu.fault()?;
        Ok(probe)
    }
}

impl Probe {
    /// The kernel's result for each list of arguments. All layers have the same length.
    ///
    /// # Errors
    /// [`RenderError`] if there are more invocations than the device's textures hold, or the device is lost.
    ///
    /// # Panics
    /// If the layers differ in length.
    pub fn run(&self, layers: &[&[[u32; 4]]]) -> Result<Vec<[f32; 4]>, RenderError> {
        let count = layers.first().map_or(0, |layer| layer.len());
        assert!(layers.iter().all(|layer| layer.len() == count), "one argument of each kind per invocation");
        let height = count.div_ceil(WIDTH).max(1) as u32;
        let limit = self.gpu.device.limits().max_texture_dimension_2d;
        if height > limit {
            return Err(RenderError::TooLarge(format!("{count} invocations; take at most {}", WIDTH * limit as usize)));
        }
        let arguments = self.upload(layers, height);
        let usage = wgpu::TextureUsages::STORAGE_BINDING | wgpu::TextureUsages::COPY_SRC;
        let format = wgpu::TextureFormat::Rgba32Float;
        let target = create_texture(&self.gpu, "results", (WIDTH as u32, height), format, usage);
        let size = u64::from(ROW) * u64::from(height);
        let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
        let readback = buffer(&self.gpu, "readback", size, usage);
        self.dispatch(&arguments, &target, height, &readback);
        readback.map_async(wgpu::MapMode::Read, .., |_| {});
        self.gpu.wait()?;
        let lost = |e: wgpu::MapRangeError| RenderError::DeviceLost(e.to_string());
        let mapped = readback.get_mapped_range(..).map_err(lost)?;
        let mut results: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&mapped);
        results.truncate(count);
        Ok(results)
    }

    fn upload(&self, layers: &[&[[u32; 4]]], height: u32) -> wgpu::BindGroup {
        let size = wgpu::Extent3d { width: WIDTH as u32, height, depth_or_array_layers: layers.len().max(1) as u32 };
        let mut texels = Vec::with_capacity(WIDTH * height as usize * layers.len().max(1));
        for (index, layer) in layers.iter().enumerate() {
            texels.extend_from_slice(layer);
            texels.resize(WIDTH * height as usize * (index + 1), [0; 4]);
        }
        texels.resize(WIDTH * height as usize * layers.len().max(1), [0; 4]);
        let descriptor = wgpu::TextureDescriptor {
            label: Some("arguments"),
            size,
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::Rgba32Uint,
            usage: wgpu::TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        };
        let bytes = bytemuck::cast_slice(&texels);
        let texture =
            self.gpu.device.create_texture_with_data(&self.gpu.queue, &descriptor, TextureDataOrder::LayerMajor, bytes);
        let dimension = Some(wgpu::TextureViewDimension::D2Array);
        let view = texture.create_view(&wgpu::TextureViewDescriptor { dimension, ..Default::default() });
        let resource = wgpu::BindingResource::TextureView(&view);
        let descriptor = wgpu::BindGroupDescriptor {
            label: Some("arguments"),
            layout: &self.arguments,
            entries: &[wgpu::BindGroupEntry { binding: 0, resource }],
        };
        self.gpu.device.create_bind_group(&descriptor)
    }

    fn dispatch(&self, arguments: &wgpu::BindGroup, target: &wgpu::Texture, height: u32, readback: &wgpu::Buffer) {
        let view = |texture: &wgpu::Texture| texture.create_view(&wgpu::TextureViewDescriptor::default());
        let bindings = Bindings {
            frame: &self.frame,
            slice: &self.slice,
            scene: &self.scene,
            lights: &self.lights,
            picks: &self.picks,
            counters: &self.counters,
            environment: &self.environment,
            albedo: &self.albedo,
            work: &view(&self.work),
            film: &view(target),
            profiles: &self.profiles,
        };
        let bindings = bindings.group(&self.gpu, &self.layout);
        let mut encoder = self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        {
            let mut compute = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            compute.set_pipeline(&self.pipeline);
            compute.set_bind_group(0, &bindings, &[]);
            compute.set_bind_group(1, arguments, &[]);
            compute.dispatch_workgroups(WIDTH as u32 / GROUP, height.div_ceil(GROUP), 1);
        }
        let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(ROW), rows_per_image: None };
        encoder.copy_texture_to_buffer(
            target.as_image_copy(),
            wgpu::TexelCopyBufferInfo { buffer: readback, layout },
            wgpu::Extent3d { width: WIDTH as u32, height, depth_or_array_layers: 1 },
        );
        self.gpu.queue.submit([encoder.finish()]);
    }
}

fn arguments_layout(gpu: &Gpu) -> wgpu::BindGroupLayout {
    let ty = wgpu::BindingType::Texture {
        sample_type: wgpu::TextureSampleType::Uint,
        view_dimension: wgpu::TextureViewDimension::D2Array,
        multisampled: false,
    };
    let entry = wgpu::BindGroupLayoutEntry { binding: 0, visibility: wgpu::ShaderStages::COMPUTE, ty, count: None };
    let descriptor = wgpu::BindGroupLayoutDescriptor { label: Some("arguments"), entries: &[entry] };
    gpu.device.create_bind_group_layout(&descriptor)
}
