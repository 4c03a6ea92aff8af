//! Pictures against closed form or an independent f64 computation, on the real shaders.

mod closed_form;
mod direct;
mod invariance;
mod support;
mod third_party;
