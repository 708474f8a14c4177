//! Values of flags; what is not valid is refused with what would be.

use std::fmt::Display;
use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::str::FromStr;

use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};

use crate::dataset::blind::Sensor;
use crate::dataset::{Dataset, DatasetError};
use crate::episode::Split;

/// Parses a number of a range.
pub fn number<T>(
    range: RangeInclusive<T>,
) -> impl Fn(&str) -> Result<T, String> + Clone + Send + Sync + 'static
where
    T: FromStr + PartialOrd + Display + Clone + Send + Sync + 'static,
{
    move |text| {
        let number = text.parse().ok().filter(|number| range.contains(number));
        number.ok_or_else(|| format!("valid is a number from {} to {}", range.start(), range.end()))
    }
}

/// Parses one of some values by its name.
pub fn one_of<T, const N: usize>(
    values: [T; N],
    name: fn(T) -> &'static str,
) -> impl TypedValueParser<Value = T>
where
    T: Copy + Send + Sync + 'static,
{
    PossibleValuesParser::new(values.map(name)).map(move |found| {
        values.into_iter().find(|&value| name(value) == found).expect("clap lets only these names through")
    })
}

/// The samples of a labelled data set that a command works on.
#[derive(Debug, Args)]
pub struct SamplesArgs {
    /// Labelled data set
    #[arg(long, value_name = "DIR")]
    pub data: PathBuf,
    /// Split; without it, the first of val, dev and test that the data set has
    #[arg(long, value_parser = split())]
    split: Option<Split>,
    /// Label set; its zone is the one that counts
    #[arg(long, value_name = "SET", default_value = "rect")]
    pub labels: String,
}

impl SamplesArgs {
    /// Opens the split.
    ///
    /// # Errors
    /// As [`Dataset::open`].
    pub fn open(&self) -> Result<Dataset, DatasetError> {
        Dataset::open_to_score(&self.data, &self.labels, self.split)
    }
}

/// Parses the name of a sensor.
pub fn sensor() -> impl TypedValueParser<Value = Sensor> {
    one_of(Sensor::ALL, Sensor::name)
}

/// Parses the name of a split.
pub fn split() -> impl TypedValueParser<Value = Split> {
    one_of(Split::ALL, Split::name)
}
