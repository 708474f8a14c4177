//! The addresses and their answers. Episodes are named as the manifest names them, all else by its number in a list.

use std::future::{Ready, ready};
use std::sync::Arc;

use axum::Router;
use axum::body::Body;
use axum::extract::{Path, Request, State};
use axum::http::{HeaderValue, StatusCode, header};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use serde::Serialize;
use serde_json::json;

use super::ServeError;
use super::access::{Entrance, Gate, OF_REPORT, add_headers};
use super::frames::SampleFrame;
use super::site::ServedSite;

const HTML: &str = "text/html; charset=utf-8";
const TEXT: &str = "text/plain; charset=utf-8";
const JSON: &str = "application/json";

/// The parts of the page: address, media type, content.
const PARTS: [(&str, &str, &str); 8] = [
    ("/", HTML, include_str!("page/index.html")),
    ("/page.css", "text/css; charset=utf-8", include_str!("page/page.css")),
    ("/page.js", SCRIPT, include_str!("page/page.js")),
    ("/list.js", SCRIPT, include_str!("page/list.js")),
    ("/player.js", SCRIPT, include_str!("page/player.js")),
    ("/draw.js", SCRIPT, include_str!("page/draw.js")),
    ("/scores.js", SCRIPT, include_str!("page/scores.js")),
    ("/icon.svg", "image/svg+xml", include_str!("page/icon.svg")),
];
const SCRIPT: &str = "text/javascript; charset=utf-8";

/// All addresses behind the gate.
pub fn router(site: Arc<ServedSite>, gate: Gate) -> Router {
    let mut router = Router::new();
    for (path, kind, text) in PARTS {
        router = router.route(path, get(move || ready(answer(kind, text))));
    }
    let sample = "/api/sets/{set}/episodes/{name}/samples/{sample}";
    router
        .route("/api/folder", get(|State(site): State<Arc<ServedSite>>| ready(to_json(&site.overview()))))
        .route("/api/sets/{set}/episodes", get(episodes))
        .route("/api/sets/{set}/episodes/{name}", get(episode))
        .route(sample, get(frame_facts))
        .route(&format!("{sample}/image"), get(frame_image))
        .route(&format!("{sample}/points"), get(frame_points))
        .route("/api/scores/{idx}", get(scores))
        .route("/reports/{idx}", get(report))
        .fallback(|| ready(ServeError::NotThere { what: "page at this address".to_owned() }))
        .with_state(site)
        .layer(middleware::from_fn_with_state(Arc::new(gate), guard))
}

/// Stands before every address, those that do not exist too.
async fn guard(State(gate): State<Arc<Gate>>, request: Request, next: Next) -> Response {
    let entrance = gate.check(request.method(), request.uri(), request.headers());
    let is_front = request.uri().path() == "/";
    let mut response = match entrance {
        Err(refusal) => (refusal.status(), answer(TEXT, refusal.text())).into_response(),
        Ok(_) => next.run(request).await,
    };
    if response.status() == StatusCode::METHOD_NOT_ALLOWED {
        response.headers_mut().insert(header::ALLOW, HeaderValue::from_static("GET, HEAD"));
    }
    if entrance == Ok(Entrance::Url) && is_front {
        response.headers_mut().insert(header::SET_COOKIE, gate.cookie());
    }
    add_headers(response.headers_mut());
    response
}

fn answer(kind: &'static str, body: impl Into<Body>) -> Response {
    ([(header::CONTENT_TYPE, kind)], body.into()).into_response()
}

fn to_json(content: &impl Serialize) -> Response {
    answer(JSON, serde_json::to_vec(content).expect("what is shown has a JSON form"))
}

fn episodes(
    State(site): State<Arc<ServedSite>>,
    Path(set): Path<usize>,
) -> Ready<Result<Response, ServeError>> {
    ready(site.episodes(set).map(|list| to_json(&list)))
}

async fn episode(
    State(site): State<Arc<ServedSite>>,
    Path((set, name)): Path<(usize, String)>,
) -> Result<Response, ServeError> {
    Ok(to_json(&site.episode(set, &name).await?))
}

/// Set, episode, sample.
type SamplePlace = Path<(usize, String, usize)>;

async fn frame_facts(site: State<Arc<ServedSite>>, place: SamplePlace) -> Result<Response, ServeError> {
    Ok(answer(JSON, frame(site, place).await?.json.clone()))
}

async fn frame_image(site: State<Arc<ServedSite>>, place: SamplePlace) -> Result<Response, ServeError> {
    let frame = frame(site, place).await?;
    Ok(answer(frame.image_type, frame.image.clone()))
}

async fn frame_points(site: State<Arc<ServedSite>>, place: SamplePlace) -> Result<Response, ServeError> {
    Ok(answer("application/octet-stream", frame(site, place).await?.points.clone()))
}

async fn frame(
    State(site): State<Arc<ServedSite>>,
    Path((set, name, sample)): SamplePlace,
) -> Result<Arc<SampleFrame>, ServeError> {
    site.frame(set, &name, sample).await
}

async fn scores(State(site): State<Arc<ServedSite>>, Path(idx): Path<usize>) -> Result<Response, ServeError> {
    Ok(to_json(&site.scores(idx).await?))
}

async fn report(State(site): State<Arc<ServedSite>>, Path(idx): Path<usize>) -> Result<Response, ServeError> {
    let mut response = answer(HTML, site.report(idx).await?);
    response.headers_mut().insert(header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(OF_REPORT));
    Ok(response)
}

impl IntoResponse for ServeError {
    fn into_response(self) -> Response {
        let status = match self {
            Self::NotThere { .. } => StatusCode::NOT_FOUND,
            Self::Outside { .. } => StatusCode::FORBIDDEN,
            _ => StatusCode::UNPROCESSABLE_ENTITY,
        };
        (status, to_json(&json!({ "error": self.to_string() }))).into_response()
    }
}
