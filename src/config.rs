//! What an operator can set: every limit with its default, as a flag, an environment variable and a line of `/v1/limits`.

use crate::denoise::Bounds;
use crate::params::ParamLimits;
use crate::params::nearest;
use crate::scene;
use clap::{ArgAction, Args, ValueEnum, value_parser};
use serde::Serialize;
use serde_json::Value;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;

/// Longest time that can be set, in seconds: about thirty years, which clocks can count.
const LONGEST: u64 = 1_000_000_000;

/// Variables that the program and its tests read besides the settings of `serve`.
const NO_SETTINGS: [&str; 11] = [
    "CANDELA_KEY",
    "CANDELA_FUZZ",
    "CANDELA_FUZZ_SEED",
    "CANDELA_SCENES",
    "CANDELA_KILLS",
    "CANDELA_KILL_SEED",
    "CANDELA_OVERLOAD_SECONDS",
    "CANDELA_STREAMS",
    "CANDELA_CANCELS",
    "CANDELA_LONG",
    "CANDELA_PEERS",
];

/// Writes the table of limits once: field, default, environment variable and, of times, the range.
macro_rules! limits {
    ($($(#[doc = $doc:literal])+ $name:ident: $kind:ty = $default:expr, $env:literal $(in $range:expr)?;)+) => {
        /// Bounds on what one request, and all of them together, may cost. `GET /v1/limits` shows them.
        #[derive(Debug, Clone, Args, Serialize)]
        pub struct Limits {
            $(
                $(#[doc = $doc])+
                #[arg(long, env = $env, default_value_t = $default, action = ArgAction::Set, help_heading = "Limits")]
                $(#[arg(value_parser = value_parser!($kind).range($range))])?
                pub $name: $kind,
            )+
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
    /// Bytes of all bodies being read; further bytes wait, for `idle_seconds` at the most.
    upload_memory_bytes: u64 = 1 << 30, "CANDELA_UPLOAD_MEMORY_BYTES";
    /// Connections open at the same time; further ones wait to be accepted.
    connections: usize = 1024, "CANDELA_CONNECTIONS";
    /// Seconds in which the head of a request must have arrived; a connection without a request is closed after them, too.
    header_seconds: u64 = 20, "CANDELA_HEADER_SECONDS" in 1..=LONGEST;
    /// Seconds of silence after which a request body is given up.
    idle_seconds: u64 = 15, "CANDELA_IDLE_SECONDS" in 1..=LONGEST;
    /// Seconds in which a request body must have arrived.
    body_seconds: u64 = 120, "CANDELA_BODY_SECONDS" in 1..=LONGEST;
    /// Bytes of a body that is JSON, and of the field `params` of a form.
    json_bytes: usize = 2 << 20, "CANDELA_JSON_BYTES";
    /// Parts of one multipart form.
    form_parts: usize = 1024, "CANDELA_FORM_PARTS";
    /// Bytes that an archive may unpack to.
    decompressed_bytes: u64 = 1 << 30, "CANDELA_DECOMPRESSED_BYTES";
    /// Unpacked bytes per packed byte of an archive.
    decompression_ratio: u64 = 200, "CANDELA_DECOMPRESSION_RATIO";
    /// Bytes of host memory that uploads being imported may take together, at the most; further ones wait.
    import_memory_bytes: u64 = 4 << 30, "CANDELA_IMPORT_MEMORY_BYTES";
    /// Seconds in which a scene must have been read.
    import_seconds: u64 = 60, "CANDELA_IMPORT_SECONDS" in 1..=LONGEST;
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
    render_seconds: u64 = 3600, "CANDELA_RENDER_SECONDS" in ..=LONGEST;
    /// Seconds after which a device that does not answer is given up; renders then go on with a new one.
    device_seconds: u64 = 120, "CANDELA_DEVICE_SECONDS" in 1..=LONGEST;
    /// Estimated bytes of host memory of one job.
    job_memory_bytes: u64 = 4 << 30, "CANDELA_JOB_MEMORY_BYTES";
    /// Estimated bytes of host memory of all renders under way together.
    render_memory_bytes: u64 = 8 << 30, "CANDELA_RENDER_MEMORY_BYTES";
    /// Jobs waiting to be rendered; further ones are refused at once.
    queue_length: usize = 64, "CANDELA_QUEUE_LENGTH";
    /// Renders of one batch.
    batch_items: usize = 1000, "CANDELA_BATCH_ITEMS";
    /// Bytes of the manifest of one batch.
    manifest_bytes: usize = 4 << 20, "CANDELA_MANIFEST_BYTES";
    /// Renders of batches that wait, besides `queue_length`; further batches are refused at once.
    batch_queue_length: usize = 10_000, "CANDELA_BATCH_QUEUE_LENGTH";
    /// Renders that share the device; one more place is kept for short ones.
    active_renders: usize = 4, "CANDELA_ACTIVE_RENDERS";
    /// Seconds that denoising may take for each million pixels begun; the picture is then given undenoised, with a warning.
    denoise_seconds: u64 = 120, "CANDELA_DENOISE_SECONDS" in 1..=LONGEST;
    /// Bytes of memory that denoising one picture may take, beside the server's own.
    denoise_memory_bytes: u64 = 4 << 30, "CANDELA_DENOISE_MEMORY_BYTES";
    /// Milliseconds between two savings of an unfinished film, where there is a data folder.
    save_film_ms: u64 = 30_000, "CANDELA_SAVE_FILM_MS" in ..=1000 * LONGEST;
    /// Bytes of a film above which it is not saved: after a restart its job begins anew.
    save_film_bytes: u64 = 256 << 20, "CANDELA_SAVE_FILM_BYTES";
    /// Bytes of the scenes kept in memory, least recently used leave first.
    stored_scene_bytes: u64 = 2 << 30, "CANDELA_STORED_SCENE_BYTES";
    /// Bytes of the images kept in memory, least recently used leave first.
    stored_image_bytes: u64 = 1 << 30, "CANDELA_STORED_IMAGE_BYTES";
    /// Finished jobs kept, oldest leave first.
    kept_jobs: usize = 1000, "CANDELA_KEPT_JOBS";
    /// Bytes of the results kept: the oldest linear pictures leave first (a job's own file stays), then the oldest jobs.
    kept_result_bytes: u64 = 1 << 30, "CANDELA_KEPT_RESULT_BYTES";
    /// Hours that finished jobs are kept, and uploads that nobody uses.
    kept_hours: u64 = 168, "CANDELA_KEPT_HOURS";
    /// Bytes of the uploads kept in the data folder, least recently used leave first (in memory: at most `stored_scene_bytes`).
    kept_upload_bytes: u64 = 16 << 30, "CANDELA_KEPT_UPLOAD_BYTES";
    /// Whether a job that asks for what another has rendered gets its result.
    result_cache: bool = true, "CANDELA_RESULT_CACHE";
    /// Longest `Prefer: wait`, in seconds.
    wait_seconds: u64 = 300, "CANDELA_WAIT_SECONDS" in ..=LONGEST;
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

    /// Those of one picture that is denoised.
    pub fn denoise(&self) -> Bounds {
        Bounds { patience: Duration::from_secs(self.denoise_seconds.max(1)), memory: self.denoise_memory_bytes }
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
#[derive(Debug, Clone, Args, Serialize)]
pub struct ServeConfig {
    /// Address to listen on.
    #[arg(long, env = "CANDELA_LISTEN", default_value = "127.0.0.1:8080")]
    pub listen: SocketAddr,
    /// Folder for uploads, jobs and results, which then outlive the process; without one they are kept in memory.
    #[arg(long, env = "CANDELA_DATA", value_name = "FOLDER")]
    pub data: Option<PathBuf>,
    /// Seconds that jobs get to finish after SIGTERM or SIGINT.
    #[arg(long, env = "CANDELA_DRAIN_SECONDS", default_value_t = 30, value_parser = value_parser!(u64).range(..=LONGEST))]
    pub drain_seconds: u64,
    /// File of API keys (`candela key`), which every request must then have; without one everybody may do everything.
    #[arg(long, env = "CANDELA_KEYS", value_name = "FILE")]
    pub keys: Option<PathBuf>,
    /// Names besides addresses and localhost by which clients may call the server (`Host`); without any, a server that listens on
    /// this machine alone has no other name, and one that listens on the network any.
    #[arg(long, env = "CANDELA_ALLOWED_HOSTS", value_name = "NAME,...", value_delimiter = ',')]
    pub allowed_hosts: Vec<String>,
    /// File of the secret (`whsec_...`) with which webhooks are signed; without one none are sent.
    #[arg(long, env = "CANDELA_WEBHOOK_SECRET", value_name = "FILE")]
    pub webhook_secret: Option<PathBuf>,
    /// Hosts and addresses that webhooks may go to although they are not public.
    #[arg(long, env = "CANDELA_WEBHOOK_HOSTS", value_name = "HOST,...", value_delimiter = ',')]
    pub webhook_hosts: Vec<String>,
    /// Whether scenes are read first, and rendered, by processes of their own, which can crash, hang or be killed without the server.
    #[arg(long, env = "CANDELA_APART", default_value_t = true, action = ArgAction::Set)]
    pub apart: bool,
    /// Library of Open Image Denoise, or its folder, for `denoise: true`; without one it is looked for where the system keeps libraries.
    #[arg(long, env = "CANDELA_OIDN", value_name = "FILE|FOLDER")]
    pub oidn: Option<PathBuf>,
    /// How the log is written to standard error.
    #[arg(long, env = "CANDELA_LOG_FORMAT", value_enum, default_value_t = LogFormat::Text)]
    pub log_format: LogFormat,
    /// Collector of OpenTelemetry that is told the traces of requests and jobs, by OTLP over HTTP: http://127.0.0.1:4318.
    #[arg(long, env = "CANDELA_OTLP_ENDPOINT", value_name = "URL")]
    pub otlp_endpoint: Option<String>,
    /// Prints the configuration as a file of environment variables (for systemd, Docker, a shell) and ends.
    #[arg(long)]
    #[serde(skip)]
    pub print_config: bool,
    /// Bounds.
    #[command(flatten)]
    #[serde(flatten)]
    pub limits: Limits,
}

/// How the log is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum LogFormat {
    /// A line for people per event.
    Text,
    /// A JSON object per event.
    Json,
}

impl ServeConfig {
    /// Every setting as a line `VARIABLE=value`, with what it means above it; what is not set is commented out.
    pub fn as_environment(&self) -> String {
        let values = serde_json::to_value(self).unwrap_or_default();
        let command = Self::augment_args(clap::Command::new("serve"));
        let settings = command.get_arguments().filter_map(|argument| {
            let variable = argument.get_env()?.to_str()?;
            let help = argument.get_help().map(ToString::to_string).unwrap_or_default();
            let line = match &values[argument.get_id().as_str()] {
                Value::Null => format!("#{variable}="),
                Value::Array(list) if list.is_empty() => format!("#{variable}="),
                Value::Array(list) => {
                    let words: Vec<&str> = list.iter().filter_map(Value::as_str).collect();
                    format!("{variable}={}", quoted(&words.join(",")))
                }
                Value::String(text) => format!("{variable}={}", quoted(text)),
                other => format!("{variable}={other}"),
            };
            Some(format!("# {help} (--{})\n{line}\n", argument.get_long()?))
        });
        settings.collect()
    }

    /// Variables among these that look like settings and are none, each with the setting that it was likely meant to be.
    pub fn misspelt(names: impl IntoIterator<Item = String>) -> Vec<(String, Option<String>)> {
        const PREFIX: &str = "CANDELA_";
        let command = Self::augment_args(clap::Command::new("serve"));
        let settings: Vec<&str> =
            command.get_arguments().filter_map(|argument| argument.get_env()?.to_str()?.strip_prefix(PREFIX)).collect();
        let is_known = |name: &str| {
            settings.iter().any(|known| name.strip_prefix(PREFIX) == Some(*known))
                || NO_SETTINGS.contains(&name)
                || name.starts_with("CANDELA_TEST_")
        };
        let unknown = names.into_iter().filter(|name| name.starts_with(PREFIX) && !is_known(name));
        let guess = |name: &str| {
            let near = nearest(name.strip_prefix(PREFIX)?, settings.iter().copied())?;
            Some(format!("{PREFIX}{near}"))
        };
        unknown.map(|name| (guess(&name), name)).map(|(near, name)| (name, near)).collect()
    }
}

/// A value as shells and systemd read it: between quotes if it has more than plain characters.
fn quoted(value: &str) -> String {
    let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || b"-_./:,@%+=".contains(&byte);
    if value.bytes().all(is_plain) {
        return value.to_owned();
    }
    let escaped = |c: char| matches!(c, '"' | '\\' | '$' | '`').then_some('\\').into_iter().chain([c]);
    format!("\"{}\"", value.chars().flat_map(escaped).collect::<String>())
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::{CommandFactory, Parser};

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

    #[test]
    fn the_configuration_is_printed_as_it_is_read() {
        let arguments = ["candela", "--queue-length", "3", "--result-cache", "false", "--data", "/srv/candela"];
        let text = Arguments::parse_from(arguments).serve.as_environment();
        let lines: Vec<&str> = text.lines().filter(|line| !line.starts_with("# ")).collect();
        for line in ["CANDELA_QUEUE_LENGTH=3", "CANDELA_RESULT_CACHE=false", "CANDELA_DATA=/srv/candela"] {
            assert!(lines.contains(&line), "{line}: {text}");
        }
        assert!(
            lines.contains(&"CANDELA_LISTEN=127.0.0.1:8080") && lines.contains(&"CANDELA_LOG_FORMAT=text"),
            "{text}"
        );
        assert!(!text.contains("=null") && text.contains("(--queue-length)"), "{text}");
        let none = Arguments::parse_from(["candela"]).serve.as_environment();
        assert!(none.contains("#CANDELA_DATA=\n"), "{none}");
        let odd = Arguments::parse_from(["candela", "--data", r#"a b#c$d"e`f\g'h"#]).serve.as_environment();
        assert!(odd.contains(r#"CANDELA_DATA="a b#c\$d\"e\`f\\g'h""#), "{odd}");
    }

    #[test]
    fn times_are_bounded() {
        let command = Arguments::command();
        let times = command.get_arguments().filter_map(clap::Arg::get_long);
        let times: Vec<&str> = times.filter(|name| name.ends_with("-seconds") || name.ends_with("-ms")).collect();
        assert!(times.len() >= 9, "{times:?}");
        for time in times {
            let parse = |value: &str| Arguments::try_parse_from(["candela", &format!("--{time}"), value]);
            for most in ["18446744073709551615", "1000000000001"] {
                assert!(parse(most).is_err(), "{time} {most}");
            }
            assert!(parse("1000000000").is_ok(), "{time}");
        }
        assert!(Arguments::try_parse_from(["candela", "--body-seconds", "0"]).is_err(), "no body could be read");
    }

    #[test]
    fn misspelt_settings_are_told_of() {
        let names =
            ["CANDELA_QUEUE_LENGHT", "CANDELA_QUEUE_LENGTH", "CANDELA_KEY", "CANDELA_TEST_X", "CANDELA_XYZ", "PATH"];
        let found = ServeConfig::misspelt(names.map(str::to_owned));
        let near = Some("CANDELA_QUEUE_LENGTH".to_owned());
        assert_eq!(found, [("CANDELA_QUEUE_LENGHT".to_owned(), near), ("CANDELA_XYZ".to_owned(), None)]);
    }
}
