//! The passes of one frame. What a picture does not need has no pass.

use super::layouts::PROJECTION_STRIDE;
use super::targets::Targets;
use std::sync::Arc;
use wgpu::{BindGroup, CommandEncoder, ComputePipeline, LoadOp, RenderPass, RenderPipeline, TextureView};

/// Side of a workgroup of passes over pixels.
const GROUP: u32 = 8;
/// Lanes of a workgroup of the light culling.
const LANES: u32 = 64;
/// Vertices of the larger gizmo, the sphere.
const GIZMO_VERTICES: u32 = 6 * 6 * 8;

/// Everything that a frame binds.
pub struct Frame {
    /// Where it is drawn to.
    pub targets: Arc<Targets>,
    /// Pixels across and down.
    pub size: (u32, u32),
    /// Vertices and instance of each draw of the scene.
    pub draws: Vec<(std::ops::Range<u32>, u32)>,
    /// Vertices of the blended triangles.
    pub blended_vertices: u32,
    /// All lights.
    pub lights: u32,
    /// Lights that tiles are listed for.
    pub culled_lights: u32,
    /// Shadow maps, a view for each.
    pub shadow_maps: Vec<TextureView>,
    /// Pipelines.
    pub pipelines: FramePipelines,
    /// Bind groups.
    pub groups: Groups,
}

/// Pipelines of the passes that the picture needs.
#[allow(missing_docs, reason = "named as the passes")]
pub struct FramePipelines {
    pub shadow: Option<Arc<RenderPipeline>>,
    pub depth: Option<Arc<RenderPipeline>>,
    pub surfaces: Arc<RenderPipeline>,
    pub measure: Option<Arc<ComputePipeline>>,
    pub cull: Option<Arc<ComputePipeline>>,
    pub gizmos: Option<Arc<RenderPipeline>>,
    pub blended: Option<Arc<RenderPipeline>>,
    pub finish: Arc<ComputePipeline>,
    /// Surfaces go to the G-buffer.
    pub deferred: bool,
}

/// Bind groups of all passes.
#[allow(missing_docs, reason = "named as the layouts")]
pub struct Groups {
    pub scene: BindGroup,
    pub projection: BindGroup,
    pub light: BindGroup,
    pub blended: Option<BindGroup>,
    pub tiles: BindGroup,
    pub finish: BindGroup,
}

impl Frame {
    /// Depth as each shadow map's light sees it. Lights do not move between frames: once is enough.
    pub fn draw_shadow_maps(&self, encoder: &mut CommandEncoder) {
        let Some(pipeline) = &self.pipelines.shadow else { return };
        for (view, slot) in self.shadow_maps.iter().zip(1..) {
            let mut pass = begin(encoder, &[], view, LoadOp::Clear(0.0));
            pass.set_pipeline(pipeline);
            self.draw_scene(&mut pass, slot);
        }
    }

    /// All passes from the scene to the sums.
    pub fn draw(&self, encoder: &mut CommandEncoder) {
        let targets = &*self.targets;
        if self.pipelines.deferred {
            self.draw_surfaces(encoder, &[&targets.surface, &targets.radiance], LoadOp::Clear(0.0));
            self.cull(encoder);
        } else if let Some(pipeline) = &self.pipelines.depth {
            {
                let mut pass = begin(encoder, &[], &targets.depth, LoadOp::Clear(0.0));
                pass.set_pipeline(pipeline);
                self.draw_scene(&mut pass, 0);
            }
            self.cull(encoder);
            self.draw_surfaces(encoder, &[&targets.radiance], LoadOp::Load);
        } else {
            self.draw_surfaces(encoder, &[&targets.radiance], LoadOp::Clear(0.0));
        }
        self.draw_overlay(encoder);
        self.finish(encoder);
    }

    fn draw_surfaces(&self, encoder: &mut CommandEncoder, colors: &[&TextureView], depth: LoadOp<f32>) {
        let mut pass = begin(encoder, colors, &self.targets.depth, depth);
        pass.set_pipeline(&self.pipelines.surfaces);
        if !self.pipelines.deferred {
            pass.set_bind_group(2, &self.groups.light, &[]);
        }
        self.draw_scene(&mut pass, 0);
    }

    fn draw_scene(&self, pass: &mut RenderPass<'_>, slot: u32) {
        pass.set_bind_group(0, &self.groups.scene, &[]);
        pass.set_bind_group(1, &self.groups.projection, &[slot * PROJECTION_STRIDE as u32]);
        for (vertices, instance) in &self.draws {
            pass.draw(vertices.clone(), *instance..*instance + 1);
        }
    }

    fn cull(&self, encoder: &mut CommandEncoder) {
        let (Some(measure), Some(cull)) = (&self.pipelines.measure, &self.pipelines.cull) else { return };
        encoder.clear_buffer(&self.targets.masks, 0, None);
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_bind_group(0, &self.groups.scene, &[]);
        pass.set_bind_group(1, &self.groups.tiles, &[]);
        pass.set_pipeline(measure);
        pass.dispatch_workgroups(self.targets.grid.tiles().div_ceil(LANES), 1, 1);
        pass.set_pipeline(cull);
        pass.dispatch_workgroups(self.culled_lights.div_ceil(LANES), 1, 1);
    }

    /// Gizmos, then blended triangles from far to near, behind what is nearer.
    fn draw_overlay(&self, encoder: &mut CommandEncoder) {
        if self.pipelines.gizmos.is_none() && self.pipelines.blended.is_none() {
            return;
        }
        let mut pass = begin(encoder, &[&self.targets.overlay], &self.targets.depth, LoadOp::Load);
        pass.set_bind_group(0, &self.groups.scene, &[]);
        pass.set_bind_group(1, &self.groups.projection, &[0]);
        pass.set_bind_group(2, &self.groups.light, &[]);
        if let Some(pipeline) = &self.pipelines.gizmos {
            pass.set_pipeline(pipeline);
            pass.draw(0..GIZMO_VERTICES, 0..self.lights);
        }
        if let (Some(pipeline), Some(triangles)) = (&self.pipelines.blended, &self.groups.blended) {
            pass.set_pipeline(pipeline);
            pass.set_bind_group(3, triangles, &[]);
            pass.draw(0..self.blended_vertices, 0..1);
        }
    }

    fn finish(&self, encoder: &mut CommandEncoder) {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&self.pipelines.finish);
        pass.set_bind_group(0, &self.groups.scene, &[]);
        pass.set_bind_group(2, &self.groups.light, &[]);
        pass.set_bind_group(3, &self.groups.finish, &[]);
        pass.dispatch_workgroups(self.size.0.div_ceil(GROUP), self.size.1.div_ceil(GROUP), 1);
    }
}

/// A pass over cleared colours.
fn begin<'a>(
    encoder: &'a mut CommandEncoder,
    colors: &[&TextureView],
    depth: &TextureView,
    load: LoadOp<f32>,
) -> RenderPass<'a> {
    let color = |view| {
        let ops = wgpu::Operations { load: LoadOp::Clear(wgpu::Color::TRANSPARENT), store: wgpu::StoreOp::Store };
        Some(wgpu::RenderPassColorAttachment { view, depth_slice: None, resolve_target: None, ops })
    };
    let colors: Vec<_> = colors.iter().map(|view| color(*view)).collect();
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: None,
        color_attachments: &colors,
        depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
            view: depth,
            depth_ops: Some(wgpu::Operations { load, store: wgpu::StoreOp::Store }),
            stencil_ops: None,
        }),
        timestamp_writes: None,
        occlusion_query_set: None,
        multiview_mask: None,
    })
}
