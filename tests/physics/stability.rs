//! Numbers at their limits: far away, tiny and huge, thin and doubled. `CANDELA_LONG=24` takes 24 times as many rays in closed meshes,
//! 1e8 each, and any number larger pictures.

use crate::support::{engines, grey, params, render, scene, sphere, square, work, work_with_hdri};
use candela::bench::agreement::{Size, compare};
use candela::compile::Hdri;
use candela::params::{EngineChoice, RenderParams};
use candela::render::Work;
use candela::scene::{AlphaMode, Material, Primitive, Scene};
use glam::{DAffine3, DQuat, DVec3, Vec3, Vec4};
use std::sync::Arc;

on_both_engines! {
    no_ray_leaves_a_closed_mesh,
    pictures_do_not_depend_on_scale,
    pictures_do_not_depend_on_place,
    mirrored_scenes_give_mirrored_pictures,
    split_triangles_draw_the_same,
    instances_in_another_order_draw_the_same,
}

/// Where a survey's coordinates may lie.
const FAR: Vec3 = Vec3::new(148_376.0, 1234.0, -223_423.0);

/// How many times as many rays are asked for.
fn factor() -> u32 {
    std::env::var("CANDELA_LONG").ok().and_then(|text| text.parse().ok()).unwrap_or(1)
}

fn long() -> bool {
    factor() > 1
}

/// Inside a closed white mesh there is no light, however bright the sky outside.
fn no_ray_leaves_a_closed_mesh(engine: EngineChoice) {
    const BOUNCES: u32 = 15;
    let samples = 64 * factor();
    let meshes = [
        ("sphere", sphere(24)),
        ("box", room(&[-1.0, 1.0])),
        ("box of slivers", room(&[-1.0, -0.999, -0.99, 0.0, 0.001, 0.002, 1.0])),
        ("needles", needles()),
    ];
    for (name, mesh) in meshes {
        for place in [Vec3::ZERO, FAR] {
            let mut mesh = mesh.clone();
            mesh.normals = None;
            mesh.positions.iter_mut().for_each(|p| *p += place);
            let material = Material { double_sided: true, ..grey(1.0, 1.0, 0.0) };
            let scene = scene(vec![(mesh, material, DAffine3::IDENTITY)]);
            let mut params =
                params(r#"{"environment":{"constant":[1,1,1]},"width":64,"height":64,"filter":{"kind":"box"}}"#);
            params.max_bounces = Some(BOUNCES);
            params.max_samples = samples;
            params.camera = serde_json::from_value(serde_json::json!({
                "position": [place.x + 0.25, place.y + 0.125, place.z - 0.125], "target": [place.x, place.y + 0.125, place.z + 1.0],
                "yfov_degrees": 120
            }))
            .expect("a camera");
            let picture = render(engine, lit_from_behind(work(&scene, &params)));
            let rays = 64.0 * 64.0 * f64::from(samples) * f64::from(BOUNCES + 1);
            let leaks = picture.pixels.iter().filter(|p| p[0] > 0.0).count();
            eprintln!("{engine:?}, {name} at {place}: light in {leaks} pixels of {rays:.1e} rays");
            assert_eq!(leaks, 0, "{engine:?}: light leaks into a {name} at {place}");
        }
    }
}

/// Paths long enough to be worth it: no chance ends them, for white reflects all.
fn lit_from_behind(mut work: Work) -> Work {
    work.features.specular = false;
    work
}

/// A closed cube of side 2, turned, cut along the same planes on all axes: the more cuts, the thinner.
fn room(cuts: &[f32]) -> Primitive {
    let mut primitive = Primitive::default();
    let turned = |p: Vec3| glam::Quat::from_scaled_axis(Vec3::new(0.3, 0.5, 0.7)) * p;
    for (u, v) in [(Vec3::X, Vec3::Y), (Vec3::Y, Vec3::Z), (Vec3::Z, Vec3::X)] {
        for w in [u.cross(v), v.cross(u)] {
            for (across, up) in cuts.windows(2).flat_map(|a| cuts.windows(2).map(move |b| (a, b))) {
                let first = primitive.positions.len() as u32;
                let corners = [(across[0], up[0]), (across[1], up[0]), (across[1], up[1]), (across[0], up[1])];
                primitive.positions.extend(corners.map(|(a, b)| turned(a * u + b * v + w)));
                primitive.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
            }
        }
    }
    primitive
}

/// A closed double cone of 400 long thin triangles.
fn needles() -> Primitive {
    let count = 200;
    let mut primitive = Primitive { positions: vec![Vec3::Y * 3.0, -Vec3::Y * 3.0], ..Primitive::default() };
    for i in 0..count {
        let angle = std::f32::consts::TAU * i as f32 / count as f32;
        primitive.positions.push(Vec3::new(1.5 * angle.cos(), 0.0, 1.5 * angle.sin()));
        let (a, b) = (2 + i, 2 + (i + 1) % count);
        primitive.triangles.extend([[0, b, a], [1, a, b]]);
    }
    primitive
}

/// A glossy ball, a metal one and a lamp on a floor, moved and scaled together with what looks at it.
fn table(place: DAffine3) -> Scene {
    let lamp = Material { emissive: Vec3::new(8.0, 6.0, 4.0), double_sided: true, ..grey(0.0, 1.0, 0.0) };
    let at = |x: f64, y: f64, z: f64, size: f64| {
        place * DAffine3::from_scale_rotation_translation(DVec3::splat(size), DQuat::IDENTITY, DVec3::new(x, y, z))
    };
    scene(vec![
        (square(4.0), grey(0.6, 0.8, 0.0), at(0.0, 0.0, 0.0, 1.0)),
        (sphere(16), grey(0.9, 0.3, 1.0), at(-0.8, 0.7, 0.0, 0.7)),
        (sphere(16), grey(0.5, 0.4, 0.0), at(0.8, 0.7, 0.2, 0.7)),
        (square(0.4), lamp, at(0.0, 2.5, 0.0, 1.0)),
    ])
}

fn view(place: DAffine3) -> RenderParams {
    let mut params = params(r#"{"environment":{"constant":[0.2,0.3,0.4]},"filter":{"kind":"box"}}"#);
    let (eye, target) =
        (place.transform_point3(DVec3::new(0.5, 2.0, 5.0)), place.transform_point3(DVec3::new(0.0, 0.6, 0.0)));
    let up = place.transform_vector3(DVec3::Y).normalize();
    params.camera = serde_json::from_value(serde_json::json!({
        "position": eye.to_array(), "target": target.to_array(), "up": up.to_array(), "yfov_degrees": 35
    }))
    .expect("a camera");
    params
}

/// Asserts that two scenes give the same picture but for noise.
#[track_caller]
fn assert_same(engine: EngineChoice, what: &str, works: [Work; 2]) {
    let size =
        if long() { Size { side: 32, samples: 256, batches: 32 } } else { Size { side: 16, samples: 64, batches: 8 } };
    let works = works.map(|mut work| {
        (work.view.width, work.view.height, work.settings.max_samples) = (size.side, size.side, size.samples);
        work.settings.engine = engine;
        work
    });
    let verdict = compare(&mut engines(), works, size).expect("renders");
    eprintln!("{engine:?}, {what}: {verdict:.3?}");
    assert!(verdict.agrees(), "{engine:?}, {what}: {verdict:?}");
}

fn placed(place: DAffine3) -> Work {
    work(&table(place), &view(place))
}

fn pictures_do_not_depend_on_scale(engine: EngineChoice) {
    for scale in [1e-4, 1e-2, 1e2, 1e4] {
        let scaled = placed(DAffine3::from_scale(DVec3::splat(scale)));
        assert_same(engine, &format!("scaled by {scale}"), [placed(DAffine3::IDENTITY), scaled]);
    }
}

fn pictures_do_not_depend_on_place(engine: EngineChoice) {
    for place in [DVec3::new(1e6, -1e6, 1e6), FAR.as_dvec3()] {
        let moved = placed(DAffine3::from_translation(place));
        assert_same(engine, &format!("moved to {place}"), [placed(DAffine3::IDENTITY), moved]);
    }
}

fn mirrored_scenes_give_mirrored_pictures(engine: EngineChoice) {
    // Turned half about +y and mirrored in x: the same as mirrored in z, which the camera cannot tell after turning back.
    let mirror = DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0));
    let mirrored = work(&table(mirror), &view(mirror));
    let mean = |work: Work| {
        let picture = render(engine, work);
        let (width, pixels) = (picture.width as usize, picture.pixels);
        let row = |half: usize| -> f64 {
            let in_half = |index: &usize| (index % width >= width / 2) == (half == 1);
            (0..pixels.len()).filter(in_half).map(|index| f64::from(pixels[index][1])).sum()
        };
        [row(0), row(1)]
    };
    let [left, right] = mean(placed(DAffine3::IDENTITY));
    let [mirrored_left, mirrored_right] = mean(mirrored);
    assert!((left / mirrored_right - 1.0).abs() < 0.01 && (right / mirrored_left - 1.0).abs() < 0.01);
}

fn split_triangles_draw_the_same(engine: EngineChoice) {
    let mut fine = table(DAffine3::IDENTITY);
    for primitive in Arc::make_mut(&mut fine.meshes).iter_mut().flat_map(|mesh| &mut mesh.primitives) {
        split(primitive);
    }
    assert_same(engine, "split", [placed(DAffine3::IDENTITY), work(&fine, &view(DAffine3::IDENTITY))]);
}

/// Each triangle in four.
fn split(primitive: &mut Primitive) {
    let mut triangles = Vec::new();
    for [a, b, c] in std::mem::take(&mut primitive.triangles) {
        let mut middle = |i: u32, j: u32| {
            let index = primitive.positions.len() as u32;
            let (i, j) = (i as usize, j as usize);
            primitive.positions.push(0.5 * (primitive.positions[i] + primitive.positions[j]));
            if let Some(normals) = &mut primitive.normals {
                normals.push(0.5 * (normals[i] + normals[j]));
            }
            index
        };
        let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
        triangles.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
    }
    primitive.triangles = triangles;
}

fn instances_in_another_order_draw_the_same(engine: EngineChoice) {
    // The balls share a mesh, so that there are instances.
    let instanced = |reverse: bool| {
        let mut scene = table(DAffine3::IDENTITY);
        scene.nodes[2].mesh = scene.nodes[1].mesh;
        if reverse {
            scene.scenes[0].nodes.reverse();
        }
        work(&scene, &view(DAffine3::IDENTITY))
    };
    assert_same(engine, "re-ordered", [instanced(false), instanced(true)]);
}

/// A scene to trip over, by name.
fn obstacles() -> Vec<(&'static str, Work)> {
    let view = view(DAffine3::IDENTITY);
    let on_table = |part: Primitive, material: Material, y: f64| {
        let mut scene = table(DAffine3::IDENTITY);
        let place = DAffine3::from_translation(DVec3::new(0.0, y, 1.0));
        scene.nodes.push(candela::scene::Node { mesh: Some(scene.meshes.len()), local: place, ..Default::default() });
        scene.scenes[0].nodes.push(scene.nodes.len() - 1);
        Arc::make_mut(&mut scene.meshes).push(candela::scene::Mesh {
            name: None,
            primitives: vec![Primitive { material: Some(scene.materials.len()), ..part }],
        });
        scene.materials.push(material);
        scene
    };
    let of = |scene: &Scene, json: &str| {
        let mut value = serde_json::to_value(&view).expect("JSON");
        let over: serde_json::Value = serde_json::from_str(json).expect("JSON");
        value.as_object_mut().expect("an object").extend(over.as_object().expect("an object").clone());
        work(scene, &serde_json::from_value(value).expect("parameters"))
    };
    let glass_plate =
        Material { alpha_mode: AlphaMode::Blend, base_color: Vec4::new(0.5, 0.5, 0.5, 0.5), ..Material::default() };
    let mut doubled = sphere(12);
    doubled.triangles.extend(doubled.triangles.clone());
    let mut flat = sphere(12);
    flat.positions.iter_mut().for_each(|p| p.y *= 1e-6);
    let mut sliver = Primitive { positions: vec![], ..Primitive::default() };
    for i in 0..200u32 {
        let x = -1.0 + i as f32 * 0.01;
        sliver.positions.extend([Vec3::new(x, 0.0, 0.0), Vec3::new(x + 1e-6, 0.5, 0.0), Vec3::new(x, 1.0, 0.0)]);
        sliver.triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
    }
    let mut pointless = sphere(12);
    pointless.triangles.extend((0..100).map(|i| [i, i, i + 1]));
    pointless.tangents = Some(vec![Vec4::new(0.0, 0.0, 0.0, 1.0); pointless.positions.len()]);
    let plain = table(DAffine3::IDENTITY);
    vec![
        ("slivers", of(&on_table(sliver, grey(0.5, 0.5, 0.0), 0.1), "{}")),
        ("triangles of no area, tangents of no length", of(&on_table(pointless, grey(0.5, 0.5, 0.0), 0.5), "{}")),
        ("every triangle twice", of(&on_table(doubled, grey(0.5, 0.5, 0.0), 0.5), "{}")),
        ("flattened to a millionth", of(&on_table(flat, grey(0.5, 0.5, 0.0), 0.5), "{}")),
        ("a second floor in the floor", of(&on_table(square(1.0), grey(0.6, 0.8, 0.0), 0.0), "{}")),
        ("blended plate", of(&on_table(square(1.0), glass_plate, 0.5), "{}")),
        ("roughness 0, metal", of(&on_table(sphere(12), grey(0.9, 0.0, 1.0), 0.5), "{}")),
        ("roughness 1e-4", of(&on_table(sphere(12), grey(0.9, 1e-4, 0.5), 0.5), "{}")),
        ("roughness 0.0101", of(&on_table(sphere(12), grey(0.9, 0.0101, 0.0), 0.5), "{}")),
        ("black metal", of(&on_table(sphere(12), grey(0.0, 0.5, 1.0), 0.5), "{}")),
        ("white in a white mesh", of(&on_table(sphere(12), grey(1.0, 1.0, 0.0), 0.5), "{}")),
        ("grazing sun", of(&plain, r#"{"lights":[{"type":"directional","direction":[1,-0.0001,0],"intensity":3}]}"#)),
        ("sun in the plane", of(&plain, r#"{"lights":[{"type":"directional","direction":[1,0,0],"intensity":3}]}"#)),
        ("light inside a ball", of(&plain, r#"{"lights":[{"type":"point","position":[0.8,0.7,0.2],"intensity":30}]}"#)),
        (
            "light a hair above the floor",
            of(&plain, r#"{"lights":[{"type":"point","position":[0,0.001,1],"intensity":0.01}]}"#),
        ),
        (
            "a lighthouse beside a glow-worm",
            of(
                &plain,
                r#"{"lights":[{"type":"point","position":[50,80,0],"intensity":1e6},
                              {"type":"point","position":[0,0.5,1],"intensity":1e-6}]}"#,
            ),
        ),
        ("sun of an HDRI, 1e5 to 1", work_with_hdri(&plain, &hdri_view(), Some(sun_and_sky()))),
    ]
}

fn hdri_view() -> RenderParams {
    let mut params = view(DAffine3::IDENTITY);
    params.environment = serde_json::from_value(serde_json::json!({"hdri": "sun.hdr"})).expect("an environment");
    params
}

fn sun_and_sky() -> Arc<Hdri> {
    let texel = |index: u32| if index == 20 * 128 + 40 { [1e5; 3] } else { [0.5, 0.7, 1.0] };
    Arc::new(Hdri::new(128, 64, (0..128 * 64).map(texel).collect()))
}

/// Whatever lies in the way, no sample is lost to NaN or infinity, and both engines see the same.
#[test]
fn engines_agree_on_what_trips_others() {
    for (name, work) in obstacles() {
        let of = |engine| {
            let mut work = work.clone();
            work.settings.engine = engine;
            work
        };
        let size = if long() {
            Size { side: 48, samples: 256, batches: 32 }
        } else {
            Size { side: 16, samples: 64, batches: 8 }
        };
        let works = [EngineChoice::Gpu, EngineChoice::Cpu].map(|engine| {
            let mut work = of(engine);
            (work.view.width, work.view.height, work.settings.max_samples) = (size.side, size.side, size.samples);
            work
        });
        let verdict = compare(&mut engines(), works, size).expect("renders");
        eprintln!("{name}: {verdict:.3?}");
        assert!(verdict.agrees(), "{name}: {verdict:?}");
    }
}

/// The comparison notices when one lobe loses a hundredth of its energy.
#[test]
fn a_hundredth_of_a_lobe_is_missed() {
    let size = Size { side: 16, samples: 512, batches: 8 };
    let base = |albedo: f32, metallic: f32| {
        let scene = scene(vec![(sphere(32), grey(albedo, 0.5, metallic), DAffine3::IDENTITY)]);
        let mut params = params(
            r#"{"environment":{"constant":[1,1,1]},"width":16,"height":16,"filter":{"kind":"box"},
                "camera":{"position":[0,0,4],"target":[0,0,0],"yfov_degrees":20}}"#,
        );
        params.max_samples = size.samples;
        work(&scene, &params)
    };
    for metallic in [0.0, 1.0] {
        let engine = |mut work: Work, engine| {
            work.settings.engine = engine;
            work
        };
        let same = [engine(base(0.8, metallic), EngineChoice::Gpu), engine(base(0.8, metallic), EngineChoice::Cpu)];
        let less = [engine(base(0.8, metallic), EngineChoice::Gpu), engine(base(0.792, metallic), EngineChoice::Cpu)];
        let [same, less] = [same, less].map(|works| compare(&mut engines(), works, size).expect("renders"));
        eprintln!("metallic {metallic}: same {same:.3?}; one hundredth less {less:.3?}");
        assert!(same.agrees(), "{same:?}");
        assert!(less.passed < 0.9975, "{less:?}");
    }
}
