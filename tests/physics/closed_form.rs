//! Scenes whose radiance is known.

use crate::support::{assert_near, grey, lambert, mean, params, render, scene, sphere, square, work, work_with_hdri};
use candela::compile::Hdri;
use candela::params::EngineChoice;
use candela::scene::{AlphaMode, Material};
use glam::{DAffine3, DVec3, Vec3, Vec4};
use std::f64::consts::PI;
use std::sync::Arc;

on_both_engines! {
    white_sphere_vanishes_in_a_white_sky,
    point_light_over_a_plane,
    spot_over_a_plane,
    grazing_sun,
    square_lamp_over_a_plane,
    closed_furnace,
    rough_metal_matches_the_formula,
    plane_under_an_hdri,
    a_sun_of_1e5_in_an_hdri_converges,
    blend_is_coverage,
}

/// A white sphere in a constant sky of radiance 1 must be invisible, whatever its roughness and metalness.
fn white_sphere_vanishes_in_a_white_sky(engine: EngineChoice) {
    for metallic in [0.0, 0.5, 1.0] {
        for roughness in [0.0, 0.1, 0.3, 0.6, 1.0] {
            let scene = scene(vec![(sphere(64), grey(1.0, roughness, metallic), DAffine3::IDENTITY)]);
            let params = params(
                r#"{"environment":{"constant":[1,1,1]},"max_samples":256,
                    "camera":{"position":[0,0,4],"target":[0,0,0],"yfov_degrees":20}}"#,
            );
            assert_near(mean(&render(engine, work(&scene, &params)), 1), 1.0, 1e-3);
        }
    }
}

/// A point light over a diffuse plane: radiance = albedo / pi * I cos / d^2, at the size of a room, an atom, a planet.
fn point_light_over_a_plane(engine: EngineChoice) {
    for scale in [1.0, 1e-4, 1e4] {
        let scene = scene(vec![(square(10.0 * scale as f32), grey(1.0, 1.0, 0.0), DAffine3::IDENTITY)]);
        let params = params(&format!(
            r#"{{"lights":[{{"type":"point","position":[{},{},{}],"intensity":{}}}],"max_bounces":1,
                "camera":{{"position":[0,{},0],"target":[0,0,0],"up":[0,0,-1],"yfov_degrees":40}}}}"#,
            0.3 * scale,
            2.0 * scale,
            -0.2 * scale,
            10.0 * scale * scale,
            5.0 * scale
        ));
        let picture = render(engine, lambert(work(&scene, &params)));
        let half = (20.0f64.to_radians()).tan() * 5.0;
        for (index, pixel) in picture.pixels.iter().enumerate() {
            let (x, y) = ((index % 32) as f64, (index / 32) as f64);
            let expected = pixel_mean(|u, v| {
                let px = ((x + u) / 16.0 - 1.0) * half - 0.3;
                let pz = ((y + v) / 16.0 - 1.0) * half + 0.2;
                let d2 = px * px + pz * pz + 4.0;
                10.0 * 2.0 / d2.powf(1.5) / PI
            });
            assert_near(f64::from(pixel[0]), expected, 2e-3);
        }
    }
}

/// A spot with a range over a diffuse plane, with both curves between its cones (KHR_lights_punctual; linear in the angle).
fn spot_over_a_plane(engine: EngineChoice) {
    for falloff in ["gltf", "linear"] {
        let scene = scene(vec![(square(10.0), grey(1.0, 1.0, 0.0), DAffine3::IDENTITY)]);
        let params = params(&format!(
            r#"{{"lights":[{{"type":"spot","position":[0,2,0],"direction":[0,-1,0],"intensity":10,"range":3,
                "inner_cone_degrees":20,"outer_cone_degrees":35,"falloff":"{falloff}"}}],"max_bounces":1,
                "max_samples":256,"camera":{{"position":[0,5,0],"target":[0,0,0],"up":[0,0,-1],"yfov_degrees":40}}}}"#
        ));
        let picture = render(engine, lambert(work(&scene, &params)));
        let half = (20.0f64.to_radians()).tan() * 5.0;
        let (inner, outer) = (20f64.to_radians(), 35f64.to_radians());
        for (index, pixel) in picture.pixels.iter().enumerate() {
            let (x, y) = ((index % 32) as f64, (index / 32) as f64);
            let expected = pixel_mean(|u, v| {
                let (px, pz) = (((x + u) / 16.0 - 1.0) * half, ((y + v) / 16.0 - 1.0) * half);
                let d2 = px * px + pz * pz + 4.0;
                let cosine = 2.0 / d2.sqrt();
                let cone = if falloff == "gltf" {
                    ((cosine - outer.cos()) / (inner.cos() - outer.cos())).clamp(0.0, 1.0).powi(2)
                } else {
                    ((outer - cosine.acos()) / (outer - inner)).clamp(0.0, 1.0)
                };
                let window = (1.0 - (d2 / 9.0).powi(2)).clamp(0.0, 1.0);
                10.0 * cone * window / d2 * cosine / PI
            });
            let got = f64::from(pixel[0]);
            assert!((got - expected).abs() < 2e-3, "{falloff}, pixel {index}: {got} for {expected}");
        }
    }
}

/// A sun at 1 degree above the horizon: radiance = albedo / pi * E sin(elevation).
fn grazing_sun(engine: EngineChoice) {
    let scene = scene(vec![(square(10.0), grey(0.8, 1.0, 0.0), DAffine3::IDENTITY)]);
    let (sin, cos) = 1f64.to_radians().sin_cos();
    let params = params(&format!(
        r#"{{"lights":[{{"type":"directional","direction":[{},{},0],"intensity":3}}],"max_bounces":1,
            "camera":{{"position":[0,5,0],"target":[0,0,0],"up":[0,0,-1]}}}}"#,
        -cos, -sin
    ));
    assert_near(mean(&render(engine, lambert(work(&scene, &params))), 0), 0.8 / PI * 3.0 * sin, 1e-4);
}

/// A square lamp over a plane, at the point below its centre: the form factor between a point and a parallel rectangle
/// (Howell, "A Catalog of Radiation Heat Transfer Configuration Factors", B-3, four corners), found by sampling the
/// lamp and by sampling the surface.
fn square_lamp_over_a_plane(engine: EngineChoice) {
    let lamp =
        Material { emissive: Vec3::splat(7.0), base_color: Vec4::new(0.0, 0.0, 0.0, 1.0), ..Material::default() };
    let down = DAffine3::from_translation(DVec3::new(0.0, 1.5, 0.0)) * DAffine3::from_rotation_x(PI);
    let scene = scene(vec![(square(10.0), grey(0.6, 1.0, 0.0), DAffine3::IDENTITY), (square(0.5), lamp, down)]);
    let params = params(
        r#"{"max_bounces":1,"max_samples":1024,"width":16,"height":16,
            "camera":{"position":[4,1,0],"target":[0,0,0],"yfov_degrees":0.2}}"#,
    );
    let x: f64 = 0.5 / 1.5;
    let s = (1.0 + x * x).sqrt();
    let expected = 0.6 * 7.0 * 4.0 / PI * (x / s) * (x / s).atan();
    let both = lambert(work(&scene, &params));
    let mut by_surface = both.clone();
    by_surface.features.emitters = false;
    assert_near(mean(&render(engine, both), 0), expected, 3e-3);
    assert_near(mean(&render(engine, by_surface), 0), expected, 2e-2);
}

/// A closed box whose walls emit 1 and reflect a half: radiance 1 / (1 - 1/2) everywhere. Russian roulette ends the
/// paths; a bias of it would show.
fn closed_furnace(engine: EngineChoice) {
    let wall = Material { emissive: Vec3::ONE, ..grey(0.5, 1.0, 0.0) };
    let turns = [
        DAffine3::IDENTITY,
        DAffine3::from_rotation_x(PI),
        DAffine3::from_rotation_x(PI / 2.0),
        DAffine3::from_rotation_x(-PI / 2.0),
        DAffine3::from_rotation_z(PI / 2.0),
        DAffine3::from_rotation_z(-PI / 2.0),
    ];
    let inwards = DAffine3::from_translation(DVec3::new(0.0, -1.0, 0.0));
    let scene = scene(turns.map(|turn| (square(1.0), wall.clone(), turn * inwards)).to_vec());
    let params =
        params(r#"{"max_samples":512,"camera":{"position":[0.2,0.1,0.3],"target":[-1,0.2,-0.5],"yfov_degrees":70}}"#);
    assert_near(mean(&render(engine, lambert(work(&scene, &params))), 0), 2.0, 3e-3);
}

/// A metal under a point light, pixel by pixel against the formula of glTF 2.0, B.2 and B.3, in f64.
fn rough_metal_matches_the_formula(engine: EngineChoice) {
    let scene = scene(vec![(square(10.0), grey(0.7, 0.5, 1.0), DAffine3::IDENTITY)]);
    let params = params(
        r#"{"lights":[{"type":"point","position":[-2,2,0],"intensity":10}],"max_bounces":1,"multiple_scattering":false,
            "max_samples":256,"camera":{"position":[2,2,0],"target":[0,0,0],"yfov_degrees":30}}"#,
    );
    let picture = render(engine, work(&scene, &params));
    let eye = DVec3::new(2.0, 2.0, 0.0);
    let forward = -eye.normalize();
    let right = forward.cross(DVec3::Y).normalize();
    let up = right.cross(forward);
    let half = 15f64.to_radians().tan();
    for (index, pixel) in picture.pixels.iter().enumerate() {
        let (x, y) = ((index % 32) as f64, (index / 32) as f64);
        let expected = pixel_mean(|u, v| {
            let d = forward + right * (((x + u) / 16.0 - 1.0) * half) + up * ((1.0 - (y + v) / 16.0) * half);
            let p = eye + d * (-eye.y / d.y);
            let to_light = DVec3::new(-2.0, 2.0, 0.0) - p;
            metal(0.7, 0.25, (eye - p).normalize(), to_light.normalize()) * 10.0 / to_light.length_squared()
        });
        assert_near(f64::from(pixel[0]), expected, 5e-3);
    }
}

/// f cos of a metal, normal +y: GGX, height-correlated Smith, Schlick.
fn metal(f0: f64, alpha: f64, v: DVec3, l: DVec3) -> f64 {
    let h = (v + l).normalize();
    let a2 = alpha * alpha;
    let d = a2 / (PI * (h.y * h.y * (a2 - 1.0) + 1.0).powi(2));
    let smith = |a: f64, b: f64| a * (b * b * (1.0 - a2) + a2).sqrt();
    let visibility = 0.5 / (smith(l.y, v.y) + smith(v.y, l.y));
    let fresnel = f0 + (1.0 - f0) * (1.0 - v.dot(h)).powi(5);
    d * visibility * fresnel * l.y
}

/// A plane under an HDRI with a sun of 1e4 on a grey sky: irradiance summed over the bilinear texels in f64.
fn plane_under_an_hdri(engine: EngineChoice) {
    let (width, height) = (64u32, 32u32);
    let mut texels = vec![[0.5f32; 3]; (width * height) as usize];
    texels[(9 * width + 20) as usize] = [1e4; 3];
    let expected = 0.6 / PI * irradiance(width, height, |i, j| f64::from(texels[(j * width + i) as usize][0]));
    let hdri = Arc::new(Hdri::new(width, height, texels));
    let scene = scene(vec![(square(10.0), grey(0.6, 1.0, 0.0), DAffine3::IDENTITY)]);
    let params = params(
        r#"{"max_bounces":1,"max_samples":256,"environment":{"hdri":"x","rotation_degrees":77},
            "camera":{"position":[0,5,0],"target":[0,0,0],"up":[0,0,-1]}}"#,
    );
    assert_near(mean(&render(engine, lambert(work_with_hdri(&scene, &params, Some(hdri)))), 0), expected, 3e-3);
}

/// Under a picture with a sun 1e5 times as bright as its sky nothing is clamped, and nothing needs to be: the error of a matte
/// plane's pixels falls as samples grow, none of them stands out, and their mean is the sum over the texels. So for a glossy
/// plane, whose mean is that of many more samples.
fn a_sun_of_1e5_in_an_hdri_converges(engine: EngineChoice) {
    let (width, height) = (128u32, 64u32);
    let mut texels = vec![[1.0f32; 3]; (width * height) as usize];
    texels[(15 * width + 40) as usize] = [1e5; 3];
    let expected = 0.6 / PI * irradiance(width, height, |i, j| f64::from(texels[(j * width + i) as usize][0]));
    let hdri = Arc::new(Hdri::new(width, height, texels));
    let picture = |roughness: f32, samples: u32| {
        let scene = scene(vec![(square(10.0), grey(0.6, roughness, 0.0), DAffine3::IDENTITY)]);
        let params = params(&format!(
            r#"{{"max_bounces":1,"max_samples":{samples},"adaptive":false,"width":16,"height":16,"environment":{{"hdri":"x"}},
                "camera":{{"position":[0,5,0],"target":[0,0,0],"up":[0,0,-1],"yfov_degrees":0.1}}}}"#
        ));
        let work = work_with_hdri(&scene, &params, Some(Arc::clone(&hdri)));
        render(engine, if roughness == 1.0 { lambert(work) } else { work })
    };
    let error = |roughness: f32, samples: u32, truth: f64| {
        let off = picture(roughness, samples).pixels.iter().map(|p| f64::from(p[0]) / truth - 1.0).collect::<Vec<_>>();
        let rms = (off.iter().map(|x| x * x).sum::<f64>() / off.len() as f64).sqrt();
        (rms, off.into_iter().fold(0.0, |worst: f64, x| worst.max(x.abs())))
    };
    let glossy = mean(&picture(0.3, 4096), 0);
    for (roughness, truth) in [(1.0, expected), (0.3, glossy)] {
        let ((few, _), (many, worst)) = (error(roughness, 64, truth), error(roughness, 1024, truth));
        eprintln!(
            "{engine:?}, roughness {roughness}: error {few:.1e} at 64 samples, {many:.1e} at 1024, worst pixel {worst:.1e}"
        );
        assert!(many < few / 3.0, "the error falls from {few} to {many} with sixteen times the samples");
        assert!(worst < 6.0 * many, "a pixel is off by {worst}, most by {many}");
        assert_near(mean(&picture(roughness, 1024), 0), truth, 2e-3);
    }
}

/// Irradiance on a horizontal plane of an equirectangular picture, bilinear between texel centres.
fn irradiance(width: u32, height: u32, texel: impl Fn(u32, u32) -> f64) -> f64 {
    const FINE: u32 = 24;
    let (columns, rows) = (width * FINE, height * FINE);
    let mut sum = 0.0;
    for row in 0..rows / 2 {
        let theta = PI * (f64::from(row) + 0.5) / f64::from(rows);
        let y = (f64::from(row) + 0.5) / f64::from(FINE) - 0.5;
        let (j0, fy) = (y.floor(), y - y.floor());
        let at = |j: f64| j.clamp(0.0, f64::from(height - 1)) as u32;
        for column in 0..columns {
            let x = (f64::from(column) + 0.5) / f64::from(FINE) - 0.5;
            let (i0, fx) = (x.floor(), x - x.floor());
            let around = |i: f64| i.rem_euclid(f64::from(width)) as u32;
            let across = |j| texel(around(i0), j) * (1.0 - fx) + texel(around(i0 + 1.0), j) * fx;
            let radiance = across(at(j0)) * (1.0 - fy) + across(at(j0 + 1.0)) * fy;
            sum += radiance * theta.cos() * theta.sin();
        }
    }
    sum * (PI / f64::from(rows)) * (2.0 * PI / f64::from(columns))
}

/// A half-transparent unlit square before a white one: their mean, found by chance hits.
fn blend_is_coverage(engine: EngineChoice) {
    let unlit =
        |color: Vec4, alpha_mode| Material { base_color: color, unlit: true, alpha_mode, ..Material::default() };
    let facing = |z| DAffine3::from_translation(DVec3::new(0.0, 0.0, z)) * DAffine3::from_rotation_x(PI / 2.0);
    let scene = scene(vec![
        (square(10.0), unlit(Vec4::ONE, AlphaMode::Opaque), facing(0.0)),
        (square(10.0), unlit(Vec4::new(0.2, 0.2, 0.2, 0.3), AlphaMode::Blend), facing(1.0)),
    ]);
    let params = params(r#"{"max_samples":256,"camera":{"position":[0,0,3],"target":[0,0,0],"yfov_degrees":30}}"#);
    assert_near(mean(&render(engine, work(&scene, &params)), 0), 0.3 * 0.2 + 0.7, 4e-3);
}

/// Mean of a function over the unit square, on a fine grid.
fn pixel_mean(f: impl Fn(f64, f64) -> f64) -> f64 {
    const FINE: u32 = 8;
    let at = |i: u32| (f64::from(i) + 0.5) / f64::from(FINE);
    (0..FINE * FINE).map(|k| f(at(k % FINE), at(k / FINE))).sum::<f64>() / f64::from(FINE * FINE)
}
