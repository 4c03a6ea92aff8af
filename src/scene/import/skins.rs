//! Skins: joints, and how meshes were bound to them.

use super::accessor::{Component, open};
use super::budget::Budget;
use super::data::Data;
use super::nodes::affine;
use super::references::{all, one};
use crate::scene::{Mesh, Node, SceneError, Skin};
use glam::DAffine3;

/// Reads all skins.
pub(super) fn read(data: &Data<'_>, budget: &mut Budget) -> Result<Vec<Skin>, SceneError> {
    (0..data.root.skins.len()).map(|index| skin(data, index, budget)).collect()
}

fn skin(data: &Data<'_>, index: usize, budget: &mut Budget) -> Result<Skin, SceneError> {
    let place = |name: &str| format!("/skins/{index}/{name}");
    let Some(source) = data.root.skins.get(index) else { return Ok(Skin::default()) };
    all(&source.joints, data.root.nodes.len(), "node", || place("joints"))?;
    one(source.skeleton, data.root.nodes.len(), "node", || place("skeleton"))?;
    one(source.inverse_bind_matrices, data.root.accessors.len(), "accessor", || place("inverseBindMatrices"))?;
    let joints = source.joints.clone();
    if joints.is_empty() {
        return Err(SceneError::invalid("skin_joints", place("joints"), "a skin needs at least one joint"));
    }
    let inverse_bind = match source.inverse_bind_matrices {
        // 3.7.3.1: joints were bound as they are in the world.
        None => vec![DAffine3::IDENTITY; joints.len()],
        Some(matrices) => inverse_bind(data, matrices, joints.len(), &place("inverseBindMatrices"), budget)?,
    };
    Ok(Skin { name: source.name.clone(), joints, inverse_bind })
}

fn inverse_bind(
    data: &Data<'_>,
    accessor: usize,
    joints: usize,
    place: &str,
    budget: &mut Budget,
) -> Result<Vec<DAffine3>, SceneError> {
    let matrices = open(data, accessor)?;
    if (matrices.format.component, matrices.format.columns) != (Component::F32, 4) {
        let detail = format!("inverse bind matrices are MAT4 of floats, not {}", matrices.format);
        return Err(SceneError::invalid("accessor_type", place, detail));
    }
    if matrices.count < joints {
        let detail = format!("{} matrices for {joints} joints; there must be one for each", matrices.count);
        return Err(SceneError::invalid("accessor_count", place, detail));
    }
    if !matrices.is_stored() && !matrices.is_sparse() {
        let detail = "inverse bind matrices without a buffer view are all zero; export the file again";
        return Err(SceneError::invalid("skin_matrices", place, detail));
    }
    budget.charge((matrices.count * size_of::<DAffine3>()) as u64, matrices.count, place)?;
    let matrices = matrices.numbers::<16>(None, 0.0)?;
    let checked = matrices.iter().take(joints).enumerate();
    checked.map(|(joint, matrix)| affine(&matrix.map(f64::from), &format!("{place}/{joint}"))).collect()
}

/// Whether the joints that vertices name are in the skins that move them.
pub(super) fn check_joints(nodes: &[Node], meshes: &[Mesh], skins: &[Skin]) -> Result<(), SceneError> {
    let highest: Vec<Option<u16>> = meshes.iter().map(highest_joint).collect();
    for (index, node) in nodes.iter().enumerate() {
        let skin = node.skin.and_then(|skin| skins.get(skin));
        let highest = node.mesh.and_then(|mesh| highest.get(mesh).copied().flatten());
        if let (Some(skin), Some(highest)) = (skin, highest)
            && usize::from(highest) >= skin.joints.len()
        {
            let detail =
                format!("a vertex of its mesh names joint {highest}, but the skin has only {}", skin.joints.len());
            return Err(SceneError::invalid("joint_out_of_range", format!("/nodes/{index}/skin"), detail));
        }
    }
    Ok(())
}

/// Of the joints that move anything.
fn highest_joint(mesh: &Mesh) -> Option<u16> {
    let influences = mesh.primitives.iter().filter_map(|primitive| primitive.influences.as_ref());
    let joints = influences.flat_map(|all| all.joints.iter().zip(&all.weights));
    joints.filter(|(_, weight)| **weight > 0.0).map(|(joint, _)| *joint).max()
}

#[cfg(test)]
mod tests {
    use crate::scene::import::testing::{Builder, error_of, scene_of};
    use serde_json::{Value, json};

    fn skinned(skin: &Value, joints: [u8; 12], weights: [f32; 12]) -> Builder {
        let mut builder = Builder::triangle();
        let view = builder.view(&joints);
        builder.json["accessors"]
            .as_array_mut()
            .unwrap()
            .push(json!({"bufferView": view, "componentType": 5121, "count": 3, "type": "VEC4"}));
        builder.json["meshes"][0]["primitives"][0]["attributes"]["JOINTS_0"] = json!(1);
        builder.attribute("WEIGHTS_0", &weights, "VEC4");
        builder.json["nodes"] = json!([{"mesh": 0, "skin": 0}, {}]);
        builder.json["skins"] = json!([skin]);
        builder
    }

    const FIRST: [f32; 12] = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0];

    #[test]
    fn weights_are_mended_with_a_warning() {
        let weights = [0.0, 0.0, 0.0, 0.0, -1.0, 0.5, 0.0, 0.0, 0.5, 0.49, 0.0, 0.0];
        let scene = scene_of(&skinned(&json!({"joints": [0, 1]}), [0, 1, 9, 9, 0, 1, 9, 9, 0, 1, 9, 9], weights));
        let influences = scene.meshes[0].primitives[0].influences.as_ref().unwrap();
        let of = |vertex: usize| &influences.weights[vertex * 4..vertex * 4 + 2];
        assert_eq!([of(0), of(1)], [&[1.0, 0.0], &[0.0, 1.0]]);
        assert!((of(2)[0] - 0.505_05).abs() < 1e-5);
        let details: Vec<&str> = scene.warnings.iter().map(|warning| &warning.detail[..14]).collect();
        assert_eq!(details, ["1 vertices hav", "1 vertices hav", "1 vertices hav"]);
        assert!(scene_of(&skinned(&json!({"joints": [0]}), [0; 12], FIRST)).warnings.is_empty());
    }

    #[test]
    fn faults_are_named() {
        let fault = |skin: Value, joints| {
            let fault = error_of(&skinned(&skin, joints, FIRST));
            (fault.code, fault.pointer)
        };
        let at = |code, pointer: &str| (code, pointer.to_owned());
        assert_eq!(fault(json!({"joints": [0, 1]}), [2; 12]), at("joint_out_of_range", "/nodes/0/skin"));
        assert_eq!(fault(json!({"joints": []}), [0; 12]), at("skin_joints", "/skins/0/joints"));
        assert_eq!(fault(json!({"joints": [7]}), [0; 12]), at("reference", "/skins/0/joints/0"));
        let mut builder = skinned(&json!({"joints": [0, 1], "inverseBindMatrices": 3}), [0; 12], FIRST);
        let mut matrices = |values: &[f32]| {
            let accessor = builder.accessor(values, "MAT4");
            builder.json["accessors"][accessor]["count"] = json!(values.len() / 16);
            builder.json["skins"][0]["inverseBindMatrices"] = json!(accessor);
            let fault = error_of(&builder);
            (fault.code, fault.pointer)
        };
        let identity = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
        assert_eq!(matrices(&identity), at("accessor_count", "/skins/0/inverseBindMatrices"));
        let broken = [identity, [f32::NAN; 16]].concat();
        assert_eq!(matrices(&broken), at("not_finite", "/skins/0/inverseBindMatrices/1"));
        let projective = [identity, [1.0; 16]].concat();
        assert_eq!(matrices(&projective), at("matrix", "/skins/0/inverseBindMatrices/1"));
        let mut bare = skinned(&json!({"joints": [0]}), [0; 12], FIRST);
        bare.json["meshes"][0]["primitives"][0]["attributes"].as_object_mut().unwrap().remove("WEIGHTS_0");
        assert_eq!(scene_of(&bare).warnings[0].code, "skin_weights");
    }
}
