//! The addresses of participants that announced themselves.

use std::collections::HashMap;
use std::net::SocketAddrV4;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Announcements come every few seconds, from Cyclone DDS every 30.
const FORGOTTEN_AFTER: Duration = Duration::from_secs(100);
/// A participant can state any address: announcements to more of them are refused.
const MAX_FOUND: usize = 128;

/// The addresses of participants that found this one, which may not have found them.
#[derive(Debug, Default)]
pub(super) struct Found(Mutex<HashMap<SocketAddrV4, Instant>>);

impl Found {
    /// A participant announced itself at `now`.
    pub(super) fn add(&self, address: SocketAddrV4, now: Instant) {
        let mut found = self.lock();
        if found.len() < MAX_FOUND || found.contains_key(&address) {
            found.insert(address, now);
        }
    }

    /// The addresses that are not outdated at `now`.
    pub(super) fn at(&self, now: Instant) -> Vec<SocketAddrV4> {
        let mut found = self.lock();
        found.retain(|_, last| now.saturating_duration_since(*last) < FORGOTTEN_AFTER);
        found.keys().copied().collect()
    }

    fn lock(&self) -> MutexGuard<'_, HashMap<SocketAddrV4, Instant>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use std::net::Ipv4Addr;

    use super::*;

    #[test]
    fn addresses_are_kept_while_they_are_announced_and_their_number_is_limited() {
        let (found, start) = (Found::default(), Instant::now());
        let address = |port| SocketAddrV4::new(Ipv4Addr::LOCALHOST, port);
        found.add(address(1), start);
        found.add(address(2), start + FORGOTTEN_AFTER / 2);
        assert_eq!(found.at(start + FORGOTTEN_AFTER), [address(2)]);
        (0..1000).for_each(|port| found.add(address(port), start + FORGOTTEN_AFTER));
        assert_eq!(found.at(start + FORGOTTEN_AFTER).len(), MAX_FOUND);
    }
}
