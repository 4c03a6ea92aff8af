//! Which moment of which animation a request shows.

use crate::params::{AnimationChoice, FieldError, RenderParams};
use crate::scene::{Moment, Scene};

/// The moment that a request asks for; none: the scene at rest.
///
/// # Errors
/// The file has no such animation.
pub fn moment(scene: &Scene, params: &RenderParams) -> Result<Option<Moment>, FieldError> {
    let animation = match &params.animation {
        None => {
            let asks = params.time.is_some() || params.open_shutter().is_some();
            (asks && !scene.animations.is_empty()).then_some(0)
        }
        Some(choice) => Some(chosen(scene, choice)?),
    };
    Ok(animation.map(|animation| Moment { animation, time: params.time.unwrap_or(0.0) }))
}

fn chosen(scene: &Scene, choice: &AnimationChoice) -> Result<usize, FieldError> {
    let name_of = |index: usize| scene.animations.get(index).and_then(|animation| animation.name.as_deref());
    let found = match choice {
        AnimationChoice::Index(index) => Some(*index).filter(|index| *index < scene.animations.len()),
        AnimationChoice::Name(name) => (0..scene.animations.len()).find(|index| name_of(*index) == Some(name)),
    };
    found.ok_or_else(|| {
        let shown = match choice {
            AnimationChoice::Index(index) => index.to_string(),
            AnimationChoice::Name(name) => format!("{name:?}"),
        };
        FieldError::new("/params/animation", format!("there is no animation {shown}; {}", listed(scene)))
    })
}

fn listed(scene: &Scene) -> String {
    if scene.animations.is_empty() {
        return "the file has none".to_owned();
    }
    let one = |(index, animation): (usize, &crate::scene::Animation)| match &animation.name {
        Some(name) => format!("{index} ({name:?})"),
        None => index.to_string(),
    };
    let shown: Vec<String> = scene.animations.iter().enumerate().take(20).map(one).collect();
    let more = scene.animations.len() - shown.len();
    let more = if more > 0 { format!(" and {more} more") } else { String::new() };
    format!("the file has {}{more}", shown.join(", "))
}
