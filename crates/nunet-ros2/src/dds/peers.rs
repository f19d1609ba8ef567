//! Participants that no longer answer.

use std::collections::HashMap;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::rtps::Prefix;

/// A participant that answers nothing for so long is taken for dead. Middleware answers within milliseconds; its lease,
/// by which it would be found dead otherwise, is 20 s in ROS 2. `dust_dds` holds back reliable messages for all
/// until then.
const SILENCE: Duration = Duration::from_secs(2);

/// Participants that were asked for an answer and have not given one.
#[derive(Debug, Default)]
pub(super) struct Peers(Mutex<HashMap<Prefix, Instant>>);

impl Peers {
    /// `peer` was asked at `now`.
    pub(super) fn asked(&self, peer: Prefix, now: Instant) {
        self.lock().entry(peer).or_insert(now);
    }

    /// Something came from `peer`.
    pub(super) fn heard(&self, peer: Prefix) {
        self.lock().remove(&peer);
    }

    /// Those that were asked too long before `now`. They are forgotten.
    pub(super) fn take_silent(&self, now: Instant) -> Vec<Prefix> {
        let mut asked = self.lock();
        let is_silent = |since: &Instant| now.saturating_duration_since(*since) >= SILENCE;
        asked.extract_if(|_, since| is_silent(since)).map(|(peer, _)| peer).collect()
    }

    fn lock(&self) -> MutexGuard<'_, HashMap<Prefix, Instant>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_who_was_asked_and_did_not_answer_is_silent() {
        let (peers, start) = (Peers::default(), Instant::now());
        let (dead, alive) = ([1; 12], [2; 12]);
        peers.asked(dead, start);
        peers.asked(alive, start);
        peers.asked(dead, start + SILENCE / 2);
        peers.heard(alive);
        assert_eq!(peers.take_silent(start + SILENCE / 2), [[0; 12]; 0]);
        assert_eq!(peers.take_silent(start + SILENCE), [dead]);
        assert_eq!(peers.take_silent(start + SILENCE * 2), [[0; 12]; 0], "it may come back");
    }
}
