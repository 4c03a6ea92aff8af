use super::*;
use crate::jobs::batch::BatchSpec;
use crate::jobs::blobs::BlobRef;
use crate::jobs::events::{Event, EventKind};
use crate::jobs::job::{Place, Spec};
use crate::jobs::outcome::{Outcome, Record};
use crate::jobs::problem::{Code, Problem};
use crate::jobs::state::State;
use crate::params::RenderParams;
use serde_json::json;
use std::sync::Arc;

fn blob(id: &str, bytes: u64) -> BlobRef {
    BlobRef { id: id.to_owned(), bytes }
}

fn spec(number: i64) -> Spec {
    Spec {
        number,
        id: format!("job-{number}"),
        key: Some(format!("key {number}")),
        created: 1_700_000_000_123,
        scene: "sha256-s".to_owned(),
        image: None,
        params: RenderParams { exposure: 0.1, target_error: Some(0.1 + 0.2), ..RenderParams::default() },
        priority: -7,
        client: "10.1.2.3".to_owned(),
        attended: false,
        content: "content".to_owned(),
        place: None,
        webhook: None,
    }
}

fn event(id: u64, kind: EventKind) -> Event {
    Event { id, kind, data: json!({ "n": id }) }
}

fn outcome(file: &str) -> Outcome {
    let record = Record {
        report: json!({ "samples": 4 }),
        facts: vec![("a".to_owned(), "b".to_owned())],
        seconds: "trace=1".to_owned(),
        samples: 4,
        error: Some(0.1),
        error_bound_95: None,
        repeatable: true,
    };
    Outcome { record, file: blob(file, 10), picture: Some(blob("sha256-p", 100)) }
}

fn scene(id: &str) -> Change {
    Change::Scene { id: id.to_owned(), upload_bytes: 5, files: vec![(String::new(), blob("sha256-f", 5))] }
}

fn happens(job: i64, id: u64, kind: EventKind, standing: Option<Standing>) -> Change {
    Change::Event { job, event: event(id, kind), standing }
}

async fn with_job(number: i64) -> Ledger {
    let ledger = Ledger::open(None).unwrap();
    ledger.commit(scene("sha256-s")).await.unwrap();
    ledger.commit(Change::Job(Arc::new(spec(number)), event(1, EventKind::Queued))).await.unwrap();
    ledger
}

async fn sound(ledger: &Ledger) {
    assert_eq!(ledger.ask(audit).await.unwrap(), Vec::<String>::new());
}

fn all() -> Kept {
    Kept { jobs: 100, result_bytes: 1000, upload_bytes: 1000, age: 1_000_000 }
}

#[tokio::test]
async fn a_job_is_read_back_as_it_was_written() {
    let ledger = with_job(3).await;
    let changes = [
        happens(3, 2, EventKind::Started, Some(Standing::Running)),
        happens(3, 3, EventKind::Progress, None),
        Change::Film { job: 3, blob: blob("sha256-film", 7) },
        happens(3, 4, EventKind::Progress, None),
    ];
    for change in changes {
        ledger.commit(change).await.unwrap();
    }
    let job = ledger.ask(jobs).await.unwrap().remove(0);
    assert_eq!((job.spec, job.state, job.last_event), (spec(3), State::Running, 4));
    assert_eq!(job.film.as_deref(), Some("sha256-film"));
    assert_eq!(job.events.iter().map(|event| event.id).collect::<Vec<_>>(), [1, 2, 4], "progress is superseded");
    sound(&ledger).await;

    let done = Standing::Succeeded(Arc::new(outcome("sha256-r")));
    ledger.commit(happens(3, 5, EventKind::Completed, Some(done))).await.unwrap();
    let job = ledger.ask(jobs).await.unwrap().remove(0);
    let found = job.outcome.unwrap();
    assert_eq!((found.record, found.file), (outcome("sha256-r").record, blob("sha256-r", 10)));
    assert_eq!((job.state, job.film), (State::Succeeded, None));
    assert_eq!(ledger.ask(unused_blobs).await.unwrap(), ["sha256-film"]);
    assert_eq!(ledger.ask(next_number).await.unwrap(), 4);
    sound(&ledger).await;
}

#[tokio::test]
async fn what_is_over_stays_over_and_the_rest_of_a_batch_is_written() {
    let ledger = with_job(1).await;
    let problem = Problem::new(Code::Internal, "a fault");
    let first = ledger.commit(happens(1, 2, EventKind::Failed, Some(Standing::Failed(problem.clone()))));
    let second = ledger.commit(happens(1, 3, EventKind::Cancelled, Some(Standing::Cancelled)));
    let third = ledger.commit(scene("sha256-other"));
    first.await.unwrap();
    assert!(matches!(second.await, Err(LedgerError::Refused(_))));
    third.await.unwrap();
    let job = ledger.ask(jobs).await.unwrap().remove(0);
    assert_eq!((job.state, job.problem), (State::Failed, Some(problem)));
    sound(&ledger).await;
}

#[tokio::test]
async fn an_id_of_an_event_is_never_given_out_twice() {
    let ledger = with_job(1).await;
    assert!(ledger.commit(happens(1, 1, EventKind::Progress, None)).await.is_err());
}

#[tokio::test]
async fn a_job_needs_its_scene() {
    let ledger = Ledger::open(None).unwrap();
    let job = || Change::Job(Arc::new(spec(1)), event(1, EventKind::Queued));
    assert!(matches!(ledger.commit(job()).await, Err(LedgerError::Refused(_))));
    ledger.commit(scene("sha256-s")).await.unwrap();
    ledger.commit(job()).await.unwrap();
    assert!(matches!(ledger.commit(job()).await, Err(LedgerError::Refused(_))), "the same id again");
}

#[tokio::test]
async fn a_scene_that_is_deleted_stays_while_a_job_needs_it() {
    let ledger = with_job(1).await;
    let leaving = || async { ledger.ask(|c| Leaving::choose(c, &all())).await.unwrap() };
    ledger.commit(Change::DeleteScene("sha256-s".to_owned())).await.unwrap();
    assert!(ledger.commit(Change::UseScene("sha256-s".to_owned())).await.is_err());
    assert!(leaving().await.is_empty());
    ledger.commit(happens(1, 2, EventKind::Cancelled, Some(Standing::Cancelled))).await.unwrap();
    assert_eq!(leaving().await.scenes, ["sha256-s"]);
    ledger.commit(Change::Forget(leaving().await)).await.unwrap();
    assert_eq!(ledger.ask(unused_blobs).await.unwrap(), ["sha256-f"]);
    ledger.commit(Change::DropBlobs(vec!["sha256-f".to_owned()])).await.unwrap();
    assert!(ledger.ask(known_blobs).await.unwrap().is_empty());
}

/// Jobs that have ended, each with a file of 10 bytes and a linear picture of 100, by their names.
async fn with_results(results: &[(&str, &str)]) -> Ledger {
    let ledger = Ledger::open(None).unwrap();
    ledger.commit(scene("sha256-s")).await.unwrap();
    for (number, (file, picture)) in (1..).zip(results) {
        ledger.commit(Change::Job(Arc::new(spec(number)), event(1, EventKind::Queued))).await.unwrap();
        let done = Outcome { picture: Some(blob(picture, 100)), ..outcome(file) };
        let done = Standing::Succeeded(Arc::new(done));
        ledger.commit(happens(number, 2, EventKind::Completed, Some(done))).await.unwrap();
    }
    ledger
}

/// Jobs that leave, and linear pictures.
async fn leave(ledger: &Ledger, kept: Kept) -> (Vec<i64>, Vec<i64>) {
    let leaving = ledger.ask(move |c| Leaving::choose(c, &kept)).await.unwrap();
    (leaving.jobs, leaving.pictures)
}

#[tokio::test]
async fn linear_pictures_leave_before_any_file_does() {
    let ledger = with_results(&[("a", "A"), ("b", "B"), ("c", "C"), ("d", "D")]).await;
    let leaving = |bytes| leave(&ledger, Kept { result_bytes: bytes, ..all() });
    assert_eq!(leaving(440).await, (vec![], vec![]));
    assert_eq!(leaving(439).await, (vec![], vec![1]));
    assert_eq!(leaving(240).await, (vec![], vec![2, 1]));
    assert_eq!(leaving(40).await, (vec![], vec![3, 2, 1]), "the newest stays whole");
    assert_eq!(leaving(39).await, (vec![1], vec![3, 2]));
    assert_eq!(leaving(0).await, (vec![3, 2, 1], vec![]));
    // What stays has room again once others have left for another reason.
    assert_eq!(leave(&ledger, Kept { jobs: 2, result_bytes: 220, ..all() }).await, (vec![2, 1], vec![]));

    let chosen = ledger.ask(|c| Leaving::choose(c, &Kept { result_bytes: 240, ..all() })).await.unwrap();
    ledger.commit(Change::Forget(chosen)).await.unwrap();
    assert_eq!(ledger.ask(unused_blobs).await.unwrap(), ["A", "B"]);
    assert_eq!(leaving(240).await, (vec![], vec![]));
    let found = ledger.ask(jobs).await.unwrap();
    let has: Vec<bool> = found.into_iter().map(|job| job.outcome.unwrap().picture.is_some()).collect();
    assert_eq!(has, [false, false, true, true]);
    sound(&ledger).await;
}

#[tokio::test]
async fn what_is_shared_counts_once_and_stays_while_one_needs_it() {
    let ledger = with_results(&[("a", "P"), ("b", "P"), ("b", "P")]).await;
    let leaving = |bytes| leave(&ledger, Kept { result_bytes: bytes, ..all() });
    assert_eq!(leaving(120).await, (vec![], vec![]));
    assert_eq!(leaving(119).await, (vec![], vec![]), "the newest needs it");
    assert_eq!(leaving(19).await, (vec![1], vec![]));
    assert_eq!(leaving(0).await, (vec![2, 1], vec![]), "the newest stays");
    assert_eq!(leave(&ledger, Kept { jobs: 1, ..all() }).await.0, [2, 1]);
    assert_eq!(leave(&ledger, Kept { age: -1, ..all() }).await.0, [3, 2, 1]);
}

#[tokio::test]
async fn of_a_batch_under_way_linear_pictures_leave_and_nothing_else() {
    let ledger = Ledger::open(None).unwrap();
    ledger.commit(scene("sha256-s")).await.unwrap();
    let batch = BatchSpec {
        number: 1,
        id: "batch-1".to_owned(),
        key: None,
        created: 1,
        client: "c".to_owned(),
        content: "x".to_owned(),
    };
    let item = |number: i64| {
        let place = Some(Place { batch: 1, item: number as u32 - 1, name: format!("n{number}") });
        (Arc::new(Spec { place, ..spec(number) }), event(1, EventKind::Queued))
    };
    ledger.commit(Change::Batch(Arc::new(batch), (1..=3).map(item).collect())).await.unwrap();
    for (number, name) in [(1, "1"), (2, "2")] {
        let done = Outcome { picture: Some(blob(&format!("P{name}"), 100)), ..outcome(name) };
        let done = Standing::Succeeded(Arc::new(done));
        ledger.commit(happens(number, 2, EventKind::Completed, Some(done))).await.unwrap();
    }
    assert_eq!(leave(&ledger, Kept { result_bytes: 0, age: -1, ..all() }).await, (vec![], vec![1]));
    ledger.commit(happens(3, 2, EventKind::Cancelled, Some(Standing::Cancelled))).await.unwrap();
    assert_eq!(leave(&ledger, Kept { result_bytes: 0, ..all() }).await.0, Vec::<i64>::new(), "the newest stays");
    assert_eq!(leave(&ledger, Kept { age: -1, ..all() }).await.0, [3, 2, 1], "together");
}

#[tokio::test]
async fn a_file_has_one_owner_and_outlives_it() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("ledger.sqlite");
    let ledger = Ledger::open(Some(&file)).unwrap();
    ledger.commit(scene("sha256-s")).await.unwrap();
    assert!(matches!(Ledger::open(Some(&file)), Err(LedgerError::InUse)));
    ledger.close().await;
    assert!(matches!(ledger.commit(scene("sha256-t")).await, Err(LedgerError::Closed)));
    let again = Ledger::open(Some(&file)).unwrap();
    assert!(again.ask(|c| scene_of(c, "sha256-s")).await.unwrap());
}

fn scene_of(c: &Connection, id: &str) -> rusqlite::Result<bool> {
    super::scene(c, id).map(|found| found.is_some())
}

#[tokio::test]
async fn a_newer_ledger_is_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("ledger.sqlite");
    Connection::open(&file).unwrap().pragma_update(None, "user_version", 99).unwrap();
    assert!(matches!(Ledger::open(Some(&file)), Err(LedgerError::Newer { found: 99, .. })));
}

#[tokio::test]
async fn the_audit_sees_what_is_wrong() {
    let ledger = with_job(1).await;
    ledger.commit(happens(1, 2, EventKind::Completed, None)).await.unwrap();
    ledger.commit(happens(1, 3, EventKind::Started, None)).await.unwrap();
    ledger.ask(|c| c.execute("DELETE FROM scenes", [])).await.unwrap();
    let faults = ledger.ask(audit).await.unwrap().join("\n");
    for part in ["started follows Some(Succeeded)", "its events end with", "its scene is gone"] {
        assert!(faults.contains(part), "{part}: {faults}");
    }
}

#[tokio::test]
async fn a_batch_is_written_whole_and_leaves_whole() {
    let ledger = Ledger::open(None).unwrap();
    ledger.commit(scene("sha256-s")).await.unwrap();
    let batch = Arc::new(BatchSpec {
        number: 1,
        id: "batch-1".to_owned(),
        key: Some("key".to_owned()),
        created: 1_700_000_000_123,
        client: "key:ci".to_owned(),
        content: "content".to_owned(),
    });
    let item = |number: i64| {
        let place = Some(Place { batch: 1, item: number as u32 - 1, name: format!("n{number}") });
        (
            Arc::new(Spec { place, webhook: Some("https://example.com/".to_owned()), ..spec(number) }),
            event(1, EventKind::Queued),
        )
    };
    // One of them does not fit: none is written.
    let twice = Change::Batch(Arc::clone(&batch), vec![item(1), item(1)]);
    assert!(matches!(ledger.commit(twice).await, Err(LedgerError::Refused(_))));
    assert!(ledger.ask(jobs).await.unwrap().is_empty() && ledger.ask(batches).await.unwrap().is_empty());
    ledger.commit(Change::Batch(Arc::clone(&batch), vec![item(1), item(2)])).await.unwrap();
    assert_eq!(ledger.ask(batches).await.unwrap(), [batch.as_ref().clone()]);
    assert_eq!(ledger.ask(jobs).await.unwrap()[1].spec, *item(2).0);
    let renders = ledger.ask(|c| usage(c, 1_700_000_000_999)).await.unwrap();
    assert_eq!(renders, [("10.1.2.3".to_owned(), 2)]);
    sound(&ledger).await;

    let leaving = |kept: Kept| {
        let ledger = ledger.clone();
        async move { ledger.ask(move |c| Leaving::choose(c, &kept)).await.unwrap() }
    };
    ledger.commit(happens(1, 2, EventKind::Cancelled, Some(Standing::Cancelled))).await.unwrap();
    assert!(leaving(Kept { age: -1, ..all() }).await.jobs.is_empty(), "the other is not over");
    ledger.commit(happens(2, 2, EventKind::Cancelled, Some(Standing::Cancelled))).await.unwrap();
    let told = ledger.ask(|c| deliveries(c, i64::MAX, 9)).await.unwrap();
    assert_eq!((told.len(), told[0].id.as_str(), told[0].attempts), (2, "msg_job-1", 0));
    ledger.commit(Change::Postponed { id: "msg_job-1".to_owned(), due: i64::MAX }).await.unwrap();
    ledger.commit(Change::Delivered("msg_job-2".to_owned())).await.unwrap();
    assert_eq!(ledger.ask(|c| deliveries(c, i64::MAX, 9)).await.unwrap()[0].attempts, 1);
    let all_of_it = leaving(Kept { age: -1, ..all() }).await;
    assert_eq!((all_of_it.jobs.len(), all_of_it.batches.as_slice()), (2, [1].as_slice()));
    ledger.ask(|c| c.execute("DELETE FROM jobs WHERE number = 1", [])).await.unwrap();
    assert!(ledger.ask(audit).await.unwrap().join("\n").contains("1 jobs, of 2"));
    ledger.commit(Change::Forget(all_of_it)).await.unwrap();
    assert!(ledger.ask(batches).await.unwrap().is_empty());
    assert_eq!(ledger.ask(next_batch).await.unwrap(), 2);
    sound(&ledger).await;
}

#[tokio::test]
async fn nobody_waits_for_a_medium_that_is_at_fault() {
    let ledger = with_job(1).await;
    assert!(!ledger.is_stuck());
    ledger.ask(|c| c.pragma_update(None, "query_only", true)).await.unwrap();
    let begun = std::time::Instant::now();
    assert!(matches!(ledger.commit(scene("sha256-t")).await, Err(LedgerError::Stuck)));
    assert!(matches!(ledger.ask(jobs).await, Err(LedgerError::Stuck)));
    ledger.close().await;
    assert!(ledger.is_stuck());
    assert!(begun.elapsed() < 8 * GRACE, "{:?}", begun.elapsed());
}
