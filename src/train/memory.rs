//! Memory of this process, and a bound on it that a run keeps.
//!
//! What is not known is not bounded: the figures are those of Linux's `/proc`.

use fs_err as fs;

use super::error::TrainError;

const MIB: f64 = (1 << 20) as f64;
/// Share of the bound that pictures leave free: no two steps take the same.
const FREE_SHARE: f64 = 0.05;

/// Resident now, MiB.
#[must_use]
pub fn resident_mib() -> Option<f64> {
    field_mib("VmRSS:")
}

/// The most since the process began, MiB.
#[must_use]
pub fn peak_mib() -> Option<f64> {
    field_mib("VmHWM:")
}

fn field_mib(field: &str) -> Option<f64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix(field))?;
    let kibibytes: f64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kibibytes / 1024.0)
}

/// The most memory that a run may take.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MemoryBound {
    most_mib: f64,
}

impl MemoryBound {
    #[must_use]
    pub fn new(most_mib: f64) -> Self {
        Self { most_mib }
    }

    /// Refuses a run before its first step, if what is held by now and the bytes that a step is reckoned to take go beyond the
    /// bound.
    ///
    /// # Errors
    /// [`TrainError::TooLarge`].
    pub fn check_start(self, step_bytes: usize) -> Result<(), TrainError> {
        let (step_mib, held_mib) = (step_bytes as f64 / MIB, peak_mib().unwrap_or_default());
        if held_mib + step_mib <= self.most_mib {
            return Ok(());
        }
        Err(TrainError::TooLarge { held_mib, step_mib, most_mib: self.most_mib })
    }

    /// The bytes that unpacked pictures may take beside the rest of the run.
    #[must_use]
    pub fn room_for_pictures(self, rest: &Rest) -> usize {
        (((1.0 - FREE_SHARE) * self.most_mib - rest.most_mib).max(0.0) * MIB) as usize
    }

    /// Refuses to go on with a run that has gone beyond the bound.
    ///
    /// # Errors
    /// [`TrainError::Grown`].
    pub fn check(self) -> Result<(), TrainError> {
        match peak_mib() {
            Some(peak_mib) if peak_mib > self.most_mib => {
                Err(TrainError::Grown { peak_mib, most_mib: self.most_mib })
            }
            _ => Ok(()),
        }
    }
}

/// The most that a run took beside unpacked pictures, as far as its steps have shown.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Rest {
    peak_mib: f64,
    most_mib: f64,
}

impl Rest {
    /// Looks at the memory while so many bytes of it are pictures. Only a new peak tells anything: an old one was reached
    /// beside as many pictures as there were then.
    pub fn look(&mut self, kept_bytes: usize) {
        self.note(peak_mib().unwrap_or_default(), kept_bytes);
    }

    fn note(&mut self, peak_mib: f64, kept_bytes: usize) {
        if peak_mib > self.peak_mib {
            self.peak_mib = peak_mib;
            self.most_mib = self.most_mib.max(peak_mib - kept_bytes as f64 / MIB);
        }
    }
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use std::process::Command;

    use super::*;

    const ALONE: &str = "HARMZONE_TEST_ALONE";

    #[test]
    fn a_bound_that_is_passed_is_told_and_leaves_no_room_for_pictures() {
        let now = resident_mib().unwrap();
        let told = MemoryBound::new(now / 2.0).check().unwrap_err().to_string();
        assert!(told.contains("--max-memory"), "{told}");
        let mut rest = Rest::default();
        rest.look(0);
        assert_eq!(MemoryBound::new(now / 2.0).room_for_pictures(&rest), 0);
        MemoryBound::new(1e6).check().unwrap();
    }

    #[test]
    fn the_room_for_pictures_is_what_the_rest_leaves_whenever_the_peak_was_reached() {
        let bound = MemoryBound::new(1000.0);
        let room_mib = |rest: &Rest| bound.room_for_pictures(rest) >> 20;
        let mut rest = Rest::default();
        rest.note(400.0, 0);
        assert_eq!(room_mib(&rest), 550);
        // Below the peak, more pictures show nothing of the rest.
        rest.note(400.0, 300 << 20);
        assert_eq!(room_mib(&rest), 550);
        // Full, and a validation takes a little more; then they are forgotten.
        rest.note(980.0, 550 << 20);
        assert_eq!(room_mib(&rest), 520);
        rest.note(980.0, 0);
        assert_eq!(room_mib(&rest), 520);
    }

    #[test]
    fn what_is_filled_is_resident_and_the_peak_stays_when_it_is_freed() {
        // Beside this program's other tests, which free memory at any moment, nothing is sure.
        if std::env::var_os(ALONE).is_none() {
            let name = "what_is_filled_is_resident_and_the_peak_stays_when_it_is_freed";
            let name = format!("{}::{name}", module_path!().split_once("::").unwrap().1);
            let program = std::env::current_exe().unwrap();
            let done = Command::new(program).args(["--exact", &name]).env(ALONE, "1").output().unwrap();
            let told = String::from_utf8_lossy(&done.stdout);
            assert!(done.status.success() && told.contains("1 passed"), "{told}");
            return;
        }
        let before = resident_mib().unwrap();
        let filled = vec![1u8; 256 << 20];
        let during = resident_mib().unwrap();
        assert!(during - before > 200.0, "{before} and {during}");
        drop(std::hint::black_box(filled));
        // The kernel adds a thread's pages to the sum in batches.
        assert!(peak_mib().unwrap() > during - 16.0);
    }
}
