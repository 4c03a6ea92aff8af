//! Chi-square and normal tests.

/// Expected counts below this are pooled.
const LEAST_EXPECTED: f64 = 5.0;

/// P-value of counts under expected ones (Pearson 1900).
pub fn chi_square(observed: &[f64], expected: &[f64]) -> f64 {
    let (mut statistic, mut cells) = (0.0, 0u32);
    let (mut rest_observed, mut rest_expected) = (0.0, 0.0);
    for (o, e) in observed.iter().zip(expected) {
        if *e >= LEAST_EXPECTED {
            statistic += (o - e).powi(2) / e;
            cells += 1;
        } else {
            rest_observed += o;
            rest_expected += e;
        }
    }
    if rest_expected >= LEAST_EXPECTED {
        statistic += (rest_observed - rest_expected).powi(2) / rest_expected;
        cells += 1;
    } else if rest_observed > 0.0 {
        // Too few for a term of the sum: their own test is that of a Poisson variable.
        let p = poisson_upper(rest_observed, rest_expected);
        return (2.0 * p.min(chi_square_upper(statistic, cells))).min(1.0);
    }
    chi_square_upper(statistic, cells)
}

fn chi_square_upper(statistic: f64, cells: u32) -> f64 {
    assert!(cells > 1, "one cell tests nothing");
    gamma_q(0.5 * f64::from(cells - 1), 0.5 * statistic)
}

/// Probability of at least `count` where `mean` are expected.
fn poisson_upper(count: f64, mean: f64) -> f64 {
    if mean == 0.0 { 0.0 } else { 1.0 - gamma_q(count, mean) }
}

/// Two-sided p-value of a standard normal variable.
pub fn normal(z: f64) -> f64 {
    libm::erfc(z.abs() / std::f64::consts::SQRT_2)
}

/// Regularised upper incomplete gamma function: its series, or Lentz' continued fraction beyond the mean
/// (DLMF 8.11.4, 8.9.2).
fn gamma_q(a: f64, x: f64) -> f64 {
    if x <= 0.0 {
        return 1.0;
    }
    let scale = (a * x.ln() - x - libm::lgamma(a)).exp();
    if x < a + 1.0 {
        let (mut term, mut sum, mut n) = (1.0 / a, 1.0 / a, a);
        while term > sum * 1e-16 {
            n += 1.0;
            term *= x / n;
            sum += term;
        }
        return 1.0 - sum * scale;
    }
    let mut b = x + 1.0 - a;
    let (mut c, mut d) = (1e300, 1.0 / b);
    let mut fraction = d;
    for i in 1..10_000 {
        let numerator = -f64::from(i) * (f64::from(i) - a);
        b += 2.0;
        d = 1.0 / (numerator * d + b);
        c = b + numerator / c;
        fraction *= d * c;
        if (d * c - 1.0).abs() < 1e-15 {
            break;
        }
    }
    fraction * scale
}

/// Values of tables: chi-square of 10 and 300 degrees of freedom at 0.05 and 0.01, the normal at 1.96.
#[test]
fn p_values_are_those_of_tables() {
    for (degrees, statistic, p) in [(10, 18.307, 0.05), (10, 23.209, 0.01), (300, 341.395, 0.05), (300, 359.906, 0.01)]
    {
        let got = chi_square_upper(statistic, degrees + 1);
        assert!((got / p - 1.0).abs() < 1e-3, "{degrees}: {got} for {p}");
    }
    assert!((normal(1.959_964) - 0.05).abs() < 1e-7);
    assert!(chi_square(&[100.0, 100.0, 1.0], &[100.0, 101.0, 0.0]) == 0.0);
}
