//! How much memory the numbers of a file may take.

use crate::scene::{Limits, SceneError};

/// Bytes that may be decoded yet.
pub(super) struct Budget {
    left: u64,
    ratio: u64,
}

impl Budget {
    /// For a package of so many bytes.
    pub(super) fn new(limits: &Limits, file_bytes: u64) -> Self {
        Self { left: limits.decoded(file_bytes), ratio: limits.decoded_ratio }
    }

    /// Bytes that may be decoded yet.
    pub(super) fn left(&self) -> u64 {
        self.left
    }

    /// Takes `bytes` for the `count` elements at `pointer`, before they are allocated.
    pub(super) fn charge(&mut self, bytes: u64, count: usize, pointer: &str) -> Result<(), SceneError> {
        self.left = self.left.checked_sub(bytes).ok_or_else(|| {
            let detail = format!(
                "with the {count} elements here, what the file holds takes far more memory than the file has bytes: is an \
                 accessor's `count` right, or is its `bufferView` missing? (limit decompressed_bytes, and {} per byte of the file)",
                self.ratio
            );
            SceneError::too_large("decoded_bytes", pointer, detail)
        })?;
        Ok(())
    }
}
