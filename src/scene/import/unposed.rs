//! Skins, morph targets and animations: checked, and reported as not posed.

use super::accessor::{Accessor, Component, open};
use super::data::Data;
use super::references::{all, one};
use super::schema::{Animation, Root};
use crate::scene::SceneError;
use crate::scene::error::Warnings;

/// Checks the structures and says once for each kind what the picture shows instead.
pub(super) fn check(data: &Data<'_>, warnings: &mut Warnings) -> Result<(), SceneError> {
    skins(data)?;
    for index in 0..data.root.animations.len() {
        animation(data, index)?;
    }
    warn(data.root, warnings);
    Ok(())
}

fn warn(root: &Root, warnings: &mut Warnings) {
    if root.nodes.iter().any(|node| node.skin.is_some()) {
        warnings.add(
            "skin_ignored",
            "/skins",
            "skinned meshes are drawn unskinned, with vertices where the file stores them",
        );
    }
    let targets = |primitive: &super::schema::Primitive| !primitive.targets.is_empty();
    if root.meshes.iter().any(|mesh| mesh.primitives.iter().any(targets)) {
        let moved =
            root.meshes.iter().flat_map(|mesh| &mesh.weights).chain(root.nodes.iter().flat_map(|node| &node.weights));
        let lost = if moved.into_iter().any(|weight| *weight != 0.0) { ", though the file sets weights" } else { "" };
        warnings.add("morph_ignored", "/meshes", format!("morph targets are not applied{lost}; base meshes are drawn"));
    }
    if !root.animations.is_empty() {
        warnings.add(
            "animation_ignored",
            "/animations",
            "animations are not played; nodes keep the transforms stored in the file",
        );
    }
}

fn skins(data: &Data<'_>) -> Result<(), SceneError> {
    for (index, skin) in data.root.skins.iter().enumerate() {
        let place = |name: &str| format!("/skins/{index}/{name}");
        all(&skin.joints, data.root.nodes.len(), "node", || place("joints"))?;
        one(skin.skeleton, data.root.nodes.len(), "node", || place("skeleton"))?;
        one(skin.inverse_bind_matrices, data.root.accessors.len(), "accessor", || place("inverseBindMatrices"))?;
        let Some(matrices) = skin.inverse_bind_matrices else { continue };
        let matrices = open(data, matrices)?;
        let place = place("inverseBindMatrices");
        if (matrices.format.component, matrices.format.columns) != (Component::F32, 4) {
            let detail = format!("inverse bind matrices are MAT4 of floats, not {}", matrices.format);
            return Err(SceneError::invalid("accessor_type", place, detail));
        }
        if matrices.count < skin.joints.len() {
            let detail =
                format!("{} matrices for {} joints; there must be one for each", matrices.count, skin.joints.len());
            return Err(SceneError::invalid("accessor_count", place, detail));
        }
    }
    Ok(())
}

fn animation(data: &Data<'_>, index: usize) -> Result<(), SceneError> {
    let Some(animation) = data.root.animations.get(index) else { return Ok(()) };
    for (i, sampler) in animation.samplers.iter().enumerate() {
        let place = format!("/animations/{index}/samplers/{i}");
        one(Some(sampler.input), data.root.accessors.len(), "accessor", || format!("{place}/input"))?;
        one(Some(sampler.output), data.root.accessors.len(), "accessor", || format!("{place}/output"))?;
        let input = open(data, sampler.input)?;
        if (input.format.component, input.format.rows) != (Component::F32, 1) {
            let detail = format!("times are SCALAR floats, not {}", input.format);
            return Err(SceneError::invalid("accessor_type", format!("{place}/input"), detail));
        }
        if !matches!(sampler.interpolation.as_deref(), None | Some("LINEAR" | "STEP" | "CUBICSPLINE")) {
            let detail = "the interpolation is LINEAR, STEP or CUBICSPLINE";
            return Err(SceneError::invalid("animation", format!("{place}/interpolation"), detail));
        }
    }
    (0..animation.channels.len())
        .try_for_each(|channel| check_channel(data, animation, channel, &format!("/animations/{index}")))
}

fn check_channel(data: &Data<'_>, animation: &Animation, index: usize, place: &str) -> Result<(), SceneError> {
    let Some(channel) = animation.channels.get(index) else { return Ok(()) };
    let place = format!("{place}/channels/{index}");
    one(Some(channel.sampler), animation.samplers.len(), "sampler of the animation", || format!("{place}/sampler"))?;
    one(channel.target.node, data.root.nodes.len(), "node", || format!("{place}/target/node"))?;
    let Some(sampler) = animation.samplers.get(channel.sampler) else { return Ok(()) };
    let (input, output) = (open(data, sampler.input)?, open(data, sampler.output)?);
    let values = if sampler.interpolation.as_deref() == Some("CUBICSPLINE") { 3 } else { 1 };
    let (rows, per_key) = match channel.target.path.as_str() {
        "translation" | "scale" => (3, 1),
        "rotation" => (4, 1),
        "weights" => (1, weights(data.root, channel.target.node)),
        // Other paths belong to extensions.
        _ => return Ok(()),
    };
    check_output(&output, rows, input.count as u64 * values * per_key, &format!("{place}/sampler"))
}

fn check_output(output: &Accessor<'_>, rows: usize, count: u64, place: &str) -> Result<(), SceneError> {
    if (output.format.rows, output.format.columns) != (rows, 1) {
        let detail =
            format!("the sampler's output is {}, but the path needs {rows} numbers per element", output.format);
        return Err(SceneError::invalid("accessor_type", place, detail));
    }
    if output.count as u64 != count {
        let detail = format!("the sampler's output has {} elements, but its keys need {count}", output.count);
        return Err(SceneError::invalid("accessor_count", place, detail));
    }
    Ok(())
}

/// Morph targets of the mesh that `node` shows.
fn weights(root: &Root, node: Option<usize>) -> u64 {
    let mesh = node.and_then(|node| root.nodes.get(node)).and_then(|node| root.meshes.get(node.mesh?));
    mesh.and_then(|mesh| mesh.primitives.first()).map_or(0, |primitive| primitive.targets.len() as u64)
}

#[cfg(test)]
mod tests {
    use crate::scene::import::testing::{error, gltf, scene};
    use serde_json::{Value, json};

    fn accessor(kind: &str, count: u32) -> Value {
        json!({"componentType": 5126, "type": kind, "count": count})
    }

    #[test]
    fn skins_are_checked_and_reported() {
        let skin = |count, joints: &[u32]| json!({"nodes": [{"skin": 0}, {}], "skins": [{"inverseBindMatrices": 0, "joints": joints}], "accessors": [accessor("MAT4", count)]});
        let warnings = scene(&gltf(skin(2, &[0, 1]))).warnings;
        assert!(warnings.iter().any(|warning| warning.code == "skin_ignored"));
        assert_eq!(error(&gltf(skin(1, &[0, 1]))).pointer, "/skins/0/inverseBindMatrices");
    }

    #[test]
    fn animations_are_checked_and_reported() {
        let animation = |path: &str, interpolation: &str, kind: &str, count| {
            json!({"nodes": [{}], "accessors": [accessor("SCALAR", 2), accessor(kind, count)], "animations": [{
                "samplers": [{"input": 0, "output": 1, "interpolation": interpolation}],
                "channels": [{"sampler": 0, "target": {"node": 0, "path": path}}]}]})
        };
        let good = scene(&gltf(animation("rotation", "CUBICSPLINE", "VEC4", 6)));
        assert_eq!(good.animation_count, 1);
        assert!(good.warnings.iter().any(|warning| warning.code == "animation_ignored"));
        assert!(scene(&gltf(animation("pointer", "LINEAR", "VEC2", 9))).animation_count == 1);
        let fault =
            |path, interpolation, kind, count| error(&gltf(animation(path, interpolation, kind, count))).pointer;
        assert_eq!(fault("scale", "LINEAR", "VEC3", 3), "/animations/0/channels/0/sampler");
        assert_eq!(fault("scale", "STEP", "VEC4", 2), "/animations/0/channels/0/sampler");
        assert_eq!(fault("scale", "CURVE", "VEC3", 2), "/animations/0/samplers/0/interpolation");
    }
}
