//! Profiles of lights as `shaders/lib/profile.wesl` reads them.

use crate::scene::Profile;

/// For each profile four words (where its numbers begin, angles from the pole, angles around it, type), then the numbers of each:
/// angles from the pole, angles around it, candela by the latter.
pub fn words(profiles: &[Profile]) -> Vec<u32> {
    let mut words = Vec::new();
    let mut first = 4 * profiles.len();
    for profile in profiles {
        let (around, from_pole) = profile.size();
        words.extend([first as u32, from_pole, around, profile.web as u32]);
        first += profile.polar.len() + profile.azimuth.len() + profile.candela.len();
    }
    for profile in profiles {
        let numbers = [&profile.polar, &profile.azimuth, &profile.candela];
        words.extend(numbers.into_iter().flatten().map(|number| number.to_bits()));
    }
    words
}
