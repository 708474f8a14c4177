//! A folder's episodes, scores and reports as a page of this machine: read-only, on the loopback alone, behind a token.

mod access;
mod facts;
mod folder;
mod frames;
mod routes;
mod scores;
mod sets;
mod shelf;
mod site;
mod source;
#[cfg(test)]
mod tests;

use std::io;
use std::net::{Ipv4Addr, TcpListener};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use thiserror::Error;
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::watch;

use crate::dataset::DatasetError;
use crate::episode::{EpisodeError, ManifestError};
use crate::eval::ScoreError;
use crate::progress::Progress;
use crate::report::scores::ScoresError;
use access::{AccessToken, Gate};
use folder::ServedFolder;
use site::{ServedSite, WantedSets};

pub use sets::SetOptions;

/// How long answers that are under way may take after the server was told to stop.
const GRACE: Duration = Duration::from_secs(2);

/// Why something cannot be served or shown.
#[derive(Debug, Error)]
pub enum ServeError {
    #[error("a folder with data sets, scores or reports is needed, and {found} here: {}", path.display())]
    NoFolder { found: &'static str, path: PathBuf },
    #[error(
        "nothing to show: no data set (`harmzone gen --out DIR`), no scores (`harmzone eval --out DIR`) and no page of \
         `harmzone report` lies here or below: {}",
        path.display()
    )]
    Nothing { path: PathBuf },
    #[error("it leads out of {}: {}", folder.display(), path.display())]
    Outside { folder: PathBuf, path: PathBuf },
    #[error("cannot listen on 127.0.0.1:{port}, {source}; `--port 0` takes a free port")]
    Listen { port: u16, source: io::Error },
    #[error("the system gives no randomness for a token: {source}")]
    NoRandomness { source: getrandom::Error },
    #[error("there is no {what}")]
    NotThere { what: String },
    #[error("{message}")]
    Trouble { message: String },
    #[error(transparent)]
    Manifest(#[from] ManifestError),
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    #[error(transparent)]
    Episode(#[from] EpisodeError),
    #[error(transparent)]
    Score(#[from] ScoreError),
    #[error(transparent)]
    Scores(#[from] ScoresError),
    #[error(transparent)]
    Io(#[from] io::Error),
}

/// A server that listens, and answers once it runs.
#[derive(Debug)]
pub struct Server {
    site: Arc<ServedSite>,
    wanted: WantedSets,
    gate: Gate,
    listener: TcpListener,
}

impl Server {
    /// Looks through a folder and listens on a port of the loopback; 0 takes a free one.
    ///
    /// # Errors
    /// [`ServeError`]: no such folder, nothing in it to show, or the port is taken.
    pub fn open(folder: &Path, port: u16, options: &SetOptions) -> Result<Self, ServeError> {
        let (site, wanted) = ServedSite::open(ServedFolder::open(folder)?, options)?;
        let listen = |source| ServeError::Listen { port, source };
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port)).map_err(listen)?;
        listener.set_nonblocking(true).map_err(listen)?;
        let gate = Gate { token: AccessToken::draw()?, port: listener.local_addr().map_err(listen)?.port() };
        Ok(Self { site, wanted, gate, listener })
    }

    /// What to open in a browser, with the token.
    #[must_use]
    pub fn url(&self) -> String {
        self.gate.url()
    }

    /// The port that it listens on.
    #[must_use]
    pub fn port(&self) -> u16 {
        self.gate.port
    }

    /// The folder, by its real path.
    #[must_use]
    pub fn folder(&self) -> &Path {
        self.site.folder.path()
    }

    /// How many data sets and their episodes there are; one with boxes of two detectors counts twice.
    #[must_use]
    pub fn n_episodes(&self) -> usize {
        self.site.sets.iter().map(|set| set.entries.len()).sum()
    }

    /// Answers until the process is told to stop (SIGINT or SIGTERM); answers under way get two seconds.
    ///
    /// # Errors
    /// The system refuses threads, sockets or signals.
    pub fn run(self, progress: &dyn Progress) -> Result<(), ServeError> {
        let Self { site, wanted, gate, listener } = self;
        let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
        std::thread::scope(|scope| {
            scope.spawn(|| site.read_through(wanted, progress));
            let done = runtime.block_on(async {
                let listener = tokio::net::TcpListener::from_std(listener)?;
                let (stop, stopped) = watch::channel(false);
                let (mut interrupt, mut terminate) =
                    (signal(SignalKind::interrupt())?, signal(SignalKind::terminate())?);
                let serving = axum::serve(listener, routes::router(site.clone(), gate));
                let serving = tokio::spawn(serving.with_graceful_shutdown(wait_for(stopped)).into_future());
                tokio::select! {
                    _ = interrupt.recv() => {}
                    _ = terminate.recv() => {}
                }
                stop.send_replace(true);
                // A reader that takes no more does not keep the server.
                let _ = tokio::time::timeout(GRACE, serving).await;
                Ok(())
            });
            site.stop();
            runtime.shutdown_timeout(GRACE);
            done
        })
    }
}

async fn wait_for(mut stopped: watch::Receiver<bool>) {
    // An error: nobody can tell any more, which is the end too.
    let _ = stopped.wait_for(|&is_stopped| is_stopped).await;
}
