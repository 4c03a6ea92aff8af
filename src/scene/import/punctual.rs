//! KHR_lights_punctual.

use super::number::{finite, non_negative, not_finite};
use super::schema;
use crate::scene::error::Warnings;
use crate::scene::{Light, LightKind, SceneError};
use glam::Vec3;
use std::f32::consts::{FRAC_PI_2, FRAC_PI_4};

const PLACE: &str = "/extensions/KHR_lights_punctual/lights";

/// Checks the lights of the file.
pub(super) fn read(lights: &[schema::Light], warnings: &mut Warnings) -> Result<Vec<Light>, SceneError> {
    lights.iter().enumerate().map(|(index, light)| read_one(light, &format!("{PLACE}/{index}"), warnings)).collect()
}

fn read_one(source: &schema::Light, place: &str, warnings: &mut Warnings) -> Result<Light, SceneError> {
    let color = source.color.unwrap_or([1.0; 3]);
    let channel = |value: f64| non_negative(value, &format!("{place}/color"));
    let color = Vec3::new(channel(color[0])?, channel(color[1])?, channel(color[2])?);
    let intensity = color * non_negative(source.intensity.unwrap_or(1.0), &format!("{place}/intensity"))?;
    if !intensity.is_finite() {
        return Err(not_finite(&format!("{place}/intensity"), "colour times intensity"));
    }
    Ok(Light {
        name: source.name.clone(),
        intensity,
        range: source.range.map(|range| positive_range(range, place)).transpose()?,
        kind: kind(source, place, warnings)?,
        profile: None,
    })
}

fn positive_range(range: f64, place: &str) -> Result<f32, SceneError> {
    let place = format!("{place}/range");
    match finite(range, &place)? {
        range if range > 0.0 => Ok(range),
        range => Err(SceneError::invalid(
            "out_of_range",
            place,
            format!("{range} must be greater than 0; leave it out for no cut-off"),
        )),
    }
}

fn kind(source: &schema::Light, place: &str, warnings: &mut Warnings) -> Result<LightKind, SceneError> {
    match source.kind.as_str() {
        "directional" => Ok(LightKind::Directional),
        "point" => Ok(LightKind::Point),
        "spot" => spot(source.spot.as_ref().unwrap_or(&schema::Spot::default()), &format!("{place}/spot"), warnings),
        other => {
            let detail = format!("`{other}` is not a kind of light; it is directional, point or spot");
            Err(SceneError::invalid("light_type", format!("{place}/type"), detail))
        }
    }
}

fn spot(source: &schema::Spot, place: &str, warnings: &mut Warnings) -> Result<LightKind, SceneError> {
    let angle = |value: Option<f64>, default: f32, name: &str| match value {
        Some(value) => non_negative(value, &format!("{place}/{name}")),
        None => Ok(default),
    };
    let mut outer = angle(source.outer_cone_angle, FRAC_PI_4, "outerConeAngle")?;
    let mut inner = angle(source.inner_cone_angle, 0.0, "innerConeAngle")?;
    // A writer's pi/2 may exceed ours by the last digit.
    if outer > FRAC_PI_2 {
        if outer > FRAC_PI_2 + 1e-4 {
            warnings.add(
                "cone_clamped",
                format!("{place}/outerConeAngle"),
                format!("{outer} is more than pi/2 and is taken as that"),
            );
        }
        outer = FRAC_PI_2;
    }
    if inner > outer {
        let detail = format!("{inner} is more than the outer angle {outer} and is taken as that");
        warnings.add("cone_clamped", format!("{place}/innerConeAngle"), detail);
        inner = outer;
    }
    Ok(LightKind::Spot { inner_cone: inner, outer_cone: outer })
}

#[cfg(test)]
mod tests {
    use crate::scene::LightKind;
    use crate::scene::import::testing::{error, gltf, scene};
    use glam::Vec3;
    use serde_json::{Value, json};

    fn lights(lights: &Value) -> crate::scene::Package {
        gltf(
            json!({"extensionsUsed": ["KHR_lights_punctual"], "extensions": {"KHR_lights_punctual": {"lights": lights}},
            "nodes": [{"extensions": {"KHR_lights_punctual": {"light": 0}}}], "scenes": [{"nodes": [0]}]}),
        )
    }

    #[test]
    fn lights_are_read() {
        let scene = scene(&lights(&json!([
            {"type": "spot", "color": [1, 0.5, 0], "intensity": 4, "range": 9, "spot": {"innerConeAngle": 2, "outerConeAngle": 0.5}},
            {"type": "point"}, {"type": "directional"}, {"type": "spot", "spot": {}},
        ])));
        assert_eq!(scene.nodes[0].light, Some(0));
        assert_eq!((scene.lights[0].intensity, scene.lights[0].range), (Vec3::new(4.0, 2.0, 0.0), Some(9.0)));
        assert_eq!(scene.lights[0].kind, LightKind::Spot { inner_cone: 0.5, outer_cone: 0.5 });
        assert_eq!(scene.lights[1].intensity, Vec3::ONE);
        assert_eq!(scene.lights[3].kind, LightKind::Spot { inner_cone: 0.0, outer_cone: std::f32::consts::FRAC_PI_4 });
        assert_eq!(scene.warnings.len(), 1);
        assert!(scene.extensions[0].honoured);
    }

    #[test]
    fn bad_lights_are_refused() {
        let place = |light: Value| {
            error(&lights(&json!([light]))).pointer.replace("/extensions/KHR_lights_punctual/lights/0", "")
        };
        assert_eq!(place(json!({"type": "area"})), "/type");
        assert_eq!(place(json!({"type": "point", "intensity": -1})), "/intensity");
        assert_eq!(place(json!({"type": "point", "intensity": 1e39})), "/intensity");
        assert_eq!(place(json!({"type": "point", "color": [1, -1, 1]})), "/color");
        assert_eq!(place(json!({"type": "point", "range": 0})), "/range");
        assert_eq!(place(json!({"type": "spot", "spot": {"outerConeAngle": -1}})), "/spot/outerConeAngle");
        assert_eq!(place(json!({"type": 3})), "/type", "a type error inside an extension has its place too");
    }
}
