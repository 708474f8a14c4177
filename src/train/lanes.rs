//! The devices that compute the batches of a step side by side.
//!
//! The first one works on the calling thread, each other one on a thread of its own that lives as long as the run: a GPU has a
//! queue and a memory pool for each thread.

use burn::tensor::Device;
use rayon::{ThreadPool, ThreadPoolBuilder};

/// Devices with their threads.
#[derive(Debug)]
pub struct Lanes {
    /// With autodiff; at least one.
    devices: Vec<Device>,
    /// Of the devices after the first.
    threads: Vec<ThreadPool>,
}

impl Lanes {
    /// # Panics
    /// There is no device, or the system gives no thread.
    pub fn new(devices: &[Device]) -> Self {
        assert!(!devices.is_empty(), "a run has a device");
        let devices: Vec<Device> = devices.iter().map(|device| device.clone().autodiff()).collect();
        let start = |_| ThreadPoolBuilder::new().num_threads(1).build().expect("the system gives a thread");
        let threads = (1..devices.len()).map(start).collect();
        Self { devices, threads }
    }

    /// The devices, with autodiff.
    pub fn devices(&self) -> &[Device] {
        &self.devices
    }

    /// Does one piece of work on each device, all at the same time; the results are in the order of the devices.
    ///
    /// # Arguments
    /// - `loads`: one for each device
    pub fn work<L: Send, R: Send>(&self, loads: Vec<L>, work: impl Fn(&Device, L) -> R + Sync) -> Vec<R> {
        assert_eq!(loads.len(), self.devices.len(), "a load for each device");
        let work = &work;
        let mut results: Vec<Option<R>> = loads.iter().map(|_| None).collect();
        let mut pieces = self.devices.iter().zip(loads).zip(&mut results);
        let ((device, load), result) = pieces.next().expect("a run has a device");
        let own = || *result = Some(work(device, load));
        let others = self.threads.iter().zip(pieces).map(|(thread, ((device, load), result))| Other {
            thread,
            piece: Box::new(move || *result = Some(work(device, load))),
        });
        spread(others.collect(), own);
        results.into_iter().map(|result| result.expect("each device has worked")).collect()
    }
}

/// The work of one of the other devices.
struct Other<'a> {
    thread: &'a ThreadPool,
    piece: Box<dyn FnOnce() + Send + 'a>,
}

/// Starts the others' work, then does `own`, and waits for all.
fn spread(mut others: Vec<Other<'_>>, own: impl FnOnce()) {
    fn start(others: &mut Vec<Other<'_>>, own: Box<dyn FnOnce() + '_>) {
        match others.pop() {
            None => own(),
            Some(Other { thread, piece }) => thread.in_place_scope(|scope| {
                scope.spawn(|_| piece());
                start(others, own);
            }),
        }
    }
    start(&mut others, Box::new(own));
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Barrier;

    #[test]
    fn devices_work_at_the_same_time_and_their_results_are_in_order() {
        let lanes = Lanes::new(&[Device::flex(), Device::flex(), Device::flex()]);
        let all_there = Barrier::new(3);
        let here = std::thread::current().id();
        for round in 0..3 {
            let found = lanes.work(vec![10, 20, 30], |device, load| {
                all_there.wait();
                assert!(device.is_autodiff());
                (load + round, std::thread::current().id())
            });
            let numbers: Vec<i32> = found.iter().map(|of| of.0).collect();
            assert_eq!(numbers, [10 + round, 20 + round, 30 + round]);
            assert!(found[0].1 == here && found[1].1 != here && found[1].1 != found[2].1);
        }
    }

    #[test]
    #[should_panic(expected = "the second fails")]
    fn a_panic_on_another_device_is_one_of_the_run() {
        Lanes::new(&[Device::flex(), Device::flex()])
            .work(vec![1, 2], |_, load| assert!(load < 2, "the second fails"));
    }
}
