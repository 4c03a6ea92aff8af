//! What a request trades truth for.

use super::{DirectShading, LightParams, Mode, OverrideParams, RenderParams, SphereParams};

impl RenderParams {
    /// Every choice of this request by which the picture differs from the full simulation, in words for the reply.
    pub fn biases(&self) -> Vec<String> {
        let mut biases = Vec::new();
        if self.mode == Mode::Direct {
            biases
                .push("mode direct: light that comes by way of other surfaces is missing, mirrors excepted".to_owned());
        }
        if self.mode == Mode::Direct && self.direct.shading == DirectShading::Phong {
            biases.push("direct.shading phong: reflection by Phong's formula, which keeps no energy".to_owned());
        }
        if self.mode != Mode::Path && self.lights.iter().any(LightParams::has_extent) {
            let mode = if self.mode == Mode::Direct { "direct" } else { "preview" };
            biases.push(format!(
                "mode {mode}: lights with an extent (rect, disk, sphere, angular_diameter_degrees) are points that send the same \
                 light afar: their shadows are hard, and nothing shows or mirrors them"
            ));
        }
        biases.extend(self.relief_bias());
        if self.mode == Mode::Preview {
            biases.extend(self.preview.biases());
            if self.camera.as_ref().is_some_and(|camera| camera.aperture_radius > 0.0) {
                biases.push("mode preview: the lens is a point, whatever `camera.aperture_radius` says".to_owned());
            }
        } else if let Some(bounces) = self.max_bounces {
            biases.push(format!("max_bounces {bounces}: light that scatters more often than that is missing"));
        }
        if !self.multiple_scattering {
            biases
                .push("multiple_scattering off: rough surfaces lose the light that scatters more than once".to_owned());
        }
        biases
    }

    fn relief_bias(&self) -> Option<String> {
        let surfaces =
            self.spheres.iter().map(SphereParams::maps).chain(self.overrides.iter().map(OverrideParams::maps));
        let mut shadowed = surfaces.filter_map(|maps| maps.parallax).map(|parallax| parallax.self_shadow).peekable();
        shadowed.peek()?;
        let light = if self.mode != Mode::Preview && shadowed.all(|shadowed| shadowed) {
            "light that they keep off themselves is lost"
        } else {
            "no shadow on themselves"
        };
        Some(format!("parallax maps: reliefs have the outline of their surface, and {light}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_bias_is_named_and_none_by_default() {
        assert!(RenderParams::default().biases().is_empty());
        let request = RenderParams {
            mode: Mode::Direct,
            max_bounces: Some(3),
            multiple_scattering: false,
            ..RenderParams::default()
        };
        assert_eq!(request.biases().len(), 3);
        let direct = crate::params::DirectParams { shading: DirectShading::Phong, ..request.direct };
        assert_eq!(RenderParams { direct, ..request }.biases().len(), 4);
        let json =
            r#"{"mode": "direct", "lights": [{"type": "disk", "position": [0, 1, 0], "direction": [0, -1, 0]}]}"#;
        assert_eq!(crate::params::from_json(json).unwrap().biases().len(), 2);
        let json = r#"{"overrides": [{"material": "a", "parallax": {"image": "a", "scale": 1}}]}"#;
        assert_eq!(crate::params::from_json(json).unwrap().biases().len(), 1);
    }
}
