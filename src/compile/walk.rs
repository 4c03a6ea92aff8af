//! Which scene of the file a picture shows, and where its nodes are in the world.

use super::CompileError;
use crate::params::FieldError;
use crate::scene::{Placed, Scene, SceneError, SceneErrorKind};

/// The scene to draw: by index, else the file's default, else its first.
pub fn chosen_scene(scene: &Scene, index: Option<usize>) -> Result<usize, CompileError> {
    if scene.scenes.is_empty() {
        return Err(
            invalid("no_scene", "/scenes", "the file has no scene; add one that lists the nodes to draw").into()
        );
    }
    let chosen = index.or(scene.default_scene).unwrap_or(0);
    if chosen < scene.scenes.len() {
        return Ok(chosen);
    }
    let last = scene.scenes.len() - 1;
    let detail = format!("there is no scene {chosen}; this file has scenes 0 to {last}");
    Err(CompileError::Params(FieldError { pointer: "/params/scene".into(), detail }))
}

/// All nodes of the chosen scene, parents before children, in the order of the file's lists.
pub(super) fn placed_nodes(scene: &Scene, index: Option<usize>) -> Result<Vec<Placed>, CompileError> {
    Ok(scene.placed(chosen_scene(scene, index)?))
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
