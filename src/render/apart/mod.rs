//! An engine in a process of its own: what a driver or a scene does to it, be it a crash, a hang or a `kill -9`, ends that process
//! alone. Here it is a lost device, after which a new process goes on from the films, of which this side has a copy.
//!
//! One process holds the device and all renders under way. Both ends are this program, so that nothing on the wire has versions.

mod host;
mod link;
mod wire;

pub use host::host;
pub use link::ApartEngine;
