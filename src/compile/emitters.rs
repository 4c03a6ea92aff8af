//! Which triangles emit, and how much.

use super::assemble::Bottom;
use super::texels::{TexelCounts, Texels};
use super::vertices::Placement;
use super::{Emitter, Material, TexturePages};
use glam::{DAffine3, Vec2, Vec3};
use std::sync::LazyLock;

/// Share of a lit texel's worth that a triangle gets at least when samples miss its lit texels.
const MISSED: f32 = 0.05;

/// Luminance of linear Rec. 709.
pub fn luminance(rgb: Vec3) -> f32 {
    rgb.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}

/// sRGB byte -> linear (IEC 61966-2-1).
static LINEAR: LazyLock<[f32; 256]> = LazyLock::new(|| {
    std::array::from_fn(|byte| {
        let x = byte as f64 / 255.0;
        (if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }) as f32
    })
});

/// sRGB byte -> linear.
pub fn linear(byte: u8) -> f32 {
    LINEAR[usize::from(byte)]
}

/// Emission of one material.
pub struct Emission<'a> {
    factor: Vec3,
    texture: Option<(Texels<'a>, TexelCounts<'a>)>,
}

impl<'a> Emission<'a> {
    /// Prepares for a material.
    pub fn new(material: &'a Material, pages: &'a TexturePages) -> Self {
        let factor = Vec3::from_array(material.emissive);
        let texture = Texels::new(pages, &material.emissive_texture).filter(|_| factor.max_element() > 0.0);
        let lit = move |texel: [u8; 4]| (0..3).any(|i| texel[i] > 0 && factor[i] > 0.0);
        Self { factor, texture: texture.map(|texels| (texels, TexelCounts::new(texels, lit))) }
    }

    /// Which uv set it wants to see.
    pub fn uv_set(&self) -> Option<usize> {
        self.texture.as_ref().map(|(texels, _)| texels.uv_set())
    }

    /// Mean luminance over a triangle; zero only if it is black everywhere.
    pub fn luminance(&self, uvs: [Vec2; 3]) -> f32 {
        let full = luminance(self.factor);
        let Some((texels, counts)) = &self.texture else { return full };
        let (lit, total) = counts.around(uvs);
        if lit == 0 {
            return 0.0;
        }
        let side = (total as f32).sqrt().clamp(2.0, 12.0) as u32;
        let mean = self.mean(texels, uvs, side);
        mean.max(full * MISSED * lit as f32 / total as f32).max(f32::MIN_POSITIVE)
    }

    /// Mean over the centres of `side`^2 equal parts of the triangle.
    fn mean(&self, texels: &Texels, uvs: [Vec2; 3], side: u32) -> f32 {
        let [a, ab, ac] = [uvs[0], uvs[1] - uvs[0], uvs[2] - uvs[0]];
        let mut sum = 0.0;
        let mut add = |row: u32, column: u32, third: f32| {
            let at = |cell: u32| (cell as f32 + third) / side as f32;
            let [r, g, b, _] = texels.nearest(a + ab * at(column) + ac * at(row));
            sum += luminance(self.factor * Vec3::new(linear(r), linear(g), linear(b)));
        };
        for row in 0..side {
            for column in 0..side - row {
                add(row, column, 1.0 / 3.0);
                if column + 1 < side - row {
                    add(row, column, 2.0 / 3.0);
                }
            }
        }
        sum / (side * side) as f32
    }
}

/// The emitters of an instance of a mesh.
pub fn of_instance<'a>(
    instance: u32,
    bottom: &'a Bottom,
    first_triangle: u32,
    materials: &'a [Material],
    world: DAffine3,
) -> impl Iterator<Item = Emitter> + 'a {
    let placement = Placement::new(world);
    bottom.lit.iter().map(move |(index, luminance)| {
        let triangle = &bottom.triangles[*index as usize];
        let material = triangle.material();
        let [a, b, c] = [triangle.v0, triangle.v1, triangle.v2]
            .map(|v| placement.map.transform_point3(Vec3::from_array(v).as_dvec3()));
        Emitter {
            instance,
            triangle: first_triangle + index,
            area: (0.5 * (b - a).cross(c - a).length()) as f32,
            luminance: *luminance,
            double_sided: materials[material].flags & Material::DOUBLE_SIDED != 0,
        }
    })
}
