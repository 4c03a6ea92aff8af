//! What is said to the process that denoises, and what it says: [`Hello`] once, then an answer to the one task that it gets.

use serde::{Deserialize, Serialize};

/// Version of the library, or why it cannot be used.
pub type Hello = Result<String, String>;

/// The picture, row by row, or why there is none.
pub type Answer = Result<Done, String>;

/// A picture to be denoised.
#[derive(Debug, Serialize, Deserialize)]
pub struct Task {
    /// Bytes of memory that it may take.
    pub memory: u64,
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Light, linear.
    #[serde(with = "crate::pod")]
    pub color: Vec<[f32; 3]>,
    /// Albedo and normal, of as many pixels.
    pub guides: Option<crate::film::Guides>,
    /// What is done about their noise.
    pub guidance: Guidance,
}

/// What a denoiser makes of the guides.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Guidance {
    /// Nothing: it has the light alone.
    None,
    /// They are read as they are, with their noise.
    Noisy,
    /// They are denoised first.
    #[default]
    Prefiltered,
}

/// A denoised picture.
#[derive(Debug, Serialize, Deserialize)]
pub struct Done {
    /// As many pixels as the task had.
    #[serde(with = "crate::pod")]
    pub pixels: Vec<[f32; 3]>,
}
