//! How long a run has taken so far: wall and CPU time, summed over all calls, in `time.json` of its folder.
//!
//! Measured, so no two runs agree: no other file of a run holds a time. What a killed call did after its last saved
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
pub struct TrainingTime {
    /// Seconds on the clock, from inputs to the last weights, validation between epochs included.
    pub wall_s: f64,
    /// Seconds of all the process's threads together.
    pub cpu_s: f64,
    /// Calls that saved a state.
    pub n_calls: usize,
}

impl TrainingTime {
    /// Reads a run's folder; `None` where the file is missing or broken.
    #[must_use]
    pub fn read(run: &Path) -> Option<Self> {
        serde_json::from_str(&fs::read_to_string(run.join(TIME_FILE)).ok()?).ok()
    }
}

/// Measures one call of a run over what earlier ones took.
pub struct Stopwatch {
    earlier: TrainingTime,
    wall: Instant,
    cpu: ProcessTime,
}

impl Stopwatch {
    /// Starts from what earlier calls took.
    #[must_use]
    pub fn start(run: &Path) -> Self {
        let earlier = TrainingTime::read(run).unwrap_or_default();
        Self { earlier, wall: Instant::now(), cpu: ProcessTime::now() }
    }

    /// Writes the sum so far.
    ///
    /// # Errors
    /// Any IO error.
    pub fn save(&self, run: &Path) -> std::io::Result<()> {
        let tenths = |seconds: f64| (10.0 * seconds).round() / 10.0;
        let time = TrainingTime {
            wall_s: tenths(self.earlier.wall_s + self.wall.elapsed().as_secs_f64()),
            cpu_s: tenths(self.earlier.cpu_s + self.cpu.elapsed().as_secs_f64()),
            n_calls: self.earlier.n_calls + 1,
        };
        let text = serde_json::to_string(&time).expect("two numbers and a count have a JSON form");
        files::write_atomic(&run.join(TIME_FILE), format!("{text}\n").as_bytes())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_second_call_adds_to_the_first() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(TrainingTime::read(folder.path()), None);
        let before = TrainingTime { wall_s: 100.0, cpu_s: 150.0, n_calls: 1 };
        fs::write(folder.path().join(TIME_FILE), serde_json::to_string(&before).unwrap()).unwrap();
        let watch = Stopwatch::start(folder.path());
        let (wall, cpu, mut n) = (Instant::now(), ProcessTime::now(), 0u64);
        while wall.elapsed().as_millis().min(cpu.elapsed().as_millis()) < 200 {
            n = std::hint::black_box(n + 1);
        }
        watch.save(folder.path()).unwrap();
        watch.save(folder.path()).unwrap();
        let after = TrainingTime::read(folder.path()).unwrap();
        assert!(after.wall_s >= 100.2 && after.cpu_s >= 150.2 && after.n_calls == 2, "{after:?}");
    }
}
