//! `candela bench`.

use super::{Failure, apart};
use crate::bench::{self, clock::Clock};
use crate::denoise::Bounds;
use crate::params::{self, EngineChoice};
use crate::render::gpu::GpuEngine;
use crate::render::{DeviceInfo, Engines};
use anyhow::{Result, anyhow};
use clap::{Args, Subcommand};
use std::io::Write;
use std::path::PathBuf;

/// Arguments of `candela bench`.
#[derive(Debug, Args)]
pub struct BenchArgs {
    #[command(subcommand)]
    what: What,
}

/// Each prints tables of Markdown on standard output.
#[derive(Debug, Subcommand)]
enum What {
    /// Paths per second on meshes of growing size, beside a native tracer.
    Trace {
        /// Names of demo scenes.
        #[arg(long, value_delimiter = ',', default_values = ["bumpy-10k", "bumpy-160k", "bumpy-1m"])]
        scenes: Vec<String>,
        #[command(flatten)]
        rounds: Rounds,
    },
    /// The two engines against each other, pixel by pixel.
    Agreement {
        /// glTF files, and folders to be searched for them.
        #[arg(required = true)]
        scenes: Vec<PathBuf>,
        /// Parameters of all pictures, as JSON; size and samples are set by the options below.
        #[arg(long, default_value = "{}")]
        params: String,
        /// Pixels a side.
        #[arg(long, default_value_t = 24)]
        side: u32,
        /// Samples per pixel of a batch.
        #[arg(long, default_value_t = 64)]
        samples: u32,
        /// Batches of each engine, each with a seed of its own.
        #[arg(long, default_value_t = 16, value_parser = clap::value_parser!(u32).range(3..))]
        batches: u32,
    },
    /// Adaptive sampling against uniform: time to the same error.
    Adaptive {
        /// Seeds of each scene.
        #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..))]
        rounds: u32,
        /// Samples per pixel to go to.
        #[arg(long, default_value_t = 256, value_parser = clap::value_parser!(u32).range(32..))]
        samples: u32,
        /// Which engine: auto, gpu or cpu.
        #[arg(long, default_value = "auto", value_parser = engine)]
        engine: EngineChoice,
        /// Folder with `cases` that other renderers were given.
        #[arg(long, value_name = "FOLDER")]
        peers: Option<PathBuf>,
        /// Only scenes whose names have one of these words.
        #[arg(long, value_delimiter = ',', value_name = "WORD")]
        scenes: Vec<String>,
    },
    /// Whether stated errors are true: many renders against references of many samples.
    Coverage {
        /// Seeds of each scene at each sample count.
        #[arg(long, default_value_t = 25, value_parser = clap::value_parser!(u32).range(1..))]
        renders: u32,
        /// Samples per pixel of a reference.
        #[arg(long, default_value_t = 65536)]
        reference: u32,
        /// Which engine: auto, gpu or cpu.
        #[arg(long, default_value = "auto", value_parser = engine)]
        engine: EngineChoice,
        /// Folder with `cases` that other renderers were given.
        #[arg(long, value_name = "FOLDER")]
        peers: Option<PathBuf>,
    },
    /// What denoising does to the error, by number of samples.
    Denoise {
        /// glTF files to measure beside the demos.
        models: Vec<PathBuf>,
        /// Library of Open Image Denoise, or its folder.
        #[arg(long, env = "CANDELA_OIDN", value_name = "FILE|FOLDER")]
        oidn: Option<PathBuf>,
        /// Samples per pixel.
        #[arg(long, value_delimiter = ',', default_values = ["4", "16", "64", "256"])]
        samples: Vec<u32>,
        /// Samples per pixel of a reference.
        #[arg(long, default_value_t = 8192, value_parser = clap::value_parser!(u32).range(2..))]
        reference: u32,
        /// Pixels a side.
        #[arg(long, default_value_t = 192, value_parser = clap::value_parser!(u32).range(8..))]
        side: u32,
        /// Which engine: auto, gpu or cpu.
        #[arg(long, default_value = "auto", value_parser = engine)]
        engine: EngineChoice,
        /// Folder for denoise.jpg.
        #[arg(long, default_value = ".", value_name = "FOLDER")]
        folder: PathBuf,
    },
    /// Run time against error, by engine and by ways of looking for light.
    Error {
        /// Samples per pixel to go to.
        #[arg(long, default_value_t = 512, value_parser = clap::value_parser!(u32).range(32..))]
        samples: u32,
        /// Samples per pixel of a reference.
        #[arg(long, default_value_t = 4096)]
        reference: u32,
        /// Folder with `cases` that other renderers were given.
        #[arg(long, value_name = "FOLDER")]
        peers: Option<PathBuf>,
        /// Pixels a side.
        #[arg(long, default_value_t = 64, value_parser = clap::value_parser!(u32).range(8..))]
        side: u32,
        /// Only scenes whose names have one of these words.
        #[arg(long, value_delimiter = ',', value_name = "WORD")]
        scenes: Vec<String>,
        /// Only these ways, like `cpu` or `cpu, uniform`; may be repeated.
        #[arg(long = "way", value_name = "NAME")]
        ways: Vec<String>,
        /// Folder for error.csv and error.svg.
        #[arg(long, default_value = ".", value_name = "FOLDER")]
        folder: PathBuf,
    },
    /// Many emitting triangles: time to the same error with and without the tree of emitters.
    ManyLights {
        /// Numbers of triangles.
        #[arg(long, value_delimiter = ',', default_values = ["10", "100", "1000", "10000", "100000", "1000000"])]
        counts: Vec<usize>,
        /// Which engine: auto, gpu or cpu.
        #[arg(long, default_value = "auto", value_parser = engine)]
        engine: EngineChoice,
        /// Pixels a side.
        #[arg(long, default_value_t = 64, value_parser = clap::value_parser!(u32).range(8..))]
        side: u32,
        /// Samples per pixel.
        #[arg(long, default_value_t = 64, value_parser = clap::value_parser!(u32).range(4..))]
        samples: u32,
        #[command(flatten)]
        rounds: Rounds,
    },
    /// The preview engine: forward against deferred shading, 1 to 10,000 lights.
    Lights {
        /// Pixels a side.
        #[arg(long, default_value_t = 128, value_parser = clap::value_parser!(u32).range(8..))]
        side: u32,
        #[command(flatten)]
        rounds: Rounds,
        /// Folder for lights.svg and lights.jpg.
        #[arg(long, default_value = ".", value_name = "FOLDER")]
        folder: PathBuf,
    },
    /// The preview engine: shadow algorithms, time against error.
    Shadows {
        /// glTF files to measure beside the still life.
        models: Vec<PathBuf>,
        /// Pixels a side.
        #[arg(long, default_value_t = 256, value_parser = clap::value_parser!(u32).range(8..))]
        side: u32,
        #[command(flatten)]
        rounds: Rounds,
        /// Folder for shadows.csv, shadows.svg and shadows.jpg.
        #[arg(long, default_value = ".", value_name = "FOLDER")]
        folder: PathBuf,
    },
    /// The preview engine against the path tracer with one bounce, scene by scene.
    Likeness {
        /// glTF files to compare beside the demos.
        models: Vec<PathBuf>,
        /// Pixels a side.
        #[arg(long, default_value_t = 128, value_parser = clap::value_parser!(u32).range(8..))]
        side: u32,
        /// Folder for likeness.jpg.
        #[arg(long, default_value = ".", value_name = "FOLDER")]
        folder: PathBuf,
    },
    /// Height, normal and parallax maps: time by load, error against real relief.
    Detail {
        /// Pixels a side.
        #[arg(long, default_value_t = 192, value_parser = clap::value_parser!(u32).range(8..))]
        side: u32,
        #[command(flatten)]
        rounds: Rounds,
        /// Folder for detail-load.svg, detail.svg and detail.jpg.
        #[arg(long, default_value = ".", value_name = "FOLDER")]
        folder: PathBuf,
    },
    /// The preview engine over HTTP: from POST to PNG, by stage.
    Preview {
        /// glTF files to measure beside the demos.
        models: Vec<PathBuf>,
        #[command(flatten)]
        rounds: Rounds,
    },
    /// What it saves to leave out what a picture does not need, and that the picture stays the same.
    Skip {
        /// Only rows of what is left out whose names have one of these words.
        #[arg(long, value_delimiter = ',', value_name = "WORD")]
        rows: Vec<String>,
        #[command(flatten)]
        rounds: Rounds,
    },
    /// The service over HTTP: cold and warm, more clients than places, a small job beside a long one.
    Http(Rounds),
    /// Memory on the way from a file to the device. Linux only.
    Memory {
        /// Name of a demo scene.
        #[arg(long, default_value = "bumpy-1m")]
        scene: String,
    },
}

#[derive(Debug, Clone, Copy, Args)]
struct Rounds {
    /// Interleaved rounds, of which the best counts.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(2..))]
    rounds: u32,
}

/// The engine of that name.
fn engine(name: &str) -> Result<EngineChoice> {
    Ok(serde_json::from_value(serde_json::Value::from(name))?)
}

/// Runs one.
pub fn run(arguments: &BenchArgs) -> Result<(), Failure> {
    measure(&arguments.what).map_err(|error| Failure::Machine(format!("{error:#}")))
}

/// The line above a table whose times are of the clock that suits the device.
fn measured_on(device: &DeviceInfo, rounds: &Rounds, out: &mut dyn Write) -> Result<Clock> {
    let clock = Clock::of(device);
    let machine = bench::machine(device);
    writeln!(out, "On {machine}; best of {} interleaved rounds; {}.\n", rounds.rounds, clock.words())?;
    Ok(clock)
}

fn measure(what: &What) -> Result<()> {
    let mut out = std::io::stdout().lock();
    match what {
        What::Trace { scenes, rounds } => {
            let scenes: Vec<&str> = scenes.iter().map(String::as_str).collect();
            let mut engine = GpuEngine::new()?;
            writeln!(out, "On {}; best of {} interleaved rounds.\n", bench::machine(engine.device()), rounds.rounds)?;
            bench::trace::run(&mut engine, &scenes, rounds.rounds, &mut out)?;
        }
        What::Agreement { scenes, params, side, samples, batches } => {
            let params = params::from_json(params).map_err(|faults| anyhow!("{}", faults[0]))?;
            let size = bench::agreement::Size { side: *side, samples: *samples, batches: *batches };
            bench::agreement::run(scenes, &params, size, &mut out)?;
        }
        What::Adaptive { rounds, samples, engine, peers, scenes } => {
            bench::adaptive::run(*engine, *rounds, *samples, peers.as_deref(), scenes, &mut out)?;
        }
        What::Coverage { renders, reference, engine, peers } => {
            bench::coverage::run(*engine, *renders, *reference, peers.as_deref(), &mut out)?;
        }
        What::Error { samples, reference, peers, side, scenes, ways, folder } => {
            let size = bench::error::Size { side: *side, samples: *samples, reference: *reference };
            let choice = bench::error::Choice { peers: peers.as_deref(), scenes, ways };
            bench::error::run(size, choice, folder, &mut out)?;
        }
        What::Denoise { models, oidn, samples, reference, side, engine, folder } => {
            let denoiser = apart::denoiser(oidn.as_deref(), Bounds::default()).map_err(|why| anyhow!(why))?;
            let size = bench::denoise::Size { side: *side, samples, reference: *reference, engine: *engine };
            bench::denoise::run(&denoiser, models, size, folder, &mut out)?;
        }
        What::ManyLights { counts, engine, side, samples, rounds } => {
            let size = bench::many_lights::Size { side: *side, samples: *samples, rounds: rounds.rounds };
            bench::many_lights::run(*engine, counts, size, &mut out)?;
        }
        What::Lights { side, rounds, folder } => {
            let mut engine = GpuEngine::new()?;
            measured_on(engine.device(), rounds, &mut out)?;
            bench::preview::lights::run(&mut engine, *side, rounds.rounds, folder, &mut out)?;
        }
        What::Shadows { models, side, rounds, folder } => {
            let mut engine = GpuEngine::new()?;
            measured_on(engine.device(), rounds, &mut out)?;
            bench::preview::shadows::run(&mut engine, models, *side, rounds.rounds, folder, &mut out)?;
        }
        What::Likeness { models, side, folder } => {
            writeln!(out, "On {}.\n", bench::machine(GpuEngine::new()?.device()))?;
            bench::preview::likeness::run(&mut Engines::new(), models, *side, folder, &mut out)?;
        }
        What::Detail { side, rounds, folder } => {
            let mut engines = Engines::new();
            let clock = measured_on(GpuEngine::new()?.device(), rounds, &mut out)?;
            let effort = bench::detail::Effort { side: *side, rounds: rounds.rounds, clock };
            bench::detail::run(&mut engines, effort, folder, &mut out)?;
        }
        What::Preview { models, rounds } => {
            writeln!(out, "On {}; medians of {}.\n", bench::machine(GpuEngine::new()?.device()), rounds.rounds)?;
            bench::preview::post::run(models, rounds.rounds, &mut out)?;
        }
        What::Skip { rows, rounds } => bench::skip::run(&mut GpuEngine::new()?, rows, rounds.rounds, &mut out)?,
        What::Http(rounds) => bench::http::run(rounds.rounds, &mut out)?,
        What::Memory { scene } => bench::memory::run(&mut GpuEngine::new()?, scene, &mut out)?,
    }
    Ok(out.flush()?)
}
