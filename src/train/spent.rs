//! What a run has taken so far: wall and CPU time, summed over all calls, in `time.json` of its folder.
//!
//! Measured, so no two runs agree: no other file of a run holds a time. What a killed call did after its last kept
//! state is not counted; the next call does it again.

use std::path::Path;
use std::time::Instant;

use cpu_time::ProcessTime;
use fs_err as fs;
use serde::{Deserialize, Serialize};

use crate::files;

/// Name of the file.
pub const TIME_FILE: &str = "time.json";

/// Time that a run took.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Spent {
    /// Seconds on the clock, from inputs to the last weights, validation between epochs included.
    pub wall_s: f64,
    /// Seconds of all the process's threads together.
    pub cpu_s: f64,
    /// Calls that kept a state.
    pub n_calls: usize,
}

impl Spent {
    /// What a run's folder says; `None` where it says nothing that can be read.
    #[must_use]
    pub fn read(run: &Path) -> Option<Self> {
        serde_json::from_str(&fs::read_to_string(run.join(TIME_FILE)).ok()?).ok()
    }
}

/// Measures one call of a run over what earlier ones took.
pub struct Stopwatch {
    earlier: Spent,
    wall: Instant,
    cpu: ProcessTime,
}

impl Stopwatch {
    /// Starts, on top of what the folder says.
    #[must_use]
    pub fn start(run: &Path) -> Self {
        let earlier = Spent::read(run).unwrap_or_default();
        Self { earlier, wall: Instant::now(), cpu: ProcessTime::now() }
    }

    /// Writes the sum so far.
    ///
    /// # Errors
    /// Any IO error.
    pub fn save(&self, run: &Path) -> std::io::Result<()> {
        let tenths = |seconds: f64| (10.0 * seconds).round() / 10.0;
        let spent = Spent {
            wall_s: tenths(self.earlier.wall_s + self.wall.elapsed().as_secs_f64()),
            cpu_s: tenths(self.earlier.cpu_s + self.cpu.elapsed().as_secs_f64()),
            n_calls: self.earlier.n_calls + 1,
        };
        let text = serde_json::to_string(&spent).expect("two numbers and a count have a JSON form");
        files::write_atomic(&run.join(TIME_FILE), format!("{text}\n").as_bytes())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_second_call_adds_to_the_first() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(Spent::read(folder.path()), None);
        let before = Spent { wall_s: 100.0, cpu_s: 150.0, n_calls: 1 };
        fs::write(folder.path().join(TIME_FILE), serde_json::to_string(&before).unwrap()).unwrap();
        let watch = Stopwatch::start(folder.path());
        let (wall, cpu, mut n) = (Instant::now(), ProcessTime::now(), 0u64);
        while wall.elapsed().as_millis().min(cpu.elapsed().as_millis()) < 200 {
            n = std::hint::black_box(n + 1);
        }
        watch.save(folder.path()).unwrap();
        watch.save(folder.path()).unwrap();
        let after = Spent::read(folder.path()).unwrap();
        assert!(after.wall_s >= 100.2 && after.cpu_s >= 150.2 && after.n_calls == 2, "{after:?}");
    }
}
