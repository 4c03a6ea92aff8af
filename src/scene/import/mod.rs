//! glTF bytes -> [`Scene`]. The order of the steps is the order of trust: text, structure, references, numbers.

mod accessor;
mod animations;
mod attributes;
mod budget;
mod cameras;
pub(super) mod container;
mod data;
mod document;
mod draco;
mod extended;
mod extensions;
mod instances;
mod luminaires;
mod materials;
mod meshes;
mod meshopt;
mod movable;
mod nodes;
mod number;
mod punctual;
mod references;
mod schema;
mod skins;
mod tangents;
#[cfg(test)]
pub(super) mod testing;
mod textures;
mod triangles;
mod vertices;

use super::error::Warnings;
use super::{Animation, Limits, Package, Path, Primitive, Scene, SceneError};
use budget::Budget;
use data::Data;
use materials::ReadMaterial;
use meshes::{Decoder, Need, Tally};
use nodes::Hierarchy;
use schema::{Lights, Luminaires, Root, Variants};
use std::sync::Arc;
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
    let luminaires: Option<Luminaires> = root_extension(&root, luminaires::NAME)?;
    let variants: Option<Variants> = root_extension(&root, schema::VARIANTS)?;
    let lights = lights.map_or_else(Vec::new, |lights| lights.lights);
    references::check(&root, lights.len(), variants.as_ref().map_or(0, |list| list.variants.len()))?;
    let mut budget = Budget::new(limits, package.bytes());
    let data = Data::new(&root, package, container.bin, limits, &mut budget)?;
    (0..root.accessors.len()).try_for_each(|index| accessor::open(&data, index).map(drop))?;
    meshes::check(&data)?;
    let skins = skins::read(&data, &mut budget)?;
    let mut animations = animations::read(&data, &mut budget, &mut warnings)?;
    let mut hierarchy = nodes::read(&data, limits, &mut budget, &mut warnings)?;
    let profiles = luminaires::read(&data, package, luminaires, &mut budget)?;
    let mut lights = punctual::read(&lights, &mut warnings)?;
    luminaires::place(&data, &mut hierarchy, &profiles, &mut lights, &mut warnings)?;
    animations::find_moved_meshes(&mut animations, &hierarchy.nodes, &skins);

    // Read what the scenes show.
    let textures = textures::read(&root, &mut warnings)?;
    let materials = read_materials(&root, &textures, &mut warnings)?;
    let needs = needs(&root, &hierarchy, &animations);
    let mut decoder = Decoder {
        data: &data,
        materials: &materials,
        limits,
        budget: &mut budget,
        warnings: &mut warnings,
        tally: Tally::default(),
    };
    let meshes = decoder.meshes(&needs)?;
    skins::check_joints(&hierarchy.nodes, &meshes, &skins)?;
    let drawn = meshes.iter().flat_map(|mesh| &mesh.primitives);
    let drawn = drawn.flat_map(|drawn| drawn.alternatives.iter().map(|(_, other)| other).chain([drawn]));
    let images =
        textures::images(&data, package, &used_images(drawn, &materials, &textures, root.images.len()), limits)?;

    Ok(Scene {
        moved: animations::moved(&root, &animations, &hierarchy.nodes, &mut warnings),
        nodes: hierarchy.nodes,
        scenes: hierarchy.scenes,
        default_scene: root.scene,
        meshes: Arc::new(meshes),
        materials: materials.into_iter().map(|read| read.material).collect(),
        textures: textures.list,
        images,
        cameras: cameras::read(&root.cameras, &mut warnings)?,
        lights,
        variants: variants.into_iter().flat_map(|list| list.variants).map(|variant| variant.name).collect(),
        animations: Arc::new(animations),
        skins: Arc::new(skins),
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

/// By mesh: what the nodes of the scenes that show it make of it.
fn needs(root: &Root, hierarchy: &Hierarchy, animations: &[Animation]) -> Vec<Need> {
    let mut needs = vec![Need::default(); root.meshes.len()];
    let mut weighted = vec![false; hierarchy.nodes.len()];
    for channel in animations.iter().flat_map(|animation| &animation.channels) {
        if let Some(weighted) = weighted.get_mut(channel.node).filter(|_| channel.path == Path::Weights) {
            *weighted = true;
        }
    }
    let nodes = hierarchy.nodes.iter().zip(weighted).zip(&hierarchy.shown);
    for ((node, weighted), _) in nodes.filter(|(_, shown)| **shown) {
        if let Some(need) = node.mesh.and_then(|mesh| needs.get_mut(mesh)) {
            need.shown = true;
            need.skinned |= node.skin.is_some();
            need.morphed |= weighted || node.weights.iter().any(|weight| *weight != 0.0);
        }
    }
    needs
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
