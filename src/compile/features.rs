//! What a picture needs. A feature that no material, light or camera uses costs nothing: each becomes an override
//! constant of the kernel, and the driver removes what is dead.

/// Needs of a (scene, lighting, view) triple.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
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
    /// There are punctual lights.
    pub punctual: bool,
    /// There are emitting triangles.
    pub emitters: bool,
    /// Kind of environment: 0 none, 1 constant, 2 gradient, 3 HDRI.
    pub environment: u32,
    /// The lens has an extent.
    pub thin_lens: bool,
    /// Parallel projection.
    pub orthographic: bool,
}
