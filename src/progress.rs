//! Progress of long work: library code reports it, the command line draws it as a bar.

/// A watcher of long work. Library code reports to it and never prints.
pub trait Progress: Sync {
    /// A stage of `total` steps begins; it ends the one before.
    fn start(&self, stage: &str, total: u64);
    /// `n` steps of the stage were done before it began here, and say nothing of its rate.
    fn skip(&self, n: u64) {
        self.advance(n);
    }
    /// `n` more steps of the stage are done.
    fn advance(&self, n: u64);
    /// A short text to show beside the bar (loss, file name).
    fn note(&self, text: &str);
    /// A line that stays, such as a row of a table, while the bar goes on below it.
    fn line(&self, _text: &str) {}
    /// The stage is done.
    fn finish(&self);
}

/// A watcher that ignores everything, for tests and library callers.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Progress for Silent {
    fn start(&self, _stage: &str, _total: u64) {}
    fn advance(&self, _n: u64) {}
    fn note(&self, _text: &str) {}
    fn finish(&self) {}
}
