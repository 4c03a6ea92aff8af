//! One picture under way: passes cut into dispatches, read back into the film.

use super::device::Gpu;
use super::layout::{Frame, Slice};
use super::resources::{GpuEnvironment, GpuScene, Resources};
use crate::film::Film;
use crate::render::schedule::{Pass, Schedule};
use crate::render::slice::SlicePaths;
use crate::render::{DeviceInfo, NonFinite, Render, RenderError, StopReason, Work};
use std::sync::Arc;
use std::time::{Duration, Instant};
use wgpu::util::{BufferInitDescriptor, DeviceExt};

/// Side of the square of pixels that one workgroup traces, as in `shaders/pathtrace/pathtrace.wesl`.
const TILE: u32 = 8;
/// Most workgroups of one dispatch in one dimension (WebGPU's least limit).
const MAX_WORKGROUPS: u32 = 65535;
/// Bytes to which rows are aligned when a texture is copied to a buffer.
const ROW_ALIGNMENT: u32 = wgpu::COPY_BYTES_PER_ROW_ALIGNMENT;

/// A picture under way on the device.
pub struct GpuRender {
    gpu: Arc<Gpu>,
    pipeline: Arc<wgpu::ComputePipeline>,
    bindings: wgpu::BindGroup,
    slice: wgpu::Buffer,
    counters: wgpu::Buffer,
    target: wgpu::Texture,
    readback: wgpu::Buffer,
    schedule: Schedule,
    max_samples: u32,
    film: Film,
    /// The pass under way and the tiles of it that are done.
    pass: Option<(Pass, u32)>,
    tracing: Duration,
    slice_paths: SlicePaths,
    non_finite: NonFinite,
}

impl GpuRender {
    /// Everything bound, nothing traced.
    #[allow(clippy::too_many_arguments, reason = "the parts of one bind group")]
    pub(super) fn new(
        gpu: &Arc<Gpu>,
        pipeline: Arc<wgpu::ComputePipeline>,
        layout: &wgpu::BindGroupLayout,
        resources: &Resources,
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
        let counters = buffer(gpu, "counters", 8, wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC);
        let target = create_target(gpu, width, height);
        let size = u64::from(padded_row(width)) * u64::from(height) + 8;
        let readback = buffer(gpu, "readback", size, wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST);
        let lights = gpu.storage("lights", bytemuck::cast_slice(&work.lighting.lights), 64)?;
        let picks = gpu.storage("light table", bytemuck::cast_slice(&work.lighting.picks), 32)?;
        let view = target.create_view(&wgpu::TextureViewDescriptor::default());
        let entries = [
            frame.as_entire_binding(),
            slice.as_entire_binding(),
            scene.nodes.as_entire_binding(),
            scene.triangles.as_entire_binding(),
            scene.attributes.as_entire_binding(),
            scene.instances.as_entire_binding(),
            scene.materials.as_entire_binding(),
            lights.as_entire_binding(),
            picks.as_entire_binding(),
            counters.as_entire_binding(),
            wgpu::BindingResource::TextureView(&scene.color_pages),
            wgpu::BindingResource::TextureView(&scene.data_pages),
            wgpu::BindingResource::TextureView(&environment.texels),
            wgpu::BindingResource::TextureView(&environment.cells),
            wgpu::BindingResource::TextureView(&resources.albedo),
            wgpu::BindingResource::TextureView(&view),
        ];
        let mut binding = 0;
        let entries = entries.map(|resource| {
            let entry = wgpu::BindGroupEntry { binding, resource };
            binding += 1;
            entry
        });
        let bindings = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("pathtrace"),
            layout,
            entries: &entries,
        });
        Ok(Self {
            gpu: Arc::clone(gpu),
            pipeline,
            bindings,
            slice,
            counters,
            target,
            readback,
            schedule: Schedule::new(&work.settings),
            max_samples: work.settings.max_samples,
            film: film.unwrap_or_else(|| Film::new(width, height)),
            pass: None,
            tracing: Duration::ZERO,
            slice_paths: SlicePaths::default(),
            non_finite: NonFinite::default(),
        })
    }

    fn tiles(&self) -> (u32, u32) {
        let across = self.film.width().div_ceil(TILE);
        (across, across * self.film.height().div_ceil(TILE))
    }

    /// Tiles of the next dispatch, by the speed seen so far.
    fn slice_tiles(&self, pass: Pass, done: u32) -> u32 {
        let paths_per_tile = f64::from(TILE * TILE * pass.samples);
        let tiles = self.slice_paths.tiles(paths_per_tile);
        tiles.min(self.tiles().1 - done).min(MAX_WORKGROUPS)
    }

    /// Traces some tiles of a pass; copies the pictures out with the last.
    fn dispatch(&mut self, pass: Pass, done: u32, count: u32) -> Result<(), RenderError> {
        let (tiles_across, tiles) = self.tiles();
        let slice = Slice {
            first_tile: done,
            tile_count: count,
            first_sample: pass.first,
            sample_count: pass.samples,
            replicate: pass.replicate,
            tile_stride: spread(tiles),
            tiles_across,
            tiles,
        };
        self.gpu.queue.write_buffer(&self.slice, 0, bytemuck::bytes_of(&slice));
        let mut encoder = self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        {
            let mut compute = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            compute.set_pipeline(&self.pipeline);
            compute.set_bind_group(0, &self.bindings, &[]);
            compute.dispatch_workgroups(count, 1, 1);
        }
        if done + count == tiles {
            self.copy_out(&mut encoder);
        }
        self.gpu.queue.submit([encoder.finish()]);
        self.gpu.wait()
    }

    fn copy_out(&self, encoder: &mut wgpu::CommandEncoder) {
        let (width, height) = (self.film.width(), self.film.height());
        let row = padded_row(width);
        encoder.copy_texture_to_buffer(
            self.target.as_image_copy(),
            wgpu::TexelCopyBufferInfo {
                buffer: &self.readback,
                layout: wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(row), rows_per_image: None },
            },
            wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        );
        encoder.copy_buffer_to_buffer(&self.counters, 0, &self.readback, u64::from(row) * u64::from(height), 8);
    }

    /// Adds what a pass has made to the film.
    fn collect(&mut self, pass: Pass) -> Result<(), RenderError> {
        self.readback.map_async(wgpu::MapMode::Read, .., |_| {});
        self.gpu.wait()?;
        let lost = |e: wgpu::MapRangeError| RenderError::DeviceLost(e.to_string());
        let (width, height) = (self.film.width() as usize, self.film.height() as usize);
        let row = padded_row(self.film.width()) as usize;
        let mapped = self.readback.get_mapped_range(..).map_err(lost)?;
        let mut sums: Vec<[f32; 4]> = Vec::with_capacity(width * height);
        for line in mapped[..row * height].chunks_exact(row) {
            sums.extend_from_slice(bytemuck::cast_slice(&line[..width * 16]));
        }
        let counters: [u32; 2] = bytemuck::pod_read_unaligned(&mapped[row * height..row * height + 8]);
        drop(mapped);
        self.readback.unmap();
        self.non_finite = NonFinite { nan: u64::from(counters[0]), infinite: u64::from(counters[1]) };
        self.film.add(pass.replicate as usize, pass.samples, &sums);
        Ok(())
    }
}

impl Render for GpuRender {
    fn device(&self) -> &DeviceInfo {
        &self.gpu.info
    }

    fn step(&mut self) -> Result<Option<StopReason>, RenderError> {
        let begun = Instant::now();
        let (pass, done) = match self.pass {
            Some(under_way) => under_way,
            None => match self.schedule.next(&self.film) {
                Some(pass) => (pass, 0),
                None => return Ok(Some(StopReason::MaxSamples)),
            },
        };
        let count = self.slice_tiles(pass, done);
        self.dispatch(pass, done, count)?;
        let paths = f64::from(count * TILE * TILE) * f64::from(pass.samples);
        self.slice_paths.learn(paths, begun.elapsed());
        let finished = done + count == self.tiles().1;
        self.pass = (!finished).then_some((pass, done + count));
        if finished {
            self.collect(pass)?;
        }
        self.tracing += begun.elapsed();
        if finished {
            return Ok(self.schedule.stop(&self.film, self.tracing));
        }
        Ok(self.schedule.overdue(&self.film, self.tracing).then_some(StopReason::Deadline))
    }

    fn film(&self) -> &Film {
        &self.film
    }

    fn into_film(self: Box<Self>) -> Film {
        self.film
    }

    fn progress(&self) -> f64 {
        let under_way =
            self.pass.map_or(0.0, |(pass, done)| f64::from(pass.samples) * f64::from(done) / f64::from(self.tiles().1));
        (f64::from(self.film.samples()) + under_way) / f64::from(self.max_samples.max(1))
    }

    fn non_finite(&self) -> NonFinite {
        self.non_finite
    }
}

/// A step through `tiles` that visits each once and puts neighbours far apart.
fn spread(tiles: u32) -> u32 {
    let coprime = |step: &u32| {
        let (mut a, mut b) = (*step, tiles);
        while b != 0 {
            (a, b) = (b, a % b);
        }
        a == 1
    };
    // About the golden section, and small enough that no product leaves 32 bits.
    let start = (f64::from(tiles) * 0.618) as u32;
    (start.clamp(1, u32::MAX / tiles.max(1))..).find(coprime).unwrap_or(1)
}

fn padded_row(width: u32) -> u32 {
    (width * 16).next_multiple_of(ROW_ALIGNMENT)
}

fn uniform(gpu: &Gpu, label: &str, contents: &[u8]) -> wgpu::Buffer {
    let usage = wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST;
    gpu.device.create_buffer_init(&BufferInitDescriptor { label: Some(label), contents, usage })
}

fn buffer(gpu: &Gpu, label: &str, size: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
    gpu.device.create_buffer(&wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false })
}

fn create_target(gpu: &Gpu, width: u32, height: u32) -> wgpu::Texture {
    gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("film"),
        size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba32Float,
        usage: wgpu::TextureUsages::STORAGE_BINDING | wgpu::TextureUsages::COPY_SRC,
        view_formats: &[],
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spread_visits_each_tile_once() {
        for tiles in [1, 2, 3, 64, 9450, 65536, 1_048_576] {
            let stride = spread(tiles);
            let mut seen = vec![false; tiles as usize];
            for tile in 0..tiles {
                seen[((tile * stride) % tiles) as usize] = true;
            }
            assert!(seen.iter().all(|&s| s), "{tiles} tiles, stride {stride}");
        }
    }
}
