//! What arrives from other participants.

use std::io;
use std::net::{SocketAddrV4, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use tracing::debug;

use super::addresses::{OwnAddress, is_own, reachable};
use super::announcement::{discovery_addresses, extend_lease};
use super::found::Found;
use super::guard::{hide_misunderstood, is_acceptable, participant_payload};
use super::health::Library;
use super::peers::{Peers, REMOVED_AFTER};
use super::rtps::{Prefix, departure_of, end_of_readers, sender};
use super::sending::MAX_DATAGRAM_BYTES;
use super::subscriber::Inboxes;
use super::user_data::is_only_user_data;

/// How often receiving threads check whether they have to end.
const POLL_PERIOD: Duration = Duration::from_millis(200);
/// The transport removes participants that do not answer. The library does not, because it would match their
/// readers again.
const LEASE_SECONDS: i32 = 2 * REMOVED_AFTER.as_secs() as i32;

/// Hands what a socket receives to the subscribers and to the library, on a thread.
pub(super) struct Receiving {
    pub(super) socket: UdpSocket,
    pub(super) library: Library,
    pub(super) inboxes: Arc<Inboxes>,
    pub(super) peers: Arc<Peers>,
    pub(super) found: Arc<Found>,
    pub(super) own: Vec<OwnAddress>,
    /// The port of discovery of this participant.
    pub(super) own_port: u16,
    pub(super) ended: Arc<AtomicBool>,
}

impl Receiving {
    pub(super) fn start(self) -> io::Result<()> {
        self.socket.set_read_timeout(Some(POLL_PERIOD))?;
        std::thread::Builder::new().name("dds".to_owned()).spawn(move || self.run()).map(drop)
    }

    fn run(&self) {
        let mut buffer = vec![0; MAX_DATAGRAM_BYTES];
        while !self.ended.load(Ordering::Relaxed) && !self.library.has_ended() {
            // A timeout, or an error that is about an earlier datagram.
            let received = self.socket.recv(&mut buffer).unwrap_or_default();
            let datagram = buffer.get_mut(..received).unwrap_or_default();
            if let Some(peer) = sender(datagram).filter(|_| is_acceptable(datagram)) {
                self.take(peer, datagram);
            }
            for (gone, readers) in self.peers.take_gone(Instant::now()) {
                debug!("a ROS 2 participant has not answered for {REMOVED_AFTER:?}: {gone:02x?}");
                self.library.give(end_of_readers(gone, &readers));
                self.library.give(departure_of(gone, 1));
            }
        }
    }

    fn take(&self, peer: Prefix, datagram: &mut [u8]) {
        let now = Instant::now();
        for (held, to) in self.peers.heard(peer, now) {
            // One that is lost is sent again.
            let _ = self.socket.send_to(&held, to);
        }
        self.inboxes.put(datagram);
        if is_only_user_data(datagram) {
            return;
        }
        if let Some(payload) = participant_payload(datagram).and_then(|range| datagram.get_mut(range)) {
            let is_self =
                |address: &SocketAddrV4| address.port() == self.own_port && is_own(*address.ip(), &self.own);
            let address = reachable(&discovery_addresses(payload), &self.own);
            address.into_iter().filter(|address| !is_self(address)).for_each(|one| self.found.add(one, now));
            if self.peers.has_readers(peer) {
                extend_lease(payload, LEASE_SECONDS);
            }
        }
        hide_misunderstood(datagram);
        self.peers.renumber(peer, datagram);
        self.library.give(datagram.to_vec());
    }
}
