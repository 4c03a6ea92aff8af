//! The one way from a scene and a request to [`Work`], and from [`Work`] to a film where nothing else wants the device.

use super::{DeviceInfo, Engine, NonFinite, RenderError, Settings, StopReason, Strategy, Work};
use crate::compile::{self, CompileError, CompiledScene, DefaultTaken, Features, LightFiles, Lighting, View};
use crate::film::{Film, Guides};
use crate::params::{Mode, RenderParams};
use crate::scene::{Scene, Warning};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Work, and what the reply must say about it.
#[derive(Debug, Clone)]
pub struct Prepared {
    /// For an engine.
    pub work: Work,
    /// What the request left open, and what was taken.
    pub defaults: Vec<DefaultTaken>,
    /// What the request trades truth for.
    pub biases: Vec<String>,
    /// What the picture lacks or had to guess.
    pub warnings: Vec<Warning>,
}

/// Adds the light and the camera of a request to a scene.
///
/// `scene` stands as [`Scene::at`] the [`compile::moment`] of `params` poses it; `compiled` is what
/// [`compile::compile_request`] made of it; `files` are those that the light of `params` names. `params` have been validated.
///
/// # Errors
/// [`CompileError`] if the parameters name what the scene does not have.
pub fn prepare(
    scene: &Scene,
    compiled: Arc<CompiledScene>,
    params: &RenderParams,
    files: impl Into<LightFiles>,
) -> Result<Prepared, CompileError> {
    let (view, mut defaults) = compile::view(scene, &compiled, params)?;
    let compile::Lit { lighting, defaults: defaults_of_light, warning } =
        compile::light(scene, &compiled, params, files.into())?;
    defaults.extend(defaults_of_light);
    let features = compile::features(&compiled, &lighting, &view, params);
    defaults.extend(default_moment(scene, params));
    let mut warnings = scene.warnings.clone();
    warnings.extend(nothing_moves(scene, params));
    warnings.extend(shutter_ignored(params));
    warnings.extend(warning);
    warnings.extend(blackness(&compiled, &lighting, features.unlit).or_else(|| nothing_in_view(&compiled, &view)));
    warnings.extend(beyond_glass(&features));
    let mut biases = params.biases();
    if params.mode == Mode::Direct && compiled.extended.iter().any(compile::Extended::scatters) {
        biases.push("mode direct: light that is scattered inside of bodies is missing".to_owned());
    }
    let work = Work { scene: compiled, lighting: Arc::new(lighting), view, features, settings: Settings::from(params) };
    Ok(Prepared { work, defaults, biases, warnings })
}

/// What of an animation and a time was given without the other.
fn default_moment(scene: &Scene, params: &RenderParams) -> Vec<DefaultTaken> {
    let shutter = params.open_shutter().is_some();
    let Some(first) = scene.animations.first() else { return Vec::new() };
    let animation = || {
        let value = serde_json::json!({"index": 0, "name": first.name});
        DefaultTaken { what: "animation".into(), value }
    };
    let time = || DefaultTaken { what: "time".into(), value: 0.0.into() };
    match (params.time, &params.animation) {
        (Some(_), None) => vec![animation()],
        (None, Some(_)) => vec![time()],
        (None, None) if shutter => vec![animation(), time()],
        _ => Vec::new(),
    }
}

fn nothing_moves(scene: &Scene, params: &RenderParams) -> Option<Warning> {
    let field = if params.time.is_some() { "time" } else { "shutter" };
    let asked = params.time.is_some() || params.open_shutter().is_some();
    (asked && scene.animations.is_empty()).then(|| Warning {
        code: "no_animation",
        pointer: format!("/params/{field}"),
        detail: format!("the file has no animation; `{field}` changes nothing"),
    })
}

/// That a mode which draws one moment was asked for several.
fn shutter_ignored(params: &RenderParams) -> Option<Warning> {
    let open = params.shutter.is_some_and(|shutter| shutter.close > shutter.open);
    let detail = "previews and direct light show the one moment `time`: ask for mode path to have motion blurred";
    (open && params.mode != Mode::Path).then(|| Warning {
        code: "shutter_ignored",
        pointer: "/params/shutter".into(),
        detail: detail.into(),
    })
}

/// Why the picture must be black, or has nothing but its background in it.
fn blackness(compiled: &CompiledScene, lighting: &Lighting, unlit: bool) -> Option<Warning> {
    let warning = |code, pointer: &str, detail: &str| Warning { code, pointer: pointer.into(), detail: detail.into() };
    let dark = lighting.lights.is_empty() && compiled.emitters.is_empty() && !compile::shines(&lighting.environment);
    if compiled.triangles.is_empty() {
        let detail = "the scene draws no triangle, so the picture shows its background alone: has it meshes, are their nodes \
                      in the scene that was chosen, and is no scale zero?";
        Some(warning("nothing_drawn", "/scenes", detail))
    } else if dark && !unlit {
        let detail = "no light reaches the scene, so the picture is black: give lights or an environment, or leave \
                      `environment` out for a neutral sky";
        Some(warning("no_light", "/params/environment", detail))
    } else {
        None
    }
}

/// Why the picture has nothing but its background in it although the scene draws something.
fn nothing_in_view(compiled: &CompiledScene, view: &View) -> Option<Warning> {
    let why = compile::unseen(&compiled.bounds, view)?;
    let detail = format!(
        "{why}, so the picture shows its background alone: leave `camera` out, or `orbit.distance`, to have it framed"
    );
    Some(Warning { code: "nothing_in_view", pointer: "/params/camera".into(), detail })
}

/// Light that no path can find: a point or a direction behind what bends light or scatters it.
fn beyond_glass(features: &Features) -> Option<Warning> {
    let detail = "what is inside or behind a filled body (KHR_materials_volume) gets no light through it from point, spot and \
                  directional lights, because no path that it bends can meet them: light it with an emitting mesh, a light \
                  with an extent or an environment; thin and smooth walls (thickness 0, roughness 0) do let such light through";
    (features.punctual && features.volume).then(|| Warning {
        code: "light_behind_glass",
        pointer: "/lights".into(),
        detail: detail.into(),
    })
}

impl From<&RenderParams> for Settings {
    fn from(params: &RenderParams) -> Self {
        let is_preview = params.mode == Mode::Preview;
        Self {
            engine: params.engine,
            mode: params.mode,
            strategy: Strategy::default(),
            max_bounces: params.max_bounces,
            multiple_scattering: params.multiple_scattering,
            pieces: params.open_shutter().map_or(0, |shutter| shutter.steps),
            seed: params.seed,
            max_samples: if is_preview { params.preview.samples } else { params.max_samples },
            adaptive: params.adaptive && !is_preview,
            target_error: params.target_error.filter(|_| !is_preview),
            deadline: params.deadline_ms.map(Duration::from_millis),
            denoise: params.denoise && !is_preview,
            direct: params.direct,
            preview: params.preview,
        }
    }
}

/// A render that has ended.
#[derive(Debug)]
pub struct Rendered {
    /// Its samples.
    pub film: Film,
    /// What guides a denoiser, if it was to.
    pub guides: Option<Guides>,
    /// Why it ended.
    pub reason: StopReason,
    /// Dropped samples.
    pub non_finite: NonFinite,
    /// What traced.
    pub device: DeviceInfo,
    /// Upload and pipelines.
    pub device_upload: Duration,
    /// Tracing.
    pub trace: Duration,
}

/// A render under way.
#[derive(Debug, Clone, Copy)]
pub struct Progress<'a> {
    /// Part of `max_samples` done, 0 to 1.
    pub fraction: f64,
    /// The samples so far, in whole passes.
    pub film: &'a Film,
    /// Time spent tracing.
    pub elapsed: Duration,
}

/// Renders to the end, telling `progress` after each slice.
///
/// # Errors
/// [`RenderError`] if the device cannot hold the scene or is lost.
pub fn render_to_end(
    engine: &mut dyn Engine,
    work: Work,
    progress: &mut dyn FnMut(Progress<'_>),
) -> Result<Rendered, RenderError> {
    let begun = Instant::now();
    let mut render = engine.begin_ready(work, None)?;
    let device_upload = begun.elapsed();
    let begun = Instant::now();
    loop {
        let ended = render.step()?;
        let elapsed = begun.elapsed();
        progress(Progress { fraction: render.progress(), film: render.film(), elapsed });
        if let Some(reason) = ended {
            let (non_finite, device) = (render.non_finite(), render.device().clone());
            return Ok(Rendered {
                guides: render.take_guides(),
                film: render.into_film(),
                reason,
                non_finite,
                device,
                device_upload,
                trace: elapsed,
            });
        }
    }
}
