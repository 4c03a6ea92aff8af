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
