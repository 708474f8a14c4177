//! Who may ask, and what every answer carries: this machine's own browser, with the token, for reading.
//!
//! Refused are other methods than GET and HEAD, other hosts than the loopback's (a page elsewhere whose name was
//! made to mean 127.0.0.1), requests without the token, and requests that a page of another origin makes with this
//! one's cookie.

use std::fmt::{self, Write as _};
use std::hint::black_box;

use axum::http::{HeaderMap, HeaderValue, Method, StatusCode, Uri, header};

use super::ServeError;

/// Bytes of a token.
const N_BYTES: usize = 32;

/// What the one who started the server hands to a browser, in the URL.
///
/// It comes from the operating system's randomness and not from a seed: it must not be guessed, and it reaches no
/// output that has to be the same again.
#[derive(Clone)]
pub struct AccessToken(String);

impl AccessToken {
    /// Draws a new one.
    ///
    /// # Errors
    /// The system has no randomness.
    pub fn draw() -> Result<Self, ServeError> {
        let mut bytes = [0; N_BYTES];
        getrandom::fill(&mut bytes).map_err(|source| ServeError::NoRandomness { source })?;
        let hex = bytes.iter().fold(String::with_capacity(2 * N_BYTES), |mut hex, byte| {
            write!(hex, "{byte:02x}").expect("writing to a string cannot fail");
            hex
        });
        Ok(Self(hex))
    }

    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// Whether someone knows it. The time that this takes tells nothing of where they differ.
    #[must_use]
    pub fn is(&self, given: &str) -> bool {
        let (own, given) = (self.0.as_bytes(), given.as_bytes());
        let differences = own.iter().zip(given).fold(0, |all, (a, b)| black_box(all | (a ^ b)));
        own.len() == given.len() && differences == 0
    }
}

impl fmt::Debug for AccessToken {
    /// It stays out of logs.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("AccessToken(..)")
    }
}

/// The door: the token, and the port that the server listens on.
#[derive(Debug, Clone)]
pub struct Gate {
    pub token: AccessToken,
    pub port: u16,
}

/// Why a request is not answered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Refusal {
    Method,
    Host,
    Token,
    Origin,
}

/// How a request came in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Entrance {
    /// With the token in the URL: the browser gets a cookie in its place.
    Url,
    Cookie,
}

impl Refusal {
    #[must_use]
    pub fn status(self) -> StatusCode {
        match self {
            Self::Method => StatusCode::METHOD_NOT_ALLOWED,
            Self::Host => StatusCode::MISDIRECTED_REQUEST,
            Self::Token | Self::Origin => StatusCode::FORBIDDEN,
        }
    }

    /// What the one who asked is told.
    #[must_use]
    pub fn text(self) -> &'static str {
        match self {
            Self::Method => "This server only shows: GET and HEAD are answered.\n",
            Self::Host => "Only 127.0.0.1 and localhost are answered here, with this server's port.\n",
            Self::Token => {
                "The token is missing or not valid. Open the whole URL that `harmzone serve` printed, with `?token=`; a \
                 server that was started again has another token.\n"
            }
            Self::Origin => {
                "A page of another origin asked. Open the URL that `harmzone serve` printed by itself.\n"
            }
        }
    }
}

impl Gate {
    /// The URL to open.
    #[must_use]
    pub fn url(&self) -> String {
        format!("http://127.0.0.1:{}/?token={}", self.port, self.token.as_str())
    }

    /// Lets a request in, or tells why not.
    ///
    /// # Errors
    /// [`Refusal`].
    pub fn check(&self, method: &Method, uri: &Uri, headers: &HeaderMap) -> Result<Entrance, Refusal> {
        if !matches!(*method, Method::GET | Method::HEAD) {
            return Err(Refusal::Method);
        }
        if !self.is_own_host(uri, headers) {
            return Err(Refusal::Host);
        }
        let mut in_url =
            uri.query().unwrap_or_default().split('&').filter_map(|pair| pair.strip_prefix("token="));
        if in_url.any(|given| self.token.is(given)) {
            return Ok(Entrance::Url);
        }
        let name = self.cookie_name();
        let cookies = headers.get_all(header::COOKIE).into_iter().filter_map(|value| value.to_str().ok());
        let mut values =
            cookies.flat_map(|all| all.split(';')).filter_map(|pair| pair.trim().split_once('='));
        if !values.any(|(given, value)| given == name && self.token.is(value)) {
            return Err(Refusal::Token);
        }
        // Ports share cookies: a page of another server on this machine could ask with ours.
        match headers.get("sec-fetch-site").map(HeaderValue::as_bytes) {
            None | Some(b"same-origin" | b"none") => Ok(Entrance::Cookie),
            Some(_) => Err(Refusal::Origin),
        }
    }

    fn is_own_host(&self, uri: &Uri, headers: &HeaderMap) -> bool {
        let is_own = |host: &str| {
            let (name, port) =
                host.rsplit_once(':').map_or((host, Some(80)), |(name, port)| (name, port.parse().ok()));
            port == Some(self.port) && (name == "127.0.0.1" || name.eq_ignore_ascii_case("localhost"))
        };
        let mut hosts = headers.get_all(header::HOST).into_iter();
        let is_named =
            hosts.next().is_some_and(|host| host.to_str().is_ok_and(is_own)) && hosts.next().is_none();
        is_named && uri.authority().is_none_or(|authority| is_own(authority.as_str()))
    }

    /// With the port in its name, since all servers of this machine share their cookies.
    fn cookie_name(&self) -> String {
        format!("harmzone_{}", self.port)
    }

    /// The cookie that stands for the token: no script reads it, and no other site sends it.
    #[must_use]
    pub fn cookie(&self) -> HeaderValue {
        let cookie =
            format!("{}={}; HttpOnly; SameSite=Strict; Path=/", self.cookie_name(), self.token.as_str());
        HeaderValue::from_str(&cookie).expect("digits and letters are a header")
    }
}

/// What the page may load: its own parts and nothing else, no script or style within the page.
const OF_PAGE: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; connect-src 'self'; \
     frame-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";
/// What a report may do: show what it holds, in an origin of its own, so that its script reaches nothing here. Forms,
/// since its dialog closes by one.
pub const OF_REPORT: &str = "sandbox allow-scripts allow-forms; default-src 'none'; script-src 'unsafe-inline'; \
     style-src 'unsafe-inline'; img-src data:; media-src data:; font-src data:; base-uri 'none'; form-action 'none'; \
     frame-ancestors 'self'";

/// Adds what every answer carries; a policy that is there already stays.
pub fn add_headers(headers: &mut HeaderMap) {
    let all = [
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "no-referrer"),
        (header::CACHE_CONTROL, "no-store"),
        (header::HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
        (header::HeaderName::from_static("cross-origin-opener-policy"), "same-origin"),
    ];
    for (name, value) in all {
        headers.insert(name, HeaderValue::from_static(value));
    }
    headers.entry(header::CONTENT_SECURITY_POLICY).or_insert(HeaderValue::from_static(OF_PAGE));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gate() -> Gate {
        Gate { token: AccessToken::draw().unwrap(), port: 4321 }
    }

    fn headers(pairs: &[(&'static str, &str)]) -> HeaderMap {
        let mut headers = HeaderMap::new();
        for &(name, value) in pairs {
            headers.append(name, HeaderValue::from_str(value).unwrap());
        }
        headers
    }

    #[test]
    fn tokens_are_long_differ_and_are_compared_whole() {
        let (one, other) = (AccessToken::draw().unwrap(), AccessToken::draw().unwrap());
        assert_eq!(one.as_str().len(), 64);
        assert!(
            one.is(one.as_str()) && !one.is(other.as_str()) && !one.is("") && !one.is(&one.as_str()[1..])
        );
        assert!(!one.is(&format!("{}0", one.as_str())));
        assert_eq!(format!("{one:?}"), "AccessToken(..)");
    }

    #[test]
    fn only_the_loopback_with_our_port_is_our_host() {
        let gate = gate();
        let url: Uri = format!("/?token={}", gate.token.as_str()).parse().unwrap();
        let told = |host: &[(&'static str, &str)]| gate.check(&Method::GET, &url, &headers(host));
        for host in ["127.0.0.1:4321", "localhost:4321", "LocalHost:4321"] {
            assert_eq!(told(&[("host", host)]), Ok(Entrance::Url), "{host}");
        }
        let others =
            ["127.0.0.1", "localhost", "127.0.0.1:80", "evil.example:4321", "127.0.0.1.evil.example:4321"];
        for host in
            others.into_iter().chain(["", ":4321", "0.0.0.0:4321", "[::1]:4321", "127.0.0.1:4321:4321"])
        {
            assert_eq!(told(&[("host", host)]), Err(Refusal::Host), "{host}");
        }
        assert_eq!(told(&[]), Err(Refusal::Host));
        assert_eq!(told(&[("host", "localhost:4321"), ("host", "evil.example")]), Err(Refusal::Host));
        let absolute: Uri = format!("http://evil.example/?token={}", gate.token.as_str()).parse().unwrap();
        let own = headers(&[("host", "localhost:4321")]);
        assert_eq!(gate.check(&Method::GET, &absolute, &own), Err(Refusal::Host));
    }

    #[test]
    fn without_the_token_nobody_gets_in_and_a_cookie_only_from_our_own_page() {
        let gate = gate();
        let right = gate.cookie().to_str().unwrap().split(';').next().unwrap().to_owned();
        let ask = |url: &str, more: &[(&'static str, &str)]| {
            let headers = headers(&[&[("host", "127.0.0.1:4321")], more].concat());
            gate.check(&Method::GET, &url.parse().unwrap(), &headers)
        };
        assert_eq!(ask("/", &[]), Err(Refusal::Token));
        assert_eq!(ask("/?token=", &[]), Err(Refusal::Token));
        assert_eq!(ask(&format!("/?token={}", "0".repeat(64)), &[]), Err(Refusal::Token));
        assert_eq!(ask("/", &[("cookie", "harmzone_4321=0")]), Err(Refusal::Token));
        assert_eq!(ask("/", &[("cookie", &right.replace("4321=", "4322="))]), Err(Refusal::Token));
        assert_eq!(ask("/", &[("cookie", &format!("a=b; {right}"))]), Ok(Entrance::Cookie));
        for (site, wanted) in [
            ("same-origin", Ok(Entrance::Cookie)),
            ("none", Ok(Entrance::Cookie)),
            ("same-site", Err(Refusal::Origin)),
            ("cross-site", Err(Refusal::Origin)),
        ] {
            assert_eq!(ask("/", &[("cookie", &right), ("sec-fetch-site", site)]), wanted, "{site}");
        }
        for method in
            [Method::POST, Method::PUT, Method::DELETE, Method::OPTIONS, Method::TRACE, Method::CONNECT]
        {
            let url = gate.url().parse().unwrap();
            assert_eq!(
                gate.check(&method, &url, &headers(&[("host", "127.0.0.1:4321")])),
                Err(Refusal::Method)
            );
        }
    }
}
