//! The page, the contract and the list of errors, all embedded in the program.

use super::picture::has_it;
use crate::jobs::{Code, Problem};
use axum::http::{HeaderMap, HeaderValue, Method, Uri, header};
use axum::response::{IntoResponse, Response};
use sha2::{Digest, Sha256};
use std::collections::HashMap;
use std::fmt::Write;
use std::sync::LazyLock;

/// Path and content of every file of `web/`.
const FILES: &[(&str, &[u8])] = include!(concat!(env!("OUT_DIR"), "/page.rs"));

/// The files by path, each with its `ETag`.
static PAGE: LazyLock<HashMap<&str, (&[u8], HeaderValue)>> =
    LazyLock::new(|| FILES.iter().map(|(path, bytes)| (*path, (*bytes, etag(bytes)))).collect());

static ERRORS: LazyLock<String> = LazyLock::new(|| page_of(include_str!("../../docs/errors.md")));

/// `GET /openapi.json`
pub async fn openapi_json() -> Response {
    text("application/json", include_str!(concat!(env!("OUT_DIR"), "/openapi.json")))
}

/// `GET /openapi.yaml`
pub async fn openapi_yaml() -> Response {
    text("application/yaml", include_str!("../../openapi.yaml"))
}

/// `GET /docs/errors`
pub async fn errors() -> Response {
    text("text/html; charset=utf-8", ERRORS.as_str())
}

fn text(kind: &'static str, content: &'static str) -> Response {
    ([(header::CONTENT_TYPE, kind), (header::CACHE_CONTROL, "no-cache")], content).into_response()
}

/// `GET /`
pub async fn index(headers: HeaderMap) -> Response {
    embedded("/index.html", &headers)
}

/// `GET /docs`
pub async fn reference(headers: HeaderMap) -> Response {
    embedded("/reference/index.html", &headers)
}

/// Whatever the route table does not name.
pub async fn file(method: Method, uri: Uri, headers: HeaderMap) -> Response {
    if PAGE.contains_key(uri.path()) && !matches!(method, Method::GET | Method::HEAD) {
        let problem = Problem::new(Code::MethodNotAllowed, "this is a file: read it with GET");
        return ([(header::ALLOW, "GET,HEAD")], problem).into_response();
    }
    embedded(uri.path(), &headers)
}

fn embedded(path: &str, headers: &HeaderMap) -> Response {
    let Some((bytes, etag)) = PAGE.get(path) else {
        let detail = format!("there is nothing at `{path}`; /openapi.json lists what there is");
        return Problem::new(Code::NotFound, detail).into_response();
    };
    let known = [(header::ETAG, etag.clone()), (header::CACHE_CONTROL, HeaderValue::from_static("no-cache"))];
    if etag.to_str().is_ok_and(|etag| has_it(headers, etag)) {
        return (axum::http::StatusCode::NOT_MODIFIED, known).into_response();
    }
    (known, [(header::CONTENT_TYPE, media_type(path))], *bytes).into_response()
}

fn media_type(path: &str) -> &'static str {
    match path.rsplit('.').next().unwrap_or_default() {
        "html" => "text/html; charset=utf-8",
        "css" => "text/css; charset=utf-8",
        "js" => "text/javascript; charset=utf-8",
        "json" => "application/json",
        "svg" => "image/svg+xml",
        "png" => "image/png",
        "jpg" => "image/jpeg",
        "webp" => "image/webp",
        "ico" => "image/x-icon",
        "woff2" => "font/woff2",
        "glb" => "model/gltf-binary",
        "webmanifest" => "application/manifest+json",
        "txt" | "md" => "text/plain; charset=utf-8",
        _ => "application/octet-stream",
    }
}

fn etag(bytes: &[u8]) -> HeaderValue {
    let hash = Sha256::digest(bytes);
    let digits = hash.iter().take(16).fold(String::new(), |mut digits, byte| {
        // Writing to a String cannot fail.
        let _ = write!(digits, "{byte:02x}");
        digits
    });
    HeaderValue::try_from(format!("\"{digits}\"")).unwrap_or_else(|_| HeaderValue::from_static("\"\""))
}

/// A plain page of headings, paragraphs and `code`, which is all that docs/errors.md uses. A heading's anchor is
/// its text.
fn page_of(markdown: &str) -> String {
    let mut html =
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>Candela errors</title>\n".to_owned();
    for block in markdown.split("\n\n").map(str::trim).filter(|block| !block.is_empty()) {
        let level = block.bytes().take_while(|byte| *byte == b'#').count();
        let (tag, text) = match level {
            0 => ("p", block),
            1 => ("h1", block[level..].trim()),
            _ => ("h2", block[level..].trim()),
        };
        let anchor = if tag == "h2" { format!(" id=\"{}\"", escaped(text)) } else { String::new() };
        // Writing to a String cannot fail.
        let _ = writeln!(html, "<{tag}{anchor}>{}</{tag}>", with_code(text));
    }
    html
}

/// Every second stretch between backticks is code.
fn with_code(text: &str) -> String {
    let stretches = text.split('`').enumerate();
    let marked = stretches.map(|(n, stretch)| match n % 2 {
        1 => format!("<code>{}</code>", escaped(stretch)),
        _ => escaped(stretch),
    });
    marked.collect()
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_code_has_its_anchor() {
        for code in Code::ALL {
            assert!(ERRORS.contains(&format!("<h2 id=\"{}\">", code.id())), "docs/errors.md lacks {}", code.id());
        }
    }

    #[test]
    fn markdown_becomes_plain_html() {
        let html = page_of("# A\n\n## b_c\n\nuse `x < y` & go\n");
        assert!(
            html.contains("<h1>A</h1>\n<h2 id=\"b_c\">b_c</h2>\n<p>use <code>x &lt; y</code> &amp; go</p>"),
            "{html}"
        );
    }
}
