//! What the library sends.

use std::net::{SocketAddrV4, UdpSocket};
use std::sync::Arc;
use std::sync::mpsc::Sender;
use std::time::Instant;

use dust_dds::transport::interface::WriteMessage;
use dust_dds::transport::types::{LOCATOR_KIND_UDP_V4, Locator};

use super::addresses::{OwnAddress, is_own, reachable};
use super::announcement::limit_endpoints;
use super::found::Found;
use super::guard::participant_payload;
use super::pace::Pace;
use super::peers::{Outgoing, Peers};
use super::rtps::understood_departure;

/// The largest UDP datagram.
pub(super) const MAX_DATAGRAM_BYTES: usize = 65_507;

/// Where the participant announces itself.
pub(super) struct Announcements {
    /// One for each interface, to the multicast group.
    pub(super) groups: Vec<UdpSocket>,
    pub(super) group: SocketAddrV4,
    pub(super) peers: Vec<SocketAddrV4>,
    pub(super) found: Arc<Found>,
}

/// Sends what the library writes.
pub(super) struct Sending {
    pub(super) socket: UdpSocket,
    pub(super) buffer: Vec<u8>,
    pub(super) own: Vec<OwnAddress>,
    pub(super) announcements: Announcements,
    pub(super) peers: Arc<Peers>,
    /// Takes what the library gets in the place of silent readers. It is inside the library when it sends.
    pub(super) answers: Sender<Vec<u8>>,
    pub(super) pace: Pace,
}

impl Sending {
    /// A datagram that is lost is sent again, or was not worth it.
    fn send(&mut self, length: usize, to: SocketAddrV4) {
        let datagram = self.buffer.get(..length).unwrap_or_default();
        let Outgoing { is_sent, answer } = self.peers.outgoing(datagram, to, Instant::now());
        answer.into_iter().for_each(|answer| drop(self.answers.send(answer)));
        if !is_sent {
            return;
        }
        let _ = self.socket.send_to(datagram, to);
        self.pace.sent(length, to, is_own(*to.ip(), &self.own));
    }

    fn announce(&mut self, length: usize) {
        let datagram = self.buffer.get_mut(..length).unwrap_or_default();
        if let Some(payload) = participant_payload(datagram).and_then(|range| datagram.get_mut(range)) {
            limit_endpoints(payload);
        }
        let datagram: &[u8] = datagram;
        let departure = understood_departure(datagram);
        let datagram = departure.as_deref().unwrap_or(datagram);
        let Announcements { groups, group, peers, found } = &self.announcements;
        groups.iter().for_each(|socket| drop(socket.send_to(datagram, group)));
        let found = found.at(Instant::now());
        let others = found.iter().filter(|address| !peers.contains(address));
        peers.iter().chain(others).for_each(|peer| drop(self.socket.send_to(datagram, peer)));
    }
}

impl WriteMessage for Sending {
    fn write_buffer_mut(&mut self) -> &mut [u8] {
        &mut self.buffer
    }

    fn write_message(&mut self, length: usize, locators: &[Locator]) {
        let (groups, addresses): (Vec<_>, Vec<_>) =
            locators.iter().filter_map(socket_address).partition(|address| address.ip().is_multicast());
        if !groups.is_empty() {
            self.announce(length);
        }
        if let Some(address) = reachable(&addresses, &self.own) {
            self.send(length, address);
        }
    }
}

/// `None` for other transports, such as shared memory.
fn socket_address(locator: &Locator) -> Option<SocketAddrV4> {
    let [.., a, b, c, d] = locator.address();
    let port = u16::try_from(locator.port()).ok()?;
    (locator.kind() == LOCATOR_KIND_UDP_V4).then(|| SocketAddrV4::new([a, b, c, d].into(), port))
}

/// The sockets are gone.
pub(super) struct Nowhere(pub(super) Vec<u8>);

impl WriteMessage for Nowhere {
    fn write_buffer_mut(&mut self) -> &mut [u8] {
        self.0.resize(MAX_DATAGRAM_BYTES, 0);
        &mut self.0
    }

    fn write_message(&mut self, _length: usize, _locators: &[Locator]) {}
}
