//! Passwords in URLs of network cameras: never part of a message.

use std::borrow::Cow;

const AFTER_SCHEME: &str = "://";

/// A text as it may be shown: each URL in it without its user and password.
pub(crate) fn without_passwords(text: &str) -> Cow<'_, str> {
    if !text.contains(AFTER_SCHEME) {
        return text.into();
    }
    let mut shown = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(start) = rest.find(AFTER_SCHEME) {
        let (before, url) = rest.split_at(start + AFTER_SCHEME.len());
        shown.push_str(before);
        let ends_url = |c: char| c.is_whitespace() || matches!(c, '\'' | '"' | '`' | '<' | '>');
        let (url, after) = url.split_at(url.find(ends_url).unwrap_or(url.len()));
        match end_of_user(url) {
            Some(end) => shown.extend(["***@", &url[end..]]),
            None => shown.push_str(url),
        }
        rest = after;
    }
    shown.push_str(rest);
    shown.into()
}

/// Where the host begins in a URL without its scheme, after a user; `None` without one.
fn end_of_user(url: &str) -> Option<usize> {
    let (host, _) = url.split_once(['/', '?', '#']).unwrap_or((url, ""));
    // A slash in a password must be escaped. Where it is not, what looks like the port is no number.
    let has_port = host.rsplit_once(':').is_none_or(|(_, port)| port.bytes().all(|c| c.is_ascii_digit()));
    let user = host.rfind('@').or_else(|| if has_port { None } else { url.rfind('@') })?;
    Some(user + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn users_and_passwords_are_replaced_wherever_a_url_is() {
        for (text, shown) in [
            ("rtsp://10.0.0.4/front", "rtsp://10.0.0.4/front"),
            ("rtsp://10.0.0.4:554/a@b", "rtsp://10.0.0.4:554/a@b"),
            ("rtsp://[fe80::1]:554/a@b", "rtsp://[fe80::1]:554/a@b"),
            ("rtsp://admin:s3cret@10.0.0.4:554/a@b", "rtsp://***@10.0.0.4:554/a@b"),
            ("rtsp://admin:p@ss@cam", "rtsp://***@cam"),
            ("rtsp://admin:p/ss@cam/a", "rtsp://***@cam/a"),
            ("ffmpeg -i 'rtsp://a:b@c/d' -i http://e:f@g", "ffmpeg -i 'rtsp://***@c/d' -i http://***@g"),
            ("write to me@example.org", "write to me@example.org"),
            ("", ""),
        ] {
            assert_eq!(without_passwords(text), shown);
        }
    }
}
