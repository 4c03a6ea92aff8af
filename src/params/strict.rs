//! JSON in which no object has a field twice: elsewhere the last one would win in silence.

use super::FieldError;
use serde::de::{Deserialize, Deserializer, Error, MapAccess, SeqAccess, Visitor};
use serde_json::error::Category;
use serde_json::{Map, Value};
use std::fmt;

/// Whole numbers up to this one are those that an f64 holds exactly.
const EXACT: f64 = (1_u64 << 53) as f64;

/// Why a text is not read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum JsonError {
    /// It is no JSON: what, line and column.
    Syntax(String),
    /// A field is given twice.
    Twice(FieldError),
}

/// Reads JSON; places at fault get a pointer that begins with `root`.
pub fn json(text: &str, root: &str) -> Result<Value, JsonError> {
    let mut reader = serde_json::Deserializer::from_str(text);
    let read = serde_path_to_error::deserialize::<_, Strict>(&mut reader).map_err(|error| {
        let pointer = super::parse::pointer(root, &super::parse::names(error.path()));
        match error.inner().classify() {
            Category::Data => JsonError::Twice(FieldError::new(pointer, "given twice: leave one out")),
            _ => JsonError::Syntax(error.inner().to_string()),
        }
    })?;
    reader.end().map_err(|error| JsonError::Syntax(error.to_string()))?;
    Ok(read.0)
}

/// A [`Value`] that was read so.
struct Strict(Value);

impl<'de> Deserialize<'de> for Strict {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(Reader).map(Self)
    }
}

struct Reader;

impl<'de> Visitor<'de> for Reader {
    type Value = Value;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("JSON")
    }

    fn visit_bool<E>(self, value: bool) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_i64<E>(self, value: i64) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_u64<E>(self, value: u64) -> Result<Value, E> {
        Ok(value.into())
    }

    /// `1e5` and `2.0` are whole numbers, as JSON Schema has them.
    fn visit_f64<E>(self, value: f64) -> Result<Value, E> {
        let is_whole = value.fract() == 0.0 && value.abs() <= EXACT && !(value == 0.0 && value.is_sign_negative());
        Ok(if is_whole { Value::from(value as i64) } else { value.into() })
    }

    fn visit_str<E>(self, value: &str) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_unit<E>(self) -> Result<Value, E> {
        Ok(Value::Null)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Value, A::Error> {
        let mut list = Vec::new();
        while let Some(Strict(item)) = items.next_element()? {
            list.push(item);
        }
        Ok(list.into())
    }

    fn visit_map<A: MapAccess<'de>>(self, mut fields: A) -> Result<Value, A::Error> {
        let mut object = Map::new();
        while let Some(name) = fields.next_key::<String>()? {
            if object.contains_key(&name) {
                // The path of this fault ends with the name.
                fields.next_value::<Twice>()?;
            }
            let Strict(value) = fields.next_value()?;
            object.insert(name, value);
        }
        Ok(object.into())
    }
}

/// The value of a field that was there already.
struct Twice;

impl<'de> Deserialize<'de> for Twice {
    fn deserialize<D: Deserializer<'de>>(_: D) -> Result<Self, D::Error> {
        Err(D::Error::custom("given twice"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_field_given_twice_is_named() {
        let twice = |text| match json(text, "/params") {
            Err(JsonError::Twice(fault)) => fault.pointer,
            other => panic!("{other:?}"),
        };
        assert_eq!(twice(r#"{"width": 1, "height": 2, "width": 3}"#), "/params/width");
        assert_eq!(twice(r#"{"lights": [{}, {"a/b": [], "a/b": {}}]}"#), "/params/lights/1/a~1b");
    }

    #[test]
    fn a_whole_number_may_be_written_in_any_way() {
        let text = r#"[1e5, 2.0, -3e0, 1.5, 9007199254740993.0, 1e17, -0.0]"#;
        assert_eq!(json(text, "").unwrap().to_string(), "[100000,2,-3,1.5,9007199254740992,1e+17,-0.0]");
    }

    #[test]
    fn all_other_json_is_read_as_it_is() {
        let text = r#"{"a": [1, -2, 2.5, 1e300, 18446744073709551615, true, null, "\u00e9\n"], "b": {"a": {}}}"#;
        assert_eq!(json(text, ""), Ok(serde_json::from_str(text).unwrap()));
        for text in ["", "{", "{}x", "[1,]", "{\"a\": 1e999}"] {
            assert!(matches!(json(text, ""), Err(JsonError::Syntax(_))), "{text}");
        }
    }
}
