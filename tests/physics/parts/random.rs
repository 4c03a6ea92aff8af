//! Random numbers that share nothing with the renderer's: SplitMix64 (Steele, Lea, Flood 2014).

/// A stream of random numbers.
pub struct Random(pub u64);

impl Random {
    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut x = self.0;
        x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        x ^ (x >> 31)
    }

    /// In [0, 1), of 24 bits: an f32 holds it exactly, as the renderer's numbers.
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 40) as f64 / f64::from(1 << 24)
    }

    /// Points of the unit cube.
    pub fn points(&mut self, count: usize) -> Vec<[f64; 3]> {
        (0..count).map(|_| [self.unit(), self.unit(), self.unit()]).collect()
    }
}

/// Evenly spread points of the unit cube (Hammersley's), rounded to 24 bits.
pub fn lattice(count: usize) -> Vec<[f64; 3]> {
    let round = |x: f64| (x * f64::from(1 << 24)).floor() / f64::from(1 << 24);
    let point = |i| [radical_inverse(2, i), radical_inverse(3, i), (i as f64 + 0.5) / count as f64];
    (0..count).map(|i| point(i).map(round)).collect()
}

/// Digits of a number, mirrored at the point.
fn radical_inverse(base: usize, mut number: usize) -> f64 {
    let (mut place, mut sum) = (1.0, 0.0);
    while number > 0 {
        place /= base as f64;
        sum += (number % base) as f64 * place;
        number /= base;
    }
    sum
}
