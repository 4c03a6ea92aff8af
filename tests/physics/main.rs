//! Pictures against closed form, on the real shaders.

mod closed_form;
mod support;
