//! Kernels of `shaders/proof/parts.wesl` on the device, as they are or with a fault written into them.

use crate::support::{params, scene, work};
use candela::render::Work;
use candela::render::gpu::{GpuEngine, Probe};
use std::sync::{Mutex, OnceLock, PoisonError};

/// The linked kernels.
const SOURCE: &str = include_str!(concat!(env!("OUT_DIR"), "/parts.wgsl"));

/// A fault in the shader: a piece of its source that occurs once, and what stands there instead, by size.
#[derive(Clone, Copy)]
pub struct Fault {
    /// Right.
    pub right: &'static str,
    /// Wrong, by the fault's relative size.
    pub wrong: fn(f64) -> String,
}

impl Fault {
    fn write(&self, size: f64) -> String {
        assert_eq!(SOURCE.matches(self.right).count(), 1, "{:?} must occur once in the shader", self.right);
        SOURCE.replace(self.right, &(self.wrong)(size))
    }
}

/// A kernel that can be run.
pub struct Kernel(Probe);

impl Kernel {
    /// The kernel `entry` with what `work` uploads.
    pub fn new(work: &Work, entry: &str, fault: Option<(Fault, f64)>) -> Self {
        let source = fault.map_or_else(|| SOURCE.to_owned(), |(fault, size)| fault.write(size));
        static ENGINE: OnceLock<Mutex<GpuEngine>> = OnceLock::new();
        let open = || Mutex::new(GpuEngine::new().expect("an adapter; script/test installs lavapipe"));
        let mut engine = ENGINE.get_or_init(open).lock().unwrap_or_else(PoisonError::into_inner);
        Self(engine.probe(work, &source, entry).expect("a kernel"))
    }

    /// Its results for lists of arguments.
    pub fn run(&self, layers: &[&[[u32; 4]]]) -> Vec<[f64; 4]> {
        let results = self.0.run(layers).expect("a dispatch");
        results.into_iter().map(|result| result.map(f64::from)).collect()
    }
}

/// Work without anything to see: enough for kernels that read nothing but tables.
pub fn nothing() -> Work {
    work(&scene(vec![]), &params("{}"))
}

/// Arguments of a kernel; f64 are rounded to f32.
pub fn words(values: [f64; 4]) -> [u32; 4] {
    values.map(|value| (value as f32).to_bits())
}
