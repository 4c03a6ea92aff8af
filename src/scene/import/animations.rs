//! Animations: all are checked; channels that move a node are kept.

use super::accessor::{Accessor, Component, open};
use super::budget::Budget;
use super::data::Data;
use super::number::not_finite;
use super::references::one;
use super::schema::{self, Root};
use crate::scene::error::Warnings;
use crate::scene::{Animation, Channel, Curve, Interpolation, Node, Parts, Path, SceneError, Skin};
use glam::{DAffine3, DQuat, DVec3};
use std::collections::{BTreeMap, BTreeSet};

/// Reads all animations.
pub(super) fn read(
    data: &Data<'_>,
    budget: &mut Budget,
    warnings: &mut Warnings,
) -> Result<Vec<Animation>, SceneError> {
    (0..data.root.animations.len()).map(|index| animation(data, index, budget, warnings)).collect()
}

fn animation(
    data: &Data<'_>,
    index: usize,
    budget: &mut Budget,
    warnings: &mut Warnings,
) -> Result<Animation, SceneError> {
    let place = format!("/animations/{index}");
    let Some(source) = data.root.animations.get(index) else { return Ok(Animation::default()) };
    for (i, sampler) in source.samplers.iter().enumerate() {
        check_sampler(data, sampler, &format!("{place}/samplers/{i}"))?;
    }
    let mut channels: Vec<Channel> = Vec::new();
    let mut seen = BTreeSet::new();
    for (i, channel) in source.channels.iter().enumerate() {
        let place = format!("{place}/channels/{i}");
        one(Some(channel.sampler), source.samplers.len(), "sampler of the animation", || format!("{place}/sampler"))?;
        one(channel.target.node, data.root.nodes.len(), "node", || format!("{place}/target/node"))?;
        let (Some(node), Some(sampler)) = (channel.target.node, source.samplers.get(channel.sampler)) else { continue };
        let Some((path, width)) = property(data.root, channel, node, &place, warnings) else { continue };
        if !seen.insert((node, path)) {
            let detail = "another channel of the animation moves the same property; the last one counts";
            warnings.add("channel_repeated", place.clone(), detail);
        }
        let curve = curve(data, sampler, path, width, &format!("{place}/sampler"), budget)?;
        channels.push(Channel { node, path, curve });
    }
    let keys = || channels.iter().flat_map(|channel| channel.curve.times.iter().map(|time| f64::from(*time)));
    let span = match keys().next() {
        Some(_) => [keys().fold(f64::INFINITY, f64::min), keys().fold(f64::NEG_INFINITY, f64::max)],
        None => [0.0, 0.0],
    };
    Ok(Animation { name: source.name.clone(), channels, span, moves_meshes: false })
}

fn check_sampler(data: &Data<'_>, sampler: &schema::AnimationSampler, place: &str) -> Result<(), SceneError> {
    one(Some(sampler.input), data.root.accessors.len(), "accessor", || format!("{place}/input"))?;
    one(Some(sampler.output), data.root.accessors.len(), "accessor", || format!("{place}/output"))?;
    let input = open(data, sampler.input)?;
    if (input.format.component, input.format.rows, input.format.columns) != (Component::F32, 1, 1) {
        let detail = format!("times are SCALAR floats, not {}", input.format);
        return Err(SceneError::invalid("accessor_type", format!("{place}/input"), detail));
    }
    if interpolation(sampler).is_none() {
        let detail = "the interpolation is LINEAR, STEP or CUBICSPLINE";
        return Err(SceneError::invalid("animation", format!("{place}/interpolation"), detail));
    }
    Ok(())
}

fn interpolation(sampler: &schema::AnimationSampler) -> Option<Interpolation> {
    match sampler.interpolation.as_deref() {
        None | Some("LINEAR") => Some(Interpolation::Linear),
        Some("STEP") => Some(Interpolation::Step),
        Some("CUBICSPLINE") => Some(Interpolation::CubicSpline),
        Some(_) => None,
    }
}

/// What a channel moves, and of how many numbers that is; none: nothing that is known here.
fn property(
    root: &Root,
    channel: &schema::Channel,
    node: usize,
    place: &str,
    warnings: &mut Warnings,
) -> Option<(Path, usize)> {
    match channel.target.path.as_str() {
        "translation" => Some((Path::Translation, 3)),
        "rotation" => Some((Path::Rotation, 4)),
        "scale" => Some((Path::Scale, 3)),
        "weights" => match targets(root, node) {
            0 => {
                let detail = "the node shows no mesh with morph targets; the channel moves nothing";
                warnings.add("channel_ignored", format!("{place}/target"), detail);
                None
            }
            targets => Some((Path::Weights, targets)),
        },
        // Of an extension, whose own warning says so.
        _ => None,
    }
}

/// Morph targets of the mesh that a node shows.
pub(super) fn targets(root: &Root, node: usize) -> usize {
    let mesh = root.nodes.get(node).and_then(|node| root.meshes.get(node.mesh?));
    mesh.and_then(|mesh| mesh.primitives.first()).map_or(0, |primitive| primitive.targets.len())
}

fn curve(
    data: &Data<'_>,
    sampler: &schema::AnimationSampler,
    path: Path,
    width: usize,
    place: &str,
    budget: &mut Budget,
) -> Result<Curve, SceneError> {
    let (input, output) = (open(data, sampler.input)?, open(data, sampler.output)?);
    let interpolation = interpolation(sampler).unwrap_or_default();
    let times = times(&input, place, budget)?;
    let per_key = if interpolation == Interpolation::CubicSpline { 3 } else { 1 };
    let (rows, elements) = if path == Path::Weights { (1, width) } else { (width, 1) };
    check_output(&output, rows, (times.len() as u64).saturating_mul(per_key * elements as u64), place)?;
    let values = values(&output, rows, place, budget)?;
    let curve = Curve { times, values, width, interpolation };
    if path == Path::Rotation {
        check_rotations(&curve, per_key as usize, place)?;
    }
    Ok(curve)
}

fn times(input: &Accessor<'_>, place: &str, budget: &mut Budget) -> Result<Vec<f32>, SceneError> {
    if input.count == 0 {
        return Err(SceneError::invalid("animation_times", place, "the sampler has no key"));
    }
    budget.charge((input.count * size_of::<f32>()) as u64, input.count, &input.pointer)?;
    let times: Vec<f32> = input.numbers::<1>(None, 0.0)?.into_iter().flatten().collect();
    if let Some(key) = times.iter().position(|time| !time.is_finite()) {
        return Err(not_finite(&input.pointer, format!("the time of key {key}")));
    }
    if let Some(key) = times.windows(2).position(|pair| pair[0] >= pair[1]) {
        let detail = format!("the time of key {} is not after that of key {key}; sort the keys", key + 1);
        return Err(SceneError::invalid("animation_times", input.pointer.clone(), detail));
    }
    Ok(times)
}

fn check_output(output: &Accessor<'_>, rows: usize, count: u64, place: &str) -> Result<(), SceneError> {
    let format = output.format;
    let component = format.component == Component::F32 || (format.normalized && format.component != Component::U32);
    if (format.rows, format.columns) != (rows, 1) || !component {
        let detail = format!(
            "the sampler's output is {format}, but the path needs {rows} numbers per element, floats or normalised integers"
        );
        return Err(SceneError::invalid("accessor_type", place, detail));
    }
    if output.count as u64 != count {
        let detail = format!("the sampler's output has {} elements, but its keys need {count}", output.count);
        return Err(SceneError::invalid("accessor_count", place, detail));
    }
    Ok(())
}

fn values(output: &Accessor<'_>, rows: usize, place: &str, budget: &mut Budget) -> Result<Vec<f32>, SceneError> {
    budget.charge((output.count * size_of::<[f32; 4]>()) as u64, output.count, &output.pointer)?;
    let elements = output.numbers::<4>(None, 0.0)?;
    let values: Vec<f32> = elements.iter().flat_map(|element| element.iter().take(rows)).copied().collect();
    if let Some(number) = values.iter().position(|value| !value.is_finite()) {
        return Err(not_finite(place, format!("a number of element {} of the output", number / rows)));
    }
    Ok(values)
}

fn check_rotations(curve: &Curve, per_key: usize, place: &str) -> Result<(), SceneError> {
    // Of a cubic the second of three; tangents may be zero.
    let values = curve.values.chunks_exact(4).skip(per_key / 2).step_by(per_key);
    for (key, value) in values.enumerate() {
        if DQuat::from_slice(&[0, 1, 2, 3].map(|i: usize| f64::from(value[i]))).length() < 1e-6 {
            let detail = format!("the quaternion of key {key} has no direction; write unit quaternions (x, y, z, w)");
            return Err(SceneError::invalid("rotation", place, detail));
        }
    }
    Ok(())
}

/// The transforms at rest of the nodes that animations move, in the parts that they move.
pub(super) fn moved(
    root: &Root,
    animations: &[Animation],
    nodes: &[Node],
    warnings: &mut Warnings,
) -> BTreeMap<usize, Parts> {
    let channels = animations.iter().flat_map(|animation| &animation.channels);
    let indices: BTreeSet<usize> = channels.filter(|c| c.path != Path::Weights).map(|channel| channel.node).collect();
    let mut moved = BTreeMap::new();
    for index in indices {
        let (Some(source), Some(node)) = (root.nodes.get(index), nodes.get(index)) else { continue };
        let parts = if source.matrix.is_some() {
            let detail =
                "animations move a node's translation, rotation and scale, but it has a `matrix`, which is taken apart";
            warnings.add("animated_matrix", format!("/nodes/{index}/matrix"), detail);
            taken_apart(&node.local)
        } else {
            Parts {
                translation: source.translation.map_or(DVec3::ZERO, DVec3::from),
                rotation: source.rotation.map_or(DQuat::IDENTITY, DQuat::from_array).normalize(),
                scale: source.scale.map_or(DVec3::ONE, DVec3::from),
            }
        };
        moved.insert(index, parts);
    }
    moved
}

fn taken_apart(local: &DAffine3) -> Parts {
    let (scale, rotation, translation) = local.to_scale_rotation_translation();
    let rotation = if rotation.is_finite() { rotation } else { DQuat::IDENTITY };
    Parts { translation, rotation, scale }
}

/// Sets [`Animation::moves_meshes`].
pub(super) fn find_moved_meshes(animations: &mut [Animation], nodes: &[Node], skins: &[Skin]) {
    let used = nodes.iter().filter(|node| node.mesh.is_some()).filter_map(|node| skins.get(node.skin?));
    let mut shows: Vec<bool> = nodes.iter().map(|node| node.mesh.is_some()).collect();
    for joint in used.flat_map(|skin| &skin.joints) {
        if let Some(shows) = shows.get_mut(*joint) {
            *shows = true;
        }
    }
    for animation in animations {
        let mut moved: Vec<usize> = animation.channels.iter().map(|channel| channel.node).collect();
        let mut seen = vec![false; nodes.len()];
        while let Some(index) = moved.pop() {
            let (Some(node), Some(seen)) = (nodes.get(index), seen.get_mut(index)) else { continue };
            if !std::mem::replace(seen, true) {
                animation.moves_meshes |= shows.get(index).copied().unwrap_or(false);
                moved.extend(&node.children);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::scene::import::testing::{Builder, error_of, scene_of};
    use crate::scene::{Path, Scene};
    use serde_json::json;

    fn animated(path: &str, interpolation: &str, kind: &str, times: &[f32], values: &[f32]) -> Builder {
        let mut builder = Builder::triangle();
        let (input, output) = (builder.accessor(times, "SCALAR"), builder.accessor(values, kind));
        builder.json["animations"] = json!([{
            "samplers": [{"input": input, "output": output, "interpolation": interpolation}],
            "channels": [{"sampler": 0, "target": {"node": 0, "path": path}}]}]);
        builder
    }

    fn codes(scene: &Scene) -> Vec<&str> {
        scene.warnings.iter().map(|warning| warning.code).collect()
    }

    #[test]
    fn channels_are_read() {
        let unit = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0];
        let scene = scene_of(&animated("rotation", "CUBICSPLINE", "VEC4", &[0.5], &unit));
        let channel = &scene.animations[0].channels[0];
        assert_eq!((channel.path, channel.node, channel.curve.width), (Path::Rotation, 0, 4));
        assert!(codes(&scene).is_empty() && scene.moved.contains_key(&0));
        assert!(scene_of(&animated("pointer", "LINEAR", "VEC2", &[0.0], &[0.0; 4])).animations[0].channels.is_empty());
        let weights = scene_of(&animated("weights", "LINEAR", "SCALAR", &[0.0], &[0.0]));
        assert_eq!((weights.animations[0].channels.len(), codes(&weights)), (0, vec!["channel_ignored"]));
        let mut twice = animated("scale", "STEP", "VEC3", &[0.0], &[1.0; 3]);
        let channel = twice.json["animations"][0]["channels"][0].clone();
        twice.json["animations"][0]["channels"].as_array_mut().unwrap().push(channel);
        twice.json["nodes"][0]["matrix"] = json!([2, 0, 0, 0, 0, 3, 0, 0, 0, 0, 4, 0, 5, 6, 7, 1]);
        let scene = scene_of(&twice);
        assert_eq!(codes(&scene), ["channel_repeated", "animated_matrix"]);
        assert!(glam::DAffine3::from(scene.moved[&0]).abs_diff_eq(scene.nodes[0].local, 1e-12));
    }

    #[test]
    fn faults_are_named() {
        let fault = |path, interpolation, kind, times: &[f32], values: &[f32]| {
            let fault = error_of(&animated(path, interpolation, kind, times, values));
            (fault.code, fault.pointer)
        };
        let at = |code, pointer: &str| (code, pointer.to_owned());
        let sampler = "/animations/0/channels/0/sampler";
        assert_eq!(fault("scale", "LINEAR", "VEC3", &[0.0, 1.0], &[1.0; 9]), at("accessor_count", sampler));
        assert_eq!(fault("scale", "CUBICSPLINE", "VEC3", &[0.0], &[1.0; 3]), at("accessor_count", sampler));
        assert_eq!(fault("scale", "STEP", "VEC4", &[0.0], &[1.0; 4]), at("accessor_type", sampler));
        assert_eq!(
            fault("scale", "CURVE", "VEC3", &[0.0], &[1.0; 3]),
            at("animation", "/animations/0/samplers/0/interpolation")
        );
        for times in [[1.0, 1.0], [2.0, 1.0]] {
            assert_eq!(fault("scale", "LINEAR", "VEC3", &times, &[1.0; 6]), at("animation_times", "/accessors/1"));
        }
        assert_eq!(fault("scale", "LINEAR", "VEC3", &[0.0, f32::NAN], &[1.0; 6]), at("not_finite", "/accessors/1"));
        assert_eq!(fault("scale", "LINEAR", "VEC3", &[0.0], &[1.0, f32::INFINITY, 1.0]), at("not_finite", sampler));
        assert_eq!(fault("rotation", "LINEAR", "VEC4", &[0.0], &[0.0; 4]), at("rotation", sampler));
        assert_eq!(fault("scale", "LINEAR", "VEC3", &[], &[]), at("animation_times", sampler));
        let mut huge = animated("scale", "LINEAR", "VEC3", &[0.0], &[1.0; 3]);
        huge.json["accessors"][1] = json!({"componentType": 5126, "type": "SCALAR", "count": 4_000_000_000_u32});
        assert_eq!(error_of(&huge).code, "decoded_bytes");
    }
}
