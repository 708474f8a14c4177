//! A stage told by lines, where no terminal shows a bar: one at each tenth, and one a period, also while no step ends.

use std::fmt;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use indicatif::FormattedDuration;

/// Tells how far a stage is, until it is dropped; then nothing more comes.
pub(super) struct Heartbeat {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

/// What the stage and the thread that waits for the period share.
struct Shared {
    timed: Mutex<TimedStage>,
    ended: Condvar,
    period: Duration,
    tell: Box<dyn Fn(&str) + Send + Sync>,
}

/// How far a stage is, and since when.
struct TimedStage {
    name: String,
    total: u64,
    /// Steps that an earlier call did: those that are told before the first one is done here.
    n_before: u64,
    n_done: u64,
    note: String,
    started: Instant,
    /// When the last step ended; before that, when the stage began.
    stepped: Instant,
    /// When the last line was told; before that, when the stage began.
    told: Instant,
    /// Next tenth to tell.
    next_tenth: u64,
    is_over: bool,
}

impl Heartbeat {
    /// Begins to tell of a stage of `total` steps, a line each `period` at the least.
    pub(super) fn start(
        name: &str,
        total: u64,
        period: Duration,
        tell: impl Fn(&str) + Send + Sync + 'static,
    ) -> Self {
        let timed = Mutex::new(TimedStage::new(name, total, Instant::now()));
        let shared = Arc::new(Shared { timed, ended: Condvar::new(), period, tell: Box::new(tell) });
        let of_thread = Arc::clone(&shared);
        let thread = std::thread::Builder::new().name("heartbeat".into()).spawn(move || of_thread.beat());
        // Where the system gives no thread, lines come with steps alone.
        Self { shared, thread: thread.ok() }
    }

    /// `n` steps were done before the stage began here.
    pub(super) fn skip(&self, n: u64) {
        let mut timed = self.shared.lock();
        timed.n_before += n;
        timed.n_done += n;
    }

    /// `n` more steps are done.
    pub(super) fn advance(&self, n: u64) {
        let now = Instant::now();
        let mut timed = self.shared.lock();
        timed.step(n, now);
        if timed.is_at_tenth() || timed.next_beat(self.shared.period) <= now {
            self.shared.tell_line(&mut timed, now);
        }
    }

    /// A short text for the ends of the lines.
    pub(super) fn note(&self, text: &str) {
        text.clone_into(&mut self.shared.lock().note);
    }
}

impl Drop for Heartbeat {
    fn drop(&mut self) {
        self.shared.lock().is_over = true;
        self.shared.ended.notify_all();
        if let Some(thread) = self.thread.take() {
            // It does nothing that could panic, and nobody could be told.
            let _ = thread.join();
        }
    }
}

impl fmt::Debug for Heartbeat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Heartbeat").finish_non_exhaustive()
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, TimedStage> {
        self.timed.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Tells a line whenever none was told for the period, until the stage is over.
    fn beat(&self) {
        let mut timed = self.lock();
        while !timed.is_over {
            let now = Instant::now();
            let left = timed.next_beat(self.period).saturating_duration_since(now);
            if left.is_zero() {
                self.tell_line(&mut timed, now);
            } else {
                timed = self.ended.wait_timeout(timed, left).unwrap_or_else(PoisonError::into_inner).0;
            }
        }
    }

    fn tell_line(&self, timed: &mut TimedStage, now: Instant) {
        (self.tell)(&timed.line(now));
        timed.told = now;
        timed.next_tenth = timed.n_done.saturating_mul(10) / timed.total + 1;
    }
}

impl TimedStage {
    fn new(name: &str, total: u64, now: Instant) -> Self {
        Self {
            name: name.to_owned(),
            total: total.max(1),
            n_before: 0,
            n_done: 0,
            note: String::new(),
            started: now,
            stepped: now,
            told: now,
            next_tenth: 1,
            is_over: false,
        }
    }

    fn step(&mut self, n: u64, now: Instant) {
        self.n_done += n;
        self.stepped = now;
    }

    fn is_at_tenth(&self) -> bool {
        self.n_done.saturating_mul(10) >= self.next_tenth.saturating_mul(self.total)
    }

    /// When a line is due at the latest.
    fn next_beat(&self, period: Duration) -> Instant {
        self.told + period
    }

    /// Stage, steps done of all, rate, time left, how long no step has ended if none has since the last line, and the note.
    fn line(&self, now: Instant) -> String {
        let Self { name, total, n_done, note, .. } = self;
        let mut line = format!("{name:>10} {n_done}/{total}");
        let seconds = (now - self.started).as_secs_f64();
        let per_second = (n_done - self.n_before) as f64 / seconds.max(1e-9);
        if seconds >= 1.0 && per_second > 0.0 {
            let left_s = (total.saturating_sub(*n_done) as f64 / per_second).min(1e9);
            line += &format!(" {} {} left", rate_in_words(per_second), in_words(left_s));
        }
        if self.stepped <= self.told && self.told < now {
            line += &format!(", no step for {}", in_words((now - self.stepped).as_secs_f64()));
        }
        format!("{line} {note}").trim_end().to_owned()
    }
}

/// A rate by the unit of time in which it has digits to show.
fn rate_in_words(per_second: f64) -> String {
    let (seconds, unit) = match per_second {
        0.1.. => (1.0, "s"),
        rate if rate * 60.0 >= 0.1 => (60.0, "min"),
        _ => (3600.0, "h"),
    };
    format!("{:.1}/{unit}", per_second * seconds)
}

fn in_words(seconds: f64) -> FormattedDuration {
    FormattedDuration(Duration::from_secs(seconds.round() as u64))
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::{Receiver, TryRecvError, channel};

    use super::*;

    /// Longer than any machine is busy.
    const LONG: Duration = Duration::from_mins(1);

    fn begin(total: u64, period: Duration) -> (Heartbeat, Receiver<String>) {
        let (to, lines) = channel();
        let tell = move |line: &str| to.send(line.to_owned()).unwrap();
        (Heartbeat::start("predict", total, period, tell), lines)
    }

    #[test]
    fn lines_come_while_no_step_ends_and_none_after_the_end() {
        let (heart, lines) = begin(10, Duration::from_millis(20));
        let first = lines.recv_timeout(LONG).unwrap();
        heart.note("town_3");
        // The one under way may be of before.
        lines.recv_timeout(LONG).unwrap();
        assert!(first.starts_with("   predict 0/10") && first.contains(", no step for 00:0"), "{first}");
        let last = lines.recv_timeout(LONG).unwrap();
        assert!(last.ends_with(" town_3"), "{last}");
        drop(heart);
        while lines.try_recv().is_ok() {}
        // Nobody is left who could send.
        assert_eq!(lines.try_recv(), Err(TryRecvError::Disconnected));
    }

    #[test]
    fn a_stage_shorter_than_the_period_tells_its_tenths_and_ends_at_once() {
        let begun = Instant::now();
        let (heart, lines) = begin(20, 60 * LONG);
        heart.skip(1);
        heart.advance(0);
        assert!(lines.try_recv().is_err());
        (0..4).for_each(|_| heart.advance(1));
        drop(heart);
        let told: Vec<String> = lines.iter().collect();
        // On a machine that stood still for a second they tell the rate, too.
        let is_told = |(line, wanted): (&String, &str)| line.starts_with(wanted);
        let wanted = ["   predict 2/20", "   predict 4/20"];
        assert!(told.len() == 2 && told.iter().zip(wanted).all(is_told), "{told:?}");
        assert!(begun.elapsed() < LONG);
    }

    #[test]
    fn rate_time_left_and_the_time_without_a_step_are_those_of_the_steps_done_here() {
        let begun = Instant::now();
        let after = |seconds| begun + Duration::from_secs(seconds);
        let mut stage = TimedStage::new("train", 100, begun);
        (stage.n_before, stage.n_done) = (10, 10);
        assert_eq!(stage.line(after(50)), "     train 10/100, no step for 00:00:50");
        stage.step(20, after(10));
        assert_eq!(stage.line(after(10)), "     train 30/100 2.0/s 00:00:35 left");
        stage.told = after(10);
        // 20 steps in 100 s, and 70 are left.
        assert_eq!(stage.line(after(100)), "     train 30/100 0.2/s 00:05:50 left, no step for 00:01:30");
        stage.step(10, after(110));
        stage.note = "loss 0.5".to_owned();
        assert_eq!(stage.line(after(120)), "     train 40/100 0.2/s 00:04:00 left loss 0.5");
        assert_eq!(stage.next_beat(Duration::from_mins(1)), after(70));
    }

    #[test]
    fn slow_rates_are_told_by_the_minute_or_the_hour() {
        let told = [12.34, 0.1, 0.05, 0.002, 0.001].map(rate_in_words);
        assert_eq!(told, ["12.3/s", "0.1/s", "3.0/min", "0.1/min", "3.6/h"]);
    }
}
