//! Tasks on a Ray cluster, through `harmzone.ray` of the wheel: a process that speaks lines of JSON and knows Ray.
//!
//! It hears one [`Header`] and then [`Numbered`] tasks; it says how many tasks it takes at a time, which may change as nodes
//! come and go, and answers each task as a worker does. Files that a node has made are checked, written below the folder and
//! whole before the answer. A closed pipe ends it, and what it has begun is cancelled.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::call::{Call, Errand, TaskError};
use super::process::{Process, THREADS, Unheard};
use super::watchdog::SILENCE_VARIABLE;
use super::{ALLOCATOR_ENVIRONMENT, Answer, Program};

/// The word that starts the process.
const COMMAND: &str = "ray-engine";

/// Cancelling and leaving a cluster takes its time.
const PATIENCE: Duration = Duration::from_secs(15);

/// A Ray cluster, and what of it a task takes.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RayCluster {
    /// `HOST:PORT`, `auto` or `ray://..`; `None`: what `RAY_ADDRESS` says, else a cluster of this machine alone.
    pub address: Option<String>,
    /// Cores that Ray sets aside for a task.
    pub task_cpus: f64,
    /// Share of a GPU, for rendering.
    pub task_gpus: f64,
    /// Tasks that are given away at a time; `None`: somewhat more than the cluster does at once.
    pub most_in_flight: Option<usize>,
}

/// The first line.
#[derive(Serialize)]
struct Header<'a, Job> {
    version: &'static str,
    command: &'static str,
    job: &'a Job,
    folder: &'a Path,
    shared: &'a [(PathBuf, PathBuf)],
    /// Of the processes that serve the tasks.
    environment: BTreeMap<&'static str, String>,
    cluster: &'a RayCluster,
}

/// A task with its place, which its answers name.
#[derive(Serialize)]
struct Numbered<'a, Task> {
    place: usize,
    task: &'a Task,
    reads: &'a [PathBuf],
}

/// What the process says.
#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
enum Said<Made> {
    /// So many tasks may be under way.
    Takes(usize),
    /// What a user should know, such as a lost node.
    Told(String),
    Answer {
        place: usize,
        answer: Answer<Made>,
    },
    /// No node did the task, however often it was tried; how the last one was lost.
    Lost {
        place: usize,
        text: String,
    },
}

/// As [`super::do_all`].
pub(super) fn do_all<Job, Task, Made, E>(
    cluster: &RayCluster,
    call: &Call<'_, Job>,
    errands: &[Errand<Task>],
    on_tick: &dyn Fn(),
    on_made: &dyn Fn(usize, Result<Made, TaskError>) -> Result<(), E>,
) -> Result<(), E>
where
    Job: Serialize,
    Task: Serialize,
    Made: DeserializeOwned,
    E: From<io::Error>,
{
    let other = |text: String| E::from(io::Error::other(text));
    let mut process = start(call.program)?;
    let (version, shared) = (env!("CARGO_PKG_VERSION"), call.shared.as_slice());
    let Call { command, job, folder, .. } = *call;
    // A task's share of a node's cores.
    let n_threads = cluster.task_cpus.floor().max(1.0).to_string();
    let environment = ALLOCATOR_ENVIRONMENT.map(|(name, value)| (name, value.to_owned()));
    let silence_s = call.silence.as_secs().max(1).to_string();
    let more = [(THREADS, n_threads), (SILENCE_VARIABLE, silence_s)];
    let environment = environment.into_iter().chain(more).collect();
    process.say(&Header { version, command, job, folder, shared, environment, cluster }).map_err(other)?;
    let (mut n_given, mut n_made, mut takes) = (0, 0, 0);
    while n_made < errands.len() {
        while n_given < errands.len() && n_given - n_made < takes {
            let Errand { task, reads } = &errands[n_given];
            process.say(&Numbered { place: n_given, task, reads }).map_err(other)?;
            n_given += 1;
        }
        let said = process.hear::<Said<Made>>(Duration::MAX).map_err(|unheard| match unheard {
            Unheard::Lost(text) => other(text),
            Unheard::Interrupted => other("interrupted".to_owned()),
        })?;
        match said {
            Said::Takes(n) => takes = n.max(1),
            Said::Told(text) => tracing::warn!("{text}"),
            Said::Lost { place, text } => {
                n_made += 1;
                on_made(place, Err(TaskError::Lost(text)))?;
            }
            Said::Answer { place, answer } => {
                let made = match answer {
                    Answer::Tick => {
                        on_tick();
                        continue;
                    }
                    Answer::Done(made) => Ok(*made),
                    Answer::Failed(message) => Err(TaskError::Failed(message)),
                };
                n_made += 1;
                on_made(place, made)?;
            }
        }
    }
    Ok(())
}

fn start(program: &Program) -> io::Result<Process> {
    Process::start(program, COMMAND, [], "Ray engine", PATIENCE)
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;

    use super::super::SILENCE;
    use super::*;

    type Answers = Vec<(usize, Result<u32, TaskError>)>;

    /// Runs 5 tasks, of which each is a number, on a process that is this script; also counts the ticks.
    fn run(script: &str) -> (Result<(), io::Error>, Answers, usize) {
        let program = Program::new("python3".into(), vec!["-c".into(), script.into()]);
        let folder = std::env::temp_dir();
        let call = Call {
            program: &program,
            command: "some-worker",
            job: &serde_json::json!({ "folder": folder }),
            folder: &folder,
            shared: Vec::new(),
            n_threads: None,
            silence: SILENCE,
            befalls_all: None,
        };
        let cluster = RayCluster { address: None, task_cpus: 1.0, task_gpus: 0.0, most_in_flight: None };
        let (made, n_ticks) = (RefCell::new(Vec::new()), RefCell::new(0));
        let errands: Vec<Errand<u32>> = (0..5).map(Errand::from).collect();
        let done = do_all(&cluster, &call, &errands, &|| *n_ticks.borrow_mut() += 1, &|place, answer| {
            made.borrow_mut().push((place, answer));
            Ok(())
        });
        (done, made.into_inner(), n_ticks.into_inner())
    }

    const SAY: &str = "
import json, sys
def say(what): print(json.dumps(what), flush=True)
def answer(task, what): say({'answer': {'place': task['place'], 'answer': what}})
header = json.loads(sys.stdin.readline())
assert header['command'] == 'some-worker' and sys.argv[1] == 'ray-engine', header
assert header['environment']['HARMZONE_WORKER_SILENCE_S'] == '600', header
";

    #[test]
    fn no_more_tasks_are_under_way_than_it_takes_and_the_order_of_answers_is_free() {
        let (done, mut made, n_ticks) = run(&format!(
            "{SAY}
say({{'takes': 2}})
while True:
    two = [json.loads(line) for line in (sys.stdin.readline(), sys.stdin.readline()) if line]
    if not two: break
    print('a library talks')
    for task in reversed(two):
        answer(task, 'tick')
        answer(task, {{'done': 10 * task['task']}} if task['place'] else {{'failed': 'no road'}})
    say({{'takes': 1}}) if two[0]['place'] == 2 else None
    if two[0]['place'] == 2:
        place = json.loads(sys.stdin.readline())['place']
        say({{'lost': {{'place': place, 'text': 'all nodes died'}}}})
        break
"
        ));
        done.unwrap();
        assert_eq!(made.iter().map(|(place, _)| *place).collect::<Vec<_>>(), [1, 0, 3, 2, 4]);
        made.sort_by_key(|(place, _)| *place);
        assert_eq!(made[0].1, Err(TaskError::Failed("no road".to_owned())));
        assert_eq!(made[3].1, Ok(30));
        assert_eq!(made[4].1, Err(TaskError::Lost("all nodes died".to_owned())));
        assert_eq!(n_ticks, 4);
    }

    #[test]
    fn a_process_that_dies_is_told_with_its_last_words() {
        let (done, made, _) = run(&format!(
            "{SAY}
say({{'takes': 5}})
answer(json.loads(sys.stdin.readline()), {{'done': 1}})
sys.exit('no cluster at 10.0.0.1:6379')
"
        ));
        let told = done.unwrap_err().to_string();
        assert!(told.contains("Ray engine") && told.contains("10.0.0.1:6379"), "{told}");
        assert!(made.len() <= 1);
    }
}
