//! The page: files of this crate, compiled in.

use axum::extract::Path;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};

use super::text;

const HTML: &str = "text/html; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";

/// The files of the page: name, content type, content.
const FILES: &[(&str, &str, &str)] = &[
    ("style.css", "text/css; charset=utf-8", include_str!("../page/style.css")),
    ("icon.svg", "image/svg+xml", include_str!("../page/icon.svg")),
    ("main.js", SCRIPT, include_str!("../page/main.js")),
    ("connection.js", SCRIPT, include_str!("../page/connection.js")),
    ("protocol.js", SCRIPT, include_str!("../page/protocol.js")),
    ("panes.js", SCRIPT, include_str!("../page/panes.js")),
    ("cloud.js", SCRIPT, include_str!("../page/cloud.js")),
    ("obstacles.js", SCRIPT, include_str!("../page/obstacles.js")),
    ("plots.js", SCRIPT, include_str!("../page/plots.js")),
    ("settings.js", SCRIPT, include_str!("../page/settings.js")),
];

/// The page itself.
pub(super) async fn index() -> Response {
    ([(header::CONTENT_TYPE, HTML)], include_str!("../page/index.html")).into_response()
}

/// The page that asks for the token.
pub(super) fn sign_in() -> Response {
    let kind = [(header::CONTENT_TYPE, HTML)];
    (StatusCode::UNAUTHORIZED, kind, include_str!("../page/sign-in.html")).into_response()
}

/// A file of the page.
pub(super) async fn asset(Path(file): Path<String>) -> Response {
    let found = FILES.iter().find(|(name, ..)| *name == file);
    found.map_or_else(
        || text(StatusCode::NOT_FOUND, "the page has no such file\n"),
        |(_, kind, content)| ([(header::CONTENT_TYPE, *kind)], *content).into_response(),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_file_that_the_page_names_is_served_and_no_other_host_is_named() {
        let html = [include_str!("../page/index.html"), include_str!("../page/sign-in.html")];
        let scripts = FILES.iter().map(|(_, _, content)| *content);
        let texts: Vec<&str> = html.into_iter().chain(scripts).collect();
        for text in &texts {
            let named = text.split(['"', '\'']).filter_map(|word| {
                word.strip_prefix("/_page/")
                    .or_else(|| word.strip_prefix("./").filter(|word| word.ends_with(".js")))
            });
            for name in named {
                assert!(FILES.iter().any(|(file, ..)| *file == name), "{name} is not served");
            }
            for (at, _) in text.match_indices("//").filter(|(at, _)| text[..*at].ends_with(':')) {
                let host = &text[at + 2..];
                let is_own = host.starts_with("${location.host}") || host.starts_with("www.w3.org/2000/svg");
                assert!(is_own, "another host is named: {}", &host[..host.len().min(40)]);
            }
        }
        for (file, ..) in FILES.iter().filter(|(file, ..)| *file != "main.js") {
            assert!(texts.iter().any(|text| text.contains(file)), "{file} is not used");
        }
    }

    #[test]
    fn the_page_has_neither_inline_scripts_nor_inline_styles() {
        for html in [include_str!("../page/index.html"), include_str!("../page/sign-in.html")] {
            for forbidden in ["<style", "style=", "onclick=", "onload=", "javascript:"] {
                assert!(!html.contains(forbidden), "{forbidden}");
            }
            assert!(
                html.match_indices("<script")
                    .all(|(at, _)| html[at..].starts_with("<script type=\"module\" src="))
            );
        }
    }
}
