//! Procedural textures, as PNG bytes.

use glam::{FloatExt, Vec2, Vec3};

/// A picture of `size` x `size` texels whose colours `texel(u, v)` gives as stored: 0 to 1, RGBA.
pub fn png(size: u32, texel: impl Fn(f32, f32) -> [f32; 4]) -> Vec<u8> {
    let mut data = Vec::with_capacity((size * size * 4) as usize);
    for y in 0..size {
        for x in 0..size {
            let rgba = texel((x as f32 + 0.5) / size as f32, (y as f32 + 0.5) / size as f32);
            data.extend(rgba.map(|value| (value.clamp(0.0, 1.0) * 255.0).round() as u8));
        }
    }
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, size, size);
    encoder.set_color(png::ColorType::Rgba);
    let written = encoder.write_header().and_then(|mut writer| writer.write_image_data(&data));
    debug_assert!(written.is_ok(), "writing to memory does not fail");
    bytes
}

/// A normal map of the height field `height(u, v)`, in units of the texture's width.
pub fn normal_map(size: u32, height: impl Fn(f32, f32) -> f32) -> Vec<u8> {
    let step = 0.5 / size as f32;
    png(size, |u, v| {
        let across = (height(u + step, v) - height(u - step, v)) / (2.0 * step);
        // v runs down in the picture, the green channel up.
        let along = (height(u, v - step) - height(u, v + step)) / (2.0 * step);
        let normal = Vec3::new(-across, -along, 1.0).normalize() * 0.5 + 0.5;
        normal.extend(1.0).to_array()
    })
}

/// Two colours in squares, `count` of them across.
pub fn checker(count: f32, a: [f32; 3], b: [f32; 3]) -> Vec<u8> {
    png(256, |u, v| {
        let even = ((u * count).floor() + (v * count).floor()).rem_euclid(2.0) < 1.0;
        Vec3::from(if even { a } else { b }).extend(1.0).to_array()
    })
}

/// Wooden boards along v, six across.
pub fn boards() -> Vec<u8> {
    png(1024, |u, v| {
        let board = (u * 6.0).floor();
        let across = (u * 6.0).fract();
        let shift = random(board as u32, 7);
        let end = (v * 1.5 + shift).fract();
        let piece = board as u32 * 31 + (v * 1.5 + shift).floor() as u32;
        let grain = noise(Vec2::new(u * 90.0, v * 3.0 + shift * 9.0));
        let ring = (across * 7.0 + 2.5 * noise(Vec2::new(u * 9.0, v * 1.2 + shift * 5.0))).sin() * 0.5 + 0.5;
        let gap = if across < 0.012 || end < 0.003 { 0.25 } else { 1.0 };
        let tone = (0.62 + 0.16 * random(piece, 3) + 0.12 * ring + 0.16 * (grain - 0.5)) * gap;
        [0.80 * tone, 0.56 * tone, 0.36 * tone, 1.0]
    })
}

/// Veined stone.
pub fn marble() -> Vec<u8> {
    png(512, |u, v| {
        let place = Vec2::new(u, v) * 5.0;
        let swirl = noise(place) + 0.5 * noise(place * 2.1) + 0.25 * noise(place * 4.3);
        let vein = ((u * 4.0 + swirl * 3.5) * std::f32::consts::PI).sin().abs();
        let light = vein.powf(0.35);
        [0.24.lerp(0.93, light), 0.31.lerp(0.91, light), 0.36.lerp(0.88, light), 1.0]
    })
}

/// A number from 0 to 1 that depends on `index` and `salt` alone.
pub fn random(index: u32, salt: u32) -> f32 {
    // The PCG hash (Jarzynski and Olano 2020).
    let state =
        index.wrapping_mul(0x9e37_79b9).wrapping_add(salt).wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
    ((word >> 22) ^ word) as f32 / u32::MAX as f32
}

/// Smooth noise from 0 to 1 of feature size 1.
pub fn noise(place: Vec2) -> f32 {
    let cell = place.floor();
    let [x, y] = (place - cell).to_array().map(|t| t * t * (3.0 - 2.0 * t));
    let corner = |dx: f32, dy: f32| random((cell.x + dx) as i32 as u32, (cell.y + dy) as i32 as u32);
    corner(0.0, 0.0).lerp(corner(1.0, 0.0), x).lerp(corner(0.0, 1.0).lerp(corner(1.0, 1.0), x), y)
}
