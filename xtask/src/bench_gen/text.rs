//! The figures of a measurement as one table.

use std::fmt;

use super::{BenchReport, LEAST_SPEED_UP, MOST_OVER_BARE, Memory, Runs};

impl fmt::Display for BenchReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{} episodes of {} samples; towns: {}; weathers: {}\n",
            self.n_episodes,
            self.samples_per_episode,
            self.towns.join(", "),
            self.weathers.join(", ")
        )?;
        writeln!(f, "{:<28}{:>9}{:>9}{:>8}", "ms a sample, one process", "gen", "bare", "ratio")?;
        for stage in &self.stages {
            let bare_ms = stage.bare_ms.map_or_else(String::new, |ms| format!("{ms:.2}"));
            let ratio = stage.bare_ms.map_or_else(String::new, |ms| format!("{:.2}", stage.gen_ms / ms));
            let calls = stage.calls.unwrap_or_default();
            let row = format!("  {:<26}{:>9.2}{bare_ms:>9}{ratio:>8}  {calls}", stage.name, stage.gen_ms);
            writeln!(f, "{}", row.trim_end())?;
        }
        writeln!(
            f,
            "  {:<26}{:>9.2}{:>9.2}{:>8.2}  {}; by episode {:.2} to {:.2}",
            "all",
            self.gen_ms,
            self.bare_ms,
            self.over_bare,
            verdict(self.over_bare <= MOST_OVER_BARE, &format!("at most {MOST_OVER_BARE}")),
            self.over_bare_least,
            self.over_bare_most
        )?;
        writeln!(
            f,
            "ms an episode: set-up {:.0}, warm-up {:.0}, finishing {:.0}\n",
            self.set_up_ms_per_episode, self.warm_up_ms_per_episode, self.finishing_ms_per_episode
        )?;
        self.runs.fmt(f)
    }
}

fn verdict(holds: bool, wanted: &str) -> String {
    format!("{} ({wanted})", if holds { "ok" } else { "MISSED" })
}

impl fmt::Display for Runs {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { n_episodes, n_samples, jobs, .. } = self;
        writeln!(f, "{n_episodes} episodes, {n_samples} samples, everything included")?;
        let verdict = match jobs {
            2 => verdict(self.speed_up >= LEAST_SPEED_UP, &format!("at least {LEAST_SPEED_UP}")),
            _ => String::new(),
        };
        writeln!(f, "  {:<26}{:>9.2}", "samples a second, 1 job", self.one_job_samples_per_s)?;
        writeln!(
            f,
            "  {:<26}{:>9.2}{:>9}{:>8.2}  {verdict}",
            format!("samples a second, {jobs} jobs"),
            self.jobs_samples_per_s,
            "",
            self.speed_up
        )?;
        writeln!(f, "  {:<26}{:>9.1}", "kB a sample on disk", self.bytes_per_sample / 1e3)?;
        let Some(Memory { first, last, most, second_quarter, fourth_quarter }) = self.memory else {
            return writeln!(f, "  the worker's memory is not told by this system");
        };
        let mb = |bytes: f64| bytes / 1e6;
        writeln!(
            f,
            "  worker's memory, MB: {:.0} after the first sample, {:.0} after the last, {:.0} at most; \
             second quarter {:.0}, fourth {:.0} ({:+.1} %)",
            mb(first as f64),
            mb(last as f64),
            mb(most as f64),
            mb(second_quarter),
            mb(fourth_quarter),
            100.0 * (fourth_quarter / second_quarter - 1.0)
        )
    }
}
