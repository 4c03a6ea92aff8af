//! Integrals over rectangles, to a tolerance.

/// An axis-aligned rectangle.
#[derive(Debug, Clone, Copy)]
pub struct Rectangle {
    /// Lower corner.
    pub low: [f64; 2],
    /// Upper corner.
    pub high: [f64; 2],
}

impl Rectangle {
    /// The unit square.
    pub const UNIT: Self = Self { low: [0.0; 2], high: [1.0; 2] };

    fn quarters(&self) -> [Self; 4] {
        let middle: [f64; 2] = std::array::from_fn(|k| 0.5 * (self.low[k] + self.high[k]));
        std::array::from_fn(|quarter| {
            let upper = [quarter & 1 == 1, quarter & 2 == 2];
            Self {
                low: std::array::from_fn(|k| if upper[k] { middle[k] } else { self.low[k] }),
                high: std::array::from_fn(|k| if upper[k] { self.high[k] } else { middle[k] }),
            }
        })
    }
}

/// Nodes on [0, 1] and weights of Gauss' rule with five points.
const NODES: [(f64, f64); 5] = [
    (0.046_910_077_030_668, 0.118_463_442_528_094_5),
    (0.230_765_344_947_158_4, 0.239_314_335_249_683_2),
    (0.5, 0.284_444_444_444_444_4),
    (0.769_234_655_052_841_6, 0.239_314_335_249_683_2),
    (0.953_089_922_969_332, 0.118_463_442_528_094_5),
];

/// Absolute tolerance for densities with peaks: small enough that a corner of the domain far from a peak is not taken for
/// zero before it is looked at closely.
pub const LEAST: f64 = 1e-16;

/// Most halvings of a side.
const DEPTH: u32 = 24;

/// Integral of `f`; refined until four quarters agree with their whole to `relative` of the value or to `absolute`.
pub fn integrate(f: &dyn Fn(f64, f64) -> f64, over: Rectangle, relative: f64, absolute: f64) -> f64 {
    refine(f, over, gauss(f, over), relative, absolute, DEPTH)
}

fn refine(f: &dyn Fn(f64, f64) -> f64, over: Rectangle, coarse: f64, relative: f64, absolute: f64, depth: u32) -> f64 {
    let quarters = over.quarters();
    let fine = quarters.map(|quarter| gauss(f, quarter));
    let sum: f64 = fine.iter().sum();
    if depth == 0 || (sum - coarse).abs() <= (relative * sum.abs()).max(absolute) {
        return sum;
    }
    quarters
        .into_iter()
        .zip(fine)
        .map(|(quarter, fine)| refine(f, quarter, fine, relative, 0.5 * absolute, depth - 1))
        .sum()
}

/// Integral of a function with kinks but no peaks, on a grid.
pub fn integrate_evenly(f: &dyn Fn(f64, f64) -> f64, over: Rectangle) -> f64 {
    const SIDE: u32 = 64;
    let at = |k: usize, i: u32| over.low[k] + (over.high[k] - over.low[k]) * f64::from(i) / f64::from(SIDE);
    let cell = |i, j| Rectangle { low: [at(0, i), at(1, j)], high: [at(0, i + 1), at(1, j + 1)] };
    (0..SIDE * SIDE).map(|k| gauss(f, cell(k % SIDE, k / SIDE))).sum()
}

fn gauss(f: &dyn Fn(f64, f64) -> f64, over: Rectangle) -> f64 {
    let size: [f64; 2] = std::array::from_fn(|k| over.high[k] - over.low[k]);
    let mut sum = 0.0;
    for (x, weight_x) in NODES {
        for (y, weight_y) in NODES {
            sum += weight_x * weight_y * f(over.low[0] + x * size[0], over.low[1] + y * size[1]);
        }
    }
    sum * size[0] * size[1]
}
