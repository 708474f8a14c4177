//! A metric's figures as a table, for whoever shows them: text, HTML.

/// One table.
#[derive(Debug, Clone, PartialEq)]
pub struct MetricTable {
    /// The names of the columns; the first says what the rows are.
    pub head: Vec<String>,
    pub rows: Vec<Vec<MetricValue>>,
    pub note: String,
}

/// One cell.
#[derive(Debug, Clone, PartialEq)]
pub enum MetricValue {
    Name(String),
    Count(usize),
    /// `None` if it is not known.
    Number {
        value: Option<f64>,
        n_digits: usize,
    },
    /// A share from 0 to 1, of how many, and its confidence interval.
    Share {
        value: Option<f64>,
        of: Option<usize>,
        interval: Option<[f64; 2]>,
    },
}

impl MetricTable {
    /// `None` if there are no rows.
    pub(super) fn new(head: &[&str], rows: Vec<Vec<MetricValue>>, note: impl Into<String>) -> Option<Self> {
        let head = head.iter().map(|&name| name.to_owned()).collect();
        (!rows.is_empty()).then(|| Self { head, rows, note: note.into() })
    }
}

impl MetricValue {
    pub(super) fn name(name: impl Into<String>) -> Self {
        Self::Name(name.into())
    }

    pub(super) fn number(value: impl Into<Option<f64>>, n_digits: usize) -> Self {
        Self::Number { value: value.into(), n_digits }
    }

    pub(super) fn share(value: Option<f64>, of: impl Into<Option<usize>>) -> Self {
        Self::Share { value, of: of.into(), interval: None }
    }
}
