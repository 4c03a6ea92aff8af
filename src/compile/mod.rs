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
mod compiled;
mod emitters;
mod environment;
mod extended;
pub mod features;
mod framing;
mod geometry;
mod groups;
mod hdri;
mod light_records;
mod light_tree;
mod lighting;
mod lights;
mod look;
mod materials;
mod moment;
pub mod motion;
mod own_light;
mod profiles;
mod quantize;
mod repeats;
mod sight;
mod texels;
mod textures;
mod tiles;
mod vertices;
mod walk;

#[cfg(test)]
mod tests;

pub use camera::view;
pub use compiled::{
    Bounds, BvhNode, CompileStats, CompiledScene, Detail, Emitter, Instance, Material, TexturePages, TextureSlot,
    Triangle, VertexLayout,
};
pub use extended::{Extended, SLOTS, Slot};
pub use features::{Features, features};
pub use geometry::{compile_request, compile_scene};
pub use hdri::{ENVIRONMENT_PIXELS, HdriError, decode_hdri, decode_radiance};
pub use light_tree::{LightNode, LightTree};
pub use lighting::{
    ENVIRONMENT_GROUP, Environment, EnvironmentCell, EnvironmentKind, Hdri, LIGHTS_GROUP, LightPick, Lighting,
    PunctualKind, PunctualLight, SURFACES_GROUP, Share,
};
pub use lights::{LightFiles, Lit, light, shines};
pub use look::MapFiles;
pub use moment::moment;
pub use motion::Motion;
pub use own_light::Surface;
pub use sight::unseen;
pub use textures::map_size;
pub use tiles::{ANY_FACING, FACING_STRIDE, FACINGS, TILES, tile_of};
pub use walk::{camera_nodes, chosen_scene};

use glam::Affine3A;

/// Marks "none" in `u32` index fields.
pub const NONE: u32 = u32::MAX;

/// Something that the request left open and the renderer chose; stated in the reply.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct DefaultTaken {
    /// What was open, like `camera`.
    pub what: String,
    /// What was chosen.
    pub value: serde_json::Value,
}

/// Camera and film of one request.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct View {
    /// Camera to world, relative to the origin; the camera looks along -Z.
    pub to_world: Affine3A,
    /// The same at the ends of the pieces of its way while the shutter is open ([`Motion`]); empty: it stands still.
    pub way: Vec<Affine3A>,
    /// Lens.
    pub lens: Lens,
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Reconstruction filter.
    #[serde(with = "crate::pod::as_json")]
    pub filter: crate::params::Filter,
    /// Misses have alpha 0 and show nothing.
    pub transparent: bool,
}

/// Projection of a [`View`].
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub enum Lens {
    /// Thin lens; a pinhole if the aperture is 0.
    Perspective {
        /// Tangent of half the vertical field of view.
        tan_half_yfov: f32,
        /// Radius of the lens.
        aperture_radius: f32,
        /// Sides of its opening; 0: round.
        blades: u32,
        /// Angle of the first corner from +x towards +y.
        blade_rotation: f32,
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
