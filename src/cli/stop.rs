//! SIGTERM and SIGINT (elsewhere than on Unix: Ctrl-C).

use std::io;
#[cfg(unix)]
use tokio::signal::unix::{Signal, SignalKind, signal};

/// The signals that ask a process to end; from when this is made they end it no more by themselves.
pub struct Stops {
    #[cfg(unix)]
    terminate: Signal,
    #[cfg(unix)]
    interrupt: Signal,
}

impl Stops {
    /// Must be called within a runtime.
    pub fn new() -> io::Result<Self> {
        Ok(Self {
            #[cfg(unix)]
            terminate: signal(SignalKind::terminate())?,
            #[cfg(unix)]
            interrupt: signal(SignalKind::interrupt())?,
        })
    }

    /// Waits for the next one; answers the exit code that shells know it by.
    pub async fn next(&mut self) -> u8 {
        #[cfg(unix)]
        return tokio::select! {
            _ = self.terminate.recv() => 128 + 15,
            _ = self.interrupt.recv() => 128 + 2,
        };
        #[cfg(not(unix))]
        {
            let _ = tokio::signal::ctrl_c().await;
            128 + 2
        }
    }
}

/// At the first signal does something, and then ends the process; at the second ends it at once. Where signals cannot be heard they do
/// what they do by themselves.
pub fn on_stop(last: impl FnOnce() + Send + 'static) {
    std::thread::spawn(move || {
        let Ok(runtime) = tokio::runtime::Builder::new_current_thread().enable_all().build() else { return };
        runtime.block_on(async {
            let Ok(mut stops) = Stops::new() else { return };
            let code = stops.next().await;
            tokio::select! {
                _ = tokio::task::spawn_blocking(last) => {}
                _ = stops.next() => {}
            }
            std::process::exit(code.into());
        });
    });
}
