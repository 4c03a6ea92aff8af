//! How much a scene may ask for.

/// Bounds on what [`import`](super::import()) and [`Package`](super::Package) accept. All are checked before the memory is spent.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Limits {
    /// Bytes of all files of a package together, after inflating.
    pub bytes: u64,
    /// Entries of a zip.
    pub zip_entries: usize,
    /// Inflated bytes per compressed byte of a zip entry (beyond the first MiB).
    pub zip_ratio: u64,
    /// Values in the JSON text, counted by its commas.
    pub json_values: usize,
    /// Nodes.
    pub nodes: usize,
    /// Nodes on the way from a root to a leaf.
    pub node_depth: usize,
    /// Triangles that are decoded, meshes counted once.
    pub triangles: usize,
    /// Vertices that are decoded.
    pub vertices: usize,
    /// Buffers.
    pub buffers: usize,
    /// Images.
    pub images: usize,
    /// Pixels of one image, from its header.
    pub image_pixels: u64,
    /// Pixels of all images that are read.
    pub total_image_pixels: u64,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            bytes: 1 << 30,
            zip_entries: 10_000,
            zip_ratio: 200,
            json_values: 20_000_000,
            nodes: 1_000_000,
            node_depth: 1000,
            triangles: 50_000_000,
            vertices: 100_000_000,
            buffers: 4096,
            images: 4096,
            image_pixels: 8192 * 8192,
            total_image_pixels: 8 * 8192 * 8192,
        }
    }
}
