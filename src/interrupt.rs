//! The wish to stop: Ctrl-C or SIGTERM ask a long stage to end soon, with what is whole kept.
//!
//! A stage that listens looks between two steps, [`check`], and ends with an error; the command line tells it. A stage that
//! does not come to look is ended after some seconds: what it was writing is under a partial name. A stage whose steps may take
//! longer, and that has something to save behind them, holds a [`SaveGuard`] and is waited for.

use std::io;
use std::sync::atomic::{AtomicI32, AtomicUsize, Ordering};
use std::time::Duration;

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::iterator::Signals;

/// How long a stage may take to end by itself.
const PATIENCE: Duration = Duration::from_secs(4);
/// Time between two looks at whether a stage still has something to save.
const BETWEEN_LOOKS: Duration = Duration::from_millis(100);

/// The signal that asked; 0: none has.
static ASKED: AtomicI32 = AtomicI32::new(0);

/// Number of the guards.
static N_GUARDS: AtomicUsize = AtomicUsize::new(0);

/// While there is one, a stage that was asked to end may take all the time of its step and of the save behind it.
#[derive(Debug)]
#[must_use = "the stage is waited for only while the guard is there"]
pub struct SaveGuard(());

impl SaveGuard {
    pub fn hold() -> Self {
        N_GUARDS.fetch_add(1, Ordering::SeqCst);
        Self(())
    }
}

impl Drop for SaveGuard {
    fn drop(&mut self) {
        N_GUARDS.fetch_sub(1, Ordering::SeqCst);
    }
}

fn is_guarded() -> bool {
    N_GUARDS.load(Ordering::SeqCst) > 0
}

/// From now on signals ask instead of ending the process; a second one ends it at once.
///
/// # Errors
/// The system refuses.
#[expect(clippy::disallowed_methods, reason = "a process that must end at once runs no destructors")]
pub fn listen() -> io::Result<()> {
    let mut signals = Signals::new([SIGINT, SIGTERM])?;
    std::thread::Builder::new().name("signals".into()).spawn(move || {
        for signal in signals.forever() {
            if ASKED.swap(signal, Ordering::SeqCst) != 0 {
                std::process::exit(exit_code_of(signal).into());
            }
            if is_guarded() {
                tracing::warn!("saving, once the step under way is done; once more ends at once");
            }
            std::thread::spawn(move || {
                wait_for_stage(PATIENCE, is_guarded);
                tracing::warn!(
                    "ended after {} s in one step; what is whole is kept, and the same command goes on",
                    PATIENCE.as_secs()
                );
                std::process::exit(exit_code_of(signal).into());
            });
        }
    })?;
    Ok(())
}

/// Returns when a stage has had its time to end, in which it had nothing to save.
fn wait_for_stage(patience: Duration, is_guarded: impl Fn() -> bool) {
    loop {
        while is_guarded() {
            std::thread::sleep(BETWEEN_LOOKS);
        }
        std::thread::sleep(patience);
        if !is_guarded() {
            return;
        }
    }
}

/// Whether a signal has asked.
#[must_use]
pub fn is_asked() -> bool {
    ASKED.load(Ordering::Relaxed) != 0
}

/// An error once a signal has asked, to end a stage by `?`.
///
/// # Errors
/// A signal has asked.
pub fn check() -> io::Result<()> {
    if is_asked() { Err(io::Error::other("interrupted")) } else { Ok(()) }
}

/// What the process ends with where a signal has asked: 128 and the signal's number, as shells say it.
#[must_use]
pub fn exit_code() -> Option<u8> {
    is_asked().then(|| exit_code_of(ASKED.load(Ordering::SeqCst)))
}

fn exit_code_of(signal: i32) -> u8 {
    128 + u8::try_from(signal).expect("signals have small numbers")
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::AtomicBool;

    use super::*;

    #[test]
    fn a_stage_is_waited_for_until_it_has_saved() {
        let has_to_save = Arc::new(AtomicBool::new(true));
        let asked = Arc::clone(&has_to_save);
        let waiting = std::thread::spawn(move || {
            wait_for_stage(Duration::from_millis(1), || asked.load(Ordering::SeqCst));
        });
        std::thread::sleep(3 * BETWEEN_LOOKS);
        assert!(!waiting.is_finished());
        has_to_save.store(false, Ordering::SeqCst);
        waiting.join().unwrap();
        // Trainings of other tests may hold guards of their own.
        let guard = SaveGuard::hold();
        assert!(is_guarded());
        drop(guard);
    }
}
