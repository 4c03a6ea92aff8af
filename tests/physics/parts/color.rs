//! Tone curves and transfer functions against their publications, evaluated here in f64.

use super::random::Random;
use super::verdict::Verdict;
use candela::film::tone_mapping::{srgb_encode, tone_map};
use candela::params::ToneMapping;
use glam::{DMat3, DVec3, Vec3};

/// Largest difference of a display value.
const TOLERANCE: f64 = 1e-5;

/// IEC 61966-2-1:1999, 5.2.
fn srgb(linear: f64) -> f64 {
    if linear > 0.003_130_8 { 1.055 * linear.powf(1.0 / 2.4) - 0.055 } else { 12.92 * linear }
}

/// A matrix from its rows, as publications print it.
fn rows(rows: [[f64; 3]; 3]) -> DMat3 {
    DMat3::from_cols_array_2d(&rows).transpose()
}

/// Stephen Hill's fit of RRT and ODT (BakingLab, ACES.hlsl), with three.js' exposure of 1 / 0.6.
fn aces(color: DVec3) -> DVec3 {
    let input = rows([[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]]);
    let output = rows([[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]]);
    let v = input * color / 0.6;
    let fit = |v: f64| (v * (v + 0.0245786) - 0.000090537) / (v * (0.983729 * v + 0.4329510) + 0.238081);
    output * DVec3::from(v.to_array().map(fit))
}

/// Troy Sobotka's AgX as three.js and Filament have it: Rec. 2020 primaries (ITU-R BT.2407, rounded to four places) and
/// Benjamin Wrensch's fit of the contrast curve.
fn agx(color: DVec3) -> DVec3 {
    let to_rec2020 = rows([[0.6274, 0.3293, 0.0433], [0.0691, 0.9195, 0.0113], [0.0164, 0.0880, 0.8956]]);
    let from_rec2020 = rows([[1.6605, -0.5876, -0.0728], [-0.1246, 1.1329, -0.0083], [-0.0182, -0.1006, 1.1187]]);
    let inset = rows([
        [0.856627153315983, 0.0951212405381588, 0.0482516061458583],
        [0.137318972929847, 0.761241990602591, 0.101439036467562],
        [0.11189821299995, 0.0767994186031903, 0.811302368396859],
    ]);
    // The publication gives the inverse.
    let outset = rows([
        [0.899796955911611, 0.0871996192028351, 0.013003424885555],
        [0.11142098895748, 0.875575586156966, 0.0130034248855548],
        [0.11142098895748, 0.0871996192028349, 0.801379391839686],
    ])
    .inverse();
    let curve = |v: f64| {
        let x = ((v.max(1e-10).log2() + 12.47393) / (4.026069 + 12.47393)).clamp(0.0, 1.0);
        15.5 * x.powi(6) - 40.14 * x.powi(5) + 31.96 * x.powi(4) - 6.868 * x.powi(3) + 0.4298 * x.powi(2) + 0.1191 * x
            - 0.00232
    };
    let v = outset * DVec3::from((inset * (to_rec2020 * color)).to_array().map(curve));
    from_rec2020 * DVec3::from(v.to_array().map(|c| c.max(0.0).powf(2.2)))
}

/// Khronos PBR Neutral (KhronosGroup/ToneMapping, specification of 2024).
fn pbr_neutral(color: DVec3) -> DVec3 {
    let (start, desaturation) = (0.8 - 0.04, 0.15);
    let x = color.min_element();
    let color = color - if x < 0.08 { x - 6.25 * x * x } else { 0.04 };
    let peak = color.max_element();
    if peak < start {
        return color;
    }
    let d = 1.0 - start;
    let compressed = 1.0 - d * d / (peak + d - start);
    let g = 1.0 - 1.0 / (desaturation * (peak - compressed) + 1.0);
    color * (compressed / peak) * (1.0 - g) + DVec3::splat(compressed) * g
}

type Curve = fn(DVec3) -> DVec3;

const CURVES: [(ToneMapping, Curve); 5] = [
    (ToneMapping::Linear, |color| color),
    // Reinhard et al. 2002, eq. 3.
    (ToneMapping::Reinhard, |color| color / (DVec3::ONE + color)),
    (ToneMapping::Aces, aces),
    (ToneMapping::Agx, agx),
    (ToneMapping::PbrNeutral, pbr_neutral),
];

/// Colours from 1e-4 to 1e3, greys and saturated ones, and black.
fn colors() -> impl Iterator<Item = Vec3> {
    let mut random = Random(77);
    let mut any = move || 10f64.powf(7.0 * random.unit() - 4.0) as f32;
    let greys = (0..200).map(|i| Vec3::splat(10f32.powf(i as f32 / 40.0 - 3.0)));
    greys.chain([Vec3::ZERO]).chain((0..100_000).map(move |_| Vec3::new(any(), any(), any())))
}

fn judge(implementation: impl Fn(ToneMapping, Vec3) -> Vec3, encode: impl Fn(f32) -> f32) -> Verdict {
    let mut verdict = Verdict::new("colour", "both");
    for (curve, formula) in CURVES {
        let off = colors().map(|color| {
            let expected = formula(color.as_dvec3()).clamp(DVec3::ZERO, DVec3::ONE);
            (implementation(curve, color).as_dvec3() - expected).abs().max_element()
        });
        verdict.deviation(format!("{curve:?}"), off, TOLERANCE);
    }
    let steps = (0..=100_000).map(|i| i as f32 / 1e5);
    let off = steps.map(|x| (f64::from(encode(x)) - srgb(f64::from(x))).abs());
    verdict.deviation("sRGB".into(), off, TOLERANCE);
    verdict
}

/// Values that the publications print.
fn published(encode: impl Fn(f32) -> f32) -> Verdict {
    let mut verdict = Verdict::new("colour", "both");
    // IEC 61966-2-1: the knee, white, and the 8-bit code of middle grey, 118.
    for (linear, encoded) in [(0.0, 0.0), (0.003_130_8, 0.040_449_936), (1.0, 1.0)] {
        verdict.deviation(format!("sRGB of {linear}"), [(f64::from(encode(linear)) - encoded).abs()], 1e-6);
    }
    let code = (255.0 * f64::from(encode(0.18))).round();
    verdict.deviation("code of 0.18".into(), [(code - 118.0).abs()], 0.0);
    verdict
}

#[test]
fn curves_are_those_of_their_publications() {
    judge(tone_map, srgb_encode).assert();
    published(srgb_encode).assert();
}

/// Weights of ITU-R BT.709-6, item 3.2, as the shaders have them.
#[test]
fn luminance_weights_are_those_of_rec_709() {
    const SOURCE: &str = include_str!(concat!(env!("OUT_DIR"), "/parts.wgsl"));
    let weights = SOURCE.split("return dot(c, vec3f(").nth(1).and_then(|rest| rest.split(')').next());
    let weights: Vec<f64> =
        weights.expect("luminance").split(',').map(|w| w.trim().parse().expect("a number")).collect();
    assert_eq!(weights, [0.2126, 0.7152, 0.0722]);
}

#[test]
fn faults_are_found() {
    let wrong = |size: f32| {
        let curves = move |curve, color: Vec3| tone_map(curve, color * (1.0 + size));
        let encode = move |x: f32| srgb_encode(x * (1.0 + size));
        !judge(curves, encode).failures().is_empty()
    };
    assert!(wrong(1e-3) && wrong(1e-4));
}
