//! Access: only requests with the token, and none from pages of other sites.

use axum::extract::{Query, Request, State};
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode, Uri, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use serde::Deserialize;

use super::{ServerState, page, text};
use crate::token::Token;

/// The page runs its own scripts and styles only, and reaches no other host.
const CONTENT_SECURITY_POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; \
    img-src 'self' blob: data:; connect-src 'self'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'";

/// Set on every response.
const HEADERS: [(header::HeaderName, &str); 4] = [
    (header::CONTENT_SECURITY_POLICY, CONTENT_SECURITY_POLICY),
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::REFERRER_POLICY, "no-referrer"),
    (header::HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
];

/// Refuses requests without access, and sets the headers of all responses.
pub(super) async fn check(State(shared): State<ServerState>, request: Request, next: Next) -> Response {
    let refused = match &shared.token {
        None => foreign_name(request.headers(), request.uri()),
        Some(token) => without_token(token, &request, shared.port),
    };
    let mut response = match refused.or_else(|| foreign_origin(request.headers())) {
        Some(refused) => refused,
        None => next.run(request).await,
    };
    for (name, value) in HEADERS {
        response.headers_mut().insert(name, HeaderValue::from_static(value));
    }
    response.headers_mut().entry(header::CACHE_CONTROL).or_insert(HeaderValue::from_static("no-store"));
    response
}

/// Without a token, only this machine can connect. A page of another site could still reach the server under
/// its own host name if that resolves to this machine (DNS rebinding), so only addresses and `localhost` are
/// accepted.
fn foreign_name(headers: &HeaderMap, uri: &Uri) -> Option<Response> {
    let host = headers.get(header::HOST).and_then(|host| host.to_str().ok()).or_else(|| uri.host())?;
    let name = host_name(host);
    let is_address = name.parse::<std::net::Ipv4Addr>().is_ok() || name.starts_with('[');
    let is_local =
        name.eq_ignore_ascii_case("localhost") || name.to_ascii_lowercase().ends_with(".localhost");
    let message = "this name is not answered without a token; use localhost or the address\n";
    (!is_address && !is_local).then(|| text(StatusCode::MISDIRECTED_REQUEST, message))
}

/// A host without its port.
fn host_name(host: &str) -> &str {
    match host.rsplit_once(':') {
        Some((name, port)) if port.bytes().all(|byte| byte.is_ascii_digit()) => name,
        _ => host,
    }
}

/// A script of another site may open a WebSocket to any host; browsers send its origin.
fn foreign_origin(headers: &HeaderMap) -> Option<Response> {
    let origin = headers.get(header::ORIGIN)?.to_str().unwrap_or_default();
    let host = headers.get(header::HOST).and_then(|host| host.to_str().ok()).unwrap_or_default();
    let own = origin.split_once("://").is_some_and(|(_, origin)| origin.eq_ignore_ascii_case(host));
    (!own).then(|| text(StatusCode::FORBIDDEN, "pages of other sites are not answered\n"))
}

#[derive(Deserialize)]
struct TokenQuery {
    token: Option<String>,
}

/// The token of the address. `+` means a space in a query, and no token has a space.
fn query_token(uri: &Uri) -> Option<String> {
    let Query(TokenQuery { token }) = Query::try_from_uri(uri).ok()?;
    token.map(|token| token.replace(' ', "+"))
}

/// Browsers send the cookies of one host to all of its ports.
fn cookie_name(port: u16) -> String {
    format!("nunet_view_{port}")
}

fn cookie_token(headers: &HeaderMap, port: u16) -> Option<&str> {
    let name = cookie_name(port);
    let cookies = headers.get_all(header::COOKIE).iter().filter_map(|cookies| cookies.to_str().ok());
    let mut pairs =
        cookies.flat_map(|cookies| cookies.split(';')).filter_map(|pair| pair.trim().split_once('='));
    pairs.find_map(|(key, value)| (key == name).then_some(value))
}

fn bearer_token(headers: &HeaderMap) -> Option<&str> {
    let value = headers.get(header::AUTHORIZATION)?.to_str().ok()?;
    let (scheme, token) = value.split_once(' ')?;
    scheme.eq_ignore_ascii_case("bearer").then_some(token.trim())
}

/// The response to a request without the token. A browser with the token in the address receives a cookie and
/// is redirected to the address without it.
fn without_token(token: &Token, request: &Request, port: u16) -> Option<Response> {
    let (headers, uri) = (request.headers(), request.uri());
    let in_query = query_token(uri).is_some_and(|presented| token.matches(&presented));
    let is_page = uri.path() == "/" && request.method() == Method::GET;
    if in_query && is_page {
        let cookie = format!("{}={}; Path=/; HttpOnly; SameSite=Strict", cookie_name(port), token.reveal());
        return Some(
            (StatusCode::SEE_OTHER, [(header::LOCATION, "/"), (header::SET_COOKIE, &cookie)]).into_response(),
        );
    }
    let presented = [bearer_token(headers), cookie_token(headers, port)];
    if in_query || presented.into_iter().flatten().any(|presented| token.matches(presented)) {
        return None;
    }
    // The style sheet of the page that asks for the token.
    if uri.path() == "/_page/style.css" {
        return None;
    }
    let wants_page = is_page
        && headers.get(header::ACCEPT).is_some_and(|kinds| kinds.as_bytes().starts_with(b"text/html"));
    Some(if wants_page { page::sign_in() } else { refusal() })
}

fn refusal() -> Response {
    let mut response = text(
        StatusCode::UNAUTHORIZED,
        "a token is needed: send `Authorization: Bearer TOKEN`, or open /?token=TOKEN in a browser\n",
    );
    response.headers_mut().insert(header::WWW_AUTHENTICATE, HeaderValue::from_static("Bearer"));
    response
}

#[cfg(test)]
mod tests {
    use super::*;

    fn headers(pairs: &[(header::HeaderName, &'static str)]) -> HeaderMap {
        pairs.iter().map(|(name, value)| (name.clone(), HeaderValue::from_static(value))).collect()
    }

    #[test]
    fn without_a_token_only_host_names_of_this_machine_are_accepted() {
        for host in ["127.0.0.1:8080", "localhost:8080", "LOCALHOST", "[::1]:8080", "view.localhost:1"] {
            assert!(
                foreign_name(&headers(&[(header::HOST, host)]), &Uri::from_static("/")).is_none(),
                "{host}"
            );
        }
        for host in ["evil.example:8080", "localhost.evil.example", "127.0.0.1.evil.example", ""] {
            assert!(
                foreign_name(&headers(&[(header::HOST, host)]), &Uri::from_static("/")).is_some(),
                "{host}"
            );
        }
    }

    #[test]
    fn only_the_own_origin_is_accepted() {
        let of = |origin| foreign_origin(&headers(&[(header::HOST, "robot:8080"), (header::ORIGIN, origin)]));
        assert!(of("http://robot:8080").is_none());
        assert!(foreign_origin(&headers(&[(header::HOST, "robot:8080")])).is_none(), "not a browser");
        for origin in ["http://robot", "http://evil.example", "null", "", "http://robot:8080.evil.example"] {
            assert_eq!(of(origin).map(|answer| answer.status()), Some(StatusCode::FORBIDDEN), "{origin}");
        }
    }

    #[test]
    fn a_token_is_found_in_the_address_a_cookie_and_a_header() {
        assert_eq!(query_token(&Uri::from_static("/?a=1&token=x%2Fy+z")), Some("x/y+z".to_owned()));
        assert_eq!(query_token(&Uri::from_static("/")), None);
        let cookie = headers(&[(header::COOKIE, "a=1; nunet_view_80=wrong; nunet_view_8080=s=; b")]);
        assert_eq!(cookie_token(&cookie, 8080), Some("s="));
        assert_eq!(bearer_token(&headers(&[(header::AUTHORIZATION, "bearer  s")])), Some("s"));
        assert_eq!(bearer_token(&headers(&[(header::AUTHORIZATION, "Basic s")])), None);
    }
}
