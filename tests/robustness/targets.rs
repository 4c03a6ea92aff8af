//! What is done to untrusted bytes, as one function per kind: it must not panic. Tests feed it damaged files, and `fuzz/` whatever
//! libFuzzer comes up with.

use candela::compile::{self, MapFiles, decode_hdri, decode_radiance, map_size};
use candela::jobs::read_manifest;
use candela::params::{self, ParamLimits, RenderParams};
use candela::scene::{Limits, Moment, Package, Scene, describe, import};
use serde_json::json;

/// Limits low enough that what asks for much is refused at once.
fn limits() -> Limits {
    Limits { triangles: 100_000, vertices: 300_000, total_image_pixels: 1 << 20, ..Limits::default() }
}

/// A scene in any of its forms (GLB, glTF, zip): sound in every respect, or refused; whether it was accepted.
pub fn sound_or_refused(bytes: &[u8]) -> bool {
    let read = || {
        let scene = import(&Package::from_bytes(bytes.to_vec(), &limits())?, &limits())?;
        assert_sound(&scene);
        assert_poses(&scene);
        serde_json::to_string(&describe(&scene)).expect("a description is JSON");
        Ok::<_, candela::scene::SceneError>(())
    };
    let result = read();
    if let Err(error) = &result {
        assert!(!error.detail.is_empty(), "{error:?}");
    }
    result.is_ok()
}

/// Parameters as JSON, as a query and as a manifest: what is read is written as it is read, and nothing is refused without a place.
pub fn parameters(bytes: &[u8]) -> bool {
    let Ok(text) = std::str::from_utf8(bytes) else { return false };
    // Whatever it says, it may only say so.
    let _ = read_manifest(text, 100);
    let pairs = text.split('&').filter_map(|pair| pair.split_once('='));
    let _ = params::from_query(pairs);
    match params::from_json(text) {
        // What is beyond a limit may be infinite, which JSON cannot say.
        Ok(params) if params.validate(&ParamLimits::default()).is_err() => false,
        Ok(params) => {
            let again = serde_json::to_string(&params).expect("parameters are JSON");
            assert_eq!(params::from_json(&again).as_ref(), Ok(&params), "{again}");
            true
        }
        Err(faults) => {
            assert!(
                !faults.is_empty()
                    && faults.iter().all(|fault| fault.pointer.starts_with("/params") && !fault.detail.is_empty())
            );
            false
        }
    }
}

/// An image as a map, as an environment, and as the texture of a scene.
pub fn image(bytes: &[u8]) -> bool {
    let map = map_size(bytes, 1 << 16).is_some_and(|size| size.is_ok());
    // The tables that it is sampled by take a hundred times as long as reading it: only some pictures get them.
    let environment = match bytes.len() % 64 {
        0 => decode_hdri(bytes, 1 << 14).is_ok(),
        _ => decode_radiance(bytes, 1 << 14).is_ok(),
    };
    let document = json!({
        "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [0] }], "nodes": [{ "mesh": 0 }],
        "extensionsUsed": ["KHR_texture_basisu"],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0, "TEXCOORD_0": 1 }, "material": 0 }] }],
        "materials": [{ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }],
        "textures": [{ "source": 0, "extensions": { "KHR_texture_basisu": { "source": 0 } } }],
        "images": [{ "bufferView": 1, "mimeType": if bytes.starts_with(b"\xabKTX") { "image/ktx2" } else { "image/png" } }],
        "accessors": [{ "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0] },
                      { "bufferView": 0, "byteOffset": 36, "componentType": 5126, "count": 3, "type": "VEC2" }],
        "bufferViews": [{ "buffer": 0, "byteLength": 60 }, { "buffer": 0, "byteOffset": 60, "byteLength": bytes.len().max(1) }],
        "buffers": [{ "byteLength": 60 + bytes.len().max(1) }],
    });
    let corners: [f32; 15] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0];
    let mut data: Vec<u8> = corners.iter().flat_map(|value| value.to_le_bytes()).collect();
    data.extend_from_slice(bytes);
    data.resize(data.len().max(61), 0);
    let package = Package::from_bytes(super::damage::glb(document.to_string().as_bytes(), &data), &limits());
    let scene = package.and_then(|package| import(&package, &limits()));
    let texture =
        scene.is_ok_and(|scene| compile::compile_request(&scene, &RenderParams::default(), &MapFiles::new()).is_ok());
    map || environment || texture
}

/// Panics unless every index and number that later stages rely on is sound.
pub fn assert_sound(scene: &Scene) {
    assert!(scene.scenes.iter().flat_map(|root| &root.nodes).all(|node| *node < scene.nodes.len()));
    for node in &scene.nodes {
        assert!(node.local.is_finite());
        assert!(node.children.iter().all(|child| *child < scene.nodes.len()));
        assert!(node.mesh.is_none_or(|mesh| mesh < scene.meshes.len()));
        assert!(node.camera.is_none_or(|camera| camera < scene.cameras.len()));
        assert!(node.light.is_none_or(|light| light < scene.lights.len()));
        assert!(node.skin.is_none_or(|skin| skin < scene.skins.len()));
        assert!(node.instances.iter().flat_map(|places| &places[..]).all(|place| place.is_finite()));
    }
    for primitive in scene.meshes.iter().flat_map(|mesh| &mesh.primitives) {
        let count = primitive.positions.len();
        assert!(primitive.triangles.iter().flatten().all(|vertex| (*vertex as usize) < count));
        assert!(primitive.positions.iter().all(|position| position.is_finite()));
        let normals = primitive.normals.as_ref();
        assert!(normals.is_none_or(|all| all.len() == count && all.iter().all(|normal| normal.length() < 1.001)));
        let tangents = primitive.tangents.as_ref();
        assert!(tangents.is_none_or(|all| all.len() == count && all.iter().all(|t| t.truncate().length() < 1.001)));
        let colors = primitive.colors.as_ref();
        assert!(colors.is_none_or(|all| all.len() == count && all.iter().all(|color| color.is_finite())));
        assert!(primitive.uvs.iter().all(|all| all.len() == count && all.iter().all(|uv| uv.is_finite())));
        let influences = primitive.influences.as_ref();
        assert!(influences.is_none_or(|all| all.joints.len() == count * all.per_vertex));
        assert!(influences.is_none_or(|all| all.weights.len() == all.joints.len()));
        for target in &primitive.targets {
            for list in [&target.positions, &target.normals, &target.tangents] {
                assert!(list.is_empty() || list.len() == count && list.iter().all(|difference| difference.is_finite()));
            }
        }
        let Some(material) = primitive.material else { continue };
        for texture in scene.materials[material].textures() {
            assert!(texture.uv_set < primitive.uvs.len());
            assert!(!scene.images[scene.textures[texture.texture].image].bytes.is_empty());
        }
    }
}

/// Panics unless a scene can be posed at any time, to sound vertices or an error.
pub fn assert_poses(scene: &Scene) {
    for (animation, of_file) in scene.animations.iter().enumerate() {
        for time in [f64::MIN, of_file.span[0], (of_file.span[0] + of_file.span[1]) * 0.5, f64::MAX] {
            let posed = scene.at(Some(Moment { animation, time }));
            for drawn in posed.drawn(0).into_iter().flatten() {
                let positions = || drawn.mesh.primitives.iter().flat_map(|primitive| &primitive.positions);
                assert!(positions().all(|position| position.is_finite()));
            }
        }
    }
}
