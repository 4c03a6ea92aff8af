//! What shines, what is skipped, and what is chosen when nothing does.

use super::{scene, triangle, triangle_with};
use crate::compile::{
    CompileError, CompiledScene, EnvironmentKind, Lens, LightFiles, Lighting, PunctualKind, compile_scene, features,
    light, view,
};
use crate::params::{EnvironmentChoice, EnvironmentParams, LightParams, Mode, RenderParams};
use crate::scene::{Extended, Light, LightKind, Material, Node, Profile, Scene};
use glam::{DAffine3, DVec3, Vec3};
use std::sync::Arc;

fn point(position: [f64; 3], intensity: f32, range: Option<f32>) -> LightParams {
    LightParams::Point { position, direction: None, color: [1.0; 3], intensity, range, profile: None }
}

fn lit(scene: &Scene, params: &RenderParams) -> (CompiledScene, Lighting, usize) {
    let compiled = compile_scene(scene, None).unwrap();
    let lit = light(scene, &compiled, params, LightFiles::default()).unwrap();
    (compiled, lit.lighting, lit.defaults.len())
}

fn glowing() -> Scene {
    triangle_with(Material { emissive: Vec3::ONE, ..Material::default() })
}

#[test]
fn picks_hold_lights_then_emitters_with_their_probabilities() {
    let params = RenderParams {
        lights: vec![point([0.0, 0.0, 2.0], 10.0, None), point([0.0, 0.0, 1e6], 1e-6, None)],
        ..RenderParams::default()
    };
    let (compiled, lighting, _) = lit(&glowing(), &params);
    assert_eq!((lighting.lights.len(), lighting.picks.len()), (2, 3));
    let sum: f64 = lighting.picks.iter().map(|pick| f64::from(pick.probability)).sum();
    assert!((sum - 1.0).abs() < 1e-6);
    assert!(lighting.picks.iter().all(|pick| pick.probability > 0.03), "none is starved");
    assert!(lighting.picks[0].probability > lighting.picks[1].probability);
    assert_eq!((lighting.picks[0].area, lighting.picks[1].index), (0.0, 1));
    assert_eq!((lighting.picks[2].area, lighting.picks[2].triangle), (0.5, 0));
    let position = Vec3::from(lighting.lights[0].position).as_dvec3() + compiled.origin;
    assert!(position.distance(DVec3::new(0.0, 0.0, 2.0)) < 1e-6);
}

#[test]
fn direct_mode_picks_punctual_lights_alone() {
    let lights = vec![point([0.0, 0.0, 2.0], 10.0, None)];
    let params = RenderParams { lights, mode: Mode::Direct, ..RenderParams::default() };
    let (_, lighting, _) = lit(&glowing(), &params);
    assert_eq!((lighting.picks.len(), lighting.environment_probability), (1, 0.0));
}

#[test]
fn lights_without_power_or_out_of_range_are_skipped() {
    let lights = vec![
        point([0.0, 0.0, 2.0], 0.0, None),
        point([0.0, 0.0, 2.0], 1.0, Some(1.9)),
        point([0.0, 0.0, 2.0], 1.0, Some(2.1)),
    ];
    let (_, lighting, _) = lit(&glowing(), &RenderParams { lights, ..RenderParams::default() });
    assert_eq!((lighting.lights.len(), lighting.skipped), (1, 2));
}

#[test]
fn neutral_light_comes_only_when_nothing_shines() {
    let dark = triangle_with(Material::default());
    let (_, lighting, defaults) = lit(&dark, &RenderParams::default());
    assert!(matches!(lighting.environment.kind, EnvironmentKind::Gradient { top, bottom, .. } if top.y > bottom.y));
    assert_eq!((lighting.environment_probability, defaults), (0.0, 1));
    let (_, lighting, _) = lit(&glowing(), &RenderParams::default());
    assert!(
        matches!(lighting.environment.kind, EnvironmentKind::Gradient { .. }),
        "what glows lights nothing but itself"
    );
    assert_eq!((lighting.environment_probability, lighting.picks.len()), (0.0, 1));
    let direct = RenderParams { mode: Mode::Direct, ..RenderParams::default() };
    let (_, lighting, _) = lit(&glowing(), &direct);
    assert_eq!((lighting.lights.len(), lighting.picks.len()), (1, 1));
    let none = RenderParams { environment: EnvironmentChoice::None, ..RenderParams::default() };
    let (_, lighting, defaults) = lit(&dark, &none);
    assert!(matches!(lighting.environment.kind, EnvironmentKind::None) && lighting.picks.is_empty() && defaults == 0);
    let ambient = vec![LightParams::Ambient { color: [1.0, 0.5, 0.25], intensity: 2.0 }];
    let (_, lighting, _) = lit(&dark, &RenderParams { lights: ambient, ..RenderParams::default() });
    assert_eq!((lighting.environment.ambient, lighting.environment_probability), (Vec3::new(2.0, 1.0, 0.5), 0.0));
    assert!(matches!(lighting.environment.kind, EnvironmentKind::None));
}

#[test]
fn lights_of_the_file_that_are_too_dim_do_not_take_the_sky_away() {
    let with = |intensity: f32, kind| {
        let mut source = triangle_with(Material { double_sided: true, ..Material::default() });
        source.lights.push(Light { name: None, intensity: Vec3::splat(intensity), range: None, kind, profile: None });
        let local = DAffine3::from_translation(DVec3::new(0.0, 0.0, 1.0));
        source.nodes.push(Node { light: Some(0), local, ..Node::default() });
        let light_node = source.nodes.len() - 1;
        source.scenes[0].nodes.push(light_node);
        let (_, lighting, _) = lit(&source, &RenderParams::default());
        assert_eq!(lighting.lights.len(), 1, "it shines all the same");
        matches!(lighting.environment.kind, EnvironmentKind::Gradient { .. })
    };
    assert!(with(1e-3, LightKind::Point) && with(1e-3, LightKind::Directional));
    assert!(!with(10.0, LightKind::Point) && !with(1.0, LightKind::Directional));
    // Lights of the request are meant as they are.
    let dim = RenderParams { lights: vec![point([0.0, 0.0, 1.0], 1e-3, None)], ..RenderParams::default() };
    assert!(matches!(lit(&glowing(), &dim).1.environment.kind, EnvironmentKind::None));
}

#[test]
fn lights_of_the_file_stand_where_their_node_does() {
    let mut source = scene(vec![super::mesh(triangle())], &[(0, DAffine3::IDENTITY)]);
    let kind = LightKind::Spot { inner_cone: 0.1, outer_cone: 0.5 };
    source.lights.push(Light { name: None, intensity: Vec3::splat(5.0), range: None, kind, profile: None });
    let local = DAffine3::from_translation(DVec3::new(0.0, 3.0, 0.0))
        * DAffine3::from_rotation_x(-std::f64::consts::FRAC_PI_2)
        * DAffine3::from_scale(DVec3::splat(7.0));
    source.nodes.push(Node { light: Some(0), local, ..Node::default() });
    source.scenes[0].nodes.push(1);
    let (compiled, lighting, _) = lit(&source, &RenderParams::default());
    let light = lighting.lights[0];
    assert_eq!(light.kind, PunctualKind::Spot as u32);
    assert!(Vec3::from(light.direction).distance(Vec3::NEG_Y) < 1e-6);
    let position = Vec3::from(light.position).as_dvec3() + compiled.origin;
    assert!(position.distance(DVec3::new(0.0, 3.0, 0.0)) < 1e-6);
    assert!((light.inner - 0.1_f32.cos()).abs() < 1e-6 && light.range.is_infinite());
    let off = RenderParams { scene_lights: false, ..RenderParams::default() };
    assert!(lit(&source, &off).1.lights.is_empty());
}

/// A beam that misses the scene gets the floor's share alone; one that meets it is worth what it sends there.
#[test]
fn power_is_that_of_the_profile() {
    let source = triangle_with(Material::default());
    let text = "IES:LM-63-2019\nTILT=NONE\n1 -1 1 4 1 1 2 0 0 0 1 1 9\n0 20 21 180\n0\n100 100 0 0\n";
    let profile = Arc::new(Profile::read(text.as_bytes()).unwrap());
    let lights = ["[0, -1, 0]", "[0, 1, 0]"].map(|direction| {
        format!(r#"{{"type": "point", "position": [0, 9, 0], "direction": {direction}, "ies": "a"}}"#)
    });
    let plain = r#"{"type": "point", "position": [0, 9, 0], "intensity": 100}"#;
    let json = format!(r#"{{"lights": [{}, {}, {plain}]}}"#, lights[0], lights[1]);
    let params = crate::params::from_json(&json).unwrap();
    let compiled = compile_scene(&source, None).unwrap();
    let files = LightFiles { hdri: None, profiles: [("a".to_owned(), profile)].into() };
    let lighting = light(&source, &compiled, &params, files).unwrap().lighting;
    assert_eq!((lighting.profiles.len(), lighting.lights[1].profile()), (1, Some(0)));
    let [down, up, point] = [0, 1, 2].map(|index| lighting.picks[index].probability);
    assert!((down / point - 1.0).abs() < 1e-3, "{down} and {point} send the same");
    assert!((up - 0.1 / 3.0).abs() < 1e-6, "{up}");
    match light(&source, &compiled, &params, LightFiles::default()) {
        Err(CompileError::Params(error)) => assert_eq!(error.pointer, "/params/lights/0/ies"),
        other => panic!("{other:?}"),
    }
}

#[test]
fn environments_are_checked() {
    let source = glowing();
    let compiled = compile_scene(&source, None).unwrap();
    let pointer = |given: EnvironmentParams| {
        let params = RenderParams { environment: EnvironmentChoice::Given(given), ..RenderParams::default() };
        match light(&source, &compiled, &params, LightFiles::default()) {
            Err(CompileError::Params(error)) => error.pointer,
            other => panic!("{other:?}"),
        }
    };
    let named = EnvironmentParams { hdri: Some("sky.hdr".into()), ..EnvironmentParams::default() };
    assert_eq!(pointer(named.clone()), "/params/environment/hdri");
    assert_eq!(pointer(EnvironmentParams::default()), "/params/environment");
    assert_eq!(pointer(EnvironmentParams { constant: Some([1.0; 3]), ..named }), "/params/environment");
}

#[test]
fn features_follow_from_what_is_there() {
    let of = |source: &Scene, params: &RenderParams| {
        let (compiled, lighting, _) = lit(source, params);
        let (view, _) = view(source, &compiled, params).unwrap();
        assert!(matches!(view.lens, Lens::Perspective { .. }));
        features(&compiled, &lighting, &view, params)
    };
    let plain = of(&triangle_with(Material::default()), &RenderParams::default());
    assert!(plain.normals && plain.one_sided && plain.specular && plain.environment == 2);
    assert!(!(plain.two_level || plain.alpha || plain.mirror || plain.punctual || plain.emitters || plain.thin_lens));
    let mirror = Material { roughness: 0.0, double_sided: true, ..Material::default() };
    let mirror = of(&triangle_with(mirror), &RenderParams::default());
    assert!(mirror.mirror && !mirror.one_sided);
    let unlit =
        of(&triangle_with(Material { unlit: true, roughness: 0.0, ..Material::default() }), &RenderParams::default());
    assert!(unlit.unlit && !unlit.specular && !unlit.mirror);
    let extended = |specular| Some(Arc::new(Extended { specular, ..Extended::default() }));
    let matte =
        |specular| triangle_with(Material { extended: extended(specular), metallic: 0.0, ..Material::default() });
    assert!(!of(&matte(0.0), &RenderParams::default()).specular && of(&matte(0.1), &RenderParams::default()).specular);
    let direct = RenderParams { mode: Mode::Direct, ..RenderParams::default() };
    let direct = of(&glowing(), &direct);
    assert!(direct.punctual && !direct.emitters && direct.environment == 1);
    assert!(of(&glowing(), &RenderParams::default()).emitters);
}
