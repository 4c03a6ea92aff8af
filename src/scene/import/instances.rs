//! EXT_mesh_gpu_instancing: places of a node's mesh.

use super::accessor::{Accessor, Component, open};
use super::budget::Budget;
use super::data::Data;
use super::document;
use super::number::not_finite;
use super::references::one;
use super::schema::{Instancing, Node};
use crate::scene::SceneError;
use glam::{DAffine3, DQuat, DVec3};
use std::sync::Arc;

/// The extension's name.
pub(super) const NAME: &str = "EXT_mesh_gpu_instancing";

/// The places of a node's mesh relative to the node; none: it has not the extension.
pub(super) fn read(
    data: &Data<'_>,
    node: &Node,
    place: &str,
    budget: &mut Budget,
) -> Result<Option<Arc<[DAffine3]>>, SceneError> {
    let Some(content) = node.extensions.get(NAME) else { return Ok(None) };
    let place = format!("{place}/extensions/{NAME}");
    let instancing: Instancing = document::extension(content, &place)?;
    let mut count = None;
    for (name, index) in &instancing.attributes {
        let place = format!("{place}/attributes/{}", document::escape(name));
        one(Some(*index), data.root.accessors.len(), "accessor", || place.clone())?;
        let accessor = open(data, *index)?;
        check_format(name, &accessor, &place)?;
        if *count.get_or_insert(accessor.count) != accessor.count {
            let detail = format!("{} elements, but the attributes before it have another number", accessor.count);
            return Err(SceneError::invalid("accessor_count", place, detail));
        }
    }
    let count = count.unwrap_or(0);
    budget.charge((count * size_of::<DAffine3>()) as u64, count, &place)?;
    let attribute = |name: &str, budget: &mut Budget| {
        let Some(index) = instancing.attributes.get(name) else { return Ok(None) };
        let accessor = open(data, *index)?;
        budget.charge((count * size_of::<[f32; 4]>()) as u64, count, &accessor.pointer)?;
        let values = accessor.numbers::<4>(None, 0.0)?;
        match values.iter().position(|value| value.iter().any(|number| !number.is_finite())) {
            Some(instance) => Err(not_finite(&format!("{place}/attributes/{name}"), format!("instance {instance}"))),
            None => Ok(Some(values)),
        }
    };
    let translations = attribute("TRANSLATION", budget)?;
    let rotations = attribute("ROTATION", budget)?;
    let scales = attribute("SCALE", budget)?;
    let vector = |list: &Option<Vec<[f32; 4]>>, instance: usize, default: DVec3| {
        list.as_ref()
            .and_then(|list| list.get(instance))
            .map_or(default, |&[x, y, z, _]| DVec3::new(x.into(), y.into(), z.into()))
    };
    let at = |instance: usize| {
        let rotation = rotations.as_ref().and_then(|list| list.get(instance));
        let rotation = rotation.map_or(DQuat::IDENTITY, |numbers| DQuat::from_array(numbers.map(f64::from)));
        if rotation.length() < 1e-6 {
            let detail =
                format!("the quaternion of instance {instance} has no direction; write a unit quaternion (x, y, z, w)");
            return Err(SceneError::invalid("rotation", format!("{place}/attributes/ROTATION"), detail));
        }
        Ok(DAffine3::from_scale_rotation_translation(
            vector(&scales, instance, DVec3::ONE),
            rotation.normalize(),
            vector(&translations, instance, DVec3::ZERO),
        ))
    };
    (0..count).map(at).collect::<Result<Arc<_>, _>>().map(Some)
}

fn check_format(name: &str, accessor: &Accessor<'_>, place: &str) -> Result<(), SceneError> {
    let format = accessor.format;
    let float = format.component == Component::F32;
    let small = matches!(format.component, Component::I8 | Component::I16) && format.normalized;
    let right = match name {
        "TRANSLATION" | "SCALE" => (format.rows, format.columns) == (3, 1) && float,
        "ROTATION" => (format.rows, format.columns) == (4, 1) && (float || small),
        // Custom attributes.
        _ => true,
    };
    if right {
        return Ok(());
    }
    Err(SceneError::invalid("accessor_type", place, format!("{format} is not allowed for {name} of {NAME}")))
}

#[cfg(test)]
mod tests {
    use crate::scene::describe;
    use crate::scene::import::testing::{Builder, error_of, scene_of};
    use glam::DVec3;
    use serde_json::json;

    fn instanced() -> Builder {
        let mut builder = Builder::triangle();
        let places = builder.accessor(&[0.0, 0.0, 0.0, 5.0, 0.0, 0.0], "VEC3");
        let scales = builder.accessor(&[1.0, 1.0, 1.0, 2.0, 2.0, -2.0], "VEC3");
        let attributes = json!({"TRANSLATION": places, "SCALE": scales});
        builder.json["nodes"][0]["translation"] = json!([0, 1, 0]);
        builder.json["nodes"][0]["extensions"] = json!({"EXT_mesh_gpu_instancing": {"attributes": attributes}});
        builder.json["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing"]);
        builder
    }

    #[test]
    fn a_mesh_is_drawn_at_each_place() {
        let scene = scene_of(&instanced());
        let drawn = scene.drawn(0).unwrap();
        assert_eq!(drawn[0].worlds.len(), 2);
        assert_eq!(drawn[0].worlds[1].transform_point3(DVec3::X), DVec3::new(7.0, 1.0, 0.0));
        let description = describe(&scene);
        assert_eq!((description.counts.instanced_triangles, description.bounds.unwrap().max), (2, [7.0, 3.0, 0.0]));
    }

    #[test]
    fn faults_are_named() {
        let fault = |name: &str, kind: &str, values: &[f32]| {
            let mut builder = instanced();
            let accessor = builder.accessor(values, kind);
            builder.json["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"][name] = json!(accessor);
            let fault = error_of(&builder);
            (fault.code, fault.pointer.rsplit('/').next().unwrap_or_default().to_owned())
        };
        assert_eq!(fault("ROTATION", "VEC4", &[0.0; 8]), ("rotation", "ROTATION".into()));
        assert_eq!(fault("ROTATION", "VEC3", &[0.0; 6]), ("accessor_type", "ROTATION".into()));
        assert_eq!(fault("TRANSLATION", "VEC3", &[f32::NAN; 6]), ("not_finite", "TRANSLATION".into()));
        assert_eq!(fault("_ID", "SCALAR", &[0.0; 3]).0, "accessor_count");
        let mut huge = instanced();
        for accessor in [1, 2] {
            huge.json["accessors"][accessor]["count"] = json!(3_000_000_000_u32);
            huge.json["accessors"][accessor].as_object_mut().unwrap().remove("bufferView");
        }
        assert_eq!(error_of(&huge).code, "decoded_bytes");
    }
}
