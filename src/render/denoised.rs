//! A finished picture without its noise, if that was asked for, and what the reply says of it.

use super::report::Report;
use crate::denoise::{BIAS, Denoiser, FAILED, Guidance, HOW_TO_GET_IT};
use crate::film::{Aovs, Guides, Picture};
use crate::scene::Warning;
use std::time::Instant;

/// Who is to denoise what.
pub struct Denoising<'a> {
    /// None: its library is not there any more.
    pub denoiser: Option<&'a Denoiser>,
    /// What the render has found for it; none: it was ended before.
    pub guides: Option<Guides>,
    /// Whether someone still wants the picture.
    pub wanted: &'a dyn Fn() -> bool,
}

/// The picture without its noise; with it, and with a warning, if that fails: hours of tracing are not lost by it.
pub fn denoised(asked: Denoising<'_>, picture: Picture, aovs: &mut Aovs, report: &mut Report) -> Picture {
    let begun = Instant::now();
    let smooth = smooth(asked, &picture);
    report.seconds.denoise = begun.elapsed().as_secs_f64();
    match smooth {
        Ok((smooth, guides, name)) => {
            report.denoised = Some(name);
            report.biases.push(BIAS.to_owned());
            aovs.note_denoised(&picture, guides);
            smooth
        }
        Err(why) => {
            tracing::error!(%why, "a picture was not denoised");
            report.warnings.push(Warning {
                code: FAILED,
                pointer: "/params/denoise".to_owned(),
                detail: format!("the picture is not denoised, but as it was traced: {why}"),
            });
            picture
        }
    }
}

fn smooth(asked: Denoising<'_>, picture: &Picture) -> Result<(Picture, Guides, String), String> {
    let denoiser = asked.denoiser.ok_or_else(|| format!("Open Image Denoise is not there: {HOW_TO_GET_IT}"))?;
    let guides = asked.guides.ok_or("the render was ended before albedo and normals were traced")?;
    let smooth = denoiser.denoise(picture, Some(&guides), Guidance::default(), asked.wanted)?;
    Ok((smooth, guides, denoiser.name()))
}
