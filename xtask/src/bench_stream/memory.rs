//! Resident memory of this process, as Linux's `/proc` tells it; nothing elsewhere.

use fs_err as fs;

/// Resident now, MiB.
pub fn resident_mib() -> Option<f64> {
    field_mib("VmRSS:")
}

/// The most since the process began, MiB.
pub fn peak_mib() -> Option<f64> {
    field_mib("VmHWM:")
}

fn field_mib(field: &str) -> Option<f64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix(field))?;
    let kibibytes: f64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kibibytes / 1024.0)
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;

    #[test]
    fn what_is_filled_is_resident_and_the_peak_stays_when_it_is_freed() {
        let before = resident_mib().unwrap();
        let filled = vec![1u8; 256 << 20];
        let during = resident_mib().unwrap();
        assert!(during - before > 200.0, "{before} and {during}");
        drop(std::hint::black_box(filled));
        // The kernel adds a thread's pages to the sum in batches.
        assert!(peak_mib().unwrap() > during - 16.0);
    }
}
