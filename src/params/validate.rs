//! Ranges and combinations of parameters.

/// One fault of one field.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error, serde::Serialize)]
#[error("{pointer}: {detail}")]
pub struct FieldError {
    /// JSON pointer, like `/params/width`.
    pub pointer: String,
    /// What, why, how to fix.
    pub detail: String,
}
