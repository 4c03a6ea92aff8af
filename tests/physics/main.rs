//! Pictures against closed form or an independent f64 computation, on the real shaders.

mod closed_form;
mod invariance;
mod support;
