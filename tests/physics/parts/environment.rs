//! An HDRI's directions, densities and radiance.

use super::bins::test_density;
use super::kernel::{Fault, Kernel, words};
use super::quadrature::Rectangle;
use super::random::Random;
use super::verdict::{Verdict, smallest_found};
use crate::support::{params, scene, work_with_hdri};
use candela::compile::{ANY_FACING, Environment, EnvironmentKind, FACINGS, Hdri, TILES};
use candela::render::cpu::environment;
use glam::DVec3;
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// Draws of each picture.
const DRAWS: usize = 1 << 19;
/// Turn of the environment.
const ROTATION: f64 = 77.0;

/// Numbers and, in a word after them, a facing.
fn with_facing(numbers: [f64; 3], word: usize, facing: usize) -> [u32; 4] {
    let mut argument = words([numbers[0], numbers[1], numbers[2], 0.0]);
    argument[word] = facing as u32;
    argument
}

/// An implementation.
trait Sky {
    /// Direction and density for a surface of some facing.
    fn sample(&self, facing: usize, u: &[[f64; 3]]) -> Vec<(DVec3, f64)>;
    /// Radiance of the red channel and density.
    fn value(&self, facing: usize, directions: &[DVec3]) -> Vec<[f64; 2]>;
}

struct Shader {
    sample: Kernel,
    value: Kernel,
}

impl Shader {
    fn new(picture: &Picture, fault: Option<(Fault, f64)>) -> Self {
        let hdri = Arc::new(picture.hdri());
        let params = params(&format!(r#"{{"environment":{{"hdri":"x","rotation_degrees":{ROTATION}}}}}"#));
        let work = work_with_hdri(&scene(vec![]), &params, Some(hdri));
        Self { sample: Kernel::new(&work, "sky_sample", fault), value: Kernel::new(&work, "sky_value", fault) }
    }
}

impl Sky for Shader {
    fn sample(&self, facing: usize, u: &[[f64; 3]]) -> Vec<(DVec3, f64)> {
        let points: Vec<_> = u.iter().map(|u| with_facing([u[0], u[1], 0.0], 2, facing)).collect();
        self.sample.run(&[&points]).into_iter().map(|[x, y, z, pdf]| (DVec3::new(x, y, z), pdf)).collect()
    }

    fn value(&self, facing: usize, directions: &[DVec3]) -> Vec<[f64; 2]> {
        let directions: Vec<_> = directions.iter().map(|d| with_facing(d.to_array(), 3, facing)).collect();
        self.value.run(&[&directions]).into_iter().map(|[red, _, _, pdf]| [red, pdf]).collect()
    }
}

struct F64(Environment, Arc<Hdri>);

impl F64 {
    fn new(picture: &Picture) -> Self {
        let hdri = Arc::new(picture.hdri());
        let kind = EnvironmentKind::Hdri(Arc::clone(&hdri));
        Self(Environment { kind, rotation: ROTATION.to_radians() as f32, ..Environment::default() }, hdri)
    }
}

impl Sky for F64 {
    fn sample(&self, facing: usize, u: &[[f64; 3]]) -> Vec<(DVec3, f64)> {
        let samples = u.iter().map(|u| environment::sample(&self.1, self.0.rotation, facing, [u[0], u[1]]));
        samples.map(|s| (s.direction, s.pdf)).collect()
    }

    fn value(&self, facing: usize, directions: &[DVec3]) -> Vec<[f64; 2]> {
        let density = |d: &DVec3| environment::pdf(&self.1, self.0.rotation, facing, *d);
        let value = |d: &DVec3| [environment::radiance(&self.0, *d).x, density(d)];
        directions.iter().map(value).collect()
    }
}

/// A grey equirectangular picture.
struct Picture {
    name: &'static str,
    width: usize,
    height: usize,
    texels: Vec<f32>,
}

impl Picture {
    fn new(name: &'static str, width: usize, height: usize, texel: impl Fn(usize, usize) -> f64) -> Self {
        let texels = (0..width * height).map(|k| texel(k % width, k / width) as f32).collect();
        Self { name, width, height, texels }
    }

    fn hdri(&self) -> Hdri {
        let texels = self.texels.iter().map(|texel| [*texel; 3]).collect();
        Hdri::new(self.width as u32, self.height as u32, texels)
    }

    fn texel(&self, i: usize, j: usize) -> f64 {
        f64::from(self.texels[j.min(self.height - 1) * self.width + i % self.width])
    }

    /// Where a cell between texel centres lies: heights (of its lower and upper edge) and azimuths.
    fn cell(&self, i: usize, j: usize) -> Rectangle {
        let height = |v: f64| (PI * (v / self.height as f64).clamp(0.0, 1.0)).cos();
        let azimuth = |u: f64| TAU * (u / self.width as f64 - 0.5);
        let (i, j) = (i as f64, j as f64);
        Rectangle { low: [height(j + 0.5), azimuth(i + 0.5)], high: [height(j - 0.5), azimuth(i + 1.5)] }
    }

    /// Probability of each cell, row by row: mean of its four texels by solid angle; a black picture: solid angle. For a surface of some
    /// facing times what [`Self::squareness`] its tile has.
    fn probabilities(&self, facing: usize) -> Vec<f64> {
        let weight = |black: f64| {
            (0..self.width * (self.height + 1)).map(move |k| {
                let (i, j) = (k % self.width, k / self.width);
                let rows = [j.saturating_sub(1), j];
                let sum: f64 = rows.iter().map(|&j| self.texel(i, j) + self.texel(i + 1, j)).sum();
                let cell = self.cell(i, j);
                (0.25 * sum + black) * (cell.high[0] - cell.low[0]) * (cell.high[1] - cell.low[1])
            })
        };
        let mut weights: Vec<f64> = weight(0.0).collect();
        if weights.iter().all(|w| *w == 0.0) {
            weights = weight(1.0).collect();
        }
        let mut weights: Vec<f64> = self.squareness(&weights, facing).zip(&weights).map(|(part, w)| part * w).collect();
        let total: f64 = weights.iter().sum();
        weights.iter_mut().for_each(|w| *w /= total);
        weights
    }

    /// Per cell the cosine at which the light of its tile arrives: the mean of four normals of the facing by the mean direction of the tile's
    /// light, at least 0.03.
    fn squareness(&self, weights: &[f64], facing: usize) -> impl Iterator<Item = f64> {
        let tile = |k: usize| {
            let part = |cell: usize, cells: usize, tiles: usize| {
                (0..tiles).rfind(|t| t * cells / tiles <= cell).expect("the first tile begins at 0")
            };
            (part(k % self.width, self.width, TILES[0]), part(k / self.width, self.height + 1, TILES[1]))
        };
        let mut light = std::collections::HashMap::new();
        for (k, weight) in weights.iter().enumerate() {
            let (polar, azimuth) = (
                PI * (k / self.width) as f64 / self.height as f64,
                TAU * (((k % self.width) as f64 + 1.0) / self.width as f64 - 0.5),
            );
            let direction = DVec3::new(polar.sin() * azimuth.cos(), polar.cos(), polar.sin() * azimuth.sin());
            let (power, sum): &mut (f64, DVec3) = light.entry(tile(k)).or_default();
            *power += weight;
            *sum += *weight * direction;
        }
        let normals: Vec<DVec3> =
            [0.25, 0.75].iter().flat_map(|u| [0.25, 0.75].map(|v| facing_normal(facing, *u, v))).collect();
        let squareness = move |k: usize| match light[&tile(k)] {
            _ if facing == ANY_FACING => 1.0,
            (power, sum) if power > 0.0 => {
                let cosines = normals.iter().map(|n| n.dot(sum / power).max(0.0));
                (cosines.sum::<f64>() / 4.0).max(0.03)
            }
            _ => 0.03,
        };
        (0..weights.len()).map(squareness).collect::<Vec<_>>().into_iter()
    }

    /// Probability of a rectangle of heights and azimuths.
    fn probability(&self, cells: &[f64], over: &Rectangle) -> f64 {
        let mut sum = 0.0;
        for (k, p) in cells.iter().enumerate().filter(|(_, p)| **p > 0.0) {
            let cell = self.cell(k % self.width, k / self.width);
            let overlap = |axis: usize, turn: f64| {
                let low = (cell.low[axis] + turn).max(over.low[axis]);
                let high = (cell.high[axis] + turn).min(over.high[axis]);
                (high - low).max(0.0) / (cell.high[axis] - cell.low[axis])
            };
            // The last column passes the seam.
            sum += p * overlap(0, 0.0) * (overlap(1, 0.0) + overlap(1, -TAU));
        }
        sum
    }

    /// Place of a direction: column and row of its cell, and how far into it.
    fn place(&self, d: DVec3) -> ([usize; 2], [f64; 2]) {
        let [height, azimuth] = coordinates(d);
        let x = (azimuth / TAU + 0.5) * self.width as f64 - 0.5;
        let y = height.acos() / PI * self.height as f64 + 0.5;
        let column = x.floor().rem_euclid(self.width as f64) as usize;
        ([column, (y.floor() as usize).min(self.height)], [x - x.floor(), y - y.floor()])
    }

    fn radiance(&self, d: DVec3) -> f64 {
        let ([i, j], [u, v]) = self.place(d);
        let row = |j: usize| self.texel(i, j) * (1.0 - u) + self.texel(i + 1, j) * u;
        row(j.saturating_sub(1)) * (1.0 - v) + row(j) * v
    }
}

/// Normal at a place of a facing's square, in the picture's frame: the octahedron, its lower half folded out (Cigolle et al. 2014).
fn facing_normal(facing: usize, u: f64, v: f64) -> DVec3 {
    let at = |k: usize, within: f64| (k as f64 + within) / FACINGS as f64 * 2.0 - 1.0;
    let (x, z) = (at(facing % FACINGS, u), at(facing / FACINGS, v));
    let y = 1.0 - x.abs() - z.abs();
    if y >= 0.0 {
        DVec3::new(x, y, z).normalize()
    } else {
        DVec3::new((1.0 - z.abs()) * x.signum(), y, (1.0 - x.abs()) * z.signum()).normalize()
    }
}

/// (height, azimuth) of a direction of the world, in the picture's frame.
fn coordinates(d: DVec3) -> [f64; 2] {
    let d = DVec3::new(d.x, d.y, d.z).normalize();
    let rotation = f64::from(ROTATION.to_radians() as f32);
    // A picture turned by some angle about +y shows what lies that far back.
    let back = glam::DQuat::from_rotation_y(-rotation) * d;
    let axial = back.x * back.x + back.z * back.z;
    let height = if back.y.abs() > 0.7 { (1.0 - axial).max(0.0).sqrt().copysign(back.y) } else { back.y };
    [height, back.z.atan2(back.x)]
}

const SPHERE: Rectangle = Rectangle { low: [-1.0, -PI], high: [1.0, PI] };

fn pictures() -> Vec<Picture> {
    let noise = |i: usize, j: usize| Random((i * 7919 + j) as u64).unit();
    vec![
        Picture::new("sun, black band", 64, 32, move |i, j| match (i, j) {
            (20, 9) => 1e5,
            (_, 20..27) => 0.0,
            _ => 0.3 + noise(i, j),
        }),
        Picture::new("noise, odd sides", 61, 31, move |i, j| 100.0 * noise(i, j).powi(6)),
        Picture::new("bright poles", 32, 16, move |i, j| if j == 0 || j == 15 { 50.0 * noise(i, j) } else { 0.01 }),
        Picture::new("bright seam", 48, 24, move |i, _| if i == 0 || i == 47 { 9.0 } else { 0.2 }),
        Picture::new("two texels", 2, 1, |i, _| 1.0 + 2.0 * i as f64),
        Picture::new("black", 16, 8, |_, _| 0.0),
        Picture::new("fine", 512, 256, move |i, j| noise(i / 64, j / 32) + 0.01 * noise(i, j)),
    ]
}

/// Surfaces that are lit from both sides, that look up, and that look down and aside.
const SURFACES: [usize; 3] = [ANY_FACING, 8 * FACINGS + 8, 2 * FACINGS + 1];

fn judge(picture: &Picture, sky: &dyn Sky, verdict: &mut Verdict) {
    for facing in SURFACES {
        judge_facing(picture, sky, facing, verdict);
    }
}

fn judge_facing(picture: &Picture, sky: &dyn Sky, facing: usize, verdict: &mut Verdict) {
    let cells = picture.probabilities(facing);
    let draws = sky.sample(facing, &Random(picture.width as u64).points(DRAWS));
    let points: Vec<_> = draws.iter().map(|(d, _)| Some(coordinates(*d))).collect();
    let p = test_density(&points, SPHERE, |leaf| picture.probability(&cells, leaf));
    let name = format!("{}, facing {facing}", picture.name);
    verdict.probability(name.clone(), p);

    let directions: Vec<DVec3> = draws.iter().take(1 << 16).map(|(d, _)| *d).chain(all_around()).collect();
    let values = sky.value(facing, &directions);
    let (mut density, mut radiance, mut own) = (Vec::new(), Vec::new(), Vec::new());
    let brightest = picture.texels.iter().copied().fold(0.0f32, f32::max).max(1e-30);
    for (index, (d, [red, pdf])) in directions.iter().zip(values).enumerate() {
        radiance.push((red - picture.radiance(*d)).abs() / f64::from(brightest));
        let ([i, j], within) = picture.place(*d);
        // At a cell's very edge f32 may find its neighbour.
        if within.iter().any(|w| *w < 1e-3 || *w > 0.999) {
            continue;
        }
        let cell = picture.cell(i, j);
        let p = cells[j * picture.width + i];
        let got = pdf * (cell.high[0] - cell.low[0]) * (cell.high[1] - cell.low[1]);
        // The table's distribution functions are f32: a cell's probability has their absolute error, 2.4e-7 in all.
        density.push((got - p).abs() / (p + 0.012));
        if let Some((_, sampled)) = draws.get(index).filter(|_| index < 1 << 16) {
            own.push((sampled / pdf - 1.0).abs());
        }
    }
    verdict.deviation(format!("{name}, density"), density, 2e-5);
    verdict.deviation(format!("{name}, density of a sample"), own, 1e-6);
    verdict.deviation(format!("{name}, radiance"), radiance, 1e-5 + 1e-6 * picture.width as f64);
    integral(picture, sky, facing, verdict);
}

/// Directions of the whole sphere, rounded as the shader gets them.
fn all_around() -> impl Iterator<Item = DVec3> {
    let mut random = Random(9);
    (0..1 << 14).map(move |_| {
        let (height, azimuth) = (2.0 * random.unit() - 1.0, TAU * random.unit());
        let r = (1.0 - height * height).sqrt();
        DVec3::new(r * azimuth.cos(), height, r * azimuth.sin()).as_vec3().as_dvec3()
    })
}

/// The density integrates to 1: it is constant in each cell.
fn integral(picture: &Picture, sky: &dyn Sky, facing: usize, verdict: &mut Verdict) {
    let rotation = glam::DQuat::from_rotation_y(f64::from(ROTATION.to_radians() as f32));
    let cells: Vec<Rectangle> =
        (0..picture.width * (picture.height + 1)).map(|k| picture.cell(k % picture.width, k / picture.width)).collect();
    let middles: Vec<DVec3> = cells
        .iter()
        .map(|cell| {
            let (height, azimuth) = (0.5 * (cell.low[0] + cell.high[0]), 0.5 * (cell.low[1] + cell.high[1]));
            let r = (1.0 - height * height).sqrt();
            rotation * DVec3::new(r * azimuth.cos(), height, r * azimuth.sin())
        })
        .collect();
    let angles = cells.iter().map(|cell| (cell.high[0] - cell.low[0]) * (cell.high[1] - cell.low[1]));
    let sum: f64 = sky.value(facing, &middles).iter().zip(angles).map(|([_, pdf], angle)| pdf * angle).sum();
    verdict.deviation(format!("{}, facing {facing}, integral of the density", picture.name), [(sum - 1.0).abs()], 1e-5);
}

fn all(fault: Option<(Fault, f64)>, pictures: &[Picture]) -> Verdict {
    let mut verdict = Verdict::new("environment", "shader");
    for picture in pictures {
        judge(picture, &Shader::new(picture, fault), &mut verdict);
    }
    verdict
}

/// Pictures to find faults with: of many cells, of few.
const FAULTY: std::ops::Range<usize> = 3..5;

/// What is broken to see whether the tests find it.
const FAULTS: [(&str, Fault, f64); 5] = [
    (
        "height within a cell",
        Fault {
            right: "let depth = mix(from0, from1, within.y);",
            wrong: |e| format!("let depth = mix(from0, from1, pow(within.y, {}));", 1.0 + e),
        },
        0.05,
    ),
    (
        "azimuth (radians)",
        Fault {
            right: "let phi = 2.0 * PI * ((f32(cell.x) + 0.5 + within.x) / f32(size.x) - 0.5);",
            wrong: |e| format!("let phi = {e} + 2.0 * PI * ((f32(cell.x) + 0.5 + within.x) / f32(size.x) - 0.5);"),
        },
        0.01,
    ),
    (
        "density of a direction",
        Fault {
            right: "return share * textureLoad(environment_cells, cell, 0).y;",
            wrong: |e| format!("return {} * share * textureLoad(environment_cells, cell, 0).y;", 1.0 + e),
        },
        0.01,
    ),
    (
        "row of a sample",
        Fault {
            right: "let row = invert_distribution(band.within, ",
            wrong: |e| format!("let row = invert_distribution({:e} * band.within, ", 1.0 - e),
        },
        0.05,
    ),
    (
        "row of tiles of a sample",
        Fault {
            right: "let band = invert_distribution(u.y, ",
            wrong: |e| format!("let band = invert_distribution({:e} * u.y, ", 1.0 - e),
        },
        0.01,
    ),
];

#[test]
fn of_the_shader() {
    all(None, &pictures()).assert();
}

#[test]
fn of_the_f64_engine() {
    let mut verdict = Verdict::new("environment", "f64");
    for picture in pictures() {
        judge(&picture, &F64::new(&picture), &mut verdict);
    }
    verdict.assert();
}

#[test]
fn faults_are_found() {
    let pictures = &pictures()[FAULTY];
    for (name, fault, size) in FAULTS {
        assert!(!all(Some((fault, size)), pictures).failures().is_empty(), "{name}: a fault of {size} was not found");
    }
}

#[test]
#[ignore = "prints the power of the tests"]
fn power() {
    let pictures = &pictures()[FAULTY];
    for (name, fault, _) in FAULTS {
        let found = |size| !all(Some((fault, size)), pictures).failures().is_empty();
        eprintln!("| environment | {name} | {:?} |", smallest_found(found));
    }
}
