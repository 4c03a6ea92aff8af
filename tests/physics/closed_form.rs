//! Scenes whose radiance is known.

use crate::support::{params, prepare, render, scene, sphere, square};
use candela::scene::Material;
use glam::{DAffine3, Vec4};

fn plain(roughness: f32, metallic: f32) -> Material {
    Material { base_color: Vec4::ONE, roughness, metallic, ..Material::default() }
}

/// A white sphere in a constant sky of radiance 1 must be invisible, whatever its roughness and metalness.
#[test]
fn white_sphere_vanishes_in_a_white_sky() {
    let mut worst: f64 = 0.0;
    for metallic in [0.0, 0.5, 1.0] {
        for roughness in [0.0, 0.1, 0.3, 0.6, 1.0] {
            let scene = scene(vec![(sphere(64), plain(roughness, metallic), DAffine3::IDENTITY)]);
            let params = params(
                r#"{"environment":{"constant":[1,1,1]},"max_samples":256,
                    "camera":{"position":[0,0,4],"target":[0,0,0],"yfov_degrees":20}}"#,
            );
            let picture = render(prepare(&scene, &params)).picture();
            let mean = picture.pixels.iter().map(|p| f64::from(p[1])).sum::<f64>() / picture.pixels.len() as f64;
            eprintln!("metallic {metallic} roughness {roughness}: mean {mean:.5}");
            worst = worst.max((mean - 1.0).abs());
        }
    }
    assert!(worst < 2e-3, "off by {worst}");
}

/// A point light over a diffuse plane: radiance = albedo / pi * I cos / d^2.
#[test]
fn point_light_over_a_plane() {
    let scene = scene(vec![(square(10.0), plain(1.0, 0.0), DAffine3::IDENTITY)]);
    let params = params(
        r#"{"lights":[{"type":"point","position":[0.3,2,-0.2],"intensity":10}],"max_bounces":1,
            "camera":{"position":[0,5,0],"target":[0,0,0],"up":[0,0,-1],"yfov_degrees":40}}"#,
    );
    let mut work = prepare(&scene, &params);
    work.features.specular = false;
    let picture = render(work).picture();
    let half = (20.0f64.to_radians()).tan() * 5.0;
    for y in 0..32 {
        for x in 0..32 {
            // Mean over the pixel by a fine grid.
            let mut expected = 0.0;
            for i in 0..8 {
                for j in 0..8 {
                    let px = ((f64::from(x) + (f64::from(i) + 0.5) / 8.0) / 16.0 - 1.0) * half - 0.3;
                    let pz = ((f64::from(y) + (f64::from(j) + 0.5) / 8.0) / 16.0 - 1.0) * half + 0.2;
                    let d2 = px * px + pz * pz + 4.0;
                    expected += 10.0 * 2.0 / d2.sqrt() / d2 / std::f64::consts::PI / 64.0;
                }
            }
            let got = f64::from(picture.pixels[(y * 32 + x) as usize][0]);
            assert!((got - expected).abs() < 2e-3 * expected, "pixel {x} {y}: {got} for {expected}");
        }
    }
}
