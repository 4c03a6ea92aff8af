//! What guides a denoiser besides a picture's light: of each pixel what is seen there, without how it is lit.

use serde::{Deserialize, Serialize};

/// Pictures of what is seen, row by row from the top, filtered as the picture is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Guides {
    /// Reflectance towards the viewer, 0 to 1 per channel; emission and the background count as far as 1. Through mirrors and smooth
    /// glass it is that of what is seen there.
    #[serde(with = "crate::pod")]
    pub albedo: Vec<[f32; 3]>,
    /// Shading normal in the world on the side that is seen, -1 to 1, of the same surfaces; zero where there is none.
    #[serde(with = "crate::pod")]
    pub normal: Vec<[f32; 3]>,
}

impl Guides {
    /// Memory that they take.
    pub fn bytes(&self) -> usize {
        size_of_val(self.albedo.as_slice()) + size_of_val(self.normal.as_slice())
    }
}
