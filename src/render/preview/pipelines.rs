//! Pipelines of a preview: the linked shaders, specialised by what a picture needs.

use super::targets::{DEPTH, OVERLAY, RADIANCE, SURFACE};
use crate::params::{AttenuationKind, Shading, ShadowAlgorithm, SpotEdge};
use crate::render::gpu::Gpu;
use crate::render::gpu::pipeline::{Variant, compile_module, constants, declared};
use crate::render::preview::layouts::Layouts;
use crate::render::{Work, preview::lights::PreviewLights};
use std::collections::HashMap;
use std::sync::Arc;

/// Drawing passes.
const DRAW_WGSL: &str = include_str!(concat!(env!("OUT_DIR"), "/preview_draw.wgsl"));
/// Culling of lights.
const TILES_WGSL: &str = include_str!(concat!(env!("OUT_DIR"), "/preview_tiles.wgsl"));
/// Passes over pixels.
pub const FINISH_WGSL: &str = include_str!(concat!(env!("OUT_DIR"), "/preview_finish.wgsl"));

/// What the passes of one picture are specialised by.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Style {
    scene: Variant,
    /// Something may be cut away.
    alpha: bool,
    light: Option<LightStyle>,
}

/// What passes that add light up are specialised by.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct LightStyle {
    shading: Shading,
    attenuation: AttenuationKind,
    spot_edge: SpotEdge,
    culled: bool,
    shadows: ShadowAlgorithm,
}

impl Style {
    /// What some work needs on a device.
    pub fn new(gpu: &Gpu, work: &Work, lights: &PreviewLights) -> Self {
        let params = &work.settings.preview;
        let shadows = if lights.faces.is_empty() { ShadowAlgorithm::None } else { params.shadows.algorithm };
        Self {
            scene: Variant::of(gpu, work),
            alpha: work.features.alpha,
            light: Some(LightStyle {
                shading: params.shading,
                attenuation: params.attenuation.kind,
                spot_edge: params.spot_edge,
                culled: params.culling,
                shadows,
            }),
        }
    }

    fn constants(&self, camera: bool, blended: bool) -> Vec<(&'static str, f64)> {
        let flag = |value: bool| f64::from(u8::from(value));
        let mut all = constants(self.scene).to_vec();
        all.extend([("CAMERA", flag(camera)), ("BLENDED", flag(blended))]);
        if let Some(light) = self.light {
            all.extend([
                ("SHADING", f64::from(light.shading as u8)),
                ("ATTENUATION", f64::from(light.attenuation as u8)),
                ("SPOT_LINEAR_COSINE", flag(light.spot_edge == SpotEdge::LinearCosine)),
                ("CULLED", flag(light.culled)),
                ("SHADOWS", f64::from(light.shadows as u8)),
            ]);
        }
        all
    }
}

/// A drawing pass.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Draw {
    /// Depth of what a light sees.
    Shadow,
    /// Depth of what the camera sees.
    Depth,
    /// The G-buffer.
    Geometry,
    /// Radiance; `over_depth`: the depth is there already.
    Forward {
        /// After [`Draw::Depth`].
        over_depth: bool,
    },
    /// Blended triangles.
    Blended,
    /// Lights themselves.
    Gizmos,
}

/// What a drawing pass draws.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Shape {
    /// Triangles.
    Mesh,
    /// Spheres.
    Spheres,
}

/// A pass of compute.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Compute {
    /// Range of depths of each tile.
    Measure,
    /// Lights of each tile.
    Cull,
    /// Light on the G-buffer.
    Light,
    /// Radiance as it was drawn.
    Gather,
}

/// Pipelines made so far.
pub struct Pipelines {
    modules: HashMap<(&'static str, u32), wgpu::ShaderModule>,
    draws: HashMap<(Draw, Shape, Style), Arc<wgpu::RenderPipeline>>,
    computes: HashMap<(Compute, Style), Arc<wgpu::ComputePipeline>>,
}

impl Pipelines {
    /// None yet.
    pub fn new() -> Self {
        Self { modules: HashMap::new(), draws: HashMap::new(), computes: HashMap::new() }
    }

    /// The pipeline of a drawing pass.
    pub fn draw(
        &mut self,
        gpu: &Gpu,
        layouts: &Layouts,
        pass: Draw,
        shape: Shape,
        style: Style,
    ) -> Arc<wgpu::RenderPipeline> {
        let lit = matches!(pass, Draw::Forward { .. } | Draw::Blended);
        let style = if lit { style } else { Style { light: None, ..style } };
        if let Some(made) = self.draws.get(&(pass, shape, style)) {
            return Arc::clone(made);
        }
        let module = self.module(gpu, DRAW_WGSL, style.scene.stack.in_memory());
        let made = Arc::new(create_draw(gpu, layouts, &module, pass, shape, style));
        self.draws.insert((pass, shape, style), Arc::clone(&made));
        made
    }

    /// The pipeline of a pass of compute.
    pub fn compute(&mut self, gpu: &Gpu, layouts: &Layouts, pass: Compute, style: Style) -> Arc<wgpu::ComputePipeline> {
        let style = if pass == Compute::Light { style } else { Style { light: None, ..style } };
        if let Some(made) = self.computes.get(&(pass, style)) {
            return Arc::clone(made);
        }
        let (wgsl, entry, layout) = match pass {
            Compute::Measure => (TILES_WGSL, "measure_tiles", &layouts.tiles_pipeline),
            Compute::Cull => (TILES_WGSL, "cull_lights", &layouts.tiles_pipeline),
            Compute::Light => (FINISH_WGSL, "light_pixels", &layouts.finish_pipeline),
            Compute::Gather => (FINISH_WGSL, "gather_pixels", &layouts.finish_pipeline),
        };
        let module = self.module(gpu, wgsl, style.scene.stack.in_memory());
        let constants = declared(wgsl, &style.constants(true, false));
        let made = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(entry),
            layout: Some(layout),
            module: &module,
            entry_point: Some(entry),
            compilation_options: options(&constants),
            cache: None,
        });
        let made = Arc::new(made);
        self.computes.insert((pass, style), Arc::clone(&made));
        made
    }

    fn module(&mut self, gpu: &Gpu, wgsl: &'static str, stack: u32) -> wgpu::ShaderModule {
        self.modules.entry((wgsl, stack)).or_insert_with(|| compile_module(gpu, wgsl, stack)).clone()
    }
}

fn options<'a>(constants: &'a [(&'a str, f64)]) -> wgpu::PipelineCompilationOptions<'a> {
    wgpu::PipelineCompilationOptions { constants, zero_initialize_workgroup_memory: false }
}

fn create_draw(
    gpu: &Gpu,
    layouts: &Layouts,
    module: &wgpu::ShaderModule,
    pass: Draw,
    shape: Shape,
    style: Style,
) -> wgpu::RenderPipeline {
    use wgpu::CompareFunction::{Greater, GreaterEqual};
    let opaque = |format| Some(wgpu::ColorTargetState { format, blend: None, write_mask: wgpu::ColorWrites::ALL });
    let over = Some(wgpu::ColorTargetState {
        format: OVERLAY,
        blend: Some(wgpu::BlendState::PREMULTIPLIED_ALPHA_BLENDING),
        write_mask: wgpu::ColorWrites::ALL,
    });
    let cut = style.alpha.then_some("cut");
    let (mut vertex, mut fragment, targets, mut layout, writes_depth, compare) = match pass {
        Draw::Shadow | Draw::Depth => ("mesh", cut, vec![], &layouts.depth_pipeline, true, Greater),
        Draw::Geometry => ("mesh", Some("geometry"), vec![opaque(SURFACE)], &layouts.depth_pipeline, true, Greater),
        Draw::Forward { over_depth } => {
            let compare = if over_depth { GreaterEqual } else { Greater };
            ("mesh", Some("forward"), vec![opaque(RADIANCE)], &layouts.light_pipeline, true, compare)
        }
        Draw::Blended => ("blended_mesh", Some("blended"), vec![over], &layouts.listed_light_pipeline, false, Greater),
        Draw::Gizmos => ("gizmo_mesh", Some("gizmo"), vec![opaque(OVERLAY)], &layouts.light_pipeline, true, Greater),
    };
    if shape == Shape::Spheres {
        (vertex, fragment, layout) = match pass {
            Draw::Geometry => ("sphere_mesh", Some("sphere_geometry"), &layouts.listed_depth_pipeline),
            Draw::Forward { .. } => ("sphere_mesh", Some("sphere_forward"), &layouts.listed_light_pipeline),
            _ => ("sphere_mesh", Some("sphere_depth"), &layouts.listed_depth_pipeline),
        };
    }
    let constants = declared(DRAW_WGSL, &style.constants(pass != Draw::Shadow, pass == Draw::Blended));
    gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some(fragment.unwrap_or("depth")),
        layout: Some(layout),
        vertex: wgpu::VertexState {
            module,
            entry_point: Some(vertex),
            compilation_options: options(&constants),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: Some(wgpu::DepthStencilState {
            format: DEPTH,
            depth_write_enabled: Some(writes_depth),
            depth_compare: Some(compare),
            stencil: wgpu::StencilState::default(),
            bias: wgpu::DepthBiasState::default(),
        }),
        multisample: wgpu::MultisampleState::default(),
        fragment: fragment.map(|entry| wgpu::FragmentState {
            module,
            entry_point: Some(entry),
            compilation_options: options(&constants),
            targets: &targets,
        }),
        multiview_mask: None,
        cache: None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shaders_validate() {
        for wgsl in [DRAW_WGSL, TILES_WGSL, FINISH_WGSL] {
            let module = naga::front::wgsl::parse_str(wgsl).expect("WGSL that parses");
            let flags = naga::valid::ValidationFlags::all();
            naga::valid::Validator::new(flags, naga::valid::Capabilities::default())
                .validate(&module)
                .expect("valid WGSL");
        }
    }
}
