//! Lists, page by page.

use super::query;
use crate::jobs::{Code, Problem};
use crate::params::FieldError;
use axum::Json;
use axum::http::Uri;
use serde_json::{Value, json};

/// Where a page of a list begins, and how long it is.
#[derive(Debug)]
pub struct Page {
    /// What the page before gave as `next`.
    pub cursor: Option<String>,
    /// 1 to 100.
    pub count: usize,
}

impl Page {
    /// The fields `cursor` and `limit` of a query.
    pub fn read(uri: &Uri) -> Result<Self, Problem> {
        let [cursor, limit] = query::fields(uri, ["cursor", "limit"])?;
        let limit = limit.unwrap_or_else(|| "20".to_owned());
        match limit.parse() {
            Ok(count @ 1..=100) => Ok(Self { cursor, count }),
            _ => {
                let limit: String = limit.chars().take(40).collect();
                Err(query::fault("limit", format!("must be a whole number from 1 to 100, and is `{limit}`")))
            }
        }
    }

    /// What the page follows, which is looked up by its id.
    pub async fn after<T, F: Future<Output = Result<T, Problem>>>(
        &self,
        look_up: impl FnOnce(String) -> F,
    ) -> Result<Option<T>, Problem> {
        let Some(cursor) = &self.cursor else { return Ok(None) };
        look_up(cursor.clone()).await.map(Some).map_err(|_| bad_cursor())
    }
}

/// The fault of a cursor that leads nowhere.
pub fn bad_cursor() -> Problem {
    let why = "this is no place of this list, or it has been forgotten since";
    let detail = format!("{why}: give the `next` of the page before, or no cursor to begin again");
    Problem { errors: vec![FieldError::new("/cursor", why)], ..Problem::new(Code::BadCursor, detail) }
}

/// A page; `more`: there is another one.
pub fn reply<T>(things: &[T], more: bool, id: impl Fn(&T) -> &str, row: impl Fn(&T) -> Value) -> Json<Value> {
    let next = things.last().filter(|_| more).map(id);
    let items: Vec<_> = things.iter().map(row).collect();
    Json(json!({ "items": items, "next": next }))
}
