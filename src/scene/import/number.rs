//! Checked numbers: finite, in range.

use crate::scene::SceneError;
use crate::scene::error::Warnings;

/// A number that f32 can hold.
pub(super) fn finite(value: f64, place: &str) -> Result<f32, SceneError> {
    let single = value as f32;
    if single.is_finite() { Ok(single) } else { Err(not_finite(place, value)) }
}

/// A number that must not be negative.
pub(super) fn non_negative(value: f64, place: &str) -> Result<f32, SceneError> {
    let single = finite(value, place)?;
    if single >= 0.0 {
        return Ok(single.abs());
    }
    Err(SceneError::invalid("out_of_range", place, format!("{value} must not be negative")))
}

/// A factor between 0 and 1; more is clamped with a warning.
pub(super) fn factor(value: f64, place: &str, warnings: &mut Warnings) -> Result<f32, SceneError> {
    let single = non_negative(value, place)?;
    if single > 1.0 {
        warnings.add("factor_clamped", place, format!("{value} is greater than 1 and is taken as 1"));
    }
    Ok(single.min(1.0))
}

/// A number that is infinite, not a number or beyond the range of f32.
pub(super) fn not_finite(place: &str, value: impl std::fmt::Display) -> SceneError {
    SceneError::invalid(
        "not_finite",
        place,
        format!("{value} is not a finite number of single precision; export the file again"),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges() {
        let mut warnings = Warnings::default();
        assert_eq!(finite(1e39, "/x").unwrap_err().code, "not_finite");
        assert_eq!(non_negative(-1e-3, "/x").unwrap_err().code, "out_of_range");
        assert_eq!(non_negative(-0.0, "/x").unwrap().to_bits(), 0);
        assert_eq!(factor(1.5, "/x", &mut warnings).unwrap(), 1.0);
        assert_eq!(warnings.finish().len(), 1);
    }
}
