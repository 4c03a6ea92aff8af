//! Scenes that carry what their picture does not show, for benchmarks of leaving it out.

use super::glb::Glb;
use super::materials::{lamp, surface, textured};
use super::shapes::Shape;
use super::studies::bumps;
use super::textures;
use glam::Vec3;
use serde_json::{Value, json};

/// Something of no effect on the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Burden {
    /// Eight different textures of 2048 x 2048 texels.
    Textures,
    /// A mesh of 1,002,528 triangles.
    Mesh,
    /// Two sets of texture coordinates of 79,526 vertices.
    Coordinates,
    /// 1,000 different materials.
    Materials,
    /// As many triangles again, of no area.
    FlatTriangles,
}

/// What a file does with a [`Burden`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Use {
    /// It is not in the file.
    Absent,
    /// It is in the file, and no picture of the default scene needs it.
    Unused,
    /// It has to be compiled, though nothing of it is seen.
    Used,
}

/// A bumpy sphere with a burden inside, or on it.
pub fn burdened(burden: Burden, use_: Use) -> Vec<u8> {
    let mut glb = Glb::new();
    match burden {
        Burden::Coordinates => coordinates(&mut glb, use_),
        Burden::FlatTriangles => glb.show(&seams(bumps(141), use_), surface([0.8; 3], 0.0, 1.0)),
        Burden::Textures | Burden::Mesh | Burden::Materials => {
            glb.show(&bumps(141), surface([0.8; 3], 0.0, 1.0));
            inside(&mut glb, burden, use_);
        }
    }
    glb.camera("front", Vec3::new(0.0, 0.0, 4.2), Vec3::ZERO, 32.0);
    glb.finish()
}

/// Meshes in the middle of the sphere, shown or in another scene of the file.
fn inside(glb: &mut Glb, burden: Burden, use_: Use) {
    if use_ == Use::Absent {
        return;
    }
    let shape = if burden == Burden::Mesh { bumps(354) } else { Shape::patch(Vec3::ZERO, Vec3::X, Vec3::Y) };
    let geometry = glb.geometry(&shape);
    for material in hidden_materials(glb, burden) {
        let material = glb.material(material);
        let mesh = glb.mesh(&geometry, material);
        let placement = json!({"scale": [0.1, 0.1, 0.1]});
        match use_ {
            Use::Used => glb.place(mesh, placement),
            _ => glb.place_elsewhere(mesh, placement),
        }
    }
}

fn hidden_materials(glb: &mut Glb, burden: Burden) -> Vec<Value> {
    match burden {
        Burden::Textures => (0..8)
            .map(|salt| {
                let color = |u: f32, v: f32| textures::noise(glam::Vec2::new(u + salt as f32, v) * 300.0);
                let texture = glb.texture(&textures::png(2048, |u, v| [color(u, v), u, v, 1.0]));
                textured(texture, 0.0, 1.0)
            })
            .collect(),
        Burden::Materials => (0..1000).map(|index| surface([index as f32 / 1000.0, 0.5, 0.5], 0.0, 1.0)).collect(),
        _ => vec![surface([0.5; 3], 0.0, 1.0)],
    }
}

/// Texture coordinates that no material reads, or that two white textures read.
fn coordinates(glb: &mut Glb, use_: Use) {
    let mut shape = bumps(141);
    if use_ != Use::Absent {
        shape.uvs = shape.normals.iter().map(|normal| normal.truncate()).collect();
    }
    let mut material = surface([0.8; 3], 0.0, 1.0);
    if use_ == Use::Used {
        let white = glb.texture(&textures::png(1, |_, _| [1.0; 4]));
        material["pbrMetallicRoughness"]["baseColorTexture"] = json!({"index": white});
        material["pbrMetallicRoughness"]["metallicRoughnessTexture"] = json!({"index": white, "texCoord": 1});
    }
    let mut geometry = glb.geometry(&shape);
    if use_ != Use::Absent {
        geometry.repeat_coordinates();
    }
    let material = glb.material(material);
    let mesh = glb.mesh(&geometry, material);
    glb.place(mesh, json!({}));
}

/// Adds to each triangle one along its first edge: of no area, or (if used) of so little that it is never seen.
fn seams(mut shape: Shape, use_: Use) -> Shape {
    for [a, b, _] in shape.triangles.clone() {
        match use_ {
            Use::Absent => {}
            Use::Unused => shape.triangles.push([a, b, b]),
            Use::Used => {
                let [p, q] = [a, b].map(|index| shape.positions[index as usize]);
                shape.positions.push((p + q) * 0.5 * (1.0 - 1e-5));
                shape.normals.push(shape.normals[a as usize]);
                shape.triangles.push([a, b, shape.positions.len() as u32 - 1]);
            }
        }
    }
    shape
}

/// A room without an opening, with a lamp in it and the camera.
pub fn closed_room() -> Vec<u8> {
    let mut glb = Glb::new();
    let [x, y, z] = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| axis * 2.0);
    let sides = [
        ([-1.0, 0.0, 1.0], x, -z),
        ([-1.0, 2.0, -1.0], x, z),
        ([-1.0, 0.0, -1.0], x, y),
        ([1.0, 0.0, 1.0], -x, y),
        ([-1.0, 0.0, 1.0], -z, y),
        ([1.0, 0.0, -1.0], z, y),
    ];
    for (corner, across, along) in sides {
        glb.show(&Shape::patch(Vec3::from_array(corner), across, along), surface([0.7, 0.65, 0.6], 0.0, 1.0));
    }
    glb.show(&Shape::panel(Vec3::new(0.0, 1.9, 0.0), Vec3::ZERO, 0.6, 0.6), lamp([1.0; 3], 12.0));
    let ball = Shape::sphere(0.4, 96).placed(Vec3::new(0.2, 0.4, -0.3), [0.0; 3], 1.0);
    glb.show(&ball, surface([0.9, 0.6, 0.3], 1.0, 0.3));
    glb.camera("inside", Vec3::new(-0.3, 1.1, 0.9), Vec3::new(0.1, 0.6, -0.4), 60.0);
    glb.finish()
}
