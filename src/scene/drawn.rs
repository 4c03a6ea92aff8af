//! Where the nodes of a scene stand, and what they draw there.

use super::deform::{self, Joints};
use super::{Mesh, Node, Scene, SceneError};
use glam::DAffine3;
use std::borrow::Cow;
use std::cell::LazyCell;
use std::collections::BTreeMap;

/// A node of a scene.
#[derive(Debug, Clone, Copy)]
pub struct Placed {
    /// Index into [`Scene::nodes`].
    pub node: usize,
    /// Node to world.
    pub world: DAffine3,
}

/// A mesh with its vertices where they are, and the places at which it is drawn.
#[derive(Debug)]
pub struct Drawn<'a> {
    /// Of the file, or one that a skin or morph targets have moved.
    pub mesh: Cow<'a, Mesh>,
    /// Object to world.
    pub worlds: Vec<DAffine3>,
}

impl Scene {
    /// Nodes of scene `index`, parents before children, in the order of the file's lists; empty if there is no such scene.
    pub fn placed(&self, index: usize) -> Vec<Placed> {
        self.below(self.scenes.get(index).map_or(&[], |scene| &scene.nodes))
    }

    /// The nodes below `roots`. A node is placed once, even in a scene that no file could have.
    fn below(&self, roots: &[usize]) -> Vec<Placed> {
        let mut seen = vec![false; self.nodes.len()];
        let mut open: Vec<(usize, DAffine3)> = roots.iter().rev().map(|root| (*root, DAffine3::IDENTITY)).collect();
        let mut placed = Vec::new();
        while let Some((index, parent)) = open.pop() {
            let (Some(node), Some(seen)) = (self.nodes.get(index), seen.get_mut(index)) else { continue };
            if std::mem::replace(seen, true) {
                continue;
            }
            let world = parent * node.local;
            placed.push(Placed { node: index, world });
            open.extend(node.children.iter().rev().map(|child| (*child, world)));
        }
        placed
    }

    /// The world transforms of all nodes, those that no scene has included: joints need be in none.
    fn worlds(&self) -> Vec<DAffine3> {
        let mut is_root = vec![true; self.nodes.len()];
        for child in self.nodes.iter().flat_map(|node| &node.children) {
            if let Some(is_root) = is_root.get_mut(*child) {
                *is_root = false;
            }
        }
        let roots: Vec<usize> = (0..self.nodes.len()).filter(|node| is_root[*node]).collect();
        let mut worlds = vec![DAffine3::IDENTITY; self.nodes.len()];
        for placed in self.below(&roots) {
            worlds[placed.node] = placed.world;
        }
        worlds
    }

    /// What scene `index` draws: meshes of the file in its order, then those that skins and morph targets move.
    ///
    /// # Errors
    /// A vertex is moved beyond all numbers.
    pub fn drawn(&self, index: usize) -> Result<Vec<Drawn<'_>>, SceneError> {
        let worlds = LazyCell::new(|| self.worlds());
        let mut rigid: BTreeMap<usize, Vec<DAffine3>> = BTreeMap::new();
        let mut moved = Vec::new();
        for placed in self.placed(index) {
            let Some(node) = self.nodes.get(placed.node) else { continue };
            let Some((at, mesh)) = node.mesh.and_then(|at| Some((at, self.meshes.get(at)?))) else { continue };
            let skin = node.skin.and_then(|skin| self.skins.get(skin)).filter(|_| mesh.is_skinned());
            let place = || format!("/nodes/{}", placed.node);
            if let Some(skin) = skin {
                let joints = Joints::new(skin, &worlds, placed.world);
                let (mesh, world) = deform::skinned(mesh, &node.weights, &joints).ok_or_else(|| beyond(place()))?;
                moved.push(Drawn { mesh: Cow::Owned(mesh), worlds: vec![world] });
            } else if mesh.is_morphed(&node.weights) {
                let mesh = deform::morphed(mesh, &node.weights).ok_or_else(|| beyond(place()))?;
                moved.push(Drawn { mesh: Cow::Owned(mesh), worlds: copies(node, &placed.world) });
            } else {
                rigid.entry(at).or_default().append(&mut copies(node, &placed.world));
            }
        }
        let rigid = rigid.into_iter().filter_map(|(at, worlds)| {
            self.meshes.get(at).map(|mesh| Drawn { mesh: Cow::Borrowed(mesh), worlds })
        });
        Ok(rigid.chain(moved).collect())
    }
}

/// Where a node draws its mesh: at its own place, or at those of EXT_mesh_gpu_instancing relative to it.
fn copies(node: &Node, world: &DAffine3) -> Vec<DAffine3> {
    node.instances.as_ref().map_or_else(|| vec![*world], |list| list.iter().map(|place| *world * *place).collect())
}

fn beyond(place: String) -> SceneError {
    let detail = "its skin or morph targets move vertices beyond single precision: are the weights and the joints' transforms \
                  right? export the file again, or render another time";
    SceneError::invalid("pose_not_finite", place, detail)
}
