//! Sobol points: stratified within a sequence, independent between sequences; hashes: uniform and independent.

use super::bins::test_uniform;
use super::kernel::{Fault, Kernel, nothing};
use super::random::Random;
use super::statistics::normal;
use super::verdict::{Verdict, smallest_found};
use candela::render::cpu::sampler::{Dimension, Sampler};

/// Sequences whose points are counted in elementary intervals.
const SEQUENCES: usize = 1024;
/// Binary logarithm of the points of each.
const POINTS: u32 = 10;
/// Pairs of numbers of each test of independence.
const PAIRS: usize = 1 << 18;
/// Cells to a side of those tests.
const SIDE: usize = 32;
/// Pairs of sequences whose means are correlated, and the points of each mean.
const MEANS: usize = 1 << 14;
const MEAN_POINTS: u32 = 16;

/// Which number: pixel, sample, replicate, seed; then the dimension or key.
#[derive(Debug, Clone, Copy)]
struct Place {
    pixel: u32,
    sample: u32,
    replicate: u32,
    seed: u32,
    dimension: u32,
}

/// An implementation.
trait Numbers {
    /// For the verdict.
    fn engine(&self) -> &'static str;
    /// Points of the square.
    fn sobol(&self, places: &[Place]) -> Vec<[f64; 2]>;
    /// Single numbers.
    fn hashes(&self, places: &[Place]) -> Vec<f64>;
}

struct Shader {
    sobol: Kernel,
    hashes: Kernel,
}

impl Shader {
    fn new(fault: Option<(Fault, f64)>) -> Self {
        let kernel = |entry| Kernel::new(&nothing(), entry, fault);
        Self { sobol: kernel("sobol"), hashes: kernel("hashes") }
    }

    fn run(kernel: &Kernel, places: &[Place]) -> Vec<[f64; 4]> {
        let first: Vec<_> = places.iter().map(|p| [p.pixel, p.sample, p.replicate, p.seed]).collect();
        let second: Vec<_> = places.iter().map(|p| [p.dimension; 4]).collect();
        kernel.run(&[&first, &second])
    }
}

impl Numbers for Shader {
    fn engine(&self) -> &'static str {
        "shader"
    }

    fn sobol(&self, places: &[Place]) -> Vec<[f64; 2]> {
        Self::run(&self.sobol, places).into_iter().map(|[x, y, ..]| [x, y]).collect()
    }

    fn hashes(&self, places: &[Place]) -> Vec<f64> {
        Self::run(&self.hashes, places).into_iter().map(|[x, ..]| x).collect()
    }
}

struct F64;

impl F64 {
    fn sampler(p: &Place) -> Sampler {
        Sampler::new(p.pixel, p.sample, p.replicate, p.seed, true)
    }
}

impl Numbers for F64 {
    fn engine(&self) -> &'static str {
        "f64"
    }

    fn sobol(&self, places: &[Place]) -> Vec<[f64; 2]> {
        let kinds: [fn(u32) -> Dimension; 4] = [Dimension::Lobe, Dimension::Choice, Dimension::Pick, Dimension::Light];
        places.iter().map(|p| Self::sampler(p).pair(kinds[p.dimension as usize % 4](p.dimension / 4))).collect()
    }

    fn hashes(&self, places: &[Place]) -> Vec<f64> {
        places.iter().map(|p| Self::sampler(p).chance([u64::from(p.dimension), 1])).collect()
    }
}

fn judge(numbers: &dyn Numbers) -> Verdict {
    let mut verdict = Verdict::new("Sobol points and hashes", numbers.engine());
    stratification(numbers, &mut verdict);
    independence(numbers, &mut verdict);
    means(numbers, &mut verdict);
    hashes(numbers, &mut verdict);
    verdict
}

/// Every elementary interval of every power of two holds its one point: (0, m, 2)-nets for all m, from the start of the
/// sequence and from every multiple of the power.
fn stratification(numbers: &dyn Numbers, verdict: &mut Verdict) {
    let mut random = Random(5);
    let mut broken = 0u32;
    for _ in 0..SEQUENCES / 64 {
        let places: Vec<Place> = (0..64).flat_map(|_| sequence(&mut random)).collect();
        for points in numbers.sobol(&places).chunks_exact(1 << POINTS) {
            broken += u32::from(!(0..=POINTS).all(|m| points.chunks_exact(1 << m).all(|net| is_net(net, m))));
        }
    }
    verdict.deviation(format!("of {SEQUENCES} sequences not stratified"), [f64::from(broken)], 0.0);
}

fn sequence(random: &mut Random) -> impl Iterator<Item = Place> + use<> {
    let mut any = |below: u64| (random.bits() % below) as u32;
    let first = Place { pixel: any(1 << 26), sample: 0, replicate: any(4), seed: any(1 << 32), dimension: any(400) };
    (0..1 << POINTS).map(move |sample| Place { sample, ..first })
}

/// Whether `2^m` points have one in each interval of `2^-a` by `2^(a - m)`, for all a.
fn is_net(points: &[[f64; 2]], m: u32) -> bool {
    (0..=m).all(|a| {
        let (across, down) = (f64::from(1 << a), f64::from(1 << (m - a)));
        let mut seen = vec![false; points.len()];
        for [x, y] in points {
            seen[((y * down) as usize) << a | (x * across) as usize] = true;
        }
        seen.into_iter().all(|s| s)
    })
}

/// From one place to another.
type Neighbour = fn(Place) -> Place;

/// Pairs of numbers that must not know of each other: the place of the second as a function of the first's.
const NEIGHBOURS: [(&str, Neighbour); 8] = [
    ("pixel to the right", |p| Place { pixel: p.pixel + 1, ..p }),
    ("pixel below", |p| Place { pixel: p.pixel + 1024, ..p }),
    ("next replicate", |p| Place { replicate: p.replicate + 1, ..p }),
    ("next seed", |p| Place { seed: p.seed + 1, ..p }),
    ("next dimension", |p| Place { dimension: p.dimension + 1, ..p }),
    ("next vertex", |p| Place { dimension: p.dimension + 5, ..p }),
    ("pixel and seed exchanged", |p| Place { pixel: p.seed, seed: p.pixel, ..p }),
    ("pixel and replicate exchanged", |p| Place { pixel: p.replicate, replicate: p.pixel, ..p }),
];

/// One place in each of many pixels of a picture 1024 wide, in raster order as the renderer asks.
fn raster() -> Vec<Place> {
    (0..PAIRS as u32).map(|pixel| Place { pixel, sample: pixel % 7, replicate: 1, seed: 3, dimension: 2 }).collect()
}

fn independence(numbers: &dyn Numbers, verdict: &mut Verdict) {
    let here = raster();
    let points = numbers.sobol(&here);
    verdict.probability("the two of a pair".into(), test_uniform(&points, SIDE));
    for (name, neighbour) in NEIGHBOURS {
        let there: Vec<Place> = here.iter().map(|p| neighbour(*p)).collect();
        let others = numbers.sobol(&there);
        for k in 0..2 {
            let pairs: Vec<_> = points.iter().zip(&others).map(|(a, b)| [a[k], b[k]]).collect();
            verdict.probability(format!("{name}, coordinate {k}"), test_uniform(&pairs, SIDE));
        }
    }
}

/// Errors of means over whole sequences are not correlated between sequences: the film's replicates rely on it.
fn means(numbers: &dyn Numbers, verdict: &mut Verdict) {
    let errors = |neighbour: &dyn Fn(Place) -> Place| {
        let place = |i: u32| Place { pixel: i, sample: 0, replicate: 0, seed: 11, dimension: 7 };
        let of_sequence = |i| (0..MEAN_POINTS).map(move |sample| Place { sample, ..place(i) });
        let places: Vec<Place> = (0..MEANS as u32).flat_map(of_sequence).map(neighbour).collect();
        let sums = numbers.sobol(&places);
        let means = sums.chunks_exact(MEAN_POINTS as usize);
        means.map(|points| points.iter().map(|[x, y]| f64::from(x + y < 0.7)).sum::<f64>()).collect::<Vec<f64>>()
    };
    let here = errors(&|p| p);
    for (name, neighbour) in NEIGHBOURS {
        let r = correlation(&here, &errors(&neighbour));
        verdict.probability(format!("{name}, means"), normal(r * (MEANS as f64).sqrt()));
    }
}

fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let n = a.len() as f64;
    let mean = |v: &[f64]| v.iter().sum::<f64>() / n;
    let (ma, mb) = (mean(a), mean(b));
    let covariance: f64 = a.iter().zip(b).map(|(x, y)| (x - ma) * (y - mb)).sum();
    let square = |v: &[f64], m: f64| v.iter().map(|x| (x - m).powi(2)).sum::<f64>();
    covariance / (square(a, ma) * square(b, mb)).sqrt()
}

/// Hashes along a ray: uniform, and independent of those of neighbours, of the next key and of the next sample.
fn hashes(numbers: &dyn Numbers, verdict: &mut Verdict) {
    let here = raster();
    let values = numbers.hashes(&here);
    let more: [(&str, Neighbour); 2] = [
        ("next sample", |p| Place { sample: p.sample + 1, ..p }),
        ("key of the shadow ray", |p| Place { dimension: p.dimension + 2, ..p }),
    ];
    for (name, neighbour) in NEIGHBOURS.into_iter().chain(more) {
        let there: Vec<Place> = here.iter().map(|p| neighbour(*p)).collect();
        let pairs: Vec<_> = values.iter().zip(numbers.hashes(&there)).map(|(a, b)| [*a, b]).collect();
        verdict.probability(format!("{name}, hashes"), test_uniform(&pairs, SIDE));
    }
}

/// What is broken to see whether the tests find it.
const FAULTS: [(&str, Fault, f64); 4] = [
    (
        "a constant of the scramble",
        Fault { right: "x ^= x * 1025551850u;", wrong: |_| "x ^= x * 1025551851u;".into() },
        1.0,
    ),
    (
        "one mask of Pascal's matrix",
        Fault { right: "x ^= (x & 858993459u) << 2u;", wrong: |_| "x ^= (x & 322122547u) << 2u;".into() },
        1.0,
    ),
    (
        "range of the numbers",
        Fault {
            right: "return f32(x >> 8u) * (1.0 / 16777216.0);",
            wrong: |e| format!("return f32(x >> 8u) * ({:e} / 16777216.0);", 1.0 - e),
        },
        0.01,
    ),
    (
        "replicates not told apart",
        Fault {
            right: "return Sampler(hash2(hash2(pixel, replicate), seed), reverseBits(sample));",
            wrong: |_| "return Sampler(hash2(hash2(pixel, 0u), seed), reverseBits(sample));".into(),
        },
        1.0,
    ),
];

#[test]
fn of_the_shader() {
    judge(&Shader::new(None)).assert();
}

#[test]
fn of_the_f64_engine() {
    judge(&F64).assert();
}

#[test]
fn faults_are_found() {
    for (name, fault, size) in FAULTS {
        assert!(!judge(&Shader::new(Some((fault, size)))).failures().is_empty(), "{name}: not found");
    }
}

#[test]
#[ignore = "prints the power of the tests"]
fn power() {
    for (name, fault, _) in FAULTS {
        let failures = |size| judge(&Shader::new(Some((fault, size)))).failures();
        eprintln!("| Sobol points and hashes | {name} | {:?} |", smallest_found(|size| !failures(size).is_empty()));
        eprintln!("    {}", failures(0.01).join("\n    "));
    }
}
