//! Which nodes of the file a picture shows, and where they are in the world.

use super::CompileError;
use crate::params::FieldError;
use crate::scene::{Scene, SceneError, SceneErrorKind, SceneRoot};
use glam::DAffine3;

/// A node of the chosen scene.
#[derive(Debug, Clone, Copy)]
pub struct Placed {
    /// Index into [`Scene::nodes`].
    pub node: usize,
    /// Node to world.
    pub world: DAffine3,
}

/// The scene to draw: by index, else the file's default, else its first.
pub fn chosen_scene(scene: &Scene, index: Option<usize>) -> Result<&SceneRoot, CompileError> {
    if scene.scenes.is_empty() {
        return Err(
            invalid("no_scene", "/scenes", "the file has no scene; add one that lists the nodes to draw").into()
        );
    }
    let chosen = index.or(scene.default_scene).unwrap_or(0);
    scene.scenes.get(chosen).ok_or_else(|| {
        let last = scene.scenes.len() - 1;
        let detail = format!("there is no scene {chosen}; this file has scenes 0 to {last}");
        CompileError::Params(FieldError { pointer: "/params/scene".into(), detail })
    })
}

/// All nodes of the chosen scene, parents before children, in the order of the file's lists.
pub(super) fn placed_nodes(scene: &Scene, index: Option<usize>) -> Result<Vec<Placed>, CompileError> {
    let root = chosen_scene(scene, index)?;
    let mut seen = vec![false; scene.nodes.len()];
    let mut placed = Vec::new();
    let mut open: Vec<(usize, DAffine3)> = root.nodes.iter().rev().map(|n| (*n, DAffine3::IDENTITY)).collect();
    while let Some((index, parent)) = open.pop() {
        let (Some(node), Some(seen)) = (scene.nodes.get(index), seen.get_mut(index)) else {
            return Err(invalid("node_out_of_range", &format!("/nodes/{index}"), "the file has no such node").into());
        };
        if std::mem::replace(seen, true) {
            let detail = "the node is reached twice; nodes must form a tree";
            return Err(invalid("nodes_not_a_tree", &format!("/nodes/{index}"), detail).into());
        }
        let world = parent * node.local;
        placed.push(Placed { node: index, world });
        open.extend(node.children.iter().rev().map(|child| (*child, world)));
    }
    Ok(placed)
}

/// The nodes of the chosen scene that hold a camera, in the order that `camera.index` counts.
pub fn camera_nodes(scene: &Scene, index: Option<usize>) -> Result<Vec<Placed>, CompileError> {
    let mut nodes = placed_nodes(scene, index)?;
    nodes.retain(|placed| scene.nodes[placed.node].camera.is_some_and(|camera| camera < scene.cameras.len()));
    Ok(nodes)
}

/// A [`SceneError`] of kind `Invalid`.
pub(super) fn invalid(code: &'static str, pointer: &str, detail: &str) -> SceneError {
    SceneError { kind: SceneErrorKind::Invalid, code, pointer: pointer.into(), detail: detail.into() }
}
