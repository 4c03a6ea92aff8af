//! Tests of the room, on scenes made by hand.

mod camera;
mod lights;
mod repeats;
mod sampling;
mod scenes;
mod textures;
mod trees;
mod walker;

use crate::scene::{Image, Material, Mesh, Node, Primitive, Scene, SceneRoot, Texture, TextureRef, Wrap};
use glam::{DAffine3, Mat3, Vec2, Vec3};
use std::io::Cursor;
use std::sync::Arc;

/// Random numbers (Marsaglia's xorshift64).
struct Random(u64);

impl Random {
    fn unit(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    fn point(&mut self) -> Vec3 {
        Vec3::from_array(std::array::from_fn(|_| self.unit() as f32 - 0.5))
    }
}

/// A soup of triangles around the origin, within the unit cube or nearly.
fn soup(count: usize, seed: u64) -> Primitive {
    let mut random = Random(seed);
    let positions: Vec<Vec3> = (0..count)
        .flat_map(|_| {
            let centre = random.point();
            let size = 0.3 * random.unit() as f32;
            [centre + random.point() * size, centre + random.point() * size, centre + random.point() * size]
        })
        .collect();
    let triangles = (0..count as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    let normals = Some(positions.iter().map(|p| p.normalize()).collect());
    Primitive { positions, triangles, normals, ..Primitive::default() }
}

/// One triangle in the xy plane that faces +z, with texture coordinates of the lower left half of the texture.
fn triangle() -> Primitive {
    Primitive {
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y],
        normals: Some(vec![Vec3::Z; 3]),
        uvs: vec![vec![Vec2::ZERO, Vec2::X, Vec2::Y]],
        triangles: vec![[0, 1, 2]],
        ..Primitive::default()
    }
}

fn mesh(primitive: Primitive) -> Mesh {
    Mesh { name: None, primitives: vec![primitive] }
}

/// A scene of meshes, with a root node for each (mesh, transform).
fn scene(meshes: Vec<Mesh>, placed: &[(usize, DAffine3)]) -> Scene {
    let node = |(mesh, local): &(usize, DAffine3)| Node { mesh: Some(*mesh), local: *local, ..Node::default() };
    let nodes: Vec<Node> = placed.iter().map(node).collect();
    let scenes = vec![SceneRoot { name: None, nodes: (0..nodes.len()).collect() }];
    Scene { nodes, scenes, meshes: Arc::new(meshes), ..Scene::default() }
}

/// One triangle with a material.
fn triangle_with(material: Material) -> Scene {
    let primitive = Primitive { material: Some(0), ..triangle() };
    Scene { materials: vec![material], ..scene(vec![mesh(primitive)], &[(0, DAffine3::IDENTITY)]) }
}

/// Adds a PNG as a texture and returns a use of it.
fn add_texture(scene: &mut Scene, width: u32, height: u32, texel: impl Fn(u32, u32) -> [u8; 4]) -> TextureRef {
    let picture = image::RgbaImage::from_fn(width, height, |x, y| image::Rgba(texel(x, y)));
    let mut bytes = Cursor::new(Vec::new());
    picture.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    let pointer = format!("/images/{}", scene.images.len());
    scene.images.push(Image { bytes: Arc::from(bytes.into_inner()), pointer });
    let image = scene.images.len() - 1;
    scene.textures.push(Texture { image, wrap_u: Wrap::Repeat, wrap_v: Wrap::Repeat, nearest: false });
    TextureRef { texture: scene.textures.len() - 1, uv_set: 0, transform: Mat3::IDENTITY }
}
