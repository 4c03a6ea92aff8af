//! Connections: how many at a time, how long a request's head may take, and how they end.

use super::host::Hosts;
use super::metrics::{Counted, Traffic};
use super::{Access, Peer, router};
use crate::jobs::Service;
use axum::body::Body;
use axum::http::Request;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::server::graceful::GracefulShutdown;
use hyper_util::service::TowerToHyperService;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tower::ServiceExt;

/// Time after the last job in which clients can still fetch its result.
const LINGER: Duration = Duration::from_secs(1);

/// Time in which open connections must end after that.
const LAST_CALL: Duration = Duration::from_secs(5);

/// Pause after a connection could not be accepted, as when there are too many open files.
const BREATH: Duration = Duration::from_millis(100);

/// Serves until `shutdown` is ready, lets the jobs under way finish for up to `patience`, ends the streams of
/// events, and returns when the connections are closed.
pub async fn serve(
    listener: TcpListener,
    service: Service,
    access: &Access,
    shutdown: impl Future<Output = ()> + Send + 'static,
    patience: Duration,
) -> std::io::Result<()> {
    let drained = {
        let service = service.clone();
        async move {
            shutdown.await;
            if service.drain(patience).await {
                tokio::time::sleep(LINGER).await;
            }
        }
    };
    let connections = GracefulShutdown::new();
    tokio::select! {
        () = accept_all(&listener, &service, access, &connections) => {}
        () = drained => {}
    }
    drop(listener);
    // Connections that do not end by themselves are cut off with the process.
    let _ = tokio::time::timeout(LAST_CALL, connections.shutdown()).await;
    service.close().await;
    Ok(())
}

/// Accepts connections as long as there are places. Never ends.
async fn accept_all(listener: &TcpListener, service: &Service, access: &Access, connections: &GracefulShutdown) {
    let limits = service.limits();
    let places = Arc::new(Semaphore::new(limits.connections.max(1)));
    let traffic = Traffic::new();
    let is_loopback = listener.local_addr().is_ok_and(|address| address.ip().is_loopback());
    let router = router::router(service.clone(), &traffic, access, Hosts::new(&access.hosts, is_loopback));
    let mut http = http1::Builder::new();
    // A head that does not arrive ends its connection, and so does silence between two requests.
    http.timer(TokioTimer::new()).header_read_timeout(Duration::from_secs(limits.header_seconds.max(1)));
    loop {
        let place = Arc::clone(&places).acquire_owned().await;
        match listener.accept().await {
            Ok((stream, address)) => connect(
                &http,
                stream,
                address,
                router.clone(),
                connections,
                (place.ok(), Counted::by(&traffic.connections)),
            ),
            Err(error) => {
                tracing::debug!(%error, "a connection could not be accepted");
                tokio::time::sleep(BREATH).await;
            }
        }
    }
}

fn connect(
    http: &http1::Builder,
    stream: TcpStream,
    address: SocketAddr,
    router: axum::Router,
    connections: &GracefulShutdown,
    place: (Option<OwnedSemaphorePermit>, Counted),
) {
    // Events and small replies leave at once.
    let _ = stream.set_nodelay(true);
    let router = router.map_request(move |request: Request<Incoming>| {
        let mut request = request.map(Body::new);
        request.extensions_mut().insert(Peer(address.ip()));
        request
    });
    let connection = http.serve_connection(TokioIo::new(stream), TowerToHyperService::new(router));
    let connection = connections.watch(connection);
    tokio::spawn(async move {
        let _place = place;
        if let Err(error) = connection.await {
            tracing::debug!(%error, "a connection ended early");
        }
    });
}
