//! Manifests: many renders in one text, a line of JSON each, or a matrix of scenes, cameras, variants and lights.
//! The server and the command line read the same.

use crate::params::{self, FieldError, JsonError, RenderParams};
use serde::de::Error;
use serde::{Deserialize, Deserializer};
use serde_json::Value;
use std::collections::HashSet;

/// Faults after which reading stops: who made a thousand lines the same way has made one mistake.
const MOST_FAULTS: usize = 20;

/// Longest name of an item.
const LONGEST_NAME: usize = 100;

/// One render of a manifest.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Item {
    /// Of its file, without the extension; no two are alike, in whatever case.
    pub name: String,
    /// Id of a scene; on the command line a file or `demo:NAME`.
    pub scene: String,
    /// Parameters, not validated yet.
    pub params: RenderParams,
    /// -100 to 100.
    pub priority: i32,
    /// Address that is told of its end.
    pub webhook: Option<String>,
    /// Where all this is written.
    pub origin: Origin,
}

/// Where the parts of an item stand in its manifest: JSON pointers within the item, and in the manifest. The first one that fits
/// counts.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Origin(Vec<(&'static str, String)>);

impl Origin {
    /// The same fault, at its place in the manifest.
    pub fn place(&self, fault: FieldError) -> FieldError {
        let within =
            |part: &str| fault.pointer.strip_prefix(part).filter(|rest| rest.is_empty() || rest.starts_with('/'));
        let placed = self.0.iter().find_map(|(part, place)| within(part).map(|rest| format!("{place}{rest}")));
        FieldError { pointer: placed.unwrap_or(fault.pointer), detail: fault.detail }
    }
}

/// Who is to be told of a job's end.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Webhook {
    /// Where the message goes.
    pub url: String,
}

/// Why a manifest is not read.
#[derive(Debug, Clone, PartialEq)]
pub enum ManifestError {
    /// It is no JSON.
    Syntax(String),
    /// Fields at fault: `/items/3/params/width` for the fourth line, `/cameras/1/index` of a matrix.
    Fields(Vec<FieldError>),
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Line {
    scene: String,
    #[serde(default)]
    name: Option<String>,
    #[serde(default = "no_params")]
    params: Value,
    #[serde(default)]
    priority: i32,
    #[serde(default)]
    webhook: Option<Webhook>,
}

/// What `params` are where they are left out; null is not the same, and refused.
pub fn no_params() -> Value {
    Value::Object(serde_json::Map::new())
}

/// Each scene with each camera, variant and set of lights; an axis that is left out has one place, as `params` say.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Matrix {
    scenes: Vec<String>,
    #[serde(default = "no_params")]
    params: Value,
    #[serde(default, deserialize_with = "axis")]
    cameras: Vec<Value>,
    #[serde(default, deserialize_with = "axis")]
    variants: Vec<Value>,
    #[serde(default, deserialize_with = "axis")]
    lights: Vec<Value>,
    #[serde(default)]
    priority: i32,
    #[serde(default)]
    webhook: Option<Webhook>,
}

/// An axis that is given has a place: whoever made it of an empty list wanted no pictures, and not one.
fn axis<'de, D: Deserializer<'de>>(list: D) -> Result<Vec<Value>, D::Error> {
    let places = Vec::deserialize(list)?;
    if places.is_empty() {
        return Err(D::Error::custom(
            "is empty, so that nothing would be rendered; leave it out to have it as `params` say",
        ));
    }
    Ok(places)
}

/// Reads either form: a matrix is one JSON object that has `scenes`, on as many lines as it likes. What is neither is told of as what
/// it was most likely meant to be.
///
/// # Errors
/// As [`from_lines`] and [`from_matrix`].
pub fn read(text: &str, most: usize) -> Result<Vec<Item>, ManifestError> {
    let is_render = |line: &str| params::json(line, "").is_ok_and(|value| value.get("scene").is_some());
    let is_one_line = text.lines().filter(|line| !line.trim().is_empty()).count() <= 1;
    match params::json(text, "") {
        Ok(value) if value.get("scenes").is_some() => from_matrix(&value, most),
        _ if is_one_line || text.lines().any(is_render) => from_lines(text, most),
        Ok(value) if value.get("scene").is_some() => Err(ManifestError::Syntax(
            "a render has to stand on one line, and this one has several; a matrix has `scenes`".to_owned(),
        )),
        Ok(value) => from_matrix(&value, most),
        Err(JsonError::Syntax(error)) => Err(ManifestError::Syntax(error)),
        Err(JsonError::Twice(fault)) => Err(ManifestError::Fields(vec![fault])),
    }
}

/// Reads a render per line; empty lines count for nothing.
///
/// # Errors
/// A line is no JSON, has fields at fault, or there are none or too many.
pub fn from_lines(text: &str, most: usize) -> Result<Vec<Item>, ManifestError> {
    let lines = || text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    check_count(lines().count(), most)?;
    let mut draft = Draft::default();
    for (index, (number, line)) in lines().enumerate() {
        if draft.faults.len() >= MOST_FAULTS {
            break;
        }
        let root = format!("/items/{index}");
        let origin = Origin(vec![("", root.clone())]);
        let value = match params::json(line, &root) {
            Ok(value) => value,
            Err(JsonError::Syntax(error)) => {
                // Its own line number is 1 always.
                let (what, column) = error.rsplit_once(" at line 1 column ").unwrap_or((&error, "1"));
                return Err(ManifestError::Syntax(format!("{what} at line {} column {column}", number + 1)));
            }
            Err(JsonError::Twice(fault)) => {
                draft.note(fault);
                continue;
            }
        };
        match params::read::<Line>(&value) {
            Ok(line) => {
                let Line { scene, name, params, priority, webhook } = line;
                let name = name.unwrap_or_else(|| format!("{index:04}"));
                let webhook = webhook.map(|webhook| webhook.url);
                draft.add(&params, Item { name, scene, priority, webhook, origin, ..Item::default() });
            }
            Err(fault) => draft.note(origin.place(fault)),
        }
    }
    draft.finish()
}

/// Reads a matrix.
///
/// # Errors
/// Fields are at fault, or it is empty or too large.
pub fn from_matrix(value: &Value, most: usize) -> Result<Vec<Item>, ManifestError> {
    let matrix: Matrix = params::read(value).map_err(|fault| ManifestError::Fields(vec![fault]))?;
    let axes = [&matrix.cameras, &matrix.variants, &matrix.lights];
    let count = axes.iter().fold(matrix.scenes.len(), |count, axis| count.saturating_mul(axis.len().max(1)));
    check_count(count, most)?;
    let mut draft = Draft::default();
    for index in 0..count {
        // The last axis runs fastest.
        let mut rest = index;
        let mut place = |length: usize| {
            let at = rest % length.max(1);
            rest /= length.max(1);
            at
        };
        let [lights, variant, camera] =
            [place(matrix.lights.len()), place(matrix.variants.len()), place(matrix.cameras.len())];
        let scene = place(matrix.scenes.len());
        let mut params = matrix.params.clone();
        let (mut parts, mut origin) = (Vec::new(), vec![("/scene", format!("/scenes/{scene}"))]);
        if matrix.scenes.len() > 1 {
            parts.push(format!("scene{scene}"));
        }
        let given = [
            ("camera", "/params/camera", "cameras", &matrix.cameras, camera),
            ("variant", "/params/variant", "variants", &matrix.variants, variant),
            ("lights", "/params/lights", "lights", &matrix.lights, lights),
        ];
        for (field, part, axis, choices, at) in given {
            let (Some(choice), Some(params)) = (choices.get(at), params.as_object_mut()) else { continue };
            params.insert(field.to_owned(), choice.clone());
            parts.push(format!("{field}{at}"));
            origin.push((part, format!("/{axis}/{at}")));
        }
        let name = if parts.is_empty() { "picture".to_owned() } else { parts.join("_") };
        let scene = matrix.scenes.get(scene).cloned().unwrap_or_default();
        let webhook = matrix.webhook.as_ref().map(|webhook| webhook.url.clone());
        let origin = Origin(origin);
        draft.add(&params, Item { name, scene, priority: matrix.priority, webhook, origin, ..Item::default() });
    }
    draft.finish()
}

fn check_count(count: usize, most: usize) -> Result<(), ManifestError> {
    if (1..=most).contains(&count) {
        return Ok(());
    }
    let detail = format!("a batch has 1 to {most} renders (GET /v1/limits, batch_items), and this has {count}");
    Err(ManifestError::Fields(vec![FieldError::new("/items", detail)]))
}

/// What has been read so far.
#[derive(Default)]
struct Draft {
    items: Vec<Item>,
    names: HashSet<String>,
    faults: Vec<FieldError>,
}

impl Draft {
    /// Adds an item, whose parameters are still JSON.
    fn add(&mut self, params: &Value, item: Item) {
        let name = &item.name;
        let at_name = |detail: String| item.origin.place(FieldError::new("/name", detail));
        let plain = name.bytes().all(|byte| byte.is_ascii_alphanumeric() || matches!(byte, b'-' | b'_' | b'.'));
        if !plain || !name.starts_with(|c: char| c.is_ascii_alphanumeric()) || name.len() > LONGEST_NAME {
            let detail = format!(
                "must be 1 to {LONGEST_NAME} letters, digits, `-`, `_` or `.`, beginning with a letter or a digit"
            );
            self.note(at_name(detail));
        } else if !self.names.insert(name.to_ascii_lowercase()) {
            let detail = format!("another item is named `{name}` (files of such names may be one)");
            self.note(at_name(detail));
        }
        match params::from_json(&params.to_string()) {
            Ok(params) => self.items.push(Item { params, ..item }),
            Err(faults) => faults.into_iter().for_each(|fault| self.note(item.origin.place(fault))),
        }
    }

    /// Notes a fault once: all items of a matrix share what is written once.
    fn note(&mut self, fault: FieldError) {
        if self.faults.len() < MOST_FAULTS && !self.faults.contains(&fault) {
            self.faults.push(fault);
        }
    }

    fn finish(self) -> Result<Vec<Item>, ManifestError> {
        if self.faults.is_empty() { Ok(self.items) } else { Err(ManifestError::Fields(self.faults)) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn pointers(read: Result<Vec<Item>, ManifestError>) -> Vec<String> {
        match read {
            Err(ManifestError::Fields(faults)) => faults.into_iter().map(|fault| fault.pointer).collect(),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn lines_are_renders() {
        let text = "{\"scene\": \"a\"}\n\n{\"scene\": \"b\", \"name\": \"top\", \"params\": {\"width\": 7}, \"priority\": 3}\n";
        let items = read(text, 2).unwrap();
        assert_eq!(items.iter().map(|item| item.name.as_str()).collect::<Vec<_>>(), ["0000", "top"]);
        assert_eq!((items[1].scene.as_str(), items[1].params.width, items[1].priority), ("b", 7, 3));
    }

    #[test]
    fn a_matrix_is_every_combination() {
        let matrix = json!({
            "scenes": ["a", "b"],
            "params": {"width": 9},
            "cameras": [{"index": 0}, {"orbit": {"azimuth_degrees": 90}}, null],
            "lights": [[], [{"type": "ambient"}]],
        });
        let items = read(&matrix.to_string(), 12).unwrap();
        let names: HashSet<_> = items.iter().map(|item| item.name.clone()).collect();
        assert_eq!((items.len(), names.len()), (12, 12));
        assert_eq!((items[1].name.as_str(), items[1].params.lights.len()), ("scene0_camera0_lights1", 1));
        assert_eq!((items[11].name.as_str(), items[11].scene.as_str()), ("scene1_camera2_lights1", "b"));
        assert!(items.iter().all(|item| item.params.width == 9));
        assert_eq!(read(r#"{"scenes": ["a"]}"#, 1).unwrap()[0].name, "picture");
    }

    #[test]
    fn faults_of_a_matrix_are_where_they_are_written() {
        let matrix = r#"{"scenes": ["a", "b"], "params": {"widht": 1, "camera": {"foo": 1}},
            "cameras": [null, {"orbit": {"azimuth": 1}}], "lights": [[], [{"type": "ambient"}, {"type": "lamp"}]], "variants": [7]}"#;
        let mut places = pointers(read(matrix, 99));
        places.sort_unstable();
        assert_eq!(places, ["/cameras/1/orbit/azimuth", "/lights/1/1/type", "/params/widht", "/variants/0"]);
        let items = read(r#"{"scenes": ["a"], "cameras": [{}, {"blades": 2}], "params": {"width": 0}}"#, 9).unwrap();
        let faults = items[1].params.validate(&params::ParamLimits::default()).unwrap_err();
        let mut places: Vec<String> = faults.into_iter().map(|fault| items[1].origin.place(fault).pointer).collect();
        places.sort_unstable();
        assert_eq!(places, ["/cameras/1/blades", "/params/width"]);
        assert_eq!(items[1].origin.place(FieldError::new("/scene", "")).pointer, "/scenes/0");
    }

    #[test]
    fn what_spans_lines_is_told_of_as_a_matrix() {
        let syntax = |text| match read(text, 9) {
            Err(ManifestError::Syntax(text)) => text,
            other => panic!("{other:?}"),
        };
        let unclosed =
            "{\n  \"scenes\": [\"a\"],\n  \"params\": {\"width\": 640\n  \"cameras\": [\n    {\"orbit\": {}}\n  ]\n}\n";
        assert!(syntax(unclosed).ends_with("at line 4 column 3"), "{}", syntax(unclosed));
        assert_eq!(pointers(read("{\n  \"scnees\": [\"a\"]\n}", 9)), ["/scnees"]);
        assert_eq!(pointers(read("{\n \"scenes\": [\"a\"],\n \"scenes\": []\n}", 9)), ["/scenes"]);
        assert!(syntax("{\n  \"scene\": \"a\"\n}").contains("one line"));
        assert_eq!(pointers(read("null", 9)), ["/items/0"]);
    }

    #[test]
    fn faults_have_their_places() {
        let line = |more: &str| format!("{{\"scene\": \"a\"{more}}}\n");
        let two = [line(""), line(", \"params\": {\"widht\": 1}")].concat();
        assert_eq!(pointers(read(&two, 9)), ["/items/1/params/widht"]);
        assert_eq!(
            pointers(read(&[line(", \"name\": \"x\""), line(", \"name\": \"X\"")].concat(), 9)),
            ["/items/1/name"]
        );
        for name in ["../x", ".x", "", "a/b", "ä", &"x".repeat(101)] {
            assert_eq!(pointers(read(&line(&format!(", \"name\": \"{name}\"")), 9)), ["/items/0/name"], "{name}");
        }
        assert_eq!(pointers(read(&line(", \"more\": 1"), 9)), ["/items/0/more"]);
        assert_eq!(pointers(read("", 9)), ["/items"]);
        assert_eq!(pointers(read(&line("").repeat(10), 9)), ["/items"]);
        assert_eq!(pointers(read(r#"{"scenes": []}"#, 9)), ["/items"]);
        for axis in ["cameras", "variants", "lights"] {
            assert_eq!(pointers(read(&json!({"scenes": ["a"], axis: []}).to_string(), 9)), [format!("/{axis}")]);
        }
        let huge = json!({"scenes": ["a"], "cameras": vec![Value::Null; 4000], "lights": vec![json!([]); 4000], "variants": vec![Value::Null; 4000]});
        assert_eq!(pointers(read(&huge.to_string(), 9)), ["/items"]);
        assert!(
            matches!(read("{\"scene\": \"a\"}\n{", 9), Err(ManifestError::Syntax(text)) if text.ends_with("at line 2 column 1"))
        );
        assert_eq!(pointers(read(&line(", \"params\": {\"widht\": 1}").repeat(500), 900)).len(), MOST_FAULTS);
    }
}
