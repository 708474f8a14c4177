//! The scale of a log's intensities: 0 to 1, 0 to 255 or 0 to 65535, brought to 0 to 255.

use super::config::IntensityScale;
use super::{Notes, RawPoint};

/// One point of so many may lie beyond its cloud's scale.
const FEW: usize = 1000;

/// What the intensities of a drive were found to be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Scale {
    Unit,
    Byte,
    Word,
}

impl Scale {
    fn top(self) -> f32 {
        match self {
            Self::Unit => 1.0,
            Self::Byte => 255.0,
            Self::Word => 65_535.0,
        }
    }

    /// What makes them 0 to 255.
    pub(super) fn factor(self) -> f32 {
        255.0 / self.top()
    }

    /// For the episode's record.
    pub(super) fn sentence(self) -> &'static str {
        match self {
            Self::Unit => "0 to 1 in the log, scaled by 255",
            Self::Byte => "0 to 255 in the log, as it is",
            Self::Word => "0 to 65535 in the log, scaled by 1 / 257",
        }
    }

    /// The scale of a drive by its first cloud, and by what the config expects; what does not fit that is told.
    ///
    /// # Errors
    /// A sentence: intensities of no known scale.
    pub(super) fn find(
        points: &[RawPoint],
        expected: IntensityScale,
        notes: &mut Notes,
    ) -> Result<Self, String> {
        let intensities = || points.iter().map(|point| point.intensity).filter(|found| found.is_finite());
        // A few points beyond a scale, as mirrors send them, do not make another; they are cut to it.
        let mut falling: Vec<f32> = intensities().collect();
        falling.sort_unstable_by(|a, b| b.total_cmp(a));
        let largest = falling.get(falling.len() / FEW).copied().unwrap_or(0.0);
        // A dark cloud of whole numbers may not reach beyond 1 either.
        let has_parts = intensities().any(|found| found.fract() != 0.0);
        let is_whole = !has_parts && (expected == IntensityScale::Byte || falling.first() > Some(&1.0));
        let scale = match largest {
            _ if largest <= 1.0 && is_whole => Self::Byte,
            _ if largest <= 1.0 => Self::Unit,
            _ if largest <= 255.0 => Self::Byte,
            _ if largest <= 65_535.0 => Self::Word,
            _ => {
                return Err(format!("intensities reach {largest}; 0 to 1, 0 to 255 or 0 to 65535 are known"));
            }
        };
        let is_expected = match expected {
            IntensityScale::Unit => scale == Self::Unit,
            IntensityScale::Auto | IntensityScale::Byte => scale == Self::Byte,
        };
        if !is_expected {
            notes.tell(format!("intensities reach {largest}: taken as {}", scale.sentence()));
        }
        Ok(scale)
    }

    /// An intensity of 0 to 255, and whether it lay in the scale.
    pub(super) fn apply(self, intensity: f32) -> (f32, bool) {
        let scaled = intensity * self.factor();
        let kept = if scaled.is_nan() { 0.0 } else { scaled.clamp(0.0, 255.0) };
        (kept, kept == scaled)
    }
}

#[cfg(test)]
mod tests {
    use super::IntensityScale::{Auto, Byte, Unit};
    use super::*;

    fn find(intensities: &[f32], expected: IntensityScale) -> (Result<Scale, String>, usize) {
        let point = |&intensity: &f32| RawPoint {
            x_m: 1.0,
            y_m: 0.0,
            z_m: 0.0,
            intensity,
            ring: None,
            time_offset_s: None,
        };
        let mut notes = Notes::default();
        let found = Scale::find(&intensities.iter().map(point).collect::<Vec<_>>(), expected, &mut notes);
        (found, notes.sentences().count())
    }

    #[test]
    fn each_scale_is_known_and_told_where_another_was_expected() {
        assert_eq!(find(&[0.0, 0.99], Unit), (Ok(Scale::Unit), 0));
        assert_eq!(find(&[0.0, 0.99], Byte), (Ok(Scale::Unit), 1));
        assert_eq!(find(&[0.0, 1.0], Byte), (Ok(Scale::Byte), 0));
        assert_eq!(find(&[0.0, 200.0], Unit), (Ok(Scale::Byte), 1));
        assert_eq!(find(&[0.0, 200.0], Auto), (Ok(Scale::Byte), 0));
        assert_eq!(find(&[0.0, 40_000.0], Byte), (Ok(Scale::Word), 1));
        assert!(find(&[1e6], Auto).0.unwrap_err().contains("1000000"));
    }

    #[test]
    fn a_mirror_among_a_thousand_points_makes_no_other_scale() {
        let with = |beyond: f32, usual: f32| [vec![beyond], vec![usual; 1999]].concat();
        assert_eq!(find(&with(3.7, 0.5), Auto).0, Ok(Scale::Unit));
        assert_eq!(find(&with(3.7, 0.5), Unit), (Ok(Scale::Unit), 0));
        assert_eq!(find(&with(300.0, 90.0), Byte), (Ok(Scale::Byte), 0));
        // Whole numbers of a dark cloud are bytes.
        assert_eq!(find(&with(80.0, 1.0), Auto), (Ok(Scale::Byte), 0));
    }

    #[test]
    fn what_is_beyond_the_scale_is_cut_to_it() {
        assert_eq!(Scale::Unit.apply(0.5), (127.5, true));
        assert_eq!(Scale::Unit.apply(1.5), (255.0, false));
        assert_eq!(Scale::Byte.apply(f32::NAN), (0.0, false));
    }
}
