//! Nodes and scenes: transforms, and a hierarchy that is a forest of limited depth.

use super::animations::targets;
use super::budget::Budget;
use super::data::Data;
use super::document;
use super::instances;
use super::number::not_finite;
use super::schema::{self, NodeLight, Root};
use crate::scene::error::Warnings;
use crate::scene::{Limits, Node, SceneError, SceneRoot};
use glam::{DAffine3, DMat4, DQuat, DVec3};

/// The hierarchy of a file.
pub(super) struct Hierarchy {
    pub nodes: Vec<Node>,
    pub scenes: Vec<SceneRoot>,
    /// By node: whether a scene contains it.
    pub shown: Vec<bool>,
}

/// Reads nodes and scenes; references have been checked.
pub(super) fn read(
    data: &Data<'_>,
    limits: &Limits,
    budget: &mut Budget,
    warnings: &mut Warnings,
) -> Result<Hierarchy, SceneError> {
    let root = data.root;
    let nodes = root.nodes.iter().enumerate().map(|(index, source)| {
        let place = format!("/nodes/{index}");
        let instances = instances::read(data, source, &place, budget)?;
        Ok(Node { instances, weights: weights(root, source, index)?, ..node(source, &place, warnings)? })
    });
    let nodes = nodes.collect::<Result<Vec<_>, _>>()?;
    let has_parent = check_parents(&nodes)?;
    let tops: Vec<usize> = (0..nodes.len()).filter(|index| !has_parent.get(*index).copied().unwrap_or(false)).collect();
    let visited = walk(&nodes, &tops, limits)?;
    if let Some(index) = visited.iter().position(|visited| !visited) {
        let detail = "the node is its own ancestor; the hierarchy must be a tree";
        return Err(SceneError::invalid("node_cycle", format!("/nodes/{index}"), detail));
    }
    let scenes = scenes(root, &has_parent, tops, warnings)?;
    let mut roots: Vec<usize> = scenes.iter().flat_map(|scene| scene.nodes.iter().copied()).collect();
    roots.sort_unstable();
    roots.dedup();
    let shown = walk(&nodes, &roots, limits)?;
    Ok(Hierarchy { nodes, scenes, shown })
}

fn node(source: &schema::Node, place: &str, warnings: &mut Warnings) -> Result<Node, SceneError> {
    let light = source.extensions.get("KHR_lights_punctual");
    let light = light.map(|content| document::extension::<NodeLight>(content, place)).transpose()?;
    if source.skin.is_some() && source.extensions.contains_key(instances::NAME) {
        let detail = "joints say where a skinned mesh is; it is drawn once";
        warnings.add("instances_ignored", format!("{place}/extensions/{}", instances::NAME), detail);
    }
    Ok(Node {
        name: source.name.clone(),
        local: transform(source, place, warnings)?,
        children: source.children.clone(),
        mesh: source.mesh,
        camera: source.camera,
        light: light.map(|light| light.light),
        skin: source.skin,
        ..Node::default()
    })
}

/// Weights of the morph targets of the node's mesh: the node's own, else the mesh's, else 0.
fn weights(root: &Root, node: &schema::Node, index: usize) -> Result<Vec<f64>, SceneError> {
    let Some(mesh_index) = node.mesh else { return Ok(Vec::new()) };
    let targets = targets(root, index);
    let of_mesh = root.meshes.get(mesh_index).map_or(&[][..], |mesh| &mesh.weights);
    let lists =
        [(&node.weights[..], format!("/nodes/{index}/weights")), (of_mesh, format!("/meshes/{mesh_index}/weights"))];
    let given = lists.into_iter().find(|(list, _)| !list.is_empty());
    let Some((weights, place)) = given else { return Ok(vec![0.0; targets]) };
    if weights.len() != targets {
        let detail = format!("{} weights for {targets} morph targets; there must be one for each", weights.len());
        return Err(SceneError::invalid("morph_weights", place, detail));
    }
    weights.iter().map(|weight| super::number::finite(*weight, &place).map(f64::from)).collect()
}

fn transform(node: &schema::Node, place: &str, warnings: &mut Warnings) -> Result<DAffine3, SceneError> {
    let parts = [
        ("translation", node.translation.is_some()),
        ("rotation", node.rotation.is_some()),
        ("scale", node.scale.is_some()),
    ];
    if let Some(matrix) = &node.matrix {
        if let Some((name, _)) = parts.iter().find(|(_, present)| *present) {
            let detail = "the node has a `matrix` too, which is used; this is ignored";
            warnings.add("transform_ambiguous", format!("{place}/{name}"), detail);
        }
        return affine(matrix, &format!("{place}/matrix"));
    }
    let vector = |value: Option<[f64; 3]>, default: DVec3, name: &str| {
        let vector = value.map_or(default, DVec3::from);
        if vector.as_vec3().is_finite() { Ok(vector) } else { Err(not_finite(&format!("{place}/{name}"), vector)) }
    };
    let translation = vector(node.translation, DVec3::ZERO, "translation")?;
    let scale = vector(node.scale, DVec3::ONE, "scale")?;
    let rotation = DQuat::from_array(node.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]));
    let length = rotation.length();
    if !length.is_finite() || length < 1e-6 {
        let detail = format!("the quaternion {rotation} has no direction; write a unit quaternion (x, y, z, w)");
        return Err(SceneError::invalid("rotation", format!("{place}/rotation"), detail));
    }
    Ok(DAffine3::from_scale_rotation_translation(scale, rotation / length, translation))
}

pub(super) fn affine(elements: &[f64; 16], place: &str) -> Result<DAffine3, SceneError> {
    let matrix = DMat4::from_cols_array(elements);
    if !matrix.as_mat4().is_finite() {
        return Err(not_finite(place, matrix));
    }
    let bottom = matrix.row(3);
    if bottom.abs_diff_eq(glam::DVec4::W, 1e-5) {
        return Ok(DAffine3::from_mat4(matrix));
    }
    let detail = format!("the bottom row is {bottom}, but must be (0, 0, 0, 1); elements are stored column by column");
    Err(SceneError::invalid("matrix", place, detail))
}

/// Whether each node has a parent; it may have one only.
fn check_parents(nodes: &[Node]) -> Result<Vec<bool>, SceneError> {
    let mut has_parent = vec![false; nodes.len()];
    for (index, node) in nodes.iter().enumerate() {
        for (ordinal, child) in node.children.iter().enumerate() {
            let Some(taken) = has_parent.get_mut(*child) else { continue };
            if std::mem::replace(taken, true) {
                let detail =
                    format!("node {child} is already a child of a node; instance its mesh with another node instead");
                return Err(SceneError::invalid("node_parents", format!("/nodes/{index}/children/{ordinal}"), detail));
            }
        }
    }
    Ok(has_parent)
}

/// Which nodes are below `tops` (each node having one parent at most), with depth and placement checked.
fn walk(nodes: &[Node], tops: &[usize], limits: &Limits) -> Result<Vec<bool>, SceneError> {
    let mut visited = vec![false; nodes.len()];
    let mut stack: Vec<(usize, usize, DAffine3)> = tops.iter().map(|top| (*top, 1, DAffine3::IDENTITY)).collect();
    while let Some((index, depth, parent)) = stack.pop() {
        let Some(node) = nodes.get(index) else { continue };
        let place = || format!("/nodes/{index}");
        if depth > limits.node_depth {
            let detail =
                format!("the node lies deeper than the limit of {} levels; flatten the hierarchy", limits.node_depth);
            return Err(SceneError::too_large("node_depth", place(), detail));
        }
        let world = parent * node.local;
        if !world.matrix3.as_mat3().is_finite() || !world.translation.as_vec3().is_finite() {
            return Err(not_finite(&place(), "the product of the transforms down to here"));
        }
        if let Some(visited) = visited.get_mut(index) {
            *visited = true;
        }
        stack.extend(node.children.iter().map(|child| (*child, depth + 1, world)));
    }
    Ok(visited)
}

fn scenes(
    root: &Root,
    has_parent: &[bool],
    tops: Vec<usize>,
    warnings: &mut Warnings,
) -> Result<Vec<SceneRoot>, SceneError> {
    for (index, scene) in root.scenes.iter().enumerate() {
        let mut seen = std::collections::HashSet::new();
        for (ordinal, node) in scene.nodes.iter().enumerate() {
            let detail = if has_parent.get(*node).copied().unwrap_or(false) {
                "is a child of another node; a scene lists root nodes only"
            } else if !seen.insert(node) {
                "is listed twice"
            } else {
                continue;
            };
            let place = format!("/scenes/{index}/nodes/{ordinal}");
            return Err(SceneError::invalid("scene_nodes", place, format!("node {node} {detail}")));
        }
    }
    if root.scenes.is_empty() && !tops.is_empty() {
        warnings.add("no_scene", "/scenes", "the file has no scene; all its root nodes are drawn");
        return Ok(vec![SceneRoot { name: None, nodes: tops }]);
    }
    let scenes = root.scenes.iter();
    Ok(scenes.map(|scene| SceneRoot { name: scene.name.clone(), nodes: scene.nodes.clone() }).collect())
}

#[cfg(test)]
mod tests {
    use crate::scene::import::testing::{error, gltf, scene};
    use crate::scene::{Limits, import};
    use glam::DVec3;
    use serde_json::{Value, json};

    #[test]
    fn transforms_keep_double_precision_and_mirrors() {
        let far = 6_378_137.123_456_789;
        let scene = scene(&gltf(json!({"nodes": [
            {"translation": [far, 0, 0], "rotation": [0, 0, 2, 2], "scale": [1, -1, 1]},
            {"matrix": [0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 4, 5, 6, 1]},
        ]})));
        let local = scene.nodes[0].local;
        assert_eq!(local.translation.x, far);
        assert!(local.transform_vector3(DVec3::X).abs_diff_eq(DVec3::Y, 1e-12), "a quarter turn, normalised");
        assert!(local.matrix3.determinant() < 0.0);
        let local = scene.nodes[1].local;
        assert_eq!(local.transform_point3(DVec3::X), DVec3::new(4.0, 6.0, 6.0));
        assert_eq!(scene.scenes[0].nodes, [0, 1], "without scenes all roots are drawn");
        assert_eq!(scene.warnings[0].code, "no_scene");
    }

    #[test]
    fn broken_hierarchies_are_refused() {
        let place = |json: Value| {
            let fault = error(&gltf(json));
            (fault.code, fault.pointer)
        };
        assert_eq!(place(json!({"nodes": [{"children": [0]}]})), ("node_cycle", "/nodes/0".into()));
        assert_eq!(
            place(json!({"nodes": [{}, {"children": [2]}, {"children": [1]}]})),
            ("node_cycle", "/nodes/1".into())
        );
        assert_eq!(
            place(json!({"nodes": [{"children": [2]}, {"children": [2]}, {}]})),
            ("node_parents", "/nodes/1/children/0".into())
        );
        assert_eq!(
            place(json!({"nodes": [{"children": [1]}, {}], "scenes": [{"nodes": [1]}]})),
            ("scene_nodes", "/scenes/0/nodes/0".into())
        );
        assert_eq!(
            place(json!({"nodes": [{}], "scenes": [{"nodes": [0, 0]}]})),
            ("scene_nodes", "/scenes/0/nodes/1".into())
        );
        assert_eq!(place(json!({"nodes": [{"rotation": [0, 0, 0, 0]}]})), ("rotation", "/nodes/0/rotation".into()));
        assert_eq!(place(json!({"nodes": [{"scale": [1e39, 1, 1]}]})), ("not_finite", "/nodes/0/scale".into()));
        assert_eq!(
            place(json!({"nodes": [{"scale": [1e30, 1, 1], "children": [1]}, {"scale": [1e30, 1, 1]}]})),
            ("not_finite", "/nodes/1".into())
        );
        let projective = [1, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];
        assert_eq!(place(json!({"nodes": [{"matrix": projective}]})), ("matrix", "/nodes/0/matrix".into()));
    }

    #[test]
    fn a_deep_chain_neither_overflows_nor_passes() {
        let chain = |length: usize| {
            let nodes: Vec<Value> =
                (1..=length).map(|i| if i < length { json!({"children": [i]}) } else { json!({}) }).collect();
            gltf(json!({ "nodes": nodes }))
        };
        assert_eq!(scene(&chain(1000)).nodes.len(), 1000);
        assert_eq!(error(&chain(1001)).code, "node_depth");
        let limits = Limits { node_depth: usize::MAX, ..Limits::default() };
        assert!(import(&chain(100_000), &limits).is_ok());
    }
}
