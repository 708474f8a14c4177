//! Bounds of config keys: each struct has a table of what its numbers may be, and one walk checks them all.
//!
//! The walk goes over the config's TOML form, so a numeric key that has no bounds cannot slip through: it is found on the
//! default config already, by the first test that checks it.

use std::fmt;

use serde::Serialize;
use thiserror::Error;
use toml::Value;

/// What each numeric key of a config may be, and what the doc comments say of all its keys.
pub trait Bounds: Serialize {
    const BOUNDS: Keys;
    const DOCS: Docs = &[];
    /// What the doc comment says of the config.
    const ABOUT: Lines = &[];
    const PART: ConfigPart = ConfigPart { keys: Self::BOUNDS, docs: Self::DOCS, about: Self::ABOUT };
}

/// A config that can be checked: its bounds, and what several keys must fulfil together.
pub trait Check: Bounds {
    /// What bounds of single keys cannot say; the bounds hold already.
    ///
    /// # Errors
    /// Names the first key that does not fit, and what would.
    fn check_relations(&self) -> Result<(), InvalidConfig> {
        Ok(())
    }

    /// Checks every number, then the relations.
    ///
    /// # Errors
    /// Names the first key that does not fit, and what would.
    fn check(&self) -> Result<(), InvalidConfig> {
        let table = Value::try_from(self).map_err(|error| {
            InvalidConfig::new("the config", error, "values that TOML can hold are needed")
        })?;
        Rule::Part(Self::PART).check("", &table)?;
        self.check_relations()
    }
}

/// A config whose numbers and relations hold: what a stage works with, made from the raw one by `TryFrom`.
#[derive(Debug, Clone, PartialEq)]
pub struct Checked<T>(T);

impl<T: Check> Checked<T> {
    /// Checks a config.
    ///
    /// # Errors
    /// As [`Check::check`].
    pub fn new(raw: T) -> Result<Self, InvalidConfig> {
        raw.check()?;
        Ok(Self(raw))
    }
}

impl<T> std::ops::Deref for Checked<T> {
    type Target = T;

    fn deref(&self) -> &T {
        &self.0
    }
}

/// Gives configs their `TryFrom`, for those that need no type of their own.
macro_rules! impl_checked {
    ($($Name:ty),*) => {$(
        impl TryFrom<$Name> for $crate::config::Checked<$Name> {
            type Error = $crate::config::InvalidConfig;

            fn try_from(raw: $Name) -> Result<Self, Self::Error> {
                Self::new(raw)
            }
        }
    )*};
}
pub(crate) use impl_checked;

/// What is wrong with a config; in a box, since errors of many stages hold it.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{} is {}; {}", .0.key, .0.found, .0.wanted)]
pub struct InvalidConfig(Box<Fault>);

#[derive(Debug, Clone, PartialEq, Eq)]
struct Fault {
    key: String,
    found: String,
    wanted: String,
}

impl InvalidConfig {
    /// `wanted` is a sentence: `a number from 1 to 2 is needed`.
    pub fn new(key: impl Into<String>, found: impl fmt::Display, wanted: impl Into<String>) -> Self {
        Self(Box::new(Fault { key: key.into(), found: found.to_string(), wanted: wanted.into() }))
    }

    /// The key, with dots between tables, as `--set` takes it.
    #[must_use]
    pub fn key(&self) -> &str {
        &self.0.key
    }

    /// The same error of a config that is the table `part` of another.
    #[must_use]
    pub fn within(mut self, part: &str) -> Self {
        self.0.key = join(part, &self.0.key);
        self
    }
}

/// An error where a relation of keys does not hold.
///
/// # Errors
/// The parts of [`InvalidConfig::new`], unless `holds`.
pub fn require(
    holds: bool,
    key: &str,
    found: impl fmt::Display,
    wanted: impl Into<String>,
) -> Result<(), InvalidConfig> {
    if holds { Ok(()) } else { Err(InvalidConfig::new(key, found, wanted)) }
}

/// The keys of a struct that hold numbers, and their rules.
pub type Keys = &'static [(&'static str, Rule)];

/// Lines of a doc comment.
pub type Lines = &'static [&'static str];

/// The keys of a struct, with their doc comments.
pub type Docs = &'static [(&'static str, Lines)];

/// What is known of a table.
#[derive(Debug, Clone, Copy)]
pub struct ConfigPart {
    pub keys: Keys,
    pub docs: Docs,
    pub about: Lines,
}

/// What a key may hold.
#[derive(Debug, Clone, Copy)]
pub enum Rule {
    /// Any whole number: a seed.
    Any,
    Number(Range),
    List {
        each: Range,
        least: usize,
        most: usize,
        order: Order,
    },
    /// Numbers by names that are free.
    Named(Range),
    /// A table, or a list of such tables.
    Part(ConfigPart),
    /// Such tables by names that are free.
    Parts(ConfigPart),
}

/// Numbers between two ends, which belong to the range unless they are left out. NaN is in no range.
#[derive(Debug, Clone, Copy)]
pub struct Range {
    low: f64,
    high: f64,
    without_low: bool,
    without_high: bool,
}

/// How the numbers of a list follow each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Order {
    Any,
    Ascending,
    StrictlyAscending,
}

/// A number from `low` to `high`.
#[must_use]
pub const fn from_to(low: f64, high: f64) -> Rule {
    Rule::Number(Range { low, high, without_low: false, without_high: false })
}

/// A number above `low` and at most `high`.
#[must_use]
pub const fn above(low: f64, high: f64) -> Rule {
    Rule::Number(Range { low, high, without_low: true, without_high: false })
}

/// A number from `low` to below `high`.
#[must_use]
pub const fn below(low: f64, high: f64) -> Rule {
    Rule::Number(Range { low, high, without_low: false, without_high: true })
}

/// A table with the bounds of its own struct, or a list of such tables.
#[must_use]
pub const fn part<T: Bounds>() -> Rule {
    Rule::Part(T::PART)
}

/// Tables with the bounds of their own struct, by names that are free.
#[must_use]
pub const fn parts<T: Bounds>() -> Rule {
    Rule::Parts(T::PART)
}

/// A share of a whole.
pub const SHARE: Rule = from_to(0.0, 1.0);

impl Rule {
    /// A list of `least` to `most` such numbers.
    #[must_use]
    pub const fn list(self, least: usize, most: usize) -> Self {
        Self::List { each: self.range(), least, most, order: Order::Any }
    }

    /// Two such numbers, the first no greater than the second.
    #[must_use]
    pub const fn pair(self) -> Self {
        Self::List { each: self.range(), least: 2, most: 2, order: Order::Ascending }
    }

    /// A list of at most `most` such numbers, each above the one before.
    #[must_use]
    pub const fn rising(self, least: usize, most: usize) -> Self {
        Self::List { each: self.range(), least, most, order: Order::StrictlyAscending }
    }

    /// Such numbers by name.
    #[must_use]
    pub const fn by_name(self) -> Self {
        Self::Named(self.range())
    }

    const fn range(self) -> Range {
        match self {
            Self::Number(range) => range,
            _ => panic!("only a rule for a number makes a list"),
        }
    }

    /// Checks a value under its key.
    fn check(self, key: &str, value: &Value) -> Result<(), InvalidConfig> {
        match (self, value) {
            (Self::Part(part), Value::Table(table)) => table.iter().try_for_each(|(name, value)| {
                let path = join(key, name);
                match part.keys.iter().find(|(known, _)| known == name) {
                    Some((_, rule)) => rule.check(&path, value),
                    None if holds_number(value) => panic!("the config key `{path}` has no bounds"),
                    None => Ok(()),
                }
            }),
            (Self::Part(_), Value::Array(parts)) => parts.iter().try_for_each(|part| self.check(key, part)),
            (Self::Named(range), Value::Table(table)) => {
                table.iter().try_for_each(|(name, value)| Self::Number(range).check(&join(key, name), value))
            }
            (Self::Parts(part), Value::Table(table)) => {
                table.iter().try_for_each(|(name, value)| Self::Part(part).check(&join(key, name), value))
            }
            (Self::List { each, least, most, order }, Value::Array(values)) => {
                let numbers: Option<Vec<f64>> = values.iter().map(number).collect();
                let holds = numbers.is_some_and(|numbers| {
                    (least..=most).contains(&numbers.len())
                        && numbers.iter().all(|&number| each.contains(number))
                        && order.holds(&numbers)
                });
                if holds { Ok(()) } else { Err(InvalidConfig::new(key, shorten(values), self.wanted())) }
            }
            (Self::Number(range), value) if number(value).is_some_and(|found| range.contains(found)) => {
                Ok(())
            }
            (Self::Any, Value::Integer(_)) => Ok(()),
            (_, found) => Err(InvalidConfig::new(key, found, self.wanted())),
        }
    }

    /// The rule in words.
    fn wanted(self) -> String {
        let verb = match self {
            Self::List { order: Order::Any, .. } => " are",
            Self::List { .. } => ", are",
            _ => " is",
        };
        format!("{}{verb} needed", self.valid())
    }

    /// What is valid, in words.
    #[must_use]
    pub fn valid(self) -> String {
        match self {
            Self::Any => "a whole number".to_owned(),
            Self::Number(range) | Self::Named(range) => format!("a number {range}"),
            Self::Part(_) | Self::Parts(_) => "a table".to_owned(),
            Self::List { each, least, most, order } => {
                let count = match (least, most) {
                    (2, 2) => "two".to_owned(),
                    _ if least == most => least.to_string(),
                    _ => format!("{least} to {most}"),
                };
                let order = match order {
                    Order::Any => "",
                    Order::Ascending => ", ascending,",
                    Order::StrictlyAscending => ", each above the one before,",
                };
                format!("{count} numbers {each}{}", order.trim_end_matches(','))
            }
        }
    }
}

impl Range {
    fn contains(self, number: f64) -> bool {
        let is_inside = (self.low..=self.high).contains(&number);
        is_inside && !(self.without_low && number == self.low) && !(self.without_high && number == self.high)
    }
}

impl fmt::Display for Range {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { low, high, without_low, without_high } = self;
        match (without_low, without_high) {
            (true, _) if high.is_infinite() => write!(f, "above {low}"),
            (true, _) => write!(f, "above {low} and at most {high}"),
            (false, true) => write!(f, "from {low} to below {high}"),
            (false, false) => write!(f, "from {low} to {high}"),
        }
    }
}

impl Order {
    fn holds(self, numbers: &[f64]) -> bool {
        match self {
            Self::Any => true,
            Self::Ascending => numbers.is_sorted(),
            Self::StrictlyAscending => numbers.is_sorted_by(|a, b| a < b),
        }
    }
}

fn number(value: &Value) -> Option<f64> {
    match value {
        Value::Integer(number) => Some(*number as f64),
        Value::Float(number) => Some(*number),
        _ => None,
    }
}

fn holds_number(value: &Value) -> bool {
    match value {
        Value::Array(values) => values.iter().any(holds_number),
        Value::Table(table) => table.values().any(holds_number),
        other => number(other).is_some(),
    }
}

/// A list as text, cut after a few entries.
fn shorten(values: &[Value]) -> String {
    let told: Vec<String> = values.iter().take(8).map(ToString::to_string).collect();
    let rest = if values.len() > 8 { format!(", .. ({} entries)", values.len()) } else { String::new() };
    format!("[{}{rest}]", told.join(", "))
}

/// The path of a key of a table.
pub(super) fn join(table: &str, key: &str) -> String {
    if table.is_empty() { key.to_owned() } else { format!("{table}.{key}") }
}

#[cfg(test)]
pub(crate) mod tests;
