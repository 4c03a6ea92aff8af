//! How much a scene may ask for.

/// Bounds on what [`import`](super::import()) and [`Package`](super::Package) accept. All are checked before the memory is spent.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Limits {
    /// Bytes of all files of a package together, after inflating.
    pub bytes: u64,
    /// Bytes that what is unpacked and decoded may take in memory for each byte of the files (beyond the first 64 MiB):
    /// vertices, packed buffers, animations. One buffer may be decoded many times, an accessor without a buffer view takes none of
    /// the file at all, and Draco packs meshes to a thirtieth. `bytes` bounds them too.
    pub decoded_ratio: u64,
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
            decoded_ratio: 64,
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

/// Decoded bytes that are free of the ratio's limit.
const DECODED_FREE: u64 = 64 << 20;

/// Most that deflate can do: inflated bytes per packed byte.
const DEFLATE_RATIO: u64 = 1032;

impl Limits {
    /// Bytes that the vertices of a scene may take whose files have so many.
    pub(super) fn decoded(&self, file_bytes: u64) -> u64 {
        file_bytes.saturating_mul(self.decoded_ratio).saturating_add(DECODED_FREE).min(self.bytes)
    }

    /// Most memory that reading an upload can take: its files, unpacked, and the vertices in them.
    pub fn import_memory(&self, upload_bytes: u64, is_zip: bool) -> u64 {
        let unpacked = if is_zip { upload_bytes.saturating_mul(DEFLATE_RATIO).min(self.bytes) } else { upload_bytes };
        unpacked.saturating_add(self.decoded(unpacked))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_follows_the_upload_and_ends_at_the_limit() {
        let limits = Limits::default();
        assert_eq!(limits.import_memory(700, false), 700 + 700 * 64 + DECODED_FREE);
        assert_eq!(limits.import_memory(1 << 30, false), 2 << 30);
        assert_eq!(limits.import_memory(100 << 20, true), 2 << 30);
    }
}
