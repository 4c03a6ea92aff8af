//! Where the nodes of a scene stand, and what they draw there.

use super::deform::{self, Joints};
use super::{Mesh, Node, Primitive, Scene, SceneError, SceneErrorKind};
use glam::DAffine3;
use std::borrow::Cow;
use std::cell::LazyCell;
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::sync::Arc;

/// Most copies of meshes that move, times the moments at which they are looked at.
const MOST_COPIES: usize = 1 << 22;

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
        let mut sorted = Sorted::default();
        for placed in self.placed(index) {
            if let Some(piece) = self.piece(&placed, &|| &worlds)? {
                sorted.add(piece);
            }
        }
        Ok(sorted.into_drawn())
    }

    /// What a node draws; `worlds` are those of all nodes.
    fn piece<'w>(&self, placed: &Placed, worlds: &dyn Fn() -> &'w [DAffine3]) -> Result<Option<Piece<'_>>, SceneError> {
        let Some(node) = self.nodes.get(placed.node) else { return Ok(None) };
        let Some((at, mesh)) = node.mesh.and_then(|at| Some((at, self.meshes.get(at)?))) else { return Ok(None) };
        let skin = node.skin.and_then(|skin| self.skins.get(skin)).filter(|_| mesh.is_skinned());
        let place = || format!("/nodes/{}", placed.node);
        let piece = |file, mesh, worlds| Ok(Some(Piece { file, drawn: Drawn { mesh, worlds } }));
        if let Some(skin) = skin {
            let joints = Joints::new(skin, worlds(), placed.world);
            let (mesh, world) = deform::skinned(mesh, &node.weights, &joints).ok_or_else(|| beyond(place()))?;
            piece(None, Cow::Owned(mesh), vec![world])
        } else if mesh.is_morphed(&node.weights) {
            let mesh = deform::morphed(mesh, &node.weights).ok_or_else(|| beyond(place()))?;
            piece(None, Cow::Owned(mesh), copies(node, &placed.world))
        } else {
            piece(Some(at), Cow::Borrowed(mesh), copies(node, &placed.world))
        }
    }
}

/// What a node draws.
struct Piece<'a> {
    /// Index into [`Scene::meshes`] of a mesh whose vertices nothing moves.
    file: Option<usize>,
    drawn: Drawn<'a>,
}

/// Pieces by mesh.
#[derive(Default)]
struct Sorted<'a> {
    rigid: BTreeMap<usize, Drawn<'a>>,
    deformed: Vec<Drawn<'a>>,
}

impl<'a> Sorted<'a> {
    fn add(&mut self, piece: Piece<'a>) {
        let Piece { file, mut drawn } = piece;
        match file.map(|file| self.rigid.entry(file)) {
            None => self.deformed.push(drawn),
            Some(Entry::Vacant(entry)) => _ = entry.insert(drawn),
            Some(Entry::Occupied(mut entry)) => entry.get_mut().worlds.append(&mut drawn.worlds),
        }
    }

    /// Meshes of the file in its order, then those that skins and morph targets move.
    fn into_drawn(self) -> Vec<Drawn<'a>> {
        self.rigid.into_values().chain(self.deformed).collect()
    }
}

/// What a scene draws while time passes.
#[derive(Debug, Default)]
pub struct DrawnOver<'a> {
    /// What stays as it is.
    pub still: Vec<Drawn<'a>>,
    /// What does not.
    pub moving: Vec<Moving<'a>>,
}

/// A mesh at one place, at each of several moments: the same triangles over vertices that move.
#[derive(Debug)]
pub struct Moving<'a> {
    /// By moment the mesh, and object to world.
    pub steps: Vec<(Arc<Cow<'a, Mesh>>, DAffine3)>,
}

impl<'a> DrawnOver<'a> {
    /// What scene `index` draws at several moments; `poses` are copies of one scene by [`Scene::at`].
    ///
    /// # Errors
    /// A vertex is moved beyond all numbers.
    pub fn new(poses: &'a [Scene], index: usize) -> Result<Self, SceneError> {
        let places: Vec<Vec<Placed>> = poses.iter().map(|pose| pose.placed(index)).collect();
        let worlds: Vec<_> = poses.iter().map(|pose| LazyCell::new(|| pose.worlds())).collect();
        let (mut sorted, mut moving) = (Sorted::default(), Vec::new());
        for node in 0..places.first().map_or(0, Vec::len) {
            let at = |((pose, places), worlds): ((&'a Scene, &Vec<Placed>), &LazyCell<Vec<DAffine3>, _>)| {
                places.get(node).map_or(Ok(None), |placed| pose.piece(placed, &|| worlds))
            };
            let pieces: Option<Vec<Piece<'a>>> =
                poses.iter().zip(&places).zip(&worlds).map(at).collect::<Result<_, SceneError>>()?;
            let Some(mut pieces) = pieces else { continue };
            if pieces.windows(2).all(|pair| stands_still(&pair[0].drawn, &pair[1].drawn)) {
                pieces.drain(..).take(1).for_each(|piece| sorted.add(piece));
            } else {
                let copies = pieces.iter().map(|piece| piece.drawn.worlds.len()).max().unwrap_or(0);
                check_copies((moving.len() + copies) * poses.len())?;
                moving.extend(over_time(pieces));
            }
        }
        Ok(Self { still: sorted.into_drawn(), moving })
    }
}

/// Whether nothing has moved from one moment to the next.
fn stands_still(before: &Drawn, after: &Drawn) -> bool {
    let same_shape = |before: &Mesh, after: &Mesh| {
        let same = |(before, after): (&Primitive, &Primitive)| {
            before.positions == after.positions && before.normals == after.normals && before.tangents == after.tangents
        };
        before.primitives.iter().zip(&after.primitives).all(same)
    };
    let same_mesh = match (&before.mesh, &after.mesh) {
        (Cow::Borrowed(before), Cow::Borrowed(after)) if std::ptr::eq(*before, *after) => true,
        (before, after) => same_shape(before, after),
    };
    same_mesh && before.worlds == after.worlds
}

/// Refuses more copies of meshes over time than could be stored.
fn check_copies(copies: usize) -> Result<(), SceneError> {
    if copies <= MOST_COPIES {
        return Ok(());
    }
    let detail = format!(
        "the scene has {copies} copies of meshes that move while the shutter is open, each moment counted; at most {MOST_COPIES} are \
         supported: give the shutter fewer steps, or leave it out"
    );
    let (kind, pointer) = (SceneErrorKind::TooLarge, "/nodes".into());
    Err(SceneError { kind, code: "scene_too_large", pointer, detail })
}

/// Each of a node's copies over time.
fn over_time(pieces: Vec<Piece<'_>>) -> Vec<Moving<'_>> {
    let copies = pieces.iter().map(|piece| piece.drawn.worlds.len()).min().unwrap_or(0);
    let steps: Vec<_> = pieces.into_iter().map(|piece| (Arc::new(piece.drawn.mesh), piece.drawn.worlds)).collect();
    let copy = |copy: usize| steps.iter().map(|(mesh, worlds)| (Arc::clone(mesh), worlds[copy])).collect();
    (0..copies).map(|index| Moving { steps: copy(index) }).collect()
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

#[cfg(test)]
mod tests {
    use super::{DrawnOver, MOST_COPIES, check_copies};
    use crate::scene::import::testing::{Builder, scene_of};
    use crate::scene::{Drawn, Moment, Scene};
    use glam::{DAffine3, DQuat, DVec3, Vec3};
    use serde_json::{Value, json};
    use std::f64::consts::FRAC_PI_2;

    /// A triangle with normals in the plane's direction, and whatever `json` adds.
    fn triangle(parts: Value) -> Builder {
        let mut builder = Builder::triangle();
        builder.attribute("NORMAL", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0], "VEC3");
        let Value::Object(parts) = parts else { return builder };
        for (name, value) in parts {
            builder.json[name] = value;
        }
        builder
    }

    /// Two joints: the first vertex follows the first, the second the second, the third both by half.
    fn skinned(nodes: &Value, scale: f32) -> Builder {
        let mut builder = triangle(json!({"nodes": nodes}));
        let weight = |x: f32| x * scale;
        let joints = builder.view(&[0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0]);
        let accessor = json!({"bufferView": joints, "componentType": 5121, "count": 3, "type": "VEC4"});
        let accessors = builder.json["accessors"].as_array_mut().unwrap();
        accessors.push(accessor);
        let joints = accessors.len() - 1;
        builder.json["meshes"][0]["primitives"][0]["attributes"]["JOINTS_0"] = json!(joints);
        let weights = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.5, 0.5, 0.0, 0.0].map(weight);
        builder.attribute("WEIGHTS_0", &weights, "VEC4");
        builder.json["scenes"] = json!([{"nodes": [0]}]);
        builder.json["skins"] = json!([{"joints": [1, 2]}]);
        builder
    }

    fn only<'a>(drawn: &'a [Drawn<'_>]) -> (Vec<DVec3>, &'a Drawn<'a>) {
        assert_eq!((drawn.len(), drawn[0].worlds.len()), (1, 1));
        let at = |p: &Vec3| drawn[0].worlds[0].transform_point3(p.as_dvec3());
        (drawn[0].mesh.primitives[0].positions.iter().map(at).collect(), &drawn[0])
    }

    fn assert_near(found: &[DVec3], expected: [DVec3; 3], tolerance: f64) {
        for (found, expected) in found.iter().zip(expected) {
            assert!(found.abs_diff_eq(expected, tolerance), "{found} is not {expected}");
        }
    }

    #[test]
    fn joints_move_vertices_and_the_node_does_not() {
        let far = 1e7;
        let nodes = json!([{"mesh": 0, "skin": 0, "translation": [99, 99, 99]}, {"translation": [far, 0, 0]},
            {"translation": [far, 0, 2], "scale": [1, 3, 1]}]);
        for scale in [1.0, 4.0] {
            let scene = scene_of(&skinned(&nodes, scale));
            assert_eq!(scene.warnings.iter().any(|warning| warning.code == "skin_weights"), scale != 1.0);
            let drawn = scene.drawn(0).unwrap();
            let (positions, drawn) = only(&drawn);
            let third = DVec3::new(far, 0.5 * (1.0 + 3.0), 1.0);
            assert_near(&positions, [DVec3::new(far, 0.0, 0.0), DVec3::new(far + 1.0, 0.0, 2.0), third], 1e-7);
            // The third is moved by a shear: x, 2y, z + 1/2 of 2.
            assert_eq!(drawn.mesh.primitives[0].normals.as_ref().unwrap()[2], Vec3::Z);
        }
    }

    #[test]
    fn normals_stay_upright_and_mirrored_skins_keep_their_front() {
        let turn = DQuat::from_rotation_y(0.7).to_array();
        let joint = json!({"rotation": turn, "scale": [0.2, 3, -5]});
        let scene = scene_of(&skinned(&json!([{"mesh": 0, "skin": 0}, joint, joint]), 1.0));
        let drawn = scene.drawn(0).unwrap();
        let (positions, drawn) = only(&drawn);
        let primitive = &drawn.mesh.primitives[0];
        let edges = [positions[1] - positions[0], positions[2] - positions[0]];
        let normal = primitive.normals.as_ref().unwrap()[0].as_dvec3();
        assert!(edges.iter().all(|edge| edge.dot(normal).abs() < 1e-6));
        // Object +z is the front: it is where the joint's map sends it.
        let map =
            DAffine3::from_scale_rotation_translation(DVec3::new(0.2, 3.0, -5.0), DQuat::from_array(turn), DVec3::ZERO);
        assert!(normal.dot(map.transform_vector3(DVec3::Z)) > 0.0);
        let [a, b, c] = primitive.triangles[0].map(|vertex| positions[vertex as usize]);
        assert!((b - a).cross(c - a).dot(normal) > 0.0, "counter-clockwise about the normal");
    }

    /// A triangle whose third vertex a target lifts by 2, with a child that has a camera, both animated.
    fn animated() -> Scene {
        let mut builder = triangle(json!({"nodes": [{"mesh": 0, "children": [1]}, {"camera": 0}]}));
        builder.json["cameras"] = json!([{"type": "perspective", "perspective": {"yfov": 1, "znear": 1}}]);
        let lift = builder.accessor(&[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0], "VEC3");
        let tilt = builder.accessor(&[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, -1.0], "VEC3");
        builder.json["meshes"][0]["primitives"][0]["targets"] = json!([{"POSITION": lift}, {"NORMAL": tilt}]);
        let times = builder.accessor(&[1.0, 3.0], "SCALAR");
        let weights = builder.accessor(&[0.0, 0.0, 1.0, 0.5], "SCALAR");
        let s = FRAC_PI_2.sin() as f32 * std::f32::consts::FRAC_1_SQRT_2;
        let turn = builder.accessor(&[0.0, 0.0, 0.0, 1.0, 0.0, s, 0.0, s], "VEC4");
        let shift = builder.accessor(&[0.0, 0.0, 0.0, 0.0, 4.0, 0.0], "VEC3");
        let sampler = |output| json!({"input": times, "output": output});
        let channel = |sampler, node, path| json!({"sampler": sampler, "target": {"node": node, "path": path}});
        builder.json["animations"] = json!([
            {"name": "all", "samplers": [sampler(weights), sampler(turn)],
                "channels": [channel(0, 0, "weights"), channel(1, 0, "rotation")]},
            {"name": "camera", "samplers": [sampler(shift)], "channels": [channel(0, 1, "translation")]},
        ]);
        scene_of(&builder)
    }

    #[test]
    fn what_moves_is_told_from_what_stands_still() {
        let scene = animated();
        let poses = |animation| -> Vec<Scene> {
            [1.0, 2.0, 3.0].map(|time| scene.at(Some(Moment { animation, time }))).to_vec()
        };
        let (turning, resting) = (poses(0), poses(1));
        let drawn = DrawnOver::new(&turning, 0).unwrap();
        assert_eq!((drawn.still.len(), drawn.moving.len()), (0, 1));
        // As each pose by itself.
        for (pose, (mesh, world)) in turning.iter().zip(&drawn.moving[0].steps) {
            let alone = pose.drawn(0).unwrap();
            let moved: Vec<DVec3> =
                mesh.primitives[0].positions.iter().map(|p| world.transform_point3(p.as_dvec3())).collect();
            assert_eq!(moved, only(&alone).0);
        }
        let drawn = DrawnOver::new(&resting, 0).unwrap();
        assert_eq!((drawn.still.len(), drawn.moving.len()), (1, 0), "the camera alone moves");
        assert_eq!(drawn.still[0].worlds, resting[0].drawn(0).unwrap()[0].worlds);
    }

    #[test]
    fn too_many_copies_are_refused() {
        assert!(check_copies(MOST_COPIES).is_ok());
        assert_eq!(check_copies(MOST_COPIES + 1).unwrap_err().code, "scene_too_large");
    }

    #[test]
    fn a_scene_stands_as_its_animation_says() {
        let scene = animated();
        assert_eq!(scene.warnings.iter().map(|warning| warning.code).collect::<Vec<_>>(), [] as [&str; 0]);
        assert_eq!(
            scene.animations.iter().map(|a| (a.span, a.moves_meshes)).collect::<Vec<_>>(),
            [([1.0, 3.0], true), ([1.0, 3.0], false)]
        );
        let at = |animation, time| scene.at(Some(Moment { animation, time }));
        let base = [DVec3::ZERO, DVec3::X, DVec3::Y];
        for rest in [scene.at(None), at(0, 0.5), at(1, 9.0)] {
            assert_near(&only(&rest.drawn(0).unwrap()).0, base, 0.0);
        }
        // Half way: the weights are (1/2, 1/4), the node has turned by an eighth.
        let half = at(0, 2.0);
        let turn = DQuat::from_rotation_y(FRAC_PI_2 / 2.0);
        let drawn = half.drawn(0).unwrap();
        let (positions, moved) = only(&drawn);
        assert_near(&positions, [DVec3::ZERO, turn * DVec3::X, turn * DVec3::new(0.0, 1.0, 1.0)], 1e-6);
        let normal = DVec3::new(0.0, 0.25, 0.75).normalize().as_vec3();
        assert!(moved.mesh.primitives[0].normals.as_ref().unwrap()[2].abs_diff_eq(normal, 1e-6));
        let camera = at(1, 2.0).placed(0)[1].world.translation;
        assert_eq!((camera, half.placed(0)[1].world.translation), (DVec3::new(0.0, 2.0, 0.0), DVec3::ZERO));
    }
}
