//! What a film has gained since someone looked, so that a copy of it elsewhere keeps up.

use super::{Film, TILE_PIXELS};
use serde::{Deserialize, Serialize};

/// What a copy of a film has.
#[derive(Debug, Default)]
pub struct Seen {
    counts: Vec<u32>,
    has_rates: bool,
}

/// Cells (a tile in a replicate) of a film that have changed, as they are now.
#[derive(Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Changes {
    cells: Vec<u32>,
    counts: Vec<u32>,
    #[serde(with = "crate::pod")]
    sums: Vec<[f64; 4]>,
    /// Of each group the lanes of the tile of each of the cells.
    #[serde(with = "crate::pod::nested")]
    groups: Vec<Vec<[f64; 3]>>,
    rates: Option<Vec<i8>>,
}

impl Seen {
    /// What a copy of this film has.
    pub fn of(film: &Film) -> Self {
        Self { counts: film.counts.clone(), has_rates: film.rates.is_some() }
    }

    /// What the film has gained since, which counts as seen from now on.
    pub fn update(&mut self, film: &Film) -> Changes {
        self.counts.resize(film.counts.len(), 0);
        let mut changes = Changes { groups: vec![Vec::new(); film.groups.len()], ..Changes::default() };
        for (cell, (seen, now)) in self.counts.iter_mut().zip(&film.counts).enumerate() {
            if seen != now {
                *seen = *now;
                changes.cells.push(cell as u32);
                changes.counts.push(*now);
                changes.sums.extend_from_slice(&film.sums[cell * TILE_PIXELS..][..TILE_PIXELS]);
                let tile = cell % film.tiles.count() as usize;
                for (lanes, group) in changes.groups.iter_mut().zip(&film.groups) {
                    lanes.extend_from_slice(&group.sums[tile * TILE_PIXELS..][..TILE_PIXELS]);
                }
            }
        }
        if !self.has_rates {
            changes.rates.clone_from(&film.rates);
            self.has_rates = film.rates.is_some();
        }
        changes
    }
}

impl Changes {
    /// Whether there are any.
    pub fn is_empty(&self) -> bool {
        self.cells.is_empty() && self.rates.is_none()
    }
}

impl Film {
    /// Brings a copy up to date, to the same bits; false if the changes are not of such a film.
    pub fn follow(&mut self, changes: Changes) -> bool {
        let Changes { cells, counts, sums, groups, rates } = changes;
        let fits = counts.len() == cells.len()
            && sums.len() == cells.len() * TILE_PIXELS
            && groups.len() == self.groups.len()
            && groups.iter().all(|lanes| lanes.len() == sums.len())
            && cells.iter().all(|&cell| (cell as usize) < self.counts.len())
            && rates.as_ref().is_none_or(|rates| rates.len() == self.tiles.count() as usize);
        if !fits {
            return false;
        }
        for ((&cell, &count), sums) in cells.iter().zip(&counts).zip(sums.chunks_exact(TILE_PIXELS)) {
            self.counts[cell as usize] = count;
            self.sums[cell as usize * TILE_PIXELS..][..TILE_PIXELS].copy_from_slice(sums);
        }
        for (group, lanes) in self.groups.iter_mut().zip(&groups) {
            for (&cell, lanes) in cells.iter().zip(lanes.chunks_exact(TILE_PIXELS)) {
                let tile = cell as usize % self.tiles.count() as usize;
                group.sums[tile * TILE_PIXELS..][..TILE_PIXELS].copy_from_slice(lanes);
            }
        }
        self.rates = rates.or(self.rates.take());
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_copy_keeps_up_to_the_bit() {
        let (mut film, mut copy) = (Film::new(37, 19), Film::new(37, 19));
        let mut seen = Seen::of(&copy);
        for round in 0..6 {
            film.fill([2, 2, 2, 2], |x, y, r, n| [(x * 7 + y * 3 + r + round) as f32 / 9.0, 0.1, n as f32, 1.0]);
            let bytes = postcard::to_stdvec(&seen.update(&film)).unwrap();
            assert!(copy.follow(postcard::from_bytes(&bytes).unwrap()));
            assert_eq!(copy.picture(), film.picture());
            assert_eq!((copy.error(), copy.rates()), (film.error(), film.rates()));
        }
        assert!(film.rates().is_some() && seen.update(&film).is_empty());
        assert!(!Film::new(8, 8).follow(Seen::default().update(&film)), "another size");
    }
}
