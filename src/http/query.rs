//! Fields of a query, each of them known.

use crate::jobs::{Code, Problem};
use crate::params::FieldError;
use axum::extract::Query;
use axum::http::Uri;

/// Name and value of each field, decoded.
pub fn pairs(uri: &Uri) -> Result<Vec<(String, String)>, Problem> {
    let read = Query::<Vec<(String, String)>>::try_from_uri(uri);
    read.map(|Query(pairs)| pairs)
        .map_err(|error| Problem::new(Code::BadRequest, format!("the query cannot be read: {error}")))
}

/// The values of the fields of these names; any other field, and one given twice, is refused.
pub fn fields<const N: usize>(uri: &Uri, names: [&str; N]) -> Result<[Option<String>; N], Problem> {
    let mut values = [const { None }; N];
    for (name, value) in pairs(uri)? {
        let Some(place) = names.iter().position(|known| *known == name) else {
            let known = names.map(|name| format!("`{name}`")).join(", ");
            let known = if known.is_empty() { "none: its parameters are the body's".to_owned() } else { known };
            return Err(fault(&name, format!("is not a query field of this route, which has {known}")));
        };
        if values[place].replace(value).is_some() {
            return Err(fault(&name, "given twice: leave one out".to_owned()));
        }
    }
    Ok(values)
}

/// The fault of one field.
pub fn fault(name: &str, detail: String) -> Problem {
    Problem::fields(Code::InvalidParams, vec![FieldError::new(format!("/{name}"), detail)])
}
