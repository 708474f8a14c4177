//! `harmzone serve` as others meet it: over the socket, from strangers, from many at once, and in a real browser.
//!
//! The browser's part is `tests/browser/check_serve.py`; where no Chromium is installed it is skipped, and says so.

mod made_data;
mod made_served;

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use fs_err as fs;
use made_data::{command, fails, text};
use serde_json::Value;

/// What the browser's checks end with where there is no browser.
const SKIPPED: i32 = 77;
const N_EPISODES: usize = 1000;

/// A server that runs.
struct Running {
    child: Child,
    port: u16,
    token: String,
    url: String,
}

/// What came back: the status, the headers with the status line, the body.
struct Answer {
    status: u16,
    head: String,
    body: Vec<u8>,
}

impl Running {
    fn start(folder: &Path) -> Self {
        let mut command = command(&["serve", text(folder), "--json"]);
        let mut child =
            command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().expect("the program starts");
        let mut line = String::new();
        let out = child.stdout.take().expect("it is piped");
        BufReader::new(out).read_line(&mut line).expect("it tells its URL");
        let told: Value = serde_json::from_str(&line).unwrap_or_else(|error| panic!("{error}: {line}"));
        let url = told["url"].as_str().expect("a URL").to_owned();
        let token = url.split_once("?token=").expect("a token in the URL").1.to_owned();
        let port = told["port"].as_u64().expect("a port") as u16;
        assert_eq!(url, format!("http://127.0.0.1:{port}/?token={token}"));
        Self { child, port, token, url }
    }

    fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(("127.0.0.1", self.port)).expect("it listens");
        stream.set_read_timeout(Some(Duration::from_mins(1))).expect("a socket");
        stream
    }

    /// Sends bytes as they are; `connection: close` has to be among them.
    fn send(&self, request: &str) -> Answer {
        let mut stream = self.connect();
        stream.write_all(request.as_bytes()).expect("it reads");
        let mut bytes = Vec::new();
        stream.read_to_end(&mut bytes).expect("it answers");
        let at = bytes.windows(4).position(|four| four == b"\r\n\r\n").expect("a whole head");
        let head = String::from_utf8(bytes[..at].to_vec()).expect("a head is text").to_lowercase();
        let status = head.split(' ').nth(1).and_then(|code| code.parse().ok()).expect("a status");
        Answer { status, head, body: bytes[at + 4..].to_vec() }
    }

    fn request(&self, method: &str, path: &str, headers: &str) -> Answer {
        self.send(&format!("{method} {path} HTTP/1.1\r\nconnection: close\r\n{headers}\r\n"))
    }

    fn get(&self, path: &str) -> Answer {
        let host = format!("host: 127.0.0.1:{}\r\n", self.port);
        self.request("GET", &format!("{path}?token={}", self.token), &host)
    }

    fn json(&self, path: &str) -> Value {
        let answer = self.get(path);
        assert_eq!(answer.status, 200, "{path}: {}", String::from_utf8_lossy(&answer.body));
        serde_json::from_slice(&answer.body).expect("JSON")
    }

    /// Asks it to end, as Ctrl-C does, and waits.
    fn stop(mut self) -> ExitStatus {
        let told =
            Command::new("kill").arg("-INT").arg(self.child.id().to_string()).status().expect("kill runs");
        assert!(told.success());
        let begin = Instant::now();
        loop {
            if let Some(status) = self.child.try_wait().expect("a child of ours") {
                return status;
            }
            assert!(begin.elapsed() < Duration::from_secs(30), "it does not end");
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // It has ended where a test stopped it.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Every file below a folder with its content's hash.
fn files_of(folder: &Path) -> Vec<String> {
    let script = "find . -type f -exec sha256sum {} + | sort";
    let output = Command::new("sh").args(["-c", script]).current_dir(folder).output().expect("a shell");
    String::from_utf8(output.stdout).expect("text").lines().map(str::to_owned).collect()
}

#[test]
fn strangers_get_nothing_no_path_leads_out_and_nothing_is_written() {
    let outside = tempfile::tempdir().expect("a temporary folder");
    fs::write(outside.path().join("secret.html"), b"<p>the secret</p>").expect("a writable folder");
    let folder = tempfile::tempdir().expect("a temporary folder");
    made_served::small(folder.path());
    let out =
        |name: &str| std::os::unix::fs::symlink(outside.path().join("secret.html"), folder.path().join(name));
    out("linked.html").expect("a writable folder");
    fs::create_dir(folder.path().join("linked")).expect("a writable folder");
    out("linked/metrics.json").expect("a writable folder");
    let before = files_of(folder.path());
    let server = Running::start(folder.path());
    let (own, with_token) =
        (format!("host: localhost:{}\r\n", server.port), format!("/?token={}", server.token));
    assert_eq!(server.request("GET", &with_token, &own).status, 200);

    for host in ["evil.example", "127.0.0.1", "127.0.0.1:1", "0.0.0.0", "[::1]"] {
        let host = if host.contains(':') { host.to_owned() } else { format!("{host}:{}", server.port + 1) };
        let answer = server.request("GET", &with_token, &format!("host: {host}\r\n"));
        assert_eq!(answer.status, 421, "{host}");
    }
    assert!(matches!(server.request("GET", &with_token, "").status, 400 | 421), "without a host");
    let absolute = format!("http://evil.example/?token={}", server.token);
    assert_eq!(server.request("GET", &absolute, &own).status, 421);
    let wrong = format!("/?token={}", "0".repeat(64));
    for path in ["/", "/api/folder", "/page.js", "/?token=", &wrong, "/absent"] {
        let answer = server.request("GET", path, &own);
        assert_eq!(answer.status, 403, "{path}");
        assert!(!String::from_utf8_lossy(&answer.body).contains("small"), "{path} tells what is there");
    }
    let cookie = format!("{own}cookie: harmzone_{}={}\r\n", server.port, server.token);
    assert_eq!(server.request("GET", "/api/folder", &cookie).status, 200);
    assert_eq!(
        server.request("GET", "/api/folder", &format!("{cookie}sec-fetch-site: same-site\r\n")).status,
        403
    );
    for method in ["POST", "PUT", "DELETE", "PATCH", "OPTIONS", "TRACE"] {
        let answer = server.request(method, &with_token, &format!("{own}content-length: 0\r\n"));
        assert!(
            answer.status == 405 && answer.head.contains("\r\nallow: get, head"),
            "{method}: {}",
            answer.head
        );
    }

    let secret = outside.path().join("secret.html");
    let ups = ["../", "..%2f", "%2e%2e/", "%2e%2e%2f", "%252e%252e%252f", "..%5c", "..%c0%af", "....//"];
    let absolutes =
        [text(&secret).to_owned(), text(&secret).replace('/', "%2f"), format!("%00{}", text(&secret))];
    let bases = ["/", "/reports/", "/api/scores/", "/api/sets/0/episodes/", "/api/sets/"];
    for base in bases {
        let climbs = ups.iter().map(|up| format!("{base}{}{}", up.repeat(12), &text(&secret)[1..]));
        for path in climbs.chain(absolutes.iter().map(|path| format!("{base}{path}"))) {
            let answer = server.get(&path);
            let body = String::from_utf8_lossy(&answer.body).into_owned();
            assert!((400..500).contains(&answer.status), "{path}: {}", answer.status);
            assert!(!body.contains("the secret"), "{path}");
        }
    }
    // Neither is listed, nor read where it is.
    let told = server.json("/api/folder");
    assert_eq!(told["reports"].as_array().map(Vec::len), Some(0), "{told}");
    let answer = server.get("/api/scores/0");
    let body = String::from_utf8_lossy(&answer.body).into_owned();
    assert!(answer.status == 403 && body.contains("leads out of") && !body.contains("the secret"), "{body}");
    assert!(server.stop().success());
    assert_eq!(files_of(folder.path()), before, "nothing is written");
}

#[test]
fn two_hundred_at_once_get_the_same_and_readers_that_go_away_do_no_harm() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let data = made_served::small(folder.path());
    made_served::tear(&made_served::big(folder.path(), 5).join("episodes/episode-0004.mcap"));
    let server = Running::start(folder.path());
    let list = server.json("/api/sets/0/episodes");
    let names: Vec<&str> = list["episodes"]
        .as_array()
        .expect("a list")
        .iter()
        .map(|row| row["name"].as_str().expect("a name"))
        .collect();
    let paths: Vec<String> = (0..200)
        .map(|i| {
            let part = ["", "/image", "/points"][i % 3];
            format!("/api/sets/0/episodes/{}/samples/{}{part}", names[i % 4], (i / 12) % 3)
        })
        .collect();
    // Nothing has been read of these yet.
    let begin = Instant::now();
    let asked: Vec<Answer> = std::thread::scope(|scope| {
        let all: Vec<_> = paths.iter().map(|path| scope.spawn(|| server.get(path))).collect();
        all.into_iter().map(|asked| asked.join().expect("no panic")).collect()
    });
    let took = begin.elapsed();
    let wanted: Vec<Vec<u8>> = paths.iter().map(|path| server.get(path).body).collect();
    for ((answer, path), wanted) in asked.iter().zip(&paths).zip(&wanted) {
        assert!(answer.status == 200 && answer.body == *wanted, "{path}");
    }
    writeln!(std::io::stderr(), "\n200 requests at once: {:.2} s", took.as_secs_f64()).expect("a terminal");

    // Some ask and read a little, some say half a sentence, some go at once.
    let points = format!("/api/sets/0/episodes/{}/samples/0/points?token={}", names[0], server.token);
    let mut held = Vec::new();
    for i in 0..60 {
        let mut stream = server.connect();
        let request = format!("GET {points} HTTP/1.1\r\nhost: 127.0.0.1:{}\r\n\r\n", server.port);
        let part = if i % 3 == 0 { &request[..20] } else { &request };
        stream.write_all(part.as_bytes()).expect("it reads");
        match i % 3 {
            1 => stream.read_exact(&mut [0; 10]).expect("it answers"),
            2 => held.push(stream),
            _ => {}
        }
    }
    assert_eq!(server.get(&paths[0]).body, wanted[0], "it goes on");

    let answer = server.get("/api/sets/0/episodes/episode-0004/samples/0");
    let body = String::from_utf8_lossy(&answer.body).into_owned();
    assert!(answer.status == 422 && body.contains("episode-0004.mcap"), "{body}");
    let detail = server.json("/api/sets/0/episodes/episode-0004");
    assert!(detail["trouble"].as_str().is_some_and(|told| told.contains("episode-0004.mcap")), "{detail}");
    // The data set goes away meanwhile.
    fs::remove_dir_all(&data).expect("a writable folder");
    assert_eq!(server.get("/api/sets/1/episodes/absent/samples/0").status, 404);
    assert_eq!(server.get(&paths[1]).body, wanted[1], "it goes on");

    let begin = Instant::now();
    assert!(server.stop().success(), "Ctrl-C is a good end");
    assert!(begin.elapsed() < Duration::from_secs(10), "readers that hold on do not keep it");
    drop(held);
}

#[test]
fn a_folder_without_data_or_with_a_taken_port_is_refused() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let message = fails(&["serve", text(folder.path())]);
    assert!(message.contains("nothing to show") && message.contains("harmzone gen"), "{message}");
    fs::write(folder.path().join("report.html"), b"<p>a report</p>").expect("a writable folder");
    let server = Running::start(folder.path());
    let message = fails(&["serve", text(folder.path()), "--port", &server.port.to_string()]);
    assert!(message.contains("--port 0"), "{message}");
    let message = fails(&["serve", text(&folder.path().join("absent"))]);
    assert!(message.contains("absent"), "{message}");
    assert!(server.stop().success());
}

#[test]
fn a_thousand_episodes_are_listed_filtered_and_played_in_a_browser() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    made_served::small(folder.path());
    made_served::scores_and_report(folder.path());
    made_served::tear(&made_served::big(folder.path(), N_EPISODES).join("episodes/episode-0007.mcap"));
    let begin = Instant::now();
    let server = Running::start(folder.path());
    let started_s = begin.elapsed().as_secs_f64();
    let mut longest = Duration::ZERO;
    let begin = Instant::now();
    loop {
        let asked = Instant::now();
        let list = server.json("/api/sets/0/episodes");
        longest = longest.max(asked.elapsed());
        assert_eq!(list["episodes"].as_array().map(Vec::len), Some(N_EPISODES));
        if list["n_read"] == N_EPISODES {
            let rows = list["episodes"].as_array().expect("a list");
            assert!(rows.iter().all(|row| row["is_read"] == true));
            let torn: Vec<&Value> = rows.iter().filter(|row| !row["trouble"].is_null()).collect();
            assert!(torn.len() == 1 && torn[0]["name"] == "episode-0007", "{torn:?}");
            break;
        }
        assert!(begin.elapsed() < Duration::from_mins(10), "it reads on");
        std::thread::sleep(Duration::from_millis(100));
    }
    let read_s = begin.elapsed().as_secs_f64();
    let told = format!(
        "{N_EPISODES} episodes: up after {started_s:.2} s, read through in {read_s:.1} s, the list at most {:.0} ms meanwhile",
        1e3 * longest.as_secs_f64()
    );
    writeln!(std::io::stderr(), "\n{told}").expect("a terminal");
    assert!(started_s < 20.0 && longest < Duration::from_secs(3), "{told}");

    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let python = root.join(".venv-test/bin/python");
    assert!(python.is_file(), "no {}: run `make setup-test` first", python.display());
    let mut check = Command::new(&python);
    check.arg(root.join("tests/browser/check_serve.py")).arg(&server.url);
    // To look at what the browser shows.
    check.args(std::env::var_os("HARMZONE_KEEP_PICTURES"));
    let checked = check.output().expect("Python starts");
    let said =
        [checked.stdout, checked.stderr].map(|said| String::from_utf8_lossy(&said).into_owned()).concat();
    if checked.status.code() == Some(SKIPPED) {
        // Not by `eprintln!`, which a passing test does not show.
        writeln!(std::io::stderr(), "\nSKIPPED: the page was not opened in a browser: {said}")
            .expect("a terminal");
        return;
    }
    assert!(checked.status.success() && said.contains("wide and narrow"), "{said}");
    writeln!(std::io::stderr(), "\n{said}").expect("a terminal");
    assert!(server.stop().success());
}
