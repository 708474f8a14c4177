//! Resident memory of this process's children, as Linux's `/proc` tells it; nothing elsewhere.

use std::sync::{Mutex, PoisonError};

use fs_err as fs;

use harmzone::progress::Progress;

/// Looks at the children's memory whenever a sample is done, and passes everything on.
pub(super) struct MemoryWatch<'a> {
    pub inner: &'a dyn Progress,
    /// Of the largest child, after each sample.
    found_bytes: Mutex<Vec<u64>>,
}

impl<'a> MemoryWatch<'a> {
    pub(super) fn new(inner: &'a dyn Progress) -> Self {
        Self { inner, found_bytes: Mutex::default() }
    }

    /// The memory after each sample, in the order in which they were done.
    pub(super) fn into_bytes(self) -> Vec<u64> {
        self.found_bytes.into_inner().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Progress for MemoryWatch<'_> {
    fn start(&self, stage: &str, total: u64) {
        self.inner.start(stage, total);
    }

    fn advance(&self, n: u64) {
        if let Some(bytes) = largest_child_bytes() {
            self.found_bytes.lock().unwrap_or_else(PoisonError::into_inner).push(bytes);
        }
        self.inner.advance(n);
    }

    fn note(&self, text: &str) {
        self.inner.note(text);
    }

    fn finish(&self) {
        self.inner.finish();
    }
}

fn largest_child_bytes() -> Option<u64> {
    let tasks = fs::read_dir("/proc/self/task").ok()?;
    let children = tasks.filter_map(|task| fs::read_to_string(task.ok()?.path().join("children")).ok());
    let ids: Vec<u32> = children
        .flat_map(|text| text.split_whitespace().filter_map(|id| id.parse().ok()).collect::<Vec<_>>())
        .collect();
    ids.into_iter().filter_map(resident_bytes).max()
}

fn resident_bytes(process: u32) -> Option<u64> {
    let status = fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    let kibibytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kibibytes * 1024)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::{Read, Write};
    use std::process::{Command, Stdio};

    #[test]
    fn a_child_has_memory_and_a_process_that_is_not_there_has_none() {
        let mut child = Command::new("cat").stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
        // What it gives back shows that it is running, and no longer a copy of this process.
        child.stdin.as_mut().unwrap().write_all(b"x").unwrap();
        child.stdout.as_mut().unwrap().read_exact(&mut [0]).unwrap();
        assert!(resident_bytes(child.id()).unwrap() > 100_000);
        // The kernel may leave children out of a list that it tells while others end, such as those of other tests.
        let largest = (0..1000).find_map(|_| largest_child_bytes());
        assert!(largest.unwrap() > 100_000);
        child.kill().unwrap();
        child.wait().unwrap();
        assert_eq!(resident_bytes(u32::MAX), None);
    }
}
