//! Jobs that the process before left unfinished.

use super::job::{Job, Order};
use super::problem::{Code, Problem};
use super::{Service, Stages};
use std::collections::BTreeMap;
use std::sync::Arc;

impl Service {
    /// Goes on with the jobs of the process before.
    pub(super) fn resume(&self, unfinished: Vec<(Arc<Job>, Option<String>)>) {
        let count = unfinished.len();
        let mut batches = BTreeMap::<i64, Vec<_>>::new();
        for (job, film) in unfinished {
            if job.spec.attended {
                // The client that waited for it is gone.
                job.cancel();
                continue;
            }
            job.requeue();
            if let Some(place) = &job.spec.place {
                batches.entry(place.batch).or_default().push((Arc::clone(&job), film));
            } else {
                let service = self.clone();
                tokio::spawn(async move { service.reopen(job, film).await });
            }
        }
        for mut work in batches.into_values() {
            // What had been begun goes on first.
            work.sort_by_key(|(_, film)| film.is_none());
            tokio::spawn(self.clone().feed(work, false));
        }
        if count > 0 {
            tracing::info!(jobs = count, "unfinished jobs go on");
        }
    }

    /// Reads back what a job of the process before needs.
    pub(super) async fn reopen(&self, job: Arc<Job>, film: Option<String>) {
        match self.order_again(&job).await {
            Ok(order) => {
                let saved = match film {
                    Some(film) => self.core.storage.film(&film).await,
                    None => None,
                };
                self.clone().compile(job, order, saved).await;
            }
            Err(problem) => self.fail(&job, problem),
        }
    }

    async fn order_again(&self, job: &Job) -> Result<Order, Problem> {
        let spec = &job.spec;
        let lost = || Problem::new(Code::StorageUnavailable, "the scene of this job is lost");
        let scene = self.read_scene(&spec.scene).await?.ok_or_else(lost)?;
        let hdri = match &spec.image {
            Some(image) => Some(self.read_image(image).await?),
            None => None,
        };
        let mut maps = Vec::new();
        for name in spec.params.map_names() {
            maps.push(self.read_image(name).await?);
        }
        let mut profiles = Vec::new();
        for name in spec.params.profile_names() {
            profiles.push(self.read_image(name).await?);
        }
        let (params, priority) = (spec.params.clone(), spec.priority);
        Ok(Order { scene, hdri, maps, profiles, params, priority, stages: Stages::default() })
    }
}
