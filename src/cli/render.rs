//! `candela render`.

use super::progress::Bar;
use super::request::{Request, Target, request};
use super::summary::Summary;
use super::{Failure, apart, demo, manifest};
use crate::compile::{self, Hdri, LightFiles, MapFiles};
use crate::denoise::{Bounds, Denoiser};
use crate::film::{self, Aov, Aovs};
use crate::jobs::StoredScene;
use crate::params::RenderParams;
use crate::render::denoised::{Denoising, denoised};
use crate::render::prepare::{Prepared, prepare, render_to_end};
use crate::render::report::{Report, Stages};
use crate::render::{Engine, Engines, RenderError};
use crate::scene::{self, Package, Profile};
use clap::Args;
use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// What a scene begins with that Candela makes itself.
pub const DEMO_PREFIX: &str = "demo:";

/// Arguments of `candela render`.
#[derive(Debug, Args)]
pub struct RenderArgs {
    /// A .glb, .gltf or .zip, or demo:NAME (`candela demo` lists the names).
    #[arg(required_unless_present = "manifest", default_value = "", hide_default_value = true)]
    pub scene: String,
    /// Parameters as of `POST /v1/jobs`: a file of JSON, or JSON itself.
    #[arg(short, long, value_name = "FILE|JSON")]
    pub params: Option<String>,
    /// A parameter by name, over those of --params: `width=640`, `camera.yfov_degrees=30`. May be repeated.
    #[arg(short, long, value_name = "NAME=VALUE")]
    pub set: Vec<String>,
    /// Picture to write (.png, .exr, .webp, .jpg), or - for standard output; by default named after the scene, unless a file of that
    /// name is there. Of a manifest the folder of its pictures, by default this one, where none is replaced.
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// What is known of each pixel besides, as .exr: `standard_error=FILE.exr`, `samples=FILE.exr`; with `denoise`
    /// also `undenoised`, `albedo`, `normal`; with `light_groups` that. May be repeated.
    #[arg(long, value_name = "NAME=FILE", value_parser = aov)]
    pub aov: Vec<(Aov, PathBuf)>,
    /// Library of Open Image Denoise, or its folder, for `denoise`; without one it is looked for where the system keeps libraries.
    #[arg(long, env = "CANDELA_OIDN", value_name = "FILE|FOLDER")]
    pub oidn: Option<PathBuf>,
    /// Environment picture (.hdr, .exr): the same as `environment.hdri`.
    #[arg(long, value_name = "FILE")]
    pub hdri: Option<PathBuf>,
    /// Many pictures: a file (or - for standard input) of a JSON object per line like `{"scene": "duck.glb", "name": "top", "params":
    /// {"width": 640}}`, or of one object with `scenes`, `params`, `cameras`, `variants` and `lights`, of which every combination is made.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["scene", "params", "set", "aov", "hdri", "json"])]
    pub manifest: Option<PathBuf>,
    /// Has the server at this address render the manifest: http://127.0.0.1:8080.
    #[arg(long, value_name = "URL", requires = "manifest")]
    pub server: Option<String>,
    /// API key for that server.
    #[arg(long, env = "CANDELA_KEY", hide_env_values = true, requires = "server")]
    pub key: Option<String>,
    /// Prints the report as JSON on standard output.
    #[arg(long)]
    pub json: bool,
    /// No progress bar and no summary.
    #[arg(short, long)]
    pub quiet: bool,
}

/// Renders one picture on the best device of this machine, or those of a manifest.
pub fn run(arguments: &RenderArgs) -> Result<(), Failure> {
    if let Some(manifest) = &arguments.manifest {
        return manifest::run(arguments, manifest);
    }
    let request = request(arguments)?;
    if arguments.json && request.target == Target::Stdout {
        return Err(Failure::Request("--json and --output - both want standard output: give a file to one".into()));
    }
    check_aovs(&arguments.aov, &request.params)?;
    let denoiser = denoiser(arguments.oidn.as_deref(), request.params.denoise)?;
    let (prepared, stages) = Stage::default().load(&arguments.scene, &request.params)?;
    let (bytes, aovs, report) =
        picture(&mut Engines::new(), denoiser.as_ref(), prepared, stages, &request.params, arguments.quiet)?;
    write(&request.target, &bytes)?;
    for (aov, path) in &arguments.aov {
        let bytes = film::encode_aov(&aovs, *aov, &report.facts()).ok_or_else(|| {
            Failure::Machine(format!("--aov {}: {}", aov.name(), aov.lack(1, false, false).unwrap_or_default()))
        })?;
        let bytes = bytes.map_err(|error| Failure::Machine(error.to_string()))?;
        write(&Target::File(path.clone()), &bytes)?;
    }
    tell(arguments, &request, &report)
}

/// An AOV and the file that it is written to.
fn aov(text: &str) -> Result<(Aov, PathBuf), String> {
    let (name, file) = text.split_once('=').ok_or("write NAME=FILE, like standard_error=error.exr")?;
    let path = PathBuf::from(file);
    if !path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("exr")) {
        return Err(format!("{file}: AOVs are written as EXR; end the name in .exr"));
    }
    Ok((Aov::from_name(name)?, path))
}

/// Found out before the work, not after.
fn check_aovs(aovs: &[(Aov, PathBuf)], params: &RenderParams) -> Result<(), Failure> {
    for (aov, path) in aovs {
        if path.parent().is_some_and(|folder| !folder.as_os_str().is_empty() && !folder.is_dir()) {
            return Err(Failure::Request(format!("--aov {}: there is no such folder", path.display())));
        }
        if let Some(lack) = aov.lack(params.max_samples, params.denoise, params.light_groups.is_some()) {
            return Err(Failure::Request(format!("--aov {}: {lack}", aov.name())));
        }
    }
    Ok(())
}

/// What denoises, if that is asked for. Found out before the work, not after.
pub fn denoiser(place: Option<&Path>, asked: bool) -> Result<Option<Denoiser>, Failure> {
    let found = asked.then(|| apart::denoiser(place, Bounds::default()));
    found.transpose().map_err(|why| Failure::Request(format!("/params/denoise: {why}")))
}

/// The scene that was read last, with what was compiled of it: the pictures of a manifest mostly share theirs.
#[derive(Default)]
pub struct Stage(Option<StoredScene>);

impl Stage {
    /// Scene and environment, read and compiled.
    pub fn load(&mut self, name: &str, params: &RenderParams) -> Result<(Prepared, Stages), Failure> {
        let mut stages = Stages::default();
        let begun = Instant::now();
        let scene = self.import(name)?;
        let (maps, lights) = (maps(params)?, LightFiles { hdri: hdri(params)?, profiles: profiles(params)? });
        stages.import = seconds(begun);
        let begun = Instant::now();
        let faulty = |fault: String| Failure::Request(format!("{name}: {fault}"));
        let (posed, compiled) = scene.compile(params, &maps).map_err(|error| faulty(error.to_string()))?;
        let prepared = prepare(&posed, compiled, params, lights).map_err(|error| faulty(error.to_string()))?;
        stages.compile = seconds(begun);
        Ok((prepared, stages))
    }

    fn import(&mut self, name: &str) -> Result<&StoredScene, Failure> {
        // Two scenes at a time are one too many for a large one.
        let kept = self.0.take().filter(|scene| scene.id == name);
        let scene = if let Some(scene) = kept { scene } else { read(name)? };
        Ok(self.0.insert(scene))
    }
}

fn read(name: &str) -> Result<StoredScene, Failure> {
    let limits = scene::Limits::default();
    let imported = scene::import(&package(name, &limits)?, &limits);
    let imported = imported.map_err(|error| Failure::Request(format!("{name}: {}", located(&error))))?;
    Ok(StoredScene::new(name.to_owned(), imported, 0))
}

/// The files of a scene, or of a demo.
pub fn package(scene: &str, limits: &scene::Limits) -> Result<Package, Failure> {
    let package = match scene.strip_prefix(DEMO_PREFIX) {
        Some(name) => Package::from_bytes(demo::make(name)?, limits),
        None => Package::from_path(Path::new(scene), limits),
    };
    package.map_err(|error| Failure::Request(format!("{scene}: {}", located(&error))))
}

/// What is wrong and where; faults of the file as a whole have no place.
fn located(error: &scene::SceneError) -> String {
    if error.pointer.is_empty() { error.detail.clone() } else { error.to_string() }
}

/// The picture that the environment names, which is a file here.
fn hdri(params: &RenderParams) -> Result<Option<Arc<Hdri>>, Failure> {
    let Some(file) = params.hdri_name() else { return Ok(None) };
    let faulty = |fault: String| Failure::Request(format!("environment {file}: {fault}"));
    let bytes = std::fs::read(file).map_err(|error| faulty(error.to_string()))?;
    compile::decode_hdri(&bytes, compile::ENVIRONMENT_PIXELS)
        .map(|hdri| Some(Arc::new(hdri)))
        .map_err(|error| faulty(error.to_string()))
}

/// The pictures of spheres and overrides, which are files here.
fn maps(params: &RenderParams) -> Result<MapFiles, Failure> {
    let read = |name: &str| {
        let bytes = std::fs::read(name).map_err(|error| Failure::Request(format!("image {name}: {error}")))?;
        Ok((name.to_owned(), Arc::from(bytes)))
    };
    params.map_names().into_iter().map(read).collect()
}

/// The profiles of lights, which are files here.
fn profiles(params: &RenderParams) -> Result<BTreeMap<String, Arc<Profile>>, Failure> {
    let read = |name: &str| {
        let faulty = |fault: String| Failure::Request(format!("profile {name}: {fault}"));
        let bytes = std::fs::read(name).map_err(|error| faulty(error.to_string()))?;
        Ok((name.to_owned(), Arc::new(Profile::read(&bytes).map_err(faulty)?)))
    };
    params.profile_names().map(read).collect()
}

/// Traces and encodes.
pub fn picture(
    engine: &mut dyn Engine,
    denoiser: Option<&Denoiser>,
    prepared: Prepared,
    mut stages: Stages,
    params: &RenderParams,
    quiet: bool,
) -> Result<(Vec<u8>, Aovs, Report), Failure> {
    let Prepared { work, defaults, biases, warnings } = prepared;
    let (scene, adaptive) = (work.scene.stats.clone(), work.settings.adaptive);
    let mut bar = Bar::new(work.settings, quiet);
    let rendered = render_to_end(engine, work, &mut |progress| bar.show(progress));
    bar.finish();
    let rendered = rendered.map_err(|error| failure(&error))?;
    stages.device_upload = rendered.device_upload.as_secs_f64();
    stages.trace = rendered.trace.as_secs_f64();
    let begun = Instant::now();
    let error = rendered.film.error();
    let (samples_min, samples_max) = rendered.film.samples_range();
    let mut report = Report {
        samples: rendered.film.samples(),
        samples_min,
        samples_max,
        adaptive,
        error: error.map(|error| error.relative_rms),
        error_bound_95: error.map(|error| error.upper_bound_95),
        denoised: None,
        seed: params.seed,
        engine: rendered.device.engine,
        device: rendered.device,
        stop_reason: rendered.reason,
        seconds: stages,
        biases,
        defaults,
        warnings,
        non_finite: rendered.non_finite,
        scene,
    };
    let (mut picture, mut aovs) = (rendered.film.picture(), rendered.film.aovs());
    if params.denoise {
        let asked = Denoising { denoiser, guides: rendered.guides, wanted: &|| true };
        picture = denoised(asked, picture, &mut aovs, &mut report);
    }
    let bytes = film::encode(&picture, params, params.output.format, &report.facts());
    report.seconds.encode = seconds(begun) - report.seconds.denoise;
    bytes.map(|bytes| (bytes, aovs, report)).map_err(|error| match error {
        film::EncodeError::Unsupported(_) => Failure::Request(error.to_string()),
        film::EncodeError::Failed(_) => Failure::Machine(error.to_string()),
    })
}

/// Writes a file, or standard output.
pub fn write(target: &Target, bytes: &[u8]) -> Result<(), Failure> {
    let written = match target {
        Target::File(path) => std::fs::write(path, bytes),
        Target::Stdout => std::io::stdout().write_all(bytes),
    };
    written.map_err(|error| Failure::Machine(format!("cannot write {}: {error}", place(target))))
}

fn tell(arguments: &RenderArgs, request: &Request, report: &Report) -> Result<(), Failure> {
    if !arguments.quiet {
        eprint!("{}", Summary { place: &place(&request.target), params: &request.params, report });
    }
    if arguments.json {
        let printed = serde_json::to_writer_pretty(std::io::stdout(), report).map_err(std::io::Error::from);
        printed
            .and_then(|()| writeln!(std::io::stdout()))
            .map_err(|error| Failure::Machine(format!("cannot print the report: {error}")))?;
    }
    Ok(())
}

fn place(target: &Target) -> String {
    match target {
        Target::File(path) => path.display().to_string(),
        Target::Stdout => "standard output".to_owned(),
    }
}

fn failure(error: &RenderError) -> Failure {
    match error {
        RenderError::TooLarge(_) => Failure::Request(error.to_string()),
        RenderError::DeviceLost(_) | RenderError::NoAdapter(_) => Failure::Machine(error.to_string()),
    }
}

fn seconds(since: Instant) -> f64 {
    since.elapsed().as_secs_f64()
}
