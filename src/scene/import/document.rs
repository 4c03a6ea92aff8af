//! JSON text -> [`Root`], with the place of whatever is wrong.

use super::schema::{Asset, Root};
use crate::scene::{Limits, SceneError};
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};
use serde_path_to_error::Segment;

/// Parses the text and checks the glTF version.
pub(super) fn parse(json: &[u8], limits: &Limits) -> Result<Root, SceneError> {
    check_text(json, limits)?;
    let mut deserializer = serde_json::Deserializer::from_slice(json);
    let root: Root = serde_path_to_error::deserialize(&mut deserializer).map_err(|error| {
        let pointer = pointer(error.path());
        json_error(&pointer, error.inner())
    })?;
    deserializer.end().map_err(|error| json_error("", &error))?;
    check_version(root.asset.as_ref())?;
    if root.nodes.len() > limits.nodes {
        let detail = format!("the file has {} nodes, more than the limit of {}", root.nodes.len(), limits.nodes);
        return Err(SceneError::too_large("nodes", "/nodes", detail));
    }
    Ok(root)
}

/// Reads the contents of an extension that is honoured.
pub(super) fn extension<T: DeserializeOwned>(content: &Map<String, Value>, place: &str) -> Result<T, SceneError> {
    serde_path_to_error::deserialize(content).map_err(|error| {
        SceneError::invalid("json_type", format!("{place}{}", pointer(error.path())), in_json_words(error.inner()))
    })
}

fn check_text(json: &[u8], limits: &Limits) -> Result<(), SceneError> {
    if json.starts_with(b"\xEF\xBB\xBF") {
        let detail =
            "line 1 column 1: the JSON begins with a byte order mark, which glTF forbids; save it as UTF-8 without one";
        return Err(SceneError::malformed("json_syntax", detail));
    }
    if !json.trim_ascii_start().starts_with(b"{") {
        let detail = "line 1 column 1: the file is neither GLB (`glTF`), nor zip, nor a JSON object (`{`); send a .glb, a .gltf or a .zip";
        return Err(SceneError::malformed("not_gltf", detail));
    }
    // Bounds the memory that parsing takes; commas in strings count too, which errs on the safe side.
    let values = json.iter().filter(|byte| **byte == b',').count();
    if values > limits.json_values {
        let detail = format!("the JSON has about {values} values, more than the limit of {}", limits.json_values);
        return Err(SceneError::too_large("json_values", "", detail));
    }
    Ok(())
}

/// A fault of syntax is malformed; one of types is invalid, at its pointer.
fn json_error(pointer: &str, error: &serde_json::Error) -> SceneError {
    match error.classify() {
        serde_json::error::Category::Data => SceneError::invalid("json_type", pointer, in_json_words(error)),
        _ => SceneError {
            pointer: pointer.to_owned(),
            ..SceneError::malformed("json_syntax", format!("not valid JSON: {error}"))
        },
    }
}

/// The message of a type error, without the names of Rust's types.
fn in_json_words(error: &serde_json::Error) -> String {
    let message = error.to_string();
    let (found, rest) = message.split_once("expected ").unwrap_or((&message, ""));
    let (expected, place) = rest
        .split_once(" at line")
        .map_or((rest, String::new()), |(expected, place)| (expected, format!(" at line{place}")));
    let expected = match expected {
        "" => return message,
        "usize" | "u64" | "u32" => "a non-negative integer",
        "f64" => "a number",
        "a map" => "an object",
        "a sequence" => "an array",
        other if other.starts_with("struct ") => "an object",
        other => other,
    };
    format!(
        "{}expected {expected}{place}",
        found.replace("type: map", "type: object").replace("type: sequence", "type: array")
    )
}

fn pointer(path: &serde_path_to_error::Path) -> String {
    path.iter().fold(String::new(), |pointer, segment| match segment {
        Segment::Seq { index } => format!("{pointer}/{index}"),
        Segment::Map { key } => format!("{pointer}/{}", escape(key)),
        Segment::Enum { variant } => format!("{pointer}/{variant}"),
        Segment::Unknown => pointer,
    })
}

/// A key as a segment of a JSON pointer (RFC 6901).
pub(super) fn escape(key: &str) -> String {
    key.replace('~', "~0").replace('/', "~1")
}

fn check_version(asset: Option<&Asset>) -> Result<(), SceneError> {
    let Some(asset) = asset else {
        return Err(SceneError::invalid(
            "version",
            "/asset",
            "`asset` with its `version` is missing; export as glTF 2.0",
        ));
    };
    let version = parse_version(&asset.version, "/asset/version")?;
    if version.0 != 2 {
        let detail = format!("glTF {} is not supported; export as glTF 2.0", asset.version);
        return Err(SceneError::invalid("version", "/asset/version", detail));
    }
    match &asset.min_version {
        Some(minimum) if parse_version(minimum, "/asset/minVersion")? > (2, 0) => {
            let detail = format!("the file needs a reader of glTF {minimum}, this one reads 2.0; export as glTF 2.0");
            Err(SceneError::invalid("version", "/asset/minVersion", detail))
        }
        _ => Ok(()),
    }
}

fn parse_version(text: &str, pointer: &str) -> Result<(u32, u32), SceneError> {
    let numbers = text.split_once('.').and_then(|(major, minor)| Some((major.parse().ok()?, minor.parse().ok()?)));
    numbers.ok_or_else(|| SceneError::invalid("version", pointer, format!("`{text}` is not a version like `2.0`")))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error(json: &str) -> SceneError {
        parse(json.as_bytes(), &Limits::default()).unwrap_err()
    }

    #[test]
    fn faults_name_their_place() {
        let fault = error("{\"asset\": {\"version\": \"2.0\"},\n \"nodes\": [{}, {\"children\": [1, -2]}]}");
        assert_eq!((fault.code, fault.pointer.as_str()), ("json_type", "/nodes/1/children/1"));
        assert!(fault.detail.contains("integer `-2`, expected a non-negative integer at line 2"), "{}", fault.detail);
        assert!(error(r#"{"asset":{}}"#).detail.contains("missing field `version`"));
        assert!(error(r#"{"nodes":{}}"#).detail.contains("type: object, expected an array"));
        assert!(error(r#"{"nodes":["x"]}"#).detail.contains("expected an object"));
        let fault = error("{\n\"asset\" \"2.0\"}");
        assert_eq!(fault.code, "json_syntax");
        assert!(fault.detail.contains("line 2 column 9"), "{}", fault.detail);
        let fault = error(r#"{"asset":{"version":"2.0"},"extensions":{"A/B":3}}"#);
        assert_eq!(fault.pointer, "/extensions/A~1B");
        assert_eq!(error(r#"{"asset":{"version":"2.0"}} x"#).code, "json_syntax", "trailing text");
        assert_eq!(error("\u{feff}{}").code, "json_syntax");
        assert_eq!(error("").code, "not_gltf");
    }

    #[test]
    fn deep_json_is_refused() {
        let json = format!("{{\"asset\":{{\"version\":\"2.0\"}},\"extensions\":{{\"a\":{}", "{\"a\":".repeat(100_000));
        assert_eq!(error(&json).code, "json_syntax");
    }

    #[test]
    fn versions() {
        let check = |version: &str, minimum: Option<&str>| {
            let json = serde_json::json!({"asset": {"version": version, "minVersion": minimum}});
            parse(json.to_string().as_bytes(), &Limits::default()).map(|_| ()).map_err(|error| error.pointer)
        };
        assert_eq!(check("2.0", None), Ok(()));
        assert_eq!(check("2.1", Some("2.0")), Ok(()));
        assert_eq!(check("1.0", None), Err("/asset/version".into()));
        assert_eq!(check("two", None), Err("/asset/version".into()));
        assert_eq!(check("2.1", Some("2.1")), Err("/asset/minVersion".into()));
        assert_eq!(error("{}").pointer, "/asset");
    }

    #[test]
    fn values_are_limited() {
        let limits = Limits { json_values: 2, ..Limits::default() };
        assert_eq!(parse(br#"{"a":[1,2,3,4]}"#, &limits).unwrap_err().code, "json_values");
    }
}
