//! The passes of one frame, light in bands of rows. What a picture does not need has no pass.

use super::layouts::PROJECTION_STRIDE;
use super::targets::Targets;
use std::ops::Range;
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
    pub draws: Vec<(Range<u32>, u32)>,
    /// Vertices of the blended triangles.
    pub blended_vertices: u32,
    /// Vertices of the spheres' rectangles.
    pub sphere_vertices: u32,
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

/// Pipelines of a pass over the scene.
pub struct ScenePipelines {
    /// Of triangles.
    pub mesh: Arc<RenderPipeline>,
    /// Of spheres, if there are any.
    pub spheres: Option<Arc<RenderPipeline>>,
}

/// Pipelines of the passes that the picture needs.
#[allow(missing_docs, reason = "named as the passes")]
pub struct FramePipelines {
    pub shadow: Option<ScenePipelines>,
    pub depth: Option<ScenePipelines>,
    pub surfaces: ScenePipelines,
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
    pub spheres: Option<BindGroup>,
    pub tiles: BindGroup,
    pub finish: BindGroup,
}

impl Frame {
    /// Depth as each shadow map's light sees it. Lights do not move between frames: once is enough.
    pub fn draw_shadow_maps(&self, encoder: &mut CommandEncoder) {
        let Some(pipeline) = &self.pipelines.shadow else { return };
        for (view, slot) in self.shadow_maps.iter().zip(1..) {
            let mut pass = begin(encoder, &[], view, LoadOp::Clear(0.0));
            self.draw_scene(&mut pass, pipeline, slot);
        }
    }

    /// What all rows need: the G-buffer, or of the forward path the depths that lights are listed by; and these lists.
    pub fn draw_geometry(&self, encoder: &mut CommandEncoder) {
        let targets = &*self.targets;
        if self.pipelines.deferred {
            let mut pass = begin(encoder, &[(&targets.surface, CLEAR)], &targets.depth, LoadOp::Clear(0.0));
            self.draw_scene(&mut pass, &self.pipelines.surfaces, 0);
        } else if let Some(pipeline) = &self.pipelines.depth {
            let mut pass = begin(encoder, &[], &targets.depth, LoadOp::Clear(0.0));
            self.draw_scene(&mut pass, pipeline, 0);
        }
        self.cull(encoder);
    }

    /// Light on some rows, from the surfaces to the sums.
    pub fn light_rows(&self, encoder: &mut CommandEncoder, rows: &Range<u32>) {
        let is_first = rows.start == 0;
        if !self.pipelines.deferred {
            let targets = &*self.targets;
            let clear_depth = is_first && self.pipelines.depth.is_none();
            let depth = if clear_depth { LoadOp::Clear(0.0) } else { LoadOp::Load };
            let mut pass = begin(encoder, &[(&targets.radiance, color_load(is_first))], &targets.depth, depth);
            pass.set_scissor_rect(0, rows.start, self.size.0, rows.len() as u32);
            pass.set_bind_group(2, &self.groups.light, &[]);
            self.draw_scene(&mut pass, &self.pipelines.surfaces, 0);
        }
        self.draw_overlay(encoder, rows);
        self.finish(encoder, rows);
    }

    fn draw_scene(&self, pass: &mut RenderPass<'_>, pipelines: &ScenePipelines, slot: u32) {
        pass.set_pipeline(&pipelines.mesh);
        pass.set_bind_group(0, &self.groups.scene, &[]);
        pass.set_bind_group(1, &self.groups.projection, &[slot * PROJECTION_STRIDE as u32]);
        for (vertices, instance) in &self.draws {
            pass.draw(vertices.clone(), *instance..*instance + 1);
        }
        if let (Some(pipeline), Some(spheres)) = (&pipelines.spheres, &self.groups.spheres) {
            pass.set_pipeline(pipeline);
            pass.set_bind_group(3, spheres, &[]);
            pass.draw(0..self.sphere_vertices, 0..1);
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
    fn draw_overlay(&self, encoder: &mut CommandEncoder, rows: &Range<u32>) {
        if self.pipelines.gizmos.is_none() && self.pipelines.blended.is_none() {
            return;
        }
        let overlay = (&self.targets.overlay, color_load(rows.start == 0));
        let mut pass = begin(encoder, &[overlay], &self.targets.depth, LoadOp::Load);
        pass.set_scissor_rect(0, rows.start, self.size.0, rows.len() as u32);
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

    fn finish(&self, encoder: &mut CommandEncoder, rows: &Range<u32>) {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&self.pipelines.finish);
        pass.set_bind_group(0, &self.groups.scene, &[]);
        pass.set_bind_group(2, &self.groups.light, &[]);
        pass.set_bind_group(3, &self.groups.finish, &[]);
        pass.dispatch_workgroups(self.size.0.div_ceil(GROUP), (rows.len() as u32).div_ceil(GROUP), 1);
    }
}

const CLEAR: LoadOp<wgpu::Color> = LoadOp::Clear(wgpu::Color::TRANSPARENT);

fn color_load(is_first: bool) -> LoadOp<wgpu::Color> {
    if is_first { CLEAR } else { LoadOp::Load }
}

fn begin<'a>(
    encoder: &'a mut CommandEncoder,
    colors: &[(&TextureView, LoadOp<wgpu::Color>)],
    depth: &TextureView,
    load: LoadOp<f32>,
) -> RenderPass<'a> {
    let color = |&(view, load): &(_, _)| {
        let ops = wgpu::Operations { load, store: wgpu::StoreOp::Store };
        Some(wgpu::RenderPassColorAttachment { view, depth_slice: None, resolve_target: None, ops })
    };
    let colors: Vec<_> = colors.iter().map(color).collect();
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
