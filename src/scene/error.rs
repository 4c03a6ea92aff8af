//! What goes wrong while a scene is read, and what the user should know.

/// Something the user should know; never silent.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Warning {
    /// Stable identifier, like `extension_ignored`.
    pub code: &'static str,
    /// JSON pointer into the glTF.
    pub pointer: String,
    /// What is lost and why.
    pub detail: String,
}

/// Why a scene cannot be read.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{pointer}: {detail}")]
pub struct SceneError {
    /// Which status the fault deserves.
    pub kind: SceneErrorKind,
    /// Stable identifier, like `accessor_out_of_bounds`.
    pub code: &'static str,
    /// JSON pointer into the glTF (or empty: the file as a whole).
    pub pointer: String,
    /// What, why, how to fix.
    pub detail: String,
}

/// Class of a [`SceneError`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SceneErrorKind {
    /// Not a glTF at all, or cut off (400).
    Malformed,
    /// Well-formed, but invalid or needing what is not supported (422).
    Invalid,
    /// Beyond a limit (413).
    TooLarge,
}

impl SceneError {
    /// The bytes are no glTF, or are cut off.
    pub fn malformed(code: &'static str, detail: impl Into<String>) -> Self {
        Self { kind: SceneErrorKind::Malformed, code, pointer: String::new(), detail: detail.into() }
    }

    /// The glTF at `pointer` is invalid or needs what is not supported.
    pub fn invalid(code: &'static str, pointer: impl Into<String>, detail: impl Into<String>) -> Self {
        Self { kind: SceneErrorKind::Invalid, code, pointer: pointer.into(), detail: detail.into() }
    }

    /// The glTF at `pointer` is beyond a limit.
    pub fn too_large(code: &'static str, pointer: impl Into<String>, detail: impl Into<String>) -> Self {
        Self { kind: SceneErrorKind::TooLarge, code, pointer: pointer.into(), detail: detail.into() }
    }
}

/// Collects warnings; a fault that a file repeats a thousand times is reported a few times and then counted.
#[derive(Debug, Default)]
pub(super) struct Warnings {
    list: Vec<Warning>,
    counts: std::collections::BTreeMap<&'static str, usize>,
}

impl Warnings {
    /// Warnings of one code that are listed one by one.
    const LISTED: usize = 20;

    /// Adds a warning.
    pub(super) fn add(&mut self, code: &'static str, pointer: impl Into<String>, detail: impl Into<String>) {
        let count = self.counts.entry(code).or_default();
        *count += 1;
        if *count <= Self::LISTED {
            self.list.push(Warning { code, pointer: pointer.into(), detail: detail.into() });
        }
    }

    /// The warnings in the order in which they came; those not listed are counted at the end.
    pub(super) fn finish(mut self) -> Vec<Warning> {
        for (code, count) in self.counts {
            if let Some(more) = count.checked_sub(Self::LISTED).filter(|more| *more > 0) {
                let detail = format!("{more} more warnings `{code}` are not listed");
                self.list.push(Warning { code, pointer: String::new(), detail });
            }
        }
        self.list
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn repeated_warnings_are_counted() {
        let mut warnings = Warnings::default();
        for i in 0..25 {
            warnings.add("a", format!("/{i}"), "x");
        }
        warnings.add("b", "", "y");
        let list = warnings.finish();
        assert_eq!(list.len(), Warnings::LISTED + 2);
        assert!(list.last().unwrap().detail.starts_with("5 more"));
    }
}
