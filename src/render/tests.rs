//! Adaptive sampling on pictures whose truth is known: the schedule and the film together.

use super::plan::Round;
use super::schedule::Schedule;
use super::{Settings, StopReason};
use crate::film::testing::{Noise, Random, gaussian, log_normal, spikes, true_error, truth};
use crate::film::{Film, TileSamples};
use crate::params::RenderParams;
use rayon::prelude::*;
use std::ops::ControlFlow;
use std::time::Duration;

/// Two-sided 1 % quantile of the normal distribution for two tests at once (Sidak).
const Z_LIMIT: f64 = 2.806;

fn settings(max_samples: u32, adaptive: bool) -> Settings {
    Settings::from(&RenderParams { max_samples, adaptive, ..RenderParams::default() })
}

/// How samples are allotted.
#[derive(Clone, Copy, PartialEq)]
enum Scheme {
    Uniform,
    /// As renders do it.
    Adaptive,
    /// Each tile by what it has found itself.
    Naive,
}

/// Noise is strong in one part of the picture and weak in the rest.
fn strength(x: u32, y: u32) -> f64 {
    if x % 96 >= 48 && y % 48 < 24 { 1.0 } else { 0.1 }
}

/// Takes all samples of a synthetic render.
fn simulate(
    (width, height): (u32, u32),
    scheme: Scheme,
    max_samples: u32,
    mut sample: impl FnMut(u32, u32) -> f64,
) -> Film {
    let mut film = Film::new(width, height);
    let schedule = Schedule::new(&settings(max_samples, scheme != Scheme::Uniform));
    while let ControlFlow::Continue(pass) = schedule.next(&film, Duration::ZERO) {
        let mut sum = |entry: &TileSamples, (x, y): (u32, u32)| {
            let sum = (0..entry.samples).map(|_| sample(x, y) as f32).sum::<f32>();
            [sum, sum, sum, entry.samples as f32]
        };
        let sums = film.tiles().lanes(&pass, &mut sum);
        let before_pilot = film.rates().is_none();
        film.add(&pass, &sums);
        if scheme == Scheme::Naive && before_pilot {
            film.let_tiles_rate_themselves();
        }
    }
    film
}

/// Z of the mean of a white picture over many runs.
fn bias(scheme: Scheme, noise: Noise, runs: u64) -> f64 {
    let mean = |run: u64| {
        let mut random = Random(run << 32);
        let film = simulate((96, 8), scheme, 64, |x, y| 1.0 + strength(x, y) * (noise(&mut random) - 1.0));
        film.picture().pixels.iter().map(|pixel| f64::from(pixel[0])).sum::<f64>() / 768.0
    };
    let means: Vec<f64> = (1..=runs).into_par_iter().map(mean).collect();
    let count = runs as f64;
    let mean = means.iter().sum::<f64>() / count;
    let variance = means.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / (count - 1.0);
    eprintln!("mean {mean} of {runs} runs");
    (mean - 1.0) / (variance / count).sqrt()
}

#[test]
fn adaptive_pictures_are_unbiased_and_the_test_would_see_it() {
    for (name, noise, runs) in [("spikes", spikes as Noise, 10_000), ("log-normal", log_normal, 2_000)] {
        let z = bias(Scheme::Adaptive, noise, runs);
        eprintln!("{name}: Z = {z:.2}");
        assert!(z.abs() < Z_LIMIT, "{name}: the mean of adaptive pictures is off, Z = {z}");
    }
    let z = bias(Scheme::Naive, spikes, 2_000);
    eprintln!("spikes, naive: Z = {z:.2}");
    assert!(z < -2.0 * Z_LIMIT, "tiles that rate themselves are not found out: Z = {z}");
}

/// A render of the picture of `film::testing`.
fn render(size: (u32, u32), scheme: Scheme, max_samples: u32, noise: Noise, seed: u64) -> Film {
    let mut random = Random(seed);
    let truth = truth(size.0, size.1);
    simulate(size, scheme, max_samples, |x, y| {
        truth[(y * size.0 + x) as usize] * (1.0 + strength(x, y) * (noise(&mut random) - 1.0))
    })
}

#[test]
fn the_stated_error_of_adaptive_pictures_is_the_true_error() {
    for (noise, tolerance) in [(gaussian as Noise, 0.02), (log_normal, 0.05)] {
        for samples in [24, 64, 100] {
            let ratio = |seed: u64| {
                let film = render((160, 100), Scheme::Adaptive, samples, noise, seed);
                let (least, most) = film.samples_range();
                assert!(least < samples && most > samples, "{least} to {most} samples");
                film.error().unwrap().relative_rms / true_error(&film)
            };
            let ratio = (1..=8).into_par_iter().map(ratio).sum::<f64>() / 8.0;
            eprintln!("{samples} samples: stated over true {ratio:.4}");
            assert!((ratio - 1.0).abs() < tolerance, "{samples} samples: stated over true error is {ratio}");
        }
    }
}

#[test]
fn the_bound_holds_in_95_of_100_adaptive_renders() {
    for (name, noise) in [("gaussian", gaussian as Noise), ("log-normal", log_normal)] {
        for size in [(16, 16), (64, 48)] {
            let trials = 400;
            let held = |trial: &u64| {
                let film = render(size, Scheme::Adaptive, 48, noise, 1000 + trial);
                true_error(&film) <= film.error().unwrap().upper_bound_95
            };
            let share = (0..trials).into_par_iter().filter(held).count() as f64 / trials as f64;
            eprintln!("{name} {size:?}: {share}");
            assert!(share >= 0.95, "{name} noise, {size:?} pixels: the bound held in {share} of the renders");
        }
    }
}

#[test]
fn adaptive_pictures_have_less_error_for_the_same_samples() {
    let error = |scheme| render((192, 96), scheme, 96, gaussian, 3).error().unwrap().relative_rms;
    let gain = (error(Scheme::Uniform) / error(Scheme::Adaptive)).powi(2);
    assert!(gain > 1.5, "{gain} times fewer samples");
}

#[test]
fn the_budget_is_spent_but_for_less_than_a_sample_of_a_tile() {
    for size in [(160, 100), (33, 9), (17, 1), (8, 8), (1, 1)] {
        for samples in [1, 15, 16, 17, 23, 64, 100, 257, 1000] {
            let film = render(size, Scheme::Adaptive, samples, gaussian, 11);
            let budget = u64::from(samples) * u64::from(size.0 * size.1);
            let left = budget - film.pixel_samples();
            assert!(left < 128, "{size:?}, {samples} samples: {left} of {budget} left");
            assert_eq!(film.samples(), samples.min(film.samples()), "never more than asked for");
        }
    }
}

#[test]
fn even_noise_gets_even_samples() {
    let mut random = Random(5);
    let film = simulate((160, 96), Scheme::Adaptive, 100, |_, _| gaussian(&mut random));
    assert_eq!(film.samples_range(), (100, 100));
    let constant = simulate((160, 96), Scheme::Adaptive, 100, |_, _| 0.7);
    assert_eq!(constant.samples_range(), (100, 100));
}

#[test]
fn counts_in_whole_rounds_are_powers_of_two_and_equal_in_all_replicates() {
    let settings = settings(4096, true);
    let mut random = Random(9);
    let mut film = render((64, 48), Scheme::Adaptive, 16, gaussian, 9);
    let (mut rounds, mut most) = (0, 0);
    while most < 64 {
        let round = Round::of(&settings, &film).unwrap();
        let entries: Vec<TileSamples> = (0..4)
            .flat_map(|replicate| (0..film.tiles().count()).map(move |tile| (replicate, tile)))
            .map(|(replicate, tile)| {
                let first = film.replicate_samples(replicate, tile);
                TileSamples { tile, replicate, first, samples: round.goal(replicate, tile) - first }
            })
            .collect();
        assert!(round.is_new);
        let sums = film.tiles().lanes(&entries, |entry, _| [(random.uniform() * f64::from(entry.samples)) as f32; 4]);
        film.add(&entries, &sums);
        for tile in 0..film.tiles().count() {
            let counts = [0, 1, 2, 3].map(|replicate| film.replicate_samples(replicate, tile));
            assert!(counts.iter().all(|&count| count == counts[0] && (count.is_power_of_two() || count > 64)));
            most = most.max(counts[0]);
        }
        rounds += 1;
    }
    assert!(rounds > 6, "{rounds} rounds");
}

#[test]
fn a_render_goes_on_from_the_middle_of_a_round() {
    let schedule = Schedule::new(&settings(64, true));
    let mut random = Random(4);
    let mut film = render((64, 48), Scheme::Adaptive, 16, gaussian, 4);
    let mut again = film.clone();
    while let ControlFlow::Continue(pass) = schedule.next(&film, Duration::ZERO) {
        let ControlFlow::Continue(same) = Schedule::new(&settings(64, true)).next(&again, Duration::ZERO) else {
            panic!("the other has ended");
        };
        assert_eq!(pass, same);
        let sums = film.tiles().lanes(&pass, |_, _| [random.uniform() as f32; 4]);
        film.add(&pass, &sums);
        again = film.clone();
    }
    assert_eq!(schedule.next(&again, Duration::ZERO).break_value(), Some(StopReason::MaxSamples));
}
