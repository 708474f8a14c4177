//! A moment of an episode, as a flag names it: a sample's number, or seconds from the first sample on.

use std::fmt;
use std::ops::Range;
use std::str::FromStr;

use thiserror::Error;

/// A text is no moment.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("valid is a sample's number, such as 12, or seconds from the first sample on, such as 3.5s")]
pub struct MomentError;

/// A moment of an episode.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Moment {
    /// Counted from 0.
    Sample(usize),
    /// From the first sample on.
    Seconds(f64),
}

impl FromStr for Moment {
    type Err = MomentError;

    fn from_str(text: &str) -> Result<Self, MomentError> {
        let Some(seconds) = text.strip_suffix('s') else {
            return text.parse().map(Self::Sample).map_err(|_| MomentError);
        };
        let seconds: f64 = seconds.parse().map_err(|_| MomentError)?;
        if seconds.is_finite() && seconds >= 0.0 { Ok(Self::Seconds(seconds)) } else { Err(MomentError) }
    }
}

impl fmt::Display for Moment {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Sample(sample) => write!(f, "sample {sample}"),
            Self::Seconds(seconds) => write!(f, "{seconds} s"),
        }
    }
}

impl Moment {
    /// The first sample that is not before the moment; times in order.
    fn place(self, times_ns: &[u64]) -> usize {
        match self {
            Self::Sample(sample) => sample.min(times_ns.len()),
            Self::Seconds(seconds) => {
                // Half a nanosecond stands for what a decimal number leaves out.
                let is_before = |&time_ns: &u64| seconds_after(times_ns, time_ns) < seconds - 5e-10;
                times_ns.partition_point(is_before)
            }
        }
    }
}

/// The samples from a moment up to another, without that; without moments all.
pub(super) fn span(times_ns: &[u64], from: Option<Moment>, to: Option<Moment>) -> Range<usize> {
    let begin = from.map_or(0, |from| from.place(times_ns));
    begin..to.map_or(times_ns.len(), |to| to.place(times_ns)).max(begin)
}

/// Seconds from the first of the times to one of them.
pub(super) fn seconds_after(times_ns: &[u64], time_ns: u64) -> f64 {
    time_ns.saturating_sub(times_ns.first().copied().unwrap_or(time_ns)) as f64 / 1e9
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_span_is_told_by_samples_or_seconds() {
        let times_ns: Vec<u64> = (0..10).map(|i| 1_700_000_000_000_000_000 + i * 300_000_000).collect();
        let of = |from: &str, to: &str| span(&times_ns, from.parse().ok(), to.parse().ok());
        assert_eq!(of("2", "5"), 2..5);
        assert_eq!(of("0.6s", "1.5s"), 2..5);
        assert_eq!(of("0.7s", "99s"), 3..10);
        assert_eq!(of("8", "3"), 8..8);
        assert_eq!(span(&times_ns, None, None), 0..10);
    }

    #[test]
    fn other_texts_are_told_what_is_valid() {
        for text in ["-3", "3.5", "-1s", "NaNs", "soon"] {
            assert_eq!(text.parse::<Moment>(), Err(MomentError), "{text}");
        }
        assert!(MomentError.to_string().contains("3.5s"));
    }
}
