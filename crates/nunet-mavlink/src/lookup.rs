//! The address of a host, looked up on a thread of its own.

use std::io;
use std::net::{SocketAddr, ToSocketAddrs as _};
use std::sync::mpsc::{Receiver, TryRecvError, channel};

/// Looks up a host. The system's lookup may block for longer than a shutdown may last, and cannot be
/// canceled. So a thread waits for it, one at a time, which a shutdown abandons.
#[derive(Debug, Default)]
pub(crate) struct HostLookup {
    running: Option<Receiver<io::Result<SocketAddr>>>,
}

impl HostLookup {
    /// The address of `HOST:PORT`; `None` while the lookup goes on. Never blocks.
    ///
    /// # Errors
    /// The host is unknown, or the thread cannot be started.
    pub(crate) fn poll(&mut self, host: &str) -> io::Result<Option<SocketAddr>> {
        if let Ok(address) = host.parse() {
            return Ok(Some(address));
        }
        let host = host.to_owned();
        self.poll_with(move || resolved(&host))
    }

    /// [`poll`](Self::poll) with another lookup.
    pub(crate) fn poll_with(
        &mut self,
        look_up: impl FnOnce() -> io::Result<SocketAddr> + Send + 'static,
    ) -> io::Result<Option<SocketAddr>> {
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

fn resolved(host: &str) -> io::Result<SocketAddr> {
    let unknown = || io::Error::new(io::ErrorKind::NotFound, format!("`{host}` has no address"));
    host.to_socket_addrs()?.next().ok_or_else(unknown)
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, Instant};

    use super::*;

    /// Polls until the lookup has ended.
    fn ended(lookup: &mut HostLookup, host: &str) -> io::Result<SocketAddr> {
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
            assert_eq!(lookup.poll(address).unwrap(), Some(address.parse().unwrap()));
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
        assert_eq!(lookup.poll_with(move || Ok(address)).unwrap(), None);
        assert_eq!(ended(&mut lookup, HOST).unwrap(), address);
    }
}
