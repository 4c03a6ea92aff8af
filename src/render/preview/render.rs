//! One preview under way: its uploads, then frame after frame, each moved by a part of a pixel.

use super::Previews;
use super::bands::Bands;
use super::camera::{jitter, projection};
use super::frame::{Frame, FramePipelines, Groups};
use super::layout::{Preview, PreviewLight, Projection};
use super::layouts::{Layouts, PROJECTION_STRIDE};
use super::lights::PreviewLights;
use super::pipelines::{Compute, Draw, Pipelines, Style};
use super::targets::{DEPTH, Extent, Targets};
use crate::compile::{CompiledScene, Instance, Triangle, View};
use crate::film::{Film, TILE_PIXELS, TileSamples};
use crate::params::{PreviewParams, ShadingPath, ShadowAlgorithm, ShadowHash};
use crate::render::gpu::Gpu;
use crate::render::gpu::layout::Frame as SceneFrame;
use crate::render::gpu::render::uniform;
use crate::render::gpu::resources::{GpuEnvironment, GpuScene, Resources};
use crate::render::{DeviceInfo, NonFinite, Render, RenderError, StopReason, Work};
use bytemuck::Zeroable;
use glam::{Affine3A, Vec3};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;
use std::time::{Duration, Instant};
use wgpu::BindingResource;

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
        let lights = PreviewLights::new(&work.scene, &work.lighting.lights, params);
        let blended = blended_triangles(&work.scene, &work.view);
        let has_overlay = params.gizmos && !lights.lights.is_empty() || !blended.is_empty();
        let extent = Extent {
            width: work.view.width,
            height: work.view.height,
            deferred: params.path == ShadingPath::Deferred,
            overlay: has_overlay,
            bounded_lights: if params.culling { lights.lights.len() as u32 - lights.unbounded } else { 0 },
        };
        let targets = previews.targets.take(gpu, extent)?;
        let uploads = Uploads::new(gpu, work, &lights, &blended)?;
        let maps = shadow_maps(gpu, params, lights.faces.len() as u32)?;
        let albedo = resources.albedo(gpu, &work.scene);
        let binder =
            Binder { gpu, layouts: &previews.layouts, scene: &scene, environment: &environment, albedo: &albedo };
        let groups = binder.groups(&uploads, &targets, &maps.array);
        let style = Style::new(gpu, work, &lights);
        let passes =
            Passes { extent, gizmos: params.gizmos && !lights.lights.is_empty(), blended: !blended.is_empty() };
        let pipelines =
            passes.pipelines(gpu, &mut previews.pipelines, &previews.layouts, style, !maps.layers.is_empty());
        let mut preview = shading_values(params, &work.scene);
        preview.harmonics = previews.harmonics.get(&work.lighting.environment);
        preview.tiles_across = targets.grid.across;
        preview.tiles_down = targets.grid.down;
        preview.tile_side = targets.grid.side;
        preview.summary_words = targets.grid.summary_words;
        preview.mask_words = targets.grid.mask_words;
        preview.light_count = lights.lights.len() as u32;
        preview.unbounded_count = lights.unbounded;
        preview.open_tiles = u32::from(!blended.is_empty());
        preview.has_overlay = u32::from(has_overlay);
        let Uploads { preview_buffer, projections, .. } = uploads;
        Ok(Self {
            gpu: Arc::clone(gpu),
            frame: Frame {
                targets,
                size: (extent.width, extent.height),
                draws: draws(&work.scene),
                blended_vertices: 3 * blended.len() as u32,
                lights: lights.lights.len() as u32,
                culled_lights: extent.bounded_lights,
                shadow_maps: maps.layers,
                pipelines,
                groups,
            },
            preview,
            preview_buffer,
            projections,
            camera: Camera { view: work.view, scene: Arc::clone(&work.scene), filter: Box::new(SceneFrame::new(work)) },
            film: Film::new(extent.width, extent.height),
            done: 0,
            row: 0,
            bands: Bands::new(work, &lights),
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

/// Buffers of one picture.
struct Uploads {
    scene_frame: wgpu::Buffer,
    preview_buffer: wgpu::Buffer,
    /// The camera's, then those of the shadow maps, [`PROJECTION_STRIDE`] bytes apart.
    projections: wgpu::Buffer,
    /// Those of the shadow maps, side by side.
    faces: wgpu::Buffer,
    lights: wgpu::Buffer,
    blended: Option<wgpu::Buffer>,
}

impl Uploads {
    fn new(gpu: &Gpu, work: &Work, lights: &PreviewLights, blended: &[[u32; 2]]) -> Result<Self, RenderError> {
        let mut faces = [Projection::zeroed(); super::faces::MAX_FACES];
        faces.iter_mut().zip(&lights.faces).for_each(|(slot, face)| *slot = *face);
        let mut projections = vec![0; PROJECTION_STRIDE as usize * (1 + lights.faces.len())];
        for (slot, face) in projections.chunks_exact_mut(PROJECTION_STRIDE as usize).skip(1).zip(&lights.faces) {
            slot[..size_of::<Projection>()].copy_from_slice(bytemuck::bytes_of(face));
        }
        let blended_bytes = bytemuck::cast_slice(blended);
        Ok(Self {
            scene_frame: uniform(gpu, "frame", bytemuck::bytes_of(&SceneFrame::new(work))),
            preview_buffer: uniform(gpu, "preview", bytemuck::bytes_of(&Preview::zeroed())),
            projections: uniform(gpu, "projections", &projections),
            faces: uniform(gpu, "faces", bytemuck::cast_slice(&faces)),
            lights: gpu.storage("lights", bytemuck::cast_slice(&lights.lights), size_of::<PreviewLight>())?,
            blended: (!blended.is_empty()).then(|| gpu.storage("blended triangles", blended_bytes, 8)).transpose()?,
        })
    }
}

/// Makes bind groups.
struct Binder<'a> {
    gpu: &'a Gpu,
    layouts: &'a Layouts,
    scene: &'a GpuScene,
    environment: &'a GpuEnvironment,
    albedo: &'a wgpu::TextureView,
}

impl Binder<'_> {
    fn groups(&self, uploads: &Uploads, targets: &Targets, maps: &wgpu::TextureView) -> Groups {
        let texture = BindingResource::TextureView;
        let projection = wgpu::BufferBinding {
            buffer: &uploads.projections,
            offset: 0,
            size: wgpu::BufferSize::new(size_of::<Projection>() as u64),
        };
        let (layouts, scene) = (self.layouts, self.scene);
        let blended = uploads.blended.as_ref();
        Groups {
            scene: self.group(
                &layouts.scene,
                &[
                    (0, uploads.scene_frame.as_entire_binding()),
                    (2, texture(&scene.nodes)),
                    (3, texture(&scene.triangles)),
                    (4, scene.attributes.as_entire_binding()),
                    (5, scene.instances.as_entire_binding()),
                    (6, scene.materials.as_entire_binding()),
                    (10, texture(&scene.color_pages)),
                    (11, texture(&scene.data_pages)),
                    (12, texture(&self.environment.texels)),
                    (14, texture(self.albedo)),
                ],
            ),
            projection: self.group(&layouts.projection, &[(0, BindingResource::Buffer(projection))]),
            light: self.group(
                &layouts.light,
                &[
                    (0, uploads.preview_buffer.as_entire_binding()),
                    (1, uploads.lights.as_entire_binding()),
                    (2, targets.masks.as_entire_binding()),
                    (3, uploads.faces.as_entire_binding()),
                    (4, texture(maps)),
                ],
            ),
            blended: blended.map(|buffer| self.group(&layouts.blended, &[(0, buffer.as_entire_binding())])),
            tiles: self.group(
                &layouts.tiles,
                &[
                    (0, uploads.preview_buffer.as_entire_binding()),
                    (1, uploads.lights.as_entire_binding()),
                    (2, targets.tile_depths.as_entire_binding()),
                    (3, targets.masks.as_entire_binding()),
                    (4, texture(&targets.depth)),
                ],
            ),
            finish: self.group(
                &layouts.finish,
                &[
                    (0, texture(&targets.surface)),
                    (1, texture(&targets.radiance)),
                    (2, texture(&targets.depth)),
                    (3, texture(&targets.overlay)),
                    (4, targets.sums.as_entire_binding()),
                ],
            ),
        }
    }

    fn group(&self, layout: &wgpu::BindGroupLayout, bindings: &[(u32, BindingResource<'_>)]) -> wgpu::BindGroup {
        let entries: Vec<_> = bindings
            .iter()
            .map(|(binding, resource)| wgpu::BindGroupEntry { binding: *binding, resource: resource.clone() })
            .collect();
        self.gpu.device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries: &entries })
    }
}

/// Which passes there are.
struct Passes {
    extent: Extent,
    gizmos: bool,
    blended: bool,
}

impl Passes {
    fn pipelines(
        &self,
        gpu: &Gpu,
        pipelines: &mut Pipelines,
        layouts: &Layouts,
        style: Style,
        shadow_maps: bool,
    ) -> FramePipelines {
        let culls = self.extent.bounded_lights > 0;
        let deferred = self.extent.deferred;
        let surfaces = if deferred { Draw::Geometry } else { Draw::Forward { over_depth: culls } };
        let finish = if deferred { Compute::Light } else { Compute::Gather };
        let mut draw = |pass, wanted: bool| wanted.then(|| pipelines.draw(gpu, layouts, pass, style));
        let (shadow, depth) = (draw(Draw::Shadow, shadow_maps), draw(Draw::Depth, culls && !deferred));
        let (gizmos, blended) = (draw(Draw::Gizmos, self.gizmos), draw(Draw::Blended, self.blended));
        let surfaces = pipelines.draw(gpu, layouts, surfaces, style);
        let mut compute = |pass, wanted: bool| wanted.then(|| pipelines.compute(gpu, layouts, pass, style));
        let (measure, cull) = (compute(Compute::Measure, culls), compute(Compute::Cull, culls));
        let finish = pipelines.compute(gpu, layouts, finish, style);
        FramePipelines { shadow, depth, surfaces, measure, cull, gizmos, blended, finish, deferred }
    }
}

/// Shadow maps: all for the shaders, each to draw to.
struct ShadowMaps {
    array: wgpu::TextureView,
    layers: Vec<wgpu::TextureView>,
}

fn shadow_maps(gpu: &Gpu, params: &PreviewParams, faces: u32) -> Result<ShadowMaps, RenderError> {
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
    Ok(ShadowMaps {
        array: texture.create_view(&wgpu::TextureViewDescriptor { dimension, ..Default::default() }),
        layers: (0..drawn).map(layer).collect(),
    })
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

/// Triangles of each instance's mesh: from its first to the next mesh's.
fn meshes(scene: &CompiledScene) -> Vec<Range<u32>> {
    let all = scene.triangles.len() as u32;
    let first = |instance: &Instance| if scene.two_level { instance.first_triangle } else { 0 };
    let mut firsts: Vec<u32> = scene.instances.iter().map(first).collect();
    firsts.sort_unstable();
    let range = |instance| {
        let first = first(instance);
        first..firsts.get(firsts.partition_point(|&other| other <= first)).copied().unwrap_or(all)
    };
    scene.instances.iter().map(range).collect()
}

/// Vertices and instance of each draw: three vertices a triangle.
fn draws(scene: &CompiledScene) -> Vec<(Range<u32>, u32)> {
    meshes(scene).into_iter().map(|mesh| 3 * mesh.start..3 * mesh.end).zip(0..).collect()
}

/// (triangle, instance) of what is blended, from far to near.
fn blended_triangles(scene: &CompiledScene, view: &View) -> Vec<[u32; 2]> {
    let is_blended = |triangle: &Triangle| {
        let material = scene.materials.get((triangle.material & !Triangle::ALPHA) as usize);
        triangle.material & Triangle::ALPHA != 0 && material.is_some_and(|material| material.alpha_cutoff == -1.0)
    };
    let blended: Vec<u32> =
        (0..).zip(&scene.triangles).filter(|(_, t)| is_blended(t)).map(|(index, _)| index).collect();
    if blended.is_empty() {
        return Vec::new();
    }
    let to_view = view.to_world.inverse();
    let mut found: Vec<(f32, [u32; 2])> = Vec::new();
    for (index, (instance, mesh)) in (0..).zip(scene.instances.iter().zip(meshes(scene))) {
        let rows = instance.to_world.map(glam::Vec4::from_array);
        let matrix = glam::Mat4::from_cols(rows[0], rows[1], rows[2], glam::Vec4::W).transpose();
        let to_view = to_view * Affine3A::from_mat4(matrix);
        let from = blended.partition_point(|&triangle| triangle < mesh.start);
        for &triangle in blended[from..].iter().take_while(|&&triangle| triangle < mesh.end) {
            let Triangle { v0, v1, v2, .. } = scene.triangles[triangle as usize];
            let centre = [v0, v1, v2].into_iter().map(Vec3::from_array).sum::<Vec3>() / 3.0;
            found.push((to_view.transform_point3(centre).z, [triangle, index]));
        }
    }
    // The camera looks along -z; what is as far keeps the order of the scene.
    found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    found.into_iter().map(|(_, entry)| entry).collect()
}
