//! Pictures against closed form or an independent f64 computation, on the real shaders.

#[macro_use]
mod support;

mod asset_generator;
mod closed_form;
mod direct;
mod extended_lights;
mod invariance;
mod light_groups;
mod many_lights;
mod materials;
mod motion;
mod parts;
mod preview;
mod profiles;
mod reliefs;
mod scatter;
mod spheres;
mod stability;
mod third_party;
