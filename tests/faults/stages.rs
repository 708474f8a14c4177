//! The stages that write, each as one command on inputs that are made once.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use fs_err as fs;

use super::folder::{copy, hashes};
use super::made_data::{TINY, command, done, fixture, generation, succeed, text};

/// A command that writes in a folder.
pub struct Stage {
    pub name: &'static str,
    /// Its words, with `OUT` for the folder.
    words: Vec<String>,
    /// What lies in the folder before it begins; empty: there is no folder.
    before: Option<PathBuf>,
    unbroken: OnceLock<Unbroken>,
}

/// What a run that nothing happened to leaves, and how long it took.
pub struct Unbroken {
    pub hashes: BTreeMap<String, String>,
    pub took: Duration,
}

impl Stage {
    fn new(name: &'static str, words: &[&str], before: Option<&Path>) -> Self {
        let words = words.iter().map(|&word| word.to_owned()).collect();
        Self { name, words, before: before.map(Path::to_owned), unbroken: OnceLock::new() }
    }

    /// The command that writes in this folder.
    pub fn command(&self, out: &Path) -> Command {
        let words: Vec<String> = self.words.iter().map(|word| word.replace("OUT", text(out))).collect();
        command(&words.iter().map(String::as_str).collect::<Vec<_>>())
    }

    /// Lets the command end; one that says that it is done already is. Returns what it says otherwise.
    pub fn finish(&self, out: &Path) -> Result<(), String> {
        let output = self.command(out).output().expect("the program starts");
        let told = String::from_utf8_lossy(&output.stderr).into_owned();
        if output.status.success() || told.contains("exist already") { Ok(()) } else { Err(told) }
    }

    /// Makes the folder what it is before the command.
    pub fn prepare(&self, out: &Path) {
        if let Some(before) = &self.before {
            copy(before, out);
        }
    }

    /// What the stage leaves where nothing happens.
    pub fn unbroken(&self) -> &Unbroken {
        self.unbroken.get_or_init(|| {
            let folder = inputs().home.path().join(format!("unbroken-{}", self.name));
            self.prepare(&folder);
            let begin = Instant::now();
            succeed(&mut self.command(&folder));
            Unbroken { hashes: hashes(&folder), took: begin.elapsed() }
        })
    }
}

/// What the stages read.
struct Inputs {
    home: tempfile::TempDir,
    log: PathBuf,
    shards: [PathBuf; 2],
}

fn inputs() -> &'static Inputs {
    static INPUTS: OnceLock<Inputs> = OnceLock::new();
    INPUTS.get_or_init(|| {
        let home = tempfile::tempdir().expect("a temporary folder");
        let path = |name: &str| home.path().join(name);
        let log = path("log");
        let words =
            ["export", "nuscenes", text(&fixture().id), text(&log), "--categories", "source", "--version"];
        done(&[words.as_slice(), &["v1.0-mini"]].concat());
        let shards = [path("a"), path("b")];
        for (shard, out) in ["0/2", "1/2"].into_iter().zip(&shards) {
            done(&generation(out, "1", &["--episodes", "2", "--shard", shard]));
            done(&["label", text(out)]);
        }
        Inputs { home, log, shards }
    })
}

/// All stages, with what each leaves where nothing happens, for all tests here.
pub fn all() -> &'static [Stage] {
    static STAGES: OnceLock<Vec<Stage>> = OnceLock::new();
    STAGES.get_or_init(stages)
}

fn stages() -> Vec<Stage> {
    let (made, Inputs { log, shards, .. }) = (fixture(), inputs());
    let [first, second] = [text(&shards[0]), text(&shards[1])];
    vec![
        Stage::new("gen", &generation(Path::new("OUT"), "2", &["--episodes", "3"]), None),
        Stage::new("label", &["label", "OUT", "--labels", "again"], Some(&made.id)),
        Stage::new("train", &[&["train", text(&made.id), "--out", "OUT"], TINY.as_slice()].concat(), None),
        Stage::new("predict", &["predict", "small", "--data", text(&made.id), "--out", "OUT"], None),
        Stage::new("import", &["import", "nuscenes", text(log), "--out", "OUT"], None),
        Stage::new("merge", &["merge", second, first, "--out", "OUT"], None),
    ]
}

/// The stage of this name.
pub fn named(name: &str) -> &'static Stage {
    all().iter().find(|stage| stage.name == name).expect("a stage of this name")
}

/// Two short drives, the same on every call; beside the others, since it takes longer than they.
pub fn drive() -> &'static Stage {
    static DRIVE: OnceLock<Stage> = OnceLock::new();
    DRIVE.get_or_init(|| {
        let words = "drive blind --episodes 2 --town downtown --set seconds=2.0 --seed 3 --jobs 1 --no-record --out OUT";
        Stage::new("drive", &words.split(' ').collect::<Vec<_>>(), None)
    })
}

/// The scores of the small network; beside the others, since a folder that holds scores is refused.
pub fn eval() -> &'static Stage {
    static EVAL: OnceLock<Stage> = OnceLock::new();
    EVAL.get_or_init(|| {
        Stage::new("eval", &["eval", "small", "--data", text(&fixture().id), "--out", "OUT"], None)
    })
}

/// Forgets what lies in a folder, if it is there.
pub fn clear(out: &Path) {
    if out.exists() {
        fs::remove_dir_all(out).expect("a folder of ours");
    }
}
