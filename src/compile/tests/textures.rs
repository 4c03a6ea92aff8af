//! Textures: packing, slots, what of them decides on alpha, emission and roughness.

use super::{Random, add_texture, triangle_with};
use crate::compile::atlas::pack;
use crate::compile::{CompileError, CompiledScene, NONE, TextureSlot, Triangle, compile_scene};
use crate::scene::{AlphaMode, Material, Scene, SceneErrorKind};
use glam::{Mat3, Vec2, Vec3};
use std::sync::Arc;

#[test]
fn packing_does_not_overlap() {
    let mut random = Random(9);
    let sizes: Vec<(u32, u32)> =
        (0..200).map(|_| (1 + (random.unit() * 255.0) as u32, 1 + (random.unit() * 255.0) as u32)).collect();
    let (places, pages) = pack(&sizes, 256);
    let mut taken = vec![false; 256 * 256 * pages as usize];
    for (place, (width, height)) in places.iter().zip(&sizes) {
        assert!(place.x + width <= 256 && place.y + height <= 256 && place.page < pages);
        for y in place.y..place.y + height {
            for x in place.x..place.x + width {
                let texel = ((place.page * 256 + y) * 256 + x) as usize;
                assert!(!std::mem::replace(&mut taken[texel], true), "overlap");
            }
        }
    }
    let area: u32 = sizes.iter().map(|(w, h)| w * h).sum();
    assert!(f64::from(area) > 0.6 * taken.len() as f64, "{} of {}", area, taken.len());
    assert_eq!(pack(&[(256, 256), (256, 256)], 256).1, 2);
}

fn compiled(scene: &Scene) -> CompiledScene {
    compile_scene(scene, None).unwrap()
}

#[test]
fn slots_lead_to_their_texels() {
    let mut source = triangle_with(Material::default());
    let first = add_texture(&mut source, 5, 3, |x, y| [x as u8, y as u8, 7, 255]);
    let mut second = add_texture(&mut source, 300, 2, |x, y| [x as u8, y as u8, 9, 255]);
    let unused = add_texture(&mut source, 1, 1, |_, _| [0; 4]);
    second.transform = Mat3::from_scale(Vec2::new(2.0, 3.0));
    source.materials[0].base_color_texture = Some(first);
    source.materials[0].normal_texture = Some(second);
    source.materials[0].metallic_roughness_texture = Some(first);
    let compiled = compiled(&source);
    assert_eq!((compiled.stats.textures, compiled.stats.unused_textures), (2, 1));
    assert!(unused.texture == 2 && compiled.data_pages.page_size == 512 && compiled.color_pages.page_size == 256);
    let material = compiled.materials[0];
    assert_eq!(material.emissive_texture.info, NONE);
    assert_eq!((material.normal_texture.row_u, material.normal_texture.row_v), ([2.0, 0.0, 0.0], [0.0, 3.0, 0.0]));
    let check = |slot: &TextureSlot, data: bool, blue: u8| {
        let pages = if data { &compiled.data_pages } else { &compiled.color_pages };
        let page = &pages.pages[(slot.info & 0xffff) as usize];
        for y in 0..=slot.size >> 16 {
            for x in 0..=slot.size & 0xffff {
                let at = ((y + (slot.corner >> 16)) * pages.page_size + x + (slot.corner & 0xffff)) as usize * 4;
                assert_eq!(page[at..at + 3], [x as u8, y as u8, blue]);
            }
        }
    };
    check(&material.base_color_texture, false, 7);
    check(&material.metallic_roughness_texture, true, 7);
    check(&material.normal_texture, true, 9);
    assert_eq!(material.normal_texture.size, 299 | 1 << 16);
}

#[test]
fn bad_images_are_refused_with_their_pointer() {
    let mut source = triangle_with(Material::default());
    source.materials[0].base_color_texture = Some(add_texture(&mut source, 4, 4, |_, _| [0; 4]));
    let whole = source.images[0].bytes.clone();
    for (bytes, kind) in [(&whole[..40], SceneErrorKind::Malformed), (&b"nonsense"[..], SceneErrorKind::Invalid)] {
        source.images[0].bytes = bytes.into();
        match compile_scene(&source, None) {
            Err(CompileError::Scene(error)) => assert_eq!((&*error.pointer, error.kind), ("/images/0", kind)),
            other => panic!("{other:?}"),
        }
    }
    let mut large = triangle_with(Material::default());
    large.materials[0].base_color_texture = Some(add_texture(&mut large, 8193, 1, |_, _| [0; 4]));
    match compile_scene(&large, None) {
        Err(CompileError::Scene(error)) => {
            assert_eq!((&*error.pointer, error.kind), ("/images/0", SceneErrorKind::TooLarge));
        }
        other => panic!("{other:?}"),
    }
}

/// The triangle covers the half of the texture where u + v < 1.
fn blended(texel: impl Fn(u32, u32) -> u8) -> CompiledScene {
    let mut source = triangle_with(Material { alpha_mode: AlphaMode::Blend, ..Material::default() });
    let texture = add_texture(&mut source, 64, 64, |x, y| [255, 255, 255, texel(x, y)]);
    source.materials[0].base_color_texture = Some(texture);
    for uv in &mut Arc::make_mut(&mut source.meshes)[0].primitives[0].uvs[0] {
        *uv = *uv * 0.25 + 0.25;
    }
    compiled(&source)
}

#[test]
fn alpha_of_texels_under_a_triangle_decides() {
    let tested = |scene: &CompiledScene| scene.triangles[0].material & Triangle::ALPHA != 0;
    assert!(!tested(&blended(|_, _| 255)));
    assert!(!tested(&blended(|x, _| if x < 12 { 0 } else { 255 })), "holes elsewhere do not matter");
    assert!(tested(&blended(|x, y| if (x, y) == (20, 20) { 254 } else { 255 })));
    assert!(tested(&blended(|x, _| if x < 16 { 0 } else { 255 })), "filtering reads one texel beyond the edge");
    assert!(tested(&blended(|x, _| if x > 31 { 0 } else { 255 })), "on either side");
    assert!(!tested(&blended(|x, _| if x > 32 { 0 } else { 255 })));
    assert!(blended(|x, _| if x < 12 { 255 } else { 0 }).triangles.is_empty());
}

fn glowing(texel: impl Fn(u32, u32) -> u8) -> CompiledScene {
    let mut source = triangle_with(Material { emissive: Vec3::splat(3.0), ..Material::default() });
    let texture = add_texture(&mut source, 64, 64, |x, y| [texel(x, y), texel(x, y), texel(x, y), 255]);
    source.materials[0].emissive_texture = Some(texture);
    compiled(&source)
}

#[test]
fn emission_is_the_mean_over_the_triangle_and_never_missed() {
    assert!(glowing(|_, _| 0).emitters.is_empty());
    assert!((glowing(|_, _| 255).emitters[0].luminance - 3.0).abs() < 1e-5);
    // A lit band over a quarter of u holds 7/16 of the triangle u + v < 1.
    let band = glowing(|x, _| if x < 16 { 255 } else { 0 });
    assert!((band.emitters[0].luminance - 3.0 * 7.0 / 16.0).abs() < 0.15, "{}", band.emitters[0].luminance);
    let spark = glowing(|x, y| u8::from((x, y) == (11, 17)));
    assert!(spark.emitters.len() == 1 && spark.emitters[0].luminance > 0.0);
}

#[test]
fn roughness_of_texels_decides_on_mirrors() {
    let rough = |green: u8| {
        let mut source = triangle_with(Material { roughness: 0.5, ..Material::default() });
        let texture = add_texture(&mut source, 4, 4, |x, y| [0, if (x, y) == (1, 2) { green } else { 200 }, 0, 255]);
        source.materials[0].metallic_roughness_texture = Some(texture);
        compiled(&source).min_roughness
    };
    assert_eq!(rough(0), 0.0);
    assert!((rough(51) - 0.1).abs() < 1e-6);
}
