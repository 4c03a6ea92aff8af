//! HTTP on top of [`jobs`](crate::jobs): the only room that knows axum.

mod accept;
mod access;
mod archive;
mod batches;
mod events;
mod health;
mod host;
mod images;
mod jobs;
pub mod keys;
mod list;
mod listen;
mod metrics;
mod origin;
mod pages;
mod picture;
mod prefer;
mod problem;
mod query;
mod render;
mod revoked;
pub mod router;
mod scenes;
mod span;
mod upload;

pub use access::Access;
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

/// Who asks.
#[derive(Debug, Clone)]
struct Caller {
    /// For sharing the device, and for the log: the name of the key, else the address at the other end of the connection.
    client: String,
    /// Whether that is a key.
    has_key: bool,
    /// Quota of the key.
    renders_per_day: Option<u64>,
}

/// Who has asked, as a reply carries it to the log.
#[derive(Debug, Clone)]
struct Client(String);

fn caller(request: &Request) -> Caller {
    request.extensions().get::<Caller>().cloned().unwrap_or_else(|| {
        let peer = request.extensions().get::<Peer>().copied().unwrap_or(Peer(Ipv4Addr::LOCALHOST.into()));
        Caller { client: peer.0.to_canonical().to_string(), has_key: false, renders_per_day: None }
    })
}
