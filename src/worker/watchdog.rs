//! Ends a worker whose task stands still, from within: on a node of a cluster nobody else looks.

use std::io::Write as _;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Tells a worker how many seconds its task may say nothing. Processes of this machine are watched by their parent and lack it.
pub(super) const SILENCE_VARIABLE: &str = "HARMZONE_WORKER_SILENCE_S";

/// How often to look.
const LOOK: Duration = Duration::from_millis(200);

/// When the task under way was last heard of; `None` between tasks.
type Heard = Mutex<Option<Instant>>;

/// Watches the tasks of this process; a thread of its own looks until this is dropped.
#[derive(Debug)]
pub(super) struct Watchdog(Arc<Heard>);

impl Watchdog {
    /// One that ends the process, if [`SILENCE_VARIABLE`] says after what time; else one that never does.
    pub(super) fn of_environment() -> Self {
        let silence_s = std::env::var(SILENCE_VARIABLE).ok().and_then(|text| text.parse().ok());
        match silence_s.map(Duration::from_secs) {
            None => Self(Arc::default()),
            Some(silence) => Self::start(silence, move || {
                let silence_s = silence.as_secs();
                // There may be nobody to hear it.
                let _ = writeln!(
                    std::io::stderr(),
                    "the worker process said nothing for {silence_s} s and ended itself"
                );
                // No destructors: they may wait for what stands still.
                std::process::abort();
            }),
        }
    }

    /// Does this, once, when a task has not been heard of for so long.
    fn start(silence: Duration, on_silence: impl FnOnce() + Send + 'static) -> Self {
        let heard: Arc<Heard> = Arc::default();
        let watched = Arc::downgrade(&heard);
        std::thread::spawn(move || {
            while let Some(heard) = watched.upgrade() {
                let last = *heard.lock().unwrap_or_else(PoisonError::into_inner);
                if last.is_some_and(|last| last.elapsed() >= silence) {
                    return on_silence();
                }
                drop(heard);
                std::thread::sleep(LOOK.min(silence));
            }
        });
        Self(heard)
    }

    /// A task begins, or goes on.
    pub(super) fn hear(&self) {
        self.set(Some(Instant::now()));
    }

    /// No task is under way.
    pub(super) fn rest(&self) {
        self.set(None);
    }

    fn set(&self, heard: Option<Instant>) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = heard;
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::channel;

    use super::*;

    const SILENCE: Duration = Duration::from_secs(1);

    #[test]
    fn a_task_that_stands_still_is_noticed() {
        let (say, said) = channel();
        let watchdog = Watchdog::start(SILENCE, move || say.send(()).unwrap());
        watchdog.hear();
        said.recv_timeout(Duration::from_mins(1)).unwrap();
    }

    #[test]
    fn a_process_without_a_task_may_be_silent() {
        let (say, said) = channel::<()>();
        // Longer than a busy machine stands still between the two calls.
        let silence = 3 * SILENCE;
        let watchdog = Watchdog::start(silence, move || say.send(()).unwrap());
        watchdog.hear();
        watchdog.rest();
        assert!(said.recv_timeout(2 * silence).is_err());
        drop(watchdog);
    }

    #[test]
    fn a_watchdog_that_is_told_no_time_never_ends_the_process() {
        let watchdog = Watchdog::of_environment();
        watchdog.hear();
        assert_eq!(Arc::weak_count(&watchdog.0), 0);
    }
}
