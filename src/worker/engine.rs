//! Hands out tasks until all are done: to worker processes here, or to a cluster.

use std::io;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use serde::Serialize;
use serde::de::DeserializeOwned;

use super::call::{Call, Errand};
use super::process::Worker;
use super::ray::{self, RayCluster};

/// Where tasks are done; it does not change what they make.
#[derive(Debug, Clone, PartialEq)]
pub enum Engine {
    /// In so many processes of this machine.
    Local { jobs: usize },
    /// On the nodes of a Ray cluster, a task at a time each.
    Ray(RayCluster),
}

/// Has all tasks done. `on_made` hears of each by its place, in no order: what it made, or the text of its failure. Where it
/// returns an error, no task is begun any more.
///
/// # Errors
/// The first error of `on_made`; a worker or the cluster cannot be started.
pub fn do_all<Job, Task, Made, E>(
    engine: &Engine,
    call: &Call<'_, Job>,
    errands: &[Errand<Task>],
    on_tick: &(dyn Fn() + Sync),
    on_made: &(dyn Fn(usize, Result<Made, String>) -> Result<(), E> + Sync),
) -> Result<(), E>
where
    Job: Serialize + Sync,
    Task: Serialize + Sync,
    Made: DeserializeOwned,
    E: From<io::Error> + Send,
{
    match engine {
        _ if errands.is_empty() => Ok(()),
        Engine::Ray(cluster) => ray::do_all(cluster, call, errands, on_tick, on_made),
        Engine::Local { jobs } => {
            let next = AtomicUsize::new(0);
            let failure: Mutex<Option<E>> = Mutex::new(None);
            let work = || -> Result<(), E> {
                let mut worker = None;
                loop {
                    let place = next.fetch_add(1, Ordering::Relaxed);
                    let Some(errand) = errands.get(place) else { return Ok(()) };
                    if failure.lock().expect("no worker thread panics").is_some() {
                        return Ok(());
                    }
                    let worker = match &mut worker {
                        Some(worker) => worker,
                        none => {
                            none.insert(Worker::start(call.program, call.command, call.job, call.n_threads)?)
                        }
                    };
                    on_made(place, worker.make(&errand.task, on_tick))?;
                }
            };
            std::thread::scope(|scope| {
                for _ in 0..(*jobs).clamp(1, errands.len()) {
                    scope.spawn(|| {
                        if let Err(error) = work() {
                            failure.lock().expect("no worker thread panics").get_or_insert(error);
                        }
                    });
                }
            });
            failure.into_inner().expect("no worker thread panics").map_or(Ok(()), Err)
        }
    }
}
