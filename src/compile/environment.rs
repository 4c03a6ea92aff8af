//! Light from infinity, as asked for or neutral.

use super::{CompileError, DefaultTaken, Environment, EnvironmentKind, Hdri, Lighting, PunctualKind, PunctualLight};
use crate::params::{EnvironmentChoice, EnvironmentParams, FieldError, Mode};
use glam::Vec3;
use serde_json::json;
use std::sync::Arc;

/// Neutral sky: a bright ceiling, a light horizon, a dim floor, so that shapes read from above to below.
const SKY: [f32; 3] = [1.0, 0.75, 0.3];
/// Where the neutral key light of direct mode shines.
const KEY_DIRECTION: [f32; 3] = [-0.45, -0.77, -0.45];
/// Illuminance of the key light: white facing it shows 0.7.
const KEY_LUX: f32 = 2.2;
/// Radiance from all sides beside the key light.
const FILL: f32 = 0.3;

/// The environment that the request gives; automatic: none yet.
pub fn given(choice: &EnvironmentChoice, hdri: Option<Arc<Hdri>>) -> Result<Environment, CompileError> {
    match choice {
        EnvironmentChoice::Auto | EnvironmentChoice::None => Ok(Environment::default()),
        EnvironmentChoice::Given(params) => Ok(Environment {
            kind: kind(params, hdri)?,
            intensity: params.intensity,
            rotation: params.rotation_degrees.to_radians() as f32,
            visible: params.visible,
            ambient: Vec3::ZERO,
        }),
    }
}

fn kind(params: &EnvironmentParams, hdri: Option<Arc<Hdri>>) -> Result<EnvironmentKind, FieldError> {
    let colour = Vec3::from_array;
    match (&params.hdri, params.constant, params.gradient) {
        (Some(name), None, None) => hdri.map(EnvironmentKind::Hdri).ok_or_else(|| {
            let detail = format!("the picture {name:?} is neither a part of the form nor a stored image");
            FieldError { pointer: "/params/environment/hdri".into(), detail }
        }),
        (None, Some(constant), None) => Ok(EnvironmentKind::Constant(colour(constant))),
        (None, None, Some(gradient)) => Ok(EnvironmentKind::Gradient {
            top: colour(gradient.top),
            horizon: colour(gradient.horizon),
            bottom: colour(gradient.bottom),
        }),
        _ => Err(FieldError {
            pointer: "/params/environment".into(),
            detail: "exactly one of hdri, constant and gradient must be given (or null for no environment)".into(),
        }),
    }
}

/// Adds neutral light where nothing else shines: a soft sky on paths, a key light and a fill in direct mode.
pub fn neutral(mode: Mode, lighting: &mut Lighting) -> Vec<DefaultTaken> {
    match mode {
        // A preview stands in for the path-traced picture.
        Mode::Path | Mode::Preview => {
            let [top, horizon, bottom] = SKY.map(Vec3::splat);
            lighting.environment.kind = EnvironmentKind::Gradient { top, horizon, bottom };
            let value = json!({"gradient": {"top": rgb(SKY[0]), "horizon": rgb(SKY[1]), "bottom": rgb(SKY[2])}});
            vec![DefaultTaken { what: "environment".into(), value }]
        }
        Mode::Direct => {
            let direction = Vec3::from_array(KEY_DIRECTION).normalize().to_array();
            lighting.lights.push(PunctualLight {
                kind: PunctualKind::Directional as u32,
                direction,
                range: f32::INFINITY,
                intensity: [KEY_LUX; 3],
                inner: 1.0,
                ..PunctualLight::default()
            });
            lighting.environment.ambient = Vec3::splat(FILL);
            let key = json!({"type": "directional", "direction": KEY_DIRECTION, "intensity": KEY_LUX});
            let fill = json!({"type": "ambient", "intensity": FILL});
            vec![DefaultTaken { what: "lights".into(), value: json!([key, fill]) }]
        }
    }
}

fn rgb(grey: f32) -> [f32; 3] {
    [grey; 3]
}
