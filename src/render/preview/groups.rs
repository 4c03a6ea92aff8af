//! What the passes of one preview bind: buffers of its own, and groups of these and the scene's.

use super::draws::Listed;
use super::faces::MAX_FACES;
use super::frame::Groups;
use super::layout::{Preview, PreviewLight, Projection};
use super::layouts::{Layouts, PROJECTION_STRIDE};
use super::lights::PreviewLights;
use super::targets::Targets;
use crate::render::gpu::Gpu;
use crate::render::gpu::layout::Frame as SceneFrame;
use crate::render::gpu::render::uniform;
use crate::render::gpu::resources::{GpuEnvironment, GpuScene, upload_profiles};
use crate::render::{RenderError, Work};
use bytemuck::Zeroable;
use wgpu::BindingResource;

/// Buffers of one picture.
pub struct Uploads {
    scene_frame: wgpu::Buffer,
    /// What changes from frame to frame.
    pub preview_buffer: wgpu::Buffer,
    /// The camera's, then those of the shadow maps, [`PROJECTION_STRIDE`] bytes apart.
    pub projections: wgpu::Buffer,
    /// Those of the shadow maps, side by side.
    faces: wgpu::Buffer,
    lights: wgpu::Buffer,
    profiles: wgpu::TextureView,
    blended: Option<wgpu::Buffer>,
    spheres: Option<wgpu::Buffer>,
}

impl Uploads {
    /// Of some work under its lights, with what is drawn by itself.
    ///
    /// # Errors
    /// [`RenderError::TooLarge`] if the device cannot hold them.
    pub fn new(gpu: &Gpu, work: &Work, lights: &PreviewLights, listed: &Listed) -> Result<Self, RenderError> {
        let mut faces = [Projection::zeroed(); MAX_FACES];
        faces.iter_mut().zip(&lights.faces).for_each(|(slot, face)| *slot = *face);
        let mut projections = vec![0; PROJECTION_STRIDE as usize * (1 + lights.faces.len())];
        for (slot, face) in projections.chunks_exact_mut(PROJECTION_STRIDE as usize).skip(1).zip(&lights.faces) {
            slot[..size_of::<Projection>()].copy_from_slice(bytemuck::bytes_of(face));
        }
        let list = |name, entries: &[[u32; 2]]| {
            (!entries.is_empty()).then(|| gpu.storage(name, bytemuck::cast_slice(entries), 8)).transpose()
        };
        Ok(Self {
            scene_frame: uniform(gpu, "frame", bytemuck::bytes_of(&SceneFrame::new(work))),
            preview_buffer: uniform(gpu, "preview", bytemuck::bytes_of(&Preview::zeroed())),
            projections: uniform(gpu, "projections", &projections),
            faces: uniform(gpu, "faces", bytemuck::cast_slice(&faces)),
            lights: gpu.storage("lights", bytemuck::cast_slice(&lights.lights), size_of::<PreviewLight>())?,
            profiles: upload_profiles(gpu, &work.lighting.profiles)?,
            blended: list("blended triangles", &listed.blended)?,
            spheres: list("spheres", &listed.spheres)?,
        })
    }
}

/// Makes bind groups.
pub struct Binder<'a> {
    /// The device.
    pub gpu: &'a Gpu,
    /// What passes bind.
    pub layouts: &'a Layouts,
    /// The scene's uploads.
    pub scene: &'a GpuScene,
    /// The environment's.
    pub environment: &'a GpuEnvironment,
    /// Tables of lobes.
    pub albedo: &'a wgpu::TextureView,
    /// The environment prefiltered.
    pub reflected: &'a wgpu::TextureView,
}

impl Binder<'_> {
    /// The groups of all passes.
    pub fn groups(&self, uploads: &Uploads, targets: &Targets, maps: &wgpu::TextureView) -> Groups {
        let texture = BindingResource::TextureView;
        let projection = wgpu::BufferBinding {
            buffer: &uploads.projections,
            offset: 0,
            size: wgpu::BufferSize::new(size_of::<Projection>() as u64),
        };
        let (layouts, scene) = (self.layouts, self.scene);
        let list = |buffer: &Option<wgpu::Buffer>| {
            buffer.as_ref().map(|buffer| self.group(&layouts.listed, &[(0, buffer.as_entire_binding())]))
        };
        Groups {
            scene: self.group(
                &layouts.scene,
                &[
                    (0, uploads.scene_frame.as_entire_binding()),
                    (2, texture(&scene.nodes)),
                    (3, texture(&scene.triangles)),
                    (4, texture(&scene.records)),
                    (10, texture(&scene.color_pages)),
                    (11, texture(&scene.data_pages)),
                    (12, texture(&self.environment.texels)),
                    (14, texture(self.albedo)),
                    (17, texture(&uploads.profiles)),
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
                    (5, texture(self.reflected)),
                ],
            ),
            blended: list(&uploads.blended),
            spheres: list(&uploads.spheres),
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
