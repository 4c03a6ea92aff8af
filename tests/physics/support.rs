//! Small scenes built in place, and a render to the end.

use candela::compile::{self, CompiledScene};
use candela::film::Film;
use candela::params::RenderParams;
use candela::render::gpu::GpuEngine;
use candela::render::{Engine, Settings, Work};
use candela::scene::{Material, Mesh, Node, Primitive, Scene, SceneRoot};
use glam::{DAffine3, Vec3};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock};
use std::time::Duration;

/// The one engine of this test binary; tests take turns.
pub fn engine() -> MutexGuard<'static, GpuEngine> {
    static ENGINE: OnceLock<Mutex<GpuEngine>> = OnceLock::new();
    ENGINE
        .get_or_init(|| Mutex::new(GpuEngine::new().expect("an adapter; script/test installs lavapipe")))
        .lock()
        .unwrap_or_else(std::sync::PoisonError::into_inner)
}

/// A scene of placed primitives, each with its material.
pub fn scene(parts: Vec<(Primitive, Material, DAffine3)>) -> Scene {
    let mut scene = Scene::default();
    let mut root = SceneRoot::default();
    for (index, (mut primitive, material, local)) in parts.into_iter().enumerate() {
        primitive.material = Some(index);
        scene.materials.push(material);
        scene.meshes.push(Mesh { name: None, primitives: vec![primitive] });
        scene.nodes.push(Node { mesh: Some(index), local, ..Node::default() });
        root.nodes.push(index);
    }
    scene.scenes.push(root);
    scene
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
pub fn prepare(scene: &Scene, params: &RenderParams) -> Work {
    let compiled = compile::compile_scene(scene, params.scene).expect("a scene that compiles");
    prepare_compiled(scene, compiled, params)
}

/// The same with a compiled scene that the test has altered.
pub fn prepare_compiled(scene: &Scene, compiled: CompiledScene, params: &RenderParams) -> Work {
    let (lighting, _) = compile::light(scene, &compiled, params, None).expect("light");
    let (view, _) = compile::view(scene, &compiled, params).expect("a view");
    let features = compile::features(&compiled, &lighting, &view, params);
    let settings = Settings {
        mode: params.mode,
        max_bounces: params.max_bounces,
        multiple_scattering: params.multiple_scattering,
        seed: params.seed,
        max_samples: params.max_samples,
        target_error: params.target_error,
        deadline: params.deadline_ms.map(Duration::from_millis),
    };
    Work { scene: Arc::new(compiled), lighting: Arc::new(lighting), view, features, settings }
}

/// Renders to the end.
pub fn render(work: Work) -> Film {
    let mut engine = engine();
    let mut render = engine.begin(work, None).expect("a render");
    while render.step().expect("a slice").is_none() {}
    assert_eq!(render.non_finite(), candela::render::NonFinite::default(), "non-finite samples");
    render.into_film()
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
