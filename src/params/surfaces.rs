//! Spheres of the request, and what it says of materials of the file: values and maps.

use super::RenderParams;
use super::validate::Check;
use serde::{Deserialize, Serialize};

/// A sphere given by its equation; no mesh.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SphereParams {
    /// World space.
    pub center: [f64; 3],
    /// Scene units.
    pub radius: f64,
    /// Linear base colour.
    #[serde(default = "white")]
    pub color: [f32; 3],
    /// 0 to 1.
    #[serde(default)]
    pub metallic: f32,
    /// Perceptual, 0 to 1; none: that of `shininess`, else 0.5.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub roughness: Option<f32>,
    /// Exponent of Phong's highlight, in place of `roughness`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shininess: Option<f32>,
    /// Reflectance of the surface at normal incidence, 0 to below 1; none: 0.04.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reflectivity: Option<f32>,
    /// Axis of the poles, between which v runs: from 0 at its positive end to 1.
    #[serde(default)]
    pub axis: Axis,
    /// sRGB picture that multiplies `color`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub texture: Option<TextureParams>,
    /// Height map: bends normals alone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub height: Option<ReliefParams>,
    /// Normal map.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub normal: Option<NormalParams>,
    /// Height map that moves what is seen, too.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub parallax: Option<ParallaxParams>,
}

/// Other values and maps for a material of the file. Absent: as in the file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OverrideParams {
    /// Name of the material in the file; all of that name are meant.
    pub material: String,
    /// Linear base colour factor.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub color: Option<[f32; 3]>,
    /// 0 to 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub metallic: Option<f32>,
    /// Perceptual, 0 to 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub roughness: Option<f32>,
    /// Radiance factor.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub emissive: Option<[f32; 3]>,
    /// sRGB picture in the place of the file's base colour texture.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub texture: Option<TextureParams>,
    /// Height map: bends normals alone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub height: Option<ReliefParams>,
    /// Normal map.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub normal: Option<NormalParams>,
    /// Height map that moves what is seen, too.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub parallax: Option<ParallaxParams>,
}

/// Axis of the world.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Axis {
    /// +x
    X,
    /// +y
    #[default]
    Y,
    /// +z
    Z,
}

/// A picture on a surface.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TextureParams {
    /// File name of a part of the same form, or an id from `POST /v1/images`.
    pub image: String,
    /// How often it is repeated in u and v.
    #[serde(default = "once")]
    pub tiling: [f32; 2],
}

/// Heights on a surface, black to white, as slopes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReliefParams {
    /// File name of a part of the same form, or an id from `POST /v1/images`.
    pub image: String,
    /// Height of white above black, in scene units; negative: white lies below.
    pub scale: f32,
    /// How often it is repeated in u and v.
    #[serde(default = "once")]
    pub tiling: [f32; 2],
}

/// Normals on a surface, in its tangent space: x in red, y (up) in green.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NormalParams {
    /// File name of a part of the same form, or an id from `POST /v1/images`.
    pub image: String,
    /// Factor on x and y.
    #[serde(default = "one")]
    pub scale: f32,
    /// How often it is repeated in u and v.
    #[serde(default = "once")]
    pub tiling: [f32; 2],
}

/// Heights on a surface, as depths below it: white is the surface itself.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ParallaxParams {
    /// File name of a part of the same form, or an id from `POST /v1/images`.
    pub image: String,
    /// Depth of black in scene units.
    pub scale: f32,
    /// How often it is repeated in u and v.
    #[serde(default = "once")]
    pub tiling: [f32; 2],
    /// How the point that is seen is found.
    #[serde(default)]
    pub method: ParallaxMethod,
    /// Steps of `steep` and `relief` from the surface to the depth of black, and of `self_shadow` from there to the surface.
    #[serde(default = "steps")]
    pub steps: u32,
    /// Whether the relief keeps light off itself.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub self_shadow: bool,
}

/// Ways of finding the point of a relief that is seen.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ParallaxMethod {
    /// One step along the view, by the depth under the point (Kaneko et al. 2001).
    Offset,
    /// The same, no longer than that depth (Welsh 2004).
    OffsetLimited,
    /// Equal steps until the ray is below (McGuire and McGuire 2005).
    Steep,
    /// The same, then halved where it went below (Policarpo, Oliveira and Comba 2005).
    #[default]
    Relief,
}

/// Most steps of a search.
pub const MAX_STEPS: u32 = 1024;

fn white() -> [f32; 3] {
    [1.0; 3]
}

fn once() -> [f32; 2] {
    [1.0; 2]
}

fn one() -> f32 {
    1.0
}

fn steps() -> u32 {
    32
}

/// The maps of a sphere or an override.
#[derive(Debug, Clone, Copy)]
pub struct Maps<'a> {
    /// Base colour.
    pub texture: Option<&'a TextureParams>,
    /// Height map.
    pub height: Option<&'a ReliefParams>,
    /// Normal map.
    pub normal: Option<&'a NormalParams>,
    /// Parallax map.
    pub parallax: Option<&'a ParallaxParams>,
}

impl SphereParams {
    /// Its maps.
    pub fn maps(&self) -> Maps<'_> {
        let Self { texture, height, normal, parallax, .. } = self;
        Maps {
            texture: texture.as_ref(),
            height: height.as_ref(),
            normal: normal.as_ref(),
            parallax: parallax.as_ref(),
        }
    }

    /// Perceptual roughness: given, or that of facets whose highlight is as wide as Phong's (a Blinn-Phong exponent of four
    /// times Phong's, and from it Beckmann's width: Walter et al. 2007, section 5).
    pub fn roughness(&self) -> f32 {
        let of_shininess = |shininess: f32| (2.0 / (4.0 * shininess + 2.0)).powf(0.25);
        self.roughness.or(self.shininess.map(of_shininess)).unwrap_or(0.5)
    }
}

impl OverrideParams {
    /// Its maps.
    pub fn maps(&self) -> Maps<'_> {
        let Self { texture, height, normal, parallax, .. } = self;
        Maps {
            texture: texture.as_ref(),
            height: height.as_ref(),
            normal: normal.as_ref(),
            parallax: parallax.as_ref(),
        }
    }
}

/// Notes what is wrong with spheres and overrides; `most`: of each.
pub(super) fn check(check: &mut Check, params: &RenderParams, most: usize) {
    for (name, count) in [("spheres", params.spheres.len()), ("overrides", params.overrides.len())] {
        check.require(count <= most, name, || format!("at most {most} {name} are allowed here"));
    }
    for (index, sphere) in params.spheres.iter().enumerate() {
        check.at(&format!("spheres/{index}"), |check| check_sphere(check, sphere));
    }
    for (index, material) in params.overrides.iter().enumerate() {
        check.at(&format!("overrides/{index}"), |check| {
            check.require(
                !params.overrides[..index].iter().any(|other| other.material == material.material),
                "material",
                || "is overridden above already: put everything into one entry".to_owned(),
            );
            material.color.iter().for_each(|color| check_part(check, color, "color"));
            material.emissive.iter().for_each(|emissive| check.light(emissive, "emissive"));
            material.metallic.iter().for_each(|part| check_part(check, &[*part], "metallic"));
            material.roughness.iter().for_each(|part| check_part(check, &[*part], "roughness"));
            check_maps(check, &material.maps());
        });
    }
}

fn check_sphere(check: &mut Check, sphere: &SphereParams) {
    check.finite(&sphere.center, "center");
    check.require(sphere.radius > 0.0 && sphere.radius.is_finite(), "radius", || {
        "must be finite and above 0".to_owned()
    });
    check_part(check, &sphere.color, "color");
    check_part(check, &[sphere.metallic], "metallic");
    sphere.roughness.iter().for_each(|part| check_part(check, &[*part], "roughness"));
    check.require(sphere.roughness.is_none() || sphere.shininess.is_none(), "shininess", || {
        "says the same as `roughness`: give one of them".to_owned()
    });
    check.require(sphere.shininess.is_none_or(|s| s >= 0.0 && s.is_finite()), "shininess", || {
        "must be finite and not negative".to_owned()
    });
    check.require(sphere.reflectivity.is_none_or(|r| (0.0..1.0).contains(&r)), "reflectivity", || {
        "must be at least 0 and below 1; what reflects all light is a metal: `metallic` 1".to_owned()
    });
    check_maps(check, &sphere.maps());
}

fn check_part(check: &mut Check, values: &[f32], name: &str) {
    check.require(values.iter().all(|value| (0.0..=1.0).contains(value)), name, || {
        "must lie between 0 and 1".to_owned()
    });
}

fn check_maps(check: &mut Check, maps: &Maps<'_>) {
    let details = [maps.height.is_some(), maps.normal.is_some(), maps.parallax.is_some()];
    check.require(details.into_iter().filter(|&given| given).count() <= 1, "", || {
        "give at most one of `height`, `normal` and `parallax`".to_owned()
    });
    let mut map = |name: &str, image: &str, tiling: [f32; 2], scale: f32| {
        check.at(name, |check| {
            check.require(!image.is_empty(), "image", || "must be a file name or the id of an image".to_owned());
            let sound = tiling.iter().all(|times| times.is_finite() && *times != 0.0);
            check.require(sound, "tiling", || "must be finite and not 0".to_owned());
            check.require(scale.is_finite(), "scale", || "must be finite".to_owned());
        });
    };
    if let Some(texture) = maps.texture {
        map("texture", &texture.image, texture.tiling, 1.0);
    }
    if let Some(height) = maps.height {
        map("height", &height.image, height.tiling, height.scale);
    }
    if let Some(normal) = maps.normal {
        map("normal", &normal.image, normal.tiling, normal.scale);
    }
    if let Some(parallax) = maps.parallax {
        map("parallax", &parallax.image, parallax.tiling, parallax.scale);
        check.at("parallax", |check| {
            check.require(parallax.scale >= 0.0, "scale", || "must not be negative: reliefs lie below".to_owned());
            check.require((1..=MAX_STEPS).contains(&parallax.steps), "steps", || {
                format!("must lie between 1 and {MAX_STEPS}")
            });
        });
    }
}

#[cfg(test)]
mod tests {
    use crate::params::validate::tests::faults;

    #[test]
    fn every_range_of_a_sphere_is_checked() {
        for (fields, field) in [
            (r#""radius": 0"#, "/radius"),
            (r#""radius": 1, "color": [1, 2, 0]"#, "/color"),
            (r#""radius": 1, "metallic": -1"#, "/metallic"),
            (r#""radius": 1, "roughness": 2"#, "/roughness"),
            (r#""radius": 1, "roughness": 1, "shininess": 3"#, "/shininess"),
            (r#""radius": 1, "shininess": -3"#, "/shininess"),
            (r#""radius": 1, "reflectivity": 1"#, "/reflectivity"),
            (r#""radius": 1, "texture": {"image": ""}"#, "/texture/image"),
            (r#""radius": 1, "texture": {"image": "a", "tiling": [0, 1]}"#, "/texture/tiling"),
            (r#""radius": 1, "height": {"image": "a", "scale": 1}, "normal": {"image": "a"}"#, ""),
            (r#""radius": 1, "parallax": {"image": "a", "scale": -1}"#, "/parallax/scale"),
            (r#""radius": 1, "parallax": {"image": "a", "scale": 1, "steps": 0}"#, "/parallax/steps"),
        ] {
            let json = format!(r#"{{"spheres": [{{"center": [0, 0, 0], {fields}}}]}}"#);
            assert_eq!(faults(&json), [format!("/params/spheres/0{field}")], "{fields}");
        }
        assert!(faults(r#"{"spheres": [{"center": [0, 0, 0], "radius": 1e-3, "shininess": 0}]}"#).is_empty());
    }

    #[test]
    fn overrides_are_checked_and_meant_once() {
        let twice = r#"{"overrides": [{"material": "a"}, {"material": "b", "roughness": 7}, {"material": "a"}]}"#;
        assert_eq!(faults(twice), ["/params/overrides/1/roughness", "/params/overrides/2/material"]);
    }
}
