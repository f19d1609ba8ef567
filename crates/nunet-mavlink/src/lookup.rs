//! The addresses of a host, looked up on a thread of its own.

use std::io;
use std::net::{SocketAddr, ToSocketAddrs as _};
use std::sync::mpsc::{Receiver, TryRecvError, channel};

/// Looks up a host. The system's lookup may block for longer than a shutdown may last, and cannot be
/// canceled. So a thread waits for it, one at a time, which a shutdown abandons.
#[derive(Debug, Default)]
pub(crate) struct HostLookup {
    running: Option<Receiver<io::Result<Vec<SocketAddr>>>>,
}

impl HostLookup {
    /// The addresses of `HOST:PORT`, one or more; `None` while the lookup goes on. Never blocks.
    ///
    /// # Errors
    /// The host is unknown, or the thread cannot be started.
    pub(crate) fn poll(&mut self, host: &str) -> io::Result<Option<Vec<SocketAddr>>> {
        if let Ok(address) = host.parse() {
            return Ok(Some(vec![address]));
        }
        let host = host.to_owned();
        self.poll_with(move || resolved(&host))
    }

    /// [`poll`](Self::poll) with another lookup.
    pub(crate) fn poll_with(
        &mut self,
        look_up: impl FnOnce() -> io::Result<Vec<SocketAddr>> + Send + 'static,
    ) -> io::Result<Option<Vec<SocketAddr>>> {
        let Some(running) = &self.running else {
            let (found, running) = channel();
            // Nobody waits for an answer after a shutdown.
            let run = move || drop(found.send(look_up()));
            std::thread::Builder::new().name("mavlink lookup".into()).spawn(run)?;
            self.running = Some(running);
            return Ok(None);
        };
        let found = match running.try_recv() {
            Err(TryRecvError::Empty) => return Ok(None),
            Err(TryRecvError::Disconnected) => Err(io::Error::other("the lookup failed")),
            Ok(found) => found,
        };
        self.running = None;
        found.map(Some)
    }
}

fn resolved(host: &str) -> io::Result<Vec<SocketAddr>> {
    let addresses = loopback_v6_last(host.to_socket_addrs()?);
    if addresses.is_empty() {
        return Err(io::Error::new(io::ErrorKind::NotFound, format!("`{host}` has no address")));
    }
    Ok(addresses)
}

/// The addresses in the system's order, but `::1` last. It often comes first for `localhost`, and simulators
/// and ground stations listen on 127.0.0.1. A datagram that nobody receives is no error.
fn loopback_v6_last(addresses: impl Iterator<Item = SocketAddr>) -> Vec<SocketAddr> {
    let (last, mut addresses): (Vec<_>, Vec<_>) =
        addresses.partition(|address| address.is_ipv6() && address.ip().is_loopback());
    addresses.extend(last);
    addresses
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, Instant};

    use super::*;

    /// Polls until the lookup has ended.
    fn ended(lookup: &mut HostLookup, host: &str) -> io::Result<Vec<SocketAddr>> {
        let start = Instant::now();
        loop {
            if let Some(found) = lookup.poll(host).transpose() {
                return found;
            }
            assert!(start.elapsed() < Duration::from_secs(60), "the lookup does not end");
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    #[test]
    fn an_address_needs_no_lookup() {
        let mut lookup = HostLookup::default();
        for address in ["127.0.0.1:14550", "[::1]:5760"] {
            assert_eq!(lookup.poll(address).unwrap(), Some(vec![address.parse().unwrap()]));
        }
        assert!(lookup.running.is_none());
    }

    #[test]
    fn a_failed_lookup_is_reported_and_followed_by_another_one() {
        const HOST: &str = "autopilot:14550";
        let mut lookup = HostLookup::default();
        assert_eq!(lookup.poll_with(|| Err(io::ErrorKind::TimedOut.into())).unwrap(), None);
        assert_eq!(ended(&mut lookup, HOST).unwrap_err().kind(), io::ErrorKind::TimedOut);
        let address = SocketAddr::from(([10, 0, 0, 1], 14550));
        assert_eq!(lookup.poll_with(move || Ok(vec![address])).unwrap(), None);
        assert_eq!(ended(&mut lookup, HOST).unwrap(), [address]);
    }

    #[test]
    fn localhost_is_its_ipv4_address_first_and_other_hosts_keep_their_order() {
        let sorted = |addresses: &[&str]| -> Vec<String> {
            let found = addresses.iter().map(|address| address.parse().unwrap());
            loopback_v6_last(found).iter().map(ToString::to_string).collect()
        };
        assert_eq!(sorted(&["[::1]:5760", "127.0.0.1:5760"]), ["127.0.0.1:5760", "[::1]:5760"]);
        assert_eq!(sorted(&["[::1]:5760"]), ["[::1]:5760"]);
        let robot = ["[fd00::7]:5760", "10.0.0.7:5760"];
        assert_eq!(sorted(&robot), robot);
    }
}
