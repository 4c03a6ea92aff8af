//! The process that holds the engine: it does what it is asked, one ask after the other, and ends with whoever asks.

use super::wire::{Answer, Ask, Begin, Device, Failure, Stepped};
use crate::compile::{CompiledScene, EnvironmentKind, Hdri, Lighting};
use crate::film::Seen;
use crate::process::{read_frame, write_frame};
use crate::render::{Engine, Render, RenderError, Work};
use std::collections::HashMap;
use std::io::{self, Read, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, mpsc};

/// Serves an engine to whoever writes to `asks` and reads `answers`.
///
/// The reader's thread ends the process when `asks` ends, also while the engine hangs: nobody is left to kill it then.
///
/// # Errors
/// Nobody reads the answers, or what was asked cannot be read.
pub fn host(
    make: impl FnOnce() -> Box<dyn Engine>,
    mut asks: impl Read + Send + 'static,
    mut answers: impl Write,
) -> io::Result<()> {
    let (sender, inbox) = mpsc::channel();
    std::thread::spawn(move || {
        while let Ok(frame) = read_frame(&mut asks) {
            if sender.send(frame).is_err() {
                return;
            }
        }
        std::process::exit(0);
    });
    let mut host = Host { engine: make(), scenes: HashMap::new(), pictures: HashMap::new(), renders: HashMap::new() };
    say(&mut answers, &Answer::Ready)?;
    for frame in inbox {
        if let Some(answer) = host.answer(&frame).map_err(io::Error::other)? {
            say(&mut answers, &answer)?;
        }
    }
    Ok(())
}

fn say(answers: &mut impl Write, answer: &Answer) -> io::Result<()> {
    write_frame(answers, &postcard::to_stdvec(answer).map_err(io::Error::other)?)
}

struct Host {
    engine: Box<dyn Engine>,
    scenes: HashMap<u64, Arc<CompiledScene>>,
    pictures: HashMap<u64, Arc<Hdri>>,
    renders: HashMap<u64, (Box<dyn Render>, Seen)>,
}

impl Host {
    fn answer(&mut self, frame: &[u8]) -> postcard::Result<Option<Answer>> {
        let (ask, body) = postcard::take_from_bytes(frame)?;
        match ask {
            Ask::KeepScene(number) => {
                self.scenes.insert(number, Arc::new(postcard::from_bytes(body)?));
            }
            Ask::KeepPicture(number) => {
                self.pictures.insert(number, Arc::new(postcard::from_bytes(body)?));
            }
            Ask::Forget(number) => {
                self.scenes.remove(&number);
                self.pictures.remove(&number);
            }
            Ask::Begin { render, scene, picture } => {
                return Ok(Some(self.begin(render, scene, picture, postcard::from_bytes(body)?)));
            }
            Ask::Step(render) => return Ok(Some(self.step(render))),
            Ask::Drop(render) => {
                let gone = self.renders.remove(&render);
                // One that has failed may fail again as it goes.
                let _ = guarded(|| {
                    drop(gone);
                    Ok(())
                });
            }
        }
        Ok(None)
    }

    fn begin(&mut self, render: u64, scene: u64, picture: Option<u64>, begin: Begin<Lighting>) -> Answer {
        let (mut lighting, view, features, settings, film) = begin;
        let Some(scene) = self.scenes.get(&scene).map(Arc::clone) else { return unknown() };
        if let Some(number) = picture {
            let Some(picture) = self.pictures.get(&number) else { return unknown() };
            lighting.environment.kind = EnvironmentKind::Hdri(Arc::clone(picture));
        }
        let work = Work { scene, lighting: Arc::new(lighting), view, features, settings };
        match guarded(|| self.engine.begin(work, film)) {
            Ok(begun) => {
                let (device, is_ready) = (Device::from(begun.device()), begun.is_ready());
                let seen = Seen::of(begun.film());
                self.renders.insert(render, (begun, seen));
                Answer::Begun(device, is_ready)
            }
            Err(failure) => Answer::Failed(failure),
        }
    }

    fn step(&mut self, render: u64) -> Answer {
        let Some((render, seen)) = self.renders.get_mut(&render) else { return unknown() };
        match guarded(|| render.step()) {
            Ok(reason) => Answer::Stepped(Stepped {
                is_ready: render.is_ready(),
                reason,
                progress: render.progress(),
                non_finite: render.non_finite(),
                changes: seen.update(render.film()),
                guides: render.take_guides(),
            }),
            Err(failure) => Answer::Failed(failure),
        }
    }
}

fn unknown() -> Answer {
    Answer::Failed(Failure::Render(RenderError::DeviceLost("the engine's process knows nothing of this render".into())))
}

fn guarded<T>(part: impl FnOnce() -> Result<T, RenderError>) -> Result<T, Failure> {
    catch_unwind(AssertUnwindSafe(part)).map_err(|_| Failure::Panic)?.map_err(Failure::Render)
}
