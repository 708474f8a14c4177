//! Hands out tasks until all are done: to worker processes here, or to a cluster.

use std::io;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use serde::Serialize;
use serde::de::DeserializeOwned;

use super::call::{Call, Errand, TaskError};
use super::process::{NotMade, Unheard, Worker};
use super::ray::{self, RayCluster};
use crate::interrupt;

/// How often a task is begun before it is given up: a process may die of what other programs do.
const N_TRIES: usize = 3;

/// Where tasks are done; it does not change what they make.
#[derive(Debug, Clone, PartialEq)]
pub enum Engine {
    /// In so many processes of this machine.
    Local { jobs: usize },
    /// On the nodes of a Ray cluster, a task at a time each.
    Ray(RayCluster),
}

/// Has all tasks done. `on_made` hears of each by its place, in no order: what it made, or why not. A task whose process dies or
/// hangs, or fails by what `call.befalls_all` names after one has ticked or was done, is tried again, with another process. Where `on_made` returns an error, no task is begun any more.
///
/// # Errors
/// The first error of `on_made`; a worker or the cluster cannot be started; the user wants to stop.
pub fn do_all<Job, Task, Made, E>(
    engine: &Engine,
    call: &Call<'_, Job>,
    errands: &[Errand<Task>],
    on_tick: &(dyn Fn() + Sync),
    on_made: &(dyn Fn(usize, Result<Made, TaskError>) -> Result<(), E> + Sync),
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
            let has_begun_well = AtomicBool::new(false);
            let on_tick = || {
                has_begun_well.store(true, Ordering::Relaxed);
                on_tick();
            };
            let failure: Mutex<Option<E>> = Mutex::new(None);
            let work = || -> Result<(), E> {
                let mut worker = None;
                loop {
                    let place = next.fetch_add(1, Ordering::Relaxed);
                    let Some(errand) = errands.get(place) else { return Ok(()) };
                    if failure.lock().expect("no worker thread panics").is_some() {
                        return Ok(());
                    }
                    on_made(place, make(&mut worker, call, &errand.task, &on_tick, &has_begun_well)?)?;
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

/// Does one task with a worker, which is started where there is none, and anew where it is lost.
fn make<Job: Serialize, Task: Serialize, Made: DeserializeOwned>(
    worker: &mut Option<Worker<Made>>,
    call: &Call<'_, Job>,
    task: &Task,
    on_tick: &dyn Fn(),
    has_begun_well: &AtomicBool,
) -> io::Result<Result<Made, TaskError>> {
    let is_passing = |text: &str| {
        has_begun_well.load(Ordering::Relaxed)
            && call.befalls_all.is_some_and(|befalls_all| befalls_all(text))
    };
    let mut n_tries = 0;
    loop {
        interrupt::check()?;
        let started = match worker.take() {
            Some(worker) => Ok(worker),
            None => Worker::start(call)?,
        };
        let lost = match started {
            Err(text) => text,
            Ok(mut able) => match able.make(task, on_tick) {
                Ok(made) => {
                    has_begun_well.store(true, Ordering::Relaxed);
                    *worker = Some(able);
                    return Ok(Ok(made));
                }
                Err(NotMade::Failed(text)) if is_passing(&text) => text,
                Err(NotMade::Failed(text)) => {
                    *worker = Some(able);
                    return Ok(Err(TaskError::Failed(text)));
                }
                Err(NotMade::Unheard(Unheard::Interrupted)) => continue,
                Err(NotMade::Unheard(Unheard::Lost(text))) => text,
            },
        };
        n_tries += 1;
        if n_tries == N_TRIES {
            return Ok(Err(TaskError::Lost(format!("given up after {N_TRIES} tries: {lost}"))));
        }
        tracing::warn!("try {n_tries} of {N_TRIES}: {lost}");
    }
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, Instant};

    use super::super::Program;
    use super::*;

    /// Does the tasks 0, 1 and 2 with a worker that is this script; "no screen" is said to befall all.
    fn run(script: &str, silence: Duration) -> Vec<Result<u32, TaskError>> {
        let folder = tempfile::tempdir().unwrap();
        let program = Program::new("python3".into(), vec!["-c".into(), script.into()]);
        let job = serde_json::json!({ "folder": folder.path() });
        let (command, folder) = ("some-worker", folder.path());
        let call = Call {
            program: &program,
            command,
            job: &job,
            folder,
            shared: Vec::new(),
            n_threads: None,
            silence,
            befalls_all: Some(|text| text.contains("no screen")),
        };
        let made = Mutex::new(vec![None; 3]);
        let errands: Vec<Errand<u32>> = (0..3).map(Errand::from).collect();
        let on_made = |place: usize, answer| -> io::Result<()> {
            made.lock().unwrap()[place] = Some(answer);
            Ok(())
        };
        do_all(&Engine::Local { jobs: 1 }, &call, &errands, &|| (), &on_made).unwrap();
        made.into_inner().unwrap().into_iter().map(Option::unwrap).collect()
    }

    const HEAR: &str = "
import json, os, sys, time
folder = json.loads(sys.stdin.readline())['folder']
for line in sys.stdin:
    task = json.loads(line)
";
    const SAY: &str = "
    print(json.dumps({'done': 10 * task}), flush=True)
";

    #[test]
    fn a_task_whose_process_dies_is_tried_again_and_the_others_are_done() {
        let once = "
    mark = folder + '/died'
    if task == 1 and not os.path.exists(mark):
        open(mark, 'w').close()
        os.kill(os.getpid(), 9)
";
        assert_eq!(run(&format!("{HEAR}{once}{SAY}"), Duration::from_mins(1)), [Ok(0), Ok(10), Ok(20)]);
        let always = "
    if task == 1: sys.exit('no memory for the sky')
";
        let made = run(&format!("{HEAR}{always}{SAY}"), Duration::from_mins(1));
        assert!(made[0] == Ok(0) && made[2] == Ok(20), "{made:?}");
        let Err(TaskError::Lost(text)) = &made[1] else { panic!("{made:?}") };
        assert!(text.contains("3 tries") && text.contains("no memory for the sky"), "{text}");
    }

    #[test]
    fn what_would_befall_all_tasks_is_the_loss_of_a_worker_once_a_task_was_done() {
        let fail = "
    mark = folder + '/failed'
    fails_once = task == 1 and not os.path.exists(mark)
    if fails_once: open(mark, 'w').close()
    if task == 2 or fails_once:
        print(json.dumps({'failed': 'no screen'}), flush=True)
        continue
";
        let made = run(&format!("{HEAR}{fail}{SAY}"), Duration::from_mins(1));
        assert!(made[0] == Ok(0) && made[1] == Ok(10), "{made:?}");
        let Err(TaskError::Lost(text)) = &made[2] else { panic!("{made:?}") };
        assert!(text.contains("3 tries") && text.contains("no screen"), "{text}");
        let at_first = "
    if task == 0:
        print(json.dumps({'failed': 'no screen'}), flush=True)
        continue
";
        let made = run(&format!("{HEAR}{at_first}{SAY}"), Duration::from_mins(1));
        assert_eq!(made, [Err(TaskError::Failed("no screen".to_owned())), Ok(10), Ok(20)]);
        let of_task = "
    if task == 1:
        print(json.dumps({'failed': 'no road'}), flush=True)
        continue
";
        let made = run(&format!("{HEAR}{of_task}{SAY}"), Duration::from_mins(1));
        assert_eq!(made, [Ok(0), Err(TaskError::Failed("no road".to_owned())), Ok(20)]);
    }

    #[test]
    fn a_process_that_hangs_is_ended_and_its_task_given_up() {
        let hang = "
    if task == 0: time.sleep(1000)
";
        let begin = Instant::now();
        let made = run(&format!("{HEAR}{hang}{SAY}"), Duration::from_secs(5));
        assert!(made[1] == Ok(10) && made[2] == Ok(20), "{made:?}");
        assert!(
            matches!(&made[0], Err(TaskError::Lost(text)) if text.contains("said nothing for 5 s")),
            "{made:?}"
        );
        assert!(begin.elapsed() < Duration::from_mins(2));
    }
}
