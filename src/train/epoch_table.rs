//! The table that a training tells while it runs, a row an epoch.

use std::time::{Duration, Instant};

use super::losses::LossParts;
use super::plan::{Plan, Position};
use crate::progress::Progress;

/// Counts steps and time of this call, and tells rows.
pub struct EpochTable {
    batch_size: usize,
    n_steps: usize,
    n_epochs: usize,
    has_header: bool,
    counted: usize,
    since: Instant,
    /// What the last validation found.
    pub last_ap: Option<String>,
}

impl EpochTable {
    /// Of a stage that goes on at a position.
    ///
    /// # Arguments
    /// - `batch_size`: samples of a step
    pub fn new(plan: &Plan, position: Position, batch_size: usize) -> Self {
        Self {
            batch_size,
            n_steps: plan.n_steps.iter().sum(),
            n_epochs: plan.n_steps[position.stage] / plan.steps_per_epoch.max(1),
            has_header: false,
            counted: 0,
            since: Instant::now(),
            last_ap: None,
        }
    }

    pub fn count(&mut self, n_steps: usize) {
        self.counted += n_steps;
    }

    /// Of this call and stage, validation included.
    pub fn samples_per_second(&self) -> f64 {
        (self.counted * self.batch_size) as f64 / self.since.elapsed().as_secs_f64().max(1e-9)
    }

    /// Tells the row of an epoch that is done.
    ///
    /// # Arguments
    /// - `n_done`: steps of all stages until now
    pub fn tell(
        &mut self,
        progress: &dyn Progress,
        stage: &str,
        epoch: usize,
        loss: LossParts,
        n_done: usize,
    ) {
        if !self.has_header {
            self.has_header = true;
            progress.line("  stage  epoch    loss heatmap    harm   boxes      AP samples/s    left");
        }
        let per_step = self.since.elapsed().as_secs_f64() / self.counted.max(1) as f64;
        let left = Duration::from_secs_f64(per_step * self.n_steps.saturating_sub(n_done) as f64);
        progress.line(&format!(
            "{stage:>7} {:>6} {:>7.3} {:>7.3} {:>7.3} {:>7.3} {:>7} {:>9.1} {:>7}",
            format!("{}/{}", epoch + 1, self.n_epochs),
            loss.total(),
            loss.heatmap,
            loss.harm,
            loss.boxes,
            self.last_ap.as_deref().unwrap_or("-"),
            self.samples_per_second(),
            clock(left)
        ));
    }
}

/// Hours, minutes and seconds, as 1:02:03 or 2:03.
fn clock(time: Duration) -> String {
    let seconds = time.as_secs();
    let (h, m, s) = (seconds / 3600, seconds / 60 % 60, seconds % 60);
    if h > 0 { format!("{h}:{m:02}:{s:02}") } else { format!("{m}:{s:02}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_read_as_on_a_clock() {
        assert_eq!([5, 65, 3723].map(|s| clock(Duration::from_secs(s))), ["0:05", "1:05", "1:02:03"]);
    }
}
