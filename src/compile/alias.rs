//! Alias tables (Walker 1974): a draw from any discrete distribution in constant time. Built as Vose 1991 does.

/// An entry: keep it with this probability, else take the other.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Entry {
    /// Probability of keeping.
    pub keep: f32,
    /// The other entry.
    pub alias: u32,
}

/// The table for weights, none of them negative, and the probability of each entry that the table really has, the
/// rounding of `keep` included: a sampler that divides by these is unbiased. If all weights are zero: uniform.
pub fn table(weights: &[f64]) -> (Vec<Entry>, Vec<f64>) {
    let count = weights.len();
    let total: f64 = weights.iter().sum();
    let scaled = |weight: &f64| if total > 0.0 { weight / total * count as f64 } else { 1.0 };
    let mut left: Vec<f64> = weights.iter().map(scaled).collect();
    let mut entries: Vec<Entry> = (0..count as u32).map(|alias| Entry { keep: 1.0, alias }).collect();
    let (mut small, mut large): (Vec<usize>, Vec<usize>) = (0..count).partition(|i| left[*i] < 1.0);
    while let (Some(poor), Some(rich)) = (small.pop(), large.last().copied()) {
        entries[poor] = Entry { keep: left[poor] as f32, alias: rich as u32 };
        left[rich] -= 1.0 - left[poor];
        if left[rich] < 1.0 {
            large.pop();
            small.push(rich);
        }
    }
    let probabilities = probabilities(&entries);
    (entries, probabilities)
}

/// Probability of each entry.
fn probabilities(entries: &[Entry]) -> Vec<f64> {
    let mut sums: Vec<f64> = entries.iter().map(|entry| f64::from(entry.keep)).collect();
    for entry in entries {
        sums[entry.alias as usize] += 1.0 - f64::from(entry.keep);
    }
    sums.iter().map(|sum| sum / entries.len() as f64).collect()
}
