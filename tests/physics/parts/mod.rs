//! Proof of the parts: every sampler, density, lobe and curve by itself, as the shaders have it and as the f64 engine
//! has it, against formulas written here anew.
//!
//! Each family is a function of an implementation (a trait with "draw" and "density"), so that a wrong one can be put
//! in its place: the tests named `faults_are_found` do so with faults written into the shader's source, and
//! `cargo test --test physics parts -- --ignored --nocapture --test-threads 1` prints how small a fault each finds.

mod bins;
mod bsdf;
mod bsdf_formulas;
mod camera;
mod color;
mod environment;
mod extended_lights;
mod kernel;
mod layers;
mod light_tree;
mod lights;
mod lobes;
mod phase;
mod quadrature;
mod random;
mod roulette;
mod sampler;
mod statistics;
mod verdict;
