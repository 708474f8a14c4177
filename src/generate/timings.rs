//! Where the time of an episode goes.

use std::time::{Duration, Instant};

/// Time spent in each part of an episode.
#[derive(Debug, Clone, Copy, Default)]
pub struct Timings {
    pub set_up: Duration,
    pub warm_up: Duration,
    pub motion: Duration,
    /// With the geom of each pixel, and its depth where it is needed.
    pub picture: Duration,
    /// Weather and daytime in the camera's picture.
    pub weather: Duration,
    pub rays: Duration,
    pub packing: Duration,
    pub truth: Duration,
    pub writing: Duration,
    pub finishing: Duration,
}

/// Adds the time that a call takes.
pub(super) fn time<T>(spent: &mut Duration, call: impl FnOnce() -> T) -> T {
    let begin = Instant::now();
    let result = call();
    *spent += begin.elapsed();
    result
}
