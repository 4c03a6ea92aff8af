//! An unfinished film on its way to the store and back, so that a render goes on where it was after a restart.

use super::memory::film_bytes;
use crate::film::Film;
use crate::render::DeviceInfo;
use bytes::Bytes;
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// Version of everything that a picture's bytes depend on besides scene and parameters: a hash of Candela's own source.
pub const ENGINE_VERSION: &str = env!("CANDELA_SOURCE_HASH");

/// What an interrupted render had made.
#[derive(Debug, Clone)]
pub struct SavedFilm {
    /// Its samples.
    pub film: Film,
    /// What it is of, besides scene and parameters.
    pub origin: Origin,
    /// Time of the device that went into it.
    pub attained: Duration,
    /// Time since the job began to be traced.
    pub spent: Duration,
}

/// Where samples come from. Those of another device or version are not mixed in: the picture would be neither's.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Origin {
    version: String,
    device: String,
    driver: String,
}

impl Origin {
    /// Samples that this version takes on a device.
    pub fn of(device: &DeviceInfo) -> Self {
        Self {
            version: ENGINE_VERSION.to_owned(),
            device: format!("{}; {}; {}", device.engine, device.name, device.backend),
            driver: device.driver.clone(),
        }
    }
}

#[derive(Serialize, Deserialize)]
struct Stored<F> {
    origin: Origin,
    attained: Duration,
    spent: Duration,
    film: F,
}

/// As it is stored; the film is not copied for it.
pub fn to_bytes(film: &Film, origin: Origin, attained: Duration, spent: Duration) -> Result<Bytes, postcard::Error> {
    let space = Vec::with_capacity(usize::try_from(bytes(film)).unwrap_or_default());
    postcard::to_extend(&Stored { origin, attained, spent, film }, space).map(Bytes::from)
}

/// Bytes of a film as it is stored, at the most.
pub fn bytes(film: &Film) -> u64 {
    film_bytes(film.width(), film.height(), film.groups())
}

impl SavedFilm {
    /// Back from the store; none: it was made by another version, or is damaged.
    pub fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let (origin, _): (Origin, _) = postcard::take_from_bytes(bytes).ok()?;
        if origin.version != ENGINE_VERSION {
            return None;
        }
        let Stored { origin, attained, spent, film } = postcard::from_bytes(bytes).ok()?;
        Some(Self { film, origin, attained, spent })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_film_is_read_back() {
        let mut film = Film::new(17, 9);
        film.fill([3, 2, 2, 2], |x, y, replicate, samples| {
            [(x + y + replicate) as f32 / 7.0, 0.1, samples as f32, 1.0]
        });
        let device =
            DeviceInfo { engine: "cpu", name: "a".into(), backend: "b".into(), driver: "c".into(), hardware: false };
        let second = Duration::from_secs(1);
        let bytes = to_bytes(&film, Origin::of(&device), second, second * 2).unwrap();
        let back = SavedFilm::from_bytes(&bytes).unwrap();
        assert_eq!(back.film.picture(), film.picture());
        assert_eq!(back.origin, Origin::of(&device));
        assert_eq!((back.attained, back.spent), (second, second * 2));
        assert!(SavedFilm::from_bytes(&bytes[..bytes.len() / 2]).is_none());
        let other = Origin { version: "another".to_owned(), ..Origin::of(&device) };
        assert!(SavedFilm::from_bytes(&to_bytes(&film, other, second, second).unwrap()).is_none());
    }
}
