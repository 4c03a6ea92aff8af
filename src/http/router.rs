//! Every route on one screen.

use super::metrics::{self, Traffic};
use super::upload::{Room, TEXT_BYTES};
use super::{App, events, health, images, jobs, origin, pages, problem, render, scenes};
use crate::jobs::Service;
use axum::Router;
use axum::extract::DefaultBodyLimit;
use axum::routing::{MethodRouter, delete, get, post, put};
use tower_http::catch_panic::CatchPanicLayer;

/// A row of the table: method, path, what answers. `GET` answers `HEAD` too.
type Row = (&'static str, &'static str, MethodRouter<App>);

fn table() -> Vec<Row> {
    vec![
        ("POST", "/v1/render", post(render::render)),
        ("POST", "/v1/scenes", post(scenes::create)),
        ("GET", "/v1/scenes", get(scenes::list)),
        ("GET", "/v1/scenes/{id}", get(scenes::show)),
        ("DELETE", "/v1/scenes/{id}", delete(scenes::remove)),
        ("POST", "/v1/images", post(images::create)),
        ("GET", "/v1/images/{id}", get(images::show)),
        ("DELETE", "/v1/images/{id}", delete(images::remove)),
        ("POST", "/v1/jobs", post(jobs::create).layer(DefaultBodyLimit::max(TEXT_BYTES))),
        ("GET", "/v1/jobs", get(jobs::list)),
        ("PUT", "/v1/jobs/{id}", put(jobs::create_named).layer(DefaultBodyLimit::max(TEXT_BYTES))),
        ("GET", "/v1/jobs/{id}", get(jobs::show)),
        ("GET", "/v1/jobs/{id}/events", get(events::stream)),
        ("GET", "/v1/jobs/{id}/preview", get(jobs::preview)),
        ("GET", "/v1/jobs/{id}/result", get(jobs::result)),
        ("POST", "/v1/jobs/{id}/cancel", post(jobs::cancel)),
        ("GET", "/v1/limits", get(health::limits)),
        ("GET", "/metrics", get(metrics::show)),
        ("GET", "/healthz", get(health::alive)),
        ("GET", "/readyz", get(health::ready)),
        ("GET", "/openapi.json", get(pages::openapi_json)),
        ("GET", "/openapi.yaml", get(pages::openapi_yaml)),
        ("GET", "/docs/errors", get(pages::errors)),
        ("GET", "/", get(pages::index)),
    ]
}

/// Method and path of every route, for the test that compares them with `openapi.yaml`.
pub fn routes() -> Vec<(&'static str, &'static str)> {
    table().into_iter().map(|(method, path, _)| (method, path)).collect()
}

/// The whole application; what the table does not name is a file of the page, or a 404.
pub fn router(service: Service, traffic: &Traffic) -> Router {
    let upload_bytes = usize::try_from(service.limits().upload_bytes).unwrap_or(usize::MAX);
    let room = Room::new(service.limits());
    table()
        .into_iter()
        .fold(Router::new(), |router, (_, path, answer)| router.route(path, answer))
        .fallback(pages::file)
        .layer(DefaultBodyLimit::max(upload_bytes))
        .layer(CatchPanicLayer::new())
        .layer(axum::middleware::from_fn(origin::check))
        .layer(axum::middleware::from_fn_with_state(traffic.clone(), problem::dress))
        .with_state(App { service, room, traffic: traffic.clone() })
}
