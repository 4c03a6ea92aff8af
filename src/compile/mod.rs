//! [`Scene`](crate::scene::Scene) -> [`CompiledScene`]: flat arrays that both engines read.
//!
//! Three parts of different life time, so that turning a light does not rebuild a tree:
//! [`CompiledScene`] (geometry, materials, textures; by scene bytes and scene index), [`Lighting`] (punctual lights,
//! environment, light sampling tables; by request) and [`View`] (camera, film; by request). [`Features`] says
//! what the three need together; kernels are specialised by it.
//!
//! World space is moved so that the scene's centre is the origin ([`CompiledScene::origin`]): f32 keeps its
//! precision for scenes that lie far out.

mod alias;
mod alpha;
mod assemble;
mod atlas;
mod bounds;
mod bvh;
mod camera;
mod emitters;
mod environment;
pub mod features;
mod framing;
mod geometry;
mod groups;
mod hdri;
mod lights;
mod materials;
mod quantize;
mod texels;
mod textures;
mod vertices;
mod walk;

#[cfg(test)]
mod tests;

pub use camera::view;
pub use features::{Features, features};
pub use geometry::compile_scene;
pub use hdri::{HdriError, decode_hdri};
pub use lights::light;
pub use walk::{Placed, camera_nodes, chosen_scene};

use bytemuck::{Pod, Zeroable};
use glam::{Affine3A, DVec3, Vec3};
use std::sync::Arc;

/// Marks "none" in `u32` index fields.
pub const NONE: u32 = u32::MAX;

/// Geometry, materials and textures, ready to trace.
#[derive(Debug, Default)]
pub struct CompiledScene {
    /// World position of the origin of everything below.
    pub origin: DVec3,
    /// Bounds of what is drawn, relative to `origin`.
    pub bounds: Bounds,
    /// CWBVH nodes: first the top level's (if `two_level`), then each mesh's, indices absolute.
    pub nodes: Vec<BvhNode>,
    /// Triangles in leaf order, object space of their instance.
    pub triangles: Vec<Triangle>,
    /// Vertex indices (absolute, into `vertices`) of each triangle, in leaf order.
    pub indices: Vec<[u32; 3]>,
    /// Vertex records of `layout.stride` words.
    pub vertices: Vec<u32>,
    /// What a vertex record holds.
    pub layout: VertexLayout,
    /// Instances in the leaf order of the top level. Not `two_level`: exactly one, identity.
    pub instances: Vec<Instance>,
    /// Materials in use.
    pub materials: Vec<Material>,
    /// sRGB texels (base colour, emission), RGBA8, pages of `page_size`^2.
    pub color_pages: TexturePages,
    /// Linear texels (metallic-roughness, normals), RGBA8.
    pub data_pages: TexturePages,
    /// Smallest perceptual roughness that a lit material in use can have somewhere; 1 if there is none.
    pub min_roughness: f32,
    /// Triangles that emit, in the order of `Triangle::light` + `Instance::light_base`.
    pub emitters: Vec<Emitter>,
    /// Whether rays pass a top level first.
    pub two_level: bool,
    /// Longest chain of nodes from the root, both levels together.
    pub depth: u32,
    /// For the reply and the skip table.
    pub stats: CompileStats,
}

/// What compiling did, and left out.
#[derive(Debug, Clone, Default, serde::Serialize)]
pub struct CompileStats {
    /// Triangles stored once.
    pub triangles: u64,
    /// Triangles counted per instance.
    pub instanced_triangles: u64,
    /// Triangles of no area, left out.
    pub degenerate_triangles: u64,
    /// Instances of the top level.
    pub instances: u64,
    /// Textures decoded.
    pub textures: u64,
    /// Textures of the file that no visible surface reads.
    pub unused_textures: u64,
    /// Seconds spent building trees.
    pub bvh_seconds: f64,
    /// Seconds spent decoding images.
    pub texture_seconds: f64,
}

/// Axis-aligned box; empty if `min > max`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// Lower corner.
    pub min: Vec3,
    /// Upper corner.
    pub max: Vec3,
}

impl Default for Bounds {
    fn default() -> Self {
        Self { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY }
    }
}

/// Compressed wide BVH node of eight children, 80 bytes
/// (Ylitie, Karras, Laine 2017, "Efficient Incoherent Ray Traversal on GPUs Through Compressed Wide BVHs"),
/// as the `obvhs` crate lays it out: `p`, `e` + `imask`, bases, `meta`, then per axis 8 minima and 8 maxima.
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
#[repr(C)]
pub struct BvhNode {
    /// Twenty words.
    pub words: [u32; 20],
}

/// Something that the request left open and the renderer chose; stated in the reply.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct DefaultTaken {
    /// What was open, like `camera`.
    pub what: String,
    /// What was chosen.
    pub value: serde_json::Value,
}

/// A triangle as the traversal reads it.
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
#[repr(C)]
pub struct Triangle {
    /// First vertex.
    pub v0: [f32; 3],
    /// Index into `materials`; bit 31 ([`Triangle::ALPHA`]): its alpha must be tested.
    pub material: u32,
    /// Second vertex.
    pub v1: [f32; 3],
    /// Ordinal among the emitting triangles of its mesh; [`NONE`]: does not emit.
    pub light: u32,
    /// Third vertex.
    pub v2: [f32; 3],
    /// Ordinal in its mesh, independent of the tree.
    pub primitive: u32,
}

impl Triangle {
    /// Bit of `material`: the triangle may be transparent.
    pub const ALPHA: u32 = 1 << 31;
}

/// Word offsets of the attributes in a vertex record; [`NONE`]: no drawn mesh has it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct VertexLayout {
    /// Words per vertex.
    pub stride: u32,
    /// Three f32; zero length: flat shading.
    pub normal: u32,
    /// Four f32; zero length: none.
    pub tangent: u32,
    /// Four f32.
    pub color: u32,
    /// Two f32 each.
    pub uv: [u32; 2],
}

impl Default for VertexLayout {
    fn default() -> Self {
        Self { stride: 0, normal: NONE, tangent: NONE, color: NONE, uv: [NONE; 2] }
    }
}

/// A placed mesh. Matrices are rows of a 3x4 affine map on column vectors.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub struct Instance {
    /// Object to world.
    pub to_world: [[f32; 4]; 3],
    /// World to object.
    pub to_object: [[f32; 4]; 3],
    /// Root of its tree in `nodes`.
    pub root: u32,
    /// First triangle of its mesh in `triangles` (node leaves count from 0 in the whole array; this is for statistics and ids).
    pub first_triangle: u32,
    /// Added to `Triangle::light`.
    pub light_base: u32,
    /// Bit 0: the transform mirrors (its determinant is negative).
    pub flags: u32,
}

/// A material as kernels read it.
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
#[repr(C)]
pub struct Material {
    /// Linear RGBA.
    pub base_color: [f32; 4],
    /// Radiance.
    pub emissive: [f32; 3],
    /// Perceptual.
    pub roughness: f32,
    /// 0 to 1.
    pub metallic: f32,
    /// Factor on x and y of the normal map.
    pub normal_scale: f32,
    /// Mask: threshold. Blend: -1. Opaque: -2.
    pub alpha_cutoff: f32,
    /// [`Material::DOUBLE_SIDED`] and so on.
    pub flags: u32,
    /// sRGB.
    pub base_color_texture: TextureSlot,
    /// sRGB.
    pub emissive_texture: TextureSlot,
    /// Linear.
    pub metallic_roughness_texture: TextureSlot,
    /// Linear.
    pub normal_texture: TextureSlot,
}

impl Material {
    /// Back faces are seen by the camera.
    pub const DOUBLE_SIDED: u32 = 1;
    /// Base colour is shown as it is.
    pub const UNLIT: u32 = 2;
}

/// Where the texels of a texture lie and how they are read.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub struct TextureSlot {
    /// `u' = dot(row_u, (u, v, 1))` (KHR_texture_transform).
    pub row_u: [f32; 3],
    /// Page (array layer) in bits 0..16, uv set in bit 16, wrap u in bits 17..19, wrap v in bits 19..21
    /// (0 repeat, 1 clamp, 2 mirror), nearest in bit 21. [`NONE`]: no texture.
    pub info: u32,
    /// `v' = dot(row_v, (u, v, 1))`.
    pub row_v: [f32; 3],
    /// Texel x in bits 0..16, y in bits 16..32 of the corner in its page.
    pub corner: u32,
    /// Width in bits 0..16, height in bits 16..32, both minus one.
    pub size: u32,
    /// Unused.
    pub pad: [u32; 3],
}

impl Default for TextureSlot {
    fn default() -> Self {
        Self { row_u: [1.0, 0.0, 0.0], info: NONE, row_v: [0.0, 1.0, 0.0], corner: 0, size: 0, pad: [0; 3] }
    }
}

/// Square RGBA8 pages that hold many textures.
#[derive(Debug, Clone, Default)]
pub struct TexturePages {
    /// Side of a page in texels; 0: no page.
    pub page_size: u32,
    /// Texels, row by row.
    pub pages: Vec<Vec<u8>>,
}

/// An emitting triangle in world space, for light sampling.
#[derive(Debug, Clone, Copy, Default)]
pub struct Emitter {
    /// Instance it belongs to.
    pub instance: u32,
    /// Index into `triangles`.
    pub triangle: u32,
    /// World area.
    pub area: f32,
    /// Mean luminance of its radiance, one side.
    pub luminance: f32,
    /// Emits to both sides.
    pub double_sided: bool,
}

/// Light of one request: everything that can be sampled, as tables.
#[derive(Debug, Clone, Default)]
pub struct Lighting {
    /// Punctual lights that can reach the scene, of non-zero power.
    pub lights: Vec<PunctualLight>,
    /// Alias table over `lights` then emitters; empty if there are neither.
    pub picks: Vec<LightPick>,
    /// Light from infinity.
    pub environment: Environment,
    /// Probability of sampling the environment rather than `picks` at a shading point.
    pub environment_probability: f32,
    /// Number of lights of the request and the file that were left out, and why: for the reply.
    pub skipped: u32,
}

/// Kinds of [`PunctualLight`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub enum PunctualKind {
    /// Parallel.
    Directional = 0,
    /// To all sides.
    Point = 1,
    /// Cone, glTF fall-off.
    Spot = 2,
    /// Cone, fall-off linear in the angle.
    SpotLinear = 3,
}

/// A punctual light as kernels read it.
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
#[repr(C)]
pub struct PunctualLight {
    /// Relative to the origin; directional: unused.
    pub position: [f32; 3],
    /// [`PunctualKind`].
    pub kind: u32,
    /// Direction that it shines in, unit length.
    pub direction: [f32; 3],
    /// Range; infinity: none.
    pub range: f32,
    /// Candela or lux.
    pub intensity: [f32; 3],
    /// Spot: cosine of the inner cone (`SpotLinear`: its angle).
    pub inner: f32,
    /// Spot: cosine of the outer cone (`SpotLinear`: its angle).
    pub outer: f32,
    /// Unused.
    pub pad: [f32; 3],
}

/// Entry of the alias table over lights (Walker 1974; Vose 1991), with what a sampled light needs at hand.
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
#[repr(C)]
pub struct LightPick {
    /// Probability of keeping this entry rather than taking `alias`.
    pub keep: f32,
    /// The other entry.
    pub alias: u32,
    /// Probability of this entry being picked in all.
    pub probability: f32,
    /// World area of an emitting triangle; 0: a punctual light.
    pub area: f32,
    /// Emitter: its instance. Punctual: index into `lights`.
    pub index: u32,
    /// Emitter: its triangle.
    pub triangle: u32,
    /// Unused.
    pub pad: [u32; 2],
}

/// Light from infinity.
#[derive(Debug, Clone)]
pub struct Environment {
    /// What it shows.
    pub kind: EnvironmentKind,
    /// Factor on the radiance (in the tables already for `Hdri`: no).
    pub intensity: f32,
    /// Turn about +y in radians; a direction d looks up `R_y(-rotation) d`.
    pub rotation: f32,
    /// Whether camera rays see it.
    pub visible: bool,
    /// Constant radiance added for all but camera rays (ambient lights).
    pub ambient: Vec3,
}

impl Default for Environment {
    fn default() -> Self {
        Self { kind: EnvironmentKind::None, intensity: 1.0, rotation: 0.0, visible: true, ambient: Vec3::ZERO }
    }
}

/// What an environment shows.
#[derive(Debug, Clone, Default)]
pub enum EnvironmentKind {
    /// Black.
    #[default]
    None,
    /// The same from everywhere.
    Constant(Vec3),
    /// By height: bottom at y = -1, horizon at 0, top at 1, linear between.
    Gradient {
        /// Straight up.
        top: Vec3,
        /// At the horizon.
        horizon: Vec3,
        /// Straight down.
        bottom: Vec3,
    },
    /// Equirectangular picture.
    Hdri(Arc<Hdri>),
}

/// An equirectangular picture with its sampling table. `u = 0.5 + atan2(z, x) / 2pi`, v from the top.
/// Radiance is bilinear between texel centres, repeated in u and clamped in v.
#[derive(Debug)]
pub struct Hdri {
    /// Texels across.
    pub width: u32,
    /// Texels down.
    pub height: u32,
    /// Row by row from the top, linear RGB.
    pub texels: Vec<[f32; 3]>,
    /// Alias table over the cells between texel centres: `width` columns, `height + 1` rows (the first and the last
    /// row are half cells at the poles). Cell (i, j) spans u from (i + 0.5) / width to (i + 1.5) / width
    /// and v from max(j - 0.5, 0) / height to min(j + 0.5, height) / height.
    pub cells: Vec<AliasCell>,
    /// Integral of luminance over the sphere.
    pub power: f32,
}

/// Entry of the environment's alias table.
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
#[repr(C)]
pub struct AliasCell {
    /// Probability of keeping this cell.
    pub keep: f32,
    /// The other cell.
    pub alias: u32,
    /// Density over solid angle within the cell (1/sr); constant, cells being sampled uniformly in solid angle.
    pub pdf: f32,
}

/// Camera and film of one request.
#[derive(Debug, Clone, Copy)]
pub struct View {
    /// Camera to world, relative to the origin; the camera looks along -Z.
    pub to_world: Affine3A,
    /// Lens.
    pub lens: Lens,
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Reconstruction filter.
    pub filter: crate::params::Filter,
    /// Misses have alpha 0 and show nothing.
    pub transparent: bool,
}

/// Projection of a [`View`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Lens {
    /// Thin lens; a pinhole if the aperture is 0.
    Perspective {
        /// Tangent of half the vertical field of view.
        tan_half_yfov: f32,
        /// Radius of the lens.
        aperture_radius: f32,
        /// Distance of the plane in focus along the axis.
        focus_distance: f32,
    },
    /// Parallel rays.
    Orthographic {
        /// Half the height of the picture.
        ymag: f32,
    },
}

/// Why a request cannot be compiled.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CompileError {
    /// The scene is at fault.
    #[error(transparent)]
    Scene(#[from] crate::scene::SceneError),
    /// The parameters are at fault.
    #[error(transparent)]
    Params(#[from] crate::params::FieldError),
}
