//! Participants that do not answer.
//!
//! `dust_dds` sends no reliable message to any reader while one reader has not confirmed the fifth before it.
//! Middleware answers within milliseconds; its lease, by which a dead participant would be found, is 20 s in
//! ROS 2. So the transport confirms in the place of readers that have been silent for 2 s, and sends them
//! only one question per second. Once a participant answers again, it receives the last heartbeats and
//! requests what it missed.

use std::collections::HashMap;
use std::net::SocketAddrV4;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::rtps::{
    Endpoints, Prefix, Question, answer, carries_topic, destination, is_of_topic, question, renumber,
};

/// Readers of a participant that does not answer for this time do not delay others.
const SILENCE: Duration = Duration::from_secs(2);
/// How often a silent participant is asked again.
const PROBE_PERIOD: Duration = Duration::from_secs(1);
/// A participant that is silent for this time is removed. One that comes back later has to subscribe again.
pub(super) const REMOVED_AFTER: Duration = Duration::from_secs(300);
/// A publisher that sent nothing for this time does not count any more. All announce themselves, Cyclone DDS
/// every 30 s.
const LOST_AFTER: Duration = Duration::from_secs(70);
/// Further participants are not watched. Any machine can make up participants.
const MAX_PEERS: usize = 1024;

/// What is known of other participants.
#[derive(Debug, Default)]
pub(super) struct Peers(Mutex<HashMap<Prefix, Peer>>);

#[derive(Debug)]
struct Peer {
    /// The first question that it has not answered.
    asked: Option<Instant>,
    /// When it was asked last while it was silent.
    probed: Option<Instant>,
    heard: Instant,
    is_removed: bool,
    readers: HashMap<Endpoints, Reader>,
}

/// A reader of the participant, with one of our writers.
#[derive(Debug, Default)]
struct Reader {
    /// The number of its last confirmation. The library ignores those that are not higher.
    count: u32,
    /// Confirmations in its place, which it does not count.
    added: u32,
    /// The last datagram with a heartbeat that it did not get.
    held: Option<Held>,
}

/// A datagram and its destination.
pub(super) type Held = (Vec<u8>, SocketAddrV4);

/// What happens with a datagram.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Outgoing {
    pub(super) is_sent: bool,
    /// For the library, in the place of a silent reader.
    pub(super) answer: Option<Vec<u8>>,
}

impl Peers {
    /// Decides about a datagram of the library at `now`.
    pub(super) fn outgoing(&self, datagram: &[u8], to: SocketAddrV4, now: Instant) -> Outgoing {
        let mut outgoing = Outgoing { is_sent: true, answer: None };
        let mut peers = self.lock();
        let Some(peer) = destination(datagram).and_then(|prefix| entry(&mut peers, prefix, now)) else {
            return outgoing;
        };
        let is_silent = peer.is_silent(now);
        let question = question(datagram);
        if question.is_some() {
            peer.asked.get_or_insert(now);
        }
        if !is_silent || !carries_topic(datagram) {
            return outgoing;
        }
        outgoing.is_sent = false;
        if let Some(question) = question {
            outgoing.is_sent = peer.is_time_for_probe(now);
            outgoing.answer = Some(peer.answer(&question, (datagram.to_vec(), to)));
        }
        outgoing
    }

    /// Something came from `prefix`. Returns what it did not get.
    pub(super) fn heard(&self, prefix: Prefix, now: Instant) -> Vec<Held> {
        let mut peers = self.lock();
        let Some(peer) = entry(&mut peers, prefix, now) else { return Vec::new() };
        (peer.asked, peer.probed, peer.heard, peer.is_removed) = (None, None, now, false);
        peer.readers.values_mut().filter_map(|reader| reader.held.take()).collect()
    }

    /// Makes the library count the confirmations in a datagram, also behind those in the place of a reader.
    pub(super) fn renumber(&self, prefix: Prefix, datagram: &mut [u8]) {
        let mut peers = self.lock();
        let Some(peer) = peers.get_mut(&prefix) else { return };
        renumber(datagram, |endpoints, count| {
            if !is_of_topic(endpoints)
                || (peer.readers.len() >= MAX_PEERS && !peer.readers.contains_key(&endpoints))
            {
                return count;
            }
            let reader = peer.readers.entry(endpoints).or_default();
            reader.count = count.wrapping_add(reader.added);
            reader.count
        });
    }

    /// Whether `prefix` does not answer at `now`.
    pub(super) fn is_silent(&self, prefix: Prefix, now: Instant) -> bool {
        self.lock().get(&prefix).is_some_and(|peer| peer.is_silent(now))
    }

    /// Whether `prefix` does not answer at `now`, or nothing has come from it for long.
    pub(super) fn is_lost(&self, prefix: Prefix, now: Instant) -> bool {
        let is_old = |peer: &Peer| now.saturating_duration_since(peer.heard) >= LOST_AFTER;
        self.lock().get(&prefix).is_some_and(|peer| peer.is_silent(now) || is_old(peer))
    }

    /// Whether `prefix` has readers that confirm messages.
    pub(super) fn has_readers(&self, prefix: Prefix) -> bool {
        self.lock().get(&prefix).is_some_and(|peer| !peer.readers.is_empty())
    }

    /// Those that are removed at `now`, with their readers.
    pub(super) fn take_gone(&self, now: Instant) -> Vec<(Prefix, Vec<Endpoints>)> {
        let mut peers = self.lock();
        peers.retain(|_, peer| now.saturating_duration_since(peer.heard) < 2 * REMOVED_AFTER);
        let is_gone = |peer: &Peer| !peer.is_removed && peer.is_silent_for(REMOVED_AFTER, now);
        let gone = peers.iter_mut().filter(|(_, peer)| is_gone(peer)).map(|(prefix, peer)| {
            peer.is_removed = true;
            (*prefix, peer.readers.drain().map(|(endpoints, _)| endpoints).collect())
        });
        gone.collect()
    }

    fn lock(&self) -> MutexGuard<'_, HashMap<Prefix, Peer>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn entry(peers: &mut HashMap<Prefix, Peer>, prefix: Prefix, now: Instant) -> Option<&mut Peer> {
    if peers.len() >= MAX_PEERS && !peers.contains_key(&prefix) {
        return None;
    }
    let new = || Peer { asked: None, probed: None, heard: now, is_removed: false, readers: HashMap::new() };
    Some(peers.entry(prefix).or_insert_with(new))
}

impl Peer {
    fn is_silent(&self, now: Instant) -> bool {
        self.is_silent_for(SILENCE, now)
    }

    fn is_silent_for(&self, time: Duration, now: Instant) -> bool {
        self.asked.is_some_and(|since| now.saturating_duration_since(since) >= time)
    }

    fn is_time_for_probe(&mut self, now: Instant) -> bool {
        let is_time = self.probed.is_none_or(|last| now.saturating_duration_since(last) >= PROBE_PERIOD);
        if is_time {
            self.probed = Some(now);
        }
        is_time
    }

    /// Confirms in the place of a reader, and keeps the question for it.
    fn answer(&mut self, question: &Question, held: Held) -> Vec<u8> {
        let reader = self.readers.entry(question.endpoints).or_default();
        reader.held = Some(held);
        reader.added = reader.added.wrapping_add(1);
        reader.count = reader.count.wrapping_add(1);
        answer(question, reader.count)
    }
}

#[cfg(test)]
mod tests {
    use super::super::rtps::tests::{acknack, data_frag, heartbeat};
    use super::*;

    const PEER: Prefix = [1; 12];
    const OTHER: Prefix = [2; 12];
    /// A reader and a writer of a topic.
    const TOPIC: Endpoints = [0, 0, 0x12, 4, 0, 0, 0x11, 3];
    const BUILTIN: Endpoints = [0, 0, 4, 0xc7, 0, 0, 4, 0xc2];
    const TO: SocketAddrV4 = SocketAddrV4::new(std::net::Ipv4Addr::LOCALHOST, 7411);
    const PASSED: Outgoing = Outgoing { is_sent: true, answer: None };
    const DROPPED: Outgoing = Outgoing { is_sent: false, answer: None };

    fn count(datagram: &[u8]) -> u32 {
        let mut found = Vec::new();
        renumber(&mut datagram.to_vec(), |_, count| {
            found.push(count);
            count
        });
        found[0]
    }

    #[test]
    fn readers_that_are_silent_are_answered_for_until_they_are_heard_again() {
        let (peers, start) = (Peers::default(), Instant::now());
        let at = |seconds: f64| start + Duration::from_secs_f64(seconds);
        let mut own = acknack(TOPIC, 7);
        peers.heard(PEER, start);
        peers.renumber(PEER, &mut own);
        assert_eq!(count(&own), 7);
        assert_eq!(peers.outgoing(&heartbeat(PEER, TOPIC, 1), TO, at(0.0)), PASSED);
        assert_eq!(peers.outgoing(&heartbeat(PEER, TOPIC, 2), TO, at(1.9)), PASSED);
        assert!(!peers.is_silent(PEER, at(1.9)) && peers.is_silent(PEER, at(2.0)));
        let first = peers.outgoing(&heartbeat(PEER, TOPIC, 3), TO, at(2.0));
        assert!(first.is_sent, "a question whether it is there again");
        assert_eq!(first.answer.as_deref().map(count), Some(8));
        let second = peers.outgoing(&heartbeat(PEER, TOPIC, 4), TO, at(2.5));
        assert_eq!((second.is_sent, second.answer.as_deref().map(count)), (false, Some(9)));
        assert_eq!(peers.outgoing(&data_frag(PEER, TOPIC), TO, at(2.5)), DROPPED);
        assert_eq!(peers.outgoing(&heartbeat(PEER, BUILTIN, 1), TO, at(2.5)), PASSED, "discovery goes on");
        assert_eq!(peers.outgoing(&heartbeat(OTHER, TOPIC, 4), TO, at(2.5)), PASSED);
        assert_eq!(
            peers.heard(PEER, at(3.0)),
            [(heartbeat(PEER, TOPIC, 4), TO)],
            "it asks for what it missed"
        );
        assert!(!peers.is_silent(PEER, at(9.0)));
        let mut later = acknack(TOPIC, 8);
        peers.renumber(PEER, &mut later);
        assert_eq!(count(&later), 10, "higher than those in its place");
        assert_eq!(peers.outgoing(&heartbeat(PEER, TOPIC, 5), TO, at(9.0)), PASSED);
    }

    #[test]
    fn the_dead_are_removed_once_with_their_readers() {
        let (peers, start) = (Peers::default(), Instant::now());
        peers.outgoing(&heartbeat(PEER, TOPIC, 1), TO, start);
        peers.outgoing(&heartbeat(PEER, TOPIC, 2), TO, start + SILENCE);
        assert!(peers.has_readers(PEER) && peers.take_gone(start + SILENCE).is_empty());
        assert_eq!(peers.take_gone(start + REMOVED_AFTER), [(PEER, vec![TOPIC])]);
        assert!(peers.take_gone(start + REMOVED_AFTER + SILENCE).is_empty());
        assert!(peers.is_silent(PEER, start + REMOVED_AFTER + SILENCE), "the library may match it again");
        peers.take_gone(start + 2 * REMOVED_AFTER);
        assert!(peers.lock().is_empty(), "nothing is kept for ever");
    }

    #[test]
    fn one_of_which_nothing_comes_is_lost_until_it_is_heard_again() {
        let (peers, start) = (Peers::default(), Instant::now());
        assert!(!peers.is_lost(PEER, start), "nothing is known of it");
        peers.heard(PEER, start);
        assert!(!peers.is_lost(PEER, start + SILENCE) && peers.is_lost(PEER, start + LOST_AFTER));
        peers.heard(PEER, start + LOST_AFTER);
        peers.outgoing(&heartbeat(PEER, BUILTIN, 1), TO, start + LOST_AFTER);
        assert!(!peers.is_lost(PEER, start + LOST_AFTER));
        assert!(peers.is_lost(PEER, start + LOST_AFTER + SILENCE), "it does not answer");
    }

    #[test]
    fn made_up_participants_take_no_more_memory() {
        let (peers, now) = (Peers::default(), Instant::now());
        for number in 0..2 * MAX_PEERS as u32 {
            let [a, b, c, d] = number.to_be_bytes();
            peers.heard([a, b, c, d, 0, 0, 0, 0, 0, 0, 0, 0], now);
        }
        assert_eq!(peers.lock().len(), MAX_PEERS);
    }
}
