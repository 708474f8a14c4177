//! Dashes along lines: how boxes of objects out of distribution are told from others.

/// The parts of a segment from `0` to `1` that are drawn, for dashes and gaps of these lengths; whole where the segment is shorter.
pub(super) fn dashes(length: f64, dash: f64, gap: f64) -> Vec<(f64, f64)> {
    if !(length > dash + gap) {
        return vec![(0.0, 1.0)];
    }
    // As many as fit, stretched, so that both ends of the segment are drawn.
    let n = ((length + gap) / (dash + gap)).floor();
    let stretch = length / (n * (dash + gap) - gap);
    let (dash, step) = (dash * stretch / length, (dash + gap) * stretch / length);
    (0..n as usize).map(|i| (i as f64 * step, (i as f64 * step + dash).min(1.0))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dashes_begin_and_end_with_the_segment() {
        let parts = dashes(10.0, 1.0, 0.6);
        assert_eq!(parts.len(), 6);
        assert_eq!(parts[0].0, 0.0);
        assert!((parts[5].1 - 1.0).abs() < 1e-9, "{parts:?}");
        assert!(parts.windows(2).all(|pair| pair[0].1 < pair[1].0), "{parts:?}");
        let drawn: f64 = parts.iter().map(|(from, to)| to - from).sum();
        assert!((drawn - 0.66).abs() < 0.05, "{drawn}");
    }

    #[test]
    fn what_is_too_short_or_no_length_is_whole() {
        assert_eq!(dashes(1.0, 1.0, 0.6), [(0.0, 1.0)]);
        assert_eq!(dashes(f64::NAN, 1.0, 0.6), [(0.0, 1.0)]);
    }
}
