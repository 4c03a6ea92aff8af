//! Bins that follow a density: a k-d tree over a pilot sample, each leaf with about the same number of its points.

use super::quadrature::Rectangle;
use super::statistics::chi_square;

/// Halvings: 256 leaves.
const LEVELS: u32 = 8;

/// Rectangles that tile a domain.
pub struct Bins {
    /// In heap order; even levels split the first coordinate.
    splits: Vec<f64>,
    /// The leaves from left to right.
    pub rectangles: Vec<Rectangle>,
}

impl Bins {
    /// Leaves by the medians of a pilot sample, which must not be among the points that are tested.
    pub fn new(mut pilot: Vec<[f64; 2]>, domain: Rectangle) -> Self {
        let mut bins = Self { splits: vec![0.0; (1 << LEVELS) - 1], rectangles: Vec::new() };
        bins.split(&mut pilot, domain, 0, 0);
        bins
    }

    fn split(&mut self, points: &mut [[f64; 2]], domain: Rectangle, node: usize, level: u32) {
        if level == LEVELS {
            self.rectangles.push(domain);
            return;
        }
        let axis = (level % 2) as usize;
        let middle = points.len() / 2;
        let at = points.select_nth_unstable_by(middle, |a, b| a[axis].total_cmp(&b[axis])).1[axis];
        self.splits[node] = at;
        let (mut low, mut high) = (domain, domain);
        low.high[axis] = at;
        high.low[axis] = at;
        let (left, right) = points.split_at_mut(middle);
        self.split(left, low, 2 * node + 1, level + 1);
        self.split(right, high, 2 * node + 2, level + 1);
    }

    /// The leaf of a point.
    fn index(&self, point: [f64; 2]) -> usize {
        let mut node = 0;
        for level in 0..LEVELS {
            node = 2 * node + 1 + usize::from(point[(level % 2) as usize] >= self.splits[node]);
        }
        node - self.splits.len()
    }

    /// P-value of points, none for those that leave the domain, under the probability of each leaf.
    pub fn test(&self, points: &[Option<[f64; 2]>], probability: impl Fn(&Rectangle) -> f64) -> f64 {
        let mut observed = vec![0.0; self.rectangles.len() + 1];
        for point in points {
            observed[point.map_or(self.rectangles.len(), |point| self.index(point))] += 1.0;
        }
        let mut expected: Vec<f64> =
            self.rectangles.iter().map(|leaf| probability(leaf) * points.len() as f64).collect();
        let outside = points.len() as f64 - expected.iter().sum::<f64>();
        expected.push(outside.max(0.0));
        chi_square(&observed, &expected)
    }
}

/// P-value of points under a density of known leaf probabilities; the first eighth is the pilot sample.
pub fn test_density(points: &[Option<[f64; 2]>], domain: Rectangle, probability: impl Fn(&Rectangle) -> f64) -> f64 {
    let (pilot, tested) = points.split_at(points.len() / 8);
    Bins::new(pilot.iter().flatten().copied().collect(), domain).test(tested, probability)
}

/// P-value of points of the unit square under the uniform density, on a square grid.
pub fn test_uniform(points: &[[f64; 2]], side: usize) -> f64 {
    let mut observed = vec![0.0; side * side];
    for point in points {
        let [x, y] = point.map(|x| ((x * side as f64) as usize).min(side - 1));
        observed[y * side + x] += 1.0;
    }
    chi_square(&observed, &vec![points.len() as f64 / (side * side) as f64; side * side])
}
