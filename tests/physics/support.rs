//! Small scenes built in place, and a render to the end.

use candela::compile::{self, Hdri, LightFiles, MapFiles};
use candela::film::Picture;
use candela::params::{EngineChoice, RenderParams};
use candela::render::Engines;
use candela::render::prepare::{prepare, render_to_end};
use candela::render::{NonFinite, Work};
use candela::scene::{Material, Mesh, Node, Primitive, Profile, Scene, SceneRoot};
use glam::{DAffine3, Vec3, Vec4};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock};

/// The engines of this test binary; tests take turns.
pub fn engines() -> MutexGuard<'static, Engines> {
    static ENGINES: OnceLock<Mutex<Engines>> = OnceLock::new();
    ENGINES.get_or_init(|| Mutex::new(Engines::new())).lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

/// A scene of placed primitives, each with its material.
pub fn scene(parts: Vec<(Primitive, Material, DAffine3)>) -> Scene {
    let mut scene = Scene::default();
    let mut root = SceneRoot::default();
    for (index, (mut primitive, material, local)) in parts.into_iter().enumerate() {
        primitive.material = Some(index);
        scene.materials.push(material);
        Arc::make_mut(&mut scene.meshes).push(Mesh { name: None, primitives: vec![primitive] });
        scene.nodes.push(Node { mesh: Some(index), local, ..Node::default() });
        root.nodes.push(index);
    }
    scene.scenes.push(root);
    scene
}

/// A grey dielectric or metal.
pub fn grey(albedo: f32, roughness: f32, metallic: f32) -> Material {
    Material { base_color: Vec4::new(albedo, albedo, albedo, 1.0), roughness, metallic, ..Material::default() }
}

/// A square of half side `half` in the plane y = 0, seen from above.
pub fn square(half: f32) -> Primitive {
    Primitive {
        positions: vec![
            Vec3::new(-half, 0.0, half),
            Vec3::new(half, 0.0, half),
            Vec3::new(half, 0.0, -half),
            Vec3::new(-half, 0.0, -half),
        ],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Primitive::default()
    }
}

/// A closed box between two heights, seen from above.
pub fn slab(half: f32, low: f32, high: f32) -> Primitive {
    let mut slab = Primitive::default();
    for y in [low, high] {
        slab.positions
            .extend([(-half, half), (half, half), (half, -half), (-half, -half)].map(|(x, z)| Vec3::new(x, y, z)));
    }
    slab.triangles = vec![[4, 5, 6], [4, 6, 7], [0, 2, 1], [0, 3, 2]];
    for [a, b] in [[0, 1], [1, 2], [2, 3], [3, 0]] {
        slab.triangles.extend([[a, b, b + 4], [a, b + 4, a + 4]]);
    }
    slab
}

/// A unit sphere with smooth normals.
pub fn sphere(rings: u32) -> Primitive {
    let mut primitive = Primitive::default();
    let spokes = 2 * rings;
    for ring in 0..=rings {
        let theta = std::f32::consts::PI * ring as f32 / rings as f32;
        for spoke in 0..=spokes {
            let phi = std::f32::consts::TAU * spoke as f32 / spokes as f32;
            primitive.positions.push(Vec3::new(theta.sin() * phi.cos(), theta.cos(), -theta.sin() * phi.sin()));
        }
    }
    for ring in 0..rings {
        for spoke in 0..spokes {
            let a = ring * (spokes + 1) + spoke;
            let b = a + spokes + 1;
            primitive.triangles.push([a, b, b + 1]);
            primitive.triangles.push([a, b + 1, a + 1]);
        }
    }
    primitive.normals = Some(primitive.positions.clone());
    primitive
}

/// The work of a request, as the server would make it.
pub fn work(scene: &Scene, params: &RenderParams) -> Work {
    work_with_hdri(scene, params, None)
}

/// The same under an HDRI.
pub fn work_with_hdri(scene: &Scene, params: &RenderParams, hdri: Option<Arc<Hdri>>) -> Work {
    compiled(scene, params, &MapFiles::new(), hdri)
}

/// The same with a profile that the parameters name.
pub fn work_with_profile(scene: &Scene, params: &RenderParams, name: &str, profile: Arc<Profile>) -> Work {
    let profiles = [(name.to_owned(), profile)].into();
    compiled(scene, params, &MapFiles::new(), LightFiles { hdri: None, profiles })
}

/// The same with pictures that the parameters name.
pub fn work_with_maps(scene: &Scene, params: &RenderParams, maps: &MapFiles) -> Work {
    compiled(scene, params, maps, None)
}

/// The same, emitters being picked by power alone however many they are.
pub fn work_without_tree(scene: &Scene, params: &RenderParams) -> Work {
    let mut compiled = compile::compile_request(scene, params, &MapFiles::new()).expect("a scene that compiles");
    compiled.light_tree = compile::LightTree::default();
    prepare(scene, Arc::new(compiled), params, None).expect("parameters that fit the scene").work
}

fn compiled(scene: &Scene, params: &RenderParams, maps: &MapFiles, files: impl Into<LightFiles>) -> Work {
    let compiled = Arc::new(compile::compile_request(scene, params, maps).expect("a scene that compiles"));
    prepare(scene, compiled, params, files).expect("parameters that fit the scene").work
}

/// A grey picture of 16 bits, from heights by column and row.
pub fn heights(width: u32, height: u32, at: impl Fn(u32, u32) -> f64) -> Arc<[u8]> {
    let picture = image::ImageBuffer::from_fn(width, height, |x, y| {
        image::Luma([(at(x, y).clamp(0.0, 1.0) * 65535.0).round() as u16])
    });
    png(&image::DynamicImage::ImageLuma16(picture))
}

/// As PNG.
pub fn png(picture: &image::DynamicImage) -> Arc<[u8]> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    picture.write_to(&mut bytes, image::ImageFormat::Png).expect("a PNG");
    bytes.into_inner().into()
}

/// Only the Lambert lobe: many closed forms know no other.
pub fn lambert(mut work: Work) -> Work {
    work.features.specular = false;
    work
}

/// Makes each function that takes an engine two tests.
macro_rules! on_both_engines {
    ($($test:ident,)*) => {
        mod gpu {
            $(#[test] fn $test() { super::$test(candela::params::EngineChoice::Gpu); })*
        }
        mod cpu {
            $(#[test] fn $test() { super::$test(candela::params::EngineChoice::Cpu); })*
        }
    };
}

/// Renders to the end.
pub fn render(engine: EngineChoice, mut work: Work) -> Picture {
    work.settings.engine = engine;
    let rendered = render_to_end(&mut *engines(), work, &mut |_| {}).expect("a render");
    assert_eq!(rendered.non_finite, NonFinite::default(), "non-finite samples");
    rendered.film.picture()
}

/// Mean of a channel over the picture.
pub fn mean(picture: &Picture, channel: usize) -> f64 {
    picture.pixels.iter().map(|p| f64::from(p[channel])).sum::<f64>() / picture.pixels.len() as f64
}

/// Asserts a relative difference of at most `tolerance`.
#[track_caller]
pub fn assert_near(got: f64, expected: f64, tolerance: f64) {
    assert!((got - expected).abs() <= tolerance * expected.abs(), "{got} for {expected}, tolerance {tolerance}");
}

/// Parameters from JSON, over those that suit tests: a small square picture, box filter, no environment.
pub fn params(json: &str) -> RenderParams {
    let base = r#"{"width":32,"height":32,"environment":null,"filter":{"kind":"box"},"max_samples":64}"#;
    let mut value: serde_json::Value = serde_json::from_str(base).expect("JSON");
    let over: serde_json::Value = serde_json::from_str(json).expect("JSON");
    let (Some(value_map), serde_json::Value::Object(over)) = (value.as_object_mut(), over) else { panic!("objects") };
    value_map.extend(over);
    serde_json::from_value(value).expect("parameters")
}
