//! Whether the server lives, whether it takes work, and how much.

use super::App;
use crate::denoise::Denoiser;
use crate::jobs::{Code, Problem};
use axum::Json;
use axum::extract::State;
use serde_json::{Value, json};

/// `GET /healthz`
pub async fn alive() -> Json<Value> {
    Json(json!({ "status": "ok" }))
}

/// `GET /readyz`: 503 while shutting down, or while nothing can be stored.
pub async fn ready(State(app): State<App>) -> Result<Json<Value>, Problem> {
    if app.service.is_draining() {
        return Err(Problem::new(Code::ShuttingDown, "the server finishes its last jobs").retry_after(2));
    }
    if app.service.is_stuck() {
        let detail = "the server cannot write its data; its log says more";
        return Err(Problem::new(Code::StorageUnavailable, detail).retry_after(2));
    }
    Ok(Json(json!({ "status": "ready" })))
}

/// `GET /v1/limits`
pub async fn limits(State(app): State<App>) -> Json<Value> {
    let limits = app.service.limits();
    let mut value = json!(limits);
    value["scene"] = json!(limits.scene());
    value["params"] = json!(limits.params());
    value["denoiser"] = json!(app.service.denoiser().map(Denoiser::name));
    Json(value)
}
