//! What a flag names: a path of this machine, or a URL of object storage.

use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use url::Url;

use super::error::StoreError;

/// Whose protocol a URL speaks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Provider {
    S3,
    Google,
    Azure,
}

impl Provider {
    /// The environment variables that credentials are read from.
    pub(super) fn variables(self) -> &'static str {
        match self {
            Self::S3 => {
                "AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY, AWS_SESSION_TOKEN, with AWS_REGION and AWS_ENDPOINT_URL"
            }
            Self::Google => "GOOGLE_SERVICE_ACCOUNT or GOOGLE_APPLICATION_CREDENTIALS",
            Self::Azure => {
                "AZURE_STORAGE_ACCOUNT_NAME with AZURE_STORAGE_ACCOUNT_KEY or AZURE_STORAGE_SAS_TOKEN"
            }
        }
    }
}

/// A URL below which a data set, a run or scores lie.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StoreUrl {
    pub(super) scheme: Provider,
    pub(super) bucket: String,
    /// Without slashes at its ends.
    pub(super) path: String,
}

impl fmt::Display for StoreUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let scheme = match self.scheme {
            Provider::S3 => "s3",
            Provider::Google => "gs",
            Provider::Azure => "az",
        };
        write!(f, "{scheme}://{}/{}", self.bucket, self.path)
    }
}

/// Where a data set, a run or scores lie.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Location {
    Local(PathBuf),
    Remote(StoreUrl),
}

impl Location {
    /// The path, of a location of this machine.
    #[must_use]
    pub fn local(&self) -> Option<&Path> {
        match self {
            Self::Local(path) => Some(path),
            Self::Remote(_) => None,
        }
    }
}

impl fmt::Display for Location {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Local(path) => path.display().fmt(f),
            Self::Remote(url) => url.fmt(f),
        }
    }
}

/// Whether a text is a URL and no path.
#[must_use]
pub fn is_url(text: &str) -> bool {
    let is_scheme = |scheme: &str| {
        scheme.starts_with(|c: char| c.is_ascii_alphabetic())
            && scheme.chars().all(|c| c.is_ascii_alphanumeric() || matches!(c, '+' | '-' | '.'))
    };
    text.split_once("://").is_some_and(|(scheme, _)| is_scheme(scheme))
}

/// Refuses a URL that holds credentials, before anybody quotes it.
///
/// # Errors
/// [`StoreError::Url`], with the URL as far as it may be told.
pub fn refuse_credentials(text: &str) -> Result<(), StoreError> {
    if !is_url(text) {
        return Ok(());
    }
    let (scheme, rest) = text.split_once("://").expect("a URL has both");
    let authority = rest.split(['/', '?', '#']).next().unwrap_or_default();
    let is_named = authority.contains('@');
    let is_asked = rest.contains('?');
    if !is_named && !is_asked {
        return Ok(());
    }
    let path = rest[authority.len()..].split(['?', '#']).next().unwrap_or_default();
    let host = authority.rsplit('@').next().unwrap_or_default();
    let message = if is_named {
        "a URL holds no credentials or account: they come from the environment, as AWS_ACCESS_KEY_ID, GOOGLE_SERVICE_ACCOUNT, \
         AZURE_STORAGE_ACCOUNT_NAME"
    } else {
        "a URL holds no query: credentials come from the environment, as AWS_SESSION_TOKEN, AZURE_STORAGE_SAS_TOKEN"
    };
    Err(StoreError::Url { message: message.to_owned(), url: format!("{scheme}://{host}{path}") })
}

impl FromStr for Location {
    type Err = StoreError;

    fn from_str(text: &str) -> Result<Self, StoreError> {
        if !is_url(text) {
            return Ok(Self::Local(text.into()));
        }
        refuse_credentials(text)?;
        let fail = |message: &str| StoreError::Url { message: message.to_owned(), url: text.to_owned() };
        let url = Url::parse(text).map_err(|error| fail(&error.to_string()))?;
        let scheme = match url.scheme() {
            "file" => {
                let is_here = url.host_str().is_none_or(|host| host == "localhost");
                let path = url.to_file_path().ok().filter(|_| is_here);
                return path
                    .map(Self::Local)
                    .ok_or_else(|| fail("a file URL names an absolute path of this machine"));
            }
            "s3" => Provider::S3,
            "gs" => Provider::Google,
            "az" => Provider::Azure,
            other => return Err(fail(&format!("`{other}` is no scheme of object storage"))),
        };
        // The bucket as it is written: a URL's host loses its capitals.
        let (_, rest) = text.split_once("://").expect("it is a URL");
        let (bucket, path) = rest.split_once('/').unwrap_or((rest, ""));
        let is_valid = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || matches!(c, '-' | '.' | '_');
        if bucket.len() < 3 || !bucket.chars().all(is_valid) {
            return Err(fail(
                "a bucket has at least three letters, digits, `-`, `.` or `_`, without capitals",
            ));
        }
        let path = path.trim_matches('/');
        let is_part = |part: &str| !part.is_empty() && part != "." && part != "..";
        if !path.split('/').all(is_part) {
            return Err(fail("the path within the bucket is missing or has an empty part"));
        }
        if path.contains(['#', '%', '\\']) {
            return Err(fail("the path within the bucket has one of the characters # % \\"));
        }
        Ok(Self::Remote(StoreUrl { scheme, bucket: bucket.to_owned(), path: path.to_owned() }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(text: &str) -> String {
        text.parse::<Location>().unwrap_err().to_string()
    }

    #[test]
    fn paths_stay_paths_and_urls_keep_their_parts() {
        let local = |text: &str| text.parse::<Location>().unwrap().local().map(Path::to_owned);
        assert_eq!(local("data/x"), Some("data/x".into()));
        assert_eq!(local("C:/x"), Some("C:/x".into()));
        assert_eq!(local("file:///data/my%20set"), Some("/data/my set".into()));
        let url: Location = "s3://bucket/a/b/".parse().unwrap();
        assert_eq!(url.to_string(), "s3://bucket/a/b");
        assert_eq!(url.local(), None);
    }

    #[test]
    fn what_is_no_place_is_refused_with_what_would_be() {
        assert!(
            told("ftp://host/x").contains("`ftp` is no scheme")
                && told("ftp://host/x").contains("s3://BUCKET/PATH")
        );
        assert!(told("s3://My_Bucket/x").contains("a bucket has"));
        assert!(told("s3://bucket").contains("path within the bucket"));
        assert!(told("gs://bucket/a//b").contains("path within the bucket"));
        assert!(told("file://elsewhere/x").contains("absolute path"));
    }

    #[test]
    fn credentials_in_a_url_are_refused_and_not_repeated() {
        for url in ["s3://AKIA:hush@bucket/x", "az://box/x?sv=1&sig=hush", "ftp://me:hush@host/x"] {
            let told = told(url);
            assert!(
                told.contains("from the environment") && !told.contains("hush") && !told.contains("AKIA"),
                "{told}"
            );
        }
    }
}
