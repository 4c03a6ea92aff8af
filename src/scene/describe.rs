//! What a scene holds, for `GET /v1/scenes/{id}`.

use super::{AlphaMode, ExtensionUse, LightKind, Material, Placed, Projection, Scene, Warning};
use glam::{BVec3, DAffine3, DVec3};
use serde::Serialize;

/// Description of a scene. World space, scene units; angles in degrees where the name says so.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Description {
    /// Scenes of the file; the parts below are those of the default one unless they say otherwise.
    pub scenes: Vec<SceneItem>,
    /// Which of `scenes` is drawn by default.
    pub default_scene: usize,
    /// What is drawn lies within; none: nothing is.
    pub bounds: Option<Box3>,
    /// Counts.
    pub counts: Counts,
    /// Cameras of the default scene in the order that a request's `camera.index` counts, the first 1000.
    pub cameras: Vec<CameraItem>,
    /// Lights of the file, each with the places where the default scene puts it.
    pub lights: Vec<LightItem>,
    /// Materials of the file.
    pub materials: Vec<MaterialItem>,
    /// Animations of the file, in the order that a request's `animation` counts.
    pub animations: Vec<AnimationItem>,
    /// Material variants by name.
    pub variants: Vec<String>,
    /// Extensions that the file uses, and how each is honoured.
    pub extensions: Vec<ExtensionUse>,
    /// What the picture will lack or had to guess.
    pub warnings: Vec<Warning>,
}

/// A scene of the file.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SceneItem {
    /// Index in the file.
    pub index: usize,
    /// Name in the file.
    pub name: Option<String>,
}

/// An axis-aligned box.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Box3 {
    /// Lower corner.
    pub min: [f64; 3],
    /// Upper corner.
    pub max: [f64; 3],
}

/// How much there is.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Counts {
    /// Triangles stored, of all scenes, each mesh once.
    pub triangles: u64,
    /// Triangles drawn in the default scene, a mesh as often as it is placed.
    pub instanced_triangles: u64,
    /// Vertices stored.
    pub vertices: u64,
    /// Nodes of the file.
    pub nodes: usize,
    /// Meshes of the file.
    pub meshes: usize,
    /// Textures of the file that have an image.
    pub textures: usize,
    /// Images of the file.
    pub images: usize,
    /// Animations of the file.
    pub animations: usize,
    /// Skins of the file.
    pub skins: usize,
}

/// Places that are listed of one light.
const MAX_POSES: usize = 16;

/// Cameras that are listed.
const MAX_CAMERAS: usize = 1000;

/// Where a camera or a light stands: it looks or shines along `direction`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Pose {
    /// Node that places it.
    pub node: usize,
    /// World position.
    pub position: [f64; 3],
    /// World direction, unit length.
    pub direction: [f64; 3],
    /// Its upward direction, unit length.
    pub up: [f64; 3],
}

/// A node of the default scene that holds a camera.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CameraItem {
    /// What `camera.index` of a request calls it.
    pub index: usize,
    /// Name of the camera in the file, else of its node.
    pub name: Option<String>,
    /// Lens.
    #[serde(flatten)]
    pub lens: Lens,
    /// Its place.
    #[serde(flatten)]
    pub pose: Pose,
}

/// Lens of a [`CameraItem`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(tag = "type", rename_all = "snake_case")]
pub enum Lens {
    /// Perspective.
    Perspective {
        /// Vertical field of view.
        yfov_degrees: f64,
    },
    /// Parallel.
    Orthographic {
        /// Half the height of the picture.
        ymag: f64,
    },
}

/// A light of the file.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LightItem {
    /// Index in the file.
    pub index: usize,
    /// Name in the file, or of the first node that places it.
    pub name: Option<String>,
    /// `directional`, `point` or `spot`.
    #[serde(rename = "type")]
    pub kind: &'static str,
    /// Linear RGB: candela, or lux if directional.
    pub intensity: [f32; 3],
    /// Distance of the cut-off.
    pub range: Option<f32>,
    /// Of a light with a measured profile, on which its intensity is a factor: the profile's largest candela.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub profile_peak: Option<f32>,
    /// Its places, the first 16.
    pub poses: Vec<Pose>,
}

/// An animation of the file.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AnimationItem {
    /// Index in the file.
    pub index: usize,
    /// Name in the file.
    pub name: Option<String>,
    /// Time of its first key.
    pub start_seconds: f64,
    /// Time of its last key, beyond which nothing moves.
    pub end_seconds: f64,
}

/// A material of the file.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MaterialItem {
    /// Index in the file.
    pub index: usize,
    /// Name in the file.
    pub name: Option<String>,
    /// `opaque`, `mask` or `blend`.
    pub alpha_mode: &'static str,
    /// Whether back faces are seen.
    pub double_sided: bool,
    /// Whether it emits light.
    pub emissive: bool,
    /// Whether it is shown without lighting.
    pub unlit: bool,
    /// Textures that it reads.
    pub textures: usize,
}

/// Describes a scene.
pub fn describe(scene: &Scene) -> Description {
    let mut description = Description {
        scenes: items(&scene.scenes, |index, root| SceneItem { index, name: root.name.clone() }),
        default_scene: scene.default_scene.unwrap_or(0),
        bounds: None,
        counts: counts(scene),
        cameras: Vec::new(),
        lights: items(&scene.lights, |index, light| LightItem {
            index,
            name: light.name.clone(),
            kind: match light.kind {
                LightKind::Directional => "directional",
                LightKind::Point => "point",
                LightKind::Spot { .. } => "spot",
            },
            intensity: light.intensity.to_array(),
            range: light.range,
            profile_peak: light.profile.as_ref().map(|profile| profile.peak),
            poses: Vec::new(),
        }),
        materials: items(&scene.materials, material),
        animations: items(&scene.animations, |index, animation| AnimationItem {
            index,
            name: animation.name.clone(),
            start_seconds: animation.span[0],
            end_seconds: animation.span[1],
        }),
        variants: scene.variants.clone(),
        extensions: scene.extensions.clone(),
        warnings: scene.warnings.clone(),
    };
    place(scene, &mut description);
    description
}

fn items<T, U>(list: &[T], item: impl Fn(usize, &T) -> U) -> Vec<U> {
    list.iter().enumerate().map(|(index, source)| item(index, source)).collect()
}

fn counts(scene: &Scene) -> Counts {
    let primitives = || scene.meshes.iter().flat_map(|mesh| &mesh.primitives);
    Counts {
        triangles: primitives().map(|primitive| primitive.triangles.len() as u64).sum(),
        instanced_triangles: 0,
        vertices: primitives().map(|primitive| primitive.positions.len() as u64).sum(),
        nodes: scene.nodes.len(),
        meshes: scene.meshes.len(),
        textures: scene.textures.len(),
        images: scene.images.len(),
        animations: scene.animations.len(),
        skins: scene.skins.len(),
    }
}

fn lens(projection: Projection) -> Lens {
    match projection {
        Projection::Perspective { yfov } => Lens::Perspective { yfov_degrees: yfov.to_degrees() },
        Projection::Orthographic { ymag } => Lens::Orthographic { ymag },
    }
}

fn material(index: usize, material: &Material) -> MaterialItem {
    MaterialItem {
        index,
        name: material.name.clone(),
        alpha_mode: match material.alpha_mode {
            AlphaMode::Opaque => "opaque",
            AlphaMode::Mask { .. } => "mask",
            AlphaMode::Blend => "blend",
        },
        double_sided: material.double_sided,
        emissive: material.emissive != glam::Vec3::ZERO,
        unlit: material.unlit,
        textures: material.textures().count(),
    }
}

/// Walks the default scene at rest: bounds, instances and poses.
fn place(scene: &Scene, description: &mut Description) {
    let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    // What cannot be drawn at rest has no bounds; a render says why.
    for drawn in scene.drawn(description.default_scene).unwrap_or_default() {
        let extent = extent(&drawn.mesh);
        description.counts.instanced_triangles += extent.triangles * drawn.worlds.len() as u64;
        for world in drawn.worlds.iter().filter(|_| extent.triangles > 0) {
            for corner in extent.corners() {
                let corner = world.transform_point3(corner);
                (min, max) = (min.min(corner), max.max(corner));
            }
        }
    }
    for Placed { node: index, world } in scene.placed(description.default_scene) {
        let Some(node) = scene.nodes.get(index) else { continue };
        if let Some(camera) = node.camera.and_then(|camera| scene.cameras.get(camera)) {
            let name = camera.name.clone().or_else(|| node.name.clone());
            let item = CameraItem {
                index: description.cameras.len(),
                name,
                lens: lens(camera.projection),
                pose: pose(index, &world),
            };
            if item.index < MAX_CAMERAS {
                description.cameras.push(item);
            }
        }
        if let Some(item) = node.light.and_then(|light| description.lights.get_mut(light)) {
            item.name = item.name.take().or_else(|| node.name.clone());
            if item.poses.len() < MAX_POSES {
                item.poses.push(pose(index, &world));
            }
        }
    }
    description.bounds = (min.cmple(max).all()).then(|| Box3 { min: min.to_array(), max: max.to_array() });
}

/// Box of a mesh in its own space.
struct Extent {
    min: DVec3,
    max: DVec3,
    triangles: u64,
}

impl Extent {
    fn corners(&self) -> impl Iterator<Item = DVec3> {
        (0..8).map(|corner| {
            DVec3::select(BVec3::new(corner & 1 != 0, corner & 2 != 0, corner & 4 != 0), self.max, self.min)
        })
    }
}

fn extent(mesh: &super::Mesh) -> Extent {
    let mut extent = Extent { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY, triangles: 0 };
    for primitive in &mesh.primitives {
        extent.triangles += primitive.triangles.len() as u64;
        for position in &primitive.positions {
            extent.min = extent.min.min(position.as_dvec3());
            extent.max = extent.max.max(position.as_dvec3());
        }
    }
    extent
}

fn pose(node: usize, world: &DAffine3) -> Pose {
    Pose {
        node,
        position: world.translation.to_array(),
        direction: world.transform_vector3(DVec3::NEG_Z).normalize_or_zero().to_array(),
        up: world.transform_vector3(DVec3::Y).normalize_or_zero().to_array(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::import::testing::{Builder, scene_of};
    use serde_json::json;

    #[test]
    fn a_scene_is_described_in_world_space() {
        let mut builder = Builder::triangle();
        builder.json["nodes"] = json!([
            {"children": [1, 2], "translation": [10, 0, 0], "scale": [2, 2, 2]}, {"mesh": 0}, {"mesh": 0, "camera": 0, "name": "eye"},
            {"mesh": 0},
        ]);
        builder.json["scenes"] = json!([{"nodes": [3]}, {"nodes": [0], "name": "main"}]);
        builder.json["scene"] = json!(1);
        builder.json["cameras"] =
            json!([{"type": "perspective", "perspective": {"yfov": std::f64::consts::FRAC_PI_2, "znear": 1}}]);
        builder.json["materials"] = json!([{"name": "m", "emissiveFactor": [1, 0, 0], "alphaMode": "BLEND"}]);
        let description = describe(&scene_of(&builder));
        assert_eq!(description.bounds, Some(Box3 { min: [10.0, 0.0, 0.0], max: [12.0, 2.0, 0.0] }));
        assert_eq!((description.counts.triangles, description.counts.instanced_triangles), (1, 2));
        let json = serde_json::to_value(&description).unwrap();
        let camera = json!({
            "index": 0, "name": "eye", "type": "perspective", "yfov_degrees": 90.0,
            "node": 2, "position": [10.0, 0.0, 0.0], "direction": [0.0, 0.0, -1.0], "up": [0.0, 1.0, 0.0]
        });
        assert_eq!(json["cameras"], json!([camera]));
        assert_eq!(json["materials"][0]["alpha_mode"], "blend");
        assert_eq!(json["scenes"][1]["name"], "main");
    }

    #[test]
    fn an_empty_scene_has_no_bounds() {
        assert_eq!(describe(&Scene::default()).bounds, None);
    }
}
