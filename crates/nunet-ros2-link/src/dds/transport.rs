//! UDP as ROS 2 uses it.

use std::io;
use std::net::{Ipv4Addr, SocketAddrV4, UdpSocket};
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, PoisonError};

use dust_dds::transport::interface::{
    RtpsTransportParticipant, TransportDataReceiver, TransportParticipantFactory, WriteMessage,
};
use dust_dds::transport::types::{LOCATOR_KIND_UDP_V4, Locator};
use socket2::{Domain, Protocol, SockRef, Socket, Type};
use tracing::debug;

use super::addresses::{
    MAX_PARTICIPANTS, MULTICAST_GROUP, OwnAddress, data_port, discovery_port, is_own, multicast_port,
    own_addresses, participants_on,
};
use super::health::{Library, LibraryState};
use super::pace::Pace;
use super::peers::Peers;
use super::receiving::Receiving;
use super::sending::{Announcements, MAX_DATAGRAM_BYTES, Nowhere, Sending};
use super::subscriber::Inboxes;
use crate::environment::{DiscoveryRange, Environment};

/// One fragment per datagram. Readers name missing fragments in groups of 256: a fragment may not be much
/// smaller, or a large message takes several rounds to repair. It may not be much larger, or the loss of one
/// packet of a wireless network costs more.
const FRAGMENT_BYTES: usize = 16_000;
/// Images that arrive must fit. The kernel limits it to `net.core.rmem_max`.
const RECEIVE_BUFFER_BYTES: usize = 4 << 20;

/// The open sockets of a participant.
pub(super) struct UdpTransport {
    /// Taken by the participant.
    sockets: Mutex<Option<Sockets>>,
    shared: Shared,
}

/// What the transport and its users share.
#[derive(Clone, Default)]
pub(super) struct Shared {
    /// Where messages for subscribers arrive.
    pub(super) inboxes: Arc<Inboxes>,
    /// What is known of other participants.
    pub(super) peers: Arc<Peers>,
    /// Whether the library works.
    pub(super) health: Arc<LibraryState>,
    /// Set it to end the threads.
    pub(super) ended: Arc<AtomicBool>,
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

impl UdpTransport {
    /// Opens the sockets of the first free participant of the domain. `static_peers` are the addresses of
    /// those of `environment`.
    pub(super) fn open(environment: &Environment, static_peers: &[Ipv4Addr]) -> io::Result<Self> {
        let &Environment { domain, range, .. } = environment;
        let is_local = range != DiscoveryRange::Subnet;
        // Nothing can be sent to another machine from a socket of the loopback.
        let is_on_loopback = is_local && static_peers.is_empty();
        let own = if is_on_loopback { Vec::new() } else { own_addresses() };
        let host = if is_on_loopback { Ipv4Addr::LOCALHOST } else { Ipv4Addr::UNSPECIFIED };
        let (participant, discovery, data) = free_participant(domain, host)?;
        SockRef::from(&data).set_recv_buffer_size(RECEIVE_BUFFER_BYTES)?;
        let multicast = if is_local { None } else { Some(multicast_socket(domain, &own)?) };
        let machines = static_peers.iter().copied().chain([Ipv4Addr::LOCALHOST]);
        let is_self = |peer: &SocketAddrV4| {
            is_own(*peer.ip(), &own) && peer.port() == discovery_port(domain, participant)
        };
        let peers = machines.flat_map(|machine| participants_on(machine, domain));
        let announcements = Announcements {
            groups: if is_local { Vec::new() } else { group_senders(&own) },
            group: SocketAddrV4::new(MULTICAST_GROUP, multicast_port(domain)),
            peers: match range {
                DiscoveryRange::Off => Vec::new(),
                _ => peers.filter(|peer| !is_self(peer)).collect(),
            },
            found: Arc::default(),
        };
        let sockets = Sockets { domain, participant, data, discovery, multicast, own, announcements };
        Ok(Self { sockets: Mutex::new(Some(sockets)), shared: Shared::default() })
    }

    pub(super) fn shared(&self) -> Shared {
        self.shared.clone()
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

fn group_senders(own: &[OwnAddress]) -> Vec<UdpSocket> {
    own.iter().filter_map(|address| group_sender(address.ip).ok()).collect()
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
        let started = taken.map(|sockets| sockets.start(receiver, self.shared())).transpose();
        if let Err(error) = &started {
            self.shared.health.end(&format!("a socket or thread cannot be used: {error}"));
        }
        let nowhere = || participant_of(Box::new(Nowhere(Vec::new())), [Vec::new(), Vec::new(), Vec::new()]);
        started.ok().flatten().unwrap_or_else(nowhere)
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
    fn start(self, receiver: TransportDataReceiver, shared: Shared) -> io::Result<RtpsTransportParticipant> {
        let Self { domain, participant, data, discovery, multicast, own, announcements } = self;
        let Shared { inboxes, peers, health, ended } = shared;
        let library = Library { receiver, health };
        let socket = data.try_clone()?;
        for socket in [Some(data), Some(discovery), multicast].into_iter().flatten() {
            let thread = Receiving {
                socket,
                library: library.clone(),
                inboxes: Arc::clone(&inboxes),
                peers: Arc::clone(&peers),
                found: Arc::clone(&announcements.found),
                own: own.clone(),
                own_port: discovery_port(domain, participant),
                ended: Arc::clone(&ended),
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
        let answers = library.start_answering()?;
        let writer = Sending { socket, buffer, own, announcements, peers, answers, pace: Pace::new() };
        Ok(participant_of(Box::new(writer), locators))
    }
}

fn locator(ip: Ipv4Addr, port: u16) -> Locator {
    let mut address = [0; 16];
    address[12..].copy_from_slice(&ip.octets());
    Locator::new(LOCATOR_KIND_UDP_V4, port.into(), address)
}
