//! Values of flags; what is not valid is refused with what would be.

use std::fmt::Display;
use std::ops::RangeInclusive;
use std::str::FromStr;

use clap::builder::{PossibleValuesParser, TypedValueParser};

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

/// Parses the name of a split.
pub fn split() -> impl TypedValueParser<Value = Split> {
    one_of(Split::ALL, Split::name)
}
