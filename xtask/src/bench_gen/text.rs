//! The figures of a measurement as one table.

use std::fmt;

use super::{BenchReport, LEAST_SPEED_UP, MOST_OVER_BARE, Memory, Runs};
use harmzone::text_table::text_table;

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
        if self.n_episodes == 0 {
            return self.runs.iter().try_for_each(|runs| runs.fmt(f));
        }
        let number = |value: f64| format!("{value:.2}");
        let mut rows = vec![["ms a sample, one process", "gen", "bare", "ratio", ""].map(str::to_owned)];
        for stage in &self.stages {
            let bare_ms = stage.bare_ms.map_or_else(String::new, number);
            let ratio = stage.bare_ms.map_or_else(String::new, |ms| number(stage.gen_ms / ms));
            let calls = stage.calls.unwrap_or_default().to_string();
            rows.push([stage.name.to_string(), number(stage.gen_ms), bare_ms, ratio, calls]);
        }
        let verdict = verdict(self.over_bare <= MOST_OVER_BARE, &format!("at most {MOST_OVER_BARE}"));
        let ratio = number(self.over_bare);
        rows.push(["all".to_owned(), number(self.gen_ms), number(self.bare_ms), ratio, verdict]);
        f.write_str(&text_table(rows))?;
        writeln!(f, "ratio by episode: {:.2} to {:.2}", self.over_bare_least, self.over_bare_most)?;
        writeln!(
            f,
            "ms an episode: set-up {:.0}, warm-up {:.0}, finishing {:.0}\n",
            self.set_up_ms_per_episode, self.warm_up_ms_per_episode, self.finishing_ms_per_episode
        )?;
        self.runs.iter().try_for_each(|runs| runs.fmt(f))
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
        let jobs_name = format!("samples a second, {jobs} jobs");
        f.write_str(&text_table([
            ["samples a second, 1 job".to_owned(), format!("{:.2}", self.one_job_samples_per_s)],
            [jobs_name, format!("{:.2}", self.jobs_samples_per_s)],
            ["over those of 1 job".to_owned(), format!("{:.2}", self.speed_up)],
            ["kB a sample on disk".to_owned(), format!("{:.1}", self.bytes_per_sample / 1e3)],
        ]))?;
        if !verdict.is_empty() {
            writeln!(f, "speed-up of {jobs} jobs: {verdict}")?;
        }
        let Some(Memory { first, last, most, second_quarter, fourth_quarter }) = self.memory else {
            return writeln!(f, "the worker's memory is not told by this system");
        };
        let mb = |bytes: f64| bytes / 1e6;
        writeln!(
            f,
            "worker's memory, MB: {:.0} after the first sample, {:.0} after the last, {:.0} at most; \
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
