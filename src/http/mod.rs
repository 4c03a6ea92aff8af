//! HTTP on top of [`jobs`](crate::jobs): the only room that knows axum.

mod accept;
mod events;
mod health;
mod images;
mod jobs;
mod pages;
mod picture;
mod problem;
mod query;
mod render;
pub mod router;
mod scenes;
mod upload;

use crate::jobs::Service;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::sync::Semaphore;

/// What handlers share.
#[derive(Clone)]
pub struct App {
    /// The service.
    pub service: Service,
    /// Places for bodies that are read at the same time: they are held in memory.
    pub uploads: Arc<Semaphore>,
}

/// Time after the last job in which clients can still fetch its result.
const LINGER: Duration = Duration::from_secs(1);

/// Time in which open connections must end after that.
const LAST_CALL: Duration = Duration::from_secs(5);

/// Serves until `shutdown` is ready, lets the jobs under way finish for up to `patience`, ends the streams of
/// events, and returns when the connections are closed.
pub async fn serve(
    listener: TcpListener,
    service: Service,
    shutdown: impl Future<Output = ()> + Send + 'static,
    patience: Duration,
) -> std::io::Result<()> {
    let router = router::router(service.clone());
    let mut closed = service.closed();
    let drained = {
        let service = service.clone();
        async move {
            shutdown.await;
            if service.drain(patience).await {
                tokio::time::sleep(LINGER).await;
            }
        }
    };
    let server = axum::serve(listener, router).with_graceful_shutdown(drained);
    let last_call = async {
        let _ = closed.wait_for(|closed| *closed).await;
        tokio::time::sleep(LINGER + LAST_CALL).await;
    };
    tokio::select! {
        result = server => result,
        () = last_call => Ok(()),
    }
}
