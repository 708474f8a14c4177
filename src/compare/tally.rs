//! Values of each quantity, counted.

use std::collections::BTreeMap;

use super::Quantity;
use crate::dataset::statistics::Histogram;

/// Values of one quantity.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Tally {
    pub histogram: Histogram,
    sum: f64,
}

impl Tally {
    fn new(quantity: Quantity) -> Self {
        Self { histogram: Histogram::new(quantity.edges()), sum: 0.0 }
    }

    fn add(&mut self, value: f64, n_times: u64) {
        if value.is_finite() && n_times > 0 {
            self.histogram.add_times(value, n_times);
            self.sum += value * n_times as f64;
        }
    }

    fn merge(&mut self, other: &Self) {
        self.histogram.merge(&other.histogram);
        self.sum += other.sum;
    }

    pub fn n(&self) -> u64 {
        self.histogram.n_values()
    }

    pub fn mean(&self) -> f64 {
        self.sum / self.n() as f64
    }
}

/// Values of all quantities; those without a value are absent.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Tallies(BTreeMap<Quantity, Tally>);

impl Tallies {
    /// Counts a value; one that is not finite says nothing.
    pub fn add(&mut self, quantity: Quantity, value: f64) {
        self.add_times(quantity, value, 1);
    }

    pub fn add_times(&mut self, quantity: Quantity, value: f64, n_times: u64) {
        self.of(quantity).add(value, n_times);
    }

    /// Counts many values.
    pub fn add_all(&mut self, quantity: Quantity, values: impl IntoIterator<Item = f64>) {
        let tally = self.of(quantity);
        values.into_iter().for_each(|value| tally.add(value, 1));
    }

    pub fn merge(&mut self, other: &Self) {
        for (&quantity, tally) in &other.0 {
            self.of(quantity).merge(tally);
        }
    }

    pub fn get(&self, quantity: Quantity) -> Option<&Tally> {
        self.0.get(&quantity).filter(|tally| tally.n() > 0)
    }

    fn of(&mut self, quantity: Quantity) -> &mut Tally {
        self.0.entry(quantity).or_insert_with(|| Tally::new(quantity))
    }
}
