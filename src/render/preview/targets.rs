//! What the passes of a preview draw to, kept for the next one of the same size.

use crate::render::RenderError;
use crate::render::gpu::Gpu;
use crate::render::gpu::render::{buffer, create_texture};
use std::sync::Arc;
use wgpu::{BufferUsages, TextureFormat, TextureUsages, TextureView};

/// Depth, of pictures and of shadow maps: a float of `1 / z`, as precise afar as nearby.
pub const DEPTH: TextureFormat = TextureFormat::Depth32Float;
/// The G-buffer: what is met, and where in it.
pub const SURFACE: TextureFormat = TextureFormat::Rgba32Uint;
/// Radiance of the forward path.
pub const RADIANCE: TextureFormat = TextureFormat::Rgba32Float;
/// What is drawn on top; the least that every device blends.
pub const OVERLAY: TextureFormat = TextureFormat::Rgba16Float;

/// Side of a tile of the light culling in pixels, doubled until masks fit [`MASK_WORDS`].
const TILE_SIDE: u32 = 16;
/// Words of the masks of all tiles.
const MASK_WORDS: u64 = 1 << 22;
/// Pictures of more pixels are made anew each time: their memory is not held.
const KEPT_PIXELS: u64 = 1 << 21;

/// Size of a picture's targets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Extent {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Whether there is a G-buffer.
    pub deferred: bool,
    /// Whether something is drawn on top.
    pub overlay: bool,
    /// Lights with an end.
    pub bounded_lights: u32,
}

/// The grid of the light culling.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Grid {
    /// Side of a tile in pixels.
    pub side: u32,
    /// Tiles in a row.
    pub across: u32,
    /// Rows of tiles.
    pub down: u32,
    /// Words of a tile's mask that say which others are not 0.
    pub summary_words: u32,
    /// Words of a tile's mask, those included.
    pub mask_words: u32,
}

impl Grid {
    /// The grid of a picture under so many lights.
    pub fn new(extent: &Extent) -> Self {
        let groups = extent.bounded_lights.div_ceil(32);
        let summary_words = groups.div_ceil(32);
        let mask_words = summary_words + groups;
        let grid = |side: u32| Self {
            side,
            across: extent.width.div_ceil(side),
            down: extent.height.div_ceil(side),
            summary_words,
            mask_words,
        };
        let fits = |grid: &Self| u64::from(grid.tiles()) * u64::from(mask_words) <= MASK_WORDS;
        let sides = (0..16).map(|doubled| grid(TILE_SIDE << doubled));
        sides.clone().find(fits).unwrap_or_else(|| grid(TILE_SIDE << 15))
    }

    /// Number of tiles.
    pub fn tiles(&self) -> u32 {
        self.across * self.down
    }
}

/// Textures and buffers of one size.
pub struct Targets {
    extent: Extent,
    /// The grid of the light culling.
    pub grid: Grid,
    /// Depth of the picture.
    pub depth: TextureView,
    /// The G-buffer; without one of one texel.
    pub surface: TextureView,
    /// Radiance of the forward path; else of one texel.
    pub radiance: TextureView,
    /// What is drawn on top; without it of one texel.
    pub overlay: TextureView,
    /// Sums over frames.
    pub sums: wgpu::Buffer,
    /// The same on its way to the host.
    pub readback: wgpu::Buffer,
    /// Range of depths per tile.
    pub tile_depths: wgpu::Buffer,
    /// Lights per tile.
    pub masks: wgpu::Buffer,
}

/// The last targets.
#[derive(Default)]
pub struct TargetCache(Option<Arc<Targets>>);

impl TargetCache {
    /// Targets of a size that nobody uses.
    ///
    /// # Errors
    /// [`RenderError::TooLarge`] if the device has no textures or buffers so large.
    pub fn take(&mut self, gpu: &Gpu, extent: Extent) -> Result<Arc<Targets>, RenderError> {
        if let Some(kept) = &self.0
            && kept.extent == extent
            && Arc::strong_count(kept) == 1
        {
            return Ok(Arc::clone(kept));
        }
        let made = Arc::new(Targets::new(gpu, extent)?);
        let pixels = u64::from(extent.width) * u64::from(extent.height);
        self.0 = (pixels <= KEPT_PIXELS).then(|| Arc::clone(&made));
        Ok(made)
    }
}

impl Targets {
    fn new(gpu: &Gpu, extent: Extent) -> Result<Self, RenderError> {
        let limits = gpu.device.limits();
        let bytes = 16 * u64::from(extent.width) * u64::from(extent.height);
        let side = limits.max_texture_dimension_2d;
        let buffers = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
        if extent.width.max(extent.height) > side || bytes > buffers {
            return Err(RenderError::TooLarge(format!(
                "a preview of {} x {} pixels; {} takes {side} a side and {} in all",
                extent.width,
                extent.height,
                gpu.info.name,
                buffers / 16
            )));
        }
        let grid = Grid::new(&extent);
        let size = (extent.width, extent.height);
        let target = |label, present: bool, format| {
            let usage = TextureUsages::RENDER_ATTACHMENT | TextureUsages::TEXTURE_BINDING;
            let size = if present { size } else { (1, 1) };
            create_texture(gpu, label, size, format, usage).create_view(&wgpu::TextureViewDescriptor::default())
        };
        let masks = 4 * u64::from(grid.tiles()) * u64::from(grid.mask_words.max(1));
        Ok(Self {
            extent,
            grid,
            depth: target("depth", true, DEPTH),
            surface: target("surface", extent.deferred, SURFACE),
            radiance: target("radiance", !extent.deferred, RADIANCE),
            overlay: target("overlay", extent.overlay, OVERLAY),
            sums: buffer(gpu, "sums", bytes, BufferUsages::STORAGE | BufferUsages::COPY_SRC),
            readback: buffer(gpu, "readback", bytes, BufferUsages::MAP_READ | BufferUsages::COPY_DST),
            tile_depths: buffer(gpu, "tile depths", 8 * u64::from(grid.tiles()), BufferUsages::STORAGE),
            masks: buffer(gpu, "masks", masks, BufferUsages::STORAGE | BufferUsages::COPY_DST),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grids_cover_the_picture_and_fit() {
        for (width, height, lights) in [(1, 1, 0), (512, 512, 10_000), (4096, 4096, 10_000), (16384, 1024, 33)] {
            let extent = Extent { width, height, deferred: true, overlay: false, bounded_lights: lights };
            let grid = Grid::new(&extent);
            assert!(grid.across * grid.side >= width && grid.down * grid.side >= height);
            assert!(u64::from(grid.tiles()) * u64::from(grid.mask_words) <= MASK_WORDS);
            assert!(32 * (grid.mask_words - grid.summary_words) >= lights);
        }
    }
}
