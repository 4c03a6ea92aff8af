//! Server-Sent Events of a job.

use crate::support::{Server, agent, endless, tiny};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader};
use std::time::{Duration, Instant};

/// An event as it came.
#[derive(Debug)]
pub struct Heard {
    pub id: u64,
    pub kind: String,
    pub data: Value,
    pub at: Instant,
}

/// Listens to a job until the stream ends or `enough`.
pub fn listen(server: &Server, job: &str, last: Option<u64>, enough: impl Fn(&[Heard]) -> bool) -> Vec<Heard> {
    listen_at(server, &format!("/v1/jobs/{job}/events"), last, enough)
}

/// The same of any stream.
pub fn listen_at(server: &Server, path: &str, last: Option<u64>, enough: impl Fn(&[Heard]) -> bool) -> Vec<Heard> {
    let mut request = agent().get(server.url(path));
    if let Some(last) = last {
        request = request.header("last-event-id", last.to_string());
    }
    let response = request.call().expect("a reply");
    assert_eq!(response.headers()["content-type"], "text/event-stream");
    let (mut heard, mut fields) = (Vec::new(), [const { String::new() }; 3]);
    for line in BufReader::new(response.into_body().into_reader()).lines().map_while(Result::ok) {
        match line.split_once(':').map(|(name, value)| (name, value.trim())) {
            Some(("id", value)) => fields[0] = value.to_owned(),
            Some(("event", value)) => fields[1] = value.to_owned(),
            Some(("data", value)) => fields[2] = value.to_owned(),
            None if line.is_empty() && !fields[1].is_empty() => {
                let [id, kind, data] = std::mem::take(&mut fields);
                let data = serde_json::from_str(&data).expect("JSON");
                heard.push(Heard { id: id.parse().expect("a number"), kind, data, at: Instant::now() });
                if enough(&heard) {
                    return heard;
                }
            }
            _ => {}
        }
    }
    heard
}

fn kinds(heard: &[Heard]) -> Vec<&str> {
    heard.iter().map(|event| event.kind.as_str()).collect()
}

#[test]
fn events_come_in_order_and_end_with_the_job() {
    let server = Server::start();
    let id = server.begin(&server.upload(), &json!({ "width": 16, "height": 8, "max_samples": 300 }));
    let heard = listen(&server, &id, None, |_| false);
    let kinds = kinds(&heard);
    assert_eq!((kinds.first(), kinds.last()), (Some(&"queued"), Some(&"completed")), "{kinds:?}");
    assert_eq!(kinds.iter().position(|kind| *kind == "started"), Some(1), "{kinds:?}");
    assert!(kinds.contains(&"progress"), "{kinds:?}");
    assert!(heard.is_sorted_by(|a, b| a.id < b.id), "{heard:?}");
    let end = &heard[heard.len() - 1].data;
    assert_eq!(end["report"]["samples"], 300);
    assert_eq!(end["result"], format!("/v1/jobs/{id}/result"));
}

#[test]
fn who_comes_back_hears_only_what_is_new() {
    let server = Server::start();
    let id = server.begin(&server.upload(), &tiny());
    server.wait_for(&id, &["succeeded"]);
    let all = listen(&server, &id, None, |_| false);
    let after = listen(&server, &id, Some(all[0].id), |_| false);
    assert_eq!(kinds(&after), kinds(&all[1..]));
    let last = all[all.len() - 1].id.to_string();
    let nothing = server.send("GET", &format!("/v1/jobs/{id}/events"), &[("last-event-id", &last)], &[]);
    assert_eq!(nothing.status, 204);
}

#[test]
fn previews_come_at_most_twice_a_second() {
    let server = Server::start();
    let id = server.begin(&server.upload(), &endless());
    let previews = |heard: &[Heard]| heard.iter().filter(|event| event.kind == "preview").count();
    let heard = listen(&server, &id, None, |heard| previews(heard) == 4);
    let shown: Vec<_> = heard.iter().filter(|event| event.kind == "preview").collect();
    assert!(shown[3].at - shown[0].at > Duration::from_millis(1300), "{:?}", shown[3].at - shown[0].at);
    let picture = server.get(shown[3].data["url"].as_str().expect("a URL"));
    assert_eq!((picture.status, picture.header("content-type")), (200, Some("image/jpeg")));
}

#[test]
fn a_cancelled_job_ends_its_stream() {
    let server = Server::start();
    let id = server.begin(&server.upload(), &endless());
    server.wait_for(&id, &["running"]);
    let heard = std::thread::scope(|scope| {
        let listener = scope.spawn(|| listen(&server, &id, None, |_| false));
        std::thread::sleep(Duration::from_millis(100));
        server.send("POST", &format!("/v1/jobs/{id}/cancel"), &[], &[]);
        listener.join().expect("a listener")
    });
    assert_eq!(kinds(&heard).last(), Some(&"cancelled"));
}

#[test]
fn an_unknown_job_has_no_events() {
    Server::start().get("/v1/jobs/nothing/events").problem(404, "job_not_found");
}

#[test]
fn progress_tells_the_error_and_the_time_left() {
    let server = Server::start();
    let params = json!({ "width": 64, "height": 64, "max_samples": 4_000_000, "deadline_ms": 60_000 });
    let id = server.begin(&server.upload(), &params);
    let measured = |heard: &Heard| heard.kind == "progress" && heard.data["error"].is_number();
    let heard = listen(&server, &id, None, |heard| heard.iter().any(measured));
    let progress = &heard.iter().find(|heard| measured(heard)).expect("an error").data;
    assert!(progress["error_bound_95"].as_f64() >= progress["error"].as_f64(), "{progress}");
    assert!(progress["samples"].as_u64() > Some(0), "{progress}");
    let left = progress["eta_seconds"].as_f64().expect("seconds");
    assert!(left > 0.0 && left <= 60.0, "the deadline comes before max_samples: {left} s left");
    server.send("POST", &format!("/v1/jobs/{id}/cancel"), &[], &[]);
}
