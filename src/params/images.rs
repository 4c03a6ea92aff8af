//! Pictures that parameters name: of the environment, and maps of spheres and overrides.

use super::{EnvironmentChoice, Maps, NormalParams, OverrideParams, ParallaxParams, ReliefParams, RenderParams};
use super::{SphereParams, TextureParams};

impl RenderParams {
    /// Name of the environment's picture.
    pub fn hdri_name(&self) -> Option<&str> {
        match &self.environment {
            EnvironmentChoice::Given(environment) => environment.hdri.as_deref(),
            EnvironmentChoice::Auto | EnvironmentChoice::None => None,
        }
    }

    /// Names of the pictures that spheres and overrides have, each with the pointer to where it stands.
    pub fn map_names_mut(&mut self) -> impl Iterator<Item = (String, &mut String)> {
        let spheres = self.spheres.iter_mut().enumerate().flat_map(|(index, sphere)| {
            let SphereParams { texture, height, normal, parallax, .. } = sphere;
            images(format!("/params/spheres/{index}"), texture, height, normal, parallax)
        });
        let overrides = self.overrides.iter_mut().enumerate().flat_map(|(index, material)| {
            let OverrideParams { texture, height, normal, parallax, .. } = material;
            images(format!("/params/overrides/{index}"), texture, height, normal, parallax)
        });
        spheres.chain(overrides)
    }

    /// Names of the profiles that lights have, each with the pointer to where it stands.
    pub fn profile_names_mut(&mut self) -> impl Iterator<Item = (String, &mut String)> {
        let profiles =
            self.lights.iter_mut().enumerate().filter_map(|(index, light)| Some((index, light.profile_mut()?)));
        profiles.map(|(index, profile)| (format!("/params/lights/{index}/ies"), &mut profile.ies))
    }

    /// The same, to be read alone.
    pub fn profile_names(&self) -> impl Iterator<Item = &str> {
        self.lights.iter().filter_map(|light| light.profile()).map(|profile| profile.ies.as_str())
    }

    /// Names of maps, to be read alone.
    pub fn map_names(&self) -> Vec<&str> {
        let maps = self.spheres.iter().map(SphereParams::maps).chain(self.overrides.iter().map(OverrideParams::maps));
        maps.flat_map(|Maps { texture, height, normal, parallax }| {
            let texture = texture.map(|map| map.image.as_str());
            let (height, normal) = (height.map(|map| map.image.as_str()), normal.map(|map| map.image.as_str()));
            [texture, height, normal, parallax.map(|map| map.image.as_str())].into_iter().flatten()
        })
        .collect()
    }
}

fn images<'a>(
    place: String,
    texture: &'a mut Option<TextureParams>,
    height: &'a mut Option<ReliefParams>,
    normal: &'a mut Option<NormalParams>,
    parallax: &'a mut Option<ParallaxParams>,
) -> impl Iterator<Item = (String, &'a mut String)> {
    let all = [
        ("texture", texture.as_mut().map(|map| &mut map.image)),
        ("height", height.as_mut().map(|map| &mut map.image)),
        ("normal", normal.as_mut().map(|map| &mut map.image)),
        ("parallax", parallax.as_mut().map(|map| &mut map.image)),
    ];
    all.into_iter().filter_map(move |(name, image)| Some((format!("{place}/{name}/image"), image?)))
}

#[cfg(test)]
mod tests {
    use crate::params::from_json;

    #[test]
    fn maps_are_named_with_their_places() {
        let json = r#"{"spheres": [{"center": [0, 0, 0], "radius": 1, "texture": {"image": "a.png"}}],
            "overrides": [{"material": "m", "parallax": {"image": "b.png", "scale": 1}}]}"#;
        let mut params = from_json(json).unwrap();
        assert_eq!(params.map_names(), ["a.png", "b.png"]);
        let places: Vec<String> = params.map_names_mut().map(|(place, _)| place).collect();
        assert_eq!(places, ["/params/spheres/0/texture/image", "/params/overrides/0/parallax/image"]);
    }
}
