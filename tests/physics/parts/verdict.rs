//! What a family's tests say together.

/// Statistical tests of each family, for one engine. All of both engines share one error of 0.01: a proof that holds
/// fails once in a hundred seeds.
const TESTS: [(&str, usize); 12] = [
    ("Sobol points and hashes", 35),
    ("lobes", 26),
    ("whole BSDF", 75),
    ("layers", 27),
    ("phase function", 5),
    ("environment", 21),
    ("lights", 19),
    ("lights with an extent", 10),
    ("light tree", 4),
    ("lens", 1),
    ("pixel filters", 4),
    ("Russian roulette", 4),
];

/// Error of all statistical tests of the proof together.
const SIGNIFICANCE: f64 = 0.01;

/// P-values and deviations of a family of tests.
pub struct Verdict {
    family: &'static str,
    /// Whose: `shader` or `f64`.
    engine: &'static str,
    /// Case and p-value.
    probabilities: Vec<(String, f64)>,
    /// Case, what was found, and what is allowed.
    deviations: Vec<(String, f64, f64)>,
}

impl Verdict {
    /// Nothing said yet.
    pub fn new(family: &'static str, engine: &'static str) -> Self {
        Self { family, engine, probabilities: Vec::new(), deviations: Vec::new() }
    }

    /// Adds a p-value.
    pub fn probability(&mut self, case: String, p: f64) {
        self.probabilities.push((case, p));
    }

    /// Adds deviations from what is right, all of which must be at most `allowed`. One that is not a number is the worst.
    pub fn deviation(&mut self, case: String, found: impl IntoIterator<Item = f64>, allowed: f64) {
        let worse = |worst: f64, x: f64| if x > worst || x.is_nan() { x } else { worst };
        self.deviations.push((case, found.into_iter().fold(0.0, worse), allowed));
    }

    /// What failed, a line each.
    pub fn failures(&self) -> Vec<String> {
        let level = level();
        let improbable = self.probabilities.iter().filter(|(_, p)| p.is_nan() || *p < level);
        let off = self.deviations.iter().filter(|(_, found, allowed)| found.is_nan() || found > allowed);
        improbable
            .map(|(case, p)| format!("{case}: p = {p:.1e}, below {level:.1e}"))
            .chain(off.map(|(case, found, allowed)| format!("{case}: off by {found:.2e}, {allowed:.0e} allowed")))
            .collect()
    }

    /// Asserts that all is well; prints the family's line of docs/accuracy.md.
    #[track_caller]
    pub fn assert(&self) {
        let smallest = self.probabilities.iter().min_by(|a, b| a.1.total_cmp(&b.1));
        let (case, p) = smallest.map_or(("none", 1.0), |(case, p)| (case.as_str(), *p));
        eprintln!(
            "| {}, {} | {} tests, least p {p:.1e} ({case}) | {} comparisons |",
            self.family,
            self.engine,
            self.probabilities.len(),
            self.deviations.len()
        );
        let worst = self.deviations.iter().max_by(|a, b| (a.1 / a.2).total_cmp(&(b.1 / b.2)));
        if let Some((case, found, allowed)) = worst {
            eprintln!("    worst: {case}: {found:.2e} of {allowed:.0e}");
        }
        let declared = TESTS.iter().find(|(family, _)| *family == self.family).map_or(0, |(_, count)| *count);
        let failures = self.failures();
        assert!(failures.is_empty(), "{}: {} failed:\n{}", self.family, failures.len(), failures.join("\n"));
        assert_eq!(declared, self.probabilities.len(), "{}: tests declared for Sidak's correction", self.family);
    }
}

/// Error of one test (Sidak 1967).
fn level() -> f64 {
    let tests: usize = TESTS.iter().map(|(_, count)| 2 * count).sum();
    1.0 - (1.0 - SIGNIFICANCE).powf(1.0 / tests.max(1) as f64)
}

/// The smallest fault of a ladder that is found; none: not even the largest.
pub fn smallest_found(found: impl Fn(f64) -> bool) -> Option<f64> {
    const LADDER: [f64; 12] = [1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5];
    LADDER.into_iter().find(|size| found(*size))
}
