//! From an order to work for the device; blocks a core for as long as it takes.

use super::job::{Job, Order};
use super::memory::{DENOISE_BYTES_PER_PIXEL, film_bytes};
use super::problem::{Code, Problem};
use super::progress::seconds;
use super::saved::SavedFilm;
use super::scenes::compiled_bytes;
use super::worker::Ready;
use crate::compile::LightFiles;
use crate::render::prepare::prepare;
use std::sync::Arc;
use std::time::Instant;

/// Compiles the scene, unless that has been done, and what the request adds to it.
/// `saved`: what was made of it before the server restarted. Films of up to `copied` bytes are copied to be saved.
pub(super) fn compile(
    job: Arc<Job>,
    order: &Order,
    saved: Option<SavedFilm>,
    memory_limit: u64,
    copied: u64,
) -> Result<Ready, Problem> {
    let _span = tracing::info_span!(parent: &job.span(), "compile").entered();
    if job.is_over() {
        // Cancelled while it waited for a core: not worth one.
        return Err(Problem::new(Code::JobCancelled, "the job was cancelled before its scene was compiled"));
    }
    let begun = Instant::now();
    let params = &order.params;
    let maps = order.maps.iter().filter_map(|image| Some((image.id.clone(), image.map()?))).collect();
    let (scene, compiled) = order.scene.compile(params, &maps)?;
    let film = film_bytes(params.width, params.height, params.groups());
    let copy = if film <= copied { film } else { 0 };
    let pixels = u64::from(params.width) * u64::from(params.height);
    let denoising = if params.denoise { pixels * DENOISE_BYTES_PER_PIXEL } else { 0 };
    let bytes = film + copy + denoising + compiled_bytes(&compiled);
    if bytes > memory_limit {
        let detail = format!(
            "the scene and the picture need about {bytes} bytes, above this server's limit of {memory_limit} for a \
             job; use a smaller picture or a simpler scene"
        );
        return Err(Problem::new(Code::RenderTooLarge, detail));
    }
    let hdri = order.hdri.as_ref().and_then(|image| image.environment());
    let profiles = order.profiles.iter().filter_map(|image| Some((image.id.clone(), image.profile()?))).collect();
    let prepared = prepare(&scene, compiled, params, LightFiles { hdri, profiles })?;
    let mut stages = order.stages;
    stages.compile = seconds(begun.elapsed());
    Ok(Ready { job, prepared, saved, stages, since: Instant::now(), bytes })
}
