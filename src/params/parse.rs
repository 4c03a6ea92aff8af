//! JSON and query strings -> [`RenderParams`].

use super::query::overlay;
use super::strict::{self, JsonError};
use super::{FieldError, RenderParams, wording};
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};
use serde_path_to_error::{Path, Segment};

/// Faults after which reading is given up.
const MAX_FAULTS: usize = 32;

/// Reads parameters from a JSON object; absent fields have their defaults.
///
/// # Errors
/// One fault per top-level field and per light, with its JSON pointer. Ranges are not checked here:
/// [`RenderParams::validate`] does.
pub fn from_json(json: &str) -> Result<RenderParams, Vec<FieldError>> {
    from_json_and_query(json, [])
}

/// Reads parameters from pairs like those of `?width=640&tone_mapping=agx&camera.yfov_degrees=30`.
///
/// A name is a field, or a path of fields and list places with dots between (`camera.position`, `lights.0.intensity`). A
/// value is JSON if it parses as JSON, else a string: `environment={"constant":[1,1,1]}`, `environment=null`,
/// `camera.position=[0,1,4]`, `output.format=exr`.
///
/// # Errors
/// As [`from_json`], and names that are given twice or lead nowhere.
pub fn from_query<'a>(pairs: impl IntoIterator<Item = (&'a str, &'a str)>) -> Result<RenderParams, Vec<FieldError>> {
    from_json_and_query("{}", pairs)
}

/// Reads parameters from a JSON object, over which pairs as of [`from_query`] have precedence.
///
/// # Errors
/// As [`from_json`] and [`from_query`].
pub fn from_json_and_query<'a>(
    json: &str,
    pairs: impl IntoIterator<Item = (&'a str, &'a str)>,
) -> Result<RenderParams, Vec<FieldError>> {
    let mut value = strict::json(json, "/params").map_err(|error| match error {
        JsonError::Syntax(error) => vec![FieldError::new("/params", format!("not valid JSON: {error}"))],
        JsonError::Twice(fault) => vec![fault],
    })?;
    if !value.is_object() {
        let detail = format!("must be a JSON object, like {{\"width\": 640}}, and is {}", wording::kind(&value));
        return Err(vec![FieldError::new("/params", detail)]);
    }
    overlay(&mut value, pairs)?;
    from_value(value)
}

/// Lists of objects, each with an entry that nothing is wrong with and the objects within an entry.
const LISTS: [(&str, &str, &[&str]); 3] = [
    ("lights", r#"{"type": "ambient"}"#, &[]),
    ("spheres", r#"{"center": [0, 0, 0], "radius": 1}"#, &MAPS),
    ("overrides", r#"{"material": ""}"#, &MAPS),
];

/// Objects within a sphere or an override.
const MAPS: [&str; 4] = ["texture", "height", "normal", "parallax"];

/// Objects within the parameters, besides those of [`LISTS`].
const OBJECTS: [&str; 12] = [
    "/camera",
    "/camera/orbit",
    "/direct",
    "/environment",
    "/environment/gradient",
    "/filter",
    "/output",
    "/preview",
    "/preview/attenuation",
    "/preview/shadows",
    "/preview/shadows/bias",
    "/shutter",
];

/// Takes away lists in the place of objects, which serde would take for their fields in order, and notes each.
fn take_lists(value: &mut Value) -> Vec<FieldError> {
    let mut faults = Vec::new();
    let mut note = |pointer: String| {
        faults.push(FieldError::new(format!("/params{pointer}"), "must be an object, and is a list"));
    };
    for (parent, name) in OBJECTS.iter().filter_map(|pointer| pointer.rsplit_once('/')) {
        let Some(parent_value) = value.pointer_mut(parent).and_then(Value::as_object_mut) else { continue };
        if parent_value.get(name).is_some_and(Value::is_array) {
            parent_value.shift_remove(name);
            note(format!("{parent}/{name}"));
        }
    }
    for (list, _, objects) in LISTS {
        let entries = value.get_mut(list).and_then(Value::as_array_mut);
        for (index, entry) in entries.into_iter().flatten().enumerate() {
            if entry.is_array() {
                *entry = faultless(list);
                note(format!("/{list}/{index}"));
            }
            let Some(entry) = entry.as_object_mut() else { continue };
            for name in objects {
                if entry.get(*name).is_some_and(Value::is_array) {
                    entry.shift_remove(*name);
                    note(format!("/{list}/{index}/{name}"));
                }
            }
        }
    }
    faults
}

/// An entry of one of [`LISTS`] that nothing is wrong with.
fn faultless(list: &str) -> Value {
    let text = LISTS.iter().find(|(name, ..)| *name == list).map_or("null", |(_, entry, _)| entry);
    serde_json::from_str(text).unwrap_or_default()
}

/// Reads what is not parameters in the same words; places at fault get a pointer from the root of `value`.
///
/// # Errors
/// The first fault.
pub fn read<T: DeserializeOwned>(value: &Value) -> Result<T, FieldError> {
    if !value.is_object() {
        return Err(FieldError::new("", format!("must be a JSON object, and is {}", wording::kind(value))));
    }
    serde_path_to_error::deserialize(value).map_err(|error| Fault::new("", &error).error)
}

/// Reads; on a fault, notes it, takes what is at fault away and reads again, so that all faults are found.
fn from_value(mut value: Value) -> Result<RenderParams, Vec<FieldError>> {
    let mut faults = take_lists(&mut value);
    loop {
        let fault = match serde_path_to_error::deserialize(&value) {
            Ok(params) if faults.is_empty() => return Ok(params),
            Ok(_) => return Err(faults),
            Err(error) => Fault::new("/params", &error),
        };
        let removed = fault.remove_from(&mut value);
        faults.push(fault.error);
        if !removed || faults.len() >= MAX_FAULTS {
            return Err(faults);
        }
    }
}

/// Whole numbers of which there is at least one.
const COUNTS: [&str; 3] = ["width", "height", "max_samples"];

struct Fault {
    path: Vec<String>,
    is_unknown_field: bool,
    error: FieldError,
}

impl Fault {
    fn new(root: &str, error: &serde_path_to_error::Error<serde_json::Error>) -> Self {
        let mut path = names(error.path());
        let message = error.inner().to_string();
        let is_unknown_field = message.starts_with("unknown field");
        // serde places these at the object that they were looked for in.
        if (is_unknown_field || message.starts_with("missing field"))
            && let Some(field) = wording::quoted(&message).next()
            && path.last().is_none_or(|last| last != field)
        {
            path.push(field.to_owned());
        }
        let mut detail = wording::explain(&message);
        if COUNTS.contains(&path.concat().as_str()) {
            detail = detail.replace("not negative", "1 or more");
        }
        let error = FieldError::new(pointer(root, &path), detail);
        Self { path, is_unknown_field, error }
    }

    /// Takes the fault away: an unknown field by itself, else the entry of a list or the top-level field that it lies in.
    fn remove_from(&self, value: &mut Value) -> bool {
        let Some(object) = value.as_object_mut() else { return false };
        match self.path.as_slice() {
            [field] => object.shift_remove(field).is_some(),
            [list, index, ..] if LISTS.iter().any(|(name, ..)| name == list) => replace_entry(object, list, index),
            [parents @ .., field] if self.is_unknown_field => {
                let parent = parents.iter().try_fold(value, |value, name| value.get_mut(name.as_str()));
                parent.and_then(Value::as_object_mut).is_some_and(|parent| parent.shift_remove(field).is_some())
            }
            [field, ..] => object.shift_remove(field).is_some(),
            [] => false,
        }
    }
}

/// Puts a faultless entry in the place of a faulty one, so that the others keep their indices.
fn replace_entry(object: &mut Map<String, Value>, list: &str, index: &str) -> bool {
    let entries = object.get_mut(list).and_then(Value::as_array_mut).zip(index.parse().ok());
    entries.and_then(|(entries, index): (_, usize)| entries.get_mut(index)).is_some_and(|entry| {
        *entry = faultless(list);
        true
    })
}

/// The steps of a path.
pub(super) fn names(path: &Path) -> Vec<String> {
    path.iter().filter_map(name).collect()
}

/// A JSON pointer.
pub(super) fn pointer(root: &str, path: &[String]) -> String {
    path.iter().fold(root.to_owned(), |pointer, name| pointer + "/" + &escaped(name))
}

fn name(segment: &Segment) -> Option<String> {
    match segment {
        Segment::Seq { index } => Some(index.to_string()),
        Segment::Map { key } => Some(key.clone()),
        Segment::Enum { variant } => Some(variant.clone()),
        Segment::Unknown => None,
    }
}

/// RFC 6901.
fn escaped(name: &str) -> String {
    name.replace('~', "~0").replace('/', "~1")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::params::{EnvironmentChoice, LightParams, ToneMapping};

    fn faults(json: &str) -> Vec<(String, String)> {
        from_json(json).unwrap_err().into_iter().map(|fault| (fault.pointer, fault.detail)).collect()
    }

    fn only_fault(json: &str) -> (String, String) {
        let mut faults = faults(json);
        assert_eq!(faults.len(), 1, "{faults:?}");
        faults.remove(0)
    }

    #[test]
    fn absent_fields_have_their_defaults() {
        assert_eq!(from_json("{}").unwrap(), RenderParams::default());
        let params = from_json(r#"{"width": 640, "camera": {"position": [0, 1, 4]}}"#).unwrap();
        assert_eq!((params.width, params.height), (640, 500));
        assert_eq!(params.camera.unwrap().up, [0.0, 1.0, 0.0]);
    }

    #[test]
    fn an_environment_is_absent_null_or_given() {
        let environment = |json| from_json(json).unwrap().environment;
        assert_eq!(environment("{}"), EnvironmentChoice::Auto);
        assert_eq!(environment(r#"{"environment": null}"#), EnvironmentChoice::None);
        let given = environment(r#"{"environment": {"constant": [1, 1, 1]}}"#);
        assert!(matches!(given, EnvironmentChoice::Given(e) if e.constant == Some([1.0; 3])));
    }

    #[test]
    fn what_is_written_is_read_back() {
        let json = r#"{"lights": [{"type": "spot", "position": [0, 3, 0], "direction": [0, -1, 0], "range": 4},
            {"type": "directional", "direction": [1, -1, 0]}, {"type": "ambient"}, {"type": "point", "position": [1, 1, 1]}],
            "environment": null, "camera": {"orbit": {"azimuth_degrees": 10}}, "tone_mapping": "pbr_neutral"}"#;
        let params = from_json(json).unwrap();
        assert!(matches!(params.lights[0], LightParams::Spot { outer_cone_degrees: 45.0, range: Some(4.0), .. }));
        assert_eq!(from_json(&serde_json::to_string(&params).unwrap()).unwrap(), params);
        let defaults = RenderParams::default();
        assert_eq!(from_json(&serde_json::to_string(&defaults).unwrap()).unwrap(), defaults);
    }

    #[test]
    fn faults_name_their_place() {
        let at = |json| only_fault(json).0;
        assert_eq!(at(r#"{"width": "wide"}"#), "/params/width");
        assert_eq!(
            at(r#"{"lights": [{"type": "ambient"}, {"type": "ambient", "intensity": "x"}]}"#),
            "/params/lights/1/intensity"
        );
        assert_eq!(at(r#"{"lights": [{"type": "point"}]}"#), "/params/lights/0/position");
        assert_eq!(at(r#"{"lights": [{"type": "ambient", "range": 2}]}"#), "/params/lights/0/range");
        assert_eq!(at(r#"{"lights": [{"type": "lamp"}]}"#), "/params/lights/0/type");
        assert_eq!(at(r#"{"lights": [{"position": [0, 0, 0]}]}"#), "/params/lights/0/type");
        assert_eq!(at(r#"{"camera": {"position": [1, "a", 3]}}"#), "/params/camera/position/1");
        assert_eq!(at(r#"{"camera": {"position": [1, 3]}}"#), "/params/camera/position");
        assert_eq!(at(r#"{"environment": {"gradient": {"top": [1, 1, 1]}}}"#), "/params/environment/gradient/horizon");
        assert_eq!(at(r#"{"a/b~": 1}"#), "/params/a~1b~0");
        assert_eq!(at("[1]"), "/params");
        assert_eq!(at(r#"{"width": 1"#), "/params");
    }

    #[test]
    fn unknown_names_are_refused_with_the_nearest() {
        let (pointer, detail) = only_fault(r#"{"widht": 640}"#);
        assert_eq!(pointer, "/params/widht");
        assert!(detail.ends_with("Did you mean `width`?"), "{detail}");
        let (pointer, detail) = only_fault(r#"{"camera": {"fov_degrees": 40}}"#);
        assert_eq!(pointer, "/params/camera/fov_degrees");
        assert!(detail.ends_with("Did you mean `yfov_degrees`?"), "{detail}");
        let (pointer, detail) = only_fault(r#"{"tone_mapping": "pbr-neutral"}"#);
        assert_eq!(pointer, "/params/tone_mapping");
        assert!(detail.ends_with("Did you mean `pbr_neutral`?"), "{detail}");
        assert!(!only_fault(r#"{"qqq": 1}"#).1.contains("Did you mean"));
    }

    #[test]
    fn all_faults_come_at_once() {
        let faults = faults(
            r#"{"widht": 1, "height": -5, "seed": 1.5, "camera": {"foo": 1, "bar": 2, "up": 3}, "lights": [{"type": "point"},
            {"type": "ambient"}, {"type": "spot", "position": [0, 0, 0], "colour": [1, 1, 1]}], "filter": []}"#,
        );
        let mut pointers: Vec<&str> = faults.iter().map(|fault| fault.0.as_str()).collect();
        pointers.sort_unstable();
        let expected = [
            "/params/camera/bar",
            "/params/camera/foo",
            "/params/camera/up",
            "/params/filter",
            "/params/height",
            "/params/lights/0/position",
            "/params/lights/2/colour",
            "/params/seed",
            "/params/widht",
        ];
        assert_eq!(pointers, expected);
    }

    #[test]
    fn a_list_is_no_object() {
        let full = r#"{"camera": {"orbit": {}}, "environment": {"gradient":
            {"top": [0, 0, 0], "horizon": [0, 0, 0], "bottom": [0, 0, 0]}}, "filter": {}, "output": {},
            "preview": {"attenuation": {}, "shadows": {"bias": {}}}, "direct": {}, "shutter": {"open": 0, "close": 1},
            "lights": [{"type": "ambient"}, {"type": "ambient"}],
            "spheres": [{"center": [0, 0, 0], "radius": 1, "texture": {"image": "a"}, "height": {"image": "a", "scale": 1},
            "normal": {"image": "a"}, "parallax": {"image": "a", "scale": 1}}],
            "overrides": [{"material": "a", "texture": {"image": "a"}, "height": {"image": "a", "scale": 1},
            "normal": {"image": "a"}, "parallax": {"image": "a", "scale": 1}}]}"#;
        let full: Value = serde_json::from_str(full).unwrap();
        let mut open = vec![String::new()];
        let mut objects = 0;
        while let Some(place) = open.pop() {
            let value = full.pointer(&place).unwrap();
            open.extend(value.as_object().into_iter().flatten().map(|(name, _)| format!("{place}/{name}")));
            open.extend((0..value.as_array().map_or(0, Vec::len)).map(|index| format!("{place}/{index}")));
            if let Some(object) = value.as_object() {
                let mut wrong = full.clone();
                *wrong.pointer_mut(&place).unwrap() = object.values().cloned().collect();
                assert_eq!(only_fault(&wrong.to_string()).0, format!("/params{place}"));
                objects += 1;
            }
        }
        assert_eq!(objects, 1 + OBJECTS.len() + 2 + 2 * (1 + MAPS.len()));
    }

    #[test]
    fn spheres_and_overrides_are_read_each_by_itself() {
        let json = r#"{"spheres": [{"center": [0, 0]}, {"center": [0, 0, 0], "radius": 1, "colour": [1, 1, 1]},
            {"center": [0, 0, 0], "radius": 1, "height": []}, {"center": [0, 0, 0], "radius": 1}],
            "overrides": [{"color": [1, 1, 1]}, {"material": "a", "parallax": {"image": "a", "scale": 1, "method": "deep"}}]}"#;
        let mut pointers: Vec<String> = faults(json).into_iter().map(|fault| fault.0).collect();
        pointers.sort_unstable();
        let expected = [
            "/params/overrides/0/material",
            "/params/overrides/1/parallax/method",
            "/params/spheres/0/center",
            "/params/spheres/1/colour",
            "/params/spheres/2/height",
        ];
        assert_eq!(pointers, expected);
    }

    #[test]
    fn numbers_are_named_as_numbers() {
        assert!(only_fault(r#"{"height": -5}"#).1.contains("expected a whole number, 1 or more"));
        assert!(only_fault(r#"{"seed": -1}"#).1.contains("expected a whole number, not negative"));
        assert!(only_fault(r#"{"exposure": "high"}"#).1.contains("expected a number"));
        assert!(only_fault(r#"{"camera": 3}"#).1.ends_with("expected an object"));
    }

    #[test]
    fn a_query_says_the_same_as_json() {
        let query = from_query([
            ("width", "640"),
            ("tone_mapping", "agx"),
            ("environment", r#"{"constant": [1, 1, 1]}"#),
            ("environment.intensity", "2"),
            ("camera.yfov_degrees", "30"),
            ("camera.name", "42"),
            ("lights.0.type", "point"),
            ("lights.0.position", "[1, 2, 3]"),
        ])
        .unwrap();
        let json = r#"{"width": 640, "tone_mapping": "agx", "environment": {"constant": [1, 1, 1], "intensity": 2},
            "camera": {"yfov_degrees": 30, "name": "42"}, "lights": [{"type": "point", "position": [1, 2, 3]}]}"#;
        assert_eq!(query, from_json(json).unwrap());
        assert_eq!(query.tone_mapping, ToneMapping::Agx);
    }

    #[test]
    fn a_query_overrides_json() {
        let json = r#"{"width": 640, "lights": [{"type": "ambient"}, {"type": "ambient"}]}"#;
        let params = from_json_and_query(json, [("width", "320"), ("lights.1.intensity", "7")]).unwrap();
        assert_eq!(params.width, 320);
        assert!(matches!(params.lights[1], LightParams::Ambient { intensity: 7.0, .. }));
    }
}
