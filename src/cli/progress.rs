//! The one progress style: a bar on stderr with stage, count, rate, note and time to go.

use std::sync::Mutex;

use indicatif::{ProgressBar, ProgressStyle};

use super::tell;
use crate::progress::Progress;

/// Draws the current stage as one bar on stderr; plain lines where stderr is no terminal.
#[derive(Debug, Default)]
pub struct Bar {
    current: Mutex<Option<CurrentBar>>,
}

#[derive(Debug)]
struct CurrentBar {
    bar: ProgressBar,
    /// Next tenth to tell as a line where there is no terminal.
    next_tenth: u64,
}

impl Progress for Bar {
    fn start(&self, stage: &str, total: u64) {
        self.finish();
        let style = ProgressStyle::with_template(
            "{prefix:>10} [{bar:30}] {pos}/{len} {per_sec} {msg} {elapsed}<{eta}",
        )
        .expect("the template is valid")
        .progress_chars("=> ");
        let bar = ProgressBar::new(total).with_style(style).with_prefix(stage.to_owned());
        *self.lock() = Some(CurrentBar { bar, next_tenth: 1 });
    }

    fn advance(&self, n: u64) {
        let mut current = self.lock();
        let Some(CurrentBar { bar, next_tenth }) = current.as_mut() else { return };
        bar.inc(n);
        let (n_done, total) = (bar.position(), bar.length().unwrap_or(0).max(1));
        if bar.is_hidden() && n_done * 10 >= *next_tenth * total {
            *next_tenth = n_done * 10 / total + 1;
            tell(format!("{:>10} {n_done}/{total} {}", bar.prefix(), bar.message()));
        }
    }

    fn note(&self, text: &str) {
        if let Some(stage) = self.lock().as_ref() {
            stage.bar.set_message(text.to_owned());
        }
    }

    fn finish(&self) {
        if let Some(stage) = self.lock().take() {
            stage.bar.finish();
        }
    }
}

impl Bar {
    fn lock(&self) -> std::sync::MutexGuard<'_, Option<CurrentBar>> {
        self.current.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }
}
