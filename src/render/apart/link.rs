//! The side that asks: an [`Engine`] like any other, as whoever uses it sees.

use super::wire::{Answer, Ask, Failure, Stepped, ask};
use crate::compile::{CompiledScene, EnvironmentKind, Hdri};
use crate::film::{Film, Guides};
use crate::process::{read_frame, write_frame};
use crate::render::{DeviceInfo, Engine, NonFinite, Render, RenderError, StopReason, Work};
use serde::Serialize;
use std::cell::{Cell, RefCell};
use std::io;
use std::process::{Child, Command, Stdio};
use std::rc::Rc;
use std::sync::{Arc, Weak, mpsc};
use std::time::Duration;

/// An engine that another process holds.
pub struct ApartEngine {
    link: Rc<Link>,
    scenes: Held<CompiledScene>,
    pictures: Held<Hdri>,
    /// Counts scenes and renders.
    next: u64,
}

impl ApartEngine {
    /// Starts the process, which must [`host`](super::host) an engine on its standard input and output, and waits until it is
    /// ready. `patience`: an answer that takes longer is none.
    ///
    /// # Errors
    /// It cannot be started, or has no engine.
    pub fn start(command: Command, patience: Duration) -> Result<Self, RenderError> {
        let link = Link::open(command, patience)
            .map_err(|error| RenderError::NoAdapter(format!("the engine's process cannot be started: {error}")))?;
        match link.answer()? {
            Answer::Ready => {
                Ok(Self { link: Rc::new(link), scenes: Held::default(), pictures: Held::default(), next: 0 })
            }
            _ => Err(link.lose("it began with an answer")),
        }
    }
}

/// What the process holds of a kind, by number, as long as it is held here.
struct Held<T>(Vec<(u64, Weak<T>)>);

impl<T> Default for Held<T> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<T: Serialize> Held<T> {
    /// Number of a thing, which is sent unless the process has it. Those that nobody uses any more leave.
    fn number(&mut self, thing: &Arc<T>, link: &Link, next: u64, keep: fn(u64) -> Ask) -> Result<u64, RenderError> {
        let (kept, gone): (Vec<_>, Vec<_>) =
            std::mem::take(&mut self.0).into_iter().partition(|(_, thing)| thing.strong_count() > 0);
        self.0 = kept;
        for (number, _) in gone {
            link.tell(Ask::Forget(number), &())?;
        }
        let weak = Arc::downgrade(thing);
        if let Some((number, _)) = self.0.iter().find(|(_, known)| known.ptr_eq(&weak)) {
            return Ok(*number);
        }
        link.tell(keep(next), thing.as_ref())?;
        self.0.push((next, weak));
        Ok(next)
    }
}

impl Engine for ApartEngine {
    fn begin(&mut self, work: Work, film: Option<Film>) -> Result<Box<dyn Render>, RenderError> {
        // Numbers of the render, its scene and its picture: those that are not needed are left out.
        let [render, scene, picture] = [self.next, self.next + 1, self.next + 2];
        self.next += 3;
        let Work { scene: compiled, lighting, view, features, settings } = work;
        let scene = self.scenes.number(&compiled, &self.link, scene, Ask::KeepScene)?;
        let mut lighting = Arc::unwrap_or_clone(lighting);
        let picture = match std::mem::take(&mut lighting.environment.kind) {
            EnvironmentKind::Hdri(hdri) => Some(self.pictures.number(&hdri, &self.link, picture, Ask::KeepPicture)?),
            other => {
                lighting.environment.kind = other;
                None
            }
        };
        self.link.tell(Ask::Begin { render, scene, picture }, &(&lighting, &view, &features, &settings, &film))?;
        match self.link.answer()? {
            Answer::Begun(device, is_ready) => Ok(Box::new(ApartRender {
                link: Rc::clone(&self.link),
                render,
                device: device.into(),
                is_ready,
                film: film.unwrap_or_else(|| Film::split(view.width, view.height, &lighting.groups)),
                progress: 0.0,
                non_finite: NonFinite::default(),
                guides: None,
            })),
            Answer::Failed(failure) => Err(self.link.failed(failure)),
            _ => Err(self.link.lose("it gave another answer")),
        }
    }
}

/// A render that another process traces, with a copy of its film.
struct ApartRender {
    link: Rc<Link>,
    render: u64,
    device: DeviceInfo,
    is_ready: bool,
    film: Film,
    progress: f64,
    non_finite: NonFinite,
    guides: Option<Guides>,
}

impl Render for ApartRender {
    fn device(&self) -> &DeviceInfo {
        &self.device
    }

    fn is_ready(&self) -> bool {
        self.is_ready
    }

    fn step(&mut self) -> Result<Option<StopReason>, RenderError> {
        self.link.tell(Ask::Step(self.render), &())?;
        match self.link.answer()? {
            Answer::Stepped(Stepped { is_ready, reason, progress, non_finite, changes, guides }) => {
                if !self.film.follow(changes) {
                    return Err(self.link.lose("its film does not fit"));
                }
                self.guides = guides.or(self.guides.take());
                (self.is_ready, self.progress, self.non_finite) = (is_ready, progress, non_finite);
                Ok(reason)
            }
            Answer::Failed(failure) => Err(self.link.failed(failure)),
            _ => Err(self.link.lose("it gave another answer")),
        }
    }

    fn film(&self) -> &Film {
        &self.film
    }

    fn into_film(mut self: Box<Self>) -> Film {
        std::mem::replace(&mut self.film, Film::new(0, 0))
    }

    fn progress(&self) -> f64 {
        self.progress
    }

    fn non_finite(&self) -> NonFinite {
        self.non_finite
    }

    fn take_guides(&mut self) -> Option<Guides> {
        self.guides.take()
    }
}

impl Drop for ApartRender {
    fn drop(&mut self) {
        // A process that is gone holds no render.
        let _ = self.link.tell(Ask::Drop(self.render), &());
    }
}

/// The process, and what goes to it and comes from it on threads of their own: neither a full pipe nor a silent process is waited
/// for without end.
struct Link {
    process: RefCell<Child>,
    asks: mpsc::Sender<Vec<u8>>,
    answers: mpsc::Receiver<Answer>,
    patience: Duration,
    is_lost: Cell<bool>,
}

impl Link {
    fn open(mut command: Command, patience: Duration) -> io::Result<Self> {
        command.stdin(Stdio::piped()).stdout(Stdio::piped());
        // An interrupt of the terminal is for the server, which lets renders end.
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let mut process = command.spawn()?;
        tracing::info!(pid = process.id(), "the engine runs in a process of its own");
        let missing = || io::Error::other("no pipe");
        let (mut input, output) = (process.stdin.take().ok_or_else(missing)?, process.stdout.take());
        let mut output = output.ok_or_else(missing)?;
        let (asks, to_send) = mpsc::channel::<Vec<u8>>();
        std::thread::spawn(move || to_send.iter().try_for_each(|frame| write_frame(&mut input, &frame)));
        let (told, answers) = mpsc::channel();
        std::thread::spawn(move || {
            while let Some(answer) = read_frame(&mut output).ok().and_then(|frame| postcard::from_bytes(&frame).ok()) {
                if told.send(answer).is_err() {
                    return;
                }
            }
        });
        Ok(Self { process: RefCell::new(process), asks, answers, patience, is_lost: Cell::new(false) })
    }

    fn tell(&self, head: Ask, body: &impl Serialize) -> Result<(), RenderError> {
        if self.is_lost.get() {
            return Err(lost("its process has ended"));
        }
        let frame = ask(head, body).map_err(|error| RenderError::TooLarge(error.to_string()))?;
        self.asks.send(frame).map_err(|_| self.lose("it does not read"))
    }

    fn answer(&self) -> Result<Answer, RenderError> {
        self.answers.recv_timeout(self.patience).map_err(|error| match error {
            mpsc::RecvTimeoutError::Timeout => self.lose(&format!("no answer for {} s", self.patience.as_secs())),
            mpsc::RecvTimeoutError::Disconnected => self.lose("its process has ended"),
        })
    }

    /// As the engine would have failed here.
    fn failed(&self, failure: Failure) -> RenderError {
        match failure {
            Failure::Render(error) => error,
            // The other process has told of it already; here it must look like one.
            Failure::Panic => std::panic::resume_unwind(Box::new("a panic of the engine's process")),
        }
    }

    /// Ends the process, which is of no more use, and says how it has ended.
    fn lose(&self, why: &str) -> RenderError {
        self.is_lost.set(true);
        let mut process = self.process.borrow_mut();
        // Killing what has ended does nothing.
        let _ = process.kill();
        let end = process.wait().map_or_else(|error| error.to_string(), |status| status.to_string());
        tracing::error!(pid = process.id(), why, end, "the engine's process is lost");
        lost(&format!("{why} ({end})"))
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        if !self.is_lost.get() {
            let process = self.process.get_mut();
            let _ = process.kill();
            let _ = process.wait();
        }
    }
}

fn lost(why: &str) -> RenderError {
    RenderError::DeviceLost(format!("the engine's process: {why}"))
}
