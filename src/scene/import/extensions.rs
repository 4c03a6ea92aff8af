//! What is done about each extension.

use super::schema::Root;
use crate::scene::error::Warnings;
use crate::scene::{ExtensionUse, SceneError};

enum Support {
    /// The picture shows it.
    Honoured,
    /// The picture is right without it, apart from what the note says; a file may require it.
    Harmless(&'static str),
    /// A file that only uses it can be drawn; the note says what is lost.
    Lost(&'static str),
}

use Support::{Harmless, Honoured, Lost};

const TABLE: &[(&str, Support)] = &[
    ("EXT_lights_ies", Honoured),
    ("EXT_mesh_gpu_instancing", Honoured),
    ("EXT_meshopt_compression", Honoured),
    ("EXT_texture_webp", Honoured),
    ("KHR_draco_mesh_compression", Honoured),
    ("KHR_lights_punctual", Honoured),
    ("KHR_materials_anisotropy", Honoured),
    ("KHR_materials_clearcoat", Honoured),
    ("KHR_materials_diffuse_transmission", Honoured),
    ("KHR_materials_dispersion", Honoured),
    ("KHR_materials_emissive_strength", Honoured),
    ("KHR_materials_ior", Honoured),
    ("KHR_materials_iridescence", Honoured),
    ("KHR_materials_pbrSpecularGlossiness", Honoured),
    ("KHR_materials_sheen", Honoured),
    ("KHR_materials_specular", Honoured),
    ("KHR_materials_transmission", Honoured),
    ("KHR_materials_unlit", Honoured),
    ("KHR_materials_variants", Honoured),
    ("KHR_materials_volume", Honoured),
    ("KHR_materials_volume_scatter", Honoured),
    ("KHR_mesh_quantization", Honoured),
    ("KHR_meshopt_compression", Honoured),
    ("KHR_texture_basisu", Honoured),
    ("KHR_texture_transform", Honoured),
    ("KHR_xmp", Harmless("metadata is not read")),
    ("KHR_xmp_json_ld", Harmless("metadata is not read")),
    ("EXT_lights_image_based", Lost("the file's own environment light is left out; give one in `environment`")),
    ("EXT_mesh_manifold", Lost("the manifold topology is not read; the triangles are drawn as stored")),
    ("EXT_texture_avif", Lost("AVIF images are not read; the fallback image is used, or none")),
    ("KHR_animation_pointer", Lost("animated properties keep the values stored in the file")),
    ("KHR_node_hoverability", Lost("nothing in a still picture")),
    ("KHR_node_selectability", Lost("nothing in a still picture")),
    ("KHR_node_visibility", Lost("nodes that are marked invisible are drawn")),
    ("KHR_techniques_webgl", Lost("custom shaders are not run; default materials are drawn")),
    ("MSFT_lod", Lost("the most detailed level is drawn")),
    ("MSFT_texture_dds", Lost("DDS images are not read; the fallback image is used, or none")),
];

fn support(name: &str) -> &'static Support {
    const UNKNOWN: Support = Lost("the extension is not known here; what it adds is left out");
    TABLE.iter().find(|(known, _)| *known == name).map_or(&UNKNOWN, |(_, support)| support)
}

/// How each extension of the file is honoured; fails if one that it requires is not.
pub(super) fn check(root: &Root, warnings: &mut Warnings) -> Result<Vec<ExtensionUse>, SceneError> {
    for (index, name) in root.extensions_required.iter().enumerate() {
        if let Lost(note) = support(name) {
            let detail = format!(
                "the file requires {name}, which is not supported; export it without that extension \
                 (or with a fallback and {name} in `extensionsUsed` only; then: {note})"
            );
            return Err(SceneError::invalid("extension_required", format!("/extensionsRequired/{index}"), detail));
        }
    }
    let mut uses: Vec<ExtensionUse> = Vec::new();
    let used = root.extensions_used.iter().enumerate().map(|(index, name)| (format!("/extensionsUsed/{index}"), name));
    let required = root.extensions_required.iter().enumerate();
    let required = required.map(|(index, name)| (format!("/extensionsRequired/{index}"), name));
    let mut seen = std::collections::HashSet::new();
    for (pointer, name) in used.chain(required) {
        if !seen.insert(name) {
            continue;
        }
        let note = match support(name) {
            Honoured => None,
            Harmless(note) | Lost(note) => Some((*note).to_owned()),
        };
        if let (Lost(_), Some(note)) = (support(name), &note) {
            warnings.add("extension_ignored", pointer, format!("{name}: {note}"));
        }
        uses.push(ExtensionUse { name: name.clone(), honoured: note.is_none(), note });
    }
    Ok(uses)
}

/// Whether the file declares an extension.
pub(super) fn declared(root: &Root, name: &str) -> bool {
    root.extensions_used.iter().chain(&root.extensions_required).any(|declared| declared == name)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn root(used: &[&str], required: &[&str]) -> Root {
        let owned = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect();
        Root { extensions_used: owned(used), extensions_required: owned(required), ..Root::default() }
    }

    #[test]
    fn only_a_required_and_unsupported_extension_is_refused() {
        let mut warnings = Warnings::default();
        let error = check(&root(&[], &["KHR_materials_unlit", "MSFT_lod"]), &mut warnings).unwrap_err();
        assert_eq!(error.pointer, "/extensionsRequired/1");
        assert!(error.detail.contains("MSFT_lod"));
        let uses =
            check(&root(&["KHR_animation_pointer", "X_new", "KHR_xmp"], &["KHR_xmp_json_ld"]), &mut warnings).unwrap();
        assert_eq!(uses.len(), 4);
        assert!(uses.iter().all(|extension| !extension.honoured && extension.note.is_some()));
        let codes: Vec<_> = warnings.finish().into_iter().map(|warning| (warning.code, warning.pointer)).collect();
        assert_eq!(
            codes,
            [("extension_ignored", "/extensionsUsed/0".into()), ("extension_ignored", "/extensionsUsed/1".into())]
        );
    }
}
