//! Well-spread random numbers: padded, Owen-scrambled Sobol points of 32 bits.
//!
//! Each pair of dimensions is the (0,2)-sequence with its order shuffled and its digits scrambled by a hash
//! (Burley 2020, "Practical Hash-based Owen Scrambling"). A number is a function of (pixel, sample, dimension, replicate,
//! seed) alone.

/// What a pair of numbers is for; the dimensions of a path.
#[derive(Debug, Clone, Copy)]
pub enum Dimension {
    /// Place in the pixel.
    Filter,
    /// Place on the lens.
    Lens,
    /// The moment at which the path sees the scene.
    Time,
    /// On the way from the vertex before this one: flight through a medium.
    Flight(u32),
    /// At the vertex of this index: direction of scattering.
    Lobe(u32),
    /// At the vertex: which lobe, and whether the path survives.
    Choice(u32),
    /// At the vertex: environment or light, and which light.
    Pick(u32),
    /// At the vertex: place on the light.
    Light(u32),
}

impl Dimension {
    fn index(self) -> u64 {
        let (kind, vertex) = match self {
            Self::Filter => (0, 0),
            Self::Lens => (1, 0),
            Self::Lobe(vertex) => (2, vertex),
            Self::Choice(vertex) => (3, vertex),
            Self::Pick(vertex) => (4, vertex),
            Self::Light(vertex) => (5, vertex),
            Self::Time => (6, 0),
            Self::Flight(vertex) => (7, vertex),
        };
        u64::from(vertex) << 3 | kind
    }
}

/// The numbers of one path.
#[derive(Debug, Clone, Copy)]
pub struct Sampler {
    /// Hash of pixel, replicate and seed.
    stream: u64,
    sample: u32,
    /// The bits of `sample`, last first.
    reversed: u32,
    sobol: bool,
}

impl Sampler {
    /// Numbers of one sample of one pixel.
    pub fn new(pixel: u32, sample: u32, replicate: u32, seed: u32, sobol: bool) -> Self {
        let place = u64::from(pixel) << 32 | u64::from(replicate);
        Self { stream: mix(mix(place) ^ u64::from(seed)), sample, reversed: sample.reverse_bits(), sobol }
    }

    /// A point in (0, 1)^2.
    pub fn pair(&self, dimension: Dimension) -> [f64; 2] {
        let key = mix(self.stream.wrapping_add(dimension.index().wrapping_mul(0xd134_2543_de82_ef95)));
        if !self.sobol {
            let numbers = mix(key ^ mix(u64::from(self.sample)));
            return [numbers as u32, (numbers >> 32) as u32].map(unit);
        }
        // The point of the shuffled number, its digits reversed: Owen scrambling wants the most significant one lowest.
        let x = permute(self.reversed, key as u32).reverse_bits();
        let y = second_dimension(x);
        let scrambles = mix(key);
        let [x, y] = [permute(x, scrambles as u32), permute(y, (scrambles >> 32) as u32)];
        // Both at once.
        let digits = (u64::from(x) << 32 | u64::from(y)).reverse_bits();
        [digits as u32, (digits >> 32) as u32].map(unit)
    }

    /// A number that no other shares anything with, for decisions along a ray: `event` tells them apart.
    pub fn chance(&self, event: [u64; 2]) -> f64 {
        let key = event.into_iter().fold(self.stream, |key, part| mix(key ^ part));
        unit((mix(key ^ u64::from(self.sample)) >> 32) as u32)
    }
}

/// Middle of one of 2^32 equal steps of the unit interval.
fn unit(x: u32) -> f64 {
    (f64::from(x) + 0.5) / 4_294_967_296.0
}

/// Finaliser of SplitMix64 (Steele, Lea, Flood 2014).
fn mix(value: u64) -> u64 {
    let mut z = value.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Owen scrambling of a number whose lowest bit is the most significant digit: each bit is flipped by a hash of those
/// below it (Laine and Karras 2011, constants of Burley 2020).
fn permute(value: u32, seed: u32) -> u32 {
    let mut x = value.wrapping_add(seed);
    x ^= x.wrapping_mul(0x6c50_b47c);
    x ^= x.wrapping_mul(0xb82f_1e52);
    x ^= x.wrapping_mul(0xc7af_e638);
    x ^ x.wrapping_mul(0x8d22_f6e6)
}

/// Sobol's second coordinate from the first, both with their digits reversed: multiplication with Pascal's triangle
/// modulo 2, which as a matrix is a fivefold Kronecker power and so takes five steps.
fn second_dimension(x: u32) -> u32 {
    const UPPER_HALVES: [u32; 5] = [0xaaaa_aaaa, 0xcccc_cccc, 0xf0f0_f0f0, 0xff00_ff00, 0xffff_0000];
    (0..5).fold(x, |y, step| y ^ ((y & UPPER_HALVES[step]) >> (1 << step)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// In every elementary interval of area 2^-k lies one of 2^k points.
    #[test]
    fn points_are_a_net_in_base_two() {
        for seed in 0..50 {
            for log in [1u32, 4, 8] {
                let points: Vec<[f64; 2]> =
                    (0..1 << log).map(|i| Sampler::new(7, i, 0, seed, true).pair(Dimension::Lobe(seed))).collect();
                for split in 0..=log {
                    let (across, down) = ((1u32 << split) as f64, (1u32 << (log - split)) as f64);
                    let mut cells: Vec<u64> =
                        points.iter().map(|p| (p[0] * across) as u64 * down as u64 + (p[1] * down) as u64).collect();
                    cells.sort_unstable();
                    cells.dedup();
                    assert_eq!(cells.len(), points.len(), "2^{log} points in {across} x {down} cells, seed {seed}");
                }
            }
        }
    }

    #[test]
    fn the_second_dimension_is_that_of_sobol() {
        // Direction numbers of the polynomial x + 1: v_1 = 1/2, v_{i+1} = v_i xor (v_i / 2).
        for index in 0..1000u32 {
            let (mut value, mut direction) = (0, 1u32 << 31);
            for bit in 0..32 {
                if index >> bit & 1 == 1 {
                    value ^= direction;
                }
                direction ^= direction >> 1;
            }
            // The first coordinate of a point is its number with the digits reversed.
            assert_eq!(second_dimension(index), value.reverse_bits(), "point {index}");
        }
    }
}
