//! The one progress style: a bar on stderr with stage, count, rate, note and time to go.

use std::sync::Mutex;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::heartbeat::Heartbeat;
use super::{tell, verbosity};
use crate::progress::Progress;

/// Where there is no terminal, a line comes at each tenth, and at least this often.
const PERIOD: Duration = Duration::from_mins(1);

/// Draws the current stage as one bar on stderr; plain lines where stderr is no terminal; nothing with `--quiet`.
#[derive(Debug, Default)]
pub struct Bar {
    current: Mutex<Option<CurrentBar>>,
}

#[derive(Debug)]
struct CurrentBar {
    bar: ProgressBar,
    /// Tells lines where there is no terminal.
    lines: Option<Heartbeat>,
}

impl Progress for Bar {
    fn start(&self, stage: &str, total: u64) {
        self.finish();
        let style = ProgressStyle::with_template(
            "{prefix:>10} [{bar:30}] {pos}/{len} {per_sec} {msg} {elapsed}<{eta}",
        )
        .expect("the template is valid")
        .progress_chars("=> ");
        let target =
            if verbosity::is_quiet() { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
        let bar = ProgressBar::with_draw_target(Some(total), target);
        let bar = bar.with_style(style).with_prefix(stage.to_owned());
        let has_lines = bar.is_hidden() && !verbosity::is_quiet();
        let lines = has_lines.then(|| Heartbeat::start(stage, total, PERIOD, |line| tell(line)));
        *self.lock() = Some(CurrentBar { bar, lines });
    }

    fn skip(&self, n: u64) {
        let current = self.lock();
        let Some(CurrentBar { bar, lines }) = current.as_ref() else { return };
        bar.inc(n);
        bar.reset_eta();
        if let Some(lines) = lines {
            lines.skip(n);
        }
    }

    fn advance(&self, n: u64) {
        let current = self.lock();
        let Some(CurrentBar { bar, lines }) = current.as_ref() else { return };
        bar.inc(n);
        if let Some(lines) = lines {
            lines.advance(n);
        }
    }

    fn note(&self, text: &str) {
        let current = self.lock();
        let Some(CurrentBar { bar, lines }) = current.as_ref() else { return };
        bar.set_message(text.to_owned());
        if let Some(lines) = lines {
            lines.note(text);
        }
    }

    fn line(&self, text: &str) {
        if verbosity::is_quiet() {
            return;
        }
        match self.lock().as_ref().filter(|current| !current.bar.is_hidden()) {
            Some(current) => current.bar.suspend(|| tell(text)),
            None => tell(text),
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
