//! One page over HTTP/1.1: `GET` and `HEAD` of `/metrics`. Each caller has a thread of its own, so that idle connections
//! delay nobody.

use std::io::{Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use tracing::debug;

/// No request is longer.
const MAX_REQUEST_BYTES: usize = 8 << 10;
/// More connections at a time are refused: each has a thread.
const MAX_CALLERS: usize = 64;
const CONTENT_TYPE: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";

/// Makes the text of the page.
pub(crate) type Page = dyn Fn() -> String + Send + Sync;

/// Answers callers of `listener` with `page`, on threads that end with the process. A caller that does not send a request or
/// does not read the answer within `timeout` is disconnected.
pub(crate) fn serve(listener: TcpListener, page: Arc<Page>, timeout: Duration) -> std::io::Result<()> {
    named("metrics").spawn(move || accept(&listener, &page, timeout)).map(drop)
}

fn named(name: &str) -> std::thread::Builder {
    std::thread::Builder::new().name(name.into())
}

/// Each caller is answered on a thread of its own.
fn accept(listener: &TcpListener, page: &Arc<Page>, timeout: Duration) {
    let callers = Arc::new(AtomicUsize::new(0));
    for caller in listener.incoming() {
        let Ok(caller) = caller else { continue };
        if callers.fetch_add(1, Ordering::AcqRel) >= MAX_CALLERS {
            callers.fetch_sub(1, Ordering::AcqRel);
            debug!("refused a connection: {MAX_CALLERS} are open");
            continue;
        }
        let (page, open) = (Arc::clone(page), Arc::clone(&callers));
        let answer = move || {
            if let Err(error) = answer(caller, page.as_ref(), timeout) {
                debug!("a caller of the metrics received no answer: {error}");
            }
            open.fetch_sub(1, Ordering::AcqRel);
        };
        if let Err(error) = named("metrics caller").spawn(answer) {
            callers.fetch_sub(1, Ordering::AcqRel);
            debug!("cannot start a thread for a caller of the metrics: {error}");
        }
    }
}

fn answer(mut caller: TcpStream, page: &Page, timeout: Duration) -> std::io::Result<()> {
    caller.set_read_timeout(Some(timeout))?;
    caller.set_write_timeout(Some(timeout))?;
    let Some(request) = read_request(&mut caller, timeout)? else { return Ok(()) };
    let (method, target) = request_line(&request);
    let path = target.split('?').next().unwrap_or_default();
    let (status, kind, body) = match (method, path) {
        ("GET" | "HEAD", "/metrics") => ("200 OK", CONTENT_TYPE, page()),
        ("GET" | "HEAD", _) => ("404 Not Found", "text/plain", "metrics are at /metrics\n".to_owned()),
        _ => ("405 Method Not Allowed", "text/plain", "only GET and HEAD are allowed\n".to_owned()),
    };
    let allow = if status.starts_with("405") { "Allow: GET, HEAD\r\n" } else { "" };
    let shown = if method == "HEAD" { "" } else { body.as_str() };
    write!(
        caller,
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {}\r\n{allow}Connection: close\r\n\r\n{shown}",
        body.len()
    )
}

/// A request up to its empty line; `None` if the caller sends none.
fn read_request(caller: &mut TcpStream, timeout: Duration) -> std::io::Result<Option<Vec<u8>>> {
    let (mut request, mut part, start) = (Vec::new(), [0; 1024], Instant::now());
    while !request.windows(4).any(|end| end == b"\r\n\r\n") {
        let read = caller.read(&mut part)?;
        request.extend_from_slice(part.get(..read).unwrap_or_default());
        if read == 0 || request.len() > MAX_REQUEST_BYTES || start.elapsed() > timeout {
            return Ok(None);
        }
    }
    Ok(Some(request))
}

/// Method and target of a request; empty if it has none.
fn request_line(request: &[u8]) -> (&str, &str) {
    let line = request.split(|&byte| byte == b'\r').next().unwrap_or_default();
    let mut words = std::str::from_utf8(line).unwrap_or_default().split(' ');
    (words.next().unwrap_or_default(), words.next().unwrap_or_default())
}

#[cfg(test)]
pub(crate) mod tests {
    use std::net::SocketAddr;

    use super::*;

    /// The answer to a request.
    pub(crate) fn ask(address: SocketAddr, request: &str) -> String {
        let mut stream = TcpStream::connect(address).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        stream.write_all(request.as_bytes()).unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        answer
    }

    /// The address of a page that says `# EOF`.
    fn endpoint() -> SocketAddr {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        serve(listener, Arc::new(|| "# EOF\n".to_owned()), Duration::from_secs(600)).unwrap();
        address
    }

    #[test]
    fn head_and_query_strings_work_and_other_requests_are_refused() {
        let address = endpoint();
        let whole = ask(address, "GET /metrics?name[]=up HTTP/1.1\r\n\r\n");
        assert!(
            whole.starts_with(&format!("HTTP/1.1 200 OK\r\nContent-Type: {CONTENT_TYPE}\r\n")),
            "{whole}"
        );
        assert!(whole.ends_with("\r\n\r\n# EOF\n"), "{whole}");
        let head = ask(address, "HEAD /metrics HTTP/1.1\r\n\r\n");
        assert_eq!(head, whole.split_inclusive("\r\n\r\n").next().unwrap(), "the same without a body");
        assert!(ask(address, "GET / HTTP/1.1\r\n\r\n").starts_with("HTTP/1.1 404"));
        assert!(ask(address, "POST /metrics HTTP/1.1\r\n\r\n").starts_with("HTTP/1.1 405"));
        assert_eq!(ask(address, &"x".repeat(MAX_REQUEST_BYTES + 1)), "");
    }

    #[test]
    fn idle_connections_do_not_delay_an_answer() {
        let address = endpoint();
        let idle: Vec<_> = (0..5).map(|_| TcpStream::connect(address).unwrap()).collect();
        let answer = ask(address, "GET /metrics HTTP/1.1\r\n\r\n");
        assert!(answer.starts_with("HTTP/1.1 200 OK"));
        // They are still connected: the answer did not wait until they timed out.
        for mut connection in idle {
            connection.write_all(b"GET /metrics HTTP/1.1\r\n\r\n").unwrap();
            let mut answer = String::new();
            connection.read_to_string(&mut answer).unwrap();
            assert!(answer.starts_with("HTTP/1.1 200 OK"), "{answer}");
        }
    }
}
