//! HTTP on top of [`jobs`](crate::jobs): the only room that knows axum.

mod accept;
mod events;
mod health;
mod images;
mod jobs;
mod listen;
mod metrics;
mod origin;
mod pages;
mod picture;
mod problem;
mod query;
mod render;
pub mod router;
mod scenes;
mod upload;

pub use listen::serve;

use crate::jobs::Service;
use axum::extract::Request;
use metrics::Traffic;
use std::net::{IpAddr, Ipv4Addr};
use upload::Room;

/// What handlers share.
#[derive(Clone)]
pub struct App {
    /// The service.
    pub service: Service,
    /// Memory for bodies that are being read.
    pub room: Room,
    /// What is counted of requests.
    pub traffic: Traffic,
}

/// Where a request comes from.
#[derive(Debug, Clone, Copy)]
struct Peer(IpAddr);

/// Who asks, for sharing the device: the address at the other end of the connection.
fn client(request: &Request) -> String {
    let peer = request.extensions().get::<Peer>().copied().unwrap_or(Peer(Ipv4Addr::LOCALHOST.into()));
    peer.0.to_canonical().to_string()
}
