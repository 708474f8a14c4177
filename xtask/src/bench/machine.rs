//! The machine that a bench ran on, as Linux tells it.

use std::fmt;
use std::process::Command;

use fs_err as fs;
use serde::Serialize;

/// What times depend on.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Machine {
    /// `None` where the system does not tell.
    pub cpu: Option<String>,
    pub n_cores: usize,
    pub memory_gib: Option<f64>,
    /// Cards that NVIDIA's driver knows.
    pub gpus: Vec<String>,
    /// Processes that wanted to run, over the last minute before the bench.
    pub load: Option<f64>,
}

impl Machine {
    pub fn here() -> Self {
        let read = |path: &str| fs::read_to_string(path).ok();
        Self {
            cpu: read("/proc/cpuinfo").and_then(|text| field(&text, "model name").map(str::to_owned)),
            n_cores: std::thread::available_parallelism().map_or(1, usize::from),
            memory_gib: read("/proc/meminfo").and_then(|text| {
                let kib: f64 = field(&text, "MemTotal")?.trim_end_matches("kB").trim().parse().ok()?;
                Some(kib / f64::from(1 << 20))
            }),
            gpus: gpus(),
            load: read("/proc/loadavg").and_then(|text| text.split(' ').next()?.parse().ok()),
        }
    }
}

/// The first value of a name in lines of `name : value`.
fn field<'a>(text: &'a str, name: &str) -> Option<&'a str> {
    let of_line = |line: &'a str| line.split_once(':').filter(|(found, _)| found.trim() == name);
    text.lines().find_map(of_line).map(|(_, value)| value.trim())
}

fn gpus() -> Vec<String> {
    let ask = Command::new("nvidia-smi").args(["--query-gpu=name", "--format=csv,noheader"]).output();
    let told = ask.ok().filter(|output| output.status.success()).map(|output| output.stdout);
    let told = told.map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).unwrap_or_default();
    told.lines().map(str::trim).filter(|line| !line.is_empty()).map(str::to_owned).collect()
}

impl fmt::Display for Machine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let cpu = self.cpu.as_deref().unwrap_or("unknown CPU");
        write!(f, "{cpu}, {} cores", self.n_cores)?;
        if let Some(gib) = self.memory_gib {
            write!(f, ", {gib:.0} GiB")?;
        }
        let gpus = if self.gpus.is_empty() { "no GPU".to_owned() } else { self.gpus.join(", ") };
        write!(f, ", {gpus}")?;
        match self.load {
            Some(load) if load > 0.5 => {
                write!(f, "\nnot quiet: {load:.1} processes were running before the bench")
            }
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_field_is_found_by_its_whole_name() {
        let text = "model\t\t: 1\nmodel name\t: A CPU @ 2: fast\n";
        assert_eq!(field(text, "model name"), Some("A CPU @ 2: fast"));
        assert_eq!(field(text, "name"), None);
    }

    #[test]
    fn this_machine_has_a_name_and_memory() {
        let machine = Machine::here();
        assert!(machine.n_cores >= 1 && machine.memory_gib.is_none_or(|gib| gib > 0.1));
        assert!(machine.to_string().contains(" cores"), "{machine}");
    }
}
