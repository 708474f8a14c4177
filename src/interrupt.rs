//! The wish to stop: Ctrl-C or SIGTERM ask a long stage to end soon, with what is whole kept.
//!
//! A stage that listens looks between two steps, [`check`], and ends with an error; the command line tells it. A stage that
//! does not come to look is ended after some seconds: what it was writing is under a partial name.

use std::io;
use std::sync::atomic::{AtomicI32, Ordering};
use std::time::Duration;

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::iterator::Signals;

/// How long a stage may take to end by itself.
const PATIENCE: Duration = Duration::from_secs(4);

/// The signal that asked; 0: none has.
static ASKED: AtomicI32 = AtomicI32::new(0);

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
            std::thread::spawn(move || {
                std::thread::sleep(PATIENCE);
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
