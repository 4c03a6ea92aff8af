//! A scene that moves.

use super::glb::Glb;
use super::materials::{lamp, surface};
use super::shapes::Shape;
use glam::{Quat, Vec3};
use serde_json::json;
use std::f32::consts::TAU;

/// A wheel of eight spokes that turns four times a second, a ball that rolls by in a second and a lamp that swings, over a floor.
pub fn motion() -> Vec<u8> {
    let mut glb = Glb::new();
    let floor = Shape::patch(Vec3::new(-6.0, 0.0, 4.0), Vec3::X * 12.0, Vec3::NEG_Z * 10.0);
    glb.show(&floor, surface([0.5; 3], 0.0, 0.6));
    glb.show(&Shape::panel(Vec3::new(0.0, 4.0, 2.0), Vec3::new(0.0, 0.6, 0.0), 3.0, 1.5), lamp([1.0; 3], 6.0));
    wheel(&mut glb);
    glb.show(&Shape::sphere(0.3, 48), surface([0.9, 0.35, 0.1], 0.0, 0.3));
    let seconds = [0.0, 0.5, 1.0];
    let way = [-1.8, 0.0, 1.8].map(|x| Vec3::new(x, 0.3, 0.9));
    glb.animate("translation", &seconds, "VEC3", &way);
    let rolls = [1.8, 0.0, -1.8].map(|x| Quat::from_rotation_z(x / 0.3));
    glb.animate("rotation", &seconds, "VEC4", &rolls.map(|turn| turn.to_array()));
    glb.show(&Shape::sphere(0.08, 24), lamp([0.3, 0.6, 1.0], 40.0));
    let swing = [Vec3::new(-1.6, 1.2, 0.5), Vec3::new(0.0, 0.9, 0.5), Vec3::new(1.6, 1.2, 0.5)];
    glb.animate("translation", &seconds, "VEC3", &swing);
    glb.camera("front", Vec3::new(0.0, 1.4, 5.0), Vec3::new(0.0, 0.8, 0.0), 40.0);
    glb.finish()
}

/// Rim and spokes are one mesh of boxes about the z axis.
fn wheel(glb: &mut Glb) {
    let spoke = Shape::rounded_box(Vec3::new(0.35, 0.04, 0.04), 0.01);
    let tread = Shape::rounded_box(Vec3::new(0.05, 0.31, 0.08), 0.01);
    let mut wheel = Shape::default();
    for part in 0..8 {
        let degrees = 45.0 * part as f32;
        let out = Quat::from_rotation_z(degrees.to_radians()) * Vec3::X;
        wheel.append(&spoke.clone().placed(out * 0.37, [0.0, 0.0, degrees], 1.0));
        wheel.append(&tread.clone().placed(out * 0.72, [0.0, 0.0, degrees], 1.0));
    }
    let geometry = glb.geometry(&wheel);
    let material = glb.material(surface([0.7, 0.7, 0.75], 1.0, 0.25));
    let mesh = glb.mesh(&geometry, material);
    glb.place(mesh, json!({"translation": [0.0, 0.82, 0.0]}));
    let keys: Vec<f32> = (0..=16).map(|key| key as f32 / 16.0).collect();
    let turns: Vec<[f32; 4]> = keys.iter().map(|key| Quat::from_rotation_z(-4.0 * TAU * key).to_array()).collect();
    glb.animate("rotation", &keys, "VEC4", &turns);
}
