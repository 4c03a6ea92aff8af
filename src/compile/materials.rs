//! Materials of the file -> materials in use.

use super::alpha::AlphaTest;
use super::emitters::Emission;
use super::extended::{self, Extended};
use super::features::MIRROR_ROUGHNESS;
use super::look::{Look, Relief};
use super::texels::Texels;
use super::textures::{Space, Textures};
use super::{CompiledScene, Detail, Material, NONE, Slot, Triangle};
use crate::scene::{self, AlphaMode, TextureRef};
use std::collections::{BTreeMap, BTreeSet, HashMap};

/// Index into [`Look::materials`]; none: the default material.
pub type Key = Option<usize>;

/// The material behind a key.
pub fn source(look: &Look, key: Key) -> scene::Material {
    key.and_then(|index| look.materials.get(index)).cloned().unwrap_or_default()
}

/// The textures that the material behind a key reads. Unlit: its base colour alone.
pub fn uses(look: &Look, key: Key) -> Vec<(Space, TextureRef)> {
    let material = &source(look, key);
    let relief = key.and_then(|index| look.reliefs.get(&index)).filter(|_| !material.unlit);
    let relief = relief.map(|relief| (relief_space(relief), relief.map));
    own_uses(material).into_iter().chain(relief).collect()
}

/// How the texels of a relief are read.
fn relief_space(relief: &Relief) -> Space {
    if relief.kind == Detail::NORMAL { Space::Data } else { Space::Height }
}

fn own_uses(material: &scene::Material) -> Vec<(Space, TextureRef)> {
    let lit = [
        (Space::Color, material.emissive_texture.filter(|_| emits(material))),
        (Space::Data, material.metallic_roughness_texture),
        (Space::Data, material.normal_texture),
    ];
    let base = [(Space::Color, material.base_color_texture)];
    let extended = material.extended.iter().flat_map(|extended| extended::uses(extended));
    let lit = lit.into_iter().chain(extended).filter(|_| !material.unlit);
    base.into_iter().chain(lit).filter_map(|(space, use_)| Some((space, use_?))).collect()
}

fn emits(material: &scene::Material) -> bool {
    !material.unlit && material.emissive.max_element() > 0.0
}

/// Materials in use, each distinct one once.
#[derive(Debug, Default)]
pub struct Table {
    /// As kernels read them.
    pub materials: Vec<Material>,
    /// What extensions add to some of them.
    pub extended: Vec<Extended>,
    /// Reliefs of some of them.
    pub details: Vec<Detail>,
    index: BTreeMap<Key, usize>,
    modes: Vec<AlphaMode>,
}

impl Table {
    /// Compiles the materials behind the keys.
    pub fn new(look: &Look, keys: &BTreeSet<Key>, textures: &Textures) -> Self {
        let mut table = Self::default();
        let mut known: HashMap<Vec<u8>, usize> = HashMap::new();
        let mut known_extended: HashMap<Vec<u8>, u32> = HashMap::new();
        for key in keys {
            let source = source(look, *key);
            let mut material = compile(look, &source, textures);
            if let Some(extended) = source.extended.as_ref().filter(|_| !source.unlit) {
                let extended = Extended::new(look, extended, textures);
                let place = known_extended.entry(bytemuck::bytes_of(&extended).to_vec()).or_insert_with(|| {
                    table.extended.push(extended);
                    table.extended.len() as u32
                });
                material.flags |= *place << Material::EXTENDED_SHIFT;
            }
            if let Some(relief) = key.and_then(|index| look.reliefs.get(&index)).filter(|_| !source.unlit) {
                let map = textures.slot(look, relief_space(relief), Some(relief.map));
                let (kind, scale, steps) = (relief.kind, relief.scale, relief.steps);
                let self_shadow = u32::from(relief.self_shadow);
                table.details.push(Detail { kind, scale, steps, self_shadow, map });
                material.detail = table.details.len() as u32;
            }
            let next = table.materials.len();
            let index = *known.entry(bytemuck::bytes_of(&material).to_vec()).or_insert(next);
            if index == next {
                table.materials.push(material);
                table.modes.push(source.alpha_mode);
            }
            table.index.insert(*key, index);
        }
        table
    }

    /// Index of the material behind a key.
    pub fn index(&self, key: Key) -> usize {
        self.index.get(&key).copied().unwrap_or(0)
    }

    /// Whether no light passes through a triangle.
    pub fn is_opaque(&self, triangle: &Triangle) -> bool {
        let material = self.materials.get(triangle.material());
        let place = material.and_then(|material| (material.flags >> Material::EXTENDED_SHIFT).checked_sub(1));
        let extended = place.and_then(|place| self.extended.get(place as usize));
        let passes = extended.is_some_and(|e| e.transmission > 0.0 || e.diffuse_transmission > 0.0);
        triangle.material & Triangle::ALPHA == 0 && !passes
    }

    /// What decides on each material's alpha.
    pub fn alpha_tests<'a>(&'a self, textures: &'a Textures) -> Vec<AlphaTest<'a>> {
        let parts = self.materials.iter().zip(&self.modes);
        parts.map(|(material, mode)| AlphaTest::new(material, *mode, &textures.color)).collect()
    }

    /// What decides on each material's emission.
    pub fn emissions<'a>(&'a self, textures: &'a Textures) -> Vec<Emission<'a>> {
        self.materials.iter().map(|material| Emission::new(material, &textures.color)).collect()
    }
}

fn compile(look: &Look, source: &scene::Material, textures: &Textures) -> Material {
    let lit = !source.unlit;
    let slot = |space, use_: Option<TextureRef>, read: bool| textures.slot(look, space, use_.filter(|_| read));
    let flag = |set: bool, bit: u32| if set { bit } else { 0 };
    Material {
        base_color: source.base_color.to_array(),
        emissive: if emits(source) { source.emissive.to_array() } else { [0.0; 3] },
        roughness: source.roughness,
        metallic: source.metallic,
        normal_scale: source.normal_scale,
        alpha_cutoff: match source.alpha_mode {
            AlphaMode::Opaque => -2.0,
            AlphaMode::Blend => -1.0,
            AlphaMode::Mask { cutoff } => cutoff.max(0.0),
        },
        flags: flag(source.double_sided, Material::DOUBLE_SIDED)
            | flag(source.unlit, Material::UNLIT)
            | flag(lit && source.extended.as_ref().is_some_and(|e| e.volume.is_some()), Material::FILLED),
        base_color_texture: slot(Space::Color, source.base_color_texture, true),
        emissive_texture: slot(Space::Color, source.emissive_texture, emits(source)),
        metallic_roughness_texture: slot(Space::Data, source.metallic_roughness_texture, lit),
        normal_texture: slot(Space::Data, source.normal_texture, lit),
        ..Material::default()
    }
}

/// See [`CompiledScene::min_roughness`].
pub fn min_roughness(compiled: &CompiledScene) -> f32 {
    let lit = compiled.materials.iter().filter(|material| material.flags & Material::UNLIT == 0);
    let lowest = lit.map(|material| {
        if let Some(extended) = material.extended(compiled) {
            // Coats and glossiness maps have a roughness of their own.
            let coat = extended.clearcoat > 0.0 && extended.clearcoat_roughness < MIRROR_ROUGHNESS;
            let map = extended.texture(Slot::ClearcoatRoughness).info != NONE
                || extended.flags & Extended::SPECULAR_GLOSSINESS != 0;
            if coat || map {
                return 0.0;
            }
        }
        let texels = Texels::new(&compiled.data_pages, &material.metallic_roughness_texture);
        let texture = texels.and_then(|texels| texels.iter().map(|texel| texel[1]).min());
        material.roughness * texture.map_or(1.0, |green| f32::from(green) / 255.0)
    });
    lowest.fold(1.0, f32::min)
}
