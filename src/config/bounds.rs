//! Bounds of config keys: each struct has a table of what its numbers may be, and one walk checks them all.
//!
//! The walk goes over the config's TOML form, so a numeric key that has no bounds cannot slip through: it is found on the
//! default config already, by the first test that checks it.

use std::fmt;

use serde::Serialize;
use thiserror::Error;
use toml::Value;

/// A config that can be checked: bounds for each number, and what several keys must fulfil together.
pub trait Check: Serialize {
    /// What each numeric key may be.
    const BOUNDS: Keys;

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
        Rule::Part(Self::BOUNDS).check("", &table)?;
        self.check_relations()
    }
}

/// What is wrong with a config.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{key} is {found}; {wanted}")]
pub struct InvalidConfig {
    /// With dots between tables, as `--set` takes it.
    pub key: String,
    pub found: String,
    /// A sentence: `a number from 1 to 2 is needed`.
    pub wanted: String,
}

impl InvalidConfig {
    pub fn new(key: impl Into<String>, found: impl fmt::Display, wanted: impl Into<String>) -> Self {
        Self { key: key.into(), found: found.to_string(), wanted: wanted.into() }
    }

    /// The same error of a config that is the table `part` of another.
    #[must_use]
    pub fn within(self, part: &str) -> Self {
        Self { key: join(part, &self.key), ..self }
    }
}

/// The keys of a struct that hold numbers, and their rules.
pub type Keys = &'static [(&'static str, Rule)];

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
    Part(Keys),
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
            (Self::Part(keys), Value::Table(table)) => table.iter().try_for_each(|(name, value)| {
                let path = join(key, name);
                match keys.iter().find(|(known, _)| known == name) {
                    Some((_, rule)) => rule.check(&path, value),
                    None if holds_number(value) => panic!("the config key `{path}` has no bounds"),
                    None => Ok(()),
                }
            }),
            (Self::Part(_), Value::Array(parts)) => parts.iter().try_for_each(|part| self.check(key, part)),
            (Self::Named(range), Value::Table(table)) => {
                table.iter().try_for_each(|(name, value)| Self::Number(range).check(&join(key, name), value))
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
        match self {
            Self::Any => "a whole number is needed".to_owned(),
            Self::Number(range) | Self::Named(range) => format!("a number {range} is needed"),
            Self::Part(_) => "a table is needed".to_owned(),
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
                format!("{count} numbers {each}{order} are needed")
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

fn join(table: &str, key: &str) -> String {
    if table.is_empty() { key.to_owned() } else { format!("{table}.{key}") }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Asserts that a config accepts itself, and that each of its numbers is refused by its key when it is absurd.
    ///
    /// Left out: seeds, whose keys end in `seed`.
    pub(crate) fn assert_every_number_is_checked<T>(config: &T)
    where
        T: Check + serde::de::DeserializeOwned,
    {
        fn numbers(value: &Value, path: &[String], found: &mut Vec<Vec<String>>) {
            match value {
                Value::Table(table) => {
                    for (key, value) in table {
                        numbers(value, &[path, &[key.clone()]].concat(), found);
                    }
                }
                Value::Array(values) if values.iter().any(Value::is_table) => {}
                other if holds_number(other) => found.push(path.to_vec()),
                _ => {}
            }
        }
        config.check().unwrap();
        let table = Value::try_from(config).unwrap();
        let mut keys = Vec::new();
        numbers(&table, &[], &mut keys);
        assert!(!keys.is_empty());
        for path in keys.iter().filter(|path| !path.last().unwrap().ends_with("seed")) {
            let key = path.join(".");
            let mut absurd = vec![Value::Float(f64::NAN), Value::Float(-1e30), Value::Integer(i64::MAX)];
            let mut at = &table;
            path.iter().for_each(|part| at = &at[part.as_str()]);
            if let Some(values) = at.as_array() {
                absurd = absurd.into_iter().map(|value| Value::Array(vec![value; values.len()])).collect();
                absurd.push(Value::Array(vec![values[0].clone(); 100_000]));
            }
            for value in absurd {
                let mut changed = table.clone();
                let mut at = &mut changed;
                for part in path {
                    at = &mut at[part.as_str()];
                }
                *at = value.clone();
                // A whole number takes no float, a fixed list no more entries, and a small one no huge number.
                let Ok(changed) = changed.try_into::<T>() else { continue };
                let told = changed.check().expect_err(&key);
                assert_eq!(told.key, key, "{told}");
            }
        }
    }

    #[derive(Serialize)]
    struct Example {
        share: f64,
        spacing_m: [f64; 2],
        edges: Vec<f64>,
        inner: Inner,
    }

    #[derive(Serialize)]
    struct Inner {
        count: u32,
    }

    impl Check for Example {
        const BOUNDS: Keys = &[
            ("share", SHARE),
            ("spacing_m", from_to(1.0, 1000.0).pair()),
            ("edges", above(0.0, 9.0).rising(0, 3)),
            ("inner", Rule::Part(&[("count", from_to(1.0, 5.0))])),
        ];
    }

    fn told(change: fn(&mut Example)) -> String {
        let inner = Inner { count: 1 };
        let mut example = Example { share: 0.5, spacing_m: [2.0, 2.0], edges: vec![], inner };
        example.check().unwrap();
        change(&mut example);
        example.check().unwrap_err().to_string()
    }

    #[test]
    fn a_message_says_key_value_and_what_is_valid() {
        assert_eq!(told(|e| e.share = f64::NAN), "share is nan; a number from 0 to 1 is needed");
        let spacing = "two numbers from 1 to 1000, ascending, are needed";
        assert_eq!(told(|e| e.spacing_m = [0.0, 0.0]), format!("spacing_m is [0.0, 0.0]; {spacing}"));
        assert_eq!(told(|e| e.spacing_m = [9.0, 2.0]), format!("spacing_m is [9.0, 2.0]; {spacing}"));
        assert_eq!(told(|e| e.inner.count = 6), "inner.count is 6; a number from 1 to 5 is needed");
        let edges = "0 to 3 numbers above 0 and at most 9, each above the one before, are needed";
        assert_eq!(told(|e| e.edges = vec![2.0, 2.0]), format!("edges is [2.0, 2.0]; {edges}"));
        assert!(told(|e| e.edges = vec![1.0; 50]).contains(".. (50 entries)]"));
    }

    #[test]
    #[should_panic(expected = "`inner.new` has no bounds")]
    fn a_number_without_bounds_is_found_on_any_config() {
        #[derive(Serialize)]
        struct Forgotten {
            inner: BTreeMap,
        }
        type BTreeMap = std::collections::BTreeMap<&'static str, u32>;
        impl Check for Forgotten {
            const BOUNDS: Keys = &[("inner", Rule::Part(&[]))];
        }
        let _ = Forgotten { inner: BTreeMap::from([("new", 1)]) }.check();
    }
}
