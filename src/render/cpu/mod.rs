//! The second engine: path tracing on the processor, with f64 shading, independent of the shaders.

pub mod bvh;
