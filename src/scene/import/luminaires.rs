//! EXT_lights_ies: lights whose distribution was measured.

use super::budget::Budget;
use super::data::{Data, Located, locate};
use super::document;
use super::nodes::Hierarchy;
use super::number::{finite, non_negative, not_finite};
use super::references;
use super::schema::{Luminaire, LuminaireProfile, Luminaires};
use crate::scene::error::Warnings;
use crate::scene::{Light, LightKind, Package, Profile, SceneError};
use glam::Vec3;
use std::sync::Arc;

pub(super) const NAME: &str = "EXT_lights_ies";

/// Profiles of the file, with their names.
pub(super) struct Profiles(Vec<(Option<String>, Arc<Profile>)>);

/// Reads all profiles of the file.
pub(super) fn read(
    data: &Data<'_>,
    package: &Package,
    listed: Option<Luminaires>,
    budget: &mut Budget,
) -> Result<Profiles, SceneError> {
    let listed = listed.into_iter().flat_map(|list| list.lights).enumerate();
    let read = listed.map(|(index, source)| {
        let place = format!("/extensions/{NAME}/lights/{index}");
        let profile = profile(data, package, &source, &place)?;
        budget.charge(profile.bytes() as u64, profile.candela.len(), &place)?;
        Ok((source.name, Arc::new(profile)))
    });
    Ok(Profiles(read.collect::<Result<_, _>>()?))
}

fn profile(data: &Data<'_>, package: &Package, source: &LuminaireProfile, place: &str) -> Result<Profile, SceneError> {
    let broken = |why: String| SceneError::invalid("profile_broken", place, why);
    match (&source.uri, source.buffer_view) {
        (Some(uri), _) => match locate(uri, &format!("{place}/uri"), package)? {
            Located::Inline(bytes) => Profile::read(&bytes),
            Located::File(bytes) => Profile::read(bytes),
        },
        (None, Some(view)) => {
            references::one(Some(view), data.root.buffer_views.len(), "buffer view", || format!("{place}/bufferView"))?;
            Profile::read(data.view(view)?)
        }
        (None, None) => return Err(broken("the profile has neither a `uri` nor a `bufferView`".to_owned())),
    }
    .map_err(broken)
}

/// Adds a light for each node that has a profile, behind those of KHR_lights_punctual. One of those on the same node is what
/// stands in for it where profiles are not read, and is left out.
pub(super) fn place(
    data: &Data<'_>,
    hierarchy: &mut Hierarchy,
    profiles: &Profiles,
    lights: &mut Vec<Light>,
    warnings: &mut Warnings,
) -> Result<(), SceneError> {
    for (index, (source, node)) in data.root.nodes.iter().zip(&mut hierarchy.nodes).enumerate() {
        let Some(content) = source.extensions.get(NAME) else { continue };
        let place = format!("/nodes/{index}/extensions/{NAME}");
        let luminaire: Luminaire = document::extension(content, &place)?;
        references::one(Some(luminaire.light), profiles.0.len(), "light profile", || format!("{place}/light"))?;
        let Some((name, profile)) = profiles.0.get(luminaire.light) else { continue };
        if node.light.is_some() {
            let detail =
                "the node has a light of KHR_lights_punctual too, which is left out: it stands in for the profile";
            warnings.add("light_replaced", format!("/nodes/{index}/extensions/KHR_lights_punctual"), detail);
        }
        node.light = Some(lights.len());
        let (kind, range, profile) = (LightKind::Point, None, Some(Arc::clone(profile)));
        lights.push(Light { name: name.clone(), intensity: scale(&luminaire, &place)?, range, kind, profile });
    }
    Ok(())
}

/// Multiplier times colour.
fn scale(luminaire: &Luminaire, place: &str) -> Result<Vec3, SceneError> {
    let channel = |value: f64| finite(value, &format!("{place}/color")).map(|value| value.clamp(0.0, 1.0));
    let [r, g, b] = luminaire.color.unwrap_or([1.0; 3]);
    let multiplier = non_negative(luminaire.multiplier.unwrap_or(1.0), &format!("{place}/multiplier"))?;
    let scale = Vec3::new(channel(r)?, channel(g)?, channel(b)?) * multiplier;
    if scale.is_finite() {
        Ok(scale)
    } else {
        Err(not_finite(&format!("{place}/multiplier"), "multiplier times colour"))
    }
}

#[cfg(test)]
mod tests {
    use crate::scene::import::testing::{error, gltf, scene};
    use crate::scene::{LightKind, Package};
    use glam::Vec3;
    use serde_json::{Value, json};

    /// Percent-encoded: a profile of 5 candela downwards.
    const LAMP: &str =
        "data:,IESNA:LM-63-2002%0ATILT=NONE%0A1%20-1%201%202%201%201%202%200%200%200%201%201%209%200%2090%200%205%200";

    fn file(profiles: &Value, node: &Value) -> Package {
        gltf(json!({"extensionsUsed": ["EXT_lights_ies", "KHR_lights_punctual"],
            "extensions": {"EXT_lights_ies": {"lights": profiles}, "KHR_lights_punctual": {"lights": [{"type": "spot"}]}},
            "nodes": [{"extensions": {"KHR_lights_punctual": {"light": 0}}}, {"extensions": node}],
            "scenes": [{"nodes": [0, 1]}]}))
    }

    #[test]
    fn lights_with_profiles_follow_the_others() {
        let node = json!({"EXT_lights_ies": {"light": 0, "multiplier": 3, "color": [1, 0.5, 2]},
            "KHR_lights_punctual": {"light": 0}});
        let scene = scene(&file(&json!([{"uri": LAMP, "name": "lamp"}]), &node));
        assert_eq!((scene.nodes[0].light, scene.nodes[1].light), (Some(0), Some(1)));
        let light = &scene.lights[1];
        assert_eq!((light.kind, light.intensity), (LightKind::Point, Vec3::new(3.0, 1.5, 3.0)));
        assert_eq!((light.name.as_deref(), light.profile.as_ref().unwrap().peak), (Some("lamp"), 5.0));
        assert_eq!(scene.warnings[0].code, "light_replaced");
        assert!(scene.extensions[0].honoured);
    }

    #[test]
    fn bad_profiles_are_refused_with_their_place() {
        let lamp = json!([{ "uri": LAMP }]);
        let light = json!({"EXT_lights_ies": {"light": 0}});
        for (profiles, node, place, said) in [
            (json!([{}]), &light, "/extensions/EXT_lights_ies/lights/0", "neither"),
            (json!([{"uri": "data:,TILT=NONE"}]), &light, "/extensions/EXT_lights_ies/lights/0", "the file ends"),
            (json!([{"uri": "lamp.ies"}]), &light, "/extensions/EXT_lights_ies/lights/0/uri", "lamp.ies"),
            (json!([{"bufferView": 7}]), &light, "/extensions/EXT_lights_ies/lights/0/bufferView", "buffer view 7"),
            (
                lamp.clone(),
                &json!({"EXT_lights_ies": {"light": 1}}),
                "/nodes/1/extensions/EXT_lights_ies/light",
                "profile 1",
            ),
            (
                lamp.clone(),
                &json!({"EXT_lights_ies": {"light": 0, "multiplier": -1}}),
                "/nodes/1/extensions/EXT_lights_ies/multiplier",
                "negative",
            ),
        ] {
            let error = error(&file(&profiles, node));
            assert_eq!(error.pointer, place);
            assert!(error.detail.contains(said), "{}", error.detail);
        }
    }
}
