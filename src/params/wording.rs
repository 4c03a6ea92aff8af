//! Serde's words for what was found and what was expected, turned into those of JSON, with the nearest name where one is wrong.

use serde_json::Value;

/// What Rust calls a kind of value, and what a user calls it.
const EXPECTED: [(&str, &str); 12] = [
    ("struct RenderParams", "an object"),
    ("u32", "a whole number, not negative and below 2^32"),
    ("i32", "a whole number"),
    ("u64", "a whole number, not negative"),
    ("usize", "a whole number, not negative"),
    ("u8", "a whole number from 0 to 255"),
    ("f32", "a number"),
    ("f64", "a number"),
    ("a sequence", "an array"),
    ("a map", "an object"),
    ("a string", "a text in quotes"),
    ("string or map", "one of its names, a text in quotes (openapi.yaml lists them)"),
];

const FOUND: [(&str, &str); 4] =
    [("map", "an object"), ("sequence", "an array"), ("null", "null"), ("unit value", "null")];

/// Rust's words turned into those of JSON, with the nearest name where a name is wrong.
pub fn explain(message: &str) -> String {
    let mut text = of_kinds(message).unwrap_or_else(|| message.to_owned());
    if message.starts_with("unknown field") || message.starts_with("unknown variant") {
        let mut names = quoted(message);
        if let Some(wrong) = names.next()
            && let Some(near) = nearest(wrong, names)
        {
            text = format!("{text}. Did you mean `{near}`?");
        }
    }
    text
}

/// The words between backticks.
pub fn quoted(message: &str) -> impl Iterator<Item = &str> {
    message.split('`').skip(1).step_by(2)
}

/// The name that a typing mistake could have turned into `wrong`.
pub fn nearest<'a>(wrong: &str, names: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    let scored = names.map(|name| (strsim::jaro_winkler(wrong, name), name));
    scored.filter(|(likeness, _)| *likeness > 0.75).max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, name)| name)
}

/// The message of a value of the wrong kind or size; none: it is about something else.
fn of_kinds(message: &str) -> Option<String> {
    if let Some(rest) = message.strip_prefix("invalid length ") {
        let (length, expected) = rest.split_once(", expected ")?;
        return Some(format!("has {length} entries; expected {expected}"));
    }
    let rest = message.strip_prefix("invalid type: ").or_else(|| message.strip_prefix("invalid value: "))?;
    let (found, expected) = rest.split_once(", expected ")?;
    let known = EXPECTED.iter().find(|(name, _)| *name == expected).map(|(_, words)| *words);
    let is_object = expected.starts_with("struct ") || expected.contains("tagged enum");
    let expected = known.unwrap_or(if is_object { "an object" } else { expected });
    Some(format!("is {}; expected {expected}", found_words(found)))
}

/// What a value is.
pub fn kind(value: &Value) -> &'static str {
    match value {
        Value::Null => "null",
        Value::Bool(_) => "a boolean",
        Value::Number(_) => "a number",
        Value::String(_) => "a text",
        Value::Array(_) => "an array",
        Value::Object(_) => "an object",
    }
}

fn found_words(found: &str) -> String {
    if let Some((_, words)) = FOUND.iter().find(|(name, _)| *name == found) {
        return (*words).to_owned();
    }
    if let Some(text) = found.strip_prefix("string ") {
        return format!("the text {text}");
    }
    // Numbers and truth values stand between backticks.
    match found.split('`').nth(1) {
        Some(value) if found.starts_with("boolean") => value.to_owned(),
        Some(value) => format!("the number {value}"),
        None => found.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::of_kinds;
    use crate::params::from_json;

    #[test]
    fn kinds_are_named_as_in_json() {
        let said = |json: &str| from_json(json).unwrap_err().remove(0).to_string();
        assert_eq!(said(r#"{"lights": {}}"#), "/params/lights: is an object; expected an array");
        assert_eq!(said(r#"{"camera": "front"}"#), "/params/camera: is the text \"front\"; expected an object");
        let named = "/params/tone_mapping: is the number 123; expected one of its names, a text in quotes (openapi.yaml lists them)";
        assert_eq!(said(r#"{"tone_mapping": 123}"#), named);
        assert_eq!(said(r#"{"adaptive": 1}"#), "/params/adaptive: is the number 1; expected a boolean");
        assert_eq!(said(r#"{"scene_lights": null}"#), "/params/scene_lights: is null; expected a boolean");
        let position = said(r#"{"camera": {"position": [1, 3]}}"#);
        assert_eq!(position, "/params/camera/position: has 2 entries; expected an array of length 3");
        assert_eq!(of_kinds("missing field `a`"), None);
    }
}
