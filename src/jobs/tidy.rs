//! What leaves when it is too old or too much.

use super::Core;
use super::ledger::{Kept, Leaving};
use crate::config::Limits;
use std::sync::{Arc, Weak};
use std::time::{Duration, Instant};

/// Time between two looks for what has become too old.
const TIDY_PERIOD: Duration = Duration::from_secs(60);

/// Part of the time that tidying may take: 1 in 20. It looks at all that is kept, and the ledger does nothing else meanwhile.
const SHARE: u32 = 20;

/// Lets go of old jobs and uploads, whenever jobs have ended and now and then besides, until the service is gone.
pub(super) async fn keep_tidy(core: Weak<Core>) {
    loop {
        let Some(tidy) = core.upgrade().map(|core| Arc::clone(&core.tidy)) else { return };
        let _ = tokio::time::timeout(TIDY_PERIOD, tidy.notified()).await;
        let Some(core) = core.upgrade() else { return };
        let begun = Instant::now();
        let kept = kept(&core.limits, core.storage.is_durable());
        // What could not be done is tried again the next time; the log says why.
        let _ = core.storage.tidy(kept, |leaving| forget(&core, leaving)).await;
        drop(core);
        tokio::time::sleep(begun.elapsed() * (SHARE - 1)).await;
    }
}

fn forget(core: &Core, leaving: &Leaving) {
    core.table.forget(&leaving.jobs, &leaving.batches);
    core.table.lose_pictures(&leaving.pictures);
    for id in &leaving.scenes {
        core.scenes.remove(id);
    }
    for id in &leaving.images {
        core.images.remove(id);
    }
}

/// What the limits say of what is kept. Uploads that lie in memory have to be fewer.
fn kept(limits: &Limits, is_durable: bool) -> Kept {
    let upload_bytes = limits.kept_upload_bytes;
    Kept {
        jobs: limits.kept_jobs,
        result_bytes: limits.kept_result_bytes,
        upload_bytes: if is_durable { upload_bytes } else { upload_bytes.min(limits.stored_scene_bytes) },
        age: i64::try_from(limits.kept_hours.saturating_mul(3_600_000)).unwrap_or(i64::MAX),
    }
}
