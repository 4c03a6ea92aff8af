//! What ends early: a request whose key is revoked while it waits, and a stream that is sent.

use axum::body::{Body, Bytes, HttpBody};
use axum::response::Response;
use hyper::body::Frame;
use std::pin::Pin;
use std::task::{Context, Poll};

type End = Pin<Box<dyn Future<Output = ()> + Send>>;

/// The answer, unless the end comes first; if it is a stream, that breaks off at the end.
pub async fn unless(
    end: impl Future<Output = ()> + Send + 'static,
    answer: impl Future<Output = Response>,
) -> Option<Response> {
    let mut end: End = Box::pin(end);
    let response = tokio::select! {
        response = answer => response,
        () = &mut end => return None,
    };
    // What is at hand is sent.
    let is_stream = response.body().size_hint().exact().is_none();
    Some(if is_stream { response.map(|body| Body::new(Until { body, end: Some(end) })) } else { response })
}

/// A body that breaks off.
struct Until {
    body: Body,
    /// None once it has come.
    end: Option<End>,
}

impl HttpBody for Until {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        let Some(end) = &mut self.end else { return Poll::Ready(None) };
        if end.as_mut().poll(context).is_pending() {
            return Pin::new(&mut self.body).poll_frame(context);
        }
        self.end = None;
        // Whoever reads must not take a part for the whole.
        Poll::Ready(Some(Err(axum::Error::new("the key was revoked"))))
    }
}
