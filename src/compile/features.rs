//! What a picture needs. A feature that no material, light or camera uses costs nothing: each becomes an override
//! constant of the kernel, and the driver removes what is dead.

use super::{
    CompiledScene, Environment, EnvironmentKind, Extended, Lens, Lighting, Material, NONE, TextureSlot, Triangle, View,
};
use crate::params::{Mode, RenderParams};
use glam::Vec3;

/// Needs of a (scene, lighting, view) triple.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, serde::Serialize, serde::Deserialize)]
pub struct Features {
    /// Rays pass a top level of instances.
    pub two_level: bool,
    /// Some triangle's alpha must be tested.
    pub alpha: bool,
    /// Some material is seen from the front only.
    pub one_sided: bool,
    /// Some mesh has normals.
    pub normals: bool,
    /// Some mesh has colours.
    pub colors: bool,
    /// Some material reads a base colour texture.
    pub base_color_texture: bool,
    /// Some material reads a metallic-roughness texture.
    pub metallic_roughness_texture: bool,
    /// Some material reads a normal map.
    pub normal_texture: bool,
    /// Some material reads an emissive texture.
    pub emissive_texture: bool,
    /// Some material is unlit.
    pub unlit: bool,
    /// Some material has a specular lobe that must be evaluated (all but none).
    pub specular: bool,
    /// Some material has roughness so low that it is a perfect mirror (or a texture that may say so).
    pub mirror: bool,
    /// Some material has extensions.
    pub extended: bool,
    /// Some surface lets light through.
    pub transmission: bool,
    /// Some mesh is filled with something that light gets into.
    pub volume: bool,
    /// Light is scattered inside some.
    pub scatter: bool,
    /// Some surface lets shadow rays pass straight.
    pub thin: bool,
    /// Some light passes diffusely.
    pub diffuse_transmission: bool,
    /// Some material splits light into colours.
    pub dispersion: bool,
    /// Some material has a coat.
    pub clearcoat: bool,
    /// Some material has sheen.
    pub sheen: bool,
    /// Some material has a grain.
    pub anisotropy: bool,
    /// Some material has a thin film.
    pub iridescence: bool,
    /// There are spheres.
    pub spheres: bool,
    /// Some material has a relief.
    pub detail: bool,
    /// There are punctual lights.
    pub punctual: bool,
    /// Some of them have a measured profile.
    pub profiles: bool,
    /// There are lights with an extent.
    pub extended_lights: bool,
    /// There are emitting triangles.
    pub emitters: bool,
    /// They are drawn from a tree.
    pub light_tree: bool,
    /// Kind of environment: 0 none, 1 constant (of black, if there is nothing but ambient light), 2 gradient, 3 HDRI.
    pub environment: u32,
    /// The lens has an extent.
    pub thin_lens: bool,
    /// Parallel projection.
    pub orthographic: bool,
    /// The shutter is open for some time, in which something moves.
    pub motion: bool,
}

/// Perceptual roughness below which a surface is a perfect mirror.
pub const MIRROR_ROUGHNESS: f32 = 0.01;

/// What the scene, its light and its camera need together.
pub fn features(scene: &CompiledScene, lighting: &Lighting, view: &View, params: &RenderParams) -> Features {
    let some = |test: &dyn Fn(&Material) -> bool| scene.materials.iter().any(test);
    let reads = |slot: fn(&Material) -> &TextureSlot| some(&|material| slot(material).info != NONE);
    let extension = |test: &dyn Fn(&Extended) -> bool| scene.extended.iter().any(test);
    let path = params.mode == Mode::Path;
    Features {
        two_level: scene.two_level,
        alpha: scene.triangles.iter().any(|triangle| triangle.material & Triangle::ALPHA != 0),
        one_sided: some(&|material| material.flags & Material::DOUBLE_SIDED == 0),
        normals: scene.layout.normal != NONE,
        colors: scene.layout.color != NONE,
        base_color_texture: reads(|material| &material.base_color_texture),
        metallic_roughness_texture: reads(|material| &material.metallic_roughness_texture),
        normal_texture: reads(|material| &material.normal_texture),
        emissive_texture: reads(|material| &material.emissive_texture),
        unlit: some(&|material| material.flags & Material::UNLIT != 0),
        specular: some(&|material| material.flags & Material::UNLIT == 0 && !is_matte(scene, material)),
        mirror: scene.min_roughness < MIRROR_ROUGHNESS,
        extended: !scene.extended.is_empty(),
        transmission: extension(&|extended| extended.transmission > 0.0),
        volume: extension(&|extended| extended.flags & Extended::THICK != 0),
        scatter: path && extension(&Extended::scatters),
        thin: extension(&Extended::passes_straight),
        diffuse_transmission: extension(&|extended| extended.diffuse_transmission > 0.0),
        dispersion: extension(&|extended| extended.dispersion > 0.0),
        clearcoat: extension(&|extended| extended.clearcoat > 0.0),
        sheen: extension(&|extended| extended.sheen_color.iter().any(|channel| *channel > 0.0)),
        anisotropy: extension(&|extended| extended.anisotropy > 0.0),
        iridescence: extension(&|extended| extended.iridescence > 0.0),
        spheres: scene.stats.spheres > 0,
        detail: !scene.details.is_empty(),
        punctual: lighting.lights.len() > lighting.extended as usize,
        profiles: !lighting.profiles.is_empty(),
        extended_lights: lighting.extended > 0,
        emitters: path && !scene.emitters.is_empty(),
        light_tree: lighting.tree_probability > 0.0,
        environment: environment_code(&lighting.environment),
        thin_lens: matches!(view.lens, Lens::Perspective { aperture_radius, .. } if aperture_radius > 0.0),
        orthographic: matches!(view.lens, Lens::Orthographic { .. }),
        motion: scene.motion.pieces > 0 || !view.way.is_empty() || lighting.moves(),
    }
}

/// Whether a material has no lobe but Lambert's.
fn is_matte(scene: &CompiledScene, material: &Material) -> bool {
    material.metallic == 0.0 && material.extended(scene).is_some_and(Extended::is_matte)
}

fn environment_code(environment: &Environment) -> u32 {
    match environment.kind {
        EnvironmentKind::None => u32::from(environment.ambient != Vec3::ZERO),
        EnvironmentKind::Constant(_) => 1,
        EnvironmentKind::Gradient { .. } => 2,
        EnvironmentKind::Hdri(_) => 3,
    }
}
