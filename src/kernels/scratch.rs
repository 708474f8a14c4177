//! Aligned working memory that each thread keeps from call to call.

use std::cell::RefCell;

const LINE_FLOATS: usize = 16;

/// One cache line; the unit of allocation, so that buffers start on a line.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct Line([f32; LINE_FLOATS]);

/// A buffer that only grows. Between calls its contents are stale, never uninitialised.
#[derive(Default)]
pub(super) struct Buffer(Vec<Line>);

impl Buffer {
    /// The first `n_floats` floats, with stale contents.
    pub fn get(&mut self, n_floats: usize) -> &mut [f32] {
        let n_lines = n_floats.div_ceil(LINE_FLOATS);
        if self.0.len() < n_lines {
            self.0.resize(n_lines, Line([0.0; LINE_FLOATS]));
        }
        // SAFETY: a `Line` is 16 floats and nothing else (64 bytes, aligned to 64), so the vector holds at
        // least `16 * n_lines >= n_floats` initialised floats; they stay borrowed through `self`.
        unsafe { std::slice::from_raw_parts_mut(self.0.as_mut_ptr().cast::<f32>(), n_floats) }
    }

    /// As [`Self::get`], in words of 32 bits.
    pub fn words(&mut self, n_words: usize) -> &mut [u32] {
        let floats = self.get(n_words);
        // SAFETY: a float and a word have one size and alignment, and every bit pattern is valid for both.
        unsafe { std::slice::from_raw_parts_mut(floats.as_mut_ptr().cast(), floats.len()) }
    }

    /// As [`Self::get`], in words of 16 bits.
    pub fn half_words(&mut self, n_words: usize) -> &mut [u16] {
        let floats = self.get(n_words.div_ceil(2));
        // SAFETY: a float holds two half words, which need less alignment; every bit pattern is valid for both.
        unsafe { std::slice::from_raw_parts_mut(floats.as_mut_ptr().cast(), n_words) }
    }
}

/// The buffers of a thread.
#[derive(Default)]
pub(super) struct Scratch {
    pub a: Buffer,
    pub b: Buffer,
    pub c: Buffer,
}

thread_local! {
    static SCRATCH: RefCell<Scratch> = RefCell::default();
}

/// Lends this thread's buffers to `work`, which must not ask for them again or wait for other tasks.
pub(super) fn with_scratch<R>(work: impl FnOnce(&mut Scratch) -> R) -> R {
    SCRATCH.with_borrow_mut(work)
}
