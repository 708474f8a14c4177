//! The one progress style: a bar on stderr with stage, count, rate, note and time to go.

use std::sync::Mutex;
use std::time::{Duration, Instant};

use indicatif::{FormattedDuration, ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::{tell, verbosity};
use crate::progress::Progress;

/// Where there is no terminal, a line comes at each tenth, and at least this often while something moves.
const HEARTBEAT: Duration = Duration::from_mins(1);

/// Draws the current stage as one bar on stderr; plain lines where stderr is no terminal; nothing with `--quiet`.
#[derive(Debug, Default)]
pub struct Bar {
    current: Mutex<Option<CurrentBar>>,
}

#[derive(Debug)]
struct CurrentBar {
    bar: ProgressBar,
    /// Steps that an earlier call did: those that are told before the first one is done here.
    n_before: u64,
    started: Instant,
    /// Next tenth to tell as a line where there is no terminal.
    next_tenth: u64,
    told: Instant,
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
        let now = Instant::now();
        *self.lock() = Some(CurrentBar { bar, n_before: 0, started: now, next_tenth: 1, told: now });
    }

    fn skip(&self, n: u64) {
        let mut current = self.lock();
        let Some(CurrentBar { bar, n_before, .. }) = current.as_mut() else { return };
        bar.inc(n);
        bar.reset_eta();
        *n_before += n;
    }

    fn advance(&self, n: u64) {
        let mut current = self.lock();
        let Some(current) = current.as_mut() else { return };
        current.bar.inc(n);
        if current.bar.is_hidden() && !verbosity::is_quiet() {
            current.tell_line();
        }
    }

    fn note(&self, text: &str) {
        if let Some(stage) = self.lock().as_ref() {
            stage.bar.set_message(text.to_owned());
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

impl CurrentBar {
    /// Tells how far the stage is, if that is due.
    fn tell_line(&mut self) {
        let (n_done, total) = (self.bar.position(), self.bar.length().unwrap_or(0).max(1));
        let is_tenth = n_done * 10 >= self.next_tenth * total;
        if !is_tenth && self.told.elapsed() < HEARTBEAT {
            return;
        }
        self.next_tenth = n_done * 10 / total + 1;
        self.told = Instant::now();
        let seconds = self.started.elapsed().as_secs_f64();
        let per_second = (n_done - self.n_before) as f64 / seconds.max(1e-9);
        let left =
            Duration::from_secs_f64((total.saturating_sub(n_done) as f64 / per_second).clamp(0.0, 1e9));
        let mut line = format!("{:>10} {n_done}/{total}", self.bar.prefix());
        if seconds >= 1.0 && per_second > 0.0 {
            line += &format!(
                " {per_second:.1}/s {} left",
                FormattedDuration(Duration::from_secs(left.as_secs()))
            );
        }
        tell(format!("{line} {}", self.bar.message()).trim_end());
    }
}

impl Bar {
    fn lock(&self) -> std::sync::MutexGuard<'_, Option<CurrentBar>> {
        self.current.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }
}
