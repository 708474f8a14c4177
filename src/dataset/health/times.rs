//! Whether the samples of an episode follow each other in time, at the config's period, and each message is of its sample's time.

use std::path::Path;

use super::check::{Aspect, Remark};
use crate::episode::OffStamps;

/// Samples may lie this far from the config's period: it is exact, and no float has a nanosecond of a date.
const MAX_OFF_NS: f64 = 1_000.0;

/// `times_ns`: of the samples, sorted; `in_file_ns`: the same in the order in which they lie in the file; `period_s`: between
/// two samples, where the config tells it.
pub(super) fn examine(times_ns: &[u64], in_file_ns: &[u64], period_s: Option<f64>) -> Vec<Remark> {
    let pairs = |times: &[u64]| -> Vec<(u64, u64)> {
        times.iter().copied().zip(times.iter().skip(1).copied()).collect()
    };
    let again = pairs(times_ns).into_iter().position(|(one, next)| one >= next).map(|i| {
        let text =
            format!("samples {i} and {} are both at {} ns; each needs its own time", i + 1, times_ns[i]);
        Remark::fault(Aspect::Times, "same time", text)
    });
    let back = pairs(in_file_ns).into_iter().find(|(one, next)| one > next).map(|(one, next)| {
        let text =
            format!("a sample at {next} ns follows one at {one} ns in the file; rising times are needed");
        Remark::fault(Aspect::Times, "order", text)
    });
    let off = period_s.and_then(|period_s| {
        let is_off =
            |(one, next): &(u64, u64)| (next.saturating_sub(*one) as f64 - period_s * 1e9).abs() > MAX_OFF_NS;
        let (i, (one, next)) = pairs(times_ns).into_iter().enumerate().find(|(_, pair)| is_off(pair))?;
        let gap_s = next.saturating_sub(one) as f64 * 1e-9;
        let text = format!(
            "samples {i} and {} are {gap_s:.6} s apart; the config's sample_period_s is {period_s} s",
            i + 1
        );
        Some(Remark::fault(Aspect::Times, "period", text))
    });
    [again, back, off].into_iter().flatten().collect()
}

/// What is said of messages whose own stamps are not their log times: one remark a file, which names the topics of all. `may_be`:
/// whether nobody knows who stamped them.
pub(super) fn examine_stamps(path: &Path, off: &[OffStamps], may_be: bool) -> Option<Remark> {
    let OffStamps { topic, log_time_ns, stamp_ns, .. } = off.first()?;
    let off_s = (stamp_ns - i128::from(*log_time_ns)) as f64 * 1e-9;
    let all: Vec<String> = off.iter().map(|of| format!("{} of `{}`", of.n_messages, of.topic)).collect();
    let text = format!(
        "the message of `{topic}` at {log_time_ns} ns is stamped {stamp_ns} ns inside ({off_s:+.9} s); both should be one time, \
         else it was shifted or is another sample's; messages so stamped: {}: {}",
        all.join(", "),
        path.display()
    );
    Some(Remark::unless(may_be, Aspect::Times, "stamp", text))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::health::Severity;

    #[test]
    fn one_remark_names_both_stamps_of_the_first_message_and_the_topics_of_all() {
        let of = |topic: &str, n_messages| OffStamps {
            topic: topic.to_owned(),
            log_time_ns: 1_000_000_000,
            stamp_ns: 101_000_000_000,
            n_messages,
        };
        let path = Path::new("a.mcap");
        assert_eq!(examine_stamps(path, &[], false), None);
        let remark = examine_stamps(path, &[of("/lidar_top", 3), of("/tf", 2)], false).unwrap();
        assert_eq!((remark.severity, remark.aspect), (Severity::Fault, Aspect::Times));
        for part in [
            "`/lidar_top` at 1000000000 ns is stamped 101000000000 ns inside (+100.000000000 s)",
            "3 of `/lidar_top`, 2 of `/tf`: a.mcap",
        ] {
            assert!(remark.text.contains(part), "{}", remark.text);
        }
        assert_eq!(examine_stamps(path, &[of("/tf", 1)], true).unwrap().severity, Severity::Warning);
    }

    fn kinds(times_ns: &[u64], in_file_ns: &[u64], period_s: Option<f64>) -> Vec<&'static str> {
        examine(times_ns, in_file_ns, period_s).iter().map(|remark| remark.kind).collect()
    }

    #[test]
    fn each_way_out_of_order_is_named() {
        let even = [1_000_000_000, 1_300_000_000, 1_600_000_000];
        assert_eq!(kinds(&even, &even, Some(0.3)), [""; 0]);
        assert_eq!(kinds(&[even[0], even[0], even[2]], &even, None), ["same time"]);
        assert_eq!(kinds(&even, &[even[1], even[0], even[2]], Some(0.3)), ["order"]);
        assert_eq!(kinds(&[even[0], even[1] + 10_000_000, even[2]], &even, Some(0.3)), ["period"]);
        assert_eq!(kinds(&even[..1], &even[..1], Some(0.3)), [""; 0]);
    }
}
