//! `name=value` pairs laid over a JSON value; [`super::from_query`] has the rules.

use super::{FieldError, json};
use serde_json::{Map, Value};
use std::collections::HashSet;

/// Fields that are text even if they look like a number.
const TEXTS: [&str; 3] = ["camera.name", "environment.hdri", "variant"];

/// Longest path of names; no parameter lies deeper.
const MAX_DEPTH: usize = 8;

/// Sets each pair's place in `target` to its value. No pair may be given twice or lie within an earlier one's text.
pub(super) fn overlay<'a>(
    target: &mut Value,
    pairs: impl IntoIterator<Item = (&'a str, &'a str)>,
) -> Result<(), Vec<FieldError>> {
    let mut seen = HashSet::new();
    let mut faults = Vec::new();
    for (name, text) in pairs {
        let fault = |detail: String| FieldError::new(format!("/params/{}", name.replace('.', "/")), detail);
        if !seen.insert(name) {
            faults.push(fault("given twice: leave one out".to_owned()));
        } else if name.split('.').count() > MAX_DEPTH {
            faults.push(FieldError::new("/params", format!("a name has more than {MAX_DEPTH} parts")));
        } else if let Err(detail) = set(target, name.split('.'), read(name, text)) {
            faults.push(fault(detail));
        }
    }
    if faults.is_empty() { Ok(()) } else { Err(faults) }
}

fn read(name: &str, text: &str) -> Value {
    let text_value = || Value::String(text.to_owned());
    if TEXTS.contains(&name) { text_value() } else { json(text, "").unwrap_or_else(|_| text_value()) }
}

fn set<'a>(target: &mut Value, mut path: impl Iterator<Item = &'a str>, value: Value) -> Result<(), String> {
    let Some(name) = path.next() else {
        *target = value;
        return Ok(());
    };
    if target.is_null() {
        *target = if name.parse::<usize>().is_ok() { Value::Array(Vec::new()) } else { Value::Object(Map::new()) };
    }
    match target {
        Value::Object(fields) => set(fields.entry(name).or_insert(Value::Null), path, value),
        Value::Array(items) => set(item(items, name)?, path, value),
        _ => Err(format!("`{name}` cannot be set inside a value that has no fields")),
    }
}

/// The item of that number; the one after the last is made.
fn item<'a>(items: &'a mut Vec<Value>, name: &str) -> Result<&'a mut Value, String> {
    let next = items.len();
    let index: usize = name.parse().map_err(|_| format!("`{name}` must be a place in the list, from 0 to {next}"))?;
    if index == next {
        items.push(Value::Null);
    }
    items.get_mut(index).ok_or_else(|| format!("the list has no place {index}: the next free one is {next}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn laid(pairs: &[(&str, &str)]) -> Result<Value, Vec<FieldError>> {
        let mut value = json!({});
        overlay(&mut value, pairs.iter().copied()).map(|()| value)
    }

    #[test]
    fn pairs_make_objects_and_lists() {
        let value = laid(&[("a.b", "1"), ("a.c", "x"), ("l.0.p", "[1,2]"), ("l.1.p", "null"), ("camera.name", "7")]);
        assert_eq!(
            value.unwrap(),
            json!({"a": {"b": 1, "c": "x"}, "l": [{"p": [1, 2]}, {"p": null}], "camera": {"name": "7"}})
        );
    }

    #[test]
    fn what_cannot_be_placed_is_refused() {
        for pairs in [
            [("width", "1"), ("width", "2")],
            [("width", "1"), ("width.x", "2")],
            [("lights", "[]"), ("lights.first", "1")],
            [("lights", "[]"), ("lights.4294967295", "1")],
            [("width", "1"), ("a.b.c.d.e.f.g.h.i", "1")],
        ] {
            let faults = laid(&pairs).unwrap_err();
            assert_eq!(faults.len(), 1, "{faults:?}");
            assert!(faults[0].pointer.starts_with("/params"), "{faults:?}");
        }
    }
}
