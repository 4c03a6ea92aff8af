//! One picture under way: passes cut into dispatches, read back into the film.

use super::bindings::Bindings;
use super::device::Gpu;
use super::layout::{Frame, Slice};
use super::pipeline::Kernel;
use super::resources::{GpuEnvironment, GpuScene, Resources, upload_profiles};
use crate::film::{Film, TILE_PIXELS};
use crate::render::schedule::{Pass, Schedule};
use crate::render::slice::SlicePaths;
use crate::render::{DeviceInfo, NonFinite, Render, RenderError, StopReason, Work};
use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::{Duration, Instant};
use wgpu::util::{BufferInitDescriptor, DeviceExt};

/// Lanes of a workgroup, as in `shaders/pathtrace/pathtrace.wesl`.
const LANES: u32 = TILE_PIXELS as u32;
/// Bytes of the counters.
const COUNTERS: u64 = 8;
/// Bytes of a tile's sums, a multiple of what rows are aligned to when a texture is copied to a buffer.
const TILE_BYTES: u32 = LANES * 16;

/// Longest wait for a kernel in one step.
const WAIT: Duration = Duration::from_millis(2);

/// A picture under way on the device.
pub struct GpuRender {
    gpu: Arc<Gpu>,
    kernel: Kernel,
    bindings: wgpu::BindGroup,
    slice: wgpu::Buffer,
    counters: wgpu::Buffer,
    work: wgpu::Texture,
    target: wgpu::Texture,
    /// Tiles in a row of `work` and of `target`.
    row: u32,
    readback: wgpu::Buffer,
    schedule: Schedule,
    film: Film,
    /// The pass under way.
    pass: Pass,
    /// Entries of the pass that are done.
    done: u32,
    tracing: Duration,
    slice_paths: SlicePaths,
    non_finite: NonFinite,
}

impl GpuRender {
    /// Everything bound, nothing traced.
    #[allow(clippy::too_many_arguments, reason = "the parts of one bind group")]
    pub(super) fn new(
        gpu: &Arc<Gpu>,
        kernel: Kernel,
        layout: &wgpu::BindGroupLayout,
        resources: &mut Resources,
        scene: &GpuScene,
        environment: &GpuEnvironment,
        work: &Work,
        film: Option<Film>,
    ) -> Result<Self, RenderError> {
        let (width, height) = (work.view.width, work.view.height);
        let limit = gpu.device.limits().max_texture_dimension_2d;
        if width > limit || height > limit {
            return Err(RenderError::TooLarge(format!(
                "a picture of {width} x {height}; {} takes {limit} a side",
                gpu.info.name
            )));
        }
        let frame = uniform(gpu, "frame", bytemuck::bytes_of(&Frame::new(work)));
        let slice = uniform(gpu, "slice", &[0; size_of::<Slice>()]);
        let counters = buffer(gpu, "counters", COUNTERS, wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC);
        let film = film.unwrap_or_else(|| Film::new(width, height));
        let tiles = film.tiles().count();
        let row = (limit / LANES).min(tiles);
        let rows = tiles.div_ceil(row);
        let list = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST;
        let list = create_texture(gpu, "work", (row, rows), wgpu::TextureFormat::Rgba32Uint, list);
        let target = wgpu::TextureUsages::STORAGE_BINDING | wgpu::TextureUsages::COPY_SRC;
        let target = create_texture(gpu, "film", (row * LANES, rows), wgpu::TextureFormat::Rgba32Float, target);
        let size = u64::from(row * rows) * u64::from(TILE_BYTES) + COUNTERS;
        let readback = buffer(gpu, "readback", size, wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST);
        let lights = gpu.storage("lights", bytemuck::cast_slice(work.lighting.over_time()), 64)?;
        let picks = gpu.storage("light table", bytemuck::cast_slice(&work.lighting.picks), 32)?;
        let [list_view, target_view] = [&list, &target].map(|t| t.create_view(&wgpu::TextureViewDescriptor::default()));
        let bindings = Bindings {
            frame: &frame,
            slice: &slice,
            scene,
            lights: &lights,
            picks: &picks,
            counters: &counters,
            environment,
            albedo: &resources.albedo(gpu, &work.scene),
            work: &list_view,
            film: &target_view,
            profiles: &upload_profiles(gpu, &work.lighting.profiles)?,
        };
        let bindings = bindings.group(gpu, layout);
        Ok(Self {
            gpu: Arc::clone(gpu),
            kernel,
            bindings,
            slice,
            counters,
            work: list,
            target,
            row,
            readback,
            schedule: Schedule::new(&work.settings),
            film,
            pass: Pass::new(),
            done: 0,
            tracing: Duration::ZERO,
            slice_paths: SlicePaths::default(),
            non_finite: NonFinite::default(),
        })
    }

    /// Begins the pass that is due, or says why there is none.
    fn next_pass(&mut self) -> Option<StopReason> {
        (self.pass, self.done) = (Pass::new(), 0);
        match self.schedule.next(&self.film, self.tracing) {
            ControlFlow::Break(reason) => return Some(reason),
            ControlFlow::Continue(pass) => self.pass = pass,
        }
        let mut entries: Vec<[u32; 4]> = self.pass.iter().map(|e| [e.tile, e.replicate, e.first, e.samples]).collect();
        let rows = (entries.len() as u32).div_ceil(self.row);
        entries.resize((rows * self.row) as usize, [0; 4]);
        self.gpu.queue.write_texture(
            self.work.as_image_copy(),
            bytemuck::cast_slice(&entries),
            wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(16 * self.row), rows_per_image: None },
            wgpu::Extent3d { width: self.row, height: rows, depth_or_array_layers: 1 },
        );
        None
    }

    /// Traces some entries of the pass; copies the sums out with the last.
    fn dispatch(&mut self, kernel: &wgpu::ComputePipeline, count: u32) -> Result<(), RenderError> {
        let slice =
            Slice { first: self.done, count, row: self.row, regions_across: self.film.tiles().regions_across() };
        self.gpu.queue.write_buffer(&self.slice, 0, bytemuck::bytes_of(&slice));
        let mut encoder = self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        {
            let mut compute = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            compute.set_pipeline(kernel);
            compute.set_bind_group(0, &self.bindings, &[]);
            compute.dispatch_workgroups(count, 1, 1);
        }
        self.done += count;
        if self.is_finished() {
            self.copy_out(&mut encoder);
        }
        self.gpu.queue.submit([encoder.finish()]);
        self.gpu.wait()
    }

    fn is_finished(&self) -> bool {
        self.done as usize == self.pass.len()
    }

    /// Counters first, then the rows of sums that the pass has filled.
    fn copy_out(&self, encoder: &mut wgpu::CommandEncoder) {
        let layout =
            wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(self.row * TILE_BYTES), rows_per_image: None };
        let size =
            wgpu::Extent3d { width: self.row * LANES, height: self.done.div_ceil(self.row), depth_or_array_layers: 1 };
        let readback = wgpu::TexelCopyBufferInfo { buffer: &self.readback, layout };
        encoder.copy_texture_to_buffer(self.target.as_image_copy(), readback, size);
        encoder.copy_buffer_to_buffer(&self.counters, 0, &self.readback, self.readback.size() - COUNTERS, COUNTERS);
    }

    /// Adds what the pass has made to the film.
    fn collect(&mut self) -> Result<(), RenderError> {
        self.readback.map_async(wgpu::MapMode::Read, .., |_| {});
        self.gpu.wait()?;
        let lost = |e: wgpu::MapRangeError| RenderError::DeviceLost(e.to_string());
        let mapped = self.readback.get_mapped_range(..).map_err(lost)?;
        let (sums, counters) = mapped.split_at(mapped.len() - COUNTERS as usize);
        let counters: [u32; 2] = bytemuck::pod_read_unaligned(counters);
        self.non_finite = NonFinite { nan: u64::from(counters[0]), infinite: u64::from(counters[1]) };
        self.film.add(&self.pass, bytemuck::cast_slice(&sums[..self.pass.len() * TILE_BYTES as usize]));
        drop(mapped);
        self.readback.unmap();
        Ok(())
    }
}

impl Render for GpuRender {
    fn device(&self) -> &DeviceInfo {
        &self.gpu.info
    }

    fn is_ready(&self) -> bool {
        self.kernel.get().is_some()
    }

    fn step(&mut self) -> Result<Option<StopReason>, RenderError> {
        let kernel = self.kernel.clone();
        let Some(kernel) = kernel.get() else {
            std::thread::sleep(WAIT);
            return self.gpu.fault().map(|()| None);
        };
        let begun = Instant::now();
        if self.is_finished()
            && let Some(reason) = self.next_pass()
        {
            return Ok(Some(reason));
        }
        let (count, paths) = self.slice_paths.take(&self.pass[self.done as usize..]);
        self.dispatch(kernel?, count)?;
        self.slice_paths.learn(paths, begun.elapsed());
        if !self.is_finished() {
            self.tracing += begun.elapsed();
            return Ok(self.schedule.overdue(&self.film, self.tracing).then_some(StopReason::Deadline));
        }
        self.collect()?;
        self.tracing += begun.elapsed();
        Ok(self.next_pass())
    }

    fn film(&self) -> &Film {
        &self.film
    }

    fn into_film(self: Box<Self>) -> Film {
        self.film
    }

    fn progress(&self) -> f64 {
        self.schedule.fraction(&self.film, &self.pass[..self.done as usize])
    }

    fn non_finite(&self) -> NonFinite {
        self.non_finite
    }
}

pub(in crate::render) fn uniform(gpu: &Gpu, label: &str, contents: &[u8]) -> wgpu::Buffer {
    let usage = wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST;
    gpu.device.create_buffer_init(&BufferInitDescriptor { label: Some(label), contents, usage })
}

pub(in crate::render) fn buffer(gpu: &Gpu, label: &str, size: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
    gpu.device.create_buffer(&wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false })
}

pub(in crate::render) fn create_texture(
    gpu: &Gpu,
    label: &str,
    (width, height): (u32, u32),
    format: wgpu::TextureFormat,
    usage: wgpu::TextureUsages,
) -> wgpu::Texture {
    gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some(label),
        size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage,
        view_formats: &[],
    })
}
