//! How well a score separates harmful from harmless: AUROC, AUPR and FPR95, harmful being the positives.
//!
//! AUROC is the chance that a harmful object scores above a harmless one, ties counting half (Fawcett 2006). AUPR is
//! the sum over falling scores of precision times the gain of recall, as scikit-learn's `average_precision_score`.
//! FPR95 is the share of harmless objects at or above the highest score that keeps 95 % of the harmful ones.

use serde::{Deserialize, Serialize};

use super::{ByDistribution, Context, MetricTable, MetricValue};
use crate::eval::EvalConfig;

/// Share of positives that FPR95 keeps.
const KEPT: f64 = 0.95;

/// The three figures, each 0 to 1.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Separation {
    pub n_harmful: usize,
    pub n_harmless: usize,
    pub auroc: f64,
    /// With harmful as positive; guessing reaches the share of harmful objects.
    pub aupr: f64,
    pub fpr95: f64,
}

impl Separation {
    /// Takes scores and whether each object is harmful; `None` unless there are some of both.
    pub fn new(told: &[(f64, bool)]) -> Option<Self> {
        let n_harmful = told.iter().filter(|(_, is_harmful)| *is_harmful).count();
        let n_harmless = told.len() - n_harmful;
        if n_harmful == 0 || n_harmless == 0 {
            return None;
        }
        let mut falling = told.to_vec();
        falling.sort_unstable_by(|a, b| b.0.total_cmp(&a.0));
        let (mut n_true, mut n_false) = (0_usize, 0_usize);
        let (mut auroc, mut aupr, mut fpr95) = (0.0, 0.0, None);
        for equal in falling.chunk_by(|a, b| a.0 == b.0) {
            let gained = equal.iter().filter(|(_, is_harmful)| *is_harmful).count();
            let risen = equal.len() - gained;
            // The trapezium below the step: ties count half.
            auroc += risen as f64 * (n_true as f64 + gained as f64 / 2.0);
            (n_true, n_false) = (n_true + gained, n_false + risen);
            aupr += gained as f64 / n_harmful as f64 * (n_true as f64 / (n_true + n_false) as f64);
            if fpr95.is_none() && n_true as f64 >= KEPT * n_harmful as f64 {
                fpr95 = Some(n_false as f64 / n_harmless as f64);
            }
        }
        Some(Self {
            n_harmful,
            n_harmless,
            auroc: auroc / (n_harmful as f64 * n_harmless as f64),
            aupr,
            fpr95: fpr95.expect("all the positives are 95 % of them and more"),
        })
    }
}

pub(super) fn measure(of: &Context<'_>) -> ByDistribution<Option<Separation>> {
    ByDistribution::from_fn(|distribution| Separation::new(&of.probabilities(distribution)))
}

pub(super) fn show(by: &ByDistribution<Option<Separation>>, _: &EvalConfig) -> Option<MetricTable> {
    let rows = by.named().into_iter().filter_map(|(name, separation)| {
        let of = separation.as_ref()?;
        let counts =
            [MetricValue::name(name), MetricValue::Count(of.n_harmful), MetricValue::Count(of.n_harmless)];
        let figures = [of.auroc, of.aupr, of.fpr95].map(|value| MetricValue::number(value, 3));
        Some(counts.into_iter().chain(figures).collect())
    });
    let head = ["harmful against harmless", "harmful", "harmless", "AUROC", "AUPR", "FPR95"];
    let note = "Of objects that a detection lies on, by the harmful share of its scores.";
    MetricTable::new(&head, rows.collect(), note)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn figures_are_those_worked_out_by_hand() {
        // By score: harmful; harmful and harmless tied; harmless; harmful; harmless.
        let told = [(0.9, true), (0.7, true), (0.7, false), (0.5, false), (0.3, true), (0.1, false)];
        let found = Separation::new(&told).unwrap();
        // Of nine pairs: 3 and 2.5 and 1 are in order.
        assert!((found.auroc - 6.5 / 9.0).abs() < 1e-12);
        assert!((found.aupr - (1.0 + 2.0 / 3.0 + 3.0 / 5.0) / 3.0).abs() < 1e-12);
        assert!((found.fpr95 - 2.0 / 3.0).abs() < 1e-12);
        assert_eq!(Separation::new(&[(0.1, true)]), None);
    }

    proptest! {
        #[test]
        fn auroc_is_the_share_of_pairs_in_order(
            told in prop::collection::vec((0_u8..6, any::<bool>()), 2..40),
        ) {
            let told: Vec<(f64, bool)> = told.iter().map(|&(s, h)| (f64::from(s) / 5.0, h)).collect();
            let Some(found) = Separation::new(&told) else { return Ok(()) };
            let mut in_order = 0.0;
            for (harmful, _) in told.iter().filter(|(_, h)| *h) {
                for (harmless, _) in told.iter().filter(|(_, h)| !*h) {
                    in_order += match harmful.total_cmp(harmless) {
                        std::cmp::Ordering::Greater => 1.0,
                        std::cmp::Ordering::Equal => 0.5,
                        std::cmp::Ordering::Less => 0.0,
                    };
                }
            }
            let n_pairs = (found.n_harmful * found.n_harmless) as f64;
            prop_assert!((found.auroc - in_order / n_pairs).abs() < 1e-12);
            prop_assert!((0.0..=1.0).contains(&found.fpr95) && found.aupr > 0.0 && found.aupr <= 1.0 + 1e-12);
        }
    }
}
