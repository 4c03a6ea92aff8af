//! Scene-linear radiance -> display-linear colour -> sRGB. All colours are Rec. 709.

use crate::params::ToneMapping;
use glam::{Mat3, Vec3};

/// Beyond this every curve has reached its limit; keeps their quotients finite.
const BRIGHTEST: f32 = 1e9;

/// Display-linear colour, each channel 0 to 1, of an exposed scene-linear colour.
pub fn tone_map(curve: ToneMapping, color: Vec3) -> Vec3 {
    // Neither is NaN above 0.
    let color = Vec3::from(color.to_array().map(|c| if c > 0.0 { c.min(BRIGHTEST) } else { 0.0 }));
    let mapped = match curve {
        ToneMapping::Linear => color,
        ToneMapping::Reinhard => color / (Vec3::ONE + color),
        ToneMapping::Aces => aces_filmic(color),
        ToneMapping::Agx => agx(color),
        ToneMapping::PbrNeutral => pbr_neutral(color),
    };
    mapped.clamp(Vec3::ZERO, Vec3::ONE)
}

/// sRGB opto-electronic transfer (IEC 61966-2-1) of a value between 0 and 1.
pub fn srgb_encode(linear: f32) -> f32 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// Stephen Hill's fit of the ACES reference and sRGB output transforms, with the pre-scale of three.js.
fn aces_filmic(color: Vec3) -> Vec3 {
    const INPUT: Mat3 =
        Mat3::from_cols_array(&[0.59719, 0.07600, 0.02840, 0.35458, 0.90834, 0.13383, 0.04823, 0.01566, 0.83777]);
    const OUTPUT: Mat3 =
        Mat3::from_cols_array(&[1.60475, -0.10208, -0.00327, -0.53108, 1.10813, -0.07276, -0.07367, -0.00605, 1.07602]);
    let x = INPUT * (color / 0.6);
    let fitted = (x * (x + 0.024_578_6) - 0.000_090_537) / (x * (0.983_729 * x + 0.432_951) + 0.238_081);
    OUTPUT * fitted
}

/// Troy Sobotka's AgX in the form that three.js and Filament took from Blender's configuration: an inset of the Rec. 2020
/// primaries, a logarithm over 16.5 stops, a sigmoid (sixth-order fit by Benjamin Wrensch), and the way back.
fn agx(color: Vec3) -> Vec3 {
    /// ITU-R BT.2407.
    const TO_REC2020: Mat3 =
        Mat3::from_cols_array(&[0.6274, 0.0691, 0.0164, 0.3293, 0.9195, 0.0880, 0.0433, 0.0113, 0.8956]);
    const FROM_REC2020: Mat3 =
        Mat3::from_cols_array(&[1.6605, -0.1246, -0.0182, -0.5876, 1.1329, -0.1006, -0.0728, -0.0083, 1.1187]);
    const INSET: Mat3 = Mat3::from_cols_array(&[
        0.856_627_15,
        0.137_318_97,
        0.111_898_21,
        0.095_121_24,
        0.761_242,
        0.076_799_42,
        0.048_251_606,
        0.101_439_04,
        0.811_302_4,
    ]);
    const OUTSET: Mat3 = Mat3::from_cols_array(&[
        1.127_100_6,
        -0.141_329_76,
        -0.141_329_76,
        -0.110_606_64,
        1.157_823_7,
        -0.110_606_64,
        -0.016_493_939,
        -0.016_493_939,
        1.251_936_4,
    ]);
    const MIN_STOPS: f32 = -12.473_93;
    const MAX_STOPS: f32 = 4.026_069;

    let inset = (INSET * (TO_REC2020 * color)).max(Vec3::splat(1e-10));
    let stops = Vec3::from(inset.to_array().map(f32::log2));
    let x = ((stops - MIN_STOPS) / (MAX_STOPS - MIN_STOPS)).clamp(Vec3::ZERO, Vec3::ONE);
    let sigmoid = (((((15.5 * x - 40.14) * x + 31.96) * x - 6.868) * x + 0.4298) * x + 0.1191) * x - 0.00232;
    let outset = (OUTSET * sigmoid).max(Vec3::ZERO);
    FROM_REC2020 * Vec3::from(outset.to_array().map(|c| c.powf(2.2)))
}

/// Khronos PBR Neutral, as specified in the KhronosGroup/ToneMapping repository.
fn pbr_neutral(color: Vec3) -> Vec3 {
    /// Fresnel reflection of a dielectric at normal incidence, which the curve takes away again.
    const F90_OFFSET: f32 = 0.04;
    const START: f32 = 0.8 - F90_OFFSET;
    const DESATURATION: f32 = 0.15;

    let least = color.min_element();
    let offset = if least < 2.0 * F90_OFFSET { least - least * least / (4.0 * F90_OFFSET) } else { F90_OFFSET };
    let color = color - offset;
    let peak = color.max_element();
    if peak < START {
        return color;
    }
    let headroom = 1.0 - START;
    let new_peak = 1.0 - headroom * headroom / (peak + headroom - START);
    let toward_white = 1.0 - 1.0 / (DESATURATION * (peak - new_peak) + 1.0);
    (color * (new_peak / peak)).lerp(Vec3::splat(new_peak), toward_white)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assert_near(curve: ToneMapping, input: [f32; 3], expected: [f32; 3]) {
        let mapped = tone_map(curve, input.into());
        let error = (mapped - Vec3::from(expected)).abs().max_element();
        assert!(error < 2e-4, "{curve:?} of {input:?} is {mapped}, not {expected:?}");
    }

    /// Expected values: the published formulas evaluated apart from this code, in f64.
    #[test]
    fn curves_have_their_published_values() {
        use ToneMapping::{Aces, Agx, Linear, PbrNeutral, Reinhard};
        assert_near(Aces, [0.18; 3], [0.21311; 3]);
        assert_near(Aces, [1.0; 3], [0.7634; 3]);
        assert_near(Aces, [8.0, 0.2, 0.05], [1.0, 0.67809, 0.34321]);
        assert_near(Aces, [0.02, 0.3, 0.9], [0.05499, 0.37584, 0.73093]);
        assert_near(Agx, [1.0; 3], [0.5902, 0.5901, 0.5901]);
        assert_near(Agx, [8.0, 0.2, 0.05], [1.0, 0.58543, 0.45718]);
        assert_near(Agx, [0.02, 0.3, 0.9], [0.11669, 0.35404, 0.6144]);
        assert_near(PbrNeutral, [1.0; 3], [0.86909; 3]);
        assert_near(PbrNeutral, [8.0, 0.2, 0.05], [0.99226, 0.51737, 0.50824]);
        assert_near(PbrNeutral, [0.02, 0.3, 0.9], [0.00756, 0.27278, 0.8411]);
        assert_near(Reinhard, [0.0, 1.0, 3.0], [0.0, 0.5, 0.75]);
        assert_near(Linear, [0.25, 1.0, 3.0], [0.25, 1.0, 1.0]);
    }

    #[test]
    fn agx_puts_middle_grey_in_the_middle_of_the_display() {
        let grey = srgb_encode(tone_map(ToneMapping::Agx, Vec3::splat(0.18)).y);
        assert!((grey - 0.5).abs() < 0.005, "{grey}");
    }

    /// What the curve is for: base colours come out as they were, less the Fresnel reflection that white light adds.
    #[test]
    fn pbr_neutral_keeps_base_colours() {
        for base in [[0.2, 0.4, 0.6], [0.7, 0.1, 0.05], [0.5, 0.5, 0.5]] {
            assert_near(ToneMapping::PbrNeutral, base.map(|c| c + 0.04), base);
        }
    }

    #[test]
    fn every_input_gives_a_colour() {
        for curve in
            [ToneMapping::Linear, ToneMapping::Reinhard, ToneMapping::Aces, ToneMapping::Agx, ToneMapping::PbrNeutral]
        {
            for value in [0.0, -1.0, 1e-30, 1e6, f32::MAX, f32::INFINITY, f32::NAN] {
                let mapped = tone_map(curve, Vec3::new(value, 0.5, value));
                assert!(mapped.min_element() >= 0.0 && mapped.max_element() <= 1.0, "{curve:?} of {value}: {mapped}");
            }
            assert_eq!(tone_map(curve, Vec3::ZERO).max_element(), 0.0, "{curve:?} of black");
            assert!(tone_map(curve, Vec3::splat(1e9)).min_element() > 0.98, "{curve:?} of the brightest");
        }
    }

    #[test]
    fn srgb_is_that_of_the_standard() {
        for (linear, encoded) in [(0.0, 0.0), (0.0031308, 0.04045), (0.18, 0.46135), (0.5, 0.73536), (1.0, 1.0)] {
            assert!((srgb_encode(linear) - encoded).abs() < 1e-5);
        }
    }
}
