//! Cameras.

use super::number::finite;
use super::schema;
use crate::scene::error::Warnings;
use crate::scene::{Camera, Projection, SceneError};

/// Checks the cameras of the file.
pub(super) fn read(cameras: &[schema::Camera], warnings: &mut Warnings) -> Result<Vec<Camera>, SceneError> {
    let projection = |(index, source): (usize, &schema::Camera)| {
        let projection = projection(source, &format!("/cameras/{index}"), warnings)?;
        Ok(Camera { name: source.name.clone(), projection })
    };
    cameras.iter().enumerate().map(projection).collect()
}

fn projection(source: &schema::Camera, place: &str, warnings: &mut Warnings) -> Result<Projection, SceneError> {
    match (source.kind.as_str(), &source.perspective, &source.orthographic) {
        ("perspective", Some(lens), _) => perspective(lens.yfov, &format!("{place}/perspective/yfov")),
        ("orthographic", _, Some(lens)) => orthographic(lens.ymag, &format!("{place}/orthographic/ymag"), warnings),
        ("perspective" | "orthographic", ..) => {
            let detail = format!("a camera of type `{}` needs the property of that name", source.kind);
            Err(SceneError::invalid("camera", place, detail))
        }
        (other, ..) => {
            let detail = format!("`{other}` is not a kind of camera; it is perspective or orthographic");
            Err(SceneError::invalid("camera", format!("{place}/type"), detail))
        }
    }
}

fn perspective(yfov: f64, place: &str) -> Result<Projection, SceneError> {
    if finite(yfov, place)? > 0.0 && yfov < std::f64::consts::PI {
        return Ok(Projection::Perspective { yfov });
    }
    Err(SceneError::invalid("camera", place, format!("{yfov} must lie between 0 and pi (radians)")))
}

fn orthographic(ymag: f64, place: &str, warnings: &mut Warnings) -> Result<Projection, SceneError> {
    if finite(ymag, place)? == 0.0 {
        return Err(SceneError::invalid("camera", place, "the half height of the picture must not be 0"));
    }
    if ymag < 0.0 {
        warnings.add("camera", place, format!("{ymag} is negative; its absolute value is used"));
    }
    Ok(Projection::Orthographic { ymag: ymag.abs() })
}

#[cfg(test)]
mod tests {
    use crate::scene::Projection;
    use crate::scene::import::testing::{error, gltf, scene};
    use serde_json::{Value, json};

    #[test]
    fn cameras() {
        let good = scene(&gltf(json!({"cameras": [
            {"type": "perspective", "name": "p", "perspective": {"yfov": 0.5, "znear": 1}},
            {"type": "orthographic", "orthographic": {"xmag": 1, "ymag": -2, "znear": 0, "zfar": 1}},
        ]})));
        assert_eq!(good.cameras[0].projection, Projection::Perspective { yfov: 0.5 });
        assert_eq!(good.cameras[1].projection, Projection::Orthographic { ymag: 2.0 });
        let place = |camera: Value| error(&gltf(json!({"cameras": [camera]}))).pointer;
        assert_eq!(place(json!({"type": "perspective", "perspective": {"yfov": 0}})), "/cameras/0/perspective/yfov");
        assert_eq!(place(json!({"type": "perspective", "perspective": {"yfov": 4}})), "/cameras/0/perspective/yfov");
        assert_eq!(place(json!({"type": "orthographic", "orthographic": {"ymag": 0}})), "/cameras/0/orthographic/ymag");
        assert_eq!(place(json!({"type": "perspective", "orthographic": {"ymag": 1}})), "/cameras/0");
        assert_eq!(place(json!({"type": "fisheye"})), "/cameras/0/type");
    }
}
