//! What `mode: preview` can be told: the author's choices of two renderers, deferred shading and shadow maps.

use super::validate::Check;
use serde::{Deserialize, Serialize};

/// Most frames that a preview averages.
const MAX_SAMPLES: u32 = 256;
/// Most taps of a shadow test, blocker search and filter each.
const MAX_TAPS: u32 = 1024;
/// Most shadow tests of a row of the picture.
const MAX_ROW_TESTS: u64 = 1 << 26;
/// Sides of a shadow map in texels.
const MAP_SIZES: std::ops::RangeInclusive<u32> = 16..=8192;
/// Most lights with shadows: a point light takes six maps, and 96 of them are kept.
pub const MAX_SHADOW_LIGHTS: u32 = 16;

/// How `mode: preview` draws. Other modes do not read it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PreviewParams {
    /// Order of shading.
    pub path: ShadingPath,
    /// What surfaces do with light.
    pub shading: Shading,
    /// Exponent of `phong` and `blinn_phong`.
    pub shininess: f32,
    /// Strength of the highlight of `phong` and `blinn_phong`.
    pub specular: f32,
    /// How point and spot lights grow dim with distance.
    pub attenuation: Attenuation,
    /// Curve between a spot light's cones.
    pub spot_edge: SpotEdge,
    /// Lights are listed per tile of the picture, by their radius.
    pub culling: bool,
    /// Irradiance below which a point or spot light ends. None: 5/256 of `polynomial`, 0 (never) of the others.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cutoff: Option<f32>,
    /// Shadows of punctual lights.
    pub shadows: ShadowParams,
    /// Lights are drawn: points as spheres, spots as cubes.
    pub gizmos: bool,
    /// Half width of a gizmo in radii of the scene's bounds.
    pub gizmo_size: f32,
    /// Frames that are averaged against jagged edges, each moved by a part of a pixel.
    pub samples: u32,
}

impl Default for PreviewParams {
    fn default() -> Self {
        Self {
            path: ShadingPath::Deferred,
            shading: Shading::Pbr,
            shininess: 32.0,
            specular: 0.5,
            attenuation: Attenuation::default(),
            spot_edge: SpotEdge::Light,
            culling: true,
            cutoff: None,
            shadows: ShadowParams::default(),
            gizmos: false,
            gizmo_size: 0.02,
            samples: 1,
        }
    }
}

/// Order of shading.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ShadingPath {
    /// Surfaces first, then light once per pixel.
    Deferred,
    /// Light as surfaces are drawn.
    Forward,
}

/// What surfaces do with light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Shading {
    /// That of the other modes.
    Pbr,
    /// Base colour over pi.
    Lambert,
    /// Lambert and `specular (R.V)^shininess` over pi.
    Phong,
    /// Lambert and `specular (N.H)^shininess` over pi.
    BlinnPhong,
}

/// How light grows dim with distance.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Attenuation {
    /// Formula.
    pub kind: AttenuationKind,
    /// Kc of `polynomial`.
    pub constant: f32,
    /// Kl of `polynomial`.
    pub linear: f32,
    /// Kq of `polynomial`.
    pub quadratic: f32,
}

impl Default for Attenuation {
    fn default() -> Self {
        Self { kind: AttenuationKind::Physical, constant: 1.0, linear: 0.7, quadratic: 1.8 }
    }
}

/// Formula of [`Attenuation`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum AttenuationKind {
    /// `1 / d^2` within the range window of KHR_lights_punctual.
    Physical,
    /// `1 / (constant + linear d + quadratic d^2)`.
    Polynomial,
    /// `max(1 - d / R, 0)`; R is the light's range, or where `1 / d^2` falls to 5/256 if it has none.
    Range,
}

/// Curve between a spot light's cones.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SpotEdge {
    /// The light's own.
    Light,
    /// Linear in the cosine.
    LinearCosine,
}

/// Shadows of punctual lights.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ShadowParams {
    /// How they are found.
    pub algorithm: ShadowAlgorithm,
    /// The strongest so many lights cast shadows.
    pub max_lights: u32,
    /// Tests per point and light; of `pcss` in each of its two steps. Of `ray`: rays, if the light has a size.
    pub taps: u32,
    /// Texels a side of each map.
    pub map_size: u32,
    /// Half width of the filter of `pcf` and `noise` in texels. None: `sqrt(taps) / 2`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub radius: Option<f32>,
    /// Against surfaces that shadow themselves.
    pub bias: ShadowBias,
    /// Diameter of the lights for `pcss` and `ray`: scene units; of directional lights the tangent of the angle. 0: points.
    pub light_size: f32,
    /// Random numbers of `noise` and `pcss_noise`.
    pub hash: ShadowHash,
}

impl Default for ShadowParams {
    fn default() -> Self {
        Self {
            algorithm: ShadowAlgorithm::Pcf,
            max_lights: 4,
            taps: 9,
            map_size: 1024,
            radius: None,
            bias: ShadowBias::default(),
            light_size: 0.0,
            hash: ShadowHash::Integer,
        }
    }
}

/// How shadows are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ShadowAlgorithm {
    /// There are none.
    None,
    /// One tap of a shadow map.
    Basic,
    /// Mean of taps on a regular grid.
    Pcf,
    /// Mean of taps at Gaussian offsets.
    Noise,
    /// Percentage-closer soft shadows: blocker search, penumbra, filter (Fernando 2005).
    Pcss,
    /// The same with Gaussian offsets.
    PcssNoise,
    /// Rays against the scene's tree.
    Ray,
}

/// Against surfaces that shadow themselves, in texels of the map as seen at the point, times one more than the radius of
/// the filter in texels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ShadowBias {
    /// Always.
    pub constant: f32,
    /// Times the tangent of the angle between light and normal.
    pub slope: f32,
    /// Moves the point along its normal, times the sine of that angle.
    pub normal: f32,
}

impl Default for ShadowBias {
    fn default() -> Self {
        Self { constant: 0.5, slope: 1.0, normal: 0.0 }
    }
}

/// Random numbers of the noisy algorithms.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ShadowHash {
    /// An integer hash: the same on all devices.
    Integer,
    /// `fract(sin(dot(v, c)) k)`: differs between devices.
    Sine,
}

/// `width`: pixels of a row, the least that is drawn at a time.
pub(super) fn check(check: &mut Check, preview: &PreviewParams, width: u32) {
    check
        .require((1.0..=1e6).contains(&preview.shininess), "shininess", || "must lie between 1 and 1000000".to_owned());
    check.light(&[preview.specular], "specular");
    check.require((1..=MAX_SAMPLES).contains(&preview.samples), "samples", || {
        format!("must lie between 1 and {MAX_SAMPLES} frames")
    });
    check.require(preview.gizmo_size > 0.0 && preview.gizmo_size <= 1.0, "gizmo_size", || {
        "must be above 0 and at most 1 radius of the scene".to_owned()
    });
    if let Some(cutoff) = preview.cutoff {
        check.light(&[cutoff], "cutoff");
    }
    check.at("attenuation", |check| check_attenuation(check, &preview.attenuation));
    check.at("shadows", |check| {
        check_shadows(check, &preview.shadows);
        let ShadowParams { taps, max_lights, .. } = preview.shadows;
        let tests = u64::from(width) * u64::from(taps) * u64::from(max_lights);
        check.require(tests <= MAX_ROW_TESTS, "taps", || {
            format!("width x taps x max_lights is {tests}, more than the {MAX_ROW_TESTS} allowed: ask for fewer")
        });
    });
}

fn check_attenuation(check: &mut Check, attenuation: &Attenuation) {
    let Attenuation { kind, constant, linear, quadratic } = *attenuation;
    check.light(&[constant], "constant");
    check.light(&[linear], "linear");
    check.light(&[quadratic], "quadratic");
    check.require(kind != AttenuationKind::Polynomial || constant + linear + quadratic > 0.0, "", || {
        "one of `constant`, `linear` and `quadratic` must be above 0".to_owned()
    });
}

fn check_shadows(check: &mut Check, shadows: &ShadowParams) {
    check.require((1..=MAX_TAPS).contains(&shadows.taps), "taps", || format!("must lie between 1 and {MAX_TAPS}"));
    check.require(MAP_SIZES.contains(&shadows.map_size), "map_size", || {
        format!("must lie between {} and {} texels", MAP_SIZES.start(), MAP_SIZES.end())
    });
    check.require(shadows.max_lights <= MAX_SHADOW_LIGHTS, "max_lights", || {
        format!("must be at most {MAX_SHADOW_LIGHTS}")
    });
    if let Some(radius) = shadows.radius {
        check.require((0.0..=256.0).contains(&radius), "radius", || "must lie between 0 and 256 texels".to_owned());
    }
    check.light(&[shadows.light_size], "light_size");
    let ShadowBias { constant, slope, normal } = shadows.bias;
    check.at("bias", |check| {
        for (value, name) in [(constant, "constant"), (slope, "slope"), (normal, "normal")] {
            check.require((0.0..=1000.0).contains(&value), name, || "must lie between 0 and 1000 texels".to_owned());
        }
    });
}

impl PreviewParams {
    /// Irradiance below which a light ends; 0: it does not.
    pub fn cutoff(&self) -> f32 {
        let usual = if self.attenuation.kind == AttenuationKind::Polynomial { 5.0 / 256.0 } else { 0.0 };
        self.cutoff.unwrap_or(usual)
    }

    /// What the choices trade truth for, in words for the reply.
    pub(super) fn biases(&self) -> Vec<String> {
        let mut biases = vec![
            "mode preview: light that comes by way of other surfaces is missing; light of emitting surfaces lights no others; \
             mirrors show the environment alone"
                .to_owned(),
            "mode preview: nothing keeps the environment's light off a surface, and what it adds is read from spherical \
             harmonics of second order, for highlights from means over their lobes as seen from above"
                .to_owned(),
            "mode preview: glass is looked through along one ray as if it were smooth, past eight surfaces at most; it reflects the \
             environment alone and casts shadows as if it were opaque; dispersion and scattering in it are left out"
                .to_owned(),
            "mode preview: transparent triangles are blended in the order of their centres, and cast shadows by chance".to_owned(),
        ];
        if self.shading != Shading::Pbr {
            biases.push(
                "preview.shading: no shading but pbr conserves energy, and it sees no metal and no roughness"
                    .to_owned(),
            );
        }
        if self.attenuation.kind != AttenuationKind::Physical {
            biases.push("preview.attenuation: light does not fall off with the square of the distance".to_owned());
        }
        if self.spot_edge != SpotEdge::Light {
            biases.push("preview.spot_edge: spot lights have another edge than their own".to_owned());
        }
        if self.cutoff() > 0.0 {
            biases.push(format!("preview.cutoff: lights end where they are dimmer than {}", self.cutoff()));
        }
        biases.push(self.shadow_bias());
        biases
    }

    fn shadow_bias(&self) -> String {
        let ShadowParams { algorithm, max_lights, taps, map_size, light_size, .. } = self.shadows;
        match algorithm {
            ShadowAlgorithm::None => "preview.shadows none: lights shine through everything".to_owned(),
            ShadowAlgorithm::Ray => format!(
                "preview.shadows ray: at most {max_lights} lights cast shadows, as if they were {light_size} wide"
            ),
            _ => format!(
                "preview.shadows: at most {max_lights} lights cast shadows, which are read from maps of {map_size} texels a \
                 side with {taps} taps and are moved by their bias"
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::params::{ParamLimits, RenderParams, from_json};

    fn faults(preview: &str) -> Vec<String> {
        let json = format!(r#"{{"mode": "preview", "preview": {preview}}}"#);
        let params = match from_json(&json) {
            Ok(params) => params,
            Err(faults) => return faults.into_iter().map(|fault| fault.pointer).collect(),
        };
        let faults = params.validate(&ParamLimits::default());
        faults.map_or_else(|faults| faults.into_iter().map(|fault| fault.pointer).collect(), |()| Vec::new())
    }

    #[test]
    fn every_range_is_checked() {
        for (preview, field) in [
            (r#"{"shininess": 0}"#, "/shininess"),
            (r#"{"specular": -1}"#, "/specular"),
            (r#"{"samples": 0}"#, "/samples"),
            (r#"{"gizmo_size": 0}"#, "/gizmo_size"),
            (r#"{"cutoff": -1}"#, "/cutoff"),
            (r#"{"attenuation": {"linear": -1}}"#, "/attenuation/linear"),
            (r#"{"attenuation": {"kind": "polynomial", "constant": 0, "linear": 0, "quadratic": 0}}"#, "/attenuation"),
            (r#"{"shadows": {"taps": 0}}"#, "/shadows/taps"),
            (r#"{"shadows": {"taps": 1025}}"#, "/shadows/taps"),
            (r#"{"shadows": {"map_size": 8}}"#, "/shadows/map_size"),
            (r#"{"shadows": {"max_lights": 17}}"#, "/shadows/max_lights"),
            (r#"{"shadows": {"radius": -1}}"#, "/shadows/radius"),
            (r#"{"shadows": {"light_size": -1}}"#, "/shadows/light_size"),
            (r#"{"shadows": {"bias": {"slope": -1}}}"#, "/shadows/bias/slope"),
            (r#"{"shadows": {"bias": {"slop": 1}}}"#, "/shadows/bias/slop"),
            (r#"{"shadows": {"algorithm": "pfc"}}"#, "/shadows/algorithm"),
            (r#"{"shadows": []}"#, "/shadows"),
            (r#"{"shading": "toon"}"#, "/shading"),
        ] {
            assert_eq!(faults(preview), [format!("/params/preview{field}")], "{preview}");
        }
        assert!(faults("{}").is_empty());
    }

    #[test]
    fn a_row_has_a_bound() {
        let json = r#"{"mode": "preview", "width": 16000, "height": 1, "preview": {"shadows": {"taps": 1024, "max_lights": 16}}}"#;
        let faults = from_json(json).unwrap().validate(&ParamLimits::default()).unwrap_err();
        assert_eq!(faults[0].pointer, "/params/preview/shadows/taps");
    }

    #[test]
    fn a_preview_is_drawn_by_the_graphics_engine_alone() {
        let params = from_json(r#"{"mode": "preview", "engine": "cpu"}"#).unwrap();
        let faults = params.validate(&ParamLimits::default()).unwrap_err();
        assert_eq!(faults[0].pointer, "/params/engine");
    }

    #[test]
    fn what_is_approximate_is_said() {
        let biases = |json: &str| from_json(json).unwrap().biases();
        assert!(!biases(r#"{"mode": "preview"}"#).is_empty());
        let author = r#"{"mode": "preview", "preview": {"shading": "phong", "attenuation": {"kind": "polynomial"}}}"#;
        assert_eq!(biases(author).len(), biases(r#"{"mode": "preview"}"#).len() + 3);
        assert!(RenderParams::default().biases().is_empty());
    }
}
