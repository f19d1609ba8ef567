//! Users and passwords before the host of a URL.

use std::net::{Ipv4Addr, Ipv6Addr};
use std::ops::Range;

/// The users and passwords in a URL without its scheme. Characters that a URL would have to escape may be in
/// them. Where the host is an IP address, it is found; otherwise it may be anything after the last `@`.
pub(super) fn in_url(url: &str) -> Vec<Range<usize>> {
    let hosts = url.match_indices('@').map(|(at, _)| at + 1).chain([0]);
    let address = |start: usize| Some(start..start + address_len(url.get(start..)?)?);
    let Some(address) = hosts.filter_map(address).max_by_key(|address| address.start) else {
        return Vec::from_iter(url.rfind('@').map(|at| 0..at).or_else(|| without_host(url)));
    };
    let path = url.get(address.end..).unwrap_or_default();
    let in_path = path.rfind('@').filter(|&at| path.get(..at).is_some_and(|path| path.contains(':')));
    let in_path = in_path.map(|at| address.end..address.end + at);
    let before = (address.start > 0).then(|| 0..address.start - 1);
    before.into_iter().chain(in_path).collect()
}

/// All of a URL whose port is no number: then it is a password.
fn without_host(url: &str) -> Option<Range<usize>> {
    let is_end = |c: char| matches!(c, '/' | '?' | '#') || c.is_whitespace();
    let (_, port) = url.split(is_end).next()?.rsplit_once(':')?;
    let port = port.trim_end_matches(|c: char| c.is_ascii_punctuation());
    (!port.bytes().all(|byte| byte.is_ascii_digit())).then_some(0..url.len())
}

/// The length of an IP address with its port, if `url` begins with them.
fn address_len(url: &str) -> Option<usize> {
    let host_len = match url.strip_prefix('[') {
        Some(rest) => {
            let (address, _) = rest.split_once(']')?;
            address.split('%').next()?.parse::<Ipv6Addr>().ok()?;
            "[]".len() + address.len()
        }
        None => {
            let len = url.find([':', '/', '?', '#']).unwrap_or(url.len());
            url.get(..len)?.parse::<Ipv4Addr>().ok()?;
            len
        }
    };
    let rest = url.get(host_len..)?;
    let after = match rest.strip_prefix(':') {
        Some(port) => port.trim_start_matches(|c: char| c.is_ascii_digit()),
        None => rest,
    };
    (after.is_empty() || after.starts_with(['/', '?', '#'])).then_some(url.len() - after.len())
}

/// `user:password@host`, perhaps after a scheme with a typing error.
pub(super) fn in_address(word: &str) -> Option<Range<usize>> {
    let at = word.rfind('@')?;
    let start = word.len() - word.trim_start_matches(['\'', '"']).len();
    word.get(start..at)?.contains(':').then_some(start..at)
}
