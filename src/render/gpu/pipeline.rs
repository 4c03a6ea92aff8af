//! Pipelines: the linked shader, specialised by what a picture needs.

use super::bindings;
use super::device::Gpu;
use crate::compile::Features;
use crate::params::Mode;
use crate::render::{RenderError, Strategy, Work};
use std::collections::HashMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, OnceLock};

/// The tracer's source, linked from `shaders/` at build time.
pub const PATHTRACE_WGSL: &str = include_str!(concat!(env!("OUT_DIR"), "/pathtrace.wgsl"));

/// Line of the source that each pipeline replaces by the stack it needs.
const STACK_LINE: &str = "const STACK_SIZE: u32 = 1u;";

/// Most entries of the stack in registers, as in `shaders/lib/stack.wesl`.
const REGISTERS: u32 = 12;

/// What a pipeline is specialised by.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(in crate::render) struct Variant {
    features: Features,
    direct: bool,
    phong: bool,
    multiple_scattering: bool,
    strategy: Strategy,
    /// Where the traversal keeps what it has still to visit.
    pub stack: Stack,
}

impl Variant {
    /// What the picture of some work needs on a device.
    pub fn of(gpu: &Gpu, work: &Work) -> Self {
        Self {
            features: work.features,
            direct: work.settings.mode == Mode::Direct,
            phong: work.settings.is_phong(),
            multiple_scattering: work.settings.multiple_scattering,
            strategy: work.settings.strategy,
            stack: stack(work.scene.depth, work.scene.two_level, gpu.info.hardware),
        }
    }
}

/// A traversal stack of so many entries.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(in crate::render) enum Stack {
    /// 4, 8 or 12.
    Registers(u32),
    /// Of an array.
    Memory(u32),
}

impl Stack {
    fn in_registers(self) -> u32 {
        if let Self::Registers(entries) = self { entries } else { 0 }
    }

    /// Size of the shader's array, which cannot be empty. Modules differ by it alone.
    pub fn in_memory(self) -> u32 {
        if let Self::Memory(entries) = self { entries } else { 1 }
    }
}

/// A pipeline that is made on a thread of its own, which takes seconds on some drivers: other renders go on meanwhile.
#[derive(Clone)]
pub struct Kernel(Arc<OnceLock<Result<wgpu::ComputePipeline, RenderError>>>);

impl Kernel {
    fn make(pipeline: impl FnOnce() -> wgpu::ComputePipeline + Send + 'static) -> Self {
        let kernel = Self(Arc::default());
        let Self(place) = kernel.clone();
        std::thread::spawn(move || {
            let failed = |_| RenderError::DeviceLost("its driver failed to compile the kernel".to_owned());
            let _ = place.set(catch_unwind(AssertUnwindSafe(pipeline)).map_err(failed));
        });
        kernel
    }

    /// None: it is still being made.
    pub fn get(&self) -> Option<Result<&wgpu::ComputePipeline, RenderError>> {
        self.0.get().map(|made| made.as_ref().map_err(RenderError::clone))
    }
}

/// Pipelines made so far, or in the making.
pub struct Pipelines {
    /// The bindings of `shaders/lib/bindings.wesl`.
    pub layout: wgpu::BindGroupLayout,
    pipeline_layout: wgpu::PipelineLayout,
    modules: HashMap<u32, wgpu::ShaderModule>,
    kernels: HashMap<Variant, Kernel>,
}

impl Pipelines {
    /// None yet.
    pub fn new(gpu: &Gpu) -> Self {
        let layout = gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("pathtrace"),
            entries: &bindings::layout_entries(),
        });
        let pipeline_layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("pathtrace"),
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        });
        Self { layout, pipeline_layout, modules: HashMap::new(), kernels: HashMap::new() }
    }

    /// The kernel for a picture.
    pub fn get(&mut self, gpu: &Arc<Gpu>, work: &Work) -> Kernel {
        let variant = Variant::of(gpu, work);
        let Self { pipeline_layout, modules, kernels, .. } = self;
        let kernel = kernels.entry(variant).or_insert_with(|| {
            let stack = variant.stack.in_memory();
            let module = modules.entry(stack).or_insert_with(|| compile_module(gpu, PATHTRACE_WGSL, stack)).clone();
            let (gpu, layout) = (Arc::clone(gpu), pipeline_layout.clone());
            Kernel::make(move || create_pipeline(&gpu, &layout, &module, "pathtrace", &constants(variant)))
        });
        kernel.clone()
    }
}

/// One group of siblings per level, and the instances left of a leaf; rounded up, so that few kernels are compiled. On a
/// software device a shallow tree's stack is in registers (docs/benchmarks.md).
fn stack(depth: u32, two_level: bool, hardware: bool) -> Stack {
    let needed = depth + u32::from(two_level) + 1;
    if !hardware && needed <= REGISTERS {
        Stack::Registers(needed.next_multiple_of(4))
    } else {
        Stack::Memory(needed.next_multiple_of(8))
    }
}

/// The pipeline of a test kernel, specialised as that of the work's picture.
pub fn probe(
    gpu: &Gpu,
    work: &Work,
    wgsl: &str,
    entry: &str,
    groups: [&wgpu::BindGroupLayout; 2],
) -> wgpu::ComputePipeline {
    let variant = Variant::of(gpu, work);
    let layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: Some("probe"),
        bind_group_layouts: &groups.map(Some),
        immediate_size: 0,
    });
    create_pipeline(
        gpu,
        &layout,
        &compile_module(gpu, wgsl, variant.stack.in_memory()),
        entry,
        &declared(wgsl, &constants(variant)),
    )
}

/// Those constants that a source declares, for its functions ask for them; to set others is an error.
pub(in crate::render) fn declared<'a>(wgsl: &str, constants: &[(&'a str, f64)]) -> Vec<(&'a str, f64)> {
    constants.iter().copied().filter(|(name, _)| wgsl.contains(&format!("override {name}:"))).collect()
}

fn create_pipeline(
    gpu: &Gpu,
    layout: &wgpu::PipelineLayout,
    module: &wgpu::ShaderModule,
    entry: &str,
    constants: &[(&str, f64)],
) -> wgpu::ComputePipeline {
    gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(entry),
        layout: Some(layout),
        module,
        entry_point: Some(entry),
        compilation_options: wgpu::PipelineCompilationOptions { constants, zero_initialize_workgroup_memory: false },
        cache: None,
    })
}

/// The module of a source, its stack in memory sized.
pub(in crate::render) fn compile_module(gpu: &Gpu, wgsl: &str, stack: u32) -> wgpu::ShaderModule {
    let source = wgsl.replace(STACK_LINE, &format!("const STACK_SIZE: u32 = {stack}u;"));
    gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some("pathtrace"),
        source: wgpu::ShaderSource::Wgsl(source.into()),
    })
}

/// Values of the override constants of `shaders/lib/features.wesl`.
pub(in crate::render) fn constants(variant: Variant) -> [(&'static str, f64); 42] {
    let f = variant.features;
    let flag = |value: bool| f64::from(u8::from(value));
    [
        ("TWO_LEVEL", flag(f.two_level)),
        ("ALPHA", flag(f.alpha)),
        ("ONE_SIDED", flag(f.one_sided)),
        ("NORMALS", flag(f.normals)),
        ("COLORS", flag(f.colors)),
        ("BASE_COLOR_TEXTURE", flag(f.base_color_texture)),
        ("METALLIC_ROUGHNESS_TEXTURE", flag(f.metallic_roughness_texture)),
        ("NORMAL_TEXTURE", flag(f.normal_texture)),
        ("EMISSIVE_TEXTURE", flag(f.emissive_texture)),
        ("UNLIT", flag(f.unlit)),
        ("SPECULAR", flag(f.specular)),
        ("MIRROR", flag(f.mirror)),
        ("EXTENDED", flag(f.extended)),
        ("TRANSMISSION", flag(f.transmission)),
        ("VOLUME", flag(f.volume)),
        ("SCATTER", flag(f.scatter)),
        ("THIN", flag(f.thin)),
        ("DIFFUSE_TRANSMISSION", flag(f.diffuse_transmission)),
        ("DISPERSION", flag(f.dispersion)),
        ("CLEARCOAT", flag(f.clearcoat)),
        ("SHEEN", flag(f.sheen)),
        ("ANISOTROPY", flag(f.anisotropy)),
        ("IRIDESCENCE", flag(f.iridescence)),
        ("SPHERES", flag(f.spheres)),
        ("DETAIL", flag(f.detail)),
        ("PUNCTUAL", flag(f.punctual)),
        ("PROFILES", flag(f.profiles)),
        ("EXTENDED_LIGHTS", flag(f.extended_lights)),
        ("EMITTERS", flag(f.emitters)),
        ("LIGHT_TREE", flag(f.light_tree)),
        ("THIN_LENS", flag(f.thin_lens)),
        ("ORTHOGRAPHIC", flag(f.orthographic)),
        ("MOTION", flag(f.motion)),
        ("ENVIRONMENT", f64::from(f.environment)),
        ("DIRECT", flag(variant.direct)),
        ("PHONG", flag(variant.phong)),
        ("MULTIPLE_SCATTERING", flag(variant.multiple_scattering)),
        ("SOBOL", flag(variant.strategy.sobol)),
        ("LIGHT_SAMPLES", flag(variant.strategy.light_samples)),
        ("SCATTERED_LIGHT", flag(variant.strategy.scattered_light)),
        ("ROULETTE", flag(variant.strategy.roulette)),
        ("STACK_REGISTERS", f64::from(variant.stack.in_registers())),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn every_override_is_set() {
        let module = naga::front::wgsl::parse_str(PATHTRACE_WGSL).expect("WGSL that parses");
        let declared: BTreeSet<&str> = module.overrides.iter().filter_map(|(_, o)| o.name.as_deref()).collect();
        let (features, strategy) = (Features::default(), Strategy::default());
        let stack = Stack::Registers(12);
        let variant = Variant { features, direct: false, phong: false, multiple_scattering: true, strategy, stack };
        let set: BTreeSet<&str> = constants(variant).iter().map(|(name, _)| *name).collect();
        assert_eq!(declared, set);
    }

    #[test]
    fn shader_validates_and_its_stack_can_be_sized() {
        assert!(PATHTRACE_WGSL.contains(STACK_LINE), "no line {STACK_LINE}");
        let module = naga::front::wgsl::parse_str(PATHTRACE_WGSL).expect("WGSL that parses");
        let mut validator =
            naga::valid::Validator::new(naga::valid::ValidationFlags::all(), naga::valid::Capabilities::default());
        validator.validate(&module).expect("valid WGSL");
    }
}
