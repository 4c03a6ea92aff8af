//! The picture on the front page.

use super::glb::Glb;
use super::materials::{lamp, named, surface, textured};
use super::shapes::{Shape, spline};
use super::textures;
use glam::{DVec3, Vec2, Vec3};
use serde_json::json;

/// A vase, a bowl of gold, a marble ball, blocks, a ring, and two lamps that are part of the picture, on a wooden table.
/// Best in a wide picture (12 : 5).
pub fn still_life() -> Vec<u8> {
    let mut glb = Glb::new();
    table(&mut glb);
    pottery(&mut glb);
    blocks(&mut glb);
    lamps(&mut glb);
    glb.camera("table", Vec3::new(0.0, 0.62, 3.1), Vec3::new(0.0, 0.33, 0.0), 18.5);
    glb.finish()
}

/// Boards that end in a wall with a soft bend.
fn table(glb: &mut Glb) {
    let boards = glb.texture(&textures::boards());
    let relief = glb.texture(&textures::normal_map(512, |u, _| {
        let across = (u * 6.0).fract();
        -0.004 * (1.0 - (across.min(1.0 - across) / 0.012).min(1.0))
    }));
    let top = Shape::patch(Vec3::new(-3.0, 0.0, 2.4), Vec3::X * 6.0, Vec3::NEG_Z * 3.6).tiled(5.0, 3.0);
    let mut wood = named("Wood", textured(boards, 0.0, 0.38));
    wood["normalTexture"] = json!({"index": relief});
    glb.show(&top, wood);
    let wall = Shape::parametric(1, 48, |u, v| {
        let (depth, height) = spline(&[(-1.0, -0.06), (-1.7, -0.06), (-2.3, 0.2), (-2.6, 1.0), (-2.6, 6.0)], v);
        DVec3::new(16.0 * u - 8.0, height, depth)
    });
    glb.show(&wall, named("Wall", surface([0.30, 0.33, 0.38], 0.0, 0.9)));
}

fn pottery(glb: &mut Glb) {
    // Up the outside and down the inside, from foot to bottom.
    let vase = [
        (0.0, 0.0),
        (0.10, 0.0),
        (0.12, 0.015),
        (0.17, 0.14),
        (0.205, 0.28),
        (0.18, 0.42),
        (0.105, 0.53),
        (0.075, 0.60),
        (0.085, 0.67),
        (0.115, 0.71),
        (0.108, 0.715),
        (0.075, 0.67),
        (0.062, 0.60),
        (0.09, 0.52),
        (0.16, 0.41),
        (0.185, 0.28),
        (0.15, 0.12),
        (0.0, 0.03),
    ];
    let vase = Shape::lathe(160, 240, move |t| spline(&vase, t));
    // Only the outside, up to v = 0.44, is seen.
    let glaze = glb.texture(&textures::png(512, |u, v| {
        let drip = 0.62 + 0.05 * textures::noise(Vec2::new(u * 14.0, 2.0)) + 0.012 * (u * 44.0).sin();
        if v < drip { [0.10, 0.34, 0.42, 1.0] } else { [0.88, 0.84, 0.77, 1.0] }
    }));
    let glaze = named("Glaze", textured(glaze, 0.0, 0.12));
    glb.show(&vase.placed(Vec3::new(-0.62, 0.0, -0.12), [180.0, 0.0, 0.0], 1.0), glaze);

    let bowl = [
        (0.0, 0.0),
        (0.09, 0.0),
        (0.10, 0.012),
        (0.075, 0.03),
        (0.17, 0.075),
        (0.245, 0.16),
        (0.262, 0.20),
        (0.255, 0.203),
        (0.235, 0.165),
        (0.16, 0.087),
        (0.0, 0.045),
    ];
    let bowl = Shape::lathe(160, 160, move |t| spline(&bowl, t));
    let gold = named("Gold", surface([1.0, 0.72, 0.32], 1.0, 0.18));
    glb.show(&bowl.placed(Vec3::new(0.28, 0.0, 0.20), [0.0; 3], 1.0), gold);
    for (index, (x, y, z)) in [(0.22, 0.125, 0.20), (0.335, 0.12, 0.235), (0.28, 0.13, 0.12)].into_iter().enumerate() {
        let (name, color) =
            [("Cherry", [0.62, 0.05, 0.04]), ("Apricot", [0.70, 0.16, 0.03]), ("Plum", [0.45, 0.03, 0.05])][index];
        let skin = named(name, surface(color, 0.0, 0.22));
        glb.show(&Shape::sphere(0.062, 64).placed(Vec3::new(x, y, z), [0.0; 3], 1.0), skin);
    }

    let marble = glb.texture(&textures::marble());
    let ball = Shape::sphere(0.17, 128).tiled(2.0, 1.0).placed(Vec3::new(-0.20, 0.17, 0.10), [150.0, 12.0, 0.0], 1.0);
    glb.show(&ball, named("Marble", textured(marble, 0.0, 0.08)));
}

fn blocks(glb: &mut Glb) {
    let steel = named("Steel", surface([0.62, 0.64, 0.67], 1.0, 0.32));
    let block = Shape::rounded_box(Vec3::new(0.15, 0.26, 0.15), 0.012);
    glb.show(&block.placed(Vec3::new(0.80, 0.26, -0.22), [28.0, 0.0, 0.0], 1.0), steel);
    let cube = Shape::rounded_box(Vec3::splat(0.09), 0.02);
    let rubber = named("Rubber", surface([0.03, 0.16, 0.30], 0.0, 0.75));
    glb.show(&cube.clone().placed(Vec3::new(0.80, 0.61, -0.22), [-12.0, 0.0, 0.0], 1.0), rubber);
    let clay = named("Clay", surface([0.72, 0.27, 0.12], 0.0, 0.95));
    glb.show(&cube.placed(Vec3::new(-0.98, 0.09, 0.18), [38.0, 0.0, 0.0], 1.0), clay);
    let ring = Shape::torus(0.10, 0.022, 128).placed(Vec3::new(-0.02, 0.024, 0.46), [0.0; 3], 1.0);
    glb.show(&ring, named("Copper", surface([0.95, 0.52, 0.38], 1.0, 0.1)));
}

/// A soft box above the camera's left, a strip behind on the right, and two lamps in view.
fn lamps(glb: &mut Glb) {
    let still = Vec3::new(0.0, 0.2, 0.0);
    glb.show(
        &Shape::panel(Vec3::new(-2.2, 2.6, 1.9), still, 1.3, 1.3),
        named("Soft box", lamp([1.0, 0.90, 0.78], 14.0)),
    );
    glb.show(&Shape::panel(Vec3::new(2.6, 1.3, -0.9), still, 0.4, 1.8), named("Strip", lamp([0.62, 0.80, 1.0], 12.0)));
    let glow = Shape::displaced_sphere(24, |_| 0.075).placed(Vec3::new(1.06, 0.075, 0.24), [0.0; 3], 1.0);
    glb.show(&glow, named("Ember", lamp([1.0, 0.50, 0.16], 3.5)));
    let hoop = Shape::torus(0.20, 0.011, 96).placed(Vec3::new(0.36, 0.21, -0.42), [-18.0, 90.0, 0.0], 1.0);
    glb.show(&hoop, named("Hoop", lamp([0.10, 0.85, 0.75], 3.0)));
}
