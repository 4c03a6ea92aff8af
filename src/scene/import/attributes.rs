//! Which accessors may serve as which attribute (glTF 2.0, 3.7.2.1, and KHR_mesh_quantization).

use super::accessor::{Accessor, Component, Format, open};
use super::data::Data;
use super::document::escape;
use super::schema::Primitive;
use crate::scene::SceneError;

/// Checks types and counts of all attributes of a primitive at `place`; the number of its vertices, if it has positions.
/// `quantized`: the file declares KHR_mesh_quantization.
pub(super) fn check(
    data: &Data<'_>,
    primitive: &Primitive,
    quantized: bool,
    place: &str,
) -> Result<Option<usize>, SceneError> {
    let positions = primitive.attributes.get("POSITION").map(|index| open(data, *index)).transpose()?;
    let count = positions.map(|positions| positions.count);
    for (name, index) in &primitive.attributes {
        let accessor = open(data, *index)?;
        let place = || format!("{place}/attributes/{}", escape(name));
        check_format(name, accessor.format, quantized, &place)?;
        check_count(&accessor, count, &place)?;
    }
    for (target, attributes) in primitive.targets.iter().enumerate() {
        for (name, index) in attributes {
            let accessor = open(data, *index)?;
            let place = || format!("{place}/targets/{target}/{}", escape(name));
            check_target(name, accessor.format, quantized, &place)?;
            check_count(&accessor, count, &place)?;
        }
    }
    Ok(count)
}

fn check_count(accessor: &Accessor<'_>, count: Option<usize>, place: &dyn Fn() -> String) -> Result<(), SceneError> {
    match count {
        Some(count) if count != accessor.count => {
            let detail = format!(
                "{} elements, but POSITION has {count}; all attributes of a primitive need the same number",
                accessor.count
            );
            Err(SceneError::invalid("accessor_count", place(), detail))
        }
        _ => Ok(()),
    }
}

fn check_format(name: &str, format: Format, quantized: bool, place: &dyn Fn() -> String) -> Result<(), SceneError> {
    let Some((core, quantizable)) = allowed(name, format) else { return Ok(()) };
    if core || (quantized && quantizable) {
        return Ok(());
    }
    let hint = if quantizable { "; it is with KHR_mesh_quantization, which the file does not declare" } else { "" };
    let detail = format!("{format} is not allowed for {name}{hint}");
    Err(SceneError::invalid("accessor_type", place(), detail))
}

/// Differences of morph targets: three numbers, tangents too (3.7.2.2).
fn check_target(name: &str, format: Format, quantized: bool, place: &dyn Fn() -> String) -> Result<(), SceneError> {
    let small = !matches!(format.component, Component::F32 | Component::U32);
    let allowed = format.component == Component::F32 || (quantized && small);
    if !["POSITION", "NORMAL", "TANGENT"].contains(&name) || ((format.rows, format.columns) == (3, 1) && allowed) {
        return Ok(());
    }
    let detail = format!("{format} is not allowed for {name} of a morph target");
    Err(SceneError::invalid("accessor_type", place(), detail))
}

/// Whether a semantic takes a format by core glTF, and by KHR_mesh_quantization; none: not a semantic of triangles.
fn allowed(name: &str, format: Format) -> Option<(bool, bool)> {
    use Component::{F32, I8, I16, U8, U16};
    let semantic = name.trim_end_matches(|c: char| c.is_ascii_digit());
    let rows = |allowed: &[usize]| format.columns == 1 && allowed.contains(&format.rows);
    let is = |component: Component| format.component == component;
    let small = is(I8) || is(U8) || is(I16) || is(U16);
    let unit = (is(U8) || is(U16)) && format.normalized;
    Some(match semantic {
        "POSITION" => (rows(&[3]) && is(F32), rows(&[3]) && small),
        "NORMAL" => (rows(&[3]) && is(F32), rows(&[3]) && (is(I8) || is(I16)) && format.normalized),
        "TANGENT" => (rows(&[4]) && is(F32), rows(&[4]) && (is(I8) || is(I16)) && format.normalized),
        "TEXCOORD_" => (rows(&[2]) && (is(F32) || unit), rows(&[2]) && small),
        "COLOR_" => (rows(&[3, 4]) && (is(F32) || unit), false),
        "JOINTS_" => (rows(&[4]) && (is(U8) || is(U16)) && !format.normalized, false),
        "WEIGHTS_" => (rows(&[4]) && (is(F32) || unit), false),
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use crate::scene::import::testing::{Builder, error_of, scene_of};
    use glam::Vec3;
    use serde_json::json;

    #[test]
    fn quantised_positions_need_the_extension() {
        let mut builder = Builder::default();
        let bytes: Vec<u8> =
            [0_i16, 0, 0, 0, 32767, 0, 0, 0, 0, 32767, 0, 0].iter().flat_map(|x| x.to_le_bytes()).collect();
        let view = builder.view(&bytes);
        builder.json["bufferViews"][view]["byteStride"] = json!(8);
        builder.json["accessors"] =
            json!([{"bufferView": 0, "componentType": 5122, "normalized": true, "count": 3, "type": "VEC3"}]);
        builder.show(&json!([{"attributes": {"POSITION": 0}}]));
        let fault = error_of(&builder);
        assert_eq!(
            (fault.code, fault.pointer.as_str()),
            ("accessor_type", "/meshes/0/primitives/0/attributes/POSITION")
        );
        assert!(fault.detail.contains("KHR_mesh_quantization"));
        builder.json["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
        assert_eq!(scene_of(&builder).meshes[0].primitives[0].positions, [Vec3::ZERO, Vec3::X, Vec3::Y]);
    }

    #[test]
    fn attributes_must_suit_their_semantic() {
        let place = |name: &str, kind: &str, values: &[f32]| {
            let mut builder = Builder::triangle();
            builder.attribute(name, values, kind);
            let fault = error_of(&builder);
            (fault.code, fault.pointer.replace("/meshes/0/primitives/0/attributes/", ""))
        };
        assert_eq!(place("NORMAL", "VEC3", &[0.0; 6]), ("accessor_count", "NORMAL".into()));
        assert_eq!(place("NORMAL", "VEC2", &[0.0; 6]), ("accessor_type", "NORMAL".into()));
        assert_eq!(place("TEXCOORD_1", "VEC3", &[0.0; 9]), ("accessor_type", "TEXCOORD_1".into()));
        assert_eq!(place("COLOR_0", "SCALAR", &[0.0; 3]), ("accessor_type", "COLOR_0".into()));
        assert_eq!(place("JOINTS_0", "VEC4", &[0.0; 12]), ("accessor_type", "JOINTS_0".into()));
    }
}
