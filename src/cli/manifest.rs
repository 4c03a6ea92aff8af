//! `candela render --manifest`: many pictures, made here or by a server.

use super::Failure;
use super::remote::{Auth, Remote};
use super::render::{RenderArgs, Stage, denoiser, picture, write};
use super::request::{Target, limits};
use crate::denoise::Denoiser;
use crate::jobs::{Item, ManifestError, read_manifest};
use crate::params::FieldError;
use crate::render::Engines;
use indicatif::{ProgressBar, ProgressStyle};
use std::io::Read;
use std::path::{Path, PathBuf};

/// Renders of a manifest that is rendered here.
const MOST: usize = 1_000_000;

/// Renders every item into a folder. An item that fails does not end the others; the command fails at the end.
pub fn run(arguments: &RenderArgs, manifest: &Path) -> Result<(), Failure> {
    let folder = arguments.output.clone().unwrap_or_else(|| PathBuf::from("."));
    if !folder.is_dir() {
        std::fs::create_dir_all(&folder)
            .map_err(|error| Failure::Machine(format!("cannot make {}: {error}", folder.display())))?;
    }
    let items = items(manifest)?;
    if arguments.output.is_none() {
        refuse_to_replace(&items)?;
    }
    let mut tally = Tally::new(items.len(), &folder, arguments.quiet);
    match &arguments.server {
        Some(server) => {
            let auth = Auth { key: arguments.key.clone() };
            Remote::new(server, auth)?.render(&items, |item, result| tally.note(item, result))?;
        }
        None => {
            if let Some(item) = items.iter().find(|item| item.webhook.is_some()) {
                let detail = format!("item `{}` has a webhook, which a server alone sends (--server URL)", item.name);
                return Err(Failure::Request(detail));
            }
            let asks = items.iter().any(|item| item.params.denoise);
            let denoiser = denoiser(arguments.oidn.as_deref(), asks)?;
            let (mut engines, mut stage) = (Engines::new(), Stage::default());
            for item in &items {
                let made = local(&mut engines, &mut stage, item, denoiser.as_ref());
                tally.note(item, made)?;
            }
        }
    }
    tally.finish()
}

/// A file that the user did not name is not replaced, which is found out before the work.
fn refuse_to_replace(items: &[Item]) -> Result<(), Failure> {
    match items.iter().map(file_name).find(|name| Path::new(name).exists()) {
        None => Ok(()),
        Some(name) => Err(Failure::Request(format!(
            "{name} is there already: write `-o .` to replace what has the names of the manifest's pictures, or `-o FOLDER`"
        ))),
    }
}

fn file_name(item: &Item) -> String {
    format!("{}.{}", item.name, item.params.output.format.extension())
}

fn local(
    engines: &mut Engines,
    stage: &mut Stage,
    item: &Item,
    denoiser: Option<&Denoiser>,
) -> Result<Vec<u8>, Failure> {
    let (prepared, stages) = stage.load(&item.scene, &item.params)?;
    picture(engines, denoiser, prepared, stages, &item.params, true).map(|(bytes, _, _)| bytes)
}

/// Reads the manifest and checks every item before the first is rendered.
fn items(manifest: &Path) -> Result<Vec<Item>, Failure> {
    let place = manifest.display();
    let text = if manifest.as_os_str() == "-" {
        let mut text = String::new();
        std::io::stdin().read_to_string(&mut text).map(|_| text)
    } else {
        std::fs::read_to_string(manifest)
    };
    let text = text.map_err(|error| Failure::Request(format!("--manifest {place}: {error}")))?;
    let items = read_manifest(&text, MOST).map_err(|error| match error {
        ManifestError::Syntax(detail) => Failure::Request(format!("--manifest {place}: {detail}")),
        ManifestError::Fields(faults) => faulty(manifest, &faults),
    })?;
    for item in &items {
        let place = |fault| item.origin.place(fault);
        item.params
            .validate(&limits())
            .map_err(|faults| faulty(manifest, &faults.into_iter().map(place).collect::<Vec<_>>()))?;
    }
    Ok(items)
}

fn faulty(manifest: &Path, faults: &[FieldError]) -> Failure {
    let lines: Vec<String> = faults.iter().map(|fault| format!("\n  {fault}")).collect();
    Failure::Request(format!("--manifest {}:{}", manifest.display(), lines.concat()))
}

/// What has come of the items so far.
struct Tally<'a> {
    folder: &'a Path,
    bar: ProgressBar,
    quiet: bool,
    failed: usize,
    worst: u8,
    count: usize,
}

impl<'a> Tally<'a> {
    fn new(count: usize, folder: &'a Path, quiet: bool) -> Self {
        let bar = if quiet { ProgressBar::hidden() } else { ProgressBar::new(count as u64) };
        if let Ok(style) = ProgressStyle::with_template("{bar:32} {pos} of {len}, {eta} left {msg}") {
            bar.set_style(style);
        }
        Self { folder, bar, quiet, failed: 0, worst: 0, count }
    }

    /// Writes a picture, or says why there is none. Fails only if it cannot be written.
    fn note(&mut self, item: &Item, result: Result<Vec<u8>, Failure>) -> Result<(), Failure> {
        let path = self.folder.join(file_name(item));
        let line = match result {
            Ok(bytes) => {
                write(&Target::File(path.clone()), &bytes)?;
                format!("{}", path.display())
            }
            Err(failure) => {
                self.failed += 1;
                self.worst = if self.worst == 0 { failure.exit_code() } else { self.worst.min(failure.exit_code()) };
                format!("{}: FAILED: {failure}", item.name)
            }
        };
        self.bar.inc(1);
        if !self.quiet {
            self.bar.suspend(|| eprintln!("{line}"));
        }
        Ok(())
    }

    fn finish(self) -> Result<(), Failure> {
        self.bar.finish_and_clear();
        let text = format!("{} of {} pictures failed", self.failed, self.count);
        match (self.failed, self.worst) {
            (0, _) => Ok(()),
            (_, 1) => Err(Failure::Machine(text)),
            _ => Err(Failure::Request(text)),
        }
    }
}
