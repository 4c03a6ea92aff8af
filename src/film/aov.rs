//! Pictures beside the picture: how sure each pixel is, how many samples it took, and of a denoised one what it was made from.

use super::{Film, Guides, Picture, Tiles};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// What a film can show besides its picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Aov {
    /// Standard error of each pixel and channel, in the unit of the radiance, from the spread of the replicates: with
    /// four of them it has three degrees of freedom.
    StandardError,
    /// Samples of each pixel, the same in all three channels.
    Samples,
    /// The picture before it was denoised.
    Undenoised,
    /// As [`Guides::albedo`], of a picture that was denoised.
    Albedo,
    /// As [`Guides::normal`], of a picture that was denoised.
    Normal,
    /// The picture's light split by what emitted it: a layer for each group, which add up to the picture before it was denoised.
    LightGroups,
}

impl Aov {
    /// All there are.
    pub const ALL: [Self; 6] =
        [Self::StandardError, Self::Samples, Self::Undenoised, Self::Albedo, Self::Normal, Self::LightGroups];

    /// As the API and the command line have it.
    pub fn name(self) -> &'static str {
        match self {
            Self::StandardError => "standard_error",
            Self::Samples => "samples",
            Self::Undenoised => "undenoised",
            Self::Albedo => "albedo",
            Self::Normal => "normal",
            Self::LightGroups => "light_groups",
        }
    }

    /// The one of that name.
    ///
    /// # Errors
    /// The names there are.
    pub fn from_name(name: &str) -> Result<Self, String> {
        let known = Self::ALL.into_iter().find(|aov| aov.name() == name);
        known.ok_or_else(|| format!("there is no `{name}`: ask for {}", Self::ALL.map(Self::name).join(" or ")))
    }

    /// Why a picture of so many samples per pixel, denoised or not, its light split or not, cannot have it; none: it can.
    pub fn lack(self, max_samples: u32, denoised: bool, split: bool) -> Option<&'static str> {
        match self {
            Self::StandardError if max_samples < 2 => {
                Some("one sample per pixel has no spread to measure: ask for a `max_samples` of 2 or more")
            }
            Self::Undenoised | Self::Albedo | Self::Normal if !denoised => {
                Some("only a picture that was denoised has it (`denoise: true`); any other is undenoised as it is")
            }
            Self::LightGroups if !split => {
                Some("only a picture whose light was split has it: ask for `light_groups: {}`")
            }
            _ => None,
        }
    }
}

/// What is kept of a film for its AOVs.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Aovs {
    tiles: Tiles,
    /// By pixel; none if there were too few replicates.
    standard_error: Option<Vec<[f32; 3]>>,
    /// Samples by tile.
    samples: Vec<u32>,
    denoised: Option<Denoised>,
    /// Light groups with their names, by pixel.
    groups: Vec<(String, Vec<[f32; 3]>)>,
}

/// What a denoised picture was made from.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Denoised {
    #[serde(with = "crate::pod")]
    light: Vec<[f32; 3]>,
    guides: Guides,
}

impl Film {
    /// What its AOVs are made from.
    pub fn aovs(&self) -> Aovs {
        let deviation = |x, y| {
            let (tile, lane) = self.tiles.place(x, y);
            self.pixel_moments(tile, lane).1.map(|variance| variance.sqrt() as f32)
        };
        let row = |y| (0..self.width()).map(move |x| deviation(x, y));
        let measured = || (0..self.height()).into_par_iter().flat_map_iter(row).collect();
        Aovs {
            tiles: self.tiles,
            standard_error: (self.used_replicates() >= 2).then(measured),
            samples: (0..self.tiles.count()).map(|tile| self.tile_samples(tile)).collect(),
            denoised: None,
            groups: self.group_pictures(),
        }
    }
}

impl Aovs {
    /// Keeps what the picture was made from.
    pub fn note_denoised(&mut self, undenoised: &Picture, guides: Guides) {
        let light = undenoised.pixels.iter().map(|&[r, g, b, _]| [r, g, b]).collect();
        self.denoised = Some(Denoised { light, guides });
    }

    /// One as a picture with full coverage; none: the film has too few samples for it, or was not denoised ([`Aov::lack`]).
    pub fn picture(&self, aov: Aov) -> Option<Picture> {
        let (width, height) = (self.tiles.width(), self.tiles.height());
        let opaque = |[r, g, b]: [f32; 3]| [r, g, b, 1.0];
        let pictured = |values: &[[f32; 3]]| values.iter().copied().map(opaque).collect();
        let pixels = match aov {
            Aov::StandardError => pictured(self.standard_error.as_ref()?),
            Aov::Undenoised => pictured(&self.denoised.as_ref()?.light),
            Aov::Albedo => pictured(&self.denoised.as_ref()?.guides.albedo),
            Aov::Normal => pictured(&self.denoised.as_ref()?.guides.normal),
            Aov::LightGroups => {
                let (_, first) = self.groups.first()?;
                let mut sum = first.clone();
                for (_, pixels) in self.groups.iter().skip(1) {
                    let pairs = sum.iter_mut().zip(pixels);
                    pairs.for_each(|(sum, pixel)| sum.iter_mut().zip(pixel).for_each(|(sum, light)| *sum += light));
                }
                pictured(&sum)
            }
            Aov::Samples => {
                let samples = |x, y| self.samples[self.tiles.place(x, y).0 as usize] as f32;
                (0..height).flat_map(|y| (0..width).map(move |x| opaque([samples(x, y); 3]))).collect()
            }
        };
        Some(Picture { width, height, pixels })
    }

    /// Layers that an AOV has besides its picture: names and RGB by pixel.
    pub(super) fn layers(&self, aov: Aov) -> &[(String, Vec<[f32; 3]>)] {
        if aov == Aov::LightGroups { &self.groups } else { &[] }
    }

    /// Memory that it takes.
    pub fn bytes(&self) -> usize {
        let of_denoised = |denoised: &Denoised| size_of_val(denoised.light.as_slice()) + denoised.guides.bytes();
        size_of_val(self.samples.as_slice())
            + self.standard_error.as_deref().map_or(0, size_of_val)
            + self.denoised.as_ref().map_or(0, of_denoised)
            + self.groups.iter().map(|(_, pixels)| size_of_val(pixels.as_slice())).sum::<usize>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::film::REPLICATES;

    #[test]
    fn the_standard_error_is_that_of_the_mean_of_the_replicates() {
        let mut film = Film::new(17, 9);
        film.fill([2; REPLICATES], |x, _, replicate, samples| {
            let mean = x as f32 + [0.0, 1.0, 2.0, 5.0][replicate as usize];
            [samples as f32 * mean, samples as f32, samples as f32 * 2.0 * mean, samples as f32]
        });
        let aovs = film.aovs();
        // Squares about the mean 2: 4 + 1 + 0 + 9, over 3 degrees of freedom and 4 replicates.
        let expected = (14.0f32 / 12.0).sqrt();
        for pixel in aovs.picture(Aov::StandardError).unwrap().pixels {
            assert!((pixel[0] - expected).abs() < 1e-6 && (pixel[2] - 2.0 * expected).abs() < 1e-6, "{pixel:?}");
            assert_eq!((pixel[1], pixel[3]), (0.0, 1.0));
        }
        assert!(aovs.picture(Aov::Samples).unwrap().pixels.iter().all(|&pixel| pixel == [8.0, 8.0, 8.0, 1.0]));
    }

    #[test]
    fn one_replicate_has_no_standard_error() {
        let mut film = Film::new(3, 3);
        film.fill([1, 0, 0, 0], |_, _, _, _| [1.0; 4]);
        assert_eq!(film.aovs().picture(Aov::StandardError), None);
        assert!(film.aovs().picture(Aov::Samples).is_some());
    }

    #[test]
    fn a_denoised_picture_has_what_it_was_made_from() {
        let mut film = Film::new(2, 1);
        film.fill([1; REPLICATES], |x, _, _, _| [x as f32, 1.0, 2.0, 0.5]);
        let mut aovs = film.aovs();
        assert_eq!(aovs.picture(Aov::Undenoised), None);
        assert!(Aov::Undenoised.lack(4, false, false).is_some() && Aov::Undenoised.lack(4, true, false).is_none());
        let before = aovs.bytes();
        let guides = Guides { albedo: vec![[0.5; 3]; 2], normal: vec![[0.0, -1.0, 0.0]; 2] };
        aovs.note_denoised(&film.picture(), guides);
        let pixels = |aov| aovs.picture(aov).unwrap().pixels;
        assert_eq!(pixels(Aov::Undenoised), [[0.0, 1.0, 2.0, 1.0], [1.0, 1.0, 2.0, 1.0]]);
        assert_eq!((pixels(Aov::Albedo)[1], pixels(Aov::Normal)[0]), ([0.5, 0.5, 0.5, 1.0], [0.0, -1.0, 0.0, 1.0]));
        assert_eq!(aovs.bytes() - before, 72);
    }

    #[test]
    fn names_are_read_back() {
        assert!(Aov::ALL.into_iter().all(|aov| Aov::from_name(aov.name()) == Ok(aov)));
        assert!(Aov::from_name("depth").unwrap_err().contains("standard_error or samples or"));
    }
}
