//! The table of a bench: what was measured, what is wanted, the floor, and whether it holds.

use std::fmt;

use serde::Serialize;

use super::machine::Machine;
use harmzone::text_table::text_table;

/// What a line asks for.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Goal {
    pub wanted: f64,
    /// What counts as missed.
    pub floor: f64,
}

impl Goal {
    pub const fn new(wanted: f64, floor: f64) -> Self {
        Self { wanted, floor }
    }

    /// Whether a value is as good as a limit, which is more where more is wanted than the floor.
    fn reaches(self, value: f64, limit: f64) -> bool {
        if self.wanted >= self.floor { value >= limit } else { value <= limit }
    }
}

/// A measured value, with the least where it is the median of several.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Value {
    pub median: f64,
    pub least: Option<f64>,
}

impl Value {
    pub fn single(median: f64) -> Self {
        Self { median, least: None }
    }

    /// The median and the least of some values; `None` without any.
    pub fn of(values: &[f64]) -> Option<Self> {
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        let least = *sorted.first()?;
        let median = f64::midpoint(sorted[(sorted.len() - 1) / 2], sorted[sorted.len() / 2]);
        Some(Self { median, least: Some(least) })
    }

    /// How often the one goes into the other, by the medians and by the leasts.
    pub fn ratio(of: &[f64], to: &[f64]) -> Option<Self> {
        let (of, to) = (Self::of(of)?, Self::of(to)?);
        Some(Self { median: of.median / to.median, least: Some(of.least? / to.least?) })
    }
}

/// What came of a line.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    Measured(Value),
    /// It cannot be measured here until this is done.
    Absent(String),
    /// This machine has nothing to measure.
    Empty(String),
}

/// One line of the table.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Line {
    pub what: String,
    pub unit: &'static str,
    pub goal: Option<Goal>,
    pub outcome: Outcome,
    /// What belongs to the value.
    pub note: String,
}

/// How a line stands to its goal.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    Wanted,
    Floor,
    Missed,
    Absent,
    /// There is nothing to reach.
    None,
}

impl Verdict {
    fn name(self) -> &'static str {
        match self {
            Self::Wanted => "as wanted",
            Self::Floor => "above the floor",
            Self::Missed => "MISSED",
            Self::Absent => "absent",
            Self::None => "",
        }
    }
}

impl Line {
    pub fn verdict(&self) -> Verdict {
        match (&self.outcome, self.goal) {
            (Outcome::Absent(_), _) => Verdict::Absent,
            (Outcome::Empty(_), _) | (_, None) => Verdict::None,
            (Outcome::Measured(value), Some(goal)) if goal.reaches(value.median, goal.wanted) => {
                Verdict::Wanted
            }
            (Outcome::Measured(value), Some(goal)) if goal.reaches(value.median, goal.floor) => {
                Verdict::Floor
            }
            (Outcome::Measured(_), Some(_)) => Verdict::Missed,
        }
    }

    fn cells(&self) -> [String; 7] {
        let [median, least] = match &self.outcome {
            Outcome::Measured(Value { median, least }) => [Some(*median), *least].map(write_optional),
            Outcome::Absent(_) => ["absent".to_owned(), String::new()],
            Outcome::Empty(_) => [String::new(), String::new()],
        };
        let [wanted, floor] = [self.goal.map(|goal| goal.wanted), self.goal.map(|goal| goal.floor)];
        let [wanted, floor] = [wanted, floor].map(write_optional);
        let verdict = self.verdict().name().to_owned();
        [self.what.clone(), median, least, self.unit.to_owned(), wanted, floor, verdict]
    }

    /// The sentence below the table.
    fn remark(&self) -> Option<String> {
        let text = match &self.outcome {
            Outcome::Measured(_) => &self.note,
            Outcome::Absent(needed) => needed,
            Outcome::Empty(why) => why,
        };
        (!text.is_empty()).then(|| format!("{}: {text}", self.what))
    }
}

fn write_optional(value: Option<f64>) -> String {
    value.map_or_else(String::new, |value| format!("{value:.*}", usize::from(value < 100.0) * 2))
}

/// All that a bench found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    pub version: &'static str,
    pub machine: Machine,
    pub lines: Vec<Line>,
    pub seconds: f64,
}

impl Report {
    /// What the lines with this verdict are about.
    pub fn named(&self, verdict: Verdict) -> Vec<&str> {
        self.lines.iter().filter(|line| line.verdict() == verdict).map(|line| line.what.as_str()).collect()
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}\n", self.machine)?;
        let head = ["what", "median", "least", "", "wanted", "floor", ""].map(str::to_owned);
        f.write_str(&text_table(std::iter::once(head).chain(self.lines.iter().map(Line::cells))))?;
        writeln!(f)?;
        self.lines.iter().filter_map(Line::remark).try_for_each(|remark| writeln!(f, "{remark}"))?;
        write!(f, "\nall in one run of {:.1} minutes", self.seconds / 60.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(value: f64, goal: Goal) -> Line {
        let outcome = Outcome::Measured(Value::single(value));
        Line { what: "x".into(), unit: "", goal: Some(goal), outcome, note: String::new() }
    }

    #[test]
    fn more_is_better_where_more_is_wanted_than_the_floor_and_less_elsewhere() {
        let (fast, short) = (Goal::new(200.0, 100.0), Goal::new(1.0, 1.1));
        let verdicts = |goal, values: [f64; 3]| values.map(|value| line(value, goal).verdict());
        assert_eq!(verdicts(fast, [200.0, 150.0, 99.0]), [Verdict::Wanted, Verdict::Floor, Verdict::Missed]);
        assert_eq!(verdicts(short, [1.0, 1.05, 1.11]), [Verdict::Wanted, Verdict::Floor, Verdict::Missed]);
        assert_eq!(line(f64::NAN, fast).verdict(), Verdict::Missed);
    }

    #[test]
    fn what_cannot_run_is_absent_and_what_needs_other_hardware_is_nothing() {
        let goal = Some(Goal::new(1.0, 2.0));
        let with = |outcome| Line { outcome, ..Line { goal, ..line(1.0, Goal::new(1.0, 2.0)) } }.verdict();
        assert_eq!(with(Outcome::Absent("make it".into())), Verdict::Absent);
        assert_eq!(with(Outcome::Empty("no GPU".into())), Verdict::None);
    }

    #[test]
    fn a_ratio_is_of_medians_with_that_of_the_leasts_beside() {
        let ratio = Value::ratio(&[8.0, 2.0, 6.0], &[2.0, 1.0, 9.0]).unwrap();
        assert_eq!((ratio.median, ratio.least), (3.0, Some(2.0)));
        assert_eq!(Value::ratio(&[], &[1.0]), None);
        assert_eq!(Value::of(&[4.0, 1.0]).unwrap().median, 2.5);
    }
}
