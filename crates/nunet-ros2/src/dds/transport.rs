//! UDP as ROS 2 uses it.

use std::io;
use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use dust_dds::std_runtime::executor::block_on;
use dust_dds::transport::interface::{
    RtpsTransportParticipant, TransportDataReceiver, TransportParticipantFactory, WriteMessage,
};
use dust_dds::transport::types::{LOCATOR_KIND_UDP_V4, Locator};
use socket2::{Domain, Protocol, SockRef, Socket, Type};
use tracing::debug;

use super::addresses::{
    MAX_PARTICIPANTS, MULTICAST_GROUP, OwnAddress, data_port, discovery_port, multicast_port, own_addresses,
    participants_on, reachable,
};
use super::peers::Peers;
use super::rtps::{asks_for_answer, farewell_of, hide_misunderstood, is_acceptable, sender};
use crate::environment::{DiscoveryRange, Environment};

/// The largest UDP datagram.
const MAX_DATAGRAM_BYTES: usize = 65_507;
/// One fragment per datagram. Readers name missing fragments in groups of 256: a fragment may not be much smaller, or a
/// large message takes several rounds to repair. It may not be much larger, or the loss of one packet of a wireless
/// network costs more.
const FRAGMENT_BYTES: usize = 16_000;
/// After so many bytes the sender pauses: a default receive buffer holds three times as much, and what does not fit is lost.
const BURST_BYTES: usize = 48 * 1024;
/// Time for readers to empty their receive buffers.
const PAUSE: Duration = Duration::from_micros(500);
/// Images that arrive must fit. The kernel limits it to `net.core.rmem_max`.
const RECEIVE_BUFFER_BYTES: usize = 4 << 20;
/// How often receiving threads check whether they have to end.
const POLL_PERIOD: Duration = Duration::from_millis(200);

/// The open sockets of a participant.
pub(super) struct UdpTransport {
    /// Taken by the participant.
    sockets: Mutex<Option<Sockets>>,
    ended: Arc<AtomicBool>,
}

struct Sockets {
    domain: u16,
    participant: u16,
    data: UdpSocket,
    discovery: UdpSocket,
    multicast: Option<UdpSocket>,
    own: Vec<OwnAddress>,
    announcements: Announcements,
}

/// Where the participant announces itself.
struct Announcements {
    /// One for each interface, to the multicast group.
    groups: Vec<UdpSocket>,
    group: SocketAddrV4,
    peers: Vec<SocketAddrV4>,
}

impl UdpTransport {
    /// Opens the sockets of the first free participant of the domain.
    pub(super) fn open(environment: &Environment) -> io::Result<Self> {
        let &Environment { domain, range, ref static_peers } = environment;
        let is_local = range != DiscoveryRange::Subnet;
        let own = if is_local { Vec::new() } else { own_addresses() };
        let host = if is_local { Ipv4Addr::LOCALHOST } else { Ipv4Addr::UNSPECIFIED };
        let (participant, discovery, data) = free_participant(domain, host)?;
        SockRef::from(&data).set_recv_buffer_size(RECEIVE_BUFFER_BYTES)?;
        let multicast = if is_local { None } else { Some(multicast_socket(domain, &own)?) };
        let machines = static_peers.iter().copied().chain([Ipv4Addr::LOCALHOST]);
        let is_self = |peer: &SocketAddrV4| {
            peer.ip().is_loopback() && peer.port() == discovery_port(domain, participant)
        };
        let peers = machines.flat_map(|machine| participants_on(machine, domain));
        let announcements = Announcements {
            groups: own.iter().filter_map(|address| group_sender(address.ip).ok()).collect(),
            group: SocketAddrV4::new(MULTICAST_GROUP, multicast_port(domain)),
            peers: match range {
                DiscoveryRange::Off => Vec::new(),
                _ => peers.filter(|peer| !is_self(peer)).collect(),
            },
        };
        let sockets = Sockets { domain, participant, data, discovery, multicast, own, announcements };
        Ok(Self { sockets: Mutex::new(Some(sockets)), ended: Arc::default() })
    }

    /// Set it to end the threads.
    pub(super) fn ended(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.ended)
    }
}

/// The sockets of the first participant whose ports are free.
fn free_participant(domain: u16, host: Ipv4Addr) -> io::Result<(u16, UdpSocket, UdpSocket)> {
    let mut failure = None;
    for participant in 0..MAX_PARTICIPANTS {
        let discovery = UdpSocket::bind((host, discovery_port(domain, participant)));
        let data = UdpSocket::bind((host, data_port(domain, participant)));
        match (discovery, data) {
            (Ok(discovery), Ok(data)) => return Ok((participant, discovery, data)),
            (Err(error), _) | (_, Err(error)) => failure = Some(error),
        }
    }
    Err(failure.unwrap_or_else(|| io::ErrorKind::AddrInUse.into()))
}

/// Receives announcements. All participants of this machine share its port.
fn multicast_socket(domain: u16, own: &[OwnAddress]) -> io::Result<UdpSocket> {
    let socket = Socket::new(Domain::IPV4, Type::DGRAM, Some(Protocol::UDP))?;
    socket.set_reuse_address(true)?;
    socket.set_reuse_port(true)?;
    socket.bind(&SocketAddrV4::new(Ipv4Addr::UNSPECIFIED, multicast_port(domain)).into())?;
    for address in own {
        if let Err(error) = socket.join_multicast_v4(&MULTICAST_GROUP, &address.ip) {
            debug!("no ROS 2 discovery by multicast on {}: {error}", address.ip);
        }
    }
    Ok(socket.into())
}

fn group_sender(interface: Ipv4Addr) -> io::Result<UdpSocket> {
    let socket = Socket::new(Domain::IPV4, Type::DGRAM, Some(Protocol::UDP))?;
    socket.set_multicast_if_v4(&interface)?;
    socket.set_multicast_loop_v4(true)?;
    Ok(socket.into())
}

impl TransportParticipantFactory for UdpTransport {
    fn create_participant(&self, _domain: i32, receiver: TransportDataReceiver) -> RtpsTransportParticipant {
        let taken = self.sockets.lock().unwrap_or_else(PoisonError::into_inner).take();
        match taken.map(|sockets| sockets.start(receiver, &self.ended)) {
            Some(Ok(participant)) => participant,
            Some(Err(_)) | None => {
                participant_of(Box::new(Nowhere(Vec::new())), [Vec::new(), Vec::new(), Vec::new()])
            }
        }
    }
}

fn participant_of(
    message_writer: Box<dyn WriteMessage + Send + Sync>,
    [data, discovery, multicast]: [Vec<Locator>; 3],
) -> RtpsTransportParticipant {
    RtpsTransportParticipant {
        message_writer,
        default_unicast_locator_list: data,
        metatraffic_unicast_locator_list: discovery,
        metatraffic_multicast_locator_list: multicast,
        default_multicast_locator_list: Vec::new(),
        fragment_size: FRAGMENT_BYTES,
    }
}

impl Sockets {
    fn start(
        self,
        receiver: TransportDataReceiver,
        ended: &Arc<AtomicBool>,
    ) -> io::Result<RtpsTransportParticipant> {
        let Self { domain, participant, data, discovery, multicast, own, announcements } = self;
        let peers = Arc::new(Peers::default());
        let socket = data.try_clone()?;
        for socket in [Some(data), Some(discovery), multicast].into_iter().flatten() {
            let thread = Receiving {
                socket,
                receiver: receiver.clone(),
                peers: Arc::clone(&peers),
                ended: Arc::clone(ended),
            };
            thread.start()?;
        }
        let stated = if own.is_empty() { vec![OwnAddress::LOCALHOST] } else { own.clone() };
        let at = |port| stated.iter().map(|address| locator(address.ip, port)).collect::<Vec<_>>();
        let locators = [
            at(data_port(domain, participant)),
            at(discovery_port(domain, participant)),
            vec![locator(MULTICAST_GROUP, multicast_port(domain))],
        ];
        let buffer = vec![0; MAX_DATAGRAM_BYTES];
        let writer = Sending { socket, buffer, own, announcements, peers, burst_bytes: 0 };
        Ok(participant_of(Box::new(writer), locators))
    }
}

fn locator(ip: Ipv4Addr, port: u16) -> Locator {
    let mut address = [0; 16];
    address[12..].copy_from_slice(&ip.octets());
    Locator::new(LOCATOR_KIND_UDP_V4, port.into(), address)
}

/// `None` for other transports, such as shared memory.
fn socket_address(locator: &Locator) -> Option<SocketAddrV4> {
    let [.., a, b, c, d] = locator.address();
    let port = u16::try_from(locator.port()).ok()?;
    (locator.kind() == LOCATOR_KIND_UDP_V4).then(|| SocketAddrV4::new(Ipv4Addr::new(a, b, c, d), port))
}

/// Hands what a socket receives to the library, on a thread.
struct Receiving {
    socket: UdpSocket,
    receiver: TransportDataReceiver,
    peers: Arc<Peers>,
    ended: Arc<AtomicBool>,
}

impl Receiving {
    fn start(self) -> io::Result<()> {
        self.socket.set_read_timeout(Some(POLL_PERIOD))?;
        std::thread::Builder::new().name("dds".to_owned()).spawn(move || self.run()).map(drop)
    }

    fn run(&self) {
        let mut buffer = vec![0; MAX_DATAGRAM_BYTES];
        while !self.ended.load(Ordering::Relaxed) {
            // A timeout, or an error that is about an earlier datagram.
            let received = self.socket.recv(&mut buffer).unwrap_or_default();
            let datagram = buffer.get_mut(..received).unwrap_or_default();
            if let Some(peer) = sender(datagram).filter(|_| is_acceptable(datagram)) {
                self.peers.heard(peer);
                hide_misunderstood(datagram);
                block_on(self.receiver.receive_message(datagram.to_vec()));
            }
            for silent in self.peers.take_silent(Instant::now()) {
                debug!("a ROS 2 participant does not answer: {silent:02x?}");
                block_on(self.receiver.receive_message(farewell_of(silent)));
            }
        }
    }
}

/// Sends what the library writes.
struct Sending {
    socket: UdpSocket,
    buffer: Vec<u8>,
    own: Vec<OwnAddress>,
    announcements: Announcements,
    peers: Arc<Peers>,
    /// Sent since the last pause.
    burst_bytes: usize,
}

impl Sending {
    /// A datagram that is lost is sent again, or was not worth it.
    fn send(&mut self, length: usize, to: SocketAddrV4) {
        let datagram = self.buffer.get(..length).unwrap_or_default();
        let _ = self.socket.send_to(datagram, to);
        if let Some(peer) = asks_for_answer(datagram) {
            self.peers.asked(peer, Instant::now());
        }
        self.burst_bytes += length;
        if self.burst_bytes > BURST_BYTES {
            self.burst_bytes = 0;
            std::thread::sleep(PAUSE);
        }
    }

    fn announce(&self, length: usize) {
        let datagram = self.buffer.get(..length).unwrap_or_default();
        let Announcements { groups, group, peers } = &self.announcements;
        groups.iter().for_each(|socket| drop(socket.send_to(datagram, group)));
        peers.iter().for_each(|peer| drop(self.socket.send_to(datagram, peer)));
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

/// The sockets are gone.
struct Nowhere(Vec<u8>);

impl WriteMessage for Nowhere {
    fn write_buffer_mut(&mut self) -> &mut [u8] {
        self.0.resize(MAX_DATAGRAM_BYTES, 0);
        &mut self.0
    }

    fn write_message(&mut self, _length: usize, _locators: &[Locator]) {}
}
