//! The whole pipeline on URLs, against a real S3 server (moto's) behind a proxy that breaks requests. Needs what `make setup setup-test`
//! make.

mod made_data;

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Output, Stdio};

use fs_err as fs;
use made_data::{Fixture, TINY, command, done, fixture, generation, text};
use serde_json::Value;

const SECRET: &str = "hush7SecretOfTests";
const TOKEN: &str = "hush7TokenOfTests";

/// The server and the proxy before it; they end with this.
struct Server {
    child: Child,
    to: Option<ChildStdin>,
    from: BufReader<ChildStdout>,
    port: u16,
    /// How long a client waits for an answer.
    timeout: &'static str,
}

impl Server {
    fn start() -> Self {
        Self::serving("faulty_store.py", &[])
    }

    /// One of `tests/python`, which prints its port.
    fn serving(script: &str, args: &[OsString]) -> Self {
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        let python = root.join(".venv-test/bin/python");
        assert!(python.is_file(), "no {}: run `make setup-test` first", python.display());
        let mut child = Command::new(python)
            .arg(root.join("tests/python").join(script))
            .args(args)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("Python starts");
        let to = child.stdin.take();
        let mut from = BufReader::new(child.stdout.take().expect("it is piped"));
        let mut line = String::new();
        from.read_line(&mut line).expect("the server tells its port");
        let port = line.trim().parse().expect("the server starts");
        Self { child, to, from, port, timeout: "2 seconds" }
    }

    fn ask(&mut self, line: &str) -> Value {
        writeln!(self.to.as_mut().expect("it runs"), "{line}").expect("it listens");
        let mut answer = String::new();
        self.from.read_line(&mut answer).expect("it answers");
        serde_json::from_str(&answer).expect("JSON")
    }

    /// The hash of each object below a folder of the bucket.
    fn sums(&mut self, below: &str) -> BTreeMap<String, String> {
        let all: BTreeMap<String, String> = serde_json::from_value(self.ask("sums")).expect("hashes");
        let inside = |(name, sum): (String, String)| Some((name.strip_prefix(below)?.to_owned(), sum));
        all.into_iter().filter_map(inside).collect()
    }

    fn command(&self, args: &[&str], cache: &Path) -> Command {
        let mut command = command(args);
        for (name, _) in std::env::vars_os() {
            if name.to_string_lossy().starts_with("AWS_") {
                command.env_remove(name);
            }
        }
        command.env("HARMZONE_CACHE", cache).env("HARMZONE_LOG", "trace");
        command.env("AWS_ENDPOINT_URL", format!("http://127.0.0.1:{}", self.port));
        command.env("AWS_ALLOW_HTTP", "true").env("AWS_REGION", "us-east-1").env("AWS_TIMEOUT", self.timeout);
        // A proxy of this machine is none of the server on it.
        command.env("NO_PROXY", "127.0.0.1");
        command.env("AWS_ACCESS_KEY_ID", "testing").env("AWS_SECRET_ACCESS_KEY", SECRET);
        command.env("AWS_SESSION_TOKEN", TOKEN);
        command
    }

    fn run(&self, args: &[&str], cache: &Path) -> Output {
        quiet(self.command(args, cache).output().expect("the program starts"))
    }

    fn done(&self, args: &[&str], cache: &Path) -> String {
        let output = self.run(args, cache);
        assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).expect("output is text")
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        // Its input ends, and so does it.
        self.to = None;
        let _ = self.child.wait();
    }
}

/// The output, which names no credential.
fn quiet(output: Output) -> Output {
    for told in [&output.stdout, &output.stderr] {
        let told = String::from_utf8_lossy(told);
        assert!(!told.contains("hush7"), "a credential is told: {told}");
    }
    output
}

/// The hash of each file below a folder.
fn sums_of(folder: &Path) -> BTreeMap<String, String> {
    let mut sums = BTreeMap::new();
    let mut folders: Vec<PathBuf> = vec![folder.to_owned()];
    while let Some(inside) = folders.pop() {
        for entry in fs::read_dir(inside).expect("a folder") {
            let path = entry.expect("a readable folder").path();
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            let sum = harmzone::files::sha256_of(&path).expect("a file");
            let name = path.strip_prefix(folder).expect("it is below");
            sums.insert(text(name).to_owned(), sum);
        }
    }
    sums
}

#[test]
fn gen_label_train_and_eval_on_urls_give_the_hashes_of_local_folders_though_requests_break() {
    let Fixture { id, run, .. } = fixture();
    let folder = tempfile::tempdir().expect("a temporary folder");
    let local_scores = folder.path().join("scores");
    done(&["eval", text(run), "--data", text(id), "--out", text(&local_scores)]);
    let (here, there) = (folder.path().join("here"), folder.path().join("there"));

    let mut server = Server::start();
    server.ask("share 0.08");
    let (data, trained, scores) = ("s3://bucket/sets/id", "s3://bucket/runs/run", "s3://bucket/scores");
    let made = server.done(&generation(Path::new(data), "2", &["--episodes", "2"]), &here);
    assert!(made.starts_with(data), "the URL is told and not a folder of the cache: {made}");
    server.done(&["label", data], &here);
    assert_eq!(server.sums("sets/id/"), sums_of(id));
    // Another machine trains, and its cache holds less than one episode.
    let train = [&["train", data, "--out", trained], TINY.as_slice()].concat();
    let mut command = server.command(&train, &there);
    let output = quiet(command.env("HARMZONE_CACHE_GIB", "0.00001").output().expect("the program starts"));
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    server.done(&["eval", trained, "--data", data, "--out", scores], &there);
    assert!(server.done(&["info", data], &there).contains("episodes"));

    let of_run = server.sums("runs/run/");
    let wanted = sums_of(run);
    for file in ["model.safetensors", "log.csv", "validation.csv", "train.toml", "data.json"] {
        assert_eq!(of_run.get(file), wanted.get(file), "{file} differs");
    }
    assert_eq!(of_run.keys().collect::<Vec<_>>(), wanted.keys().collect::<Vec<_>>(), "no state is left");
    assert_eq!(server.sums("scores/")["metrics.json"], sums_of(&local_scores)["metrics.json"]);

    let partial = server.sums("").into_keys().find(|name| name.contains("partial"));
    assert_eq!(partial, None);
    for word in [SECRET, TOKEN] {
        assert_eq!(server.ask(&format!("grep {word}")), Value::Array(Vec::new()));
    }
    for cache in [&here, &there] {
        for name in sums_of(cache).keys() {
            let bytes = fs::read(cache.join(name)).expect("a file");
            assert!(!bytes.windows(5).any(|word| word == b"hush7"), "a credential lies in {name}");
        }
    }
    let stats = server.ask("stats");
    let broken = stats["broken"].as_object().expect("counts");
    println!("{stats}");
    assert!(broken.len() >= 5, "too few ways to break were tried: {stats}");
}

#[test]
fn what_goes_up_in_parts_arrives_whole_though_requests_break() {
    let Fixture { id, .. } = fixture();
    let cache = tempfile::tempdir().expect("a temporary folder");
    let mut server = Server::start();
    server.ask("share 0.08");
    let data = "s3://bucket/parts/id";
    for args in [generation(Path::new(data), "1", &["--episodes", "2"]), vec!["label", data]] {
        let mut command = server.command(&args, cache.path());
        command.env("HARMZONE_STORE_PARTS_FROM_MIB", "0");
        let output = quiet(command.output().expect("the program starts"));
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    }
    assert_eq!(server.sums("parts/id/"), sums_of(id));
    let stats = server.ask("stats");
    println!("{stats}");
    assert!(stats["in parts"].as_u64() >= Some(sums_of(id).len() as u64), "{stats}");
    assert!(!stats["broken"].as_object().expect("counts").is_empty(), "{stats}");
}

/// `npm install azurite`, then `HARMZONE_TEST_AZURITE=node_modules/.bin/azurite-blob`.
#[test]
fn gen_and_label_on_azure_give_the_hashes_of_a_local_folder() {
    let Some(program) = std::env::var_os("HARMZONE_TEST_AZURITE") else {
        eprintln!("SKIPPED: HARMZONE_TEST_AZURITE does not name Azurite's `azurite-blob`");
        return;
    };
    let Fixture { id, .. } = fixture();
    let folder = tempfile::tempdir().expect("a temporary folder");
    let server = Server::serving("azurite.py", &[program]);
    let run = |args: &[&str], cache: &str, parts_from_mib: &str| {
        let mut command = command(args);
        command.env("HARMZONE_CACHE", folder.path().join(cache)).env("AZURE_STORAGE_USE_EMULATOR", "true");
        command.env("AZURITE_BLOB_STORAGE_URL", format!("http://127.0.0.1:{}", server.port));
        command.env("HARMZONE_STORE_PARTS_FROM_MIB", parts_from_mib).env("NO_PROXY", "127.0.0.1");
        let output = command.output().expect("the program starts");
        assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
    };
    for (name, parts_from_mib) in [("at_once", "64"), ("in_parts", "0")] {
        let data = format!("az://lab/{name}");
        run(&generation(Path::new(&data), "1", &["--episodes", "2"]), "here", parts_from_mib);
        run(&["label", &data], "here", parts_from_mib);
        // Another machine fetches all of it.
        run(&["doctor", &data], name, parts_from_mib);
        let fetched = sums_of(&folder.path().join(name));
        for (file, sum) in sums_of(id) {
            let ending = format!("/{name}/{file}");
            let found = fetched.iter().find(|(path, _)| path.ends_with(&ending));
            assert_eq!(found.map(|(_, sum)| sum), Some(&sum), "{ending} of {:?}", fetched.keys());
        }
    }
}

#[test]
fn gen_with_a_credential_that_expires_says_so_and_goes_on_with_a_new_one() {
    let Fixture { id, .. } = fixture();
    let cache = tempfile::tempdir().expect("a temporary folder");
    let mut server = Server::start();
    // A request that is sent once more because the machine is busy would be counted.
    server.timeout = "60 seconds";
    // The list, gen.toml, dataset.json, the first episode, dataset.json.
    server.ask(&format!("expire 5 {TOKEN}"));
    let args = generation(Path::new("s3://bucket/id"), "1", &["--episodes", "2"]);
    let output = server.run(&args, cache.path());
    let told = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{told}");
    assert!(told.contains("credentials have expired (ExpiredToken"), "{told}");
    assert!(told.contains("AWS_SESSION_TOKEN") && told.contains("the same command again"), "{told}");

    let mut again = server.command(&args, cache.path());
    let output = quiet(again.env("AWS_SESSION_TOKEN", "hush7New").output().expect("the program starts"));
    let told = String::from_utf8_lossy(&output.stdout);
    assert!(
        output.status.success() && told.contains("1 kept"),
        "{told}{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let mut wanted = sums_of(id);
    wanted.retain(|name, _| !name.starts_with("labels/"));
    assert_eq!(server.sums("id/"), wanted);
}

#[test]
fn urls_that_are_not_taken_are_refused_and_no_credential_in_them_is_repeated() {
    let refused = |args: &[&str]| {
        let output = quiet(command(args).output().expect("the program starts"));
        assert_eq!(output.status.code(), Some(2), "{args:?}");
        String::from_utf8(output.stderr).expect("messages are text")
    };
    let told = refused(&["drive", "--out", "s3://bucket/x", "--episodes", "1"]);
    assert!(told.contains("a path of this machine is needed here") && told.contains("gen --out"), "{told}");
    let told = refused(&["label", "s3://id:hush7@bucket/x"]);
    assert!(told.contains("AWS_ACCESS_KEY_ID") && told.contains("s3://bucket/x"), "{told}");
    assert!(refused(&["label", "ftp://host/x"]).contains("s3://BUCKET/PATH"));
}
