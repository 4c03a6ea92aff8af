//! glTF bytes -> [`Scene`]: plain CPU data, checked, with nothing of the user's able to panic.
//!
//! The hierarchy is kept as the file has it, with what moves it: [`Scene::at`] poses it, [`Scene::drawn`] moves vertices.
//! Meshes are decoded once, only if a node of some scene shows them and only the attributes that their material reads;
//! images stay encoded.
//! Frame: glTF's, right-handed, +Y up, metres, colours linear Rec. 709.

mod animation;
mod deform;
mod describe;
mod drawn;
mod error;
mod extended;
mod ies;
mod import;
pub mod ktx2;
mod limits;
mod package;
mod profile;

pub use animation::{Animation, Channel, Curve, Interpolation, Moment, Parts, Path};
pub use deform::{Influences, Skin, Target};
pub use describe::{Description, describe};
pub use drawn::{Drawn, DrawnOver, Moving, Placed};
pub use error::{SceneError, SceneErrorKind, Warning};
pub use extended::{Extended, Scatter, Volume};
pub use import::import;
pub use limits::Limits;
pub use package::Package;
pub use profile::{Profile, Web};

use glam::{DAffine3, Mat3, Vec2, Vec3, Vec4};
use std::collections::BTreeMap;
use std::sync::Arc;

/// A checked glTF asset. Cheap to clone but for its nodes.
#[derive(Debug, Clone, Default)]
pub struct Scene {
    /// All nodes of the file, in its order.
    pub nodes: Vec<Node>,
    /// The file's scenes; if it has none, one of all root nodes.
    pub scenes: Vec<SceneRoot>,
    /// The file's `scene` property.
    pub default_scene: Option<usize>,
    /// Meshes of the file; those that no scene shows have no primitives.
    pub meshes: Arc<Vec<Mesh>>,
    /// Materials of the file, in its order.
    pub materials: Vec<Material>,
    /// Textures of the file that have an image, in its order.
    pub textures: Vec<Texture>,
    /// Images of the file, encoded, in its order.
    pub images: Vec<Image>,
    /// Cameras of the file, in its order.
    pub cameras: Vec<Camera>,
    /// Lights of KHR_lights_punctual, in the file's order, then those of EXT_lights_ies, one for each node.
    pub lights: Vec<Light>,
    /// Names of `extensionsUsed`, each with how it is honoured.
    pub extensions: Vec<ExtensionUse>,
    /// What the picture will lack or had to guess, for the reply.
    pub warnings: Vec<Warning>,
    /// Names of KHR_materials_variants.
    pub variants: Vec<String>,
    /// Animations of the file, in its order.
    pub animations: Arc<Vec<Animation>>,
    /// By node that some animation moves: its transform at rest, in parts.
    pub moved: BTreeMap<usize, Parts>,
    /// Skins of the file, in its order.
    pub skins: Arc<Vec<Skin>>,
}

/// One entry of the file's `scenes`.
#[derive(Debug, Clone, Default)]
pub struct SceneRoot {
    /// Name in the file.
    pub name: Option<String>,
    /// Root nodes.
    pub nodes: Vec<usize>,
}

/// A node of the hierarchy.
#[derive(Debug, Clone, Default)]
pub struct Node {
    /// Name in the file.
    pub name: Option<String>,
    /// Transform relative to the parent.
    pub local: DAffine3,
    /// Children.
    pub children: Vec<usize>,
    /// Index into [`Scene::meshes`].
    pub mesh: Option<usize>,
    /// Index into [`Scene::cameras`].
    pub camera: Option<usize>,
    /// Index into [`Scene::lights`].
    pub light: Option<usize>,
    /// Index into [`Scene::skins`], which moves the mesh.
    pub skin: Option<usize>,
    /// Weights of the mesh's morph targets; none: it has no targets.
    pub weights: Vec<f64>,
    /// Places of the mesh relative to the node (EXT_mesh_gpu_instancing); none: one, at the node.
    pub instances: Option<Arc<[DAffine3]>>,
}

/// A glTF mesh.
#[derive(Debug, Clone, Default)]
pub struct Mesh {
    /// Name in the file.
    pub name: Option<String>,
    /// Triangle lists; primitives of points and lines are left out (with a warning).
    pub primitives: Vec<Primitive>,
}

/// A triangle list with one material. All attribute arrays that are present have `positions.len()` entries.
#[derive(Debug, Clone, Default)]
pub struct Primitive {
    /// Object space, finite.
    pub positions: Vec<Vec3>,
    /// Unit length, or zero where the geometric normal stands in; none: flat shading (glTF 2.0, 3.7.2.1).
    pub normals: Option<Vec<Vec3>>,
    /// xyz of unit length (or zero: none could be made), w the sign of the bitangent. Present only if the material reads
    /// tangents and the primitive has texture coordinates for them.
    pub tangents: Option<Vec<Vec4>>,
    /// Texture coordinates that the material reads, by `TextureRef::uv_set`; beyond those the file's first set, if it has one.
    pub uvs: Vec<Vec<Vec2>>,
    /// Linear RGBA (COLOR_0), each 0 to 1; none: white.
    pub colors: Option<Vec<Vec4>>,
    /// Counter-clockwise seen from the front.
    pub triangles: Vec<[u32; 3]>,
    /// Index into [`Scene::materials`]; none: the default material.
    pub material: Option<usize>,
    /// What the joints of a skin do to it; present only if some node shows it with a skin.
    pub influences: Option<Influences>,
    /// Morph targets, in the file's order; none if nothing ever gives them a weight.
    pub targets: Vec<Target>,
    /// What stands in its place where other variants are drawn (KHR_materials_variants): each with the indices into
    /// [`Scene::variants`] that it is for, and the same triangles with the attributes that its material reads.
    pub alternatives: Vec<(Vec<usize>, Primitive)>,
}

impl Primitive {
    /// The primitive as a variant shows it.
    pub fn of_variant(&self, variant: Option<usize>) -> &Self {
        let shown = |variant| self.alternatives.iter().find(|(variants, _)| variants.contains(&variant));
        variant.and_then(shown).map_or(self, |(_, primitive)| primitive)
    }
}

/// How a material's alpha is read.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum AlphaMode {
    /// Alpha is ignored.
    #[default]
    Opaque,
    /// Fully there at `alpha >= cutoff`, else not at all.
    Mask {
        /// Threshold.
        cutoff: f32,
    },
    /// Covers a part of the pixel equal to alpha.
    Blend,
}

/// Metallic-roughness material of core glTF.
#[derive(Debug, Clone)]
pub struct Material {
    /// Name in the file.
    pub name: Option<String>,
    /// Linear RGBA factor.
    pub base_color: Vec4,
    /// sRGB texture; multiplies `base_color`.
    pub base_color_texture: Option<TextureRef>,
    /// Factor, 0 to 1.
    pub metallic: f32,
    /// Perceptual roughness factor, 0 to 1.
    pub roughness: f32,
    /// Linear texture: G roughness, B metallic.
    pub metallic_roughness_texture: Option<TextureRef>,
    /// Linear texture, tangent space.
    pub normal_texture: Option<TextureRef>,
    /// `normalTexture.scale`.
    pub normal_scale: f32,
    /// Radiance factor, times KHR_materials_emissive_strength.
    pub emissive: Vec3,
    /// sRGB texture; multiplies `emissive`.
    pub emissive_texture: Option<TextureRef>,
    /// How alpha is read.
    pub alpha_mode: AlphaMode,
    /// Whether back faces are seen and lit.
    pub double_sided: bool,
    /// KHR_materials_unlit: base colour is shown as it is.
    pub unlit: bool,
    /// What extensions add; none: nothing.
    pub extended: Option<Arc<Extended>>,
    /// Index into [`Primitive::uvs`] of the file's first set of texture coordinates, for maps that a request brings.
    pub first_uv: usize,
}

impl Default for Material {
    /// The default material of glTF 2.0 (3.9.7).
    fn default() -> Self {
        Self {
            name: None,
            base_color: Vec4::ONE,
            base_color_texture: None,
            metallic: 1.0,
            roughness: 1.0,
            metallic_roughness_texture: None,
            normal_texture: None,
            normal_scale: 1.0,
            emissive: Vec3::ZERO,
            emissive_texture: None,
            alpha_mode: AlphaMode::Opaque,
            double_sided: false,
            unlit: false,
            extended: None,
            first_uv: 0,
        }
    }
}

impl Material {
    /// Whether anything of it turns with the surface's tangents.
    pub fn reads_tangents(&self) -> bool {
        let extended =
            |extended: &Arc<Extended>| extended.anisotropy > 0.0 || extended.clearcoat_normal_texture.is_some();
        !self.unlit && (self.normal_texture.is_some() || self.extended.as_ref().is_some_and(extended))
    }

    /// The textures that it reads.
    pub fn textures(&self) -> impl Iterator<Item = &TextureRef> {
        let color = self.base_color_texture.iter().chain(&self.emissive_texture);
        let core = color.chain(&self.metallic_roughness_texture).chain(&self.normal_texture);
        core.chain(self.extended.iter().flat_map(|extended| extended.textures()))
    }
}

/// A use of a texture by a material.
#[derive(Debug, Clone, Copy)]
pub struct TextureRef {
    /// Index into [`Scene::textures`].
    pub texture: usize,
    /// Index into [`Primitive::uvs`] of every primitive with this material (import renumbers the file's sets).
    pub uv_set: usize,
    /// KHR_texture_transform, as a matrix on (u, v, 1).
    pub transform: Mat3,
}

/// An image with the way it is sampled.
#[derive(Debug, Clone, Copy, Default)]
pub struct Texture {
    /// Index into [`Scene::images`].
    pub image: usize,
    /// Wrap in u.
    pub wrap_u: Wrap,
    /// Wrap in v.
    pub wrap_v: Wrap,
    /// `magFilter` NEAREST: texels are squares; else bilinear.
    pub nearest: bool,
}

/// glTF wrap mode.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Wrap {
    /// REPEAT
    #[default]
    Repeat,
    /// CLAMP_TO_EDGE
    Clamp,
    /// MIRRORED_REPEAT
    Mirror,
}

/// An encoded image. Size and format have been read from its header; pixels are decoded when a picture needs them.
#[derive(Debug, Clone)]
pub struct Image {
    /// Encoded bytes; empty if nothing that is drawn reads the image.
    pub bytes: Arc<[u8]>,
    /// Place in the file, for errors: `/images/3`.
    pub pointer: String,
}

/// A glTF camera; it looks along -Z of its node.
#[derive(Debug, Clone)]
pub struct Camera {
    /// Name in the file.
    pub name: Option<String>,
    /// Its lens.
    pub projection: Projection,
}

/// Lens of a camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Projection {
    /// Vertical field of view in radians.
    Perspective {
        /// Radians.
        yfov: f64,
    },
    /// Half height of the picture in scene units.
    Orthographic {
        /// Scene units.
        ymag: f64,
    },
}

/// A light of KHR_lights_punctual or EXT_lights_ies; it shines along -Z of its node.
#[derive(Debug, Clone)]
pub struct Light {
    /// Name in the file.
    pub name: Option<String>,
    /// Linear colour times intensity: candela (point, spot) or lux (directional); with a profile a factor on its candela.
    pub intensity: Vec3,
    /// Distance of the cut-off; none: infinite.
    pub range: Option<f32>,
    /// Its shape.
    pub kind: LightKind,
    /// How its intensity depends on direction, as measured; its zero azimuth is +X of its node.
    pub profile: Option<Arc<Profile>>,
}

/// Shape of a punctual light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LightKind {
    /// Parallel light.
    Directional,
    /// To all sides.
    Point,
    /// Within a cone; half angles in radians.
    Spot {
        /// Full light within.
        inner_cone: f32,
        /// No light beyond.
        outer_cone: f32,
    },
}

/// An extension that the file uses.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct ExtensionUse {
    /// `KHR_...`
    pub name: String,
    /// Whether the picture shows it.
    pub honoured: bool,
    /// What is lost if not.
    pub note: Option<String>,
}
