//! Scenes that show or test one thing each.

use super::glb::Glb;
use super::materials::{lamp, surface, textured};
use super::shapes::Shape;
use super::textures;
use glam::{DVec3, Vec2, Vec3, Vec4};
use serde_json::{Value, json};

/// Spheres of metallic 0 (below) to 1 (above) by roughness 0 (left) to 1 (right), seven each, lit by soft boxes.
/// Best in a square picture.
pub fn material_grid() -> Vec<u8> {
    const COUNT: usize = 7;
    let mut glb = Glb::new();
    let ball = glb.geometry(&Shape::sphere(0.42, 96));
    for row in 0..COUNT {
        for column in 0..COUNT {
            let [roughness, metallic] = [column, row].map(|step| step as f32 / (COUNT - 1) as f32);
            let material = glb.material(surface([0.95, 0.45, 0.16], metallic, roughness));
            let mesh = glb.mesh(&ball, material);
            let centre = [column, row].map(|step| step as f32 - (COUNT - 1) as f32 / 2.0);
            glb.place(mesh, json!({"translation": [centre[0], centre[1], 0.0]}));
        }
    }
    let wall = Shape::patch(Vec3::new(-30.0, -30.0, -3.0), Vec3::X * 60.0, Vec3::Y * 60.0);
    glb.show(&wall, surface([0.25; 3], 0.0, 1.0));
    glb.show(&Shape::panel(Vec3::new(-7.0, 6.0, 9.0), Vec3::ZERO, 5.0, 5.0), lamp([1.0, 0.97, 0.92], 11.0));
    glb.show(&Shape::panel(Vec3::new(10.0, 1.0, 7.0), Vec3::ZERO, 1.5, 9.0), lamp([0.85, 0.92, 1.0], 7.0));
    glb.show(&Shape::panel(Vec3::new(0.0, -9.0, 6.0), Vec3::ZERO, 16.0, 3.0), lamp([1.0; 3], 1.0));
    glb.show(&Shape::panel(Vec3::new(0.0, 0.0, 26.0), Vec3::ZERO, 60.0, 40.0), lamp([1.0; 3], 0.35));
    glb.camera("front", Vec3::new(0.0, 0.0, 20.0), Vec3::ZERO, 21.5);
    glb.finish()
}

/// A box of two metres, open to the camera, with an orange and a blue wall, a lamp of 25 cd/m2 in the ceiling, and in it
/// a block and a metal ball.
pub fn light_box() -> Vec<u8> {
    let mut glb = Glb::new();
    let white = surface([0.75; 3], 0.0, 1.0);
    let [x, y, z] = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| axis * 2.0);
    let side = |corner, across, along| Shape::patch(Vec3::from_array(corner), across, along);
    glb.show(&side([-1.0, 0.0, 1.0], x, -z), white.clone());
    glb.show(&side([-1.0, 2.0, -1.0], x, z), white.clone());
    glb.show(&side([-1.0, 0.0, -1.0], x, y), white.clone());
    glb.show(&side([-1.0, 0.0, 1.0], -z, y), surface([0.80, 0.24, 0.05], 0.0, 1.0));
    glb.show(&side([1.0, 0.0, -1.0], z, y), surface([0.06, 0.22, 0.62], 0.0, 1.0));
    glb.show(&side([-0.3, 1.995, -0.25], x * 0.3, z * 0.25), lamp([1.0, 0.88, 0.72], 25.0));
    let block = Shape::rounded_box(Vec3::new(0.28, 0.55, 0.28), 0.02);
    glb.show(&block.placed(Vec3::new(-0.36, 0.55, -0.35), [22.0, 0.0, 0.0], 1.0), white);
    let ball = Shape::sphere(0.34, 96).placed(Vec3::new(0.42, 0.34, 0.2), [0.0; 3], 1.0);
    glb.show(&ball, surface([0.95, 0.93, 0.88], 1.0, 0.12));
    glb.camera("front", Vec3::new(0.0, 1.0, 4.6), Vec3::new(0.0, 1.0, 0.0), 31.0);
    glb.finish()
}

/// A sphere with bumps of several sizes, of `8 * divisions^2` triangles, rough, of base colour 0.8. It has no light: give
/// an environment.
pub fn bumpy_sphere(divisions: u32) -> Vec<u8> {
    let mut glb = Glb::new();
    glb.show(&bumps(divisions), surface([0.8; 3], 0.0, 1.0));
    glb.camera("front", Vec3::new(0.0, 0.0, 4.2), Vec3::ZERO, 32.0);
    glb.finish()
}

pub(super) fn bumps(divisions: u32) -> Shape {
    Shape::displaced_sphere(divisions, |d| {
        let wave = |x: f64, y: f64, z: f64, frequency: f64| {
            (frequency * (d.x + x)).sin() * (frequency * (d.y + y)).sin() * (frequency * (d.z + z)).sin()
        };
        1.0 + 0.14 * wave(0.3, 1.1, 0.7, 5.0) + 0.05 * wave(0.9, 0.2, 1.7, 13.0) + 0.02 * wave(1.3, 0.6, 0.1, 31.0)
    })
}

/// A white sphere. Under a constant white sky it reflects, if no energy is lost, as much as it hides, and cannot be seen.
pub fn furnace(metallic: f32, roughness: f32) -> Vec<u8> {
    let mut glb = Glb::new();
    glb.show(&Shape::sphere(1.0, 256), surface([1.0; 3], metallic, roughness));
    glb.camera("front", Vec3::new(0.0, 0.0, 6.0), Vec3::ZERO, 30.0);
    glb.finish()
}

/// A rough plane of 20 m, base colour 0.5, one metre under a point light of pi candela, seen from above: the irradiance at
/// distance x from the point below the light is `pi / (1 + x^2)^(3/2)`.
pub fn plane_and_point_light() -> Vec<u8> {
    let mut glb = Glb::new();
    let floor = Shape::patch(Vec3::new(-10.0, 0.0, 10.0), Vec3::X * 20.0, Vec3::NEG_Z * 20.0);
    glb.show(&floor, surface([0.5; 3], 0.0, 1.0));
    glb.light(json!({"type": "point", "intensity": std::f32::consts::PI}), Vec3::Y, Vec3::NEG_Y);
    glb.camera("above", Vec3::new(0.0, 6.0, 1e-3), Vec3::ZERO, 45.0);
    glb.finish()
}

/// Tiles in a row, one for each way to give a surface detail, under a sun and a soft box.
pub fn surface_detail() -> Vec<u8> {
    let mut glb = Glb::new();
    let materials = detail_materials(&mut glb);
    let spacing = 1.15;
    let left = -spacing * (materials.len() as f32) / 2.0;
    let tile = Shape::patch(Vec3::new(-0.5, 0.02, 0.0), Vec3::X, Vec3::new(0.0, 1.0, -0.25));
    for (index, material) in materials.into_iter().enumerate() {
        let place = Vec3::new(left + spacing * (index as f32 + 0.5), 0.0, 0.0);
        glb.show(&tile.clone().placed(place, [0.0; 3], 1.0), material);
    }
    let mut painted = Shape::sphere(0.4, 64).placed(Vec3::new(-left + 0.6, 0.4, 0.2), [0.0; 3], 1.0);
    painted.colors = painted.normals.iter().map(|normal| (*normal * 0.5 + 0.5).extend(1.0)).collect::<Vec<Vec4>>();
    glb.show(&painted, surface([1.0; 3], 0.0, 0.4));

    let checker = glb.texture(&textures::checker(2.0, [0.75; 3], [0.45; 3]));
    let floor = Shape::parametric(1, 1, |u, v| DVec3::new(24.0 * u - 12.0, 0.0, 9.0 - 24.0 * v)).tiled(12.0, 12.0);
    glb.show(&floor, textured(checker, 0.0, 0.6));
    glb.light(
        json!({"type": "directional", "intensity": 2.5, "color": [1.0, 0.95, 0.85]}),
        Vec3::ZERO,
        Vec3::new(-0.5, -1.0, -0.6),
    );
    glb.show(&Shape::panel(Vec3::new(-4.0, 5.0, 5.0), Vec3::ZERO, 4.0, 2.0), lamp([0.8, 0.9, 1.0], 5.0));
    let wall = Shape::patch(Vec3::new(-30.0, 0.0, -4.0), Vec3::X * 60.0, Vec3::Y * 12.0);
    glb.show(&wall, surface([0.22, 0.25, 0.3], 0.0, 1.0));
    glb.camera("front", Vec3::new(0.5, 1.5, 8.4), Vec3::new(0.5, 0.6, 0.0), 28.0);
    glb.finish()
}

fn detail_materials(glb: &mut Glb) -> Vec<Value> {
    let base = glb.texture(&textures::checker(8.0, [0.9, 0.75, 0.3], [0.2, 0.35, 0.6]));
    let bumps = glb.texture(&textures::normal_map(256, |u, v| {
        let [x, y] = [u, v].map(|t| (t * 6.0).fract() - 0.5);
        0.03 * (0.16 - x * x - y * y).max(0.0).sqrt()
    }));
    let leaf = glb.texture(&textures::png(256, |u, v| {
        let place = Vec2::new(u - 0.5, v - 0.5);
        let edge = 0.3 + 0.13 * (5.0 * place.y.atan2(place.x)).cos();
        [0.25, 0.6, 0.2, if place.length() < edge { 1.0 } else { 0.0 }]
    }));
    let glass = glb.texture(&textures::png(128, |u, _| [0.8, 0.2, 0.3, u]));
    let rough_metal = glb.texture(&textures::png(256, |u, v| {
        let stripe = if (v * 6.0).fract() < 0.5 { 1.0 } else { 0.0 };
        [0.0, 0.1 + 0.7 * u, stripe, 1.0]
    }));
    let glow = glb.texture(&textures::png(256, |u, v| {
        let ring = (40.0 * Vec2::new(u - 0.5, v - 0.5).length()).cos().max(0.0);
        [ring, 0.5 * ring, 0.1 * ring, 1.0]
    }));
    glb.uses("KHR_texture_transform");
    let turned = json!({"index": base, "extensions": {"KHR_texture_transform":
        {"rotation": 0.6, "scale": [0.5, 0.5], "offset": [0.1, 0.2]}}});
    let mut bumpy = surface([0.8, 0.8, 0.82], 0.0, 0.35);
    bumpy["normalTexture"] = json!({"index": bumps});
    let mut mask = textured(leaf, 0.0, 0.8);
    mask["alphaMode"] = json!("MASK");
    mask["doubleSided"] = json!(true);
    let mut blend = textured(glass, 0.0, 0.3);
    blend["alphaMode"] = json!("BLEND");
    let metal = json!({"pbrMetallicRoughness":
        {"baseColorFactor": [0.95, 0.8, 0.5, 1.0], "metallicRoughnessTexture": {"index": rough_metal}}});
    let mut glowing = surface([0.02; 3], 0.0, 0.5);
    glowing["emissiveTexture"] = json!({"index": glow});
    glowing["emissiveFactor"] = json!([1.0, 1.0, 1.0]);
    let moved = json!({"pbrMetallicRoughness": {"baseColorTexture": turned, "metallicFactor": 0.0}});
    vec![textured(base, 0.0, 0.7), moved, bumpy, metal, mask, blend, glowing]
}
