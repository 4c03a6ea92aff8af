//! The camera of a request: of the scene, given in place, in orbit, or framed automatically.

use super::framing::{self, Axes};
use super::motion;
use super::walk::camera_nodes;
use super::{CompileError, CompiledScene, DefaultTaken, Lens, View};
use crate::params::{CameraParams, FieldError, OrbitParams, RenderParams};
use crate::scene::{Placed, Projection, Scene};
use glam::{Affine3A, DVec3, Mat3A};
use serde_json::json;

/// Field of view where nothing says otherwise.
const YFOV_DEGREES: f64 = 45.0;

/// Compiles the camera of a request.
///
/// # Errors
/// [`CompileError::Params`] if the camera's fields contradict each other, name what the scene does not have, or
/// leave the direction of view undefined.
pub fn view(
    scene: &Scene,
    compiled: &CompiledScene,
    params: &RenderParams,
) -> Result<(View, Vec<DefaultTaken>), CompileError> {
    let (pose, lens, defaults) = stand(scene, compiled, params)?;
    let poses = motion::poses(scene, params)?;
    let way = poses.iter().map(|pose| Ok(stand(pose, compiled, params)?.0.to_world()));
    let way: Vec<Affine3A> = way.collect::<Result<_, CompileError>>()?;
    let moves = way.windows(2).any(|pair| pair[0] != pair[1]);
    let view = View {
        to_world: pose.to_world(),
        way: if moves { way } else { Vec::new() },
        lens,
        width: params.width,
        height: params.height,
        filter: params.filter,
        transparent: params.output.transparent,
    };
    Ok((view, defaults))
}

/// Where the camera of a request stands in a scene, and its lens.
fn stand(
    scene: &Scene,
    compiled: &CompiledScene,
    params: &RenderParams,
) -> Result<(Pose, Lens, Vec<DefaultTaken>), CompileError> {
    let camera = params.camera.clone().unwrap_or_default();
    check_combination(&camera)?;
    let cameras = camera_nodes(scene, params.scene)?;
    let aspect = f64::from(params.width) / f64::from(params.height.max(1));
    let mut builder = Builder { scene, compiled, camera: &camera, aspect, defaults: Vec::new() };
    let (pose, lens) = if let Some(position) = camera.position {
        builder.placed(DVec3::from_array(position))?
    } else if let Some(orbit) = camera.orbit {
        builder.orbiting(orbit)?
    } else if let Some(node) = chosen_node(scene, &camera, &cameras)? {
        builder.of_scene(node)?
    } else {
        builder.framed()?
    };
    Ok((pose, lens, builder.defaults))
}

fn fault(field: &str, detail: String) -> FieldError {
    FieldError { pointer: format!("/params/camera{field}"), detail }
}

fn check_combination(camera: &CameraParams) -> Result<(), FieldError> {
    let ways = [
        ("index", camera.index.is_some()),
        ("name", camera.name.is_some()),
        ("orbit", camera.orbit.is_some()),
        ("position", camera.position.is_some()),
    ];
    let given: Vec<&str> = ways.iter().filter(|(_, given)| *given).map(|(name, _)| *name).collect();
    if given.len() > 1 {
        return Err(fault("", format!("{} exclude each other; give one of them", given.join(" and "))));
    }
    if camera.target.is_some() && !(camera.orbit.is_some() || camera.position.is_some()) {
        return Err(fault("/target", "target needs position or orbit beside it".into()));
    }
    Ok(())
}

/// The camera of the scene that is asked for, or its first if nothing is; none: it has none.
fn chosen_node(scene: &Scene, camera: &CameraParams, cameras: &[Placed]) -> Result<Option<Placed>, FieldError> {
    if let Some(index) = camera.index {
        let missing = || fault("/index", format!("there is no camera {index}; {}", listed(scene, cameras)));
        return cameras.get(index).copied().map(Some).ok_or_else(missing);
    }
    let Some(name) = &camera.name else { return Ok(cameras.first().copied()) };
    let has_name = |placed: &&Placed| names(scene, placed).any(|known| known == name);
    let missing = || fault("/name", format!("there is no camera {name:?}; {}", listed(scene, cameras)));
    cameras.iter().find(has_name).copied().map(Some).ok_or_else(missing)
}

/// Names of a camera node: the camera's, then the node's.
fn names<'a>(scene: &'a Scene, placed: &Placed) -> impl Iterator<Item = &'a str> {
    let node = &scene.nodes[placed.node];
    let camera = node.camera.and_then(|index| scene.cameras.get(index)).and_then(|camera| camera.name.as_deref());
    [camera, node.name.as_deref()].into_iter().flatten()
}

fn listed(scene: &Scene, cameras: &[Placed]) -> String {
    if cameras.is_empty() {
        return "the scene has no camera: give position and target, or orbit".into();
    }
    let one = |(index, placed): (usize, &Placed)| match names(scene, placed).next() {
        Some(name) => format!("{index} ({name:?})"),
        None => index.to_string(),
    };
    let shown: Vec<String> = cameras.iter().enumerate().take(20).map(one).collect();
    let more =
        if cameras.len() > shown.len() { format!(" and {} more", cameras.len() - shown.len()) } else { String::new() };
    format!("the scene has {}{more}", shown.join(", "))
}

/// Where a camera stands, relative to the origin, and how it looks.
struct Pose {
    eye: DVec3,
    axes: Axes,
}

impl Pose {
    fn to_world(&self) -> Affine3A {
        let Axes { right, up, forward } = self.axes;
        let matrix3 = Mat3A::from_cols(right.as_vec3a(), up.as_vec3a(), (-forward).as_vec3a());
        Affine3A { matrix3, translation: self.eye.as_vec3a() }
    }
}

struct Builder<'a> {
    scene: &'a Scene,
    compiled: &'a CompiledScene,
    camera: &'a CameraParams,
    aspect: f64,
    defaults: Vec<DefaultTaken>,
}

impl Builder<'_> {
    fn placed(&mut self, position: DVec3) -> Result<(Pose, Lens), FieldError> {
        let eye = position - self.compiled.origin;
        let target = self.target();
        let forward = target - eye;
        let distance = forward.length();
        if !distance.is_finite() {
            return Err(fault("/position", "the camera is too far from its target; move it nearer".into()));
        }
        if distance == 0.0 {
            return Err(fault("/target", "the camera is at its target; move one of them".into()));
        }
        let axes = self.axes(forward)?;
        Ok((Pose { eye, axes }, self.perspective(self.yfov(None)?, distance)?))
    }

    /// Axes by the request's up; where that lies along the view, the most upright axis that does not.
    fn axes(&mut self, forward: DVec3) -> Result<Axes, FieldError> {
        let up = DVec3::from_array(self.camera.up);
        if !(up.is_finite() && up != DVec3::ZERO) {
            return Err(fault("/up", "up must be finite and not zero".into()));
        }
        if let Some(axes) = Axes::looking(forward, up) {
            return Ok(axes);
        }
        let other = if forward.normalize().y.abs() > 0.9 { DVec3::NEG_Z } else { DVec3::Y };
        self.defaults.push(DefaultTaken { what: "camera.up".into(), value: json!(other.to_array()) });
        Axes::looking(forward, other).ok_or_else(|| fault("/up", "up is parallel to the direction of view".into()))
    }

    /// The point looked at, relative to the origin.
    fn target(&mut self) -> DVec3 {
        if let Some(target) = self.camera.target {
            return DVec3::from_array(target) - self.compiled.origin;
        }
        let centre = self.compiled.bounds.centre();
        let value = json!((centre + self.compiled.origin).to_array());
        self.defaults.push(DefaultTaken { what: "camera.target".into(), value });
        centre
    }

    fn orbiting(&mut self, orbit: OrbitParams) -> Result<(Pose, Lens), FieldError> {
        let target = self.target();
        let yfov = self.yfov(None)?;
        let axes = Axes::orbit(orbit.azimuth_degrees, orbit.elevation_degrees);
        let distance = match orbit.distance {
            Some(distance) if distance > 0.0 && distance.is_finite() => distance,
            Some(_) => return Err(fault("/orbit/distance", "the distance must be positive".into())),
            None => self.framing_distance(target, &axes, yfov),
        };
        Ok((Pose { eye: target - axes.forward * distance, axes }, self.perspective(yfov, distance)?))
    }

    fn framing_distance(&mut self, target: DVec3, axes: &Axes, yfov: f64) -> f64 {
        let tan = (yfov * 0.5).tan();
        let distance = framing::distance(&self.compiled.bounds, target, axes, [tan * self.aspect, tan]);
        self.defaults.push(DefaultTaken { what: "camera.orbit.distance".into(), value: json!(distance) });
        distance
    }

    fn framed(&mut self) -> Result<(Pose, Lens), FieldError> {
        let orbit = OrbitParams::default();
        let value = json!({"orbit": {
            "azimuth_degrees": orbit.azimuth_degrees,
            "elevation_degrees": orbit.elevation_degrees,
        }});
        self.defaults.push(DefaultTaken { what: "camera".into(), value });
        self.orbiting(orbit)
    }

    fn of_scene(&mut self, placed: Placed) -> Result<(Pose, Lens), FieldError> {
        let node = &self.scene.nodes[placed.node];
        let source = node.camera.and_then(|index| self.scene.cameras.get(index));
        let forward = placed.world.transform_vector3(DVec3::NEG_Z);
        let upright = placed.world.transform_vector3(DVec3::Y);
        let axes = Axes::looking(forward, upright).ok_or_else(|| {
            let detail =
                format!("the transform of node {} leaves the camera no direction; choose another", placed.node);
            fault("", detail)
        })?;
        if self.camera.index.is_none() && self.camera.name.is_none() {
            let name = names(self.scene, &placed).next();
            self.defaults.push(DefaultTaken { what: "camera".into(), value: json!({"index": 0, "name": name}) });
        }
        let eye = placed.world.translation - self.compiled.origin;
        let lens = match source.map(|camera| camera.projection) {
            Some(Projection::Orthographic { ymag }) => self.orthographic(ymag)?,
            Some(Projection::Perspective { yfov }) => {
                let depth = (self.compiled.bounds.centre() - eye).dot(axes.forward);
                let distance = if depth > 0.0 { depth } else { 1.0 };
                self.perspective(self.yfov(Some(yfov))?, distance)?
            }
            None => self.perspective(self.yfov(None)?, 1.0)?,
        };
        Ok((Pose { eye, axes }, lens))
    }

    fn orthographic(&self, ymag: f64) -> Result<Lens, FieldError> {
        if self.camera.yfov_degrees.is_some() {
            return Err(fault("/yfov_degrees", "this camera is orthographic and has no field of view".into()));
        }
        if self.camera.aperture_radius != 0.0 {
            return Err(fault("/aperture_radius", "this camera is orthographic and has no lens; give 0".into()));
        }
        Ok(Lens::Orthographic { ymag: ymag.abs() as f32 })
    }

    /// Vertical field of view in radians.
    fn yfov(&self, of_camera: Option<f64>) -> Result<f64, FieldError> {
        let given = self.camera.yfov_degrees.map(f64::to_radians);
        let yfov = given.or(of_camera).unwrap_or_else(|| YFOV_DEGREES.to_radians());
        if yfov > 0.0 && yfov < std::f64::consts::PI {
            return Ok(yfov);
        }
        Err(fault(
            "/yfov_degrees",
            format!("a field of view of {} degrees; it must lie within 0 and 180", yfov.to_degrees()),
        ))
    }

    fn perspective(&self, yfov: f64, distance: f64) -> Result<Lens, FieldError> {
        let focus = self.camera.focus_distance.unwrap_or(distance);
        if !(focus.is_finite() && focus > 0.0) {
            return Err(fault("/focus_distance", "the plane in focus must lie in front of the camera".into()));
        }
        if !(self.camera.aperture_radius.is_finite() && self.camera.aperture_radius >= 0.0) {
            return Err(fault("/aperture_radius", "the aperture must be zero or positive".into()));
        }
        Ok(Lens::Perspective {
            tan_half_yfov: (yfov * 0.5).tan() as f32,
            aperture_radius: self.camera.aperture_radius as f32,
            blades: self.camera.blades,
            blade_rotation: (self.camera.blade_rotation_degrees + 90.0).rem_euclid(360.0).to_radians() as f32,
            focus_distance: focus as f32,
        })
    }
}
