//! One preview under way: its uploads, then frame after frame, each moved by a part of a pixel.

use super::Previews;
use super::bands::Bands;
use super::camera::{jitter, projection};
use super::draws::{Listed, draws};
use super::frame::{Frame, FramePipelines, ScenePipelines};
use super::groups::{Binder, Uploads};
use super::layout::{Preview, Projection};
use super::layouts::Layouts;
use super::lights::PreviewLights;
use super::pipelines::{Compute, Draw, Pipelines, Shape, Style};
use super::shadow_maps::ShadowMaps;
use super::targets::Extent;
use crate::compile::{CompiledScene, View};
use crate::film::{Film, TILE_PIXELS, TileSamples};
use crate::params::{PreviewParams, ShadingPath, ShadowHash};
use crate::render::gpu::Gpu;
use crate::render::gpu::layout::Frame as SceneFrame;
use crate::render::gpu::resources::Resources;
use crate::render::{DeviceInfo, NonFinite, Render, RenderError, StopReason, Work};
use bytemuck::Zeroable;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// How often the film is made while there is more to come.
const COLLECT_PERIOD: Duration = Duration::from_secs(1);

/// A preview under way.
pub struct PreviewRender {
    gpu: Arc<Gpu>,
    frame: Frame,
    /// What changes from frame to frame is set before each.
    preview: Preview,
    preview_buffer: wgpu::Buffer,
    projections: wgpu::Buffer,
    camera: Camera,
    film: Film,
    /// Frames that are done.
    done: u32,
    count: u32,
    /// First row of the frame under way that is not lit.
    row: u32,
    bands: Bands,
    collected: Instant,
    deadline: Option<Duration>,
    tracing: Duration,
    non_finite: NonFinite,
}

/// What the camera of a frame is made from.
struct Camera {
    view: View,
    scene: Arc<CompiledScene>,
    filter: Box<SceneFrame>,
}

impl Camera {
    fn projection(&self, index: u32, count: u32) -> Projection {
        let jitter = jitter(&self.filter.filter_table, self.filter.filter_radius, index, count);
        projection(&self.view, &self.scene.bounds, jitter)
    }
}

impl PreviewRender {
    /// Everything bound, nothing drawn.
    ///
    /// # Errors
    /// [`RenderError::TooLarge`] if the device cannot hold the scene, the picture or the shadow maps.
    pub fn new(
        gpu: &Arc<Gpu>,
        previews: &mut Previews,
        resources: &mut Resources,
        work: &Work,
    ) -> Result<Self, RenderError> {
        let params = &work.settings.preview;
        let scene = resources.scene(gpu, &work.scene)?;
        let environment = resources.environment(gpu, &work.lighting.environment)?;
        let lights = PreviewLights::new(&work.scene, &work.lighting, params, &work.view);
        let listed = Listed::new(&work.scene, &work.view);
        let has_overlay = params.gizmos && !lights.lights.is_empty() || !listed.blended.is_empty();
        let extent = Extent {
            width: work.view.width,
            height: work.view.height,
            deferred: params.path == ShadingPath::Deferred,
            overlay: has_overlay,
            bounded_lights: if params.culling { lights.lights.len() as u32 - lights.unbounded } else { 0 },
        };
        let targets = previews.targets.take(gpu, extent)?;
        let uploads = Uploads::new(gpu, work, &lights, &listed)?;
        let maps = ShadowMaps::new(gpu, params, lights.faces.len() as u32)?;
        let albedo = resources.albedo(gpu, &work.scene);
        let surroundings = previews.surroundings.get(gpu, &work.lighting.environment);
        let binder = Binder {
            gpu,
            layouts: &previews.layouts,
            scene: &scene,
            environment: &environment,
            albedo: &albedo,
            reflected: &surroundings.reflected,
        };
        let groups = binder.groups(&uploads, &targets, &maps.array);
        let style = Style::new(gpu, work, &lights);
        let passes = Passes {
            extent,
            gizmos: params.gizmos && !lights.lights.is_empty(),
            blended: !listed.blended.is_empty(),
            spheres: !listed.spheres.is_empty(),
            shadow_maps: !maps.layers.is_empty(),
        };
        let pipelines = passes.pipelines(gpu, &mut previews.pipelines, &previews.layouts, style);
        let mut preview = shading_values(params, &work.scene);
        preview.harmonics = surroundings.harmonics;
        preview.tiles_across = targets.grid.across;
        preview.tiles_down = targets.grid.down;
        preview.tile_side = targets.grid.side;
        preview.summary_words = targets.grid.summary_words;
        preview.mask_words = targets.grid.mask_words;
        preview.light_count = lights.lights.len() as u32;
        preview.unbounded_count = lights.unbounded;
        preview.open_tiles = u32::from(!listed.blended.is_empty());
        preview.has_overlay = u32::from(has_overlay);
        let Uploads { preview_buffer, projections, .. } = uploads;
        Ok(Self {
            gpu: Arc::clone(gpu),
            frame: Frame {
                targets,
                size: (extent.width, extent.height),
                draws: draws(&work.scene),
                blended_vertices: 3 * listed.blended.len() as u32,
                sphere_vertices: 6 * listed.spheres.len() as u32,
                lights: lights.lights.len() as u32,
                culled_lights: extent.bounded_lights,
                shadow_maps: maps.layers,
                pipelines,
                groups,
            },
            preview,
            preview_buffer,
            projections,
            camera: Camera {
                view: work.view.clone(),
                scene: Arc::clone(&work.scene),
                filter: Box::new(SceneFrame::new(work)),
            },
            film: Film::new(extent.width, extent.height),
            done: 0,
            row: 0,
            bands: Bands::new((extent.width, extent.height), &params.shadows, &lights),
            collected: Instant::now(),
            count: work.settings.max_samples.max(1),
            deadline: work.settings.deadline,
            tracing: Duration::ZERO,
            non_finite: NonFinite::default(),
        })
    }

    /// Draws the next rows of the frame under way, with the first of them what all need; copies the sums out with the last, if the
    /// host is to have them.
    fn draw(&mut self, rows: &Range<u32>, wanted: bool) -> Result<(), RenderError> {
        if rows.start == 0 {
            self.preview.camera = self.camera.projection(self.done, self.count);
            self.preview.sample = self.done;
            self.gpu.queue.write_buffer(&self.projections, 0, bytemuck::bytes_of(&self.preview.camera));
        }
        (self.preview.first_row, self.preview.end_row) = (rows.start, rows.end);
        self.gpu.queue.write_buffer(&self.preview_buffer, 0, bytemuck::bytes_of(&self.preview));
        let mut encoder = self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        if rows.start == 0 {
            if self.done == 0 {
                self.frame.draw_shadow_maps(&mut encoder);
            }
            self.frame.draw_geometry(&mut encoder);
        }
        self.frame.light_rows(&mut encoder, rows);
        if wanted {
            let targets = &self.frame.targets;
            encoder.copy_buffer_to_buffer(&targets.sums, 0, &targets.readback, 0, targets.sums.size());
        }
        self.gpu.queue.submit([encoder.finish()]);
        self.gpu.wait()
    }

    /// Makes the film anew from the sums of the frames that are done.
    fn collect(&mut self) -> Result<(), RenderError> {
        let readback = &self.frame.targets.readback;
        readback.map_async(wgpu::MapMode::Read, .., |_| {});
        self.gpu.wait()?;
        let lost = |e: wgpu::MapRangeError| RenderError::DeviceLost(e.to_string());
        let mapped = readback.get_mapped_range(..).map_err(lost)?;
        let sums: &[[f32; 4]] = bytemuck::cast_slice(&mapped);
        let is_nan = |sum: &&[f32; 4]| sum.iter().any(|v| v.is_nan());
        let is_infinite = |sum: &&[f32; 4]| !sum.iter().any(|v| v.is_nan()) && sum.iter().any(|v| v.is_infinite());
        self.non_finite.nan = sums.iter().filter(is_nan).count() as u64;
        self.non_finite.infinite = sums.iter().filter(is_infinite).count() as u64;
        let mut film = Film::new(self.film.width(), self.film.height());
        add_to_film(&mut film, sums, self.done);
        self.film = film;
        drop(mapped);
        readback.unmap();
        Ok(())
    }
}

impl Render for PreviewRender {
    fn device(&self) -> &DeviceInfo {
        &self.gpu.info
    }

    fn step(&mut self) -> Result<Option<StopReason>, RenderError> {
        if self.done >= self.count {
            return Ok(Some(StopReason::MaxSamples));
        }
        let begun = Instant::now();
        let height = self.frame.size.1;
        let rows = self.row..(self.row + self.bands.rows()).min(height);
        let ends_frame = rows.end == height;
        // A frame more would come too late if it took as long as those before it.
        let per_frame = if self.done > 0 { self.tracing / self.done } else { Duration::ZERO };
        let is_late = self.deadline.is_some_and(|deadline| self.tracing + 2 * per_frame >= deadline);
        let is_last = ends_frame && (self.done + 1 >= self.count || is_late);
        let wanted = is_last || ends_frame && self.collected.elapsed() >= COLLECT_PERIOD;
        self.draw(&rows, wanted)?;
        self.bands.learn(rows.len() as u32, begun.elapsed());
        self.row = if ends_frame { 0 } else { rows.end };
        self.done += u32::from(ends_frame);
        if wanted {
            self.collect()?;
            self.collected = Instant::now();
        }
        self.tracing += begun.elapsed();
        let reason = if self.done < self.count { StopReason::Deadline } else { StopReason::MaxSamples };
        Ok(is_last.then_some(reason))
    }

    fn film(&self) -> &Film {
        &self.film
    }

    fn into_film(self: Box<Self>) -> Film {
        self.film
    }

    fn progress(&self) -> f64 {
        let part = f64::from(self.row) / f64::from(self.frame.size.1);
        (f64::from(self.done) + part) / f64::from(self.count)
    }

    fn non_finite(&self) -> NonFinite {
        self.non_finite
    }
}

/// One replicate of the film: frames share their pixels' places, so that their spread says nothing of the picture's error.
fn add_to_film(film: &mut Film, sums: &[[f32; 4]], samples: u32) {
    let tiles = film.tiles();
    let entry = |tile| TileSamples { tile, replicate: 0, first: 0, samples };
    let work: Vec<_> = (0..tiles.count()).map(entry).collect();
    let width = tiles.width() as usize;
    let sum = |tile: u32, lane: usize| {
        let Some((x, y)) = tiles.pixel(tile, lane as u32) else { return [0.0; 4] };
        let sum = sums.get(y as usize * width + x as usize).copied().unwrap_or_default();
        if sum.iter().all(|v| v.is_finite()) { sum } else { [0.0; 4] }
    };
    let lanes =
        (0..tiles.count()).into_par_iter().flat_map_iter(|tile| (0..TILE_PIXELS).map(move |lane| sum(tile, lane)));
    let lanes: Vec<[f32; 4]> = lanes.collect();
    film.add(&work, &lanes);
}

/// Which passes there are.
struct Passes {
    extent: Extent,
    gizmos: bool,
    blended: bool,
    spheres: bool,
    shadow_maps: bool,
}

impl Passes {
    fn pipelines(&self, gpu: &Gpu, pipelines: &mut Pipelines, layouts: &Layouts, style: Style) -> FramePipelines {
        let culls = self.extent.bounded_lights > 0;
        let deferred = self.extent.deferred;
        let surfaces = if deferred { Draw::Geometry } else { Draw::Forward { over_depth: culls } };
        let finish = if deferred { Compute::Light } else { Compute::Gather };
        let mut draw = |pass, shape| pipelines.draw(gpu, layouts, pass, shape, style);
        let gizmos = self.gizmos.then(|| draw(Draw::Gizmos, Shape::Mesh));
        let blended = self.blended.then(|| draw(Draw::Blended, Shape::Mesh));
        let mut scene = |pass| ScenePipelines {
            mesh: draw(pass, Shape::Mesh),
            spheres: self.spheres.then(|| draw(pass, Shape::Spheres)),
        };
        let shadow = self.shadow_maps.then(|| scene(Draw::Shadow));
        let depth = (culls && !deferred).then(|| scene(Draw::Depth));
        let surfaces = scene(surfaces);
        let mut compute = |pass, wanted: bool| wanted.then(|| pipelines.compute(gpu, layouts, pass, style));
        let (measure, cull) = (compute(Compute::Measure, culls), compute(Compute::Cull, culls));
        let finish = pipelines.compute(gpu, layouts, finish, style);
        FramePipelines { shadow, depth, surfaces, measure, cull, gizmos, blended, finish, deferred }
    }
}

/// What the request says, as the shaders read it.
fn shading_values(params: &PreviewParams, scene: &CompiledScene) -> Preview {
    let shadows = &params.shadows;
    Preview {
        shininess: params.shininess,
        specular: params.specular,
        constant: params.attenuation.constant,
        linear: params.attenuation.linear,
        quadratic: params.attenuation.quadratic,
        gizmo_size: params.gizmo_size * scene.bounds.radius() as f32,
        taps: shadows.taps,
        kernel_radius: shadows.radius.unwrap_or(0.5 * (shadows.taps as f32).sqrt()),
        bias_constant: shadows.bias.constant,
        bias_slope: shadows.bias.slope,
        bias_normal: shadows.bias.normal,
        light_radius: 0.5 * shadows.light_size,
        sine_hash: u32::from(shadows.hash == ShadowHash::Sine),
        map_size: shadows.map_size,
        ..Preview::zeroed()
    }
}
