//! How long a run has taken so far: wall and CPU time, summed over all calls, in `time.json` of its folder.
//!
//! Times are measured, so no two runs agree: no other file of a run holds a time. The work of a killed call
//! after its last saved state is not counted; the next call repeats it.

use std::path::Path;
use std::time::{Duration, Instant};

use cpu_time::ProcessTime;
use fs_err as fs;
use serde::{Deserialize, Serialize};

use crate::files;

/// Name of the file.
pub const TIME_FILE: &str = "time.json";

/// Time that a run took so far.
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

    /// The sum after one more call; seconds are rounded to tenths.
    fn add_call(self, wall: Duration, cpu: Duration) -> Self {
        let tenths = |seconds: f64| (10.0 * seconds).round() / 10.0;
        Self {
            wall_s: tenths(self.wall_s + wall.as_secs_f64()),
            cpu_s: tenths(self.cpu_s + cpu.as_secs_f64()),
            n_calls: self.n_calls + 1,
        }
    }
}

/// Measures one call of a run, on top of the earlier ones.
pub struct Stopwatch {
    earlier: TrainingTime,
    wall: Instant,
    cpu: ProcessTime,
}

impl Stopwatch {
    /// Starts from the sum of earlier calls.
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
        let time = self.earlier.add_call(self.wall.elapsed(), self.cpu.elapsed());
        let text = serde_json::to_string(&time).expect("two numbers and a count have a JSON form");
        files::write_atomic(&run.join(TIME_FILE), format!("{text}\n").as_bytes())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_call_adds_its_tenths_of_seconds() {
        let before = TrainingTime { wall_s: 100.0, cpu_s: 150.0, n_calls: 1 };
        let after = before.add_call(Duration::from_millis(260), Duration::from_millis(1_040));
        assert_eq!(after, TrainingTime { wall_s: 100.3, cpu_s: 151.0, n_calls: 2 });
    }

    #[test]
    fn a_second_call_goes_on_from_what_the_folder_says() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(TrainingTime::read(folder.path()), None);
        Stopwatch::start(folder.path()).save(folder.path()).unwrap();
        let watch = Stopwatch::start(folder.path());
        watch.save(folder.path()).unwrap();
        watch.save(folder.path()).unwrap();
        assert_eq!(TrainingTime::read(folder.path()).unwrap().n_calls, 2);
    }
}
