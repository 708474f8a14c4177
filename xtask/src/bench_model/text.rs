//! The figures of a measurement as Markdown tables.

use std::fmt;

use super::{BenchReport, InferenceReport, Times, TrainingReport};

impl fmt::Display for BenchReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{} threads\n", self.n_threads)?;
        writeln!(f, "{}", self.inference)?;
        for (i, training) in self.training.iter().enumerate() {
            if i > 0 {
                writeln!(f)?;
            }
            write!(f, "{training}")?;
        }
        Ok(())
    }
}

impl fmt::Display for InferenceReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "Inference, one sample at a time, {} samples\n", self.n_samples)?;
        writeln!(f, "| stage | mean ms | p50 ms | p99 ms |\n|---|---|---|---|")?;
        for Times { name, mean_ms, p50_ms, p99_ms, .. } in self.stages.iter().chain([&self.total]) {
            writeln!(f, "| {name} | {mean_ms:.2} | {p50_ms:.2} | {p99_ms:.2} |")?;
        }
        writeln!(f, "\n{:.1} samples a second", self.samples_per_s)
    }
}

impl fmt::Display for TrainingReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "Training, {} stage: {} x {} samples a step, {} states a sample, {} steps\n",
            self.stage, self.accumulate, self.batch_size, self.n_states, self.n_steps
        )?;
        writeln!(f, "| | median ms | p90 ms |\n|---|---|---|")?;
        for Times { name, p50_ms, p90_ms, .. } in self.parts.iter().chain([&self.loading, &self.step]) {
            writeln!(f, "| {name} | {p50_ms:.1} | {p90_ms:.1} |")?;
        }
        Ok(())
    }
}
