//! `GET /v1/jobs/{id}/events`, `GET /v1/batches/{id}/events`: news as Server-Sent Events.

use super::App;
use super::metrics::Counted;
use crate::jobs::{Code, Event as News, EventLog, Problem, describe_item};
use axum::extract::{Path, State};
use axum::http::{HeaderMap, StatusCode};
use axum::response::sse::{Event, KeepAlive, Sse};
use axum::response::{IntoResponse, Response};
use std::convert::Infallible;
use std::time::Duration;
use tokio::sync::{mpsc, watch};
use tokio_stream::wrappers::ReceiverStream;

/// Silence after which a comment keeps the connection open.
const KEEP_ALIVE: Duration = Duration::from_secs(15);

/// Time in which a stream may still send its last event when the service is over.
const LAST_WORDS: Duration = Duration::from_secs(1);

type Sent = Result<Event, Infallible>;

/// `GET /v1/jobs/{id}/events`: from the beginning, or after `Last-Event-ID`; ends with the job.
/// 204 to those who have seen the last event: browsers then stop asking.
pub async fn stream(State(app): State<App>, Path(id): Path<String>, headers: HeaderMap) -> Result<Response, Problem> {
    let job = app.service.job(&id).await?;
    let seen = last_event(&headers)?;
    if job.is_over() && job.events.after(seen).is_empty() {
        return Ok(StatusCode::NO_CONTENT.into_response());
    }
    Ok(respond(&app, move |sender| async move {
        let _audience = job.events.join_audience();
        send_all(&job.events, seen, &sender).await;
    }))
}

/// `GET /v1/batches/{id}/events`: each item once it and those before it are over, then the end; after `Last-Event-ID`, or all.
pub async fn stream_batch(
    State(app): State<App>,
    Path(id): Path<String>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let batch = app.service.batch(&id).await?;
    let seen = usize::try_from(last_event(&headers)?).unwrap_or(usize::MAX);
    if seen > batch.jobs.len() && batch.jobs.iter().all(|job| job.is_over()) {
        return Ok(StatusCode::NO_CONTENT.into_response());
    }
    Ok(respond(&app, move |sender| async move {
        for (index, job) in batch.jobs.iter().enumerate().skip(seen) {
            job.finished().await;
            let event = Event::default().id((index + 1).to_string()).event("item");
            if sender.send(Ok(event.data(describe_item(job).to_string()))).await.is_err() {
                return;
            }
        }
        let event = Event::default().id((batch.jobs.len() + 1).to_string()).event("finished");
        // Nobody may listen any more.
        let _ = sender.send(Ok(event.data(batch.summary().to_string()))).await;
    }))
}

/// A stream of what `send` sends, until it is done, nobody listens, or the service is over.
fn respond<F>(app: &App, send: impl FnOnce(mpsc::Sender<Sent>) -> F) -> Response
where
    F: Future<Output = ()> + Send + 'static,
{
    let (sender, receiver) = mpsc::channel(1);
    let counted = Counted::by(&app.traffic.streams);
    let (sending, closed) = (send(sender.clone()), app.service.closed());
    tokio::spawn(async move {
        let _counted = counted;
        until_the_end(sending, closed, sender).await;
    });
    Sse::new(ReceiverStream::new(receiver)).keep_alive(KeepAlive::new().interval(KEEP_ALIVE)).into_response()
}

/// `Last-Event-ID`; none: from the beginning.
fn last_event(headers: &HeaderMap) -> Result<u64, Problem> {
    let Some(value) = headers.get("last-event-id") else { return Ok(0) };
    let is_number = |text: &&str| text.bytes().all(|byte| byte.is_ascii_digit());
    let id = value.to_str().ok().filter(is_number).and_then(|text| text.parse().ok());
    id.ok_or_else(|| Problem::new(Code::BadRequest, "`Last-Event-ID` must be the id of an event, a whole number"))
}

async fn until_the_end(
    sending: impl Future<Output = ()>,
    mut closed: watch::Receiver<bool>,
    sender: mpsc::Sender<Sent>,
) {
    tokio::pin!(sending);
    tokio::select! {
        () = &mut sending => return,
        () = sender.closed() => return,
        _ = closed.wait_for(|closed| *closed) => {}
    }
    // By now all jobs are over, or wait for the next process: whoever comes back then hears the rest.
    let _ = tokio::time::timeout(LAST_WORDS, sending).await;
}

async fn send_all(log: &EventLog, mut seen: u64, sender: &mpsc::Sender<Sent>) {
    let mut newest = log.subscribe();
    loop {
        newest.mark_unchanged();
        for event in log.after(seen) {
            seen = event.id;
            let sent = sender.send(Ok(on_the_wire(&event))).await.is_ok();
            if event.kind.is_last() || !sent {
                return;
            }
        }
        if newest.changed().await.is_err() {
            return;
        }
    }
}

fn on_the_wire(event: &News) -> Event {
    Event::default().id(event.id.to_string()).event(event.kind.name()).data(event.data.to_string())
}
