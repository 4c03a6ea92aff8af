//! A server of this process.

use crate::config::Limits;
use crate::http;
use crate::jobs::Service;
use crate::render::Engines;
use anyhow::{Context, Result};
use std::net::SocketAddr;
use std::sync::mpsc;
use std::thread::JoinHandle;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::sync::oneshot;

/// A server with an engine of its own. Dropping it shuts it down and waits for its end.
pub struct Server {
    /// Where it listens.
    pub address: SocketAddr,
    stop: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<Result<()>>>,
}

impl Server {
    /// Starts one on a free port.
    pub fn start(mut limits: Limits) -> Result<Self> {
        // What is measured is rendering.
        limits.result_cache = false;
        let (stop, stopped) = oneshot::channel();
        let (tell, told) = mpsc::channel();
        let thread = std::thread::spawn(move || {
            tokio::runtime::Runtime::new()?.block_on(async move {
                let listener = TcpListener::bind("127.0.0.1:0").await?;
                let service = Service::start(limits, Box::new(|| Ok(Box::new(Engines::new())))).await?;
                tell.send(listener.local_addr()?)?;
                let shutdown = async {
                    let _ = stopped.await;
                };
                Ok(http::serve(listener, service, &http::Access::default(), shutdown, Duration::ZERO).await?)
            })
        });
        let address = told.recv().context("the server did not start")?;
        Ok(Self { address, stop: Some(stop), thread: Some(thread) })
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        // Dropping the sender stops the server as sending does.
        self.stop = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}
