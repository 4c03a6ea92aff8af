//! Light groups: a film's light split by what emitted it. Only sums over all samples are kept, not by replicate.

use super::{Film, TILE_PIXELS, TileSamples};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Light of one group.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Group {
    /// As the layer of the AOV has it.
    pub name: String,
    /// Sums of RGB, by tile, then lane.
    #[serde(with = "crate::pod")]
    pub(super) sums: Vec<[f64; 3]>,
}

impl Film {
    /// An empty film whose light is split.
    pub fn split(width: u32, height: u32, names: &[String]) -> Self {
        let mut film = Self::new(width, height);
        let lanes = film.tiles.count() as usize * TILE_PIXELS;
        film.groups = names.iter().map(|name| Group { name: name.clone(), sums: vec![[0.0; 3]; lanes] }).collect();
        film
    }

    /// Groups that the light is split by.
    pub fn groups(&self) -> usize {
        self.groups.len()
    }

    /// As [`Film::add`], of samples whose light is split: for each entry of `work` the sums of its 64 lanes, and behind them those of
    /// each group.
    ///
    /// # Panics
    /// As [`Film::add`].
    pub fn add_split(&mut self, work: &[TileSamples], sums: &[[f32; 4]]) {
        if self.groups.is_empty() {
            return self.add(work, sums);
        }
        let stride = (1 + self.groups.len()) * TILE_PIXELS;
        let whole: Vec<[f32; 4]> = sums.chunks_exact(stride).flat_map(|entry| &entry[..TILE_PIXELS]).copied().collect();
        self.add(work, &whole);
        self.groups.par_iter_mut().enumerate().for_each(|(index, group)| {
            for (entry, sums) in work.iter().zip(sums.chunks_exact(stride)) {
                let totals = &mut group.sums[entry.tile as usize * TILE_PIXELS..][..TILE_PIXELS];
                for (total, sum) in totals.iter_mut().zip(&sums[(1 + index) * TILE_PIXELS..]) {
                    total.iter_mut().zip(sum).for_each(|(total, sum)| *total += f64::from(*sum));
                }
            }
        });
    }

    /// The mean of each group per pixel, row by row from the top.
    pub(super) fn group_pictures(&self) -> Vec<(String, Vec<[f32; 3]>)> {
        let of = |group: &Group| {
            let pixel = |x, y| {
                let (tile, lane) = self.tiles.place(x, y);
                let per_sample = 1.0 / f64::from(self.tile_samples(tile).max(1));
                group.sums[tile as usize * TILE_PIXELS + lane as usize].map(|sum| (sum * per_sample) as f32)
            };
            let row = |y| (0..self.width()).map(move |x| pixel(x, y));
            (group.name.clone(), (0..self.height()).into_par_iter().flat_map_iter(row).collect())
        };
        self.groups.iter().map(of).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::film::{Aov, Changes, Seen};

    /// Two passes over the first tile, and one over the second.
    fn film(names: &[String]) -> (Film, Vec<Changes>) {
        let mut film = Film::split(16, 8, names);
        let mut seen = Seen::of(&film);
        let changes = [(0, 0, 0), (0, 1, 0), (1, 0, 0)].map(|(tile, replicate, first)| {
            let entry = TileSamples { tile, replicate, first, samples: 2 };
            let lanes = |light: [f32; 4]| [light; TILE_PIXELS];
            let group = |index: usize| lanes([2.0 + index as f32, tile as f32, replicate as f32, 0.0]);
            let whole = lanes([5.0, 2.0 * tile as f32, 2.0 * replicate as f32, 2.0]);
            let sums: Vec<_> = std::iter::once(whole).chain((0..names.len()).map(group)).flatten().collect();
            film.add_split(&[entry], &sums);
            seen.update(&film)
        });
        (film, changes.into())
    }

    #[test]
    fn groups_are_means_and_add_up() {
        let names = ["a".to_owned(), "b".to_owned()];
        let (film, changes) = film(&names);
        let (picture, groups) = (film.picture(), film.group_pictures());
        assert_eq!(groups.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>(), ["a", "b"]);
        for (place, pixel) in picture.pixels.iter().enumerate() {
            for (channel, whole) in pixel[..3].iter().enumerate() {
                let sum: f32 = groups.iter().map(|(_, pixels)| pixels[place][channel]).sum();
                assert!((sum - whole).abs() < 1e-6, "{sum} for {whole}");
            }
        }
        assert!(film.aovs().picture(Aov::LightGroups).is_some());
        // A copy that follows has the same, and one that is not split does not fit.
        let mut copy = Film::split(16, 8, &names);
        assert!(changes.into_iter().all(|changes| copy.follow(changes)));
        assert_eq!(copy.group_pictures(), groups);
        let mut seen = Seen::of(&Film::split(16, 8, &names));
        assert!(!Film::new(16, 8).follow(seen.update(&film)));
    }

    #[test]
    fn a_film_that_is_not_split_takes_whole_sums() {
        let (film, _) = film(&[]);
        assert!(film.group_pictures().is_empty() && film.aovs().picture(Aov::LightGroups).is_none());
        assert_eq!(film.picture().pixels[0][0], 2.5);
    }
}
