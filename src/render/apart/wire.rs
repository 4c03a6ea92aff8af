//! What the two processes say: frames of a length and a `postcard` message, asks one way, an answer to some of them the other way.

use crate::compile::{Features, View};
use crate::film::{Changes, Film, Guides};
use crate::render::{DeviceInfo, NonFinite, RenderError, Settings, StopReason};
use serde::{Deserialize, Serialize};

/// What an engine is asked for. Some asks have a body after them in the same frame.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub enum Ask {
    /// To hold the scene of the body (a `CompiledScene`) under a number.
    KeepScene(u64),
    /// To hold the picture of the body (a `Hdri`) under a number.
    KeepPicture(u64),
    /// To let go of a scene or a picture.
    Forget(u64),
    /// To begin the render of the body (a [`Begin`]) of a scene; answered by `Begun`.
    Begin {
        /// Number of the render.
        render: u64,
        /// Number of its scene.
        scene: u64,
        /// Number of the picture that its environment shows.
        picture: Option<u64>,
    },
    /// To trace a slice of a render; answered by `Stepped`.
    Step(u64),
    /// To let go of a render.
    Drop(u64),
}

/// What a render needs besides its scene and the picture of its environment, which the lighting then lacks.
pub type Begin<L> = (L, View, Features, Settings, Option<Film>);

/// What an engine says.
#[derive(Debug, Serialize, Deserialize)]
pub enum Answer {
    /// It is there, and has been asked nothing yet.
    Ready,
    /// A render has begun, on this device; whether it is ready.
    Begun(Device, bool),
    /// A slice was traced.
    Stepped(Stepped),
    /// It could not be.
    Failed(Failure),
}

/// Where a render stands after a slice.
#[derive(Debug, Serialize, Deserialize)]
pub struct Stepped {
    /// As [`crate::render::Render::is_ready`].
    pub is_ready: bool,
    /// Why it has ended, if it has.
    pub reason: Option<StopReason>,
    /// As [`crate::render::Render::progress`].
    pub progress: f64,
    /// As [`crate::render::Render::non_finite`].
    pub non_finite: NonFinite,
    /// What its film has gained.
    pub changes: Changes,
    /// As [`crate::render::Render::take_guides`].
    pub guides: Option<Guides>,
}

/// Why an engine did not do what it was asked.
#[derive(Debug, Serialize, Deserialize)]
pub enum Failure {
    /// As the engine says.
    Render(RenderError),
    /// It panicked.
    Panic,
}

/// A [`DeviceInfo`], whose `engine` is a word of the program's own.
#[derive(Debug, Serialize, Deserialize)]
pub struct Device {
    is_gpu: bool,
    name: String,
    backend: String,
    driver: String,
    hardware: bool,
}

impl From<&DeviceInfo> for Device {
    fn from(info: &DeviceInfo) -> Self {
        let DeviceInfo { engine, name, backend, driver, hardware } = info.clone();
        Self { is_gpu: engine == "gpu", name, backend, driver, hardware }
    }
}

impl From<Device> for DeviceInfo {
    fn from(device: Device) -> Self {
        let Device { is_gpu, name, backend, driver, hardware } = device;
        Self { engine: if is_gpu { "gpu" } else { "cpu" }, name, backend, driver, hardware }
    }
}

/// An ask, and the body that follows it.
pub fn ask(head: Ask, body: &impl Serialize) -> postcard::Result<Vec<u8>> {
    postcard::to_extend(body, postcard::to_stdvec(&head)?)
}
