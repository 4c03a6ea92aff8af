//! Every route on one screen.

use super::host::{self, Hosts};
use super::keys::Scope;
use super::metrics::{self, Traffic};
use super::upload::Room;
use super::{Access, App, access, batches, events, health, images, jobs, origin, pages, problem, render, scenes};
use crate::jobs::Service;
use axum::Router;
use axum::extract::DefaultBodyLimit;
use axum::middleware::{from_fn, from_fn_with_state};
use axum::routing::{MethodRouter, delete, get, post, put};
use tower_http::catch_panic::CatchPanicLayer;

/// A row of the table: method, path, the scope that a key needs (none: everybody may), what answers. `GET` answers `HEAD` too.
type Row = (&'static str, &'static str, Option<Scope>, MethodRouter<App>);

const OPEN: Option<Scope> = None;
const READ: Option<Scope> = Some(Scope::Read);
const RENDER: Option<Scope> = Some(Scope::Render);
const ADMIN: Option<Scope> = Some(Scope::Admin);

fn table(json_bytes: usize, manifest_bytes: usize) -> Vec<Row> {
    vec![
        ("POST", "/v1/render", RENDER, post(render::render)),
        ("POST", "/v1/scenes", RENDER, post(scenes::create)),
        ("GET", "/v1/scenes", READ, get(scenes::list)),
        ("GET", "/v1/scenes/{id}", READ, get(scenes::show)),
        ("DELETE", "/v1/scenes/{id}", ADMIN, delete(scenes::remove)),
        ("POST", "/v1/images", RENDER, post(images::create)),
        ("GET", "/v1/images/{id}", READ, get(images::show)),
        ("DELETE", "/v1/images/{id}", ADMIN, delete(images::remove)),
        ("POST", "/v1/jobs", RENDER, post(jobs::create).layer(DefaultBodyLimit::max(json_bytes))),
        ("GET", "/v1/jobs", READ, get(jobs::list)),
        ("PUT", "/v1/jobs/{id}", RENDER, put(jobs::create_named).layer(DefaultBodyLimit::max(json_bytes))),
        ("GET", "/v1/jobs/{id}", READ, get(jobs::show)),
        ("DELETE", "/v1/jobs/{id}", RENDER, delete(jobs::remove)),
        ("GET", "/v1/jobs/{id}/events", READ, get(events::stream)),
        ("GET", "/v1/jobs/{id}/preview", READ, get(jobs::preview)),
        ("GET", "/v1/jobs/{id}/result", READ, get(jobs::result)),
        ("POST", "/v1/jobs/{id}/cancel", RENDER, post(jobs::cancel)),
        ("POST", "/v1/batches", RENDER, post(batches::create).layer(DefaultBodyLimit::max(manifest_bytes))),
        ("GET", "/v1/batches", READ, get(batches::list)),
        ("GET", "/v1/batches/{id}", READ, get(batches::show)),
        ("DELETE", "/v1/batches/{id}", RENDER, delete(batches::remove)),
        ("GET", "/v1/batches/{id}/events", READ, get(events::stream_batch)),
        ("GET", "/v1/batches/{id}/results", READ, get(batches::results)),
        ("POST", "/v1/batches/{id}/cancel", RENDER, post(batches::cancel)),
        ("GET", "/v1/limits", READ, get(health::limits)),
        ("GET", "/metrics", ADMIN, get(metrics::show)),
        ("GET", "/healthz", OPEN, get(health::alive)),
        ("GET", "/readyz", OPEN, get(health::ready)),
        ("GET", "/openapi.json", OPEN, get(pages::openapi_json)),
        ("GET", "/openapi.yaml", OPEN, get(pages::openapi_yaml)),
        ("GET", "/docs", OPEN, get(pages::reference)),
        ("GET", "/docs/errors", OPEN, get(pages::errors)),
        ("GET", "/", OPEN, get(pages::index)),
    ]
}

/// Method, path and scope of every route, for the test that compares them with `openapi.yaml`.
pub fn routes() -> Vec<(&'static str, &'static str, Option<Scope>)> {
    table(0, 0).into_iter().map(|(method, path, scope, _)| (method, path, scope)).collect()
}

/// The whole application; what the table does not name is a file of the page, or a 404.
pub fn router(service: Service, traffic: &Traffic, access: &Access, hosts: Hosts) -> Router {
    let upload_bytes = usize::try_from(service.limits().upload_bytes).unwrap_or(usize::MAX);
    let room = Room::new(service.limits());
    let guarded = |scope: Option<Scope>, answer: MethodRouter<App>| match scope {
        Some(scope) => {
            let access = access.clone();
            answer.route_layer(from_fn(move |request, next| access::check(access.clone(), scope, request, next)))
        }
        None => answer,
    };
    table(service.limits().json_bytes, service.limits().manifest_bytes)
        .into_iter()
        .fold(Router::new(), |router, (_, path, scope, answer)| router.route(path, guarded(scope, answer)))
        .fallback(pages::file)
        .layer(DefaultBodyLimit::max(upload_bytes))
        .layer(CatchPanicLayer::new())
        .layer(from_fn(origin::check))
        .layer(from_fn_with_state(hosts, host::check))
        .layer(from_fn_with_state(traffic.clone(), problem::dress))
        .with_state(App { service, room, traffic: traffic.clone() })
}
