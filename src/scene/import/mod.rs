//! glTF bytes -> [`Scene`]. The order of the steps is the order of trust: text, structure, references, numbers.

mod accessor;
mod attributes;
mod cameras;
pub(super) mod container;
mod data;
mod document;
mod extended;
mod extensions;
mod materials;
mod meshes;
mod nodes;
mod number;
mod punctual;
mod references;
mod schema;
mod tangents;
#[cfg(test)]
pub(super) mod testing;
mod textures;
mod triangles;
mod unposed;

use super::error::Warnings;
use super::{Limits, Package, Primitive, Scene, SceneError};
use data::Data;
use materials::ReadMaterial;
use meshes::Decoder;
use nodes::Hierarchy;
use schema::{Lights, Root, Variants};
use textures::Textures;

/// Reads the glTF of a package. Whatever the bytes are, the answer is a scene that is safe to index, or an error with
/// its place.
pub fn import(package: &Package, limits: &Limits) -> Result<Scene, SceneError> {
    let container = container::split(package.root())?;
    let root = document::parse(container.json, limits)?;
    let mut warnings = Warnings::default();
    let extensions = extensions::check(&root, &mut warnings)?;

    // Check the whole structure, drawn or not.
    let lights: Option<Lights> = root_extension(&root, "KHR_lights_punctual")?;
    let variants: Option<Variants> = root_extension(&root, schema::VARIANTS)?;
    let lights = lights.map_or_else(Vec::new, |lights| lights.lights);
    references::check(&root, lights.len(), variants.as_ref().map_or(0, |list| list.variants.len()))?;
    let data = Data::new(&root, package, container.bin, limits)?;
    (0..root.accessors.len()).try_for_each(|index| accessor::open(&data, index).map(drop))?;
    meshes::check(&data)?;
    unposed::check(&data, &mut warnings)?;

    // Read what the scenes show.
    let hierarchy = nodes::read(&root, limits, &mut warnings)?;
    let textures = textures::read(&root, &mut warnings)?;
    let materials = read_materials(&root, &textures, &mut warnings)?;
    let shown = shown_meshes(&root, &hierarchy);
    let meshes = Decoder::new(&data, &materials, limits, package.bytes(), &mut warnings).meshes(&shown)?;
    let drawn = meshes.iter().flat_map(|mesh| &mesh.primitives);
    let drawn = drawn.flat_map(|drawn| drawn.alternatives.iter().map(|(_, other)| other).chain([drawn]));
    let images =
        textures::images(&data, package, &used_images(drawn, &materials, &textures, root.images.len()), limits)?;

    Ok(Scene {
        nodes: hierarchy.nodes,
        scenes: hierarchy.scenes,
        default_scene: root.scene,
        meshes,
        materials: materials.into_iter().map(|read| read.material).collect(),
        textures: textures.list,
        images,
        cameras: cameras::read(&root.cameras, &mut warnings)?,
        lights: punctual::read(&lights, &mut warnings)?,
        variants: variants.into_iter().flat_map(|list| list.variants).map(|variant| variant.name).collect(),
        animation_count: root.animations.len(),
        skin_count: root.skins.len(),
        extensions,
        warnings: warnings.finish(),
    })
}

fn root_extension<T: serde::de::DeserializeOwned>(root: &Root, name: &str) -> Result<Option<T>, SceneError> {
    root.extensions.get(name).map(|content| document::extension(content, &format!("/extensions/{name}"))).transpose()
}

fn read_materials(root: &Root, textures: &Textures, warnings: &mut Warnings) -> Result<Vec<ReadMaterial>, SceneError> {
    let materials = root.materials.iter().enumerate();
    materials.map(|(index, source)| materials::read(source, index, &textures.slots, warnings)).collect()
}

/// By mesh: whether a node of a scene shows it.
fn shown_meshes(root: &Root, hierarchy: &Hierarchy) -> Vec<bool> {
    let mut shown = vec![false; root.meshes.len()];
    for (node, _) in hierarchy.nodes.iter().zip(&hierarchy.shown).filter(|(_, shown)| **shown) {
        if let Some(shown) = node.mesh.and_then(|mesh| shown.get_mut(mesh)) {
            *shown = true;
        }
    }
    shown
}

/// By image: whether a material of a primitive that is drawn reads it.
fn used_images<'a>(
    drawn: impl Iterator<Item = &'a Primitive>,
    materials: &[ReadMaterial],
    textures: &Textures,
    images: usize,
) -> Vec<bool> {
    let mut used = vec![false; images];
    let mut seen = vec![false; materials.len()];
    for index in drawn.filter_map(|primitive| primitive.material) {
        let (Some(seen), Some(read)) = (seen.get_mut(index), materials.get(index)) else { continue };
        if std::mem::replace(seen, true) {
            continue;
        }
        for reference in read.material.textures() {
            if let Some(used) = textures.list.get(reference.texture).and_then(|texture| used.get_mut(texture.image)) {
                *used = true;
            }
        }
    }
    used
}
