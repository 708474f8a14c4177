//! The flags of worker processes: where the work is done, and how long one may say nothing.

use std::time::Duration;

use anyhow::bail;
use clap::Args;

use super::{number, one_of};
use crate::worker::{Engine, Program, RayCluster, SILENCE};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum EngineName {
    Local,
    Ray,
}

impl EngineName {
    const ALL: [Self; 2] = [Self::Local, Self::Ray];

    fn name(self) -> &'static str {
        match self {
            Self::Local => "local",
            Self::Ray => "ray",
        }
    }
}

#[derive(Debug, Args)]
pub struct WorkerTimeoutArg {
    /// End a worker process that has said nothing for so many seconds, and try its episode again [default: 600]
    #[arg(long, value_name = "SECONDS", value_parser = number(1..=u32::MAX))]
    worker_timeout: Option<u32>,
}

impl WorkerTimeoutArg {
    /// How long a worker may say nothing.
    pub fn silence(&self) -> Duration {
        self.worker_timeout.map_or(SILENCE, |seconds| Duration::from_secs(seconds.into()))
    }
}

#[derive(Debug, Args)]
pub struct EngineArgs {
    #[command(flatten)]
    timeout: WorkerTimeoutArg,
    /// What does the work: this machine, or a Ray cluster, a task an episode (needs the wheel with Ray, docs/scaling.md)
    #[arg(long, value_parser = one_of(EngineName::ALL, EngineName::name), default_value = "local")]
    engine: EngineName,
    /// With --engine ray: the cluster [default: what RAY_ADDRESS says, else this machine alone]
    #[arg(long, value_name = "HOST:PORT")]
    address: Option<String>,
    /// With --engine ray: cores that are set aside for a task [default: 1]
    #[arg(long, value_name = "N", value_parser = number(0.01..=1024.0))]
    task_cpus: Option<f64>,
    /// With --engine ray: share of a GPU that is set aside for a task, such as 0.25 to render on it [default: 0]
    #[arg(long, value_name = "N", value_parser = number(0.0..=64.0))]
    task_gpus: Option<f64>,
    /// With --engine ray: tasks under way at most, begun or waiting [default: somewhat more than the cluster does at once]
    #[arg(long, value_name = "N", value_parser = number(1..=usize::MAX))]
    in_flight: Option<usize>,
}

impl EngineArgs {
    /// How long a worker may say nothing.
    pub fn silence(&self) -> Duration {
        self.timeout.silence()
    }

    /// As [`Self::cluster`], for a command that does its work itself where there is none.
    ///
    /// # Errors
    /// As [`Self::cluster`]; a time for worker processes that there are not.
    pub fn cluster_alone(&self) -> anyhow::Result<Option<Engine>> {
        let cluster = self.cluster()?;
        if cluster.is_none() && self.timeout.worker_timeout.is_some() {
            bail!(
                "--worker-timeout is for worker processes, which this command has on a Ray cluster alone: give --engine ray, too"
            );
        }
        Ok(cluster)
    }

    /// The cluster, if the work is not done here.
    ///
    /// # Errors
    /// A flag needs another; this program is not the wheel's.
    pub fn cluster(&self) -> anyhow::Result<Option<Engine>> {
        let of_ray = [
            ("--address", self.address.is_some()),
            ("--task-cpus", self.task_cpus.is_some()),
            ("--task-gpus", self.task_gpus.is_some()),
            ("--in-flight", self.in_flight.is_some()),
        ];
        if self.engine == EngineName::Local {
            return match of_ray.into_iter().find(|(_, is_given)| *is_given) {
                Some((flag, _)) => bail!("{flag} is for a Ray cluster: give --engine ray, too"),
                None => Ok(None),
            };
        }
        if !Program::is_in_python() {
            bail!(
                "--engine ray runs from harmzone's wheel, on every node the same one: `make wheel`, then \
                 `pip install 'harmzone-VERSION.whl[ray]'` and the `harmzone` that it installs; found a program that is \
                 not in a Python environment"
            );
        }
        Ok(Some(Engine::Ray(RayCluster {
            address: self.address.clone(),
            task_cpus: self.task_cpus.unwrap_or(1.0),
            task_gpus: self.task_gpus.unwrap_or(0.0),
            most_in_flight: self.in_flight,
        })))
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Debug, Parser)]
    struct Flags {
        #[command(flatten)]
        engine: EngineArgs,
    }

    fn flags(words: &[&str]) -> EngineArgs {
        Flags::try_parse_from([&["program"], words].concat()).unwrap().engine
    }

    #[test]
    fn a_time_for_workers_needs_workers_and_is_what_the_help_says_by_default() {
        assert_eq!(flags(&[]).silence(), Duration::from_mins(10), "as in the help");
        let given = flags(&["--worker-timeout", "30"]);
        assert_eq!(given.silence(), Duration::from_secs(30));
        assert!(given.cluster().unwrap().is_none() && flags(&[]).cluster_alone().unwrap().is_none());
        let told = given.cluster_alone().unwrap_err().to_string();
        assert!(told.contains("--engine ray"), "{told}");
    }
}
