//! Measured distributions of one request's lights, each once.

use super::{CompileError, PunctualLight};
use crate::params::FieldError;
use crate::scene::Profile;
use std::collections::HashMap;
use std::sync::Arc;

/// Bytes of all profiles of a request together, at the most.
const MOST_BYTES: usize = 64 << 20;

/// Profiles as they are met.
#[derive(Debug, Default)]
pub struct Profiles {
    list: Vec<Arc<Profile>>,
    /// By address.
    known: HashMap<*const Profile, u32>,
    bytes: usize,
}

impl Profiles {
    /// Gives a light a profile, and so its zero azimuth a meaning.
    ///
    /// # Errors
    /// They are too many; `place` names the light.
    pub fn lay(&mut self, profile: &Arc<Profile>, light: &mut PunctualLight, place: &str) -> Result<(), CompileError> {
        let next = self.list.len() as u32 + 1;
        let place_in_list = *self.known.entry(Arc::as_ptr(profile)).or_insert(next);
        if place_in_list == next {
            self.list.push(Arc::clone(profile));
            self.bytes += profile.bytes();
        }
        if self.bytes > MOST_BYTES || next > u32::from(u16::MAX) {
            let detail = format!(
                "the profiles of all lights are {} tables of {} bytes, above the limits of {} and {MOST_BYTES}: use fewer, or coarser ones",
                self.list.len(),
                self.bytes,
                u16::MAX
            );
            return Err(FieldError::new(place, detail).into());
        }
        light.kind |= place_in_list << PunctualLight::PROFILE_SHIFT;
        Ok(())
    }

    /// All of them.
    pub fn list(&self) -> Vec<Profile> {
        self.list.iter().map(|profile| Profile::clone(profile)).collect()
    }
}
