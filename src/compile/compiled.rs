//! [`CompiledScene`] and its parts, as kernels read them.

use super::{Extended, LightTree, Motion, NONE, Surface};
use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Geometry, materials and textures, ready to trace.
#[derive(Debug, Default, Serialize, Deserialize)]
pub struct CompiledScene {
    /// World position of the origin of everything below.
    pub origin: DVec3,
    /// Bounds of what is drawn, relative to `origin`.
    pub bounds: Bounds,
    /// CWBVH nodes: first the top level's (if `two_level`), then each mesh's, indices absolute.
    #[serde(with = "crate::pod")]
    pub nodes: Vec<BvhNode>,
    /// Triangles in leaf order, object space of their instance; those that move at the end, and again for later moments ([`Motion`]).
    #[serde(with = "crate::pod")]
    pub triangles: Vec<Triangle>,
    /// Vertex indices (absolute, into `vertices`) of each triangle, in leaf order.
    #[serde(with = "crate::pod")]
    pub indices: Vec<[u32; 3]>,
    /// Vertex records of `layout.stride` words, those that move at the end, and again for later moments.
    #[serde(with = "crate::pod")]
    pub vertices: Vec<u32>,
    /// What a vertex record holds.
    pub layout: VertexLayout,
    /// Instances in the leaf order of the top level. Not `two_level`: exactly one, identity.
    #[serde(with = "crate::pod")]
    pub instances: Vec<Instance>,
    /// Materials in use.
    #[serde(with = "crate::pod")]
    pub materials: Vec<Material>,
    /// What extensions add to some of them.
    #[serde(with = "crate::pod")]
    pub extended: Vec<Extended>,
    /// Reliefs of some of them.
    #[serde(with = "crate::pod")]
    pub details: Vec<Detail>,
    /// sRGB texels (base colour, emission), RGBA8, pages of `page_size`^2.
    pub color_pages: TexturePages,
    /// Linear texels (metallic-roughness, normals; heights in two bytes: red times 256 and green), RGBA8.
    pub data_pages: TexturePages,
    /// Smallest perceptual roughness that a lit material in use can have somewhere; 1 if there is none.
    pub min_roughness: f32,
    /// Triangles that emit, in the order of `Triangle::light` + `Instance::light_base`.
    pub emitters: Vec<Emitter>,
    /// From which they are drawn, if they are many.
    pub light_tree: LightTree,
    /// What of it moves while the shutter is open.
    pub motion: Motion,
    /// Points of its surfaces, for the choice of light.
    #[serde(skip)]
    pub surface: Surface,
    /// Whether rays pass a top level first.
    pub two_level: bool,
    /// Longest chain of nodes from the root, both levels together.
    pub depth: u32,
    /// For the reply and the skip table.
    pub stats: CompileStats,
}

/// What compiling did, and left out.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct CompileStats {
    /// Triangles stored once.
    pub triangles: u64,
    /// Triangles counted per instance.
    pub instanced_triangles: u64,
    /// Spheres.
    pub spheres: u64,
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
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
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

/// A triangle as the traversal reads it; or a sphere ([`Triangle::SPHERE`]): centre in `v0`, radius and number of the axis in `v1`.
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
#[repr(C)]
pub struct Triangle {
    /// First vertex: the longest edge lies opposite to it, so that the two others, which are the more exact, meet in it.
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
    /// Bit of `material`: it is no triangle but a sphere.
    pub const SPHERE: u32 = 1 << 30;

    /// Index into `materials`.
    pub fn material(&self) -> usize {
        (self.material & !(Self::ALPHA | Self::SPHERE)) as usize
    }

    /// Whether it is a sphere.
    pub fn is_sphere(&self) -> bool {
        self.material & Self::SPHERE != 0
    }

    /// Area in the space of its instance.
    pub fn area(&self) -> f64 {
        if self.is_sphere() {
            return 4.0 * PI * f64::from(self.v1[0]).powi(2);
        }
        let [a, b, c] = [self.v0, self.v1, self.v2].map(|v| DVec3::from(v.map(f64::from)));
        0.5 * (b - a).cross(c - a).length()
    }

    /// The box around it.
    pub fn bounds(&self) -> Bounds {
        if self.is_sphere() {
            let (center, radius) = (Vec3::from_array(self.v0).as_dvec3(), f64::from(self.v1[0]));
            return Bounds::outwards(center - radius, center + radius);
        }
        [self.v0, self.v1, self.v2].map(Vec3::from_array).into_iter().fold(Bounds::default(), Bounds::with)
    }
}

/// Word offsets of the attributes in a vertex record; [`NONE`]: no drawn mesh has it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
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
    /// Bit 0: the transform mirrors (its determinant is negative). [`Instance::MOVING`].
    pub flags: u32,
}

impl Instance {
    /// Bit of `flags`: what moves ([`Motion`]); its transform is the identity.
    pub const MOVING: u32 = 2;

    /// A point of its mesh in the world.
    pub fn point(&self, v: [f32; 3]) -> DVec3 {
        let [x, y, z] = v.map(f64::from);
        DVec3::from(self.to_world.map(|row| row.map(f64::from)).map(|[i, j, k, l]| i * x + j * y + k * z + l))
    }

    /// -1 if the transform mirrors, else 1: what the cross product of edges in the world is to be multiplied by for the normal.
    pub fn handedness(&self) -> f64 {
        if self.flags & 1 == 1 { -1.0 } else { 1.0 }
    }

    /// Factor on lengths, of all directions the geometric mean.
    pub fn scale(&self) -> f64 {
        let [x, y, z] = self.to_world.map(|[i, j, k, _]| DVec3::new(i.into(), j.into(), k.into()));
        x.dot(y.cross(z)).abs().cbrt()
    }
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
    /// [`Material::DOUBLE_SIDED`] and so on; from [`Material::EXTENDED_SHIFT`] on one more than the index into
    /// `CompiledScene::extended`, or 0.
    pub flags: u32,
    /// sRGB.
    pub base_color_texture: TextureSlot,
    /// sRGB.
    pub emissive_texture: TextureSlot,
    /// Linear.
    pub metallic_roughness_texture: TextureSlot,
    /// Linear.
    pub normal_texture: TextureSlot,
    /// One more than the index into `CompiledScene::details`, or 0.
    pub detail: u32,
    /// Unused.
    pub pad: [u32; 3],
}

impl Material {
    /// Back faces are seen by the camera.
    pub const DOUBLE_SIDED: u32 = 1;
    /// Base colour is shown as it is.
    pub const UNLIT: u32 = 2;
    /// Seen from within too: the mesh is filled (KHR_materials_volume).
    pub const FILLED: u32 = 4;
    /// Bits below the index of its extensions.
    pub const EXTENDED_SHIFT: u32 = 8;

    /// What extensions add.
    pub fn extended<'a>(&self, scene: &'a CompiledScene) -> Option<&'a Extended> {
        let place = self.flags >> Self::EXTENDED_SHIFT;
        place.checked_sub(1).and_then(|index| scene.extended.get(index as usize))
    }
}

/// Relief of a material, as kernels read it.
#[derive(Debug, Clone, Copy, Default, Pod, Zeroable)]
#[repr(C)]
pub struct Detail {
    /// [`Detail::HEIGHT`] and so on.
    pub kind: u32,
    /// Factor on normals, or the height of white above black in scene units.
    pub scale: f32,
    /// Steps of a search.
    pub steps: u32,
    /// 1: it keeps light off itself.
    pub self_shadow: u32,
    /// Linear texels.
    pub map: TextureSlot,
}

impl Detail {
    /// Heights bend normals.
    pub const HEIGHT: u32 = 0;
    /// Normals take the place of normals.
    pub const NORMAL: u32 = 1;
    /// Heights, seen one step along the view.
    pub const OFFSET: u32 = 2;
    /// The same, no longer than the height.
    pub const OFFSET_LIMITED: u32 = 3;
    /// Heights, searched in steps.
    pub const STEEP: u32 = 4;
    /// The same, refined.
    pub const RELIEF: u32 = 5;
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
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct TexturePages {
    /// Side of a page in texels; 0: no page.
    pub page_size: u32,
    /// Texels, row by row.
    #[serde(with = "crate::pod::nested")]
    pub pages: Vec<Vec<u8>>,
}

/// An emitting triangle in world space, for light sampling.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
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

impl Emitter {
    /// Luminous flux.
    pub fn power(&self) -> f64 {
        let sides = if self.double_sided { 2.0 } else { 1.0 };
        PI * f64::from(self.area) * f64::from(self.luminance) * sides
    }
}
