//! Scenes with many of one thing.

use super::glb::Glb;
use super::materials::{lamp, surface};
use super::shapes::Shape;
use super::textures::random;
use glam::{Quat, Vec3};
use serde_json::json;

/// `side * side` instances of five meshes, strewn over a floor, under a soft box of 6 m.
pub fn many_instances(side: u32) -> Vec<u8> {
    let mut glb = Glb::new();
    let shapes = [
        Shape::sphere(0.42, 64),
        Shape::torus(0.34, 0.12, 64),
        Shape::rounded_box(Vec3::splat(0.36), 0.06),
        Shape::rounded_box(Vec3::new(0.2, 0.42, 0.2), 0.2),
        Shape::displaced_sphere(40, |d| 0.4 + 0.06 * (9.0 * d.x).sin() * (9.0 * d.y).sin() * (9.0 * d.z).sin()),
    ];
    let colors = [[0.8, 0.25, 0.1], [0.95, 0.7, 0.3], [0.15, 0.4, 0.6], [0.7; 3], [0.25, 0.5, 0.25]];
    let meshes: Vec<usize> = shapes
        .iter()
        .zip(colors)
        .enumerate()
        .map(|(index, (shape, color))| {
            let geometry = glb.geometry(shape);
            let metallic = if index % 2 == 1 { 1.0 } else { 0.0 };
            let material = glb.material(surface(color, metallic, 0.2 + 0.15 * index as f32));
            glb.mesh(&geometry, material)
        })
        .collect();
    for index in 0..side * side {
        let mesh = meshes[(random(index, 0) * 4.999) as usize];
        let [x, z] = [index % side, index / side].map(|place| place as f32 - (side - 1) as f32 / 2.0);
        let turn = Quat::from_rotation_y(random(index, 1) * std::f32::consts::TAU).to_array();
        let size = 0.6 + 0.5 * random(index, 2);
        let place = [x, 0.45 * size, z];
        glb.place(mesh, json!({"translation": place, "rotation": turn, "scale": [size, size, size]}));
    }
    floor(&mut glb, side as f32);
    let half = side as f32 / 2.0;
    let panel = Shape::panel(Vec3::new(-half, side as f32, half), Vec3::ZERO, half, half);
    glb.show(&panel, lamp([1.0, 0.95, 0.88], 14.0));
    glb.camera("above", Vec3::new(0.0, 0.35 * half, 1.25 * half), Vec3::new(0.0, 0.0, 0.3 * half), 35.0);
    glb.finish()
}

/// `side * side` glowing balls of many colours and strengths over a floor with posts.
pub fn many_emitters(side: u32) -> Vec<u8> {
    let mut glb = Glb::new();
    let ball = glb.geometry(&Shape::displaced_sphere(4, |_| 0.06));
    let post = glb.geometry(&Shape::rounded_box(Vec3::new(0.1, 0.5, 0.1), 0.02));
    let stone = glb.material(surface([0.6; 3], 0.0, 0.7));
    let post = glb.mesh(&post, stone);
    for index in 0..side * side {
        let color = [0, 1, 2].map(|channel| 0.15 + 0.85 * random(index, channel).powi(2));
        let material = glb.material(lamp(color, 12.0 + 180.0 * random(index, 3).powi(4)));
        let mesh = glb.mesh(&ball, material);
        let jitter = |salt| 0.7 * random(index, salt) - 0.35;
        let [x, z] = [index % side, index / side].map(|place| place as f32 - (side - 1) as f32 / 2.0);
        let place = [x + jitter(4), 0.1 + 0.9 * random(index, 5), z + jitter(6)];
        glb.place(mesh, json!({"translation": place}));
        if index % 5 == 0 {
            glb.place(post, json!({"translation": [x + 0.45, 0.5, z]}));
        }
    }
    floor(&mut glb, side as f32);
    let half = side as f32 / 2.0;
    glb.camera("above", Vec3::new(0.0, 0.3 * half, 1.1 * half), Vec3::new(0.0, 0.0, 0.35 * half), 35.0);
    glb.finish()
}

fn floor(glb: &mut Glb, side: f32) {
    let shape = Shape::patch(Vec3::new(-1.5, 0.0, 1.5) * side, Vec3::X * 3.0 * side, Vec3::NEG_Z * 3.0 * side);
    glb.show(&shape, surface([0.5; 3], 0.0, 0.8));
}
