//! What an operator can set: every limit with its default, as a flag, an environment variable and a line of `/v1/limits`.

use crate::params::ParamLimits;
use crate::scene;
use clap::Args;
use serde::Serialize;
use std::net::SocketAddr;

/// Writes the table of limits once: field, default and environment variable.
macro_rules! limits {
    ($($(#[doc = $doc:literal])+ $name:ident: $kind:ty = $default:expr, $env:literal;)+) => {
        /// Bounds on what one request, and all of them together, may cost. `GET /v1/limits` shows them.
        #[derive(Debug, Clone, Args, Serialize)]
        pub struct Limits {
            $($(#[doc = $doc])+ #[arg(long, env = $env, default_value_t = $default, help_heading = "Limits")] pub $name: $kind,)+
        }

        impl Default for Limits {
            fn default() -> Self {
                Self { $($name: $default,)+ }
            }
        }
    };
}

limits! {
    /// Bytes of one request body.
    upload_bytes: u64 = 256 << 20, "CANDELA_UPLOAD_BYTES";
    /// Bodies read at the same time; further ones wait.
    uploads: usize = 16, "CANDELA_UPLOADS";
    /// Seconds in which a request body must have arrived.
    body_seconds: u64 = 120, "CANDELA_BODY_SECONDS";
    /// Parts of one multipart form.
    form_parts: usize = 1024, "CANDELA_FORM_PARTS";
    /// Bytes that an archive may unpack to.
    decompressed_bytes: u64 = 1 << 30, "CANDELA_DECOMPRESSED_BYTES";
    /// Unpacked bytes per packed byte of an archive.
    decompression_ratio: u64 = 200, "CANDELA_DECOMPRESSION_RATIO";
    /// Bytes of host memory that uploads being imported may take together, at the most; further ones wait.
    import_memory_bytes: u64 = 4 << 30, "CANDELA_IMPORT_MEMORY_BYTES";
    /// Triangles of a scene, counted once per mesh.
    triangles: usize = 20_000_000, "CANDELA_TRIANGLES";
    /// Pixels of all images of a scene together.
    texture_pixels: u64 = 256 << 20, "CANDELA_TEXTURE_PIXELS";
    /// Pixels of one environment picture, of which no side may be above 16384.
    environment_pixels: u64 = crate::compile::ENVIRONMENT_PIXELS, "CANDELA_ENVIRONMENT_PIXELS";
    /// Nodes of a scene.
    nodes: usize = 200_000, "CANDELA_NODES";
    /// Longest chain of nodes from a root.
    node_depth: usize = 1024, "CANDELA_NODE_DEPTH";
    /// Width of a picture.
    picture_width: u32 = 16_384, "CANDELA_PICTURE_WIDTH";
    /// Height of a picture.
    picture_height: u32 = 16_384, "CANDELA_PICTURE_HEIGHT";
    /// Pixels of a picture.
    picture_pixels: u64 = 16 << 20, "CANDELA_PICTURE_PIXELS";
    /// Width x height x max_samples of a job.
    pixel_samples: u64 = 1_000_000_000_000, "CANDELA_PIXEL_SAMPLES";
    /// Seconds of tracing after which a render stops with what it has.
    render_seconds: u64 = 3600, "CANDELA_RENDER_SECONDS";
    /// Estimated bytes of host memory of one job.
    job_memory_bytes: u64 = 4 << 30, "CANDELA_JOB_MEMORY_BYTES";
    /// Estimated bytes of host memory of all renders under way together.
    render_memory_bytes: u64 = 8 << 30, "CANDELA_RENDER_MEMORY_BYTES";
    /// Jobs waiting to be rendered; further ones are refused at once.
    queue_length: usize = 64, "CANDELA_QUEUE_LENGTH";
    /// Renders that share the device; one more place is kept for short ones.
    active_renders: usize = 4, "CANDELA_ACTIVE_RENDERS";
    /// Bytes of the scenes kept, least recently used leave first.
    stored_scene_bytes: u64 = 2 << 30, "CANDELA_STORED_SCENE_BYTES";
    /// Bytes of the images kept, least recently used leave first.
    stored_image_bytes: u64 = 1 << 30, "CANDELA_STORED_IMAGE_BYTES";
    /// Finished jobs kept, oldest leave first.
    kept_jobs: usize = 1000, "CANDELA_KEPT_JOBS";
    /// Bytes of the results kept, oldest leave first.
    kept_result_bytes: u64 = 1 << 30, "CANDELA_KEPT_RESULT_BYTES";
    /// Longest `Prefer: wait`, in seconds.
    wait_seconds: u64 = 300, "CANDELA_WAIT_SECONDS";
}

impl Limits {
    /// Those of the scene room.
    pub fn scene(&self) -> scene::Limits {
        scene::Limits {
            bytes: self.decompressed_bytes,
            zip_ratio: self.decompression_ratio,
            nodes: self.nodes,
            node_depth: self.node_depth,
            triangles: self.triangles,
            total_image_pixels: self.texture_pixels,
            ..scene::Limits::default()
        }
    }

    /// Those of the params room.
    pub fn params(&self) -> ParamLimits {
        ParamLimits {
            width: self.picture_width,
            height: self.picture_height,
            pixels: self.picture_pixels,
            pixel_samples: self.pixel_samples,
            ..ParamLimits::default()
        }
    }
}

/// What `candela serve` needs to know.
#[derive(Debug, Clone, Args)]
pub struct ServeConfig {
    /// Address to listen on.
    #[arg(long, env = "CANDELA_LISTEN", default_value = "127.0.0.1:8080")]
    pub listen: SocketAddr,
    /// Seconds that jobs get to finish after SIGTERM or SIGINT.
    #[arg(long, env = "CANDELA_DRAIN_SECONDS", default_value_t = 30)]
    pub drain_seconds: u64,
    /// Bounds.
    #[command(flatten)]
    pub limits: Limits,
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Arguments {
        #[command(flatten)]
        serve: ServeConfig,
    }

    #[test]
    fn flags_override_defaults() {
        let parsed = Arguments::parse_from(["candela", "--queue-length", "3"]).serve;
        assert_eq!(parsed.limits.queue_length, 3);
        assert_eq!(parsed.limits.kept_jobs, Limits::default().kept_jobs);
        assert!(parsed.listen.ip().is_loopback());
    }
}
