//! Every index in the document names something that is there.

use super::data::missing;
use super::document;
use super::schema::{NodeLight, Root, TextureInfo, VARIANTS, VariantMappings};
use crate::scene::SceneError;

/// Checks all references but those of accessors and buffer views, which are checked as they are opened.
pub(super) fn check(root: &Root, lights: usize, variants: usize) -> Result<(), SceneError> {
    one(root.scene, root.scenes.len(), "scene", || "/scene".into())?;
    for (i, scene) in root.scenes.iter().enumerate() {
        all(&scene.nodes, root.nodes.len(), "node", || format!("/scenes/{i}/nodes"))?;
    }
    nodes(root, lights)?;
    meshes(root, variants)?;
    materials(root)?;
    for (i, texture) in root.textures.iter().enumerate() {
        one(texture.sampler, root.samplers.len(), "sampler", || format!("/textures/{i}/sampler"))?;
        one(texture.source, root.images.len(), "image", || format!("/textures/{i}/source"))?;
    }
    for (i, image) in root.images.iter().enumerate() {
        one(image.buffer_view, root.buffer_views.len(), "buffer view", || format!("/images/{i}/bufferView"))?;
    }
    for (i, accessor) in root.accessors.iter().enumerate() {
        one(accessor.buffer_view, root.buffer_views.len(), "buffer view", || format!("/accessors/{i}/bufferView"))?;
    }
    Ok(())
}

/// Checks one reference.
pub(super) fn one(
    index: Option<usize>,
    length: usize,
    what: &str,
    place: impl Fn() -> String,
) -> Result<(), SceneError> {
    match index {
        Some(index) if index >= length => Err(missing(&place(), what, index)),
        _ => Ok(()),
    }
}

/// Checks a list of references.
pub(super) fn all(list: &[usize], length: usize, what: &str, place: impl Fn() -> String) -> Result<(), SceneError> {
    list.iter().enumerate().try_for_each(|(i, index)| one(Some(*index), length, what, || format!("{}/{i}", place())))
}

fn nodes(root: &Root, lights: usize) -> Result<(), SceneError> {
    for (i, node) in root.nodes.iter().enumerate() {
        all(&node.children, root.nodes.len(), "node", || format!("/nodes/{i}/children"))?;
        one(node.mesh, root.meshes.len(), "mesh", || format!("/nodes/{i}/mesh"))?;
        one(node.camera, root.cameras.len(), "camera", || format!("/nodes/{i}/camera"))?;
        one(node.skin, root.skins.len(), "skin", || format!("/nodes/{i}/skin"))?;
        if let Some(light) = node.extensions.get("KHR_lights_punctual") {
            let place = format!("/nodes/{i}/extensions/KHR_lights_punctual");
            let light: NodeLight = document::extension(light, &place)?;
            one(Some(light.light), lights, "light", || format!("{place}/light"))?;
        }
    }
    Ok(())
}

fn meshes(root: &Root, variants: usize) -> Result<(), SceneError> {
    let accessors = root.accessors.len();
    for (i, mesh) in root.meshes.iter().enumerate() {
        for (j, primitive) in mesh.primitives.iter().enumerate() {
            let place = |rest: &str| format!("/meshes/{i}/primitives/{j}/{rest}");
            one(primitive.indices, accessors, "accessor", || place("indices"))?;
            one(primitive.material, root.materials.len(), "material", || place("material"))?;
            if let Some(content) = primitive.extensions.get(VARIANTS) {
                let place = place(&format!("extensions/{VARIANTS}"));
                let mappings: VariantMappings = document::extension(content, &place)?;
                for (k, mapping) in mappings.mappings.iter().enumerate() {
                    let place = format!("{place}/mappings/{k}");
                    one(Some(mapping.material), root.materials.len(), "material", || format!("{place}/material"))?;
                    all(&mapping.variants, variants, "variant", || format!("{place}/variants"))?;
                }
            }
            for (name, index) in &primitive.attributes {
                one(Some(*index), accessors, "accessor", || place(&format!("attributes/{}", document::escape(name))))?;
            }
            for (k, target) in primitive.targets.iter().enumerate() {
                for (name, index) in target {
                    one(Some(*index), accessors, "accessor", || {
                        place(&format!("targets/{k}/{}", document::escape(name)))
                    })?;
                }
            }
        }
    }
    Ok(())
}

fn materials(root: &Root) -> Result<(), SceneError> {
    for (i, material) in root.materials.iter().enumerate() {
        let pbr = &material.pbr_metallic_roughness;
        let textures: [(&Option<TextureInfo>, &str); 5] = [
            (&pbr.base_color_texture, "pbrMetallicRoughness/baseColorTexture"),
            (&pbr.metallic_roughness_texture, "pbrMetallicRoughness/metallicRoughnessTexture"),
            (&material.normal_texture, "normalTexture"),
            (&material.occlusion_texture, "occlusionTexture"),
            (&material.emissive_texture, "emissiveTexture"),
        ];
        for (texture, name) in textures {
            let index = texture.as_ref().map(|texture| texture.index);
            one(index, root.textures.len(), "texture", || format!("/materials/{i}/{name}/index"))?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use crate::scene::import::testing::{error, gltf};
    use serde_json::json;

    #[test]
    fn dangling_references_are_named() {
        let light = json!({"KHR_lights_punctual": {"light": 0}});
        let cases = [
            (json!({"scene": 0}), "/scene"),
            (json!({"scenes": [{"nodes": [0]}]}), "/scenes/0/nodes/0"),
            (json!({"nodes": [{"children": [1]}]}), "/nodes/0/children/0"),
            (json!({"nodes": [{"mesh": 0}]}), "/nodes/0/mesh"),
            (json!({"nodes": [{"camera": 0}]}), "/nodes/0/camera"),
            (json!({"nodes": [{"skin": 0}]}), "/nodes/0/skin"),
            (json!({"nodes": [{"extensions": light}]}), "/nodes/0/extensions/KHR_lights_punctual/light"),
            (
                json!({"meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}]}),
                "/meshes/0/primitives/0/attributes/POSITION",
            ),
            (json!({"meshes": [{"primitives": [{"attributes": {}, "indices": 0}]}]}), "/meshes/0/primitives/0/indices"),
            (
                json!({"meshes": [{"primitives": [{"attributes": {}, "material": 0}]}]}),
                "/meshes/0/primitives/0/material",
            ),
            (
                json!({"meshes": [{"primitives": [{"attributes": {}, "targets": [{"NORMAL": 3}]}]}]}),
                "/meshes/0/primitives/0/targets/0/NORMAL",
            ),
            (json!({"materials": [{"occlusionTexture": {"index": 0}}]}), "/materials/0/occlusionTexture/index"),
            (json!({"textures": [{"source": 0}]}), "/textures/0/source"),
            (json!({"textures": [{"sampler": 0}]}), "/textures/0/sampler"),
            (json!({"images": [{"bufferView": 0}]}), "/images/0/bufferView"),
            (
                json!({"accessors": [{"bufferView": 0, "componentType": 5126, "count": 1, "type": "SCALAR"}]}),
                "/accessors/0/bufferView",
            ),
            (json!({"skins": [{"joints": [0]}]}), "/skins/0/joints/0"),
            (
                json!({"animations": [{"samplers": [], "channels": [{"sampler": 0, "target": {"path": "scale"}}]}]}),
                "/animations/0/channels/0/sampler",
            ),
        ];
        for (json, pointer) in cases {
            let fault = error(&gltf(json));
            assert_eq!((fault.code, fault.pointer.as_str()), ("reference", pointer));
        }
    }
}
