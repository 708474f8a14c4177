//! Why object storage did not do what was asked; no text here holds a credential.
//!
//! What a server or a client library says is not passed on: answers quote key ids and signatures, and addresses hold
//! tokens. Only the status, the code of the error and the kind of a broken connection are.

use std::io;

use thiserror::Error;

use crate::worker::with_causes;

/// Why a URL cannot be used, read or written.
#[derive(Debug, Error)]
pub enum StoreError {
    #[error(
        "{message}; valid is s3://BUCKET/PATH, gs://BUCKET/PATH, az://CONTAINER/PATH, file:///PATH or a path: {url}"
    )]
    Url { message: String, url: String },
    #[error("nothing lies below this URL: {url}")]
    Nothing { url: String },
    #[error("cannot {doing}: {reason}: {url}")]
    Failed { doing: &'static str, reason: String, url: String },
    #[error(
        "another writer changed this object since the command began; it was not overwritten. The same command again goes on \
         with what lies there now: {url}"
    )]
    Changed { url: String },
    #[error(
        "another object has this name already, and it was not overwritten; give another URL, or delete it if no other command \
         writes there: {url}"
    )]
    Taken { url: String },
    #[error(
        "torn on its way: {found} arrived, {wanted} was written; the same command again fetches it anew: {url}"
    )]
    Torn { found: String, wanted: String, url: String },
    #[error(
        "another harmzone command of this machine writes there, or reads what this one would write; wait for it, or give \
         HARMZONE_CACHE another folder: {url}"
    )]
    InUse { url: String },
    #[error("the environment variable {name} is `{found}`; valid is {valid}")]
    Environment { name: &'static str, found: String, valid: &'static str },
    #[error("no place for copies of objects: set HARMZONE_CACHE to a folder")]
    NoCache,
    #[error(transparent)]
    Io(#[from] io::Error),
}

impl From<StoreError> for io::Error {
    fn from(error: StoreError) -> Self {
        match error {
            StoreError::Io(error) => error,
            other => Self::other(other),
        }
    }
}

/// What is known of a failed request, without what could hold a credential.
pub(super) struct Answer {
    /// Such as 403; `None` where no answer came.
    status: Option<String>,
    /// Such as `ExpiredToken`; `None` where the answer has none, as those to questions about an object alone.
    code: Option<String>,
    text: String,
}

impl Answer {
    pub(super) fn of(error: &object_store::Error) -> Self {
        let text = with_causes(error);
        let word = |from: &str, to: &str| {
            let (_, rest) = text.split_once(from)?;
            let found: String = rest.split(to).next()?.chars().filter(char::is_ascii_alphanumeric).collect();
            (1..=64).contains(&found.len()).then_some(found)
        };
        let status = word("status code: ", " ").or_else(|| word("status code: ", ":"));
        let status = status.map(|found| found.chars().take(3).collect());
        Self { status, code: word("<Code>", "<"), text }
    }

    /// Whether the request may have counted although no answer came.
    pub(super) fn is_lost(&self) -> bool {
        self.status.is_none()
    }

    /// For people, of an error that came before any request was sent.
    pub(super) fn reason_before_requests(&self, variables: &str) -> String {
        format!("it is not set up: {}; what it needs is read from {variables}", scrubbed(&self.text))
    }

    /// For people; `variables` are what credentials are read from.
    pub(super) fn reason(&self, variables: &str) -> String {
        let code = self.code.as_deref().unwrap_or_default();
        let of = match (&self.status, code) {
            (Some(status), "") => format!("HTTP {status}"),
            (Some(status), code) => format!("{code}, HTTP {status}"),
            (None, code) => code.to_owned(),
        };
        if code.contains("Expired") {
            return format!(
                "the credentials have expired ({of}); renew them ({variables}), and the same command again goes on"
            );
        }
        match self.status.as_deref() {
            Some("401" | "403") => {
                format!("the credentials are refused ({of}); they are read from {variables}")
            }
            Some("400") if code.is_empty() => {
                format!(
                    "the server refuses, as with expired credentials ({of}); they are read from {variables}"
                )
            }
            Some("404") if code == "NoSuchBucket" => format!("there is no such bucket ({of})"),
            Some(status) if status.starts_with('5') => format!("the server fails ({of}), after all retries"),
            Some(_) => format!("the server refuses ({of})"),
            None if has_word(&self.text, &["timed out", "deadline"]) => "no answer in time".to_owned(),
            None if has_word(&self.text, &["connect", "dns", "resolve"]) => {
                "no connection to the server, after all retries".to_owned()
            }
            None if has_word(&self.text, &["missing", "not configured", "config", "credential"]) => {
                format!("it is not set up: {}", scrubbed(&self.text))
            }
            None => format!("the transfer broke off ({})", scrubbed(&self.text)),
        }
    }
}

fn has_word(text: &str, words: &[&str]) -> bool {
    let text = text.to_ascii_lowercase();
    words.iter().any(|word| text.contains(word))
}

/// The text without the values of variables that hold secrets, and without what follows the `?` of an address.
pub(super) fn scrubbed(text: &str) -> String {
    scrubbed_of(
        text,
        std::env::vars_os()
            .filter_map(|(name, value)| Some((name.into_string().ok()?, value.into_string().ok()?))),
    )
}

fn scrubbed_of(text: &str, variables: impl Iterator<Item = (String, String)>) -> String {
    let mut text = text.to_owned();
    let is_secret = |name: &str| {
        ["AWS_", "AZURE_", "GOOGLE_"].iter().any(|of| name.starts_with(of))
            && ["KEY", "SECRET", "TOKEN", "SAS", "PASSWORD"].iter().any(|word| name.contains(word))
    };
    for (_, value) in variables.filter(|(name, value)| is_secret(name) && value.len() > 3) {
        text = text.replace(&value, "***");
    }
    let words = text.split(' ').map(|word| match (word.contains("://"), word.find('?')) {
        (true, Some(at)) => &word[..at],
        _ => word,
    });
    let text = words.collect::<Vec<_>>().join(" ");
    text.chars().take(400).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn answer(text: &str) -> Answer {
        Answer::of(&object_store::Error::Generic { store: "S3", source: text.to_owned().into() })
    }

    #[test]
    fn an_expired_credential_is_told_and_nothing_that_the_server_quotes() {
        let told = answer(
            "Error performing PUT http://host/b/x?X-Amz-Security-Token=tok in 1s - Server returned non-2xx status code: 400 Bad \
             Request: <Error><Code>ExpiredToken</Code><Message>tok</Message><Token0>AKIASECRET</Token0></Error>",
        );
        assert!(!told.is_lost());
        let told = told.reason("AWS_SESSION_TOKEN");
        assert!(
            told.contains("expired (ExpiredToken, HTTP 400)") && told.contains("AWS_SESSION_TOKEN"),
            "{told}"
        );
        assert!(!told.contains("tok)") && !told.contains("AKIA"), "{told}");
    }

    #[test]
    fn a_cut_connection_is_a_lost_answer() {
        let cut =
            answer("Error performing PUT http://host/b/x?sig=abc in 1s - HTTP error: error sending request");
        assert!(cut.is_lost());
        let told = cut.reason("X");
        assert!(told.contains("http://host/b/x") && !told.contains("abc"), "{told}");
    }

    #[test]
    fn values_of_secret_variables_are_scrubbed() {
        let variables = [("AWS_SECRET_ACCESS_KEY", "hush1"), ("AWS_REGION", "eu-west-1")];
        let variables = variables.map(|(name, value)| (name.to_owned(), value.to_owned()));
        assert_eq!(scrubbed_of("key hush1 in eu-west-1", variables.into_iter()), "key *** in eu-west-1");
    }
}
