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

/// Parses the name of a split.
pub fn split() -> impl TypedValueParser<Value = Split> {
    PossibleValuesParser::new(Split::ALL.map(Split::name))
        .map(|name| Split::ALL.into_iter().find(|split| split.name() == name).expect("a name of ALL"))
}
